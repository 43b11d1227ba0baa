"""A base parameter outside its tolerance is named itself, not the physics that imitates it."""

from __future__ import annotations

import pytest

from cobot_joint.diagnosis.engine import diagnose_plant
from tests.orchestrator.diagnosis.axis import NOMINAL, Axis, campaign


@pytest.mark.parametrize(("name", "times"), [("axis.d", 0.5), ("axis.J", 1.6), ("axis.tau_C", 1.8)])
def test_a_parameter_outside_its_tolerance_is_the_finding_with_its_value(name: str, times: float) -> None:
    found = diagnose_plant(campaign({name: times * NOMINAL[name]}), Axis())
    first = found.findings[0]
    assert found.verdict == "explained"
    assert [f.term for f in found.findings] == [name]
    assert first.confidence > 0.9
    low, high = first.parameters[name].ci95
    assert low < times * NOMINAL[name] < high
    assert found.repaired[name].value == pytest.approx(times * NOMINAL[name], rel=0.02)
    assert found.calibrated[name].value == pytest.approx((0.9 if times < 1 else 1.1) * NOMINAL[name])


def test_a_listed_term_beside_it_is_named_as_well() -> None:
    truth = {
        "axis.d": 0.4 * NOMINAL["axis.d"],
        "axis.cogging.A": 6e-3,
        "axis.cogging.n": 5.0,
        "axis.cogging.phi_0": 0.4,
    }
    found = diagnose_plant(campaign(truth), Axis())
    assert {f.term for f in found.findings} == {"axis.d", "axis.cogging"}


def test_a_term_whose_re_fit_ends_at_a_bound_keeps_its_name_where_no_parameter_explains_it() -> None:
    found = diagnose_plant(campaign({"axis.windage.c": 2e-4}), Axis())
    assert [f.term for f in found.findings] == ["axis.windage"]
