"""Compiled forces and steps of the condensed model to leading order."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import CLOSE, MOST
from cablepod.condensed._kernels_dense import _solve

#: Of fewer links than this the tensions are taken one by one: arrays that run in lanes would cost more than they.
FEW = 6


# --- leading order ----------------------------------------------------------------------------------------------------


@compiled(inline="always")
def _straight(rows, at, means, stiffness, length):
    """H of a cable without deflection [N]."""
    h = stiffness * (rows[at, 0] / length - 1.0)
    for a in range(means.size):
        h -= rows[at, 1 + a] * means[a]
    return h


@compiled(inline="always")
def _tension(q, rows, at, squares, means, stiffness, length):
    """Part H of the chordwise force that is the same all along, from the closure to leading order [N]."""
    grown = 0.0
    for i in range(q.size):
        grown += squares[i] * q[i] * q[i]
    return _straight(rows, at, means, stiffness, length) + 0.5 * stiffness / length * grown


@compiled(inline="always")
def _push(q, rows, at, h, squares, bends, pushes, f):
    """Accelerations f of the coordinates for a given H."""
    patterns = bends.shape[0]
    for i in range(q.size):
        f[i] = -h * squares[i] * q[i]
    for a in range(patterns):
        g = rows[at, 1 + a]
        for i in range(q.size):
            total = 0.0
            for j in range(q.size):
                total += bends[a, i, j] * q[j]
            f[i] -= g * total
    for a in range(pushes.shape[0]):
        g = rows[at, 1 + patterns + a]
        for i in range(q.size):
            f[i] += g * pushes[a, i]


@compiled(inline="always")
def _turn(q, h, grips, f):
    """Add to accelerations f what test functions that are not the modes feel of the tension beside `squares`."""
    for i in range(q.size):
        total = 0.0
        for j in range(q.size):
            total += grips[i, j] * q[j]
        f[i] -= h * total


@compiled(inline="always")
def _look(begin, at, q, rows, h, squares, norms, knots, stiffness, length, watch):
    """Keep the least chordwise force with its step, the largest square of a frequency, the first step where it is too large."""
    least = np.inf
    for k in range(knots.shape[1]):
        tau = 0.0
        for a in range(knots.shape[0]):
            tau += rows[at, 1 + a] * knots[a, k]
        least = min(least, tau)
    if h + least < watch[0]:
        watch[0], watch[1] = h + least, begin + at
    sag, top, stray = 0.0, 0.0, 0.0
    for j in range(q.size):
        sag += (squares[j] * q[j]) ** 2
        top = max(top, squares[j])
    for a in range(norms.size):
        stray += abs(rows[at, 1 + a]) * norms[a]
    fastest = abs(h) * top + stray + stiffness / length * sag
    if fastest > watch[2]:
        watch[2] = fastest
        if fastest >= watch[3]:
            watch[4] = min(watch[4], begin + at)


@compiled(inline="always")
def _link_tension(j, q, rows, at, h, slopes, plane, taus):
    """Tension of one link to leading order [N]."""
    x, y, force = 0.0, 0.0, h
    for i in range(plane):
        x += slopes[i, j] * q[i]
    for i in range(plane, q.size):
        y += slopes[i, j] * q[i]
    for a in range(taus.shape[0]):
        force += rows[at, 1 + a] * taus[a, j]
    return force * math.sqrt(1.0 + x * x + y * y)


@compiled(fastmath=REORDERED_FUSED)
def _link_tensions(q, rows, at, h, slopes, plane, taus, work, low, high):
    """Take the tensions of all links, to leading order, into their extremes."""
    links = low.size
    for j in range(links):
        work[0, j] = 0.0
        work[1, j] = 0.0
        work[2, j] = h
    for i in range(q.size):
        k = 0 if i < plane else 1
        for j in range(links):
            work[k, j] += slopes[i, j] * q[i]
    for a in range(taus.shape[0]):
        for j in range(links):
            work[2, j] += rows[at, 1 + a] * taus[a, j]
    for j in range(links):
        size = work[2, j] * math.sqrt(1.0 + work[0, j] * work[0, j] + work[1, j] * work[1, j])
        low[j] = min(low[j], size)
        high[j] = max(high[j], size)


@compiled
def leading_verlet(
    q, v, step, decay, kick, rows, stiffness, length, squares, grips, means, bends, pushes, norms, knots,
    slopes, plane, taus, begin, marks, saved, halves, low, high, watch, series,
):  # fmt: skip
    """Velocity Verlet (velocities at half steps) over the rows, to leading order.

    Parameters
    ----------
    q, v
        Amplitudes and their rates half a step before, (r,); changed.
    step, decay, kick
        Step [s]; what damping leaves of a velocity over a step; what an acceleration adds to it [s].
    rows
        See :func:`frames`; one for each step.
    stiffness, length
        K [N] and L0 [m].
    squares, means, bends, pushes
        Coefficients: (r,), (patterns,), (patterns, r, r), (patterns times normals, r).
    grips
        With test functions that are not the modes: what they feel of the tension beside `squares` (r, r); None without.
    norms, knots
        Norms of `bends` (patterns,); chordwise force of the patterns where it may be least (patterns, knots).
    slopes, plane, taus
        Of the links, for extremes of tension: (r, n), the number of coordinates in the plane, (patterns, n).
    begin, marks, saved, halves
        Number of the first step; steps to save; q there (marks, r) and the rates on both sides (marks, 2, r).
    low, high
        Extremes of the tensions over all steps (n,), or without entries.
    watch
        Least chordwise force and its step; largest square of a frequency, the one that is too large, the first step where
        it was.
    series
        Tensions of the links at the steps to save (marks, n), or without columns.
    """
    f, work = np.empty(q.size), np.empty((3, low.size))
    mark = 0
    for i in range(rows.shape[0]):
        h = _tension(q, rows, i, squares, means, stiffness, length)
        _push(q, rows, i, h, squares, bends, pushes, f)
        if grips is not None:
            _turn(q, h, grips, f)
        _look(begin, i, q, rows, h, squares, norms, knots, stiffness, length, watch)
        if low.size < FEW:
            for j in range(low.size):
                size = _link_tension(j, q, rows, i, h, slopes, plane, taus)
                if size < low[j]:
                    low[j] = size
                if size > high[j]:
                    high[j] = size
        else:
            _link_tensions(q, rows, i, h, slopes, plane, taus, work, low, high)
        here = mark < marks.size and marks[mark] == begin + i
        if here:
            for j in range(q.size):
                saved[mark, j] = q[j]
                halves[mark, 0, j] = v[j]
            for j in range(series.shape[1]):
                series[mark, j] = _link_tension(j, q, rows, i, h, slopes, plane, taus)
        for j in range(q.size):
            v[j] = decay * v[j] + kick * f[j]
        if here:
            for j in range(q.size):
                halves[mark, 1, j] = v[j]
            mark += 1
        for j in range(q.size):
            q[j] += step * v[j]


@compiled(forceinline=True)
def _leading_tangent(q, rows, at, h, squares, bends, stiffness, length, tangent):
    """Fill the derivative of minus the accelerations (r, r)."""
    for i in range(q.size):
        for j in range(q.size):
            total = stiffness / length * squares[i] * q[i] * squares[j] * q[j]
            for a in range(bends.shape[0]):
                total += rows[at, 1 + a] * bends[a, i, j]
            tangent[i, j] = total
        tangent[i, i] += h * squares[i]


@compiled
def leading_force(q, rows, at, stiffness, length, squares, grips, means, bends, pushes, f, tangent):
    """Accelerations, their tangent and H for one state; used to look for equilibria."""
    h = _tension(q, rows, at, squares, means, stiffness, length)
    _push(q, rows, at, h, squares, bends, pushes, f)
    _leading_tangent(q, rows, at, h, squares, bends, stiffness, length, tangent)
    if grips is not None:
        _turn(q, h, grips, f)
        for i in range(q.size):
            total = 0.0
            for j in range(q.size):
                total += grips[i, j] * q[j]
            for j in range(q.size):
                tangent[i, j] += h * grips[i, j] + stiffness / length * total * squares[j] * q[j]
    return h


@compiled
def leading_rest(q, rows, stiffness, length, squares, grips, means, bends, pushes):
    """Change q into the equilibrium near it by Newton's method; False where it fails, or ends at another one."""
    f, tangent, first = np.empty(q.size), np.empty((q.size, q.size)), q.copy()
    size = np.abs(q).max()
    for _ in range(2 * MOST):
        leading_force(q, rows, 0, stiffness, length, squares, grips, means, bends, pushes, f, tangent)
        if not _solve(tangent, f):
            return False
        change, largest = 0.0, 0.0
        for i in range(q.size):
            q[i] += f[i]
            change, largest = max(change, abs(f[i])), max(largest, abs(q[i]))
            if not abs(q[i]) <= 10.0 * size:
                return False
        if change <= 1e-14 * size:
            break
    # what still moves by more than rounding has found none; further off than the deflection is the cable turned over
    return change <= 1e-9 * size and np.abs(q - first).max() <= size


