"""The bordered banded solver, against a dense one."""

import numpy as np
import pytest

from carigs.fitting.normal_equations import NormalEquations


def random_equations(t: int, q: int, s: int, seed: int = 0) -> tuple[NormalEquations, np.ndarray, np.ndarray]:
    """Positive definite equations, and the same as a dense matrix and gradient."""
    random, n = np.random.default_rng(seed), t * q + s
    rows = np.zeros((t, 3 * q, n))
    for k in range(t):
        rows[k][:, [*range(k * q, (k + 1) * q), *range(t * q, n)]] = random.normal(size=(3 * q, q + s))
    dense = np.einsum("tri,trj->ij", rows, rows) + 0.1 * np.eye(n)
    links = -random.uniform(0, 2, (t - 1, q))
    for k, j in np.ndindex(t - 1, q):
        a, b = k * q + j, (k + 1) * q + j
        dense[[a, b], [b, a]] += links[k, j]
        dense[[a, b], [a, b]] -= links[k, j]
    gradient = random.normal(size=n)
    blocks = np.stack([dense[k * q : (k + 1) * q, k * q : (k + 1) * q] for k in range(t)])
    border = dense[: t * q, t * q :].reshape(t, q, s)
    frames = gradient[: t * q].reshape(t, q)
    return NormalEquations(blocks, links, border, dense[t * q :, t * q :], frames, gradient[t * q :]), dense, gradient


@pytest.mark.parametrize(("t", "q", "s"), [(1, 1, 0), (1, 4, 3), (5, 3, 2), (7, 6, 0), (2, 5, 9)])
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_the_step_is_that_of_the_dense_system(t, q, s, damping):
    equations, dense, gradient = random_equations(t, q, s)
    frames, shape = equations.solve(damping)
    expected = -np.linalg.solve(dense + damping * np.diag(np.diag(dense)), gradient)
    np.testing.assert_allclose(np.concatenate([frames.reshape(-1), shape]), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_the_predicted_fall_is_that_of_the_quadratic_cost(damping):
    equations, dense, gradient = random_equations(5, 3, 2)
    step = equations.solve(damping)
    x = np.concatenate([step[0].reshape(-1), step[1]])
    assert equations.predicted_fall(*step, damping) == pytest.approx(-(gradient @ x + x @ dense @ x / 2))


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_parameters_that_are_held_do_not_move_and_do_not_pull(damping):
    """The others step as in the dense system without rows and columns of those that are held."""
    equations, dense, gradient = random_equations(5, 3, 2)
    held = np.random.default_rng(1).random((5, 3)) < 0.4
    assert (held[1:] != held[:-1]).any() and (held[1:] & held[:-1]).any()
    equations.hold(held)
    frames, shape = equations.solve(damping)
    free = np.flatnonzero(~np.concatenate([held.ravel(), [False, False]]))
    matrix = dense[np.ix_(free, free)]
    expected = np.zeros(len(gradient))
    expected[free] = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient[free])
    np.testing.assert_allclose(np.concatenate([frames.ravel(), shape]), expected, rtol=1e-9, atol=1e-10)


def test_a_matrix_that_is_not_positive_definite_is_an_error():
    equations, *_ = random_equations(3, 4, 2)
    equations.frames[1] *= -1
    with pytest.raises(np.linalg.LinAlgError):
        equations.solve()
