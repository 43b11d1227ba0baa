"""Filter and smoother against the same Gaussian conditioned all at once."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from cobot_joint.diagnosis.state_estimation.native.kalman import Filtered, Steps, backward, forward, respond

n, m, N = 12, 2, 3


@pytest.fixture
def drawn() -> tuple[Steps, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    steps = Steps(
        np.eye(N) * 0.8 + 0.2 * rng.standard_normal((n, N, N)),
        np.zeros(0),
        rng.standard_normal((n, N)),
        rng.standard_normal((n, m, N)),
        rng.standard_normal((n, m)),
    )
    steps.jump[0] = 0
    steps.r[3, 0] = steps.r[7, :] = np.nan  # one channel lost, and a gap
    return steps, rng.uniform(0.1, 1, N), rng.uniform(0.1, 1, m), rng.standard_normal(N), np.diag(rng.uniform(1, 2, N))


def whole(steps: Steps, Q: np.ndarray, z0: np.ndarray, P0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of all deviations stacked, before anything is recorded."""
    mean, moves = [z0], [np.eye(N, n * N)]
    for k in range(1, n):
        mean.append(steps.F[k] @ (mean[-1] + steps.jump[k]))
        moves.append(steps.F[k] @ moves[-1] + np.eye(N, n * N, k * N))
    T = np.vstack(moves)
    return np.concatenate(mean), T @ block_diag(P0, *[np.diag(Q)] * (n - 1)) @ T.T


def test_smoother_is_the_gaussian_conditioned_on_all_that_was_recorded(drawn: tuple) -> None:
    steps, Q, R, z0, P0 = drawn
    mean, covariance = whole(steps, Q, z0, P0)
    H, known = block_diag(*steps.H), np.isfinite(steps.r.ravel())
    H, r, noise = H[known], steps.r.ravel()[known], np.diag(np.tile(R, n)[known])
    S = H @ covariance @ H.T + noise
    gain = covariance @ H.T @ np.linalg.inv(S)
    filtered = forward(steps, Q, R, z0, P0)
    found = backward(steps, filtered)
    np.testing.assert_allclose(found.smoothed.ravel(), mean + gain @ (r - H @ mean), rtol=1e-8)
    np.testing.assert_allclose(found.variance.ravel(), np.diag(covariance - gain @ H @ covariance), rtol=1e-7)
    constant = -0.5 * known.sum() * np.log(2 * np.pi)
    density = multivariate_normal(H @ mean, S).logpdf(r)
    assert filtered.log_likelihood + constant == pytest.approx(density, rel=1e-10)


def test_adjoint_gives_the_slope_of_the_likelihood_over_a_noise_variance(drawn: tuple) -> None:
    steps, Q, R, z0, P0 = drawn
    found = backward(steps, forward(steps, Q, R, z0, P0))
    for j in range(N):
        h = 1e-5 * np.eye(N)[j]
        ends = [forward(steps, Q + s * h, R, z0, P0).log_likelihood for s in (-1, 1)]
        assert 0.5 * np.sum(found.a[1:, j] ** 2 - found.M[1:, j]) == pytest.approx(np.diff(ends)[0] / 2e-5, rel=1e-5)


def test_a_known_signal_adds_to_the_innovations_what_the_filter_answers(drawn: tuple) -> None:
    steps, Q, R, z0, P0 = drawn
    rng = np.random.default_rng(5)
    psi, direct = rng.standard_normal((n - 1, 2, 1)), rng.standard_normal((n, m, 1))
    filtered = forward(steps, Q, R, z0, P0)
    shift, x = direct[:, :, 0].copy(), np.zeros(N)
    for k in range(1, n):  # what the signal does to the readings
        x = steps.F[k] @ x
        x[:2] += psi[k - 1, :, 0]
        shift[k] += steps.H[k] @ x
    moved = forward(Steps(steps.F, steps.fade, steps.jump, steps.H, steps.r + shift), Q, R, z0, P0)
    beside = np.zeros((n, m, 3))
    respond(steps, filtered, psi, direct, beside[:, :, 1:2])  # among other columns
    np.testing.assert_array_equal(beside[:, :, 1:2], respond(steps, filtered, psi, direct))
    assert not beside[:, :, ::2].any()
    np.testing.assert_allclose(
        respond(steps, filtered, psi, direct)[:, :, 0], moved.white - filtered.white, rtol=1e-9, atol=1e-9
    )


