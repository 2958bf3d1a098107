"""Singular values and left singular vectors of data seen once, in blocks, to the last digits; arrays only.

A Gram matrix is the cheapest sum over blocks, but it squares the data: below 10^-8 of the largest singular value it is noise.
That holds in the axes of the data.  In axes that nearly diagonalise it, each entry is a sum over products of two rows and right
to rounding *of these rows*, so that every singular value is right to its own last digits (Demmel and Veselic 1992, SIAM J. Matrix
Anal. Appl. 13, 1204: the error is that of the Gram matrix scaled to a unit diagonal, times its condition).  So the blocks are
turned into such axes, and there squared and summed.  The axes come from the first block, and are turned anew when a block shows
that they have become crooked; what was summed before is taken along by a product in twice the working precision (Ozaki, Ogita,
Oishi and Rump 2012, Numer. Algorithms 59, 95), because a plain one would write the last digits of the largest rows over the small
ones.  The singular values at the end are those of a graded triangle, by one-sided Jacobi rotations (LAPACK dgejsv).

The mean is taken off in the same pass: each block is centred by the mean of all before it, which leaves one rank-one term to
take off and nothing that cancels (Chan, Golub and LeVeque 1983, Am. Stat. 37, 242).

Up to 512 features (``COMPLETE``) the axes are complete and nothing is left out. Above, they begin empty and are added to as
blocks show directions above their rounding (a hierarchical approximate decomposition, Himpe, Leibner and Rave 2018, SIAM J.
Sci. Comput. 40, A3267, with a local tolerance at rounding); what is left out is summed up in ``lost``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cablepod.pod._decompositions import EPSILON
from cablepod.pod._gram import (
    COMPLETE,
    ROUNDING,
    graded_factor,
    graded_svd,
    orthonormal,
    principal,
    straight,
    turned_factor,
)

#: Axes held at most above that, and how many of them stay when there are more.
MAX_AXES, KEPT_AXES = 600, 400
#: Growth of any diagonal entry until the axes are looked at again; as the sum only grows, the condition does not by more.
GROWTH = 2.0
TINY, HUGE = 1e-200, 1e200  # squares of sizes outside are summed in other units


@dataclass(frozen=True)
class Decomposed:
    """Left singular vectors (features, modes), singular values, the sum of all squares, and the part that was left out."""

    left: np.ndarray
    values: np.ndarray
    energy: float
    lost: float


class IncrementalSVD:
    """Sums that hold the left singular vectors and singular values of all rows added so far.

    Parameters
    ----------
    features
        Length of a row.
    center
        Whether the mean of all rows is taken off.
    """

    def __init__(self, features: int, *, center: bool = True) -> None:
        self.features = features
        self.center = center
        self.count = 0
        self.lost = 0.0  # squares outside the axes, in units of 1 / scale^2 as all that follows
        self.scale = 1.0
        self.center_row = np.zeros(features)
        self.axes = np.zeros((features, 0))
        self.gram = np.zeros((0, 0))
        self._seen = np.zeros(0)  # diagonal when the axes were last looked at

    @property
    def complete(self) -> bool:
        """Whether the axes span everything."""
        return self.features <= COMPLETE

    def mean(self) -> np.ndarray:
        """Return the mean of all rows, zero where it is not taken off."""
        return self.center_row / self.scale

    def prepare(self, rows: np.ndarray) -> None:
        """Find axes from some `rows` that stand for all, without counting them; spares turning the axes later."""
        if self.count or not len(rows):
            return
        energy = float(np.vdot(rows, rows))
        if not TINY < energy < HUGE:
            return
        if self.center:
            rows = rows - rows.mean(axis=0)
        if self.complete:
            self._begin(rows)
        else:
            self._widen(rows, 0.0)

    def add(self, rows: np.ndarray, *, noise: float = 0.0) -> None:
        """Count `rows` (samples, features), which are overwritten.

        `noise` is the rounding error of an entry, in the units of the rows: directions within it are not looked for.

        Raises
        ------
        FloatingPointError
            Where rows are not finite.
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
                # the sum of many equal rows is off by more than its last digit, and nothing is there yet beside which it is small
                self.center_row += (rows - self.center_row).mean(axis=0)
            rows -= self.center_row
        ones = np.ones(len(rows))
        if self.complete and not self.axes.size:
            self._begin(rows)
        outside = 0.0 if self.complete else self._widen(rows, noise)

        def incoming(axes: np.ndarray) -> np.ndarray:
            turned = rows @ axes
            gram = turned.T @ turned
            if self.center:
                sums = ones @ turned
                gram -= np.outer(sums, sums / total)
            return gram

        self._admit(incoming)
        self.lost += outside
        if self.center:
            self.center_row += (ones @ rows) / total
        self.count = total
        self._shorten()

    def merge(self, other: IncrementalSVD) -> None:
        """Count all rows that `other` has counted; it is not changed."""
        if other.count == 0:
            return
        if self.count == 0:
            for name, value in vars(other).items():
                setattr(self, name, value.copy() if isinstance(value, np.ndarray) else value)
            return
        units = min(self.scale, other.scale)
        self._to_units(units)
        ratio = units / other.scale
        total = self.count + other.count
        factor = graded_factor(other.gram) * ratio
        step = other.center_row * ratio - self.center_row
        between = self.count * other.count / total
        outside = 0.0
        if not self.complete:
            rows = np.vstack([factor @ other.axes.T, step * math.sqrt(between)])
            outside = self._widen(rows, 0.0)

        def incoming(axes: np.ndarray) -> np.ndarray:
            moved = turned_factor(factor, other.axes, axes)
            turned = step @ axes
            return moved.T @ moved + between * np.outer(turned, turned)

        self._admit(incoming)
        self.lost += outside + other.lost * ratio**2
        if self.center:
            self.center_row = self.center_row + step * (other.count / total)
        self.count = total
        self._shorten()

    def decomposed(self, modes: int | None = None) -> Decomposed:
        """Return what the sums hold, at least `modes` modes of it; directions without any energy are made up."""
        values, right = graded_svd(graded_factor(self.gram))
        left = self.axes @ right
        wanted = min(self.features, max(modes or 0, 1))
        if left.shape[1] < wanted:
            filled = np.linalg.qr(np.hstack([left, np.eye(self.features)[:, : wanted + left.shape[1]]]))[0]
            left = np.hstack([left, filled[:, left.shape[1] : wanted]])
            values = np.concatenate([values, np.zeros(wanted - values.size)])
        # the squares of sizes near the ends of the range leave it: they are sums in the units of the singular values
        energy = float(values @ values + self.lost) / self.scale**2 if self.scale == 1.0 else math.nan
        values = values / self.scale
        if math.isnan(energy):
            with np.errstate(over="ignore", under="ignore"):
                energy = float(values @ values + self.lost / self.scale / self.scale)
        return Decomposed(left, values, energy, math.sqrt(self.lost) / self.scale)

    def _rescale(self, rows: np.ndarray) -> None:
        """Bring `rows` to the units of the sums, in place, and change these units where squares would leave the range."""
        with np.errstate(over="ignore", under="ignore"):
            energy = float(np.vdot(rows, rows)) * self.scale * self.scale
        if not TINY < energy < HUGE:
            size = max(abs(float(rows.max())), abs(float(rows.min())))
            if not math.isfinite(size):
                raise FloatingPointError("rows are not finite")
            # small rows count in small units only while there is nothing larger
            small = size < 1.0 / self.scale
            if size > 0.0 and not (small and (self.gram.any() or self.center_row.any())):
                self._to_units(2.0 ** -math.frexp(size)[1])
        if self.scale != 1.0:
            rows *= self.scale

    def _to_units(self, scale: float) -> None:
        with np.errstate(under="ignore"):
            ratio = scale / self.scale
            self.gram = self.gram * ratio * ratio
            self._seen = self._seen * ratio * ratio
            self.lost = self.lost * ratio * ratio
            self.center_row = self.center_row * ratio
        self.scale = scale

    def _begin(self, rows: np.ndarray) -> None:
        """Take the eigenvectors of a block's Gram matrix as complete axes."""
        self.axes = np.linalg.eigh(rows.T @ rows)[1][:, ::-1].copy()
        self.gram = np.zeros((self.features, self.features))
        self._seen = np.zeros(self.features)

    def _admit(self, incoming: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add the Gram matrix that `incoming` gives in any axes, in axes that are straight for the sum."""
        total = self.gram + incoming(self.axes)
        if not np.isfinite(total.diagonal()).all():
            raise FloatingPointError("rows are not finite")
        if np.any(total.diagonal() > GROWTH * self._seen):
            if not straight(total):
                before, factor = self.axes, graded_factor(self.gram)
                for _ in range(4):  # each turn finds what the one before could not see beside the larger rows
                    axes = orthonormal(self.axes @ principal(total))
                    moved = turned_factor(factor, before, axes)
                    total = moved.T @ moved + incoming(axes)
                    self.axes = axes
                    if straight(total):
                        break
            self._seen = total.diagonal().copy()
        self.gram = total

    def _widen(self, rows: np.ndarray, noise: float) -> float:
        """Add axes for what `rows` have outside those there are; return the squares that stay outside."""
        floor = float(np.vdot(rows, rows)) * ROUNDING**2 + rows.size * noise**2
        rest = rows
        for _ in range(3):
            rest = rows - (rows @ self.axes) @ self.axes.T
            outside = float(np.vdot(rest, rest))
            if outside <= floor or self.axes.shape[1] == self.features:
                break
            squares, vectors = np.linalg.eigh(rest @ rest.T)
            # each direction above its share of the rounding
            chosen = squares > max(floor / len(rows), squares[-1] * 4.0 * EPSILON)
            new = rest.T @ (vectors[:, chosen] / np.sqrt(squares[chosen]))[:, ::-1]
            new = new[:, : self.features - self.axes.shape[1]]
            for _ in range(2):
                new = np.linalg.qr(new - self.axes @ (self.axes.T @ new))[0]
            grown = (0, new.shape[1])
            self.axes = np.hstack([self.axes, new])
            self.gram = np.pad(self.gram, (grown, grown))
            self._seen = np.pad(self._seen, grown)
        return outside

    def _shorten(self) -> None:
        """Leave the weakest directions out where there are too many axes."""
        if self.complete or self.axes.shape[1] <= MAX_AXES:
            return
        factor = graded_factor(self.gram)
        values, right = graded_svd(factor)
        axes = orthonormal(self.axes @ right[:, :KEPT_AXES])
        moved = turned_factor(factor, self.axes, axes)
        self.lost += float(np.sum(values[KEPT_AXES:] ** 2))
        self.axes, self.gram = axes, moved.T @ moved
        self._seen = self.gram.diagonal().copy()
