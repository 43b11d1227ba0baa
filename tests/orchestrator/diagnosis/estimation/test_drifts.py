"""A position adds up what is off in a speed, and counts no more than the channels beside it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis import engine
from cobot_joint.diagnosis.estimation.calibrate import drifts, left_of_each
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.findings import Diagnosis

UNITS = {"i": "A", "w": "rad/s", "phi": "rad"}


def problem(**off: float) -> tuple[Any, Any]:
    """Two recordings whose channels are off by so many sigma (rms)."""
    blocks, residual = [], []
    for number in range(2):
        for channel, sigma in off.items():
            rows = slice(100 * len(blocks), 100 * len(blocks) + 100)
            blocks.append(SimpleNamespace(recording=number, channel=channel, rows=rows, weight=np.ones(100)))
            residual.append(np.full(100, sigma))
    recordings = [SimpleNamespace(units=UNITS)] * 2
    noise = {name: Noise(0.1) for name in off}
    found = SimpleNamespace(residual=np.concatenate(residual))
    return SimpleNamespace(blocks=blocks, recordings=recordings, noise=noise), found


@pytest.mark.parametrize(
    ("off", "times"),
    [
        ({"i": 5.0, "w": 20.0, "phi": 500.0}, {"phi": 25.0}),
        ({"i": 0.9, "phi": 30.0}, {"phi": 30.0}),
        ({"i": 5.0, "w": 20.0, "phi": 15.0}, {}),
        ({"i": 500.0, "w": 20.0}, {}),
        ({"phi": 500.0}, {}),
    ],
)
def test_a_position_weighs_no_more_than_the_channel_that_fits_worst_beside_it(
    off: dict[str, float], times: dict[str, float]
) -> None:
    case, fit = problem(**off)
    found = drifts(case, left_of_each(case, fit), ())
    assert {name: noise.sigma / 0.1 for name, noise in found.items()} == pytest.approx(times)


def test_a_noise_that_the_campaign_states_is_believed() -> None:
    case, fit = problem(i=5.0, phi=500.0)
    assert drifts(case, left_of_each(case, fit), {"phi"}) == {}


@pytest.mark.parametrize(("off", "verdict"), [(2.0, "nothing_missing"), (500.0, "undecided")])
def test_a_position_that_drifts_off_visibly_and_has_no_explanation_is_not_called_nothing(
    off: float, verdict: str
) -> None:
    """A link whose gear was 40 % too soft, its angles off by 513 and 38 times their noise, had nothing to be added."""
    case: Any = SimpleNamespace(drifting={"phi": off})
    assert engine.verdict(Diagnosis("nothing_missing", [], {}, {}), engine.drifts_visibly(case)) == verdict