@compiled
def leading_implicit(
    q, v, acc, step, damping, rows, stiffness, length, squares, grips, means, bends, pushes, norms, knots,
    slopes, plane, taus, begin, marks, saved, halves, low, high, watch,
):  # fmt: skip
    """Trapezoidal rule (average acceleration) with Newton's method; `v` and `acc` are those of the first row.

    The state after the run is that of the row after the last but one: the last row is the first of the next block.  Other
    parameters as in :func:`leading_verlet`.

    Returns
    -------
    int
        Steps done, fewer than asked for where Newton's method did not end.
    """
    r, patterns = q.size, means.size
    work, matrices, vectors = np.empty((3, low.size)), np.empty((2, r, r)), np.empty((4, r))
    tangent, bent = matrices
    change, start, fixed, past = vectors
    past[:] = acc
    quarter, mark, last = 0.25 * step * step, 0, rows.shape[0] - 1
    grows, held = 0.5 * stiffness / length, 1.0 + 0.5 * step * damping
    straight = _straight(rows, 0, means, stiffness, length)
    for i in range(rows.shape[0]):
        h = straight
        for j in range(r):
            h += grows * squares[j] * q[j] * q[j]
        _look(begin, i, q, rows, h, squares, norms, knots, stiffness, length, watch)
        if low.size:
            _link_tensions(q, rows, i, h, slopes, plane, taus, work, low, high)
        if mark < marks.size and marks[mark] == begin + i:
            for j in range(r):
                saved[mark, j] = q[j]
                halves[mark, 0, j] = v[j] - 0.5 * step * acc[j]
                halves[mark, 1, j] = v[j] + 0.5 * step * acc[j]
            mark += 1
        if i == last:
            break
        # what does not change with q is taken out of Newton's method
        straight = _straight(rows, i + 1, means, stiffness, length)
        size = 0.0
        for j in range(r):
            start[j] = q[j]
            total = acc[j]
            for a in range(pushes.shape[0]):
                total += rows[i + 1, 1 + patterns + a] * pushes[a, j]
            fixed[j] = held * q[j] + step * (1.0 + 0.25 * step * damping) * v[j] + quarter * total
            for k in range(r):
                total = 0.0
                for a in range(patterns):
                    total += rows[i + 1, 1 + a] * bends[a, j, k]
                bent[j, k] = quarter * total
        for j in range(r):
            q[j] += step * v[j] + quarter * (3.0 * acc[j] - past[j])
            size = max(size, abs(q[j]))
        before, ended = 0.0, False  # of the first correction no gain is known
        for _ in range(MOST):
            h = straight
            for j in range(r):
                h += grows * squares[j] * q[j] * q[j]
            for j in range(r):
                own = held + quarter * h * squares[j]
                left, sag = fixed[j] - own * q[j], 2.0 * quarter * grows * squares[j] * q[j]
                if grips is not None:
                    for k in range(r):
                        left -= quarter * h * grips[j, k] * q[k]
                        sag += 2.0 * quarter * grows * grips[j, k] * q[k]
                for k in range(r):
                    left -= bent[j, k] * q[k]
                    tangent[j, k] = bent[j, k] + sag * squares[k] * q[k]
                    if grips is not None:
                        tangent[j, k] += quarter * h * grips[j, k]
                change[j] = left
                tangent[j, j] += own
            if not _solve(tangent, change):
                break
            # the forces are cubic in q: what the tangent left of them is known, and bounds the next correction of a soft cable;
            # of a stiff one quadratic convergence does, the next is smaller by the square of the last gain
            across, along, left, largest = 0.0, 0.0, 0.0, 0.0
            for j in range(r):
                across += squares[j] * q[j] * change[j]
                along += squares[j] * change[j] * change[j]
                q[j] += change[j]
                largest = max(largest, abs(change[j]))
            for j in range(r):
                total = squares[j] * (across * change[j] + 0.5 * along * q[j])
                if grips is not None:
                    for k in range(r):
                        total += grips[j, k] * (across * change[k] + 0.5 * along * q[k])
                left = max(left, abs(total))
            gain = min(largest / before, 1.0)
            if min(2.0 * quarter * grows * left, largest * gain * gain) <= CLOSE * size:
                ended = True
                break
            before = largest
        if not ended:
            for j in range(r):
                q[j] = start[j]
            return i
        for j in range(r):
            new = 2.0 / step * (q[j] - start[j]) - v[j]
            past[j] = acc[j]
            acc[j] = 2.0 / step * (new - v[j]) - acc[j]
            v[j] = new
    return last
