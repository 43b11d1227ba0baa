"""Samples that are no measurements are taken as not recorded and told; those of sound channels stay as they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import without_faults

STEP, N = 1e-3, 8000
T = STEP * np.arange(N)
AGAIN = np.random.default_rng(3).random(N) < 0.3
HOLD = np.maximum.accumulate(np.where(AGAIN, 0, np.arange(N)))


def run(w: np.ndarray, name: str = "run", **more: object) -> Recording:
    """A speed beside a current that moves."""
    i = np.sin(3 * T) + np.random.default_rng(9).normal(0, 4e-3, N)
    units = {"w": "rad/s", "i": "A"}
    return Recording(name, "train", "default", T, {}, {"w": w, "i": i}, units, **more)  # type: ignore[arg-type]


def speed(amplitude: float = 300.0, step: float = 0.38) -> np.ndarray:
    """With noise, in steps of a converter."""
    noisy = amplitude * np.sin(4 * T) + np.random.default_rng(1).normal(0, 0.3, N)
    return step * np.round(noisy / step) if step else noisy


@pytest.mark.parametrize("step", [0.0, 0.38, 2.0], ids=lambda step: f"step {step}")
@pytest.mark.parametrize("amplitude", [300.0, 10.0, 0.1])
def test_of_a_sound_channel_no_sample_is_left_out_however_slow_it_is_or_coarse(step: float, amplitude: float) -> None:
    r = run(speed(amplitude, step))
    assert without_faults([r]) == [r]


def test_of_a_clipped_channel_what_is_at_the_limit_is_left_out_and_nothing_far_from_it() -> None:
    sound = speed()
    (r,) = without_faults([run(np.clip(sound, -180, 180))])
    left = np.isnan(r.outputs["w"])
    assert left[np.abs(sound) >= 180].all()
    assert not left[np.abs(sound) < 160].any()
    (out,) = r.left_out
    assert (out.channel, out.kind, out.samples) == ("w", "clipped", int(left.sum()))
    assert f"{left.sum()} of 8000 samples are taken as not recorded" in out.words
    assert "top" in out.words
    assert "bottom" in out.words


def test_a_speed_of_encoder_counts_that_rests_between_steps_is_neither_held_nor_clipped() -> None:
    """Of a hoist's speed 1835 of 3200 samples were left out: it stood still before each step of its voltage, and at its
    highest speed an encoder's counts hid the noise."""
    level = np.repeat(np.resize([0.0, 100, 20, 360, -80, 200, 0, 340], 40), N // 40)
    w = np.empty(N)
    w[0] = 0.0
    for k in range(1, N):
        w[k] = w[k - 1] + (level[k] - w[k - 1]) / 3
    ticks = np.floor(np.cumsum(w) * 0.01 * 2048 / (2 * np.pi))  # at 100 Hz
    rpm = np.round(np.diff(ticks, prepend=0.0) * 60 / 2048 / 0.01)
    r = replace(run(rpm * np.pi / 30), time=10 * T)
    assert without_faults([r])[0].left_out == []


@pytest.mark.parametrize("step", [0.0, 0.01], ids=lambda step: f"step {step}")
def test_a_profile_that_slows_down_to_its_rests_is_neither_clipped_nor_frozen(step: float) -> None:
    up = 20 * (1 - np.cos(np.pi * T[:1000]))
    rests = [np.full(1000, level) for level in (0.0, 40.0, 0.0, 40.0)]
    profile = np.concatenate([rests[0], up, rests[1], up[::-1], rests[2], up, rests[3], up[::-1]])
    w = step * np.round(profile / step) if step else profile
    r = run(w)
    assert without_faults([r]) == [r]


def test_a_channel_that_waits_for_a_step_of_what_drives_it_is_not_frozen() -> None:
    """A camera's angle, at rest until its set point stepped and a sample longer, was "frozen while setpoint moves"."""
    setpoint = np.where(T < 2.0, 0.0, 15.0)
    w = np.where(T < 2.002, 0.0, 30 * (1 - np.exp(-(T - 2.002) / 0.1))) * (T < 6)
    r = replace(run(w), inputs={"setpoint": setpoint}, outputs={"w": w}, units={"w": "rad/s", "setpoint": "rad"})
    assert not [out for out in without_faults([r])[0].left_out if out.kind == "frozen"]


def test_every_frozen_stretch_is_left_out_but_for_its_first_sample() -> None:
    sound = speed(step=0.0)
    w = sound.copy()
    for start, stop in ((1000, 1600), (5000, 6000)):
        w[start:stop] = w[start]
    (r,) = without_faults([run(w)])
    assert np.flatnonzero(np.isnan(r.outputs["w"])).tolist() == [*range(1001, 1600), *range(5001, 6000)]
    assert r.left_out[0].words.startswith("frozen at")


def test_a_channel_that_has_lost_its_noise_is_frozen_though_nothing_moves() -> None:
    steady = np.where(T < 4, speed(step=0.0), 100.0 + np.random.default_rng(1).normal(0, 0.3, N))
    w = np.where(T < 6, steady, 100.3)
    still = run(w)
    still.outputs["i"][T >= 4] = 1.0 + np.random.default_rng(9).normal(0, 4e-3, int((T >= 4).sum()))
    (r,) = without_faults([still])
    assert np.isnan(r.outputs["w"]).sum() == pytest.approx(2000, abs=1)
    assert "without its noise" in r.left_out[0].words
    off = run(np.where(T < 6, steady, 0.0))  # a drive that is switched off
    off.outputs["i"][T >= 6] = 0.0
    assert without_faults([off]) == [off]


def test_of_a_held_channel_repeats_are_left_out_in_every_run() -> None:
    runs = [run(speed()[HOLD], "fast"), run(speed(10.0)[HOLD], "slow")]
    fast, slow = without_faults(runs)
    for r in (fast, slow):
        left = np.isnan(r.outputs["w"])
        assert left[1:][AGAIN[1:]].all()
        assert left.mean() < 0.55  # some are alike by chance
        assert r.left_out[0].kind == "held"
    assert np.isfinite(fast.outputs["i"]).all()


def test_a_held_input_is_bridged_in_every_run_and_told() -> None:
    chirp = 10 * np.sin(2 * np.pi * (1 + T) * T)
    slow = np.where(T < 4, 1.0, 2.0) * np.sin(2 * np.pi * T)
    runs = [replace(run(speed()), inputs={"v": u[HOLD]}) for u in (chirp, slow)]
    for r, truth in zip(without_faults(runs), (chirp, slow), strict=True):
        held = float(np.std(truth[HOLD] - truth))
        assert np.std(r.inputs["v"] - truth) < 0.25 * held
        assert (r.left_out[0].channel, r.left_out[0].kind) == ("v", "bridged")
        assert "are bridged in a straight line" in r.left_out[0].words
    said = [replace(r, held={"v"}) for r in runs]  # what the campaign says of it counts
    for r, given in zip(without_faults(said), said, strict=True):
        assert r.inputs["v"] is given.inputs["v"]


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(np.floor(4 * T) / 4, id="stairs"),
        pytest.param(0.01 * np.round(3 * T / 0.01), id="a ramp in a converter's steps"),
        pytest.param(np.sin(4 * T)[np.arange(N) // 10 * 10], id="renewed every tenth sample"),
        pytest.param(np.where(T > 4, 5.0, 0.0) + np.sin(8 * T), id="a step in a sine"),
    ],
)
def test_what_a_command_really_repeats_is_left_as_it_is(command: np.ndarray) -> None:
    r = replace(run(speed()), inputs={"v": command})
    assert without_faults([r]) == [r]


def test_a_slow_channel_keeps_each_value_once() -> None:
    w = np.where(T < 2, speed(0.0, 0.0), speed(step=0.0))[np.arange(N) // 10 * 10]  # at rest first
    (r,) = without_faults([run(w)])
    assert np.isfinite(r.outputs["w"]).sum() == N // 10


def test_a_channel_of_one_value_while_another_moves_is_not_compared() -> None:
    (r,) = without_faults([run(np.zeros(N))])
    assert set(r.outputs) == {"i"}
    assert "it is not compared" in r.left_out[0].words
    still = run(np.zeros(N))
    still.outputs["i"][:] = 1.0
    assert without_faults([still]) == [still]


def test_a_channel_that_somebody_looked_at_is_meant() -> None:
    r = run(np.clip(speed(), -180, 180), believed={"w"})
    assert without_faults([r]) == [r]


def test_a_campaign_is_loaded_without_them(root: Path, tmp_path: Path) -> None:
    source = root / "proof/open/case01"
    (tmp_path / "campaign.toml").write_text((source / "campaign.toml").read_text())
    for file in source.glob("*.parquet"):
        table = pa.parquet.read_table(file)
        k = next(k for k, name in enumerate(table.column_names) if name.startswith("w_motor"))
        w = table.column(k).to_numpy()
        limited = np.clip(w, -0.6 * np.abs(w).max(), 0.6 * np.abs(w).max())
        pa.parquet.write_table(table.set_column(k, table.column_names[k], pa.array(limited)), tmp_path / file.name)
    campaign = load_campaign(tmp_path)
    assert {(r.role, out.channel, out.kind) for r in campaign.recordings for out in r.left_out} == {
        ("train", "w_motor", "clipped"),
        ("holdout", "w_motor", "clipped"),
    }


def test_what_is_held_in_a_held_out_run_alone_changes_no_training_run() -> None:
    train, kept = run(speed(), "train"), replace(run(speed()[HOLD], "kept"), role="holdout")
    first, second = without_faults([train, kept])
    assert first == train
    assert second.left_out
    np.testing.assert_array_equal(second.outputs["w"], without_faults([kept])[0].outputs["w"])
    held_input = np.sin(8 * T)[HOLD]
    runs = [replace(r, inputs={"v": u}) for r, u in ((train, np.sin(8 * T)), (kept, held_input))]
    np.testing.assert_array_equal(without_faults(runs)[0].inputs["v"], np.sin(8 * T))


def test_a_log_shorter_than_what_smooths_its_slope_has_no_inertia_to_compare() -> None:
    time = np.arange(1000) * 1e-5
    rng = np.random.default_rng(0)
    series = {"w": np.sin(600 * time) + rng.normal(0, 0.01, 1000), "i": np.cos(600 * time) + rng.normal(0, 0.01, 1000)}
    runs = [Recording(n, "train", "default", time, {}, series, {"w": "rad/s", "i": "A"}) for n in ("a", "b")]
    assert [s for s in suspicions(runs) if s.kind == "inertia differs"] == []
