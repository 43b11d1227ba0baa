"""Noise, colour and step come out as they were put in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.conditioning import assess, beginning
from cobot_joint.diagnosis.data.recording import Recording, condition

N = 16000
STEP = 1e-3
T = np.arange(N) * STEP


def noise(rho: float, sigma: float, seed: int = 7) -> np.ndarray:
    white = np.random.default_rng(seed).standard_normal(N + 500)
    return sigma * scipy.signal.lfilter([np.sqrt(1 - rho**2)], [1, -rho], white)[500:]


def motion() -> np.ndarray:
    """At rest for a second, then ramps, plateaus and a resonance that rings down."""
    ramps = np.interp(T, [1, 2, 4, 5, 9, 10], [0, 300, 300, -200, -200, 0])
    return ramps + 20 * np.exp(-np.maximum(T - 4, 0) / 0.3) * np.sin(2 * np.pi * 30 * T) * (T > 4)


@pytest.mark.parametrize("rho", [-0.4, 0.0, 0.5, 0.8])
def test_noise_and_its_colour_are_estimated_under_a_moving_signal(rho: float) -> None:
    q = assess(motion() + noise(rho, 0.3))
    assert q.noise == pytest.approx(0.3, rel=0.06)
    assert q.colour == pytest.approx(rho, abs=0.06)


def test_motion_quicker_than_a_window_is_no_coloured_noise() -> None:
    swinging = 0.5 * np.sin(2 * np.pi * 7 * T + 3 * np.sin(2 * np.pi * 0.31 * T))  # 90 to 250 samples a period
    q = assess(swinging + noise(0.0, 0.03))
    assert q.noise == pytest.approx(0.03, rel=0.2)  # 0.54 and a colour of 0.98 in windows of 256 samples
    assert abs(q.colour) < 0.3


def test_where_no_window_is_without_motion_noise_is_what_has_no_pattern() -> None:
    waves = 300 * np.sin(2 * np.pi * 12 * T + 2 * np.sin(2 * np.pi * 0.3 * T))
    q = assess(waves + noise(0.0, 0.3))
    assert q.noise == pytest.approx(0.3, rel=0.1)
    assert abs(q.colour) < 0.1


def test_standing_still_says_nothing_of_the_noise() -> None:
    x = motion() + noise(0.0, 0.3)
    x[:8000] = x[0]
    assert assess(x).noise == pytest.approx(0.3, rel=0.06)


def counts(per_turn: int, step: float, angle: np.ndarray) -> np.ndarray:
    """rad/s, as an encoder counts from sample to sample."""
    ticks = np.floor(angle * per_turn / (2 * np.pi))
    return np.diff(ticks, prepend=ticks[0]) / step * 2 * np.pi / per_turn


def test_steps_that_a_file_rounded_once_more_are_seen() -> None:
    """Encoder counts of 2.93 rpm each, in whole rpm: 2, 3, 6, 9, 12, which are multiples of nothing but 1."""
    t = 0.01 * np.arange(1600)
    angle = np.cumsum(np.interp(t, [0, 2, 5, 8, 11, 16], [0, 150, 150, -80, -80, 200])) * 0.01
    rpm = np.round(counts(2048, 0.01, angle) * 60 / (2 * np.pi))
    assert assess(rpm).step == pytest.approx(60 / 2048 / 0.01, rel=2e-3)
    anywhere = np.round(np.random.default_rng(5).uniform(0, 900, 150))  # as many values that are no counts
    assert assess(np.resize(anywhere, 1600)).step in (0.0, 1.0)


def test_an_encoder_s_counts_at_one_speed_are_as_uncertain_as_at_any_other() -> None:
    """The noise of a hoist's speed was half of what its counts are off by: at constant speed they stay the same."""
    t = 0.01 * np.arange(1600)
    w = np.interp(t, [0, 4, 5, 8, 9, 12, 13, 16], [0, 0, 153.4, 153.4, -73.6, -73.6, 257.7, 257.7])
    r = Recording("run", "train", "default", t, {}, {"w": counts(2048, 0.01, np.cumsum(w) * 0.01)}, {"w": "rad/s"})
    known = condition([replace(r, differences={"w": "backward"})])["w"]
    assert condition([r])["w"].noise < 0.7 * known.noise
    assert known.noise == pytest.approx(2 * np.pi / 2048 / 0.01 / np.sqrt(6), rel=1e-2)


