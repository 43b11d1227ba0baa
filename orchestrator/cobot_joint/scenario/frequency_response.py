"""Speed over current as in thesis 4.4: a run per frequency, amplitudes from the series, compared with Table C.1."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lti

from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.errors import UserError
from cobot_joint.results.figures import COLOUR, COLOURS, Curve, Panel, Picture
from cobot_joint.results.files import SignalsWriter, header, provenance, write_csv
from cobot_joint.scenario.model import FrequencyResponse, Variant
from cobot_joint.scenario.options import TRANSFER_FUNCTION, Options
from cobot_joint.scenario.report import Progress, Report, Table
from cobot_joint.system import Inputs, System, load_system

POINTS = 1000  # samples of the input per period
ROWS = 500  # about as many recorded rows per period, on whole ms
THESIS = {"gain [dB]": 62.17, "cut-off [rad/s]": 2.59}  # thesis 4.4, read off its Bode plot


@dataclass(frozen=True)
class Series:
    """One frequency's run: float64[n] each, SI; how it was coupled, and the energy residuals of its shafts."""

    omega: float
    time: NDArray[np.float64]
    i_command: NDArray[np.float64]
    i: NDArray[np.float64]
    w: NDArray[np.float64]
    coupling: Mapping[str, str | float] = field(default_factory=dict)
    residuals: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Response:
    """What a series says after settling: amplitudes of w, rad/s, and its phase against the set value, rad."""

    omega: float
    fundamental: float
    half_swing: float
    phase: float


@dataclass(frozen=True)
class FirstOrder:
    """K/(1 + s/omega_c) fitted to amplitudes; K in rad/s per A."""

    K: float
    omega_c: float

    @property
    def gain(self) -> float:
        """dB"""
        return 20 * math.log10(self.K)


