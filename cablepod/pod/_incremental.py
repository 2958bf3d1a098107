"""Incremental SVD: singular values and left singular vectors of data read once, in blocks; arrays only.

The Gram matrix is the cheapest sum over blocks, but it squares the data: below 10^-8 of the largest singular value it is noise.
This loss depends on the basis.  In a basis that nearly diagonalises the Gram matrix, each entry has the rounding error of the two
rows that it multiplies, so that every singular value has high relative accuracy (Demmel and Veselic 1992, SIAM J. Matrix Anal.
Appl. 13, 1204: the error is that of the Gram matrix scaled to a unit diagonal, times its condition number).  Blocks are therefore
projected on such a basis (``axes``) before their Gram matrices are summed.  The basis comes from the first block.  It is rotated
when the scaled Gram matrix becomes ill-conditioned.  The sum so far is transformed by a product in twice the working precision
(Ozaki, Ogita, Oishi and Rump 2012, Numer. Algorithms 59, 95), because rounding errors of the largest rows in an ordinary product
would exceed the smallest rows.  At the end, one-sided Jacobi rotations (LAPACK dgejsv) give the singular values of the graded
triangular factor.

The mean is removed in the same pass: each block is centred by the mean of all previous blocks, which leaves a rank-one correction
without cancellation (Chan, Golub and LeVeque 1983, Am. Stat. 37, 242).

Up to ``COMPLETE`` features the basis is complete and nothing is discarded.  Above, the basis starts empty and is extended by
directions whose residual exceeds the rounding error (a hierarchical approximate decomposition, Himpe, Leibner and Rave 2018, SIAM
J. Sci. Comput. 40, A3267, with a local tolerance at rounding level); ``discarded_energy`` sums the energy outside the basis.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cablepod.pod._graded_svd import (
    COMPLETE,
    ROUNDING,
    change_basis,
    graded_factor,
    graded_svd,
    is_well_conditioned,
    orthonormal,
)
from cablepod.pod._svd_methods import EPSILON

#: Maximum dimension of an incomplete basis, and its dimension after truncation.
MAX_AXES, KEPT_AXES = 600, 400
#: Maximum growth of a diagonal entry weight two checks of the condition (the sum only grows, so it bounds the condition).
MAX_GROWTH = 2.0
#: Range of the energy of a block; outside, rows are rescaled so that squares neither underflow nor overflow.
MIN_ENERGY, MAX_ENERGY = 1e-200, 1e200


@dataclass(frozen=True)
class Decomposition:
    """Left singular vectors (features, modes), singular values, and norm of the discarded part."""

    left: np.ndarray
    values: np.ndarray
    discarded: float


class IncrementalSVD:
    """Accumulate the left singular vectors and singular values of rows, block by block.

    Parameters
    ----------
    features
        Length of a row.
    center
        Whether the mean of all rows is subtracted.
    """

    def __init__(self, features: int, *, center: bool = True) -> None:
        self.features = features
        self.center = center
        self.count = 0
        # all sums below are in scaled units, rows times `scale`
        self.discarded_energy = 0.0  # sum of squares outside the basis
        self.scale = 1.0
        self.center_row = np.zeros(features)
        self.axes = np.zeros((features, 0))
        self.gram = np.zeros((0, 0))
        self._checked_diagonal = np.zeros(0)  # of `gram` at the last check of its condition

    @property
    def complete(self) -> bool:
        """Whether the basis spans all features."""
        return self.features <= COMPLETE

    def mean(self) -> np.ndarray:
        """Return the mean of all rows (features), zero without centring."""
        return self.center_row / self.scale

    def prepare(self, rows: np.ndarray) -> None:
        """Choose the basis from a sample of rows without adding them, which avoids later re-orthogonalisation."""
        if self.count or not len(rows):
            return
        energy = float(np.vdot(rows, rows))
        if not MIN_ENERGY < energy < MAX_ENERGY:
            return
        if self.center:
            rows = rows - rows.mean(axis=0)
        if self.complete:
            self._init_axes(rows)
        else:
            self._extend_axes(rows, 0.0)

    def add(self, rows: np.ndarray, *, noise: float = 0.0) -> None:
        """Add `rows` (samples, features), which are overwritten.

        `noise` is the rounding error of an entry, in the units of the rows: the basis is not extended by smaller residuals.

        Raises
        ------
        FloatingPointError
            If rows are not finite.
        """
        if not len(rows):
            return
        self._rescale(rows)
        noise *= self.scale
        first = self.count == 0
        total = self.count + len(rows)
        if self.center:
            if first:
                self.center_row = rows.mean(axis=0)
                # second pass: the rounding error of the mean of many equal rows is not yet small against the other sums
                self.center_row += (rows - self.center_row).mean(axis=0)
            rows -= self.center_row
        ones = np.ones(len(rows))
        if self.complete and not self.axes.size:
            self._init_axes(rows)
        outside = 0.0 if self.complete else self._extend_axes(rows, noise)

        def gram_in(axes: np.ndarray) -> np.ndarray:
            projected = rows @ axes
            gram = projected.T @ projected
            if self.center:
                sums = ones @ projected
                gram -= np.outer(sums, sums / total)
            return gram

        self._add_gram(gram_in)
        self.discarded_energy += outside
        if self.center:
            self.center_row += (ones @ rows) / total
        self.count = total
        self._truncate_axes()

    def merge(self, other: IncrementalSVD) -> None:
        """Add all rows of `other`, which is not changed."""
        if other.count == 0:
            return
        if self.count == 0:
            for name, value in vars(other).items():
                setattr(self, name, value.copy() if isinstance(value, np.ndarray) else value)
            return
        scale = min(self.scale, other.scale)
        self._to_units(scale)
        ratio = scale / other.scale
        total = self.count + other.count
        factor = graded_factor(other.gram) * ratio
        shift = other.center_row * ratio - self.center_row
        weight = self.count * other.count / total
        outside = 0.0
        if not self.complete:
            rows = np.vstack([factor @ other.axes.T, shift * math.sqrt(weight)])
            outside = self._extend_axes(rows, 0.0)

        def gram_in(axes: np.ndarray) -> np.ndarray:
            transformed = change_basis(factor, other.axes, axes)
            projected = shift @ axes
            return transformed.T @ transformed + weight * np.outer(projected, projected)

        self._add_gram(gram_in)
        self.discarded_energy += outside + other.discarded_energy * ratio**2
        if self.center:
            self.center_row = self.center_row + shift * (other.count / total)
        self.count = total
        self._truncate_axes()

    def decompose(self, modes: int | None = None) -> Decomposition:
        """Return the decomposition of all rows with at least `modes` modes, completed by any orthonormal vectors."""
        values, right = graded_svd(graded_factor(self.gram))
        left = self.axes @ right
        wanted = min(self.features, max(modes or 0, 1))
        if left.shape[1] < wanted:
            filled = np.linalg.qr(np.hstack([left, np.eye(self.features)[:, : wanted + left.shape[1]]]))[0]
            left = np.hstack([left, filled[:, left.shape[1] : wanted]])
            values = np.concatenate([values, np.zeros(wanted - values.size)])
        return Decomposition(left, values / self.scale, math.sqrt(self.discarded_energy) / self.scale)

    def _rescale(self, rows: np.ndarray) -> None:
        """Scale `rows` in place; adapt the scale if squares would underflow or overflow."""
        with np.errstate(over="ignore", under="ignore"):
            energy = float(np.vdot(rows, rows)) * self.scale * self.scale
        if not MIN_ENERGY < energy < MAX_ENERGY:
            largest = max(abs(float(rows.max())), abs(float(rows.min())))
            if not math.isfinite(largest):
                raise FloatingPointError("rows are not finite")
            # small rows change the units only while all sums are zero
            small = largest < 1.0 / self.scale
            if largest > 0.0 and not (small and (self.gram.any() or self.center_row.any())):
                self._to_units(2.0 ** -math.frexp(largest)[1])
        if self.scale != 1.0:
            rows *= self.scale

    def _to_units(self, scale: float) -> None:
        """Convert all sums to another scale."""
        with np.errstate(under="ignore"):
            ratio = scale / self.scale
            self.gram = self.gram * ratio * ratio
            self._checked_diagonal = self._checked_diagonal * ratio * ratio
            self.discarded_energy = self.discarded_energy * ratio * ratio
            self.center_row = self.center_row * ratio
        self.scale = scale

    def _init_axes(self, rows: np.ndarray) -> None:
        """Set the complete basis to the eigenvectors of a block's Gram matrix."""
        self.axes = np.linalg.eigh(rows.T @ rows)[1][:, ::-1].copy()
        self.gram = np.zeros((self.features, self.features))
        self._checked_diagonal = np.zeros(self.features)

    def _add_gram(self, gram_in: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add the Gram matrix `gram_in(axes)` of new rows; rotate the basis until the sum is well conditioned."""
        total = self.gram + gram_in(self.axes)
        if not np.isfinite(total.diagonal()).all():
            raise FloatingPointError("rows are not finite")
        if np.any(total.diagonal() > MAX_GROWTH * self._checked_diagonal):
            if not is_well_conditioned(total):
                old_axes, factor = self.axes, graded_factor(self.gram)
                for _ in range(4):  # each rotation resolves directions that were below the rounding of the larger rows
                    principal = np.linalg.svd(graded_factor(total))[2].T  # largest first
                    axes = orthonormal(self.axes @ principal)
                    transformed = change_basis(factor, old_axes, axes)
                    total = transformed.T @ transformed + gram_in(axes)
                    self.axes = axes
                    if is_well_conditioned(total):
                        break
            self._checked_diagonal = total.diagonal().copy()
        self.gram = total

    def _extend_axes(self, rows: np.ndarray, noise: float) -> float:
        """Extend the basis by the residual of `rows` outside it; return the sum of squares that stays outside."""
        floor = float(np.vdot(rows, rows)) * ROUNDING**2 + rows.size * noise**2
        residual = rows
        for _ in range(3):
            residual = rows - (rows @ self.axes) @ self.axes.T
            outside = float(np.vdot(residual, residual))
            if outside <= floor or self.axes.shape[1] == self.features:
                break
            squares, vectors = np.linalg.eigh(residual @ residual.T)
            # directions whose squared residual exceeds their part of the rounding error
            chosen = squares > max(floor / len(rows), squares[-1] * 4.0 * EPSILON)
            new = residual.T @ (vectors[:, chosen] / np.sqrt(squares[chosen]))[:, ::-1]
            new = new[:, : self.features - self.axes.shape[1]]
            for _ in range(2):
                new = np.linalg.qr(new - self.axes @ (self.axes.T @ new))[0]
            padding = (0, new.shape[1])
            self.axes = np.hstack([self.axes, new])
            self.gram = np.pad(self.gram, (padding, padding))
            self._checked_diagonal = np.pad(self._checked_diagonal, padding)
        return outside

    def _truncate_axes(self) -> None:
        """Discard the weakest directions of a basis of more than MAX_AXES."""
        if self.complete or self.axes.shape[1] <= MAX_AXES:
            return
        factor = graded_factor(self.gram)
        values, right = graded_svd(factor)
        axes = orthonormal(self.axes @ right[:, :KEPT_AXES])
        transformed = change_basis(factor, self.axes, axes)
        self.discarded_energy += float(np.sum(values[KEPT_AXES:] ** 2))
        self.axes, self.gram = axes, transformed.T @ transformed
        self._checked_diagonal = self.gram.diagonal().copy()
