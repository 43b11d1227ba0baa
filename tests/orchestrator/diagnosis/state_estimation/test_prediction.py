"""Anchored prediction: what a free run over minutes gets wrong it gets right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.state_estimation import prediction
from cobot_joint.diagnosis.state_estimation.native.restart import LostError
from cobot_joint.diagnosis.state_estimation.noise import ChannelNoise, noise_of
from cobot_joint.diagnosis.state_estimation.prediction import Predicted, Variant, pieces, predict, predicted_figures
from cobot_joint.diagnosis.state_estimation.sampled import SampledSystem
from cobot_joint.system.read import load_system
from tests.orchestrator.diagnosis.state_estimation.rig import COGGING, NOISE, SIGMA, recorded, run

BASE = {"loaded": load_system("joint_logged")}


def free_error(recording: Recording, values: dict[str, float]) -> float:
    return float(np.std(recording.outputs["i_motor"] - run(values, seconds=recording.time[-1]).y[:, 0]))


def test_a_system_predicts_its_own_run_without_noise() -> None:
    figures = predicted_figures([recorded(run(), noisy=False)], {"nominal": Variant(BASE)}, NOISE)
    for channel, sigma in SIGMA.items():
        assert figures[channel]["nominal"] < 0.02 * sigma


@pytest.mark.long
def test_cogging_whose_phase_a_free_run_loses_is_worse_than_none_there_and_right_when_anchored() -> None:
    """The machine's gear ratio of speed and voltage is off a little, so that a free run's angle is soon lost."""
    other = {"motor_bldc.winding.k": 0.0232 * 1.02}
    recording = recorded(run({**COGGING, **other}, seconds=6.0))
    base, right = {}, dict(COGGING)
    assert free_error(recording, right) > free_error(recording, base)
    figures = predicted_figures([recording], {"base": Variant(BASE, base), "cogging": Variant(BASE, right)}, NOISE)[
        "i_motor"
    ]
    assert figures["cogging"] < 0.8 * figures["base"]


def test_a_speed_that_is_a_mean_since_the_sample_before_is_predicted_as_one() -> None:
    """A hoist's held-out speed erred 1.57 rad/s by these figures, 0.65 by free runs: its mean, against an instant's."""
    system = load_system("joint_no_load")
    time = 0.01 * np.arange(300)
    driven = {"v_command": np.interp(time, [0.2, 0.3, 1.0, 1.1, 2.0, 2.1], [0, 6, 6, -3, -3, 8])}
    with SampledSystem(system, ["i_motor", "w_motor"]) as sampled:
        piece = sampled.run(sampled.start({}), time, driven)
    outputs = {name: piece.y[:, j] for j, name in enumerate(("i_motor", "w_motor"))}
    outputs["w_motor"] = np.diff(piece.signals["motor_bldc.phi"], prepend=0.0) / 0.01
    instant = Recording("run", "train", "no_load", time, driven, outputs, {"i_motor": "A", "w_motor": "rad/s"})
    mean = replace(instant, differences={"w_motor": "backward"})
    system_by_setup = {"nominal": Variant({"no_load": system})}
    errs = [predicted_figures([r], system_by_setup, NOISE)["w_motor"]["nominal"] for r in (instant, mean)]
    assert errs[0] > 1.0
    assert errs[1] < SIGMA["w_motor"]


def test_right_values_predict_down_to_the_noise() -> None:
    figures = predicted_figures(
        [recorded(run(COGGING))], {"nominal": Variant(BASE), "repaired": Variant(BASE, COGGING)}, NOISE
    )
    for channel, sigma in SIGMA.items():
        assert figures[channel]["repaired"] == pytest.approx(sigma, rel=0.06)
    assert figures["i_motor"]["nominal"] > 3 * SIGMA["i_motor"]
    assert figures["i_motor"]["horizon"] == 0.2


def test_pieces_are_cut_at_gaps_and_every_horizon() -> None:
    recording = recorded(run(seconds=1.0))
    recording.outputs = {n: y.copy() for n, y in recording.outputs.items()}
    for y in recording.outputs.values():
        y[450:520] = np.nan
    found = pieces(recording, 0.2)
    assert found == [(0, 200), (200, 450), (520, 720), (720, 1001)]
    recording.outputs["i_motor"][100] = np.nan  # one channel's sample is no gap
    assert pieces(recording, 0.2) == found


def test_nothing_is_predicted_in_a_gap_and_all_of_the_rest() -> None:
    recording = recorded(run(seconds=1.5))
    lost = (recording.time > 0.8) & (recording.time < 1.0)
    recording.outputs = {n: np.where(lost, np.nan, y) for n, y in recording.outputs.items()}
    found = predict(recording, Variant(BASE), NOISE).anchored
    for channel, series in found.items():
        np.testing.assert_array_equal(np.isfinite(series), ~lost)
        error = (series - recording.outputs[channel])[~lost]
        assert np.std(error) == pytest.approx(SIGMA[channel], rel=0.1)


def test_a_prediction_begins_at_a_state_that_knows_nothing_of_the_samples_it_predicts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is recorded from a piece's beginning on does not move the prediction there, the sizes being given."""
    monkeypatch.setattr(prediction, "with_sizes", lambda estimator, tracked: estimator)
    recording = recorded(run(seconds=1.0))
    before = predict(recording, Variant(BASE), NOISE).anchored
    later = recording.time > 0.7999
    recording.outputs = {n: np.where(later, y + 5 * SIGMA[n], y) for n, y in recording.outputs.items()}
    after = predict(recording, Variant(BASE), NOISE).anchored
    for channel in SIGMA:
        np.testing.assert_array_equal(after[channel], before[channel])


