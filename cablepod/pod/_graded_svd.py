"""Factors and singular values of graded Gram matrices, with high relative accuracy."""

from __future__ import annotations

import math

import numpy as np

from cablepod.pod._svd_methods import EPSILON

#: Maximum number of features n with a complete basis (it costs 2 n^2 per snapshot, and n^3 in the Jacobi rotations).
COMPLETE = 512
#: Minimum squared pivot of the scaled Gram matrix; below this the basis is considered ill-conditioned.
MIN_SQUARED_PIVOT = 0.03
#: Relative tolerance of the residual of a block outside the basis: smaller residuals are rounding errors.
ROUNDING = 8.0 * EPSILON


def _scaled(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a Gram matrix scaled to unit diagonal, the scales and the correction of the diagonal.

    Rows below the rounding error of the largest row are scaled by that error and get a unit diagonal too, because their
    off-diagonal entries may exceed their diagonal.
    """
    squares = np.maximum(gram.diagonal(), 0.0)
    scales = np.sqrt(np.maximum(squares, squares.sum() * ROUNDING**2))
    scales[scales == 0.0] = 1.0
    scaled = gram / scales / scales[:, None]
    added = 1.0 - scaled.diagonal()
    np.fill_diagonal(scaled, 1.0)
    return scaled, scales, added


def is_well_conditioned(gram: np.ndarray) -> bool:
    """Tell whether the scaled Gram matrix is well conditioned (squared Cholesky pivots, largest rows first)."""
    scaled, scales, _ = _scaled(gram)
    order = np.argsort(-scales)
    try:
        pivots = np.linalg.cholesky(scaled[np.ix_(order, order)]).diagonal()
    except np.linalg.LinAlgError:
        return False
    return bool(pivots.min(initial=1.0) ** 2 >= MIN_SQUARED_PIVOT)


def graded_factor(gram: np.ndarray) -> np.ndarray:
    """Return R with R^T R = `gram`; each column has high relative accuracy if `gram` is well conditioned."""
    scaled, scales, added = _scaled(gram)
    if not gram.any():
        return np.zeros_like(gram)
    order = np.argsort(-scales)
    scaled, added = scaled[np.ix_(order, order)], added[order]
    lower = _leading_factor(scaled)
    n_leading = len(lower)
    pivots = lower.diagonal() ** 2 - added[:n_leading]
    coupling = np.linalg.solve(lower, scaled[:n_leading, n_leading:])
    np.fill_diagonal(lower, np.sqrt(np.maximum(pivots, 0.0)))
    ordered = np.zeros_like(gram)
    ordered[:n_leading, :n_leading], ordered[:n_leading, n_leading:] = lower.T, coupling
    if n_leading < len(gram):
        # Schur complement of the weakest rows, dominated by rounding; it affects their columns only
        rest = scaled[n_leading:, n_leading:] - coupling.T @ coupling - np.diag(added[n_leading:])
        squares, vectors = np.linalg.eigh(rest)
        ordered[n_leading:, n_leading:] = np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T
    factor = np.empty_like(gram)
    factor[:, order] = ordered * scales[order]
    return factor


def _leading_factor(scaled: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor of the largest leading block of a scaled Gram matrix with accurate pivots."""
    from scipy.linalg import lapack  # costly to import

    lower, failed = lapack.dpotrf(scaled, lower=1)
    while failed > 0:
        lower, failed = lapack.dpotrf(scaled[: failed - 1, : failed - 1], lower=1)
    weak = np.flatnonzero(lower.diagonal() ** 2 < len(scaled) * EPSILON)
    return np.tril(lower[: weak[0], : weak[0]] if weak.size else lower)


def graded_svd(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return singular values, largest first, and right singular vectors of a square matrix with graded columns."""
    if not factor.any():
        return np.zeros(len(factor)), np.eye(len(factor))
    if len(factor) > COMPLETE:  # Jacobi rotations would take minutes, and the truncation error exceeds their accuracy
        _, values, rows = np.linalg.svd(factor)
        return values, rows.T
    from scipy.linalg import lapack  # costly to import

    # joba "C": relative accuracy for graded columns; no left vectors; jobr "N": nothing is set to zero
    values, _, right, work, _, failed = lapack.dgejsv(factor, joba=0, jobu=3, jobv=0, jobr=0)
    if failed == 0:
        return values * (work[0] / work[1]), right
    _, values, rows = np.linalg.svd(factor)
    return values, rows.T


def orthonormal(axes: np.ndarray) -> np.ndarray:
    """Re-orthonormalise nearly orthonormal columns by one Newton-Schulz step (the smallest correction)."""
    return 1.5 * axes - 0.5 * (axes @ (axes.T @ axes))


def change_basis(factor: np.ndarray, axes: np.ndarray, new_axes: np.ndarray) -> np.ndarray:
    """Transform `factor` from the basis `axes` to `new_axes`; each column keeps its relative accuracy.

    Columns of `axes` = A are orthonormal only to rounding, so that a factor Y represents the rows Y (A^T A)^-1 A^T; to second
    order the inverse is 2 - A^T A.
    """
    if not factor.any():
        return np.zeros((len(factor), new_axes.shape[1]))
    high, low = accurate_product(axes.T, new_axes)
    gram, gram_low = accurate_product(axes.T, axes)
    defect = (gram - np.eye(len(gram))) + gram_low
    product, rest = accurate_product(factor, high)
    return product + (rest + factor @ (low - defect @ high))


def accurate_product(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Multiply in about twice the working precision: the product is the sum of the two matrices returned.

    Both factors are split into slices of so few bits that the products of slices are exact (Ozaki et al. 2012).  The truncation
    error is about 2^-76 of the largest entries of row and column.
    """
    bits = (53 - math.ceil(math.log2(max(2, left.shape[1])))) // 2
    rows, columns = _slices(left, 1, bits), _slices(right, 0, bits)
    high = np.zeros((left.shape[0], right.shape[1]))
    low = np.zeros_like(high)
    for order in range(len(rows)):
        for i in range(order + 1):
            term = rows[i] @ columns[order - i]
            total = high + term  # error-free sum (Knuth)
            part = total - high
            low += (high - (total - part)) + (term - part)
            high = total
    return high, low


def _slices(matrix: np.ndarray, axis: int, bits: int, count: int = 4) -> list[np.ndarray]:
    """Split entries into `count` slices of `bits` bits below the largest along `axis`; drop the remainder."""
    largest = np.abs(matrix).max(axis=axis, keepdims=True, initial=0.0)
    unit = np.exp2(np.frexp(largest)[1].astype(float))
    rest, slices = matrix.astype(float), []
    for _ in range(count):
        unit = unit * 2.0**-bits
        slices.append(np.rint(rest / unit) * unit)
        rest = rest - slices[-1]
    return slices
