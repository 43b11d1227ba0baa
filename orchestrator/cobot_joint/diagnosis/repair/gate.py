"""Prediction is the judge: a repair that predicts no better than the system without it is withheld.

Held-out runs decide where there are some; fitted runs only say that a repair which does not even fit them is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from cobot_joint.diagnosis import thresholds
from cobot_joint.results.diagnosed import VARIANTS

NOTICED = 1.1  # times what a channel erred by, from which on more is said

Channels = Mapping[str, Mapping[str, Any]]  # as diagnosis.json has them


def above_noise(channels: Channels, role: str, free: bool = False) -> dict[str, float] | None:
    """Variant -> squared error above noise, in units of it, over all channels; None: no such runs.

    Of anchored predictions (`predicted`), where every channel has these: a free run loses angles, whatever the model.
    free: of free runs all the same.
    """
    there = [(c["noise"], c[role]) for c in channels.values() if role in c]
    if not free and horizon(channels, role):
        there = [(noise, figures["predicted"]) for noise, figures in there]
    there = [(noise, figures) for noise, figures in there if any(figures[v] is not None for v in VARIANTS)]
    if not there:
        return None
    return {v: sum(_squared(figures, v, noise) for noise, figures in there) for v in VARIANTS}


def horizon(channels: Channels, role: str) -> float | None:
    """s, over which every channel is predicted in these runs; None: free runs are all there is."""
    predicted = [c[role].get("predicted") for c in channels.values() if role in c]
    return float(predicted[0]["horizon"]) if predicted and all(predicted) else None


def _squared(figures: Mapping[str, float | None], variant: str, noise: float | None) -> float:
    """Above noise, in units of it; where that is not known, in units of what the best variant errs by. Infinite: the
    variant could not be simulated, or not to the end."""
    error = figures[variant]
    if error is None or not math.isfinite(error):
        return math.inf
    if noise is None or not (noise > 0 and math.isfinite(noise)):
        least = min(x for v in VARIANTS if (x := figures[v]) is not None and math.isfinite(x))
        return (error / least) ** 2 if least > 0 else error
    return max(0.0, (error / noise) ** 2 - 1)


def judged(channels: Channels) -> Literal["offered", "withheld"]:
    """Whether the repair predicts no worse than nominal and calibrated, and fits better than calibrated."""
    return "withheld" if fails(channels) else "offered"


def fails(channels: Channels) -> Literal["holdout", "train"] | None:
    """The runs in which the repair is worse, or no better; None: in neither."""
    roles: dict[Literal["holdout", "train"], tuple[str, ...]]
    roles = {"train": ("calibrated",), "holdout": ("nominal", "calibrated")}  # what does not fit, does not predict
    for role, others in roles.items():
        error, free = above_noise(channels, role), above_noise(channels, role, free=True)
        if not error:
            continue
        before = min(error[v] for v in others)
        if math.isinf(error["repaired"]):
            return role
        if error["repaired"] > thresholds.NO_WORSE * before + thresholds.NEGLIGIBLE:
            return role
        if before > thresholds.NEGLIGIBLE:
            left = error["repaired"] / before
            if left > 1 / thresholds.NO_WORSE or (role == "holdout" and free and left * _left(free, others) > 1):
                return role
    return None


def _left(error: Mapping[str, float], others: Sequence[str]) -> float:
    """Of what free runs err by, the share that the repair leaves: more than 1 is for predictions to make up for."""
    before = min(error[v] for v in others)
    return error["repaired"] / before if before > thresholds.NEGLIGIBLE else 1.0


def beyond_doubt(channels: Channels) -> bool:
    """Whether free runs speak for the repair, and leave so little of the error of held-out runs that predictions from
    short distances need not be asked, or nothing is held out."""
    if judged(channels) == "withheld":
        return False
    share = removed(channels)
    return above_noise(channels, "holdout") is None or (share is not None and share[0] > thresholds.HOLDS)


def predicts_worse(channels: Channels) -> bool:
    """Whether predictions of held-out runs from short distances err by more with the repair than without."""
    error = above_noise(channels, "holdout") if horizon(channels, "holdout") else None
    if error is None:
        return False
    before = min(error["nominal"], error["calibrated"])
    return not error["repaired"] <= thresholds.NO_WORSE * before + thresholds.NEGLIGIBLE


def removed(channels: Channels) -> tuple[float, str] | None:
    """(share of the error above noise that the repair removes, in which runs); None: there was nothing, or none was.

    Of the better of nominal and calibrated.
    """
    for role in ("holdout", "train"):
        error = above_noise(channels, role)
        if error is None:
            continue
        before = min(error["nominal"], error["calibrated"])
        if math.isinf(before):
            return None
        if before > thresholds.NEGLIGIBLE:
            share = 1 - error["repaired"] / before
            return (share, role) if share > 0 else None
    return None


def worsened(channels: Channels, role: str) -> list[tuple[str, float]]:
    """Channels that the repaired system misses by more than the better of nominal and calibrated, and how many times as
    much: what it removes of the error is of all channels together."""
    predicted, found = horizon(channels, role), []
    for name, c in channels.items():
        figures = (c[role]["predicted"] if predicted else c[role]) if role in c else None
        if figures is None or any(figures[v] is None or not math.isfinite(figures[v]) for v in VARIANTS):
            continue
        before, noise = min(figures["nominal"], figures["calibrated"]), c["noise"] or 0.0
        if before > 0 and figures["repaired"] > NOTICED * max(before, noise):
            found.append((name, figures["repaired"] / before))
    return found


def calibration_misleads(channels: Channels) -> bool:
    """Whether the re-fitted base model predicts held-out runs worse than the system as specified."""
    error = above_noise(channels, "holdout")
    if error is None:
        return False
    return error["calibrated"] > thresholds.NO_WORSE * error["nominal"] + thresholds.NEGLIGIBLE