def test_where_a_filter_loses_its_way_the_free_run_counts_of_every_variant(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recorded(run(seconds=0.2))
    off = {"right": {"anchored": 0.0, "free": 1.0}, "lost": {"anchored": 9.0, "free": 2.0}}

    def stated(recording: Recording, variant: Variant, **more: object) -> Predicted:
        by = off[str(variant.values["name"])]
        return Predicted(*({c: y + by[kind] * SIGMA[c] for c, y in recording.outputs.items()} for kind in by))

    monkeypatch.setattr(prediction, "predict", stated)
    found = {name: Variant(BASE, {"name": name}) for name in off}
    for channel, sigma in SIGMA.items():
        figures = predicted_figures([recording], found, NOISE)[channel]
        assert (figures["right"], figures["lost"]) == pytest.approx((sigma, 2 * sigma))
        alone = predicted_figures([recording], {"right": found["right"]}, NOISE)[channel]
        assert alone["right"] == pytest.approx(0.0)


def test_a_filter_that_is_lost_is_one_that_loses_its_way(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recorded(run(seconds=0.2))

    def lost(*_: object) -> None:
        raise LostError

    monkeypatch.setattr(prediction.StateEstimator, "track", lost)
    assert predict(recording, Variant(BASE), NOISE).lost(recording, NOISE)


def test_a_free_run_s_position_is_judged_by_what_it_drifts_within_a_horizon() -> None:
    """A rotary table's motor drifted 7 rad off with a friction that was right, and by nearly as much without it; that
    outweighed speeds that it had a third closer, and the filter's loss of its way."""
    piece = run(seconds=1.0)
    recording = recorded(piece, noisy=False)
    with SampledSystem(BASE["loaded"], ["phi_motor"], {}) as sampled:
        phi = sampled.free(recording).y[:, 0]
    drift = 0.5  # rad/s
    recording.outputs["phi_motor"], recording.units["phi_motor"] = phi + drift * piece.time, "rad"
    free = predict(recording, Variant(BASE), {**NOISE, "phi_motor": ChannelNoise(1e-3)}).free["phi_motor"]
    off = np.abs(free - recording.outputs["phi_motor"])
    assert off[:-1:200] == pytest.approx(0.0, abs=1e-9)
    assert off.max() == pytest.approx(drift * 0.2, rel=0.02)


def test_a_unit_whose_states_cannot_be_set_has_no_prediction(axis: Path) -> None:
    time = np.arange(10) * 1e-3
    recording = Recording("run", "holdout", "default", time, {"u": time}, {"axis.s": time}, {})
    figures = predicted_figures([recording], {"nominal": Variant({"default": load_system(axis)})}, {})
    assert figures == {"axis.s": None}


def test_a_channel_without_noise_of_its_own_has_one_to_count_by() -> None:
    time = np.arange(500) * 1e-3
    run = Recording("run", "train", "default", time, {}, {"w": np.zeros(500)}, {"w": "rad/s"})
    noise = noise_of(Campaign("", Path(), "axis", {}, {}, {}, {}, [run]))["w"]
    assert (noise.sigma, noise.rho) == (1.0, 0.0)
