"""Floquet multipliers: eigenvalues, the fastest growth of a set, test functions that change sign on the unit circle."""

from __future__ import annotations

import numpy as np

#: Kinds of the fastest growth of one set of coordinates.
STABLE, ABOVE_ONE, BELOW_MINUS_ONE, COMPLEX, FAILED = 0, 1, 2, 3, 4
#: Logarithm of the growth over a period that counts as none, and relative imaginary part of a real multiplier.
NO_GROWTH, REAL = 1e-9, 1e-7


def eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of matrices (..., n, n), nan of those that are not finite."""
    finite = np.isfinite(matrices).all(axis=(-2, -1))
    if finite.all():
        return np.linalg.eigvals(matrices).astype(complex, copy=False)
    result = np.full(matrices.shape[:-1], np.nan + 0j)
    result[finite] = np.linalg.eigvals(matrices[finite])
    return result


def growth_of(multipliers: np.ndarray, duration: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest growth rates of the multipliers of one set (..., n) over a period, and their kinds."""
    size = np.abs(multipliers)
    fastest = size.argmax(axis=-1, keepdims=True)  # nan where one is nan
    largest, mu = (np.take_along_axis(values, fastest, axis=-1)[..., 0] for values in (size, multipliers))
    with np.errstate(divide="ignore"):
        growth = np.log(largest)
    kind = np.where(np.abs(mu.imag) > REAL * largest, COMPLEX, np.where(mu.real > 0.0, ABOVE_ONE, BELOW_MINUS_ONE))
    kind = np.where(growth > NO_GROWTH, kind, STABLE)
    return growth / duration, np.where(np.isnan(growth), FAILED, kind)


def product(factors: np.ndarray) -> float:
    """Return the real part of a product of the factors that are not 0, with large ones turned to size one: no sign changes."""
    return float(np.prod(factors / np.maximum(np.abs(factors), 1.0), where=factors != 0.0).real)


def signed_stability(kind: int, matrix: np.ndarray) -> float:
    """Return a number of the matrix of one set (n, n) that changes sign at an edge of a kind: the product of 1 -+ multipliers."""
    if kind == COMPLEX:
        return float(np.log(np.abs(eigenvalues(matrix)).max()))
    one = np.eye(len(matrix))
    return float(np.linalg.det(one - matrix if kind == ABOVE_ONE else one + matrix))
