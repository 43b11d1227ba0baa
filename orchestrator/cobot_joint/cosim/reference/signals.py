"""Signals over a step as polynomials, as `cosim/master/signals.h` has them in C."""

from __future__ import annotations

from dataclasses import dataclass

Polynomial = tuple[
    float, float, float, float
]  # a0 + a1 s + a2 s^2 + a3 s^3, s: time since the present communication point


@dataclass
class Past:
    """What is known of a signal when a step begins: at the present point, one step before, two steps before."""

    y: float
    dy: float = 0.0
    y_prev: float = 0.0
    dy_prev: float = 0.0
    y_prev2: float = 0.0


def value(p: Polynomial, s: float) -> float:
    return p[0] + s * (p[1] + s * (p[2] + s * p[3]))


def shifted(p: Polynomial, s: float) -> Polynomial:
    return value(p, s), p[1] + s * (2 * p[2] + s * (3 * p[3])), p[2] + s * (3 * p[3]), p[3]


def constant(y: float) -> Polynomial:
    return y, 0.0, 0.0, 0.0


def line(y0: float, y1: float, h: float) -> Polynomial:
    return y0, (y1 - y0) / h, 0.0, 0.0


def hermite(y0: float, dy0: float, y1: float, dy1: float, h: float) -> Polynomial:
    slope = (y1 - y0) / h
    return y0, dy0, (3 * slope - 2 * dy0 - dy1) / h, (dy0 + dy1 - 2 * slope) / (h * h)


def integral(p: Polynomial, q: Polynomial, h: float) -> float:
    """Of p q from 0 to h, by four points of Gauss: exact for cubics."""
    at = 0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263
    weight = 0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693
    mean = 0.0
    for a, w in zip(at, weight, strict=True):
        mean += w * (value(p, a * h) * value(q, a * h))
    return mean * h


def extrapolate_with_slope(p: Past, degree: int, known: int, h_prev: float) -> Polynomial:
    if degree == 0:
        return constant(p.y)
    if degree == 1 or known < 2:
        return p.y, p.dy, 0.0, 0.0
    slope_prev = (p.y - p.y_prev) / h_prev
    if degree == 2:
        return p.y, p.dy, (p.dy - slope_prev) / h_prev, 0.0
    a3 = (p.dy + p.dy_prev - 2 * slope_prev) / (h_prev * h_prev)
    return p.y, p.dy, (2 * p.dy + p.dy_prev - 3 * slope_prev) / h_prev, a3


def extrapolate_values(p: Past, degree: int, known: int, h_prev: float, h_prev2: float) -> Polynomial:
    if degree == 0 or known < 2:
        return constant(p.y)
    slope_prev = (p.y - p.y_prev) / h_prev
    if degree == 1 or known < 3:
        return p.y, slope_prev, 0.0, 0.0
    slope_prev2 = (p.y_prev - p.y_prev2) / h_prev2
    a2 = (slope_prev - slope_prev2) / (h_prev + h_prev2)
    return p.y, slope_prev + a2 * h_prev, a2, 0.0
