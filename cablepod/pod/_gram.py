"""Gram matrices of graded rows: factors and singular values right to their own last digits."""

from __future__ import annotations

import math

import numpy as np

from cablepod.pod._decompositions import EPSILON

#: Features up to which the axes are complete: turning costs 2 n^2 a snapshot and the last rotations n^3.
COMPLETE = 512
#: Rows of the scaled Gram matrix must keep this share of themselves beside all larger ones; below, the axes are crooked.
STRAIGHT = 0.03
#: What a block has outside the axes is rounding, if it is no more than so many units of the size of the block.
ROUNDING = 8.0 * EPSILON


def _scaled(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale a Gram matrix to a unit diagonal.

    Rows below the rounding of the largest are scaled by that rounding, and given a unit diagonal too: what stands beside them
    may be larger than they are.  Returns the matrix, the scales, and what was added to the diagonal.
    """
    squares = np.maximum(gram.diagonal(), 0.0)
    scales = np.sqrt(np.maximum(squares, squares.sum() * ROUNDING**2))
    scales[scales == 0.0] = 1.0
    scaled = gram / scales / scales[:, None]
    added = 1.0 - scaled.diagonal()
    np.fill_diagonal(scaled, 1.0)
    return scaled, scales, added


def straight(gram: np.ndarray) -> bool:
    """Tell whether each row of a Gram matrix is mostly outside the span of the larger ones."""
    scaled, scales, _ = _scaled(gram)
    order = np.argsort(-scales)
    try:
        pivots = np.linalg.cholesky(scaled[np.ix_(order, order)]).diagonal()
    except np.linalg.LinAlgError:
        return False
    return bool(pivots.min(initial=1.0) ** 2 >= STRAIGHT)


def graded_factor(gram: np.ndarray) -> np.ndarray:
    """Return R with R^T R = `gram`, its columns right to their own last digits where the axes are straight."""
    scaled, scales, added = _scaled(gram)
    if not gram.any():
        return np.zeros_like(gram)
    order = np.argsort(-scales)
    scaled, added = scaled[np.ix_(order, order)], added[order]
    lower = _leading_factor(scaled)
    sound = len(lower)
    pivots = lower.diagonal() ** 2 - added[:sound]
    beside = np.linalg.solve(lower, scaled[:sound, sound:])
    np.fill_diagonal(lower, np.sqrt(np.maximum(pivots, 0.0)))
    ordered = np.zeros_like(gram)
    ordered[:sound, :sound], ordered[:sound, sound:] = lower.T, beside
    if sound < len(gram):  # what rounding has left of the weakest rows; it stays in their own columns
        rest = scaled[sound:, sound:] - beside.T @ beside - np.diag(added[sound:])
        squares, vectors = np.linalg.eigh(rest)
        ordered[sound:, sound:] = np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T
    factor = np.empty_like(gram)
    factor[:, order] = ordered * scales[order]
    return factor


def _leading_factor(scaled: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor of as many leading rows of a scaled Gram matrix as have a good one."""
    from scipy.linalg import lapack  # costly to import

    lower, failed = lapack.dpotrf(scaled, lower=1)
    while failed > 0:
        lower, failed = lapack.dpotrf(scaled[: failed - 1, : failed - 1], lower=1)
    weak = np.flatnonzero(lower.diagonal() ** 2 < len(scaled) * EPSILON)
    return np.tril(lower[: weak[0], : weak[0]] if weak.size else lower)


def principal(gram: np.ndarray) -> np.ndarray:
    """Return the eigenvectors of a Gram matrix, largest first, by way of its factor, which keeps twice the digits."""
    return np.linalg.svd(graded_factor(gram))[2].T


def graded_svd(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return singular values, largest first, and right singular vectors of a square matrix of graded columns."""
    if not factor.any():
        return np.zeros(len(factor)), np.eye(len(factor))
    if len(factor) > COMPLETE:  # rotations would take minutes, and what was left out is larger than their last digits
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
    """Mend columns that are orthonormal but for rounding: one step of Newton and Schulz, which turns them least."""
    return 1.5 * axes - 0.5 * (axes @ (axes.T @ axes))


def turned_factor(factor: np.ndarray, axes: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the factor in the axes `other` of what `factor` is in `axes`, each column right to its own last digits.

    Columns of `axes` are orthonormal only to rounding, and the vectors they stand for are Y (A^T A)^-1 A^T; to second order
    the inverse is 2 - A^T A.
    """
    if not factor.any():
        return np.zeros((len(factor), other.shape[1]))
    high, low = accurate_product(axes.T, other)
    gram, gram_low = accurate_product(axes.T, axes)
    skew = (gram - np.eye(len(gram))) + gram_low
    product, rest = accurate_product(factor, high)
    return product + (rest + factor @ (low - skew @ high))


def accurate_product(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Multiply in about twice the working precision: the product is the sum of the two matrices returned.

    Both factors are cut into slices of so few bits that the products of slices have no rounding error (Ozaki et al. 2012);
    what is left out lies some 2^-76 below the largest entries of row and column.
    """
    bits = (53 - math.ceil(math.log2(max(2, left.shape[1])))) // 2
    rows, columns = _slices(left, 1, bits), _slices(right, 0, bits)
    high = np.zeros((left.shape[0], right.shape[1]))
    low = np.zeros_like(high)
    for order in range(len(rows)):
        for i in range(order + 1):
            term = rows[i] @ columns[order - i]
            total = high + term  # the sum without error, after Knuth
            part = total - high
            low += (high - (total - part)) + (term - part)
            high = total
    return high, low


def _slices(matrix: np.ndarray, axis: int, bits: int, count: int = 4) -> list[np.ndarray]:
    """Cut entries into `count` slices of `bits` bits below the largest along `axis`; what is left is dropped."""
    size = np.abs(matrix).max(axis=axis, keepdims=True, initial=0.0)
    unit = np.exp2(np.frexp(size)[1].astype(float))
    rest, slices = matrix.astype(float), []
    for _ in range(count):
        unit = unit * 2.0**-bits
        slices.append(np.rint(rest / unit) * unit)
        rest = rest - slices[-1]
    return slices
