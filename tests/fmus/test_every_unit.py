"""What holds for every unit: it validates, runs alone, and its modelDescription says what it does."""

from __future__ import annotations

import posixpath
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
from lxml import html

from cobot_joint.units import Unit, find_fmu, load_unit

UNITS = sorted(table.parent.name for table in (Path(__file__).parents[2] / "fmus").glob("*/model.def"))
TERMS = [(name, term.name) for name in UNITS for term in load_unit(find_fmu(f"{name}.fmu")).terms]

Make = Callable[..., Any]
Load = Callable[[str], Unit]

# inputs that let every term show: (level, amplitude, rad/s) of level + amplitude sin(omega t)
EXCITATION = {
    "motor_bldc": {"set_value": (1.0, 3.0, 20.0), "tau": (0.01, 0.02, 31.0)},
    "planetary_gear": {"phi": (0.0, 30.0, 9.0), "w": (0.0, 270.0, 9.0), "tau_s": (0.0, 2.0, 23.0)},
    "harmonic_drive": {"phi": (0.0, 30.0, 9.0), "w": (0.0, 270.0, 9.0), "tau_s": (0.0, 2.0, 23.0)},
    "cycloidal_drive": {"phi": (0.0, 30.0, 9.0), "w": (0.0, 270.0, 9.0), "tau_s": (0.0, 2.0, 23.0)},
    "series_elastic": {"phi_o": (0.01, 0.04, 20.0), "phi_p": (0.004, 0.03, 33.0), "w_o": (0.1, 0.2, 20.0)},
    "link": {"tau_s": (0.3, 2.0, 15.0), "tau_h": (0.1, 0.1, 7.0)},
    "torque_sensor": {"phi_o": (0.01, 0.004, 20.0), "phi_p": (0.004, 0.003, 33.0), "w_o": (0.1, 0.2, 20.0)},
    "mr_brake_belt": {"tau_s": (0.3, 2.0, 15.0), "i_b": (0.3, 0.3, 11.0), "tau_h": (0.1, 0.1, 7.0)},
    "acquisition": {"i_motor": (0.1, 1.0, 20.0), "w_motor": (100.0, 50.0, 9.0), "tau_sensor": (1.0, 2.0, 31.0)},
    "position_loop": {"phi_ref": (0.0, 0.1, 20.0), "phi": (0.0, 0.05, 30.0), "w": (0.0, 0.3, 15.0)},
    "correction": {
        "x": (0.2, 1.0, 20.0),
        "u1": (0.5, 1.0, 13.0),
        "u2": (0.3, 0.5, 17.0),
        "u3": (1.0, 0.2, 5.0),
        "u4": (2.0, 0.1, 3.0),
    },
    "driven_load": {"tau": (0.1, 0.3, 20.0), "w_imposed": (1.0, 2.0, 20.0)},
}
BASE = {"driven_load": {"friction.tau_C": 0.05, "friction.d": 0.02}}  # what its terms change is zero as it starts
INERTIAS = {"motor_bldc": {"J_coupled": 1e-5}, "driven_load": {"J_variable": 1e-4}}  # off their lower bound
FEATURE = {"feature1.A": 1.0, **{f"feature1.f{k}": 2 for k in (1, 2, 3, 4)}}  # u1*u2*u3*u4
VARIANTS = {
    "motor_bldc": [{"motor.level": 4}, {"motor.level": 5}],
    "driven_load": [{"motion.source": 2}],
    "position_loop": [{"torque_feedback.K": 1.0}],
    "correction": [FEATURE],
}  # settings under which other inputs feed through
ON = {"presliding.share": 0.5, "sublinear_viscous.x": 0.5, "viscous_warmup.fade": 0.5, "backlash.b_x": 0.002,
      "ratcheting.x": 1.0}  # fmt: skip


def amplitude_on(unit: Unit, name: str) -> float:
    """A value of a term's amplitude that shows."""
    _, high = unit.bounds_of(name)
    return ON.get(name, 0.01 * min(1.0, high or 1.0))


@pytest.fixture
def make(make: Make) -> Make:
    """As everywhere, with what a unit needs for its terms to have something to act on."""
    return lambda name, start=None, **setup: make(name, {**BASE.get(name, {}), **(start or {})}, **setup)


def excite(slave: Any, end: float = 0.4, h: float = 2e-3) -> np.ndarray:
    """Every real output at every point, under inputs linear over each step."""

    def signal(level: float, amplitude: float, omega: float) -> Callable[[float], float]:
        return lambda t: level + amplitude * np.sin(omega * t)

    inputs = {name: signal(*shape) for name, shape in EXCITATION[slave.unit.name].items()}
    outputs = slave.outputs()
    out = slave.run(slave.time + end, h, outputs, inputs)
    return np.array([out[name] for name in outputs])


