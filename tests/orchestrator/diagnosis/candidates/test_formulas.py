"""Forms at a port are made of what the signals are, not of what they are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot_joint.diagnosis.candidates.formulas import Dictionary, Local
from cobot_joint.diagnosis.candidates.tables import over_any
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem, Run
from cobot_joint.diagnosis.plant.correction import Factor, Product, parse
from cobot_joint.diagnosis.plant.plant import Port
from tests.orchestrator.diagnosis.axis import NOISE, Axis, campaign
from tests.orchestrator.diagnosis.bench import calibrated


class Renamed(Axis):
    """The axis of somebody who writes in another language."""

    ports = (Port("axis.M_zu", "N.m", ("axis.Winkel", "axis.M", "axis.Drehzahl"), ("axis.Winkel",), loads=("axis.M",)),)

    def simulate(self, values, recording, *, onsets=None, added=None, signals=()):  # type: ignore[no-untyped-def]
        found = super().simulate(values, recording, onsets=onsets)
        own = {"axis.Winkel": found["axis.phi"], "axis.Drehzahl": found["axis.w"], "axis.M": recording.inputs["u"]}
        return found | own


def dictionary() -> Dictionary:
    problem = Problem(Renamed(), campaign({}).train, {"w": Noise(NOISE)})
    base = problem.simulate([Run()])[0]
    assert base is not None
    start = Fit(Hypothesis(()), np.zeros(0), 0.0, base.white * 0, base, np.zeros((problem.rows, 0)), 0)
    return Dictionary(problem, start, Renamed.ports[0])


def test_a_units_speed_and_loads_are_found_whatever_they_are_called() -> None:
    found = dictionary()
    assert found.speeds == {"Winkel": "Drehzahl"}
    assert found.loads == ["M"]
    found.waves = [("Winkel", 3.0)]
    forms = {str(product) for product in found.first()}
    assert {"1", "M", "M^2", "Drehzahl", "sgn(Drehzahl)", "abs(M)*sgn(Drehzahl)", "sin(3*Winkel)"} <= forms
    assert "sin(3*Winkel)*sgn(Drehzahl)" in forms
    assert {a.signal for a in over_any(found, 5)} == {"Drehzahl", "M", "Winkel", "t"}


def test_forms_of_one_unit_are_those_of_another_by_its_own_motion_if_that_turns_as_far() -> None:
    here, there = dictionary(), dictionary()
    forms = [Product((Factor("Winkel", "sin", 1.0), Factor("Drehzahl", "u")))]
    renamed = Port("arm.tau", "N.m", ("arm.q", "arm.qd"), ("arm.q",))
    there.port, there.angles, there.speeds = renamed, ["q"], {"q": "qd"}

    def behind(ratio: float) -> dict[str, Local]:
        return {
            name: Local({"q": k.signals["Winkel"] / ratio, "qd": k.signals["Drehzahl"] / ratio}, k.time)
            for name, k in here.locals.items()
        }

    there.locals = behind(1.0)
    assert [str(form) for form in here.at(there, forms)] == ["sin(1*q)*qd"]
    assert here.at(there, [Product((Factor("M", "u"),))]) == {}  # a torque is none of its motion
    there.locals = behind(30.0)
    assert here.at(there, forms) == {}


def test_of_a_shaft_that_turns_too_little_for_a_spectrum_the_lowest_orders_are_tried_all_the_same() -> None:
    found = dictionary()
    for outputs in found.outputs:
        outputs["axis.Winkel"] = 3.0 * np.sin(0.02 * np.arange(len(outputs["axis.Winkel"])))
    assert found.low == [("Winkel", 1.0), ("Winkel", 2.0)]
    found.waves = [("Winkel", 10.0), ("Winkel", 11.0)]
    forms = {str(form) for form in found.first()}  # those that stand out keep their place (machine 179/9)
    assert {f"sin({n}*Winkel)" for n in (1, 2, 10, 11)} <= forms


@pytest.mark.parametrize(("swings", "orders"), [(0.3, []), (0.6, [1.0, 2.0])])
def test_of_an_arm_that_swings_the_lowest_orders_are_tried_as_gravity_has_them(
    swings: float, orders: list[float]
) -> None:
    found = dictionary()
    for outputs in found.outputs:
        outputs["axis.Winkel"] = swings * np.sin(0.02 * np.arange(len(outputs["axis.Winkel"])))
    angles = [outputs["axis.Winkel"] for outputs in found.outputs]
    found.locals = {
        name: replace(known, signals={**known.signals, "Winkel": angle})
        for (name, known), angle in zip(found.locals.items(), angles, strict=True)
    }
    assert [n for _, n in found.low] == orders


def test_a_form_reads_back_as_what_it_was_made_of_and_has_its_values() -> None:
    found = dictionary()
    found.waves = [("Winkel", float(n)) for n in range(1, 5)]
    features = found.first() | found.more()
    assert len(features) > 20
    for product, by_recording in features.items():
        constant, factors = parse(str(product))
        assert (constant, str(Product(tuple(factors)))) == (1.0, str(product))
        for name, values in by_recording.items():
            local = found.locals[name]
            names = {**local.signals, "t": local.time, "sgn": lambda x: np.tanh(x / 1e-3)}
            names["eddy"] = lambda x: x / (1 + x**2)
            names |= {f: getattr(np, f) for f in ("sin", "cos", "tanh", "exp", "abs")}
            expected = eval(str(product).replace("^", "**"), {"__builtins__": {}}, names)
            assert values == pytest.approx(np.broadcast_to(expected, values.shape), rel=1e-9, abs=1e-12), str(product)


def test_the_units_of_the_bench_have_their_speeds_and_loads() -> None:
    with calibrated({}) as (problem, base):
        found = {p.component: Dictionary(problem, base, p) for p in problem.plant.ports if p.unit == "N.m"}
    assert found["motor_bldc"].speeds["phi"] == "w"
    assert found["planetary_gear"].speeds == {"phi_o": "w_o", "phi": "w"}
    assert found["mr_brake_belt"].speeds == {"phi_p": "w_p", "phi_b": "w_b"}
    assert found["motor_bldc"].loads[0] == "i"
    assert found["planetary_gear"].loads[0] in ("tau_g", "tau")
    assert all(found[name].loads for name in ("motor_bldc", "planetary_gear", "mr_brake_belt"))


def test_tables_are_made_of_hats_that_add_up_to_one() -> None:
    found = dictionary()
    for argument in over_any(found, 7):
        if argument.direction:
            continue
        for local in found.locals.values():
            assert np.sum(argument.hats(local), axis=0) == pytest.approx(1.0)


def test_a_wave_that_stands_out_of_those_beside_it_is_tried_though_what_drifts_has_more_power() -> None:
    found = dictionary()
    found.waves = [("Winkel", 1.0), ("Winkel", 2.0), ("Winkel", 3.0), ("Winkel", 7.0)]
    found.clear = [("Winkel", 7.0), ("Winkel", 9.0)]
    first, more = ({str(form) for form in forms if "sin(" in str(form)} for forms in (found.first(), found.more()))
    assert first >= {"sin(1*Winkel)", "sin(2*Winkel)", "sin(7*Winkel)"}
    assert "sin(3*Winkel)" in more
    assert not first & more
    assert not any("9*" in form for form in first | more)
