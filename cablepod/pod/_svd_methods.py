"""Three methods for the modes of a data matrix (features, samples), as in the paper; arrays only.

All return orthonormal left singular vectors and the singular values, largest first.  The errors of the singular value
decomposition are about 2^-52 of the largest singular value.  The other two methods square the matrix first, so that singular
values below 10^-8 of the largest are noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

EPSILON = float(np.finfo(float).eps)


def by_svd(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decompose the data by SVD, eq. (30): X = U S V^T."""
    left, values, _ = np.linalg.svd(data, full_matrices=False)
    return left, values


def by_covariance(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decompose by eigenvectors of the covariance matrix, eq. (29): C = X X^T / m (features, features)."""
    samples = data.shape[1]
    eigenvalues, vectors = np.linalg.eigh(data @ data.T / samples)
    count = min(data.shape)
    return vectors[:, ::-1][:, :count], _roots(samples * eigenvalues[::-1][:count])


def by_snapshots(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decompose by the method of snapshots (Sirovich 1987), eigenvectors of G = X^T X / m (samples, samples).

    The modes are the normalised products of X with the eigenvectors.  Modes of eigenvalues at rounding level are not orthogonal;
    a QR factorisation in the order of the modes corrects them and leaves the accurate ones unchanged.
    """
    from scipy.linalg import eigh  # costly to import; computes only the pairs that can differ from zero

    samples = data.shape[1]
    count = min(data.shape)
    eigenvalues, vectors = eigh(data.T @ data / samples, subset_by_index=(samples - count, samples - 1))
    values = _roots(samples * eigenvalues[::-1])
    raw = data @ vectors[:, ::-1]
    norms = np.linalg.norm(raw, axis=0)
    # a zero vector has no direction: replace it by a unit vector, which QR makes orthogonal to the others
    raw = np.where(norms > 0.0, raw / np.where(norms > 0.0, norms, 1.0), np.eye(*data.shape)[:, :count])
    modes, triangle = np.linalg.qr(raw)
    return modes * np.where(np.diag(triangle) < 0.0, -1.0, 1.0), values


#: Method -> function.
ROUTES: dict[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "svd": by_svd,
    "covariance": by_covariance,
    "snapshots": by_snapshots,
}
#: Method -> attribute ``algorithm`` of the result; "blocks" is cablepod.pod._incremental.
ALGORITHMS = {
    "svd": "singular value decomposition of the data matrix (LAPACK gesdd)",
    "covariance": "eigenvectors of the covariance matrix",
    "snapshots": "method of snapshots",
    "blocks": "one pass in blocks: Gram matrices in nearly principal axes, one-sided Jacobi rotations",
}


def _roots(squares: np.ndarray) -> np.ndarray:
    """Return singular values, largest first, from their squares; negative squares (rounding) count as zero."""
    return np.sort(np.sqrt(np.maximum(squares, 0.0)))[::-1]


def uncertainty(values: np.ndarray, shape: tuple[int, int], method: str, *, discarded: float = 0.0) -> np.ndarray:
    """Estimate the errors of singular values by rounding and truncation.

    The error of a singular value, or of an eigenvalue of a symmetric matrix, is a small multiple of 2^-52 of the largest one; the
    multiple grows with the square root of the matrix size.  If eigenvalues are squares of singular values, all squares have the
    error of the largest one, so that small singular values have large errors.  For "blocks" each value has high relative
    accuracy, except for rounding errors of the projected rows, which average out over the samples.  A discarded part changes each
    square by at most its own squared norm.

    Parameters
    ----------
    values
        Singular values (modes), largest first.
    shape
        Features and samples of the data matrix.
    method
        Key of :data:`ALGORITHMS`.
    discarded
        Norm of the part of the data outside the basis.
    """
    largest = values.max(initial=0.0)
    if method == "blocks":
        unit = EPSILON * (8.0 + math.sqrt(shape[0]))
        rounding = unit * (values + 2.0 * largest / math.sqrt(max(shape[1], 1)))
        ratio = np.divide(discarded, np.maximum(values, discarded), out=np.zeros_like(values), where=discarded > 0.0)
        return rounding + discarded * ratio
    unit = EPSILON * (8.0 + math.sqrt(max(shape)))
    if method == "svd":
        return np.full(values.shape, unit * largest)
    floor = math.sqrt(unit) * largest
    return unit * largest / np.maximum(values, floor) * largest if largest > 0.0 else np.zeros(values.shape)


def mode_angles(values: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Estimate the angular errors [rad] of modes from singular values (sets, modes), largest first, and their errors.

    The angle is the error divided by the gap to the nearest other singular value (Wedin 1972), at most a right angle.  Rounding
    of the modes adds some units of 2^-52.  The singular value after the last one counts as zero.
    """
    below = values - np.pad(values[:, 1:], ((0, 0), (0, 1)))
    above = np.pad(below[:, :-1], ((0, 0), (1, 0)), constant_values=math.inf)
    gap = np.minimum(below, above)
    # both values of a gap have errors
    angle = np.divide(2.0 * errors, gap, out=np.full(values.shape, math.inf), where=gap > 0.0)
    return np.minimum(np.arctan(angle) + 8.0 * EPSILON, 0.5 * math.pi)


def memory_needed(features: int, samples: int, method: str) -> float:
    """Return the bytes of the squared matrix, its eigenvectors and the workspace of a method."""
    size = {"covariance": features, "snapshots": samples}.get(method, min(features, samples))
    return 8.0 * (3.0 * size**2 + 2.0 * features * samples)
