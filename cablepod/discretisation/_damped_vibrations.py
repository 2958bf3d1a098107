"""Small vibrations with dampers: the quadratic eigenvalue problem in the undamped modes."""

from __future__ import annotations

import numpy as np

#: Undamped modes of the basis beyond those for each frequency that is wanted; shapes of each damper beside them.  The error of a
#: root is of the order (omega / omega_M)^(4 SHAPES), omega_M the frequency of the first mode that is left out.
MODES_FOR_EACH, FURTHER_MODES, SHAPES = 3, 10, 8
#: Part of a shape that must be left beside the others, and least Im(lambda) / |lambda| of a vibration: others only decay.
INDEPENDENT, LEAST_SINE = 1e-10, 1e-9


def damped_vibrations(
    omega: np.ndarray, vectors: np.ndarray, dampers: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Compute vibrations of q'' + D D^T q' + K q = 0 by rising |lambda|, with q ~ exp(lambda t) and Im lambda > 0.

    The basis has the lowest undamped modes, and the static shapes of the dampers beside them: inverse K times D, times that, and
    so on.  With the energy as the norm, the first-order form is a skew-symmetric matrix less the damping; rounding is that of the
    highest frequency, not of its square.

    Parameters
    ----------
    omega, vectors
        All undamped angular frequencies (n,) [rad/s] in rising order, and vectors (n, n), orthonormal in columns.
    dampers
        Columns D (n, dampers) [s^-1/2].
    count
        Maximum number of vibrations.

    Returns
    -------
    tuple
        lambda (vibrations,) [1/s] and vectors (n, vibrations), both complex, with a norm of 1.
    """
    from scipy.linalg import eig, eigh  # costly to import

    kept = min(omega.size, MODES_FOR_EACH * count + FURTHER_MODES)
    basis = np.zeros((omega.size, kept))
    basis[:kept] = np.eye(kept)
    of_modes = vectors.T @ dampers
    shapes = _static_shapes(omega[kept:], of_modes[kept:])
    basis = np.hstack([basis, np.vstack([np.zeros((kept, shapes.shape[1])), shapes])])
    squares, turned = eigh(basis.T @ (omega[:, None] ** 2 * basis))
    basis = basis @ turned
    # of the lowest ones the square root of the eigenvalue would have lost digits
    rates = np.sqrt(np.maximum(squares, 0.0))
    rates[:kept] = omega[:kept]
    damping = basis.T @ of_modes
    size = rates.size
    matrix = np.zeros((2 * size, 2 * size))
    matrix[:size, size:] = np.diag(rates)
    matrix[size:, :size] = -np.diag(rates)
    matrix[size:, size:] = -damping @ damping.T
    roots, states = eig(matrix)
    chosen = np.flatnonzero(roots.imag > LEAST_SINE * np.abs(roots))
    chosen = chosen[np.argsort(np.abs(roots[chosen]), kind="stable")][:count]
    velocities = states[size:, chosen]
    found = vectors @ (basis @ velocities)
    return roots[chosen], found / np.linalg.norm(found, axis=0)


def _static_shapes(omega: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Return orthonormal shapes (n, shapes) of the modes `omega` (n,) under forces (n, dampers), by a block Krylov sequence."""
    shapes = np.zeros((omega.size, 0))
    block = forces
    for _ in range(SHAPES):
        if shapes.shape[1] >= omega.size:
            break
        block = block / omega[:, None] ** 2
        added = []
        for column in block.T:
            norm = float(np.linalg.norm(column))
            for _ in range(2):  # once more against rounding
                column = column - shapes @ (shapes.T @ column)
            left = float(np.linalg.norm(column))
            if left > INDEPENDENT * norm:
                added.append(column / left)
                shapes = np.hstack([shapes, added[-1][:, None]])
        if not added:
            break
        block = np.stack(added, axis=1)
    return shapes
