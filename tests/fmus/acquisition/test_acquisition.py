"""The logger alone: ranges, steps, delays, noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Make = Callable[..., Any]

STEP = 10 / 4096  # V, 12 bits over +-5 V
CHANNELS = {  # reading: (signal, voltage, V per unit)
    "i_reading": ("i_motor", "y_i", 1.0),
    "w_reading": ("w_motor", "y_w", 4 / (6000 * 2 * np.pi / 60)),
    "tau_reading": ("tau_sensor", "y_tau", 5 / 10),
}


def test_readings_are_the_signals_as_the_unit_starts(make: Make) -> None:
    logger = make("acquisition")
    for k in range(50):
        x = {"i_motor": 0.1 * np.sin(k), "w_motor": 500 * np.cos(k), "tau_sensor": np.sin(7 * k)}
        logger.set(x)
        for reading, (signal, _, _) in CHANNELS.items():
            assert logger[reading] == x[signal]
        logger.step(1e-3)
        for reading, (signal, _, _) in CHANNELS.items():
            assert logger[reading] == x[signal]


@pytest.mark.parametrize("reading", CHANNELS)
def test_channel_voltages_have_their_scale(make: Make, reading: str) -> None:
    signal, voltage, scale = CHANNELS[reading]
    logger = make("acquisition", {signal: 3.0})
    assert logger[voltage] == pytest.approx(3.0 * scale, rel=1e-12)


def test_six_thousand_rpm_are_4_volts_and_10_newton_metres_are_5(make: Make) -> None:
    logger = make("acquisition", {"w_motor": 6000 * 2 * np.pi / 60, "tau_sensor": 10.0})
    assert logger["y_w"] == pytest.approx(4, rel=1e-12)
    assert logger["y_tau"] == pytest.approx(5, rel=1e-12)


def test_current_range_of_the_no_load_tests_is_a_parameter(make: Make) -> None:
    logger = make("acquisition", {"i_motor": 0.6, "range.k_i": 4 / 0.6})
    assert logger["y_i"] == pytest.approx(4, rel=1e-12)
    logger.set({"i_motor": 1.0})
    assert logger["i_reading"] == pytest.approx(0.75, rel=1e-12)


@pytest.mark.parametrize("reading", CHANNELS)
@pytest.mark.parametrize("sign", [1, -1])
def test_readings_stop_at_5_volts(make: Make, reading: str, sign: int) -> None:
    signal, voltage, scale = CHANNELS[reading]
    logger = make("acquisition", {signal: sign * 1e4})
    assert logger[voltage] == sign * 5
    assert logger[reading] == pytest.approx(sign * 5 / scale, rel=1e-12)


@pytest.mark.parametrize("reading", CHANNELS)
def test_twelve_bits_make_steps_of_10_volts_over_4096(make: Make, reading: str) -> None:
    signal, voltage, scale = CHANNELS[reading]
    logger = make("acquisition", {"converter.bits": 12})
    codes = set()
    for x in np.linspace(-5.2, 5.2, 2001) / scale:
        logger.set({signal: x})
        code = logger[voltage] / STEP
        assert code == round(code)
        assert logger[reading] == pytest.approx(logger[voltage] / scale, rel=1e-12)
        if abs(x * scale) < 5 - STEP:
            assert abs(logger[voltage] - x * scale) <= STEP / 2 * (1 + 1e-9)
        codes.add(round(code))
    assert min(codes) == -2048
    assert max(codes) == 2047


def test_steps_of_the_readings_are_those_of_the_specification(make: Make) -> None:
    """docs/bench.md: 2.44e-3 A, 0.383 rad/s, 4.88e-3 N.m"""
    logger = make("acquisition", {"converter.bits": 12})
    steps = {"i_motor": 2.44e-3, "w_motor": 0.383, "tau_sensor": 4.88e-3}
    for reading, (signal, _, _) in CHANNELS.items():
        logger.set({signal: 0.9 * steps[signal]})
        assert logger[reading] == pytest.approx(steps[signal], rel=2e-3)


def test_set_value_leaves_in_steps_of_20_volts_over_4096(make: Make) -> None:
    logger = make("acquisition", {"v_command": 3.0001, "converter.bits": 12})
    assert logger["v_set"] == round(3.0001 / (20 / 4096)) * 20 / 4096
    logger.set({"v_command": 11.0})
    assert logger["v_set"] == 10 - 20 / 4096
    exact = make("acquisition", {"v_command": 3.0001})
    assert exact["v_set"] == 3.0001


@pytest.mark.parametrize(("i", "y"), [(0.0, 2.5), (2.0, 2.87), (-5.0, 1.575), (7.0, 3.425), (-7.0, 1.575)])
def test_acs712_gives_2_5_volts_and_185_millivolts_per_ampere_within_5_amperes(make: Make, i: float, y: float) -> None:
    logger = make("acquisition", {"i_a": i, "i_b": i, "i_c": i})
    for phase in "abc":
        assert logger[f"y_{phase}"] == pytest.approx(y, rel=1e-12)


def test_current_offset_adds_to_the_reading(make: Make) -> None:
    logger = make("acquisition", {"i_motor": 1.5, "current_offset.i_0": -0.02})
    assert logger["i_reading"] == 1.5 - 0.02


@pytest.mark.parametrize(
    ("term", "signal", "reading"),
    [("speed_delay", "w_motor", "w_reading"), ("torque_delay", "tau_sensor", "tau_reading")],
)
@pytest.mark.parametrize("T", [0.3e-3, 1e-3, 2.7e-3, 10e-3])
@pytest.mark.parametrize("h", [1e-3, 0.25e-3, 0.7e-3])
def test_delay_shifts_the_channel_by_fractions_of_a_step(
    make: Make, term: str, signal: str, reading: str, T: float, h: float
) -> None:
    """against the signal's own line between communication points; before the start it stood still"""
    logger = make("acquisition", {f"{term}.T": T})
    out = logger.run(0.05, h, [reading, signal], {signal: lambda t: np.sin(100 * t) + 0.3})
    expected = np.interp(out["time"] - T, out["time"], out[signal])
    np.testing.assert_allclose(out[reading], expected, atol=1e-12)


