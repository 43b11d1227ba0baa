"""The order spectrum."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from cobot_joint.diagnosis.estimation.order_spectrum import (
    FINEST,
    ORDINARY,
    clear_orders,
    clearest_between,
    order_spectrum,
    prewhitened,
    whole_orders,
)

ORDERS = range(1, 25)


def wave(w: float, order: float, amplitude: float) -> tuple[Any, Any, Any]:
    """(problem, residual, angle): noise, and a wave over a shaft that turns back and forth at about w, in rad/s."""
    t = np.arange(0, 48, 1e-3)
    phi = np.cumsum(w * np.sign(np.sin(2 * np.pi * t / 24)) * (1 + 0.2 * np.sin(t))) * 1e-3
    r = np.random.default_rng(1).normal(size=len(t)) + amplitude * np.sin(order * phi + 1)
    problem: Any = SimpleNamespace(blocks=[SimpleNamespace(recording=0, rows=slice(0, len(t)))])
    return problem, r, phi


def spectrum(w: float, order: float, amplitude: float) -> tuple[Any, Any]:
    """Of such a wave."""
    problem, r, phi = wave(w, order, amplitude)
    return order_spectrum(problem, r, "phi", [{"phi": phi}], ORDERS)


@pytest.mark.parametrize(("w", "order"), [(300.0, 4), (40.0, 1), (6.0, 3), (2.0, 12)])
def test_a_wave_over_a_fast_or_a_slow_shaft_stands_out_at_its_order(w: float, order: int) -> None:
    power, windows = spectrum(w, order, 0.3)
    assert ORDERS[int(np.argmax(power))] == order
    assert power[order - 1] > 6 * np.sqrt(windows[order - 1])


def test_what_turns_with_the_direction_stands_out_where_a_shaft_goes_there_and_back() -> None:
    """A friction of 0.3 over the angle: in the residual itself one way takes from the order what the other gave it"""
    t = np.arange(0, 48, 1e-3)
    phi = 8 * np.sin(2 * np.pi * t / 0.5)
    r = np.random.default_rng(1).normal(size=len(t)) + 0.3 * np.sin(2 * phi) * np.sign(np.gradient(phi))
    problem: Any = SimpleNamespace(blocks=[SimpleNamespace(recording=0, rows=slice(0, len(t)))])
    plain, turning = (order_spectrum(problem, r, "phi", [{"phi": phi}], ORDERS, turning=x)[0] for x in (False, True))
    assert ORDERS[int(np.argmax(turning))] == 2
    assert turning[1] > 3 * plain[1]


def test_noise_alone_shows_no_order() -> None:
    power, windows = spectrum(40.0, 1, 0.0)
    assert np.all(np.abs(power) < 6 * np.sqrt(np.maximum(windows, 1)))


def test_orders_above_the_nyquist_frequency_or_without_two_periods_are_not_judged() -> None:
    _, windows = spectrum(300.0, 1, 0.0)
    assert windows[ORDERS.index(12)] == 0  # 12*300 rad/s > 0.8*pi*1000
    _, windows = spectrum(0.5, 1, 0.0)
    assert windows[0] == 0  # 4 s at 0.5 rad/s are a third of a turn


@pytest.mark.parametrize(("w", "order"), [(300.0, 2.6179), (40.0, 3.58), (6.0, 1.1965)])
def test_an_order_between_whole_ones_is_known_to_a_tenth_of_a_turn_in_all_that_the_shaft_turned(
    w: float, order: float
) -> None:
    problem, r, phi = wave(w, order, 0.3)
    found = clearest_between(problem, r, "phi", [{"phi": phi}], 12.0)
    assert found == pytest.approx(order, abs=0.1 / (np.ptp(phi) / (2 * np.pi)))


@pytest.mark.parametrize(("order", "amplitude"), [(4, 0.3), (1, 0.3), (1, 0.0)])
def test_a_whole_order_or_noise_is_no_order_between(order: int, amplitude: float) -> None:
    problem, r, phi = wave(40.0, order, amplitude)
    assert clearest_between(problem, r, "phi", [{"phi": phi}], 12.0) is None


@pytest.mark.parametrize("w", [0.0, 0.1, 9000.0], ids=["stands", "a third of a turn", "more than a turn per sample"])
def test_a_shaft_that_stands_or_is_too_quick_for_its_samples_has_no_order_between(w: float) -> None:
    problem, r, phi = wave(w, 1.2, 0.3)
    assert clearest_between(problem, r, "phi", [{"phi": phi}], 12.0) is None


def test_an_order_between_is_found_beside_a_whole_one_that_is_stronger() -> None:
    problem, r, phi = wave(40.0, 2.6, 0.3)
    found = clearest_between(problem, r + 0.4 * np.sin(phi), "phi", [{"phi": phi}], 12.0)
    assert found == pytest.approx(2.6, abs=0.002)


@pytest.mark.parametrize("amplitude", [0.0, 1.0])
def test_what_wanders_in_time_is_no_order_between(amplitude: float) -> None:
    for seed in range(8):
        problem, _, phi = wave(40.0, 1, 0.0)
        rng = np.random.default_rng(seed)
        wander = lfilter([1.0], [1.0, -0.999], rng.normal(size=len(phi)))
        r = 10 * wander / np.std(wander) + rng.normal(size=len(phi)) + amplitude * np.sin(phi)
        assert clearest_between(problem, r, "phi", [{"phi": phi}], 12.0) is None


def test_of_sixty_recordings_of_noise_none_has_an_order_between() -> None:
    problem, _, phi = wave(15.0, 1, 0.0)
    rng = np.random.default_rng(5)
    found = [clearest_between(problem, rng.normal(size=len(phi)), "phi", [{"phi": phi}], 12.0) for _ in range(60)]
    assert not any(found)


def test_a_shaft_that_is_quick_in_short_bursts_keeps_the_order_of_shorter_windows() -> None:
    t = np.arange(0, 48, 1e-3)
    w = np.where(np.mod(t, 10) < 0.6, 300.0, 30.0)
    phi = np.cumsum(w) * 1e-3
    problem, _, _ = wave(1.0, 1, 0.0)
    r = np.random.default_rng(1).normal(size=len(t)) + np.sin(7.4 * phi)
    assert clearest_between(problem, r, "phi", [{"phi": phi}], 12.0) == pytest.approx(7.4, abs=0.02)


@pytest.mark.parametrize(("w", "order"), [(40.0, 3), (6.0, 130), (2.0, 399)])
def test_all_whole_orders_at_once_are_what_each_is_alone(w: float, order: int) -> None:
    problem, r, phi = wave(w, order, 0.3)
    every = range(1, FINEST + 1)
    power, windows = order_spectrum(problem, r, "phi", [{"phi": phi}], every)
    alone, of_one = order_spectrum(problem, r, "phi", [{"phi": phi}], [*every, 0.5])  # one by one
    assert windows.tolist() == of_one[:-1].tolist()
    assert power == pytest.approx(alone[:-1], abs=3e-3 * np.max(alone))
    assert every[int(np.argmax(power))] == order


def test_a_shaft_is_looked_at_up_to_what_its_samples_resolve_and_a_slower_one_at_ordinary_orders() -> None:
    """At 1 kHz: 0.8*pi rad per sample are order 84 at 30 rad/s. What a slower shaft has more often is the quicker's."""
    t = np.arange(0, 16, 1e-3)
    signals = [{"motor.phi": 30 * t, "gear.phi": 3 * t}, {"motor.phi": 30 * t}]
    found = whole_orders(signals, ["motor.phi", "gear.phi"])
    assert found["motor.phi"][-1] == int(0.8 * np.pi * 1000 / 30) == 83
    assert found["gear.phi"] == [float(n) for n in range(1, ORDINARY + 1)]
    assert whole_orders([{"phi": 0.0 * t}], ["phi"])["phi"][-1] == ORDINARY  # it stands
    assert whole_orders([{"phi": 0.1 * t}], ["phi"])["phi"][-1] == FINEST
    assert whole_orders([{}], ["phi"])["phi"][-1] == ORDINARY  # no recording has it


