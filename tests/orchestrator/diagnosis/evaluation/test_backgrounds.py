"""Machines with backgrounds are what they are said to be, and findings on them are judged by their names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.evaluation.background_count import judge, tables
from cobot_joint.diagnosis.evaluation.backgrounds import CLOSE, LEVELS, OVER, FieldConcealer
from cobot_joint.diagnosis.evaluation.synthetic import Concealer, Drawn
from cobot_joint.diagnosis.findings import Diagnosis, Finding
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant

PATTERN = Path(__file__).parents[4] / "proof" / "open" / "case14" / "campaign.toml"


def drawn(seed: int, effects: int) -> tuple[Drawn, float]:
    campaign = load_campaign(PATTERN, roles=("train",))
    with FmuPlant(campaign.systems()) as plant:
        return FieldConcealer(Concealer(campaign, plant, 2.0)).draw(np.random.default_rng(seed), effects)


def test_a_background_has_the_size_that_was_drawn_and_is_drawn_again_alike() -> None:
    (one, size), (other, _) = drawn(3, 1), drawn(3, 1)
    assert LEVELS[0] * (1 - CLOSE) < size < LEVELS[1] * (1 + CLOSE)
    samples = sum(y.size for r in one.campaign.recordings for y in r.outputs.values())
    assert OVER[0] * 0.5 < one.effects[0].size / (size * np.sqrt(samples)) < OVER[1] * 2
    for a, b in zip(one.campaign.recordings, other.campaign.recordings, strict=True):
        for channel, y in a.outputs.items():
            np.testing.assert_array_equal(y, b.outputs[channel])


@pytest.fixture
def machine() -> Drawn:
    return drawn(5, 1)[0]


def said(*names: str) -> Diagnosis:
    findings = [Finding(names[0], names[1:], 0.95, None, {}, {}, 50.0)] if names else []
    return Diagnosis("explained" if names else "nothing_missing", findings, {}, {})


def test_a_finding_is_true_by_its_own_name_or_an_alike_one_in_any_unit(machine: Drawn) -> None:
    concealed = machine.effects[0].active.term.name.split(".")[1]
    for found, true in (
        (said(f"other_unit.{concealed}"), True),
        (said("motor_bldc.nothing_of_the_sort", f"planetary_gear.{concealed}"), True),
        (said("motor_bldc.nothing_of_the_sort"), False),
        (said(), None),
    ):
        row = judge(machine, found, 100.0)
        assert [f["true"] for f in row["findings"]] == ([] if true is None else [true])
        assert row["effects"][0]["named"] is bool(true)
        assert row["effects"][0]["over"] == pytest.approx(machine.effects[0].size / 100)


def test_the_tables_count_what_was_missed_and_what_was_false(machine: Drawn) -> None:
    hit = judge(machine, said(machine.effects[0].active.term.name), 100.0)
    healthy = {"effects": [], "findings": [{**hit["findings"][0], "true": False, "confidence": 0.85}]}
    text = tables(
        [
            hit,
            healthy,
            {"effects": hit["effects"][:1], "findings": []} | {"effects": [{**hit["effects"][0], "named": False}]},
        ]
    )
    assert "| any finding | 1 | 1 |" in text
    assert "| 0.8 to 0.9 | 1 | 0 |" in text
    squares = [(hit["findings"][0]["confidence"] - 1) ** 2, 0.85**2, 1.0]
    assert f"{np.mean(squares):.3f}" in text