def test_the_converter_step_is_read_off_the_values() -> None:
    for step, scale in ((0.3834951969714103, 1.0), (10 / 4096, 0.01)):
        x = np.round(scale * (motion() + noise(0.0, 0.3)) / step) * step
        assert assess(np.round(x, 6)).step == pytest.approx(step, rel=1e-3)
    assert assess(motion() + noise(0.0, 0.3)).step == 0.0


def test_a_channel_at_its_rail_counts_as_saturated() -> None:
    x = np.clip(motion() + noise(0.0, 0.3), -150, 250)
    assert assess(x).saturated > 4000
    assert assess(motion() + noise(0.0, 0.3)).saturated == 0


def test_a_smooth_peak_that_a_converter_rounds_is_not_called_saturated_and_one_that_is_cut_off_is() -> None:
    wave = 2.7 * np.sin(2 * np.pi * np.arange(4000) / 2000)
    step = 0.0059
    assert assess(step * np.rint(wave / step)).saturated == 0
    assert assess(step * np.rint(np.clip(wave, -2.6, 2.6) / step)).saturated > 100


def test_samples_not_recorded_are_counted_and_do_not_disturb() -> None:
    x = motion() + noise(0.5, 0.3)
    x[2000:2300] = np.nan
    q = assess(x)
    assert q.missing == 300
    assert q.noise == pytest.approx(0.3, rel=0.06)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_noise_and_its_colour_are_estimated_where_no_window_is_recorded_in_full(rho: float) -> None:
    x = np.where(np.random.default_rng(3).random(N) < 0.3, np.nan, motion() + noise(rho, 0.3))
    q = assess(x)
    assert q.noise == pytest.approx(0.3, rel=0.06)
    assert q.colour == pytest.approx(rho, abs=0.06)


@pytest.mark.parametrize(("case", "rho"), [("case01", 0.0), ("case03", 0.5), ("case06", 0.8)])
def test_the_loggers_data_sheet_is_recovered_from_the_open_campaigns(root: Path, case: str, rho: float) -> None:
    """White noise and quantisation together: 4.06e-3 A, 0.320 rad/s, 5.19e-3 N.m, 12 bits."""
    quality = condition(load_campaign(root / "proof/open" / case, roles=("train",)).recordings)
    for name, sigma in {"i_motor": 4.06e-3, "w_motor": 0.320, "tau_sensor": 5.19e-3}.items():
        assert quality[name].noise == pytest.approx(sigma, rel=0.03)
    assert quality["tau_sensor"].colour == pytest.approx(rho, abs=0.08)
    assert quality["i_motor"].step == pytest.approx(10 / 4096, rel=1e-3)


def test_where_a_series_begins_is_known_to_a_fraction_of_its_noise() -> None:
    """A rotor that coasts carries what its first sample is off on to the end: 1.0 sigma from one sample alone."""
    t = 0.02 * np.arange(4000)
    coasting = 310 * np.exp(-t / 100)
    off = [beginning(coasting + 0.15 * np.random.default_rng(k).standard_normal(len(t)))[0] - 310 for k in range(30)]
    assert np.sqrt(np.mean(np.square(off))) < 0.4 * 0.15


def test_where_a_series_begins_is_not_smoothed_where_it_bends() -> None:
    t = 0.02 * np.arange(4000)
    for starts in (50 * (t > 0.1), 50 * (1 - np.exp(-t / 0.2)), 3 * np.sin(9 * t)):
        off = [beginning(starts + 0.01 * np.random.default_rng(k).standard_normal(len(t)))[0] for k in range(30)]
        assert np.sqrt(np.mean(np.square(off))) < 0.02
