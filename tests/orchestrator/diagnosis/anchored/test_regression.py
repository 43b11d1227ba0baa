"""The regression beside a background says what dense linear algebra says, and tells a term from a smooth function."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cobot_joint.diagnosis.anchored.regression import Columns, Products, Regression

Array = NDArray[np.float64]
BLOCKS, ROWS = 4, 400


def sums(a: Array, b: Array) -> Array:
    """Block by block."""
    return np.stack([x.T @ y for x, y in zip(np.split(a, BLOCKS), np.split(b, BLOCKS), strict=True)])


def regression(known: Array, smooth: Array, e: Array, precision: float = 1.0) -> Regression:
    X, k = np.hstack([known, smooth]), known.shape[1]
    columns = Columns(sums(X, X), sums(X, e[:, None])[:, :, 0])
    return Regression(columns, np.full(k, precision), np.zeros(k), [smooth.shape[1]], len(e))


def products(known: Array, smooth: Array, more: Array, e: Array) -> Products:
    X = np.hstack([known, smooth])
    return Products(sums(more, more), sums(X, more), sums(more, e[:, None])[:, :, 0])


def bells(x: Array, count: int = 8) -> Array:
    middles = np.linspace(-1, 1, count)
    return np.exp(-0.5 * ((x[:, None] - middles) / (middles[1] - middles[0])) ** 2)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def drawn(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Two known columns, a background over a variable, and the variable."""
    x = rng.uniform(-1, 1, ROWS)
    return rng.normal(size=(ROWS, 2)), bells(x), x


def test_the_evidence_is_that_of_the_dense_gaussian(rng: np.random.Generator) -> None:
    known, smooth, _ = drawn(rng)
    e = rng.normal(size=ROWS) + known @ [0.3, -0.2] + smooth @ rng.normal(0, 0.3, 8)
    found = regression(known, smooth, e)
    K = np.eye(ROWS) + known @ known.T + found.variances[0] * smooth @ smooth.T
    dense = -0.5 * (e @ np.linalg.solve(K, e) - e @ e) - 0.5 * np.linalg.slogdet(K)[1]
    assert found.evidence == pytest.approx(dense, abs=1e-6)


def test_a_groups_variance_is_the_most_likely_one(rng: np.random.Generator) -> None:
    known, smooth, _ = drawn(rng)
    e = rng.normal(size=ROWS) + smooth @ rng.normal(0, 0.7, 8)
    found = regression(known, smooth, e)

    def evidence(variance: float) -> float:
        K = np.eye(ROWS) + known @ known.T + variance * smooth @ smooth.T
        return float(-0.5 * e @ np.linalg.solve(K, e) - 0.5 * np.linalg.slogdet(K)[1])

    best = float(found.variances[0])
    assert evidence(best) > max(evidence(best * 1.3), evidence(best / 1.3))


def test_a_term_in_a_background_has_its_size_and_evidence(rng: np.random.Generator) -> None:
    known, smooth, _ = drawn(rng)
    wave = np.sin(40 * np.linspace(0, 1, ROWS))[:, None]
    e = rng.normal(size=ROWS) + smooth @ rng.normal(0, 0.5, 8) + 0.8 * wave[:, 0]
    found = regression(known, smooth, e)
    more = products(known, smooth, wave, e)
    added = found.added(more)
    assert added is not None
    assert added.coefficients[0] == pytest.approx(0.8, abs=4 * np.sqrt(added.covariance[0, 0]))
    assert added.evidence > 20
    assert found.gain(more) > 20
    assert (found.predicted(more, added.variances, [[b] for b in range(len(found.columns.gram))]) > 0).all()


def test_what_only_a_background_does_is_no_evidence_for_a_term(rng: np.random.Generator) -> None:
    """A straight line over the variable, where the background waves."""
    known, smooth, x = drawn(rng)
    e = rng.normal(size=ROWS) + smooth @ rng.normal(0, 1.0, 8)
    found = regression(known, smooth, e)
    added = found.added(products(known, smooth, x[:, None], e))
    assert added is None or added.evidence < 3


def test_a_column_that_others_make_up_says_nothing_of_its_own(rng: np.random.Generator) -> None:
    known, smooth, _ = drawn(rng)
    e = rng.normal(size=ROWS)
    found = regression(known, smooth, e, precision=1e-12)
    assert found.added(products(known, smooth, known[:, :1], e)) is None
    assert found.gain(products(known, smooth, known[:, :1], e)) == 0


def test_a_term_in_one_block_only_does_not_predict_the_others(rng: np.random.Generator) -> None:
    known, smooth, _ = drawn(rng)
    wave = np.sin(40 * np.linspace(0, 1, ROWS))[:, None]
    e = rng.normal(size=ROWS)
    e[:100] += 2 * wave[:100, 0]
    found = regression(known, smooth, e)
    more = products(known, smooth, wave, e)
    added = found.added(more)
    assert added is not None
    predicted = found.predicted(more, added.variances, [[b] for b in range(len(found.columns.gram))])
    assert predicted.sum() - predicted.max() < 0