def test_validation_has_no_finding(load: Load, name: str) -> None:
    assert validate_fmu(str(load(name).path)) == []


def test_unit_simulates_alone(load: Load, name: str) -> None:
    out = simulate_fmu(str(load(name).path), stop_time=1.0, output_interval=0.1)
    assert len(out) == 11
    assert all(np.all(np.isfinite(out[column])) for column in out.dtype.names)


def test_archive_holds_page_icon_and_sources(load: Load, name: str) -> None:
    directory = load(name).directory
    for file in ("documentation/index.html", "model.png", "sources/all.c", "modelDescription.xml"):
        assert (directory / file).stat().st_size > 0, file
    page = (directory / "documentation/index.html").read_text(encoding="utf-8")
    for term in load(name).terms:
        assert f'id="{term.name}"' in page


def test_the_page_stands_alone_and_shows_the_icon_that_is_in_the_archive(load: Load, name: str) -> None:
    """in FMI 2.0 and 3.0, which keep it in different places"""
    two = load(name).path
    for fmu in (two, two.parent / "fmi3" / two.name):
        with zipfile.ZipFile(fmu) as archive:
            page = html.fromstring(archive.read("documentation/index.html"))
            files = archive.namelist()
        loaded = [e.get("src") or e.get("href") for e in page.iter("img", "script", "link")]
        assert [posixpath.normpath(f"documentation/{link}") in files for link in loaded] == [True]


def test_the_pages_contents_lead_to_every_section_and_term(load: Load, name: str) -> None:
    page = html.parse(load(name).directory / "documentation/index.html")
    ids = [found.get("id") for found in page.iterfind(".//*[@id]")]
    assert [link.get("href") for link in page.iterfind(".//nav//a")] == [f"#{heading}" for heading in ids]
    assert {term.name for term in load(name).terms} <= set(ids)
    assert len(set(ids)) == len(ids)


def test_the_page_names_every_variable_once_with_its_unit(load: Load, name: str) -> None:
    page = html.parse(load(name).directory / "documentation/index.html")
    cells = [[cell.text_content() for cell in row.iterfind("td")] for row in page.iterfind(".//tbody/tr")]
    shown = {first: second for first, second, _ in cells}
    assert len(shown) == len(cells)
    reals = {v.name: v.unit for v in load(name).variables.values() if v.type == "Real" and v.name in shown}
    assert {
        variable for variable, unit in reals.items() if unit and unit != "1" and unit not in shown[variable]
    } == set()
    assert {v.name for v in load(name).variables.values() if v.causality in ("input", "parameter")} <= set(shown)


def test_no_type_has_a_variables_name(load: Load, name: str) -> None:
    """FMI 2.0.4, 2.2.3: the name of a type is unique among those of types and of variables"""
    unit = load(name)
    types = [t.name for t in unit.description.typeDefinitions]
    assert len(set(types)) == len(types)
    assert set(types).isdisjoint(unit.variables)


def test_choices_are_integers_whose_values_are_named_in_their_descriptions(load: Load, name: str) -> None:
    """importers refuse enumerations, leave them out, or set them as Reals"""
    unit = load(name)
    assert "Enumeration" not in {v.type for v in unit.variables.values()}
    table = (Path(__file__).parents[2] / "fmus" / name / "model.def").read_text(encoding="utf-8")
    assert bool(unit.named_values) == ("CHOICE(" in table or "FRICTION_STICKS" in table)
    for variable, values in unit.named_values.items():
        v = unit.variables[variable]
        assert (v.type, int(v.min), int(v.max)) == ("Integer", 1, len(values))
        assert list(values.values()) == list(range(1, len(values) + 1))
        assert v.description.endswith(f"({', '.join(f'{n} {item}' for item, n in values.items())})")


def test_every_real_has_a_unit_and_every_moving_one_a_nominal_value(load: Load, name: str) -> None:
    for variable in load(name).variables.values():
        if variable.type == "Real":
            assert variable.unit, variable.name
            assert variable.causality == "parameter" or variable.nominal, variable.name


def test_angles_are_shown_in_degrees_and_speeds_in_turns_per_minute(load: Load, name: str) -> None:
    shown = {"rad": "deg", "rad/s": "rpm"}
    for variable in load(name).variables.values():
        if variable.type == "Real":
            assert variable.displayUnit == shown.get(variable.unit), variable.name


