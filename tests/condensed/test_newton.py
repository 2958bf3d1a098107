"""Newton's method for many systems side by side: each as if it were alone, singular and diverging ones apart."""

from __future__ import annotations

import numpy as np

from cablepod.condensed._newton import equilibria, solve_each, solved


def roots(powers):
    """Residuals 2 - x^n, whose solutions are the n-th roots of 2; those with n = 0 have no derivative."""

    def residuals(x, part):
        n = powers[part, None]
        return 2.0 - x**n, (n * x ** np.maximum(n - 1, 0))[:, :, None]

    return residuals


def is_small(change, x, part):
    return np.abs(change).max(axis=1) <= 1e-15


def test_each_system_is_solved_as_if_it_were_alone():
    powers, start = np.array([1, 2, 3, 0, 5]), np.full((5, 1), 1.5)
    options = is_small, 30
    seen = []
    residuals = roots(powers)
    x, found = solve_each(start, lambda x, part: seen.extend(part) or residuals(x, part), *options)
    assert (seen.count(0), seen.count(3)) == (
        2,
        1,
    )  # one linear step and one that finds nothing to change; no derivative
    assert found.tolist() == [True, True, True, False, True]  # without a derivative there is none
    np.testing.assert_allclose(x[found, 0], 2.0 ** (1.0 / powers[found]), rtol=1e-15)
    alone = [solve_each(start[k : k + 1], roots(powers[k : k + 1]), *options)[0][0] for k in np.flatnonzero(found)]
    np.testing.assert_array_equal(x[found], alone)


def test_singular_matrices_leave_the_others_as_they_are():
    matrices = np.array([np.eye(2), np.ones((2, 2)), [[0.0, 2.0], [4.0, 0.0]]])
    result = solved(matrices, np.ones((3, 2)))
    assert np.isnan(result[1]).all()
    np.testing.assert_array_equal(result[[0, 2]], [[1.0, 1.0], [0.25, 0.5]])


def test_an_equilibrium_further_away_than_the_deflection_is_none():
    target = np.array([[1.1], [-1.5], [20.0]])  # near, turned over, beyond ten times the guess

    def forces(q, part):
        return target[part] - q, np.ones((len(q), 1, 1))

    q, found = equilibria(np.ones((3, 1)), forces)
    assert found.tolist() == [True, False, False]
    assert q[0] == 1.1