def test_delay_of_one_channel_leaves_the_others(make: Make) -> None:
    logger = make("acquisition", {"speed_delay.T": 5e-3})
    out = logger.run(
        0.02, 1e-3, ["tau_reading", "i_reading"], {n: lambda t: 100 * t for n in ("tau_sensor", "i_motor")}
    )
    np.testing.assert_allclose(out["tau_reading"], 100 * out["time"], atol=1e-12)
    np.testing.assert_allclose(out["i_reading"], 100 * out["time"], atol=1e-12)


def test_delay_bridges_more_steps_than_the_memory_has_rows(make: Make) -> None:
    logger = make("acquisition", {"speed_delay.T": 0.01})
    out = logger.run(0.03, 1e-5, ["w_reading"], {"w_motor": lambda t: np.sin(200 * t)})
    later = out["time"] > 0.01
    np.testing.assert_allclose(out["w_reading"][later], np.sin(200 * (out["time"][later] - 0.01)), atol=3e-5)


def test_noise_is_white_with_the_given_deviation_and_none_without(make: Make) -> None:
    sigma = {"noise.sigma_i": 4e-3, "noise.sigma_w": 0.3, "noise.sigma_tau": 5e-3}
    out = make("acquisition", sigma).run(8.0, 1e-3, list(CHANNELS))
    quiet = make("acquisition").run(0.1, 1e-3, list(CHANNELS))
    for reading, s in zip(CHANNELS, sigma.values(), strict=True):
        x, n = out[reading], len(out[reading])
        assert np.std(x) == pytest.approx(s, rel=4 / np.sqrt(2 * n))
        assert abs(np.mean(x)) < 4 * s / np.sqrt(n)
        assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 4 / np.sqrt(n)
        assert not np.any(quiet[reading])
    assert abs(np.corrcoef(out["i_reading"], out["w_reading"])[0, 1]) < 4 / np.sqrt(n)


