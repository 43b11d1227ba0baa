"""The notebooks of docs/examples run from top to bottom, and show what they say."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

marimo = pytest.importorskip("marimo", reason="the extra [examples] is not installed")
EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"


def names_after(example: str) -> Any:
    """What its cells define, by name."""
    spec = importlib.util.spec_from_file_location(example, EXAMPLES / f"{example}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.app.run()[1]


def test_the_joint_slows_down_when_its_brake_takes_hold_and_with_more_resistance() -> None:
    names = names_after("joint")
    time, w = names["result"].time, names["result"]["w_motor"]
    assert w[time > 3.5].mean() < 0.99 * w[(time > 1.5) & (time < 2)].mean()
    ends = [run["w_motor"][-1] for _, run in names["found"]]
    assert ends == sorted(ends, reverse=True)


def test_another_gear_turns_in_the_gearheads_place() -> None:
    results = names_after("own_unit")["results"]
    assert set(results) == {"planetary", "harmonic"}
    ratios = [np.mean(r["w_motor"][-200:]) / np.mean(r["w_pulley"][-200:]) for r in results.values()]
    assert abs(ratios[0] - ratios[1]) > 1
    assert all(np.isfinite(ratios))


@pytest.mark.long
def test_a_log_becomes_a_name_and_a_repaired_system_that_predicts_the_held_out_run() -> None:
    answer = names_after("own_log")["answer"]
    assert answer.findings[0]["term"].endswith(".stribeck")
    held_out = answer.to_pandas().xs("holdout", level="runs")
    assert (held_out["repaired"] < held_out["calibrated"]).all()
    assert answer.repaired.is_file()
