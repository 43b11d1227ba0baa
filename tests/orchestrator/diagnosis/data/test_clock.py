"""Single samples that are missing, or that no machine makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.orchestrator.diagnosis.data.test_recording import SIGNALS, T, read


@pytest.mark.parametrize("count", [1, 3])
def test_samples_that_stand_alone_within_the_range_are_not_compared_and_an_impact_is(
    tmp_path: Path, count: int
) -> None:
    """A spike of 430 sigma, among impacts of 80, went unseen and was most of what a calibration left."""
    at, rng = [200, 500, 800][:count], np.random.default_rng(1)
    w = (
        SIGNALS["w [rad/s]"]
        + rng.normal(0, 0.1, len(T))
        + np.where(np.isin(np.arange(1000), [300, 301, 600, 601]), 8, 0)
    )
    spiked = np.where(np.isin(np.arange(1000), at), w + 40, w)
    r = read(tmp_path, T, SIGNALS | {"w [rad/s]": spiked})
    assert np.nanmax(np.abs(r.outputs["w"] - w)) < 1.0  # one that is missing is bridged
    (out,) = r.left_out
    assert (out.channel, out.samples) == ("w", count)
    assert "apart from those before and after" in out.words
    assert read(tmp_path, T, SIGNALS | {"w [rad/s]": w}).left_out == []


def test_one_value_that_is_missing_is_bridged_and_not_called_off_the_clock(tmp_path: Path) -> None:
    w = np.where(np.arange(1000) == 200, np.nan, SIGNALS["w [rad/s]"])
    r = read(tmp_path, T, SIGNALS | {"w [rad/s]": w})
    assert r.outputs["w"][200] == pytest.approx(SIGNALS["w [rad/s]"][200], abs=0.01)
    assert r.notes == [
        "w has no value in 1 of 1000 samples, left out",
        "w: 1 of 1000 samples are missing singly, bridged",
    ]


def test_samples_between_stamps_of_whole_seconds_are_taken_evenly_apart(tmp_path: Path) -> None:
    """Of ten samples a second nine had been dropped."""
    t = 0.3 + 0.1 * np.arange(1000)
    r = read(tmp_path, np.floor(t + 1e-9), SIGNALS)
    assert r.step == pytest.approx(0.1, rel=1e-3)
    assert len(r.time) == 1000
    assert np.array_equal(r.outputs["w"], SIGNALS["w [rad/s]"])
    assert any("counts in steps of 1 s and has 10 samples in each: taken 0.1 s apart" in note for note in r.notes)


def test_a_gap_between_such_stamps_stays_one(tmp_path: Path) -> None:
    t = 0.3 + 0.1 * np.arange(1000) + 30.0 * (np.arange(1000) > 500)
    r = read(tmp_path, np.floor(t + 1e-9), SIGNALS)
    assert len(r.time) == pytest.approx(1300, abs=1)
    w = r.outputs["w"][np.isfinite(r.outputs["w"])]
    assert np.corrcoef(w[:500], SIGNALS["w [rad/s]"][:500])[0, 1] > 0.999


def test_samples_that_came_at_no_even_pace_are_not_taken_to_have(tmp_path: Path) -> None:
    counts = np.random.default_rng(1).integers(1, 20, 200)
    t = np.repeat(0.1 * np.arange(200), counts)[:1000]
    r = read(tmp_path, t, SIGNALS)
    assert any("time stamps, the first sample of each is used" in note for note in r.notes)
