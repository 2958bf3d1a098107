"""Newton's method for many small systems side by side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cablepod.condensed._kernels_layout import LeadingTerms

#: Maximum number of iterations for an equilibrium, its tolerance (last correction over the deflection), and a correction over the
#: deflection below which only rounding is left.
EQUILIBRIUM_ITERATIONS, EQUILIBRIUM_RTOL, ROUNDING_RTOL = 60, 1e-9, 1e-14
#: Residuals (systems, n) and their negative derivatives (systems, n, n) for unknowns of some systems, and the numbers of these.
Residuals = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def solve_each(
    start: np.ndarray,
    residuals: Residuals,
    is_found: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    iterations: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Solve systems from `start` (systems, n), each as if it were alone.

    Parameters
    ----------
    start
        First guesses.
    residuals
        See :data:`Residuals`.
    is_found
        Function of corrections, unknowns (some systems, n) and numbers of the systems that tells which need no further iteration.
    iterations
        Maximum number of iterations.

    Returns
    -------
    tuple of numpy.ndarray
        Unknowns (systems, n), and whether they were found (systems,).
    """
    solution, found, part = start.copy(), np.zeros(len(start), dtype=bool), np.arange(len(start))
    for _ in range(iterations):
        residual, tangent = residuals(solution[part], part)
        change = solved(tangent, residual)
        solution[part] += change
        done = is_found(change, solution[part], part)
        found[part[done]] = True
        part = part[~done & np.isfinite(change).all(axis=1)]
        if not part.size:
            break
    return solution, found


def leading_forces(terms: LeadingTerms, rows: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return undamped accelerations (members, r), their negative derivatives (members, r, r) and H (members,) [N].

    To leading order, for coordinates q (members, r) at instants with the boundary data `rows` (members, columns).
    """
    from cablepod.condensed import _kernels_closure as kernel  # numba is imported only to compute

    force, tangent, tension = np.empty_like(q), np.empty((*q.shape, q.shape[1])), np.empty(len(q))
    kernel.leading_forces(terms, rows, q, force, tangent, tension)
    return force, tangent, tension


def equilibria(guesses: np.ndarray, forces: Residuals) -> tuple[np.ndarray, np.ndarray]:
    """Find the equilibria of cables near guesses (cables, n) by Newton's method, each as if it were alone.

    Returns
    -------
    tuple of numpy.ndarray
        Coordinates (cables, n), and whether they are equilibria near the guess (cables,): one further away than the deflection is
        that of the cable turned over.
    """
    scale, last = np.abs(guesses).max(axis=1), np.full(len(guesses), np.inf)

    def is_settled(change: np.ndarray, q: np.ndarray, part: np.ndarray) -> np.ndarray:
        last[part] = np.abs(change).max(axis=1)
        has_left = ~(np.abs(q).max(axis=1) <= 10.0 * scale[part])
        last[part[has_left]] = np.inf
        return has_left | (last[part] <= ROUNDING_RTOL * scale[part])

    q, _ = solve_each(guesses, forces, is_settled, EQUILIBRIUM_ITERATIONS)
    return q, (last <= EQUILIBRIUM_RTOL * scale) & (np.abs(q - guesses).max(axis=1) <= scale)


def solved(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Solve matrices (systems, n, n) for vectors (systems, n); nan where a matrix is singular."""
    try:
        return np.linalg.solve(matrices, vectors[..., None])[..., 0]
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(vectors, np.nan)
        return np.concatenate([solved(*pair) for pair in zip(matrices[:, None], vectors[:, None], strict=True)])