@pytest.mark.parametrize("amplitude", [0.0, 0.05])
def test_a_wave_beside_a_drift_of_a_thousand_times_its_power_is_clear_once_the_drift_is_predicted(
    amplitude: float,
) -> None:
    """Where a shaft turns round, it is as slow as the drift, which then shows at all orders."""
    t = np.arange(0, 48, 1e-3)
    phi, rng = 4 * (1 - np.cos(2 * np.pi * t / 6)) + 0.3 * t, np.random.default_rng(2)
    problem: Any = SimpleNamespace(blocks=[SimpleNamespace(recording=0, rows=slice(0, len(t)))])
    r = np.sin(2 * np.pi * t / 1.3) + 0.01 * rng.normal(size=len(t)) + amplitude * np.sin(84 * phi)
    orders = whole_orders([{"phi": phi}], ["phi"])["phi"]
    plain, white = (
        [orders[k] for k in clear_orders(*order_spectrum(problem, x, "phi", [{"phi": phi}], orders))]
        for x in (r, prewhitened(problem, r))
    )
    assert 84.0 not in plain
    assert white == [84.0] * bool(amplitude)


@pytest.mark.parametrize(
    "residual",
    [np.full(600, 3.0), np.arange(5.0), np.zeros(0)],
    ids=["of one value", "as few rows as a table has", "of none"],
)
def test_of_what_cannot_be_predicted_nothing_is_prewhitened(residual: np.ndarray) -> None:
    problem: Any = SimpleNamespace(blocks=[SimpleNamespace(recording=0, rows=slice(0, len(residual)))])
    assert not prewhitened(problem, residual).any()


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e8])
def test_what_is_predicted_without_error_is_prewhitened_to_numbers(size: float) -> None:
    t = np.arange(5000) * 1e-3
    problem: Any = SimpleNamespace(blocks=[SimpleNamespace(recording=0, rows=slice(0, len(t)))])
    for x in (np.sin(t), np.sin(40 * t), np.exp(-t), t, np.where(t > 2, 1.0, 0.0)):
        assert np.std(prewhitened(problem, size * x)) == pytest.approx(1.0, rel=0.05)