def read_table(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(frequencies rad/s, measured amplitudes rad/s) of a two-column CSV with headers. UserError: it is not that."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:] if row]
        omega, amplitude = np.array(rows, dtype=np.float64).T
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: a table of frequency and amplitude is needed: {error}") from error
    return omega, amplitude


def run_frequency_response(
    scenario: FrequencyResponse, out: Path, options: Options, progress: Progress | None
) -> Report:
    """Series per variant (the first: signals.parquet), frequency_response.csv, Bode plot with misfit per frequency."""
    table_path = (scenario.path.parent if scenario.path else Path()) / scenario.table
    omegas, measured = read_table(table_path)
    where = str(scenario.path or scenario.name)
    total = len(scenario.variants) * sum(stop_time(scenario, omega) for omega in omegas)
    done = 0.0
    responses: list[list[Response]] = []
    residuals: dict[str, float] = {}
    report = Report(scenario.title or scenario.name)
    for variant in scenario.variants:
        system = variant_system(scenario, variant, options, where)
        path = out / ("signals.parquet" if not responses else f"signals_{variant.name.replace(' ', '_')}.parquet")
        found = []
        with _writer(path, scenario, variant, system, options) as writer:
            for series in sweep(scenario, variant, system, options, omegas):
                _write(writer, series)
                for name, residual in series.residuals.items():
                    residuals[name] = max(residuals.get(name, 0.0), abs(residual))
                found.append(respond(series, scenario.settle))
                done += stop_time(scenario, series.omega)
                if progress:
                    progress(done, total)
        responses.append(found)
        report.files[path] = f"series of {variant.name!r}, units and provenance; time starts anew at each frequency"
    amplitudes = [np.array([getattr(r, scenario.compared) for r in found]) for found in responses]
    fits = [fit_first_order(omegas, a / scenario.amplitude) for a in amplitudes]
    report.tables = [
        _fit_table(scenario, fits, amplitudes, measured),
        _amplitude_table(scenario, omegas, measured, amplitudes),
    ]
    if residuals:
        rows = [(name, 100 * value) for name, value in residuals.items()]
        report.tables.append(Table("energy", ["mechanical connection", "largest residual [%]"], rows))
    report.files[_write_table(out, report.tables[1])] = "amplitudes and misfit per frequency"
    level = options.level or "units"
    report.pictures.append(_bode(out, f"{report.title}: {level}", scenario, omegas, measured, responses, amplitudes))
    for variant, fit, amplitude in zip(scenario.variants, fits, amplitudes, strict=True):
        report.values |= {
            f"{variant.name}: gain [dB]": fit.gain,
            f"{variant.name}: cut-off [rad/s]": fit.omega_c,
            f"{variant.name}: misfit, rms of log ratio [%]": 100 * log_misfit(amplitude, measured),
        }
    return report


def variant_system(scenario: FrequencyResponse, variant: Variant, options: Options, where: str) -> System | None:
    """The system with the drive's bias and the variant's parameters; None at the level of the transfer function."""
    if options.level == TRANSFER_FUNCTION:
        if options.parameters:
            raise UserError(f"--set is given with --level {TRANSFER_FUNCTION}, which has J, B and k in {where} only")
        return None
    system = load_system(scenario.system)
    drives = [c.name for c in system.components if "bias.i_0" in c.unit.variables]
    if not drives:
        raise UserError(f"{where}: {system.name} has no unit with a bias current (bias.i_0, bias.from)")
    bias = {f"{drives[0]}.bias.i_0": scenario.bias, f"{drives[0]}.bias.from": scenario.bias_from}
    return options.applied(system, scenario.parameters, bias, variant.parameters, where=where)


def stop_time(scenario: FrequencyResponse, omega: float) -> float:
    """s, at one frequency"""
    return scenario.settle + scenario.periods * 2 * math.pi / omega


def sweep(
    scenario: FrequencyResponse, variant: Variant, system: System | None, options: Options, omegas: NDArray[np.float64]
) -> Iterator[Series]:
    """Series after series: co-simulated, or of the transfer function where there is no system."""
    if system is None:
        for omega in omegas:
            time = _input_times(scenario, omega)
            i = scenario.amplitude * np.sin(omega * time)
            yield Series(omega, time, i, i, transfer_function(variant, time, i))
        return
    with Simulation(system) as simulation:
        for omega in omegas:
            time = _input_times(scenario, omega)
            inputs = Inputs(time, {scenario.input: scenario.amplitude * np.sin(omega * time)})
            rows = _rows(scenario, omega)
            result = simulation.run(
                Experiment(
                    inputs,
                    rows[-1],
                    output_step=rows[1],
                    record=[scenario.input, scenario.current, scenario.speed],
                    **options.coupling(scenario),
                )
            )
            signals = result.signals
            yield Series(
                omega, result.time, signals[scenario.input], signals[scenario.current], signals[scenario.speed],
                {"scheme": result.scheme, "step": result.step},
                {name: result.energy_residual(name) for name in result.energy},
            )  # fmt: skip


def transfer_function(variant: Variant, time: NDArray[np.float64], i: NDArray[np.float64]) -> NDArray[np.float64]:
    """w of k/(J s + B), eq. 4.4, from rest: float64[n], rad/s; `i` linear between samples. The bias cancels T_f."""
    _, w, _ = lti([variant.k], [variant.J, variant.B]).output(i, time)
    return np.asarray(w, dtype=np.float64)


def respond(series: Series, settle: float) -> Response:
    """Least squares of mean, sine and cosine over whole periods after settling; half of the swing there."""
    after = series.time >= settle - 1e-9
    t, w = series.time[after], series.w[after]
    basis = np.column_stack([np.sin(series.omega * t), np.cos(series.omega * t), np.ones_like(t)])
    a, b, _ = np.linalg.lstsq(basis, w, rcond=None)[0]
    return Response(series.omega, math.hypot(a, b), float(np.ptp(w)) / 2, math.atan2(b, a))


def fit_first_order(omega: NDArray[np.float64], gain: NDArray[np.float64]) -> FirstOrder:
    """K and omega_c by least squares of the logarithm; `gain`: rad/s per A at `omega`."""

    def misfit(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(x[0] - 0.5 * np.log1p((omega / np.exp(x[1])) ** 2) - np.log(gain))

    start = [math.log(gain[0]), math.log(float(np.sqrt(omega[0] * omega[-1])))]
    K, omega_c = np.exp(least_squares(misfit, start, xtol=1e-12, ftol=1e-12, gtol=1e-12).x)
    return FirstOrder(float(K), float(omega_c))


def log_misfit(simulated: NDArray[np.float64], measured: NDArray[np.float64]) -> float:
    """rms of the logarithm of the ratio"""
    return float(np.sqrt(np.mean(np.log(simulated / measured) ** 2)))


def _writer(
    path: Path, scenario: FrequencyResponse, variant: Variant, system: System | None, options: Options
) -> SignalsWriter:
    facts = {"scenario": scenario.name, "variant": variant.model_dump(), "level": options.level or "units"}
    columns = {"time": "s", "omega": "rad/s", "i_command": "A", "i_motor": "A", "w_motor": "rad/s"}
    return SignalsWriter(path, columns, provenance(system, **facts))


def _write(writer: SignalsWriter, s: Series) -> None:
    writer.provenance |= s.coupling
    omega = np.full_like(s.time, s.omega)
    writer.write({"time": s.time, "omega": omega, "i_command": s.i_command, "i_motor": s.i, "w_motor": s.w})


def _input_times(scenario: FrequencyResponse, omega: float) -> NDArray[np.float64]:
    stop = stop_time(scenario, omega)
    return np.linspace(0, stop, math.ceil(stop * omega / (2 * math.pi) * POINTS) + 1)


def _rows(scenario: FrequencyResponse, omega: float) -> NDArray[np.float64]:
    """Recorded times: multiples of whole ms"""
    step = 1e-3 * max(1, round(1e3 * 2 * math.pi / omega / ROWS))
    return np.asarray(step * np.arange(math.floor(stop_time(scenario, omega) / step + 1e-9) + 1), dtype=np.float64)


def _fit_table(
    scenario: FrequencyResponse,
    fits: list[FirstOrder],
    amplitudes: list[NDArray[np.float64]],
    measured: NDArray[np.float64],
) -> Table:
    rows: list[list[float | str]] = []
    for variant, fit, amplitude in zip(scenario.variants, fits, amplitudes, strict=True):
        B, misfit = variant.k / fit.K, 100 * log_misfit(amplitude, measured)
        rows.append(
            [f"{variant.name} ({variant.source})", fit.gain, fit.omega_c, B / fit.omega_c, B, misfit]
        )  # fmt: skip
    rows.append(["thesis 4.4", *THESIS.values(), 6.95e-6, 1.8e-5, ""])
    return Table(
        "K/(1 + s/omega_c) fitted to the amplitudes",
        ["response", *THESIS, "J* [kg.m2]", "B* [N.m.s/rad]", "misfit to the table, rms of log ratio [%]"],
        rows,
    )


def _amplitude_table(
    scenario: FrequencyResponse,
    omegas: NDArray[np.float64],
    measured: NDArray[np.float64],
    amplitudes: list[NDArray[np.float64]],
) -> Table:
    headers = [header("omega", "rad/s"), header("measured", "rad/s")]
    for variant in scenario.variants:
        headers += [
            header(f"simulated: {variant.name}", "rad/s"),
            f"misfit: {variant.name} [%]",
            header(variant.source, "rad/s"),
        ]
    rows = []
    for n, omega in enumerate(omegas):
        row: list[float | str] = [float(omega), float(measured[n])]
        for variant, amplitude in zip(scenario.variants, amplitudes, strict=True):
            formula = scenario.amplitude * variant.k / math.hypot(variant.J * omega, variant.B)
            row += [float(amplitude[n]), 100 * (float(amplitude[n]) / measured[n] - 1), formula]
        rows.append(row)
    return Table("amplitude of the speed", headers, rows)


def _write_table(out: Path, table: Table) -> Path:
    return write_csv(out / "frequency_response.csv", table.headers, table.rows)


def _bode(
    out: Path,
    title: str,
    scenario: FrequencyResponse,
    omegas: NDArray[np.float64],
    measured: NDArray[np.float64],
    responses: list[list[Response]],
    amplitudes: list[NDArray[np.float64]],
) -> Picture:
    fine = np.geomspace(omegas[0], omegas[-1], 200)
    decibel = 20 * np.log10(measured / scenario.amplitude)
    gain = [Curve("measured, Table C.1", omegas, decibel, "markers", COLOUR["recorded"])]
    phase, misfit = [], []
    formulas: list[Curve] = []
    together = f"formulas, {' and '.join(variant.source for variant in scenario.variants)}"
    for variant, found, amplitude in zip(scenario.variants, responses, amplitudes, strict=True):
        formula = 20 * np.log10(np.abs(variant.k / (1j * variant.J * fine + variant.B)))
        gain.append(Curve(variant.name, omegas, 20 * np.log10(amplitude / scenario.amplitude)))
        formulas.append(Curve("" if formulas else together, fine, formula, "dashed", COLOURS[-1]))
        phase.append(Curve(variant.name, omegas, np.degrees([r.phase for r in found])))
        misfit.append(Curve(variant.name, omegas, 100 * (amplitude / measured - 1), "markers"))
    gain += formulas  # over the simulated ones, which they hide otherwise
    panels = [
        Panel("gain [dB re rad/s/A]", gain),
        Panel("phase [deg]", phase),
        Panel("simulated/measured - 1 [%]", misfit),
    ]
    stem = out / "frequency_response"
    return Picture(stem, "Bode plot with Table C.1", title, "omega [rad/s]", panels, x_log=True)