@pytest.mark.parametrize(("name", "term"), TERMS)
def test_term_says_where_it_comes_from_and_starts_neutral(load: Load, name: str, term: str) -> None:
    unit = load(name)
    (t,) = [t for t in unit.terms if t.name == term]
    assert t.title
    assert t.equation
    assert t.source
    assert t.amplitude
    variable = unit.variables[t.amplitude]
    assert variable.variability == "tunable"
    assert float(variable.start) == t.neutral
    low, high = unit.bounds_of(t.amplitude)
    assert low is not None
    assert high is not None
    assert low <= t.neutral <= high
    for shape in t.shapes:
        low, high = unit.bounds_of(shape.name)
        assert low <= shape.min < shape.max <= high
        assert shape.points >= 2
        assert shape.scan in ("lin", "log", "phase", "order")


@pytest.mark.parametrize(("name", "term"), TERMS)
def test_term_at_its_neutral_value_leaves_the_outputs_bit_identical(
    load: Load, make: Make, name: str, term: str
) -> None:
    (t,) = [t for t in load(name).terms if t.name == term]
    off = {shape.name: (shape.min + shape.max) / 2 for shape in t.shapes}
    plain = excite(make(name))
    neutral = excite(make(name, {**off, t.amplitude: t.neutral}))
    if term == "winding_heating":  # its time constant is that of the winding's temperature, with or without effect
        rows = [n != "T_w" for n in make(name).outputs()]
        plain, neutral = plain[rows], neutral[rows]
    np.testing.assert_array_equal(neutral, plain)


@pytest.mark.parametrize(("name", "term"), TERMS)
def test_term_shows_under_the_same_excitation(load: Load, make: Make, name: str, term: str) -> None:
    """or else its bit-identical absence above would say nothing"""
    (t,) = [t for t in load(name).terms if t.name == term]
    on = {t.amplitude: amplitude_on(load(name), t.amplitude)}
    assert not np.array_equal(excite(make(name, on)), excite(make(name)))


@pytest.mark.parametrize(("name", "term"), TERMS)
def test_term_can_set_in_while_the_run_goes_on(load: Load, make: Make, name: str, term: str) -> None:
    (t,) = [t for t in load(name).terms if t.name == term]
    plain = excite(make(name))
    slave = make(name, {"external_torque.T_d": 100.0} if term == "external_torque" else {})
    before = excite(slave, end=0.2)
    np.testing.assert_array_equal(before, plain[:, : before.shape[1]])
    slave.set({t.amplitude: amplitude_on(load(name), t.amplitude)})
    after = excite(slave, end=0.2)
    assert not np.array_equal(after[:, 1:], plain[:, before.shape[1] :])
    slave.set({t.amplitude: t.neutral})


def feed_through(slave: Any, step: float = 1e-6) -> set[tuple[str, str]]:
    """(output, input) where the output moves with the input, everything else held."""
    found = set()
    outputs = slave.outputs()
    for name in slave.inputs():
        nominal = float(slave.unit.variables[name].nominal)
        before, value = slave.reals(outputs), slave[name]
        slave.set({name: value + step * nominal})
        after = slave.reals(outputs)
        slave.set({name: value})
        found |= {(output, name) for output, a, b in zip(outputs, before, after, strict=True) if a != b}
    return found


def test_feed_through_is_what_the_model_description_declares(load: Load, make: Make, name: str) -> None:
    unit = load(name)
    declared = {
        (unknown.variable.name, known.name)
        for unknown in unit.description.outputs
        for known in unknown.dependencies or []
        if unknown.variable.type == known.type == "Real"
    }
    terms_on = {t.amplitude: amplitude_on(unit, t.amplitude) for t in unit.terms if t.amplitude}
    measured = set()
    for start in ({}, terms_on, *VARIANTS.get(name, [])):
        slave = make(name, start)
        for _ in range(5):
            excite(slave, end=0.08)
            measured |= feed_through(slave)
    assert measured == declared


def test_step_of_ten_milliseconds_equals_ten_of_one(load: Load, make: Make, name: str) -> None:
    ends = []
    for h in (1e-2, 1e-3):
        slave = make(name, tolerance=1e-8)
        slave.set({key: level + amplitude / 3 for key, (level, amplitude, _) in EXCITATION[name].items()})
        for _ in range(round(0.05 / h)):
            for key in EXCITATION[name]:
                slave.slope(key, 0.0)  # constant, as a master says it; an input without a derivative goes on by itself
            slave.step(h)
        names = [n for n in slave.outputs() if n != "w_reading" or name != "motor_bldc"]  # an encoder's, per point
        ends.append(slave.reals(names))
        nominal = np.array([float(load(name).variables[n].nominal) for n in names])
    kinks = np.array([n.endswith("_abs") for n in names])  # integrals of magnitudes, outside of the error control
    for which, tolerance in ((~kinks, 1e-4), (kinks, 5e-3)):
        a, b = ends[0][which] / nominal[which], ends[1][which] / nominal[which]
        np.testing.assert_allclose(a, b, atol=tolerance, rtol=tolerance)


