"""From a frequency-response campaign to its files: diagnosis.json, report.html, response.csv, repaired.ssp, fmus/."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.basis import of_response
from cobot_joint.diagnosis.data.parameters import with_values
from cobot_joint.diagnosis.frequency.readings import Progress, Reading, diagnose_response
from cobot_joint.diagnosis.frequency.response import Response, load_response
from cobot_joint.diagnosis.plant.frequency_plant import CHANNEL
from cobot_joint.diagnosis.provenance import provenance
from cobot_joint.diagnosis.repair.export import write_repair
from cobot_joint.diagnosis.repair.verify import write_json
from cobot_joint.diagnosis.report.headline import verdict_sentence
from cobot_joint.diagnosis.report.pictures import of_panels
from cobot_joint.diagnosis.report.report import ReportData, write_report
from cobot_joint.diagnosis.report.words import spoken
from cobot_joint.diagnosis.run import TRIED, Outcome, nominal_values, term_texts
from cobot_joint.diagnosis.store import Store
from cobot_joint.results.figures import Curve, Panel, Picture
from cobot_joint.results.files import write_csv
from cobot_joint.results.png import write_png

Vector = NDArray[np.float64]
X_LABEL = "omega [rad/s]"


def diagnose_response_campaign(path: Path, out: Path, *, progress: Progress | None = None) -> Outcome:
    """Diagnose, repair, compare, report. diagnosis.json is written last; till then OUT/.work has finished readings."""
    response = load_response(path)
    store = Store(out / ".work", of_response(response))
    diagnosis, readings = diagnose_response(response, store, progress)
    best = min(readings, key=lambda r: r.repaired.chi2)
    systems = with_values({"default": response.system}, best.alternative.parameters, str(response.path))
    write_repair(systems, diagnosis.parameters("repaired"), out)
    diagnosis.channels = {
        CHANNEL: {
            "noise": response.noise,
            "train": {"nominal": best.nominal, "calibrated": _rms(best.calibrated.residual, response),
                      "repaired": _rms(best.repaired.residual, response)},
        }
    }  # fmt: skip
    content = spoken(diagnosis.to_json()) | {"readings": [_reading(r, response) for r in readings]}
    content["provenance"] = provenance(
        response.path, response.given.title, {"default": response.system}, parameters=response.given.parameters
    )
    texts = term_texts(systems)
    panels, others = _amplitudes(response, best), _every_reading(response, readings)
    data = ReportData(
        title=response.given.title,
        diagnosis=content,
        compared=[],
        quality={},
        units={CHANNEL: "1"},
        nominal=nominal_values(systems, [*diagnosis.repaired, *diagnosis.calibrated]),
        terms=texts,
        tried=[(c.term, c.gain) for c in best.ranking][:TRIED],
        provenance=content["provenance"],
        created=date.today(),
        system=response.system,
        own_pictures=[
            of_panels(panels, X_LABEL, "Before and after", "Amplitudes, and what is left of them."),
            of_panels([others], X_LABEL, "Every reading, repaired", "What each reading of the experiment leaves."),
        ],
    )
    write_report(out / "report.html", data)
    picture = Picture(out / "report", "amplitudes", response.given.title, X_LABEL, [*panels, others], x_log=True)
    files = [out / "report.html", write_png(picture), _write_table(response, best, out)]
    sentence = verdict_sentence(content, texts)
    store.clear()
    write_json(out / "diagnosis.json", content)
    return Outcome(sentence, content, {CHANNEL: "1"}, [out / "diagnosis.json", out / "repaired.ssp", *files])


def _rms(residual: Vector, response: Response) -> float:
    """Whitened residual -> rms of ln(simulated/measured)"""
    return float(response.noise * np.sqrt(np.mean(residual**2)))


def _reading(reading: Reading, response: Response) -> dict[str, Any]:
    """One reading's figures: rms of ln(simulated/measured), and what was found under it."""
    values = reading.repaired.run.values
    return {
        "name": reading.alternative.name,
        "nominal": reading.nominal,
        "calibrated": _rms(reading.calibrated.residual, response),
        "repaired": _rms(reading.repaired.residual, response),
        "terms": [active.term.name for active in reading.repaired.hypothesis.terms],
        "equivalent": list(reading.equivalent),
        "values": dict(values),
        "ranking": [{"term": c.term, "gain": c.gain} for c in reading.ranking[:6]],
    }


def _simulated(response: Response, best: Reading) -> dict[str, Vector]:
    """Amplitudes of the best reading."""
    measured = np.exp(response.recording.outputs[CHANNEL])
    fits = {"calibrated": best.calibrated, "repaired": best.repaired}
    return {name: measured * np.exp(-response.noise * fit.residual) for name, fit in fits.items()}


def _amplitudes(response: Response, best: Reading) -> list[Panel]:
    """Measured and simulated, and the misfit."""
    omega, measured = response.recording.time, np.exp(response.recording.outputs[CHANNEL])
    simulated = _simulated(response, best)
    amplitude = [Curve("recorded", omega, 20 * np.log10(measured), "markers")]
    amplitude += [Curve(name, omega, 20 * np.log10(y)) for name, y in simulated.items()]
    misfit = [Curve(name, omega, 100 * (y / measured - 1)) for name, y in simulated.items()]
    return [Panel("amplitude [dB]", amplitude), Panel("simulated/measured - 1 [%]", misfit)]


def _every_reading(response: Response, readings: Sequence[Reading]) -> Panel:
    """Misfit of each, repaired."""
    omega = response.recording.time
    left = {r.alternative.name: 100 * (np.exp(-response.noise * r.repaired.residual) - 1) for r in readings}
    return Panel("repaired, every reading [%]", [Curve(name, omega, y) for name, y in left.items()])


def _write_table(response: Response, best: Reading, out: Path) -> Path:
    """response.csv: the numbers of the picture."""
    omega, simulated = response.recording.time, _simulated(response, best)
    columns = zip(omega, np.exp(response.recording.outputs[CHANNEL]), *simulated.values(), strict=True)
    return write_csv(
        out / "response.csv", ["omega [rad/s]", "measured", *simulated], [[float(x) for x in row] for row in columns]
    )
