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

Up to :data:`COMPLETE` features the axes are complete and nothing is left out.  Above, they begin empty and are added to as blocks
show directions above their rounding (a hierarchical approximate decomposition, Himpe, Leibner and Rave 2018, SIAM J. Sci. Comput.
40, A3267, with a local tolerance at rounding); what is left out is summed up in ``lost``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cablepod.pod._decompositions import EPSILON

#: Features up to which the axes are complete: turning costs 2 n^2 a snapshot and the last rotations n^3.
COMPLETE = 512
#: Axes held at most above that, and how many of them stay when there are more.
MOST, KEPT = 600, 400
#: Rows of the scaled Gram matrix must keep this share of themselves beside all larger ones; below, the axes are crooked.
STRAIGHT = 0.03
#: Growth of any diagonal entry until the axes are looked at again; as the sum only grows, the condition does not by more.
GROWTH = 2.0
#: What a block has outside the axes is rounding, if it is no more than so many units of the size of the block.
ROUNDING = 8.0 * EPSILON
TINY, HUGE = 1e-200, 1e200  # squares of sizes outside are summed in other units


@dataclass(frozen=True)
class Decomposed:
    """Left singular vectors (features, modes), singular values, the sum of all squares, and the part that was left out."""

    left: np.ndarray
    values: np.ndarray
    energy: float
    lost: float


class Accumulator:
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

    def merge(self, other: Accumulator) -> None:
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
        if self.complete or self.axes.shape[1] <= MOST:
            return
        factor = graded_factor(self.gram)
        values, right = graded_svd(factor)
        axes = orthonormal(self.axes @ right[:, :KEPT])
        moved = turned_factor(factor, self.axes, axes)
        self.lost += float(np.sum(values[KEPT:] ** 2))
        self.axes, self.gram = axes, moved.T @ moved
        self._seen = self.gram.diagonal().copy()


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