def test_what_is_predicted_of_left_out_parts_is_the_dense_gaussian_given_the_others(rng: np.random.Generator) -> None:
    """Of a known column that only the last blocks show, too, and of a term that the first ones do not."""
    known, smooth, _ = drawn(rng)
    half = ROWS // 2
    known[:half, 1] = 0
    wave = np.sin(40 * np.linspace(0, 1, ROWS))[:, None]
    wave[:half] = 0
    e = rng.normal(size=ROWS) + known @ [0.3, -0.2] + smooth @ rng.normal(0, 0.3, 8) + 0.8 * wave[:, 0]
    found = regression(known, smooth, e)
    more = products(known, smooth, wave, e)
    added = found.added(more)
    assert added is not None
    spread = np.linalg.inv(np.diag(found.precision))
    base = np.eye(ROWS) + known @ spread @ known.T

    def log_density(K: Array, rows: Array) -> float:
        V = K[np.ix_(rows, rows)]
        return float(-0.5 * e[rows] @ np.linalg.solve(V, e[rows]) - 0.5 * np.linalg.slogdet(V)[1])

    def given_the_others(K: Array, part: Array) -> float:
        every = np.arange(ROWS)
        return log_density(K, every) - log_density(K, np.setdiff1d(every, part))

    X = np.hstack([known, smooth])
    own = wave.T @ wave - wave.T @ X @ found.covariance @ X.T @ wave
    with_it = base + added.variances[0] * smooth @ smooth.T + wave @ wave.T * found.readings / own
    without = base + found.variances[0] * smooth @ smooth.T
    halves = [[0, 1], [2, 3]]
    for part, predicted in zip(halves, found.predicted(more, added.variances, halves), strict=True):
        rows = np.concatenate([np.arange(b * ROWS // BLOCKS, (b + 1) * ROWS // BLOCKS) for b in part])
        assert predicted == pytest.approx(given_the_others(with_it, rows) - given_the_others(without, rows), abs=1e-5)


def test_a_parameter_beyond_a_bound_predicts_where_all_parts_press_on_it_and_not_where_one_does(
    rng: np.random.Generator,
) -> None:
    known, smooth, _ = drawn(rng)
    bound, noise = 0.3, rng.normal(size=ROWS)
    everywhere = regression(known, smooth, noise + known @ [0.8, 0.0])
    assert np.all(everywhere.predicted_free(0, bound, [[b] for b in range(len(everywhere.columns.gram))]) > 5)
    once = noise.copy()
    once[: ROWS // BLOCKS] += 3.0 * known[: ROWS // BLOCKS, 0]  # 0.75 on the whole
    lopsided = regression(known, smooth, once)
    assert lopsided.theta[0] > bound
    assert np.sort(lopsided.predicted_free(0, bound, [[b] for b in range(len(lopsided.columns.gram))]))[1:-1].sum() <= 0


def test_a_parameter_beyond_a_bound_predicts_what_the_dense_gaussians_given_the_others_say(
    rng: np.random.Generator,
) -> None:
    """Of a part whose others hardly show the parameter, too: their own estimate of it had to hold there as it was, and
    an inertia that all parts pressed on was refused (machines 193/8, 193/41)."""
    known, smooth, _ = drawn(rng)
    half, bound = ROWS // 2, 0.3
    known[:half, 0] *= 0.2
    e = rng.normal(size=ROWS) + known @ [0.8, -0.2] + smooth @ rng.normal(0, 0.3, 8)
    found = regression(known, smooth, e)
    background = np.eye(ROWS) + found.variances[0] * smooth @ smooth.T
    spread = np.linalg.inv(np.diag(found.precision))

    def given_the_others(columns: Array, left: Array, part: Array) -> float:
        V = background + known[:, columns] @ spread[np.ix_(columns, columns)] @ known[:, columns].T
        others = np.setdiff1d(np.arange(ROWS), part)
        gain = V[np.ix_(part, others)] @ np.linalg.inv(V[np.ix_(others, others)])
        rest, of_it = left[part] - gain @ left[others], V[np.ix_(part, part)] - gain @ V[np.ix_(others, part)]
        return float(-0.5 * rest @ np.linalg.solve(of_it, rest) - 0.5 * np.linalg.slogdet(of_it)[1])

    halves = [[0, 1], [2, 3]]
    for part, predicted in zip(halves, found.predicted_free(0, bound, halves), strict=True):
        rows = np.concatenate([np.arange(b * ROWS // BLOCKS, (b + 1) * ROWS // BLOCKS) for b in part])
        free = given_the_others(np.array([0, 1]), e, rows)
        held = given_the_others(np.array([1]), e - bound * known[:, 0], rows)
        assert predicted == pytest.approx(free - held, abs=1e-3)
        assert predicted != 0


def test_a_wave_over_an_angle_that_rests_says_nothing(rng: np.random.Generator) -> None:
    """Its sine and cosine are one column, and the diagnosis ended in a traceback: "Singular matrix"."""
    known, smooth, x = drawn(rng)
    e = rng.normal(size=ROWS)
    found = regression(known, smooth, e)
    still = products(known, smooth, np.outer(np.sin(3 * x), [np.sin(0.6), np.cos(0.6)]), e)
    assert found.gain(still) == 0.0
    assert found.added(still) is None
    turning = products(known, smooth, np.column_stack([np.sin(3 * x), np.cos(3 * x)]), e)
    assert found.gain(turning) > 0.0
