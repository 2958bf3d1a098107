"""Three routes from a data matrix (features, samples) to its modes, each as the paper writes it; arrays only.

All give the left singular vectors and the singular values, largest first.  The singular value decomposition loses no digits:
its singular values are right to about 2^-52 of the largest one.  The other two square the matrix first, so what lies below 10^-8
of the largest is noise.  Orthogonal columns are made sure of in all three.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

EPSILON = float(np.finfo(float).eps)


def by_svd(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decompose `data` itself, eq. (30): X = U S V^T."""
    left, values, _ = np.linalg.svd(data, full_matrices=False)
    return left, values


def by_covariance(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Take the eigenvectors of the covariance matrix (features, features), eq. (29): C = X X^T / m."""
    samples = data.shape[1]
    eigenvalues, vectors = np.linalg.eigh(data @ data.T / samples)
    count = min(data.shape)
    return vectors[:, ::-1][:, :count], _roots(samples * eigenvalues[::-1][:count])


def by_snapshots(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Take the eigenvectors of the matrix (samples, samples) of the method of snapshots (Sirovich 1987), G = X^T X / m.

    The modes are X times them.  Those of eigenvalues lost in rounding come out neither of unit norm nor orthogonal; a QR
    factorisation mends that, in the order of the modes, so that the good ones stay as they are.
    """
    from scipy.linalg import eigh  # gives only the pairs that are not zero anyway, and is costly to import

    samples = data.shape[1]
    count = min(data.shape)
    eigenvalues, vectors = eigh(data.T @ data / samples, subset_by_index=(samples - count, samples - 1))
    values = _roots(samples * eigenvalues[::-1])
    raw = data @ vectors[:, ::-1]
    size = np.linalg.norm(raw, axis=0)
    # what vanishes to the last digit has no direction: any one will do, orthogonal to the others
    raw = np.where(size > 0.0, raw / np.where(size > 0.0, size, 1.0), np.eye(*data.shape)[:, :count])
    modes, triangle = np.linalg.qr(raw)
    return modes * np.where(np.diag(triangle) < 0.0, -1.0, 1.0), values


#: name of the route -> function
ROUTES: dict[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "svd": by_svd,
    "covariance": by_covariance,
    "snapshots": by_snapshots,
}
#: name of the route -> what stands in the result; "blocks" is cablepod.pod._incremental
ALGORITHMS = {
    "svd": "singular value decomposition of the data matrix (LAPACK gesdd)",
    "covariance": "eigenvectors of the covariance matrix",
    "snapshots": "method of snapshots",
    "blocks": "one pass in blocks: Gram matrices in nearly principal axes, one-sided Jacobi rotations",
}


def _roots(squares: np.ndarray) -> np.ndarray:
    """Singular values from their squares, of which rounding makes some negative, in falling order."""
    return np.sort(np.sqrt(np.maximum(squares, 0.0)))[::-1]


def uncertainty(values: np.ndarray, shape: tuple[int, int], method: str, *, lost: float = 0.0) -> np.ndarray:
    """Estimate how far the singular values of a matrix of `shape` may be off by rounding and by what was `lost`.

    An eigenvalue of a symmetric matrix, and a singular value, is right to a small multiple of 2^-52 of the largest; the
    multiple grows slowly with the size, as a root, from a few units on.  Where eigenvalues are squares of singular values,
    the error of the square is that of the largest square, so that of a small value is large.  In blocks ("blocks") each value
    is right to its own last digits, but for the rounding of the rows as they are turned, of which the part along a mode
    averages out over the samples.  A part of norm `lost` that was left out raises no square by more than its own.
    """
    largest = values.max(initial=0.0)
    if method == "blocks":
        unit = EPSILON * (8.0 + math.sqrt(shape[0]))
        rounding = unit * (values + 2.0 * largest / math.sqrt(max(shape[1], 1)))
        return rounding + lost * np.divide(lost, np.maximum(values, lost), out=np.zeros_like(values), where=lost > 0.0)
    unit = EPSILON * (8.0 + math.sqrt(max(shape)))
    if method == "svd":
        return np.full(values.shape, unit * largest)
    floor = math.sqrt(unit) * largest
    return unit * largest / np.maximum(values, floor) * largest if largest > 0.0 else np.zeros(values.shape)


def mode_angles(values: np.ndarray, unsure: np.ndarray) -> np.ndarray:
    """Estimate the angle [rad] by which modes may be turned, from singular values (sets, modes), falling, and their errors.

    It is the error over the distance to the nearest other value (Wedin 1972), at most a right angle; rounding of the modes
    themselves adds some units of 2^-52.  The value behind the last one counts as zero.
    """
    below = values - np.pad(values[:, 1:], ((0, 0), (0, 1)))
    above = np.pad(below[:, :-1], ((0, 0), (1, 0)), constant_values=math.inf)
    gap = np.minimum(below, above)
    # two values that may both be off
    angle = np.divide(2.0 * unsure, gap, out=np.full(values.shape, math.inf), where=gap > 0.0)
    return np.minimum(np.arctan(angle) + 8.0 * EPSILON, 0.5 * math.pi)


def memory_needed(features: int, samples: int, method: str) -> float:
    """Return bytes for the matrix that a route forms beside the data, its eigenvectors and workspace."""
    size = {"covariance": features, "snapshots": samples}.get(method, min(features, samples))
    return 8.0 * (3.0 * size**2 + 2.0 * features * samples)
