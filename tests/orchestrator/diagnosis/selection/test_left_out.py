"""A later term shows that it is no patch by predicting parts of the recordings that it was not fitted to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.selection.left_out import PARTS, predicts

ROWS = 4000


def fit(columns: np.ndarray, recorded: np.ndarray) -> Any:
    """Of linear columns, free between wide bounds."""
    x = np.linalg.lstsq(columns, recorded, rcond=None)[0]
    wide = SimpleNamespace(lower=-1e9, upper=1e9)
    hypothesis = SimpleNamespace(coordinates=[wide] * columns.shape[1], prior=np.zeros(columns.shape[1]))
    return SimpleNamespace(hypothesis=hypothesis, x=x, jacobian=columns, residual=recorded - columns @ x)


@pytest.mark.parametrize(("acts_in", "does"), [(range(PARTS), True), ((1,), False)], ids=["everywhere", "in one part"])
def test_an_effect_has_to_predict_every_part_of_a_recording(acts_in: range | tuple[int, ...], does: bool) -> None:
    rng = np.random.default_rng(0)
    base, effect, other = rng.normal(size=(3, ROWS))
    part = np.arange(ROWS) * PARTS // ROWS
    recorded = base + np.where(np.isin(part, acts_in), effect, other) + rng.normal(0, 0.1, ROWS)
    block = SimpleNamespace(recording=0, rows=slice(0, ROWS))
    problem: Any = SimpleNamespace(rows=ROWS, blocks=[block])
    without, with_it = fit(base[:, None], recorded), fit(np.column_stack([base, effect]), recorded)
    assert with_it.residual @ with_it.residual < without.residual @ without.residual
    assert predicts(problem, without, with_it) == does
