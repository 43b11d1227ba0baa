"""A diagnosis whose time is up: what it says, and what a later one goes on from."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.engine import diagnose_plant
from cobot_joint.diagnosis.store import Store
from cobot_joint.diagnosis.thresholds import EVEN
from tests.orchestrator.diagnosis.axis import OFF, Axis, campaign


def concealed_windage_and_cogging() -> Campaign:
    return campaign(OFF | {"axis.windage.c": 2e-6, "axis.cogging.A": 8e-3, "axis.cogging.n": 5.0})


def test_without_time_the_first_answer_says_what_was_left_out() -> None:
    found = diagnose_plant(concealed_windage_and_cogging(), Axis(), budget=Budget(0.0))
    assert len(found.findings) == 1
    assert found.findings[0].confidence < EVEN  # what was not looked at may explain it better
    assert found.left_out == [
        "gains, offsets and delays of channels",
        "a load that is not logged",
        "further listed terms",
        "external loads",
        "terms that set in",
        "parameters outside their tolerances",
        "formulas",
        "the experiment that would tell more",
    ]
    assert found.to_json()["left_out"] == found.left_out


def test_when_time_is_up_a_search_ends_in_the_middle_of_its_simulations() -> None:
    """The clock strikes in the second round: it is begun, and not finished."""
    budget, undisturbed, axis = Budget(), Axis(), Axis()
    diagnose_plant(concealed_windage_and_cogging(), undisturbed)

    def tell(words: str) -> None:
        if words.startswith("round 2") and "so far" not in words:
            budget.seconds = 0.0

    found = diagnose_plant(concealed_windage_and_cogging(), axis, budget=budget, progress=tell)
    assert found.left_out[0] == "further listed terms"
    assert len(found.findings) == 1
    assert axis.runs < 0.7 * undisturbed.runs


@pytest.mark.parametrize(("gone", "reached"), [(0.5, ["first", "inner", "last"]), (0.8, ["last"]), (1.1, [])])
def test_a_search_that_leaves_a_share_of_the_time_ends_before_what_follows_begins(
    monkeypatch: pytest.MonkeyPatch, gone: float, reached: list[str]
) -> None:
    """`--within` never came to the recorded motion where formulas took all that was left."""
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    budget, done = Budget(seconds=10.0, begun=0.0), list[str]()

    def look() -> None:
        done.append("first")
        budget.check()
        budget.spend("inner", lambda: done.append("inner"))

    clock[0] = 10 * gone
    budget.spend("formulas", look, 0.3)
    budget.spend("motion", lambda: done.append("last"))
    assert done == reached
    assert ("formulas" in budget.left_out) == (gone > 0.7)


def test_a_search_that_leaves_a_share_of_the_time_is_cut_short_there(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [6.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    budget = Budget(seconds=10.0, begun=0.0)

    def look() -> bool:
        clock[0] = 7.5
        budget.check()
        return True

    assert budget.spend("formulas", look, 0.3) is None
    assert budget.left_out == ["formulas"]
    assert budget.spend("motion", lambda: budget.check() or True) is True


def test_long_fits_say_how_many_simulations_there_were() -> None:
    said: list[str] = []
    diagnose_plant(concealed_windage_and_cogging(), Axis(), progress=said.append)
    assert any(re.fullmatch(r"re-fitting .*: \d+ simulations so far", words) for words in said)


def test_with_time_enough_nothing_is_left_out() -> None:
    found = diagnose_plant(concealed_windage_and_cogging(), Axis(), budget=Budget(1e6))
    assert {f.term for f in found.findings} == {"axis.windage", "axis.cogging"}
    assert found.left_out == []
    assert "left_out" not in found.to_json()


def test_what_time_cut_short_is_gone_on_from_and_never_taken_for_the_answer(tmp_path: Path) -> None:
    case = concealed_windage_and_cogging()
    undisturbed, first, second = Axis(), Axis(), Axis()
    expected = diagnose_plant(case, undisturbed)
    short = diagnose_plant(case, first, store=Store(tmp_path), budget=Budget(0.0))
    assert short.left_out
    found = diagnose_plant(case, second, store=Store(tmp_path))
    assert [f.term for f in found.findings] == [f.term for f in expected.findings]
    assert found.left_out == []
    assert second.runs < undisturbed.runs


def test_what_several_places_ask_for_is_left_out_once() -> None:
    budget = Budget(0.0)
    assert [budget.spend("formulas", lambda: 1) for _ in range(3)] == [None] * 3
    assert budget.left_out == ["formulas"]


def test_a_call_with_a_limit_goes_on_from_what_one_without_has_finished(tmp_path: Path) -> None:
    case, undisturbed, second = concealed_windage_and_cogging(), Axis(), Axis()
    budget, last = Budget(1e6), "writing down what was found"

    def interrupted(words: str) -> None:
        if words == last:
            raise KeyboardInterrupt

    def struck(words: str) -> None:
        budget.seconds = 0.0 if words == last else budget.seconds

    with pytest.raises(KeyboardInterrupt):
        diagnose_plant(case, undisturbed, store=Store(tmp_path), progress=interrupted)
    found = diagnose_plant(case, second, store=Store(tmp_path), progress=struck, budget=budget)
    assert found.left_out == ["the experiment that would tell more"]
    assert {f.term for f in found.findings} == {"axis.windage", "axis.cogging"}
    assert second.runs < 0.1 * undisturbed.runs


def test_what_follows_something_left_out_is_not_taken_from_what_is_kept() -> None:
    """It may be asked about something else."""
    kept: dict[str, object] = {"loads 1": "of before"}
    budget = Budget(1e6, keep=lambda name, look: kept.get(name) or kept.setdefault(name, look()))
    budget.left_out.append("further listed terms")
    assert budget.stage("loads", lambda: "new") == "new"
    assert kept == {"loads 1": "of before"}