def test_noise_and_conversion_together_have_the_specified_deviation(make: Make) -> None:
    """docs/bench.md: 4.06e-3 A, 0.320 rad/s, 5.19e-3 N.m"""
    sigma = {"noise.sigma_i": 4e-3, "noise.sigma_w": 0.3, "noise.sigma_tau": 5e-3, "converter.bits": 12}
    inputs = {signal: (lambda t, s=scale: 0.9 / s * t) for signal, _, scale in CHANNELS.values()}
    out = make("acquisition", sigma).run(4.0, 1e-3, list(CHANNELS), inputs)
    for (reading, (signal, _, _)), total in zip(CHANNELS.items(), (4.06e-3, 0.320, 5.19e-3), strict=True):
        error = out[reading] - [inputs[signal](t) for t in out["time"]]
        assert np.std(error) == pytest.approx(total, rel=4 / np.sqrt(2 * len(error)))


def test_colour_of_the_torque_noise_keeps_its_deviation(make: Make) -> None:
    x = make("acquisition", {"noise.sigma_tau": 5e-3, "noise.rho_tau": 0.8}).run(8.0, 1e-3, ["tau_reading"])[
        "tau_reading"
    ]
    assert np.corrcoef(x[1:], x[:-1])[0, 1] == pytest.approx(0.8, abs=0.04)
    assert np.std(x) == pytest.approx(5e-3, rel=0.1)


def test_seed_decides_the_noise(make: Make) -> None:
    def noise(seed: int) -> np.ndarray:
        return make("acquisition", {"noise.sigma_i": 1.0, "noise.seed": seed}).run(0.1, 1e-3, ["i_reading"])[
            "i_reading"
        ]

    np.testing.assert_array_equal(noise(1), noise(1))
    assert abs(np.corrcoef(noise(1), noise(2))[0, 1]) < 0.5


def test_sampled_readings_do_not_depend_on_the_communication_step(make: Make) -> None:
    start = {
        "sampling.T_s": 1e-3,
        "noise.sigma_i": 0.1,
        "noise.sigma_tau": 0.1,
        "noise.rho_tau": 0.5,
        "torque_delay.T": 0.4e-3,
    }
    ramps = {"i_motor": lambda t: 2 * t, "tau_sensor": lambda t: 3 * t}
    coarse = make("acquisition", start).run(0.05, 1e-3, ["i_reading", "tau_reading"], ramps)
    fine = make("acquisition", start).run(0.05, 0.125e-3, ["i_reading", "tau_reading"], ramps)
    slow = make("acquisition", start).run(0.05, 5e-3, ["i_reading", "tau_reading"], ramps)
    for reading in ("i_reading", "tau_reading"):
        np.testing.assert_allclose(fine[reading][::8], coarse[reading], atol=1e-12)
        np.testing.assert_allclose(slow[reading], coarse[reading][::5], atol=1e-12)


def test_sampled_readings_hold_between_samples(make: Make) -> None:
    out = make("acquisition", {"sampling.T_s": 1e-3}).run(0.01, 0.25e-3, ["w_reading"], {"w_motor": lambda t: 1000 * t})
    np.testing.assert_allclose(out["w_reading"], np.floor(out["time"] / 1e-3 + 1e-6), atol=1e-9)


def test_noise_of_the_phase_sensors_is_white_of_their_own_and_repeats_with_the_seed(make: Make) -> None:
    """21 mV peak to peak as 6.6 sigma: data sheet of the ACS712"""
    sigma, names = 0.021 / 6.6, ["y_a", "y_b", "y_c"]
    start = {"i_a": 2.0, "acs712.sigma": sigma}
    runs = [make("acquisition", {**start, "noise.seed": seed}).run(4.0, 1e-3, names) for seed in (7, 7, 8)]
    y = np.array([runs[0][name][1:] for name in names])
    assert np.mean(y, axis=1) == pytest.approx([2.87, 2.5, 2.5], abs=4 * sigma / np.sqrt(4000))
    assert np.std(y, axis=1) == pytest.approx(sigma, rel=0.05)
    assert np.corrcoef(y) == pytest.approx(np.eye(3), abs=0.06)
    n = y - y.mean(axis=1, keepdims=True)
    assert np.abs(np.mean(n[:, 1:] * n[:, :-1], axis=1)).max() < 0.06 * sigma**2
    for name in names:
        np.testing.assert_array_equal(runs[1][name], runs[0][name])
        assert not np.array_equal(runs[2][name], runs[0][name])
