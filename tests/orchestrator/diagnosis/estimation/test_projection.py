"""What further columns take beside a fit is known without another fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cobot_joint.diagnosis.estimation.projection import Projection


def start(bound: float) -> Any:
    """A fit of one number that may move so far."""
    rng = np.random.default_rng(2)
    column, missing = rng.normal(size=(2, 500))
    coordinate = SimpleNamespace(lower=-bound, upper=bound)
    hypothesis = SimpleNamespace(coordinates=[coordinate], prior=np.zeros(1))
    fit = SimpleNamespace(hypothesis=hypothesis, x=np.zeros(1), jacobian=column[:, None])
    return fit, missing, column


@pytest.mark.parametrize("bound", [10.0, 0.3])
def test_what_columns_take_inside_the_bounds_is_that_of_bounded_least_squares(bound: float) -> None:
    fit, missing, column = start(bound)
    fit.residual = column + 2 * missing
    taken = Projection(fit, [missing]).inside
    x = min(1.0, bound)  # all of the column where the bound allows it
    k = 2 + (1 - x) * (missing @ column) / (missing @ missing)
    if bound > 1:
        x, k = 1.0, 2.0
    left = fit.residual - x * column - k * missing
    assert taken == pytest.approx(fit.residual @ fit.residual - left @ left)


def test_what_a_column_takes_is_no_less_because_the_fit_would_do_as_much_outside_its_bounds() -> None:
    fit, missing, column = start(0.0)
    alike = column + 0.1 * missing
    fit.residual = 2 * column
    gain, (k,) = Projection(fit, [alike]).gain([0])
    alone = (alike @ fit.residual) ** 2 / (alike @ alike)  # the bounded fit takes nothing
    assert gain == pytest.approx(alone)
    assert k == pytest.approx(alike @ fit.residual / (alike @ alike))
    assert Projection(fit, [alike]).gain_beyond_bounds([0])[0] == pytest.approx(0, abs=1e-6 * gain)
