"""What was found along the recorded motion is held against free runs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.anchored import free_runs
from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Finding

ALONG, FREE, REPAIRED = 5.0, 2.0, 7.0


def estimates(value: float) -> dict[str, Estimate]:
    return {"a.b": Estimate(value, "1", (value, value))}


def problem(left_along: float, stands_out: bool = False) -> Any:
    """Free runs leave so much with what was found along the recorded motion, squared."""
    return SimpleNamespace(
        recorded=np.array([left_along, 0.0]),
        simulate=lambda runs: [SimpleNamespace(white=np.zeros(2))],
        stretches=lambda residual: None,
        stands_out=lambda residual: stands_out,
        plant=SimpleNamespace(parameters={}, terms=()),
    )


def refit(chi2: float) -> Any:
    return SimpleNamespace(chi2=chi2, residual=np.zeros(2), estimates=lambda units, stretches: estimates(FREE))


def found(*terms: str) -> Diagnosis:
    findings = [Finding(term, (), 0.9, None, {}, {}, 50.0) for term in terms]
    return Diagnosis("explained", findings, calibrated=estimates(ALONG), repaired=estimates(REPAIRED))


@pytest.mark.parametrize(("left_along", "kept"), [(3.0, FREE), (1.0, ALONG)])
def test_calibrated_is_the_base_model_that_leaves_less_of_free_runs(left_along: float, kept: float) -> None:
    """field/open case09: re-fitted along the recorded motion it left much more, and a false repair beat that"""
    after = free_runs.in_free_runs(problem(left_along), found(), Search(), refit(4.0), {})
    assert after.calibrated["a.b"].value == kept


def test_where_nothing_has_a_name_nothing_is_repaired() -> None:
    """field/open case01 and case08: what the last look along the motion left behind was offered as a repair, and
    predicted the held-out run 4.6 and 1.05 times worse"""
    after = free_runs.in_free_runs(problem(3.0), found(), Search(), refit(4.0), {})
    assert after.repaired == after.calibrated


@pytest.mark.parametrize(("stands_out", "verdict"), [(False, "nothing_missing"), (True, "undecided")])
def test_what_stands_out_and_has_no_name_is_not_called_nothing(stands_out: bool, verdict: str) -> None:
    """A drawn machine whose base model was eleven times the noise off was told that nothing is worth a name"""
    after = free_runs.in_free_runs(problem(3.0, stands_out), found(), Search(), refit(4.0), {})
    assert after.verdict == verdict


@pytest.mark.parametrize(("left_free", "kept"), [(8.0, FREE), (10.0, REPAIRED)])
def test_a_repair_is_the_fit_that_leaves_less_of_free_runs(
    left_free: float, kept: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(free_runs, "_freely", lambda *_: refit(left_free))
    after = free_runs.in_free_runs(problem(3.0), found("a.term"), Search(), refit(4.0), {})
    assert after.repaired["a.b"].value == kept