def test_fmu_state_continues_bit_by_bit(load: Load, make: Make, name: str) -> None:
    terms_on = {t.amplitude: amplitude_on(load(name), t.amplitude) for t in load(name).terms if t.amplitude}
    extra = {"acquisition": {"noise.sigma_i": 0.1, "noise.sigma_tau": 0.1, "noise.rho_tau": 0.5}}
    slave = make(name, {**terms_on, **extra.get(name, {})})
    excite(slave, end=0.1)
    state, time = slave.fmu.getFMUstate(), slave.time
    first = excite(slave, end=0.1)
    slave.fmu.setFMUstate(state)
    slave.time = time
    again = excite(slave, end=0.1)
    np.testing.assert_array_equal(again, first)

    data = slave.fmu.serializeFMUstate(state)
    other = make(name)
    restored = other.fmu.deSerializeFMUstate(data)
    other.fmu.setFMUstate(restored)
    other.time = time
    np.testing.assert_array_equal(excite(other, end=0.1), first)
    slave.fmu.freeFMUstate(state)
    other.fmu.freeFMUstate(restored)


def test_instances_do_not_know_of_each_other(make: Make, name: str) -> None:
    alone = excite(make(name))
    a, b = make(name), make(name)
    halves = []
    for _ in range(2):
        halves.append(excite(a, end=0.2))
        excite(b, end=0.3)
    np.testing.assert_array_equal(halves[0], alone[:, : halves[0].shape[1]])


def test_reset_starts_over(make: Make, name: str) -> None:
    slave = make(name)
    first = excite(slave)
    slave.fmu.reset()
    slave.initialise(BASE.get(name))
    np.testing.assert_array_equal(excite(slave), first)


def test_no_unit_is_integrated_more_loosely_than_is_sound(make: Make, name: str) -> None:
    """whatever a master suggests: Maestro gives 0.1 unasked"""
    np.testing.assert_array_equal(excite(make(name, tolerance=0.1)), excite(make(name, tolerance=1e-4)))


def test_a_tighter_tolerance_counts(make: Make) -> None:
    assert not np.array_equal(
        excite(make("planetary_gear", tolerance=1e-9)), excite(make("planetary_gear", tolerance=1e-4))
    )


def test_output_derivatives_are_those_of_the_outputs(load: Load, make: Make, name: str) -> None:
    """against the outputs a few microseconds before and after; what jumps by design is left out"""
    jumps = {"motor_bldc": {"w_reading", "i_a", "i_b", "i_c", "e_a", "e_b", "e_c"}}
    slave = make(name, tolerance=1e-9)
    excite(slave, end=0.1)
    names = [n for n in slave.outputs() if n not in jumps.get(name, set())]
    slopes = {key: amplitude * omega / 2 for key, (_, amplitude, omega) in EXCITATION[name].items()}

    def point(h: float) -> np.ndarray:
        for key, slope in slopes.items():
            slave.set({key: slave[key]})
            slave.slope(key, slope)
        slave.step(h)
        return slave.reals(names)

    h = 2e-5
    before = point(1e-3)
    point(h)
    given = np.array([slave.rate(n) for n in names])
    after = point(h)
    scale = np.array([float(load(name).variables[n].nominal) for n in names])
    measured = (after - before) / (2 * h)
    np.testing.assert_allclose(given / scale, measured / scale, rtol=2e-2, atol=2e-2)


def test_directional_derivatives_are_those_of_the_outputs(load: Load, make: Make, name: str) -> None:
    slave = make(name, INERTIAS.get(name, {}))
    excite(slave, end=0.1)
    inputs, outputs = slave.inputs(), slave.outputs()
    for key in inputs:
        slave.set({key: slave[key]})
    nominal = np.array([float(load(name).variables[n].nominal) for n in inputs])
    direction = nominal * np.cos(np.arange(len(inputs)))
    given = slave.fmu.getDirectionalDerivative(slave.vr(*outputs), slave.vr(*inputs), list(direction))
    values, eps, ends = [slave[n] for n in inputs], 1e-5, []
    for side in (-1, 1):
        slave.set(dict(zip(inputs, values + side * eps * direction, strict=True)))
        ends.append(slave.reals(outputs))
    scale = np.array([float(load(name).variables[n].nominal) for n in outputs])
    np.testing.assert_allclose(np.array(given) / scale, (ends[1] - ends[0]) / (2 * eps) / scale, rtol=1e-4, atol=1e-6)
