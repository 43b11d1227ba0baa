"""What a finding's own figures say against it."""

from __future__ import annotations

import pytest

from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.explanation.explanation import Explanation, answer
from cobot_joint.diagnosis.findings import Estimate
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from tests.orchestrator.diagnosis.axis import NOISE, TERMS, Axis, campaign


@pytest.mark.parametrize(("interval", "claimed"), [((0.5e-5, 1.5e-5), True), ((-0.5e-5, 2.5e-5), False)])
def test_a_term_whose_size_may_be_none_is_no_claim(
    interval: tuple[float, float], claimed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = campaign({"axis.windage.c": 1e-5})
    problem = Problem(Axis(), case.train, {"w": Noise(NOISE)})
    base = fit(problem, Hypothesis(()))
    found = fit(problem, Hypothesis((), (ActiveTerm(TERMS[0], {"axis.windage.c": 1e-5}),)))
    assert base is not None
    assert found is not None
    own = type(found).estimates

    def estimates(*given: object) -> dict[str, Estimate]:
        of = own(*given)  # type: ignore[arg-type]
        return of | {n: Estimate(e.value, e.unit, interval) for n, e in of.items() if n == "axis.windage.c"}

    monkeypatch.setattr(type(found), "estimates", estimates)
    selection = Selection([base, found], [Selected("axis.windage", base.cost - found.cost)])
    (finding,) = answer(problem, Explanation(base, found, selection, selection.selected)).findings
    assert (finding.confidence >= 0.5) == claimed
    assert ("its size may be none" in finding.limited_by) != claimed