def test_a_filter_in_two_parts_is_the_filter_in_one(drawn: tuple) -> None:
    steps, Q, R, z0, P0 = drawn
    whole = forward(steps, Q, R, z0, P0)
    first = forward(steps[:5], Q, R, z0, P0)
    second = forward(steps[5:], Q, R, first.updated[-1], first.P_end, begins=False)
    np.testing.assert_array_equal(np.vstack([first.updated, second.updated]), whole.updated)


def test_an_innovation_beyond_six_sigma_counts_as_one_of_six(drawn: tuple) -> None:
    steps, Q, R, z0, P0 = drawn
    before = forward(steps, Q, R, z0, P0)
    r = steps.r.copy()
    r[5, 1] += 1e3
    found = forward(Steps(steps.F, steps.fade, steps.jump, steps.H, r), Q, R, z0, P0)
    assert found.white[5, 1] == pytest.approx(6, rel=1e-12)
    np.testing.assert_array_equal(found.updated[:5], before.updated[:5])
    farther = forward(Steps(steps.F, steps.fade, steps.jump, steps.H, r + np.where(r > 500, 1e6, 0)), Q, R, z0, P0)
    move = np.abs(found.updated[5] - before.updated[5]).max()
    assert np.abs(farther.updated[5] - before.updated[5]).max() < 2 * move  # its pull has an end


def test_the_adjoints_covariance_stays_one_over_a_long_run_with_a_state_that_nothing_shows() -> None:
    """What rounding leaves of M that is not symmetric must not grow."""
    count, rng = 20_000, np.random.default_rng(1)
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    F = block_diag(turn, [[1.02, 0.02], [-0.05, 0.97]], [[1.0]])
    F[0, 3] = F[2, 0] = 0.3
    H = np.zeros((2, 5))
    H[0, 0] = H[1, 2] = 1.0
    steps = Steps(np.tile(F, (count, 1, 1)), np.zeros(0), np.zeros((count, 5)), np.tile(H, (count, 1, 1)),
                  rng.standard_normal((count, 2)))  # fmt: skip
    found = backward(steps, forward(steps, np.full(5, 1e-6), np.full(2, 1.0), np.zeros(5), 1e-4 * np.eye(5)))
    half = found.M[count // 2]
    assert (found.M >= 0).all()
    np.testing.assert_allclose(found.M[count // 4], half, rtol=1e-3, atol=1e-9)


def test_deviations_that_fade_by_themselves_are_rows_of_a_diagonal(drawn: tuple) -> None:
    """The same answers as with the whole matrix."""
    dense, Q, R, z0, P0 = drawn
    fade = np.array([0.9, 0.4])
    dense.F[:, 1:] = np.eye(N)[1:] * np.concatenate([[0.0], fade])
    steps = Steps(dense.F[:, :1], fade, dense.jump, dense.H, dense.r)
    expected, found = forward(dense, Q, R, z0, P0), forward(steps, Q, R, z0, P0)
    np.testing.assert_allclose(found.P, expected.P, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.white, expected.white, rtol=1e-12, atol=1e-14)
    for one, other in zip(
        backward(steps, found).__dict__.values(), backward(dense, expected).__dict__.values(), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13)
    psi, direct = np.random.default_rng(5).standard_normal((2, n, m, 3))
    np.testing.assert_allclose(
        respond(steps, found, psi[1:], direct), respond(dense, expected, psi[1:], direct), rtol=1e-12, atol=1e-13
    )


def test_what_is_not_asked_for_changes_nothing_else(drawn: tuple) -> None:
    steps, Q, R, z0, P0 = drawn
    whole, few = forward(steps, Q, R, z0, P0), Filtered.room(steps.H.shape, states=False)
    found = forward(steps, Q, R, z0, P0, room=few)
    assert (found.P, found.predicted, found.log_likelihood) == (None, None, whole.log_likelihood)
    np.testing.assert_array_equal(found.P_end, whole.P_end)
    np.testing.assert_array_equal(backward(steps, found, states=False).M, backward(steps, whole).M)
