"""How often a finding of this kind is expected to be right (docs/diagnosis-calibration.md says on what ground)."""

from __future__ import annotations

import math

# of the logarithm of the odds, per feature below
INTERCEPT = 2.94
COEFFICIENTS = (-3.25, -1.17, -0.73)
# Beside a background: decades of 1/(1 - taken) at which odds are even, and logits per decade beyond and short of them.
# Even at three quarters, by hand: of eleven drawn machines what was concealed took 0.8 and more (with an angle lost,
# 0.36), nothing else more than 0.56. Beyond: with five per decade, too, 0.5 to 0.9 was said of findings of which nearly
# all were true (docs/diagnosis-calibration.md counts them). What no list has follows a background more easily.
EVEN_AT, EVEN_AT_UNLISTED = 0.6, 0.746
BEYOND, SHORT = 12.0, 5.0
LEAST_LEFT, MOST = 1e-3, 0.95
BESIDE_MUCH = 0.65  # at most, where what is left stands out: of six such claims on drawn machines four were true
LEFT = 500.0  # chi-square of slow structure from which on something is left
# (from, below), findings, true ones among them: counted on 500 drawn campaigns (docs/diagnosis-calibration.md)
COUNTED = (
    ((0.0, 0.5), 6, 1),
    ((0.5, 0.8), 7, 2),
    ((0.8, 0.9), 7, 5),
    ((0.9, 0.95), 65, 63),
    ((0.95, 0.98), 118, 116),
    ((0.98, 1.01), 0, 0),
)
COUNTED_BESIDE = 430, 406  # claims, true ones: on 741 drawn machines with backgrounds (docs/diagnosis-calibration.md)
# of large effects of which two and more were drawn there
COUNTED_TERMS = frozenset(
    [
        "backlash",
        "brake_fade",
        "brake_hysteresis",
        "cogging",
        "current_offset",
        "dead_time",
        "external_torque",
        "friction_asymmetry",
        "gain",
        "hysteresis",
        "imbalance",
        "load_friction",
        "low_pass",
        "misalignment_ripple",
        "position_friction",
        "presliding",
        "pulley_eccentricity",
        "speed_delay",
        "stiffness_hardening",
        "stribeck",
        "sublinear_viscous",
        "supply_sag",
        "torque_delay",
        "torque_ripple",
        "torque_saturation",
        "transmission_error",
        "viscous_warmup",
        "windage",
    ]
)


def features(gain: float, left: float, unlisted: bool) -> tuple[float, float, float]:
    """What stays unexplained, as such (to an order of magnitude) and beside what the finding explains; no list has it.

    gain: chi-square the finding takes away; left: structure above noise that stays unexplained.
    """
    share = left / max(gain, 1e-9)  # a finding that explains less than what stays unexplained is a patch
    return min(math.log10(1 + left / LEFT), 1.0), math.log10(1 + 10 * share), float(unlisted)


def confidence(gain: float, left: float, unlisted: bool = False) -> float:
    """0..1; arguments as `features` has them."""
    x = features(gain, left, unlisted)
    score = INTERCEPT + sum(b * f for b, f in zip(COEFFICIENTS, x, strict=True))
    return round(1 / (1 + math.exp(-score)), 3)


def beside_background(taken: float, unlisted: bool = False) -> float:
    """0..1, where no model fits to the noise: by the share that the term took of what was above it.

    A background is not a listed term's to take; an effect of three times its size is nine tenths of the whole.
    """
    beyond = math.log10(1 / max(1 - taken, LEAST_LEFT)) - (EVEN_AT_UNLISTED if unlisted else EVEN_AT)
    score = beyond * (BEYOND if beyond > 0 else SHORT)
    return round(min(1 / (1 + math.exp(-score)), MOST), 3)


def counted(given: float) -> tuple[tuple[float, float], int, int]:
    """(confidences from and below, findings, true ones among them) of the count's row for this confidence."""
    return next(row for row in COUNTED if row[0][0] <= given < row[0][1])
