"""Compiled loops of the condensed model: quasi-static along the chord, modes for the deflection normal to it.

Coordinates q are mass-orthonormal, and inside a set (in the plane, out of it) orthogonal in their slopes too, so that the tension
acts on each by itself.  Index a counts patterns of load along the cable: its uniform part, with a moving end the inertia that
grows linearly from the lower end to the upper one, each point load.  A row of `rows` is what a step needs to know of the outside:
length of the chord [m]; along the chord, normal to it and (spatial scenes) across both, the size of each pattern.

Sums are free to be reordered (reassoc, nsz), which lets them run in lanes; numbers that are not finite stay so.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LOOSE = {"reassoc", "nsz", "contract"}
#: Newton's method ends when what is left of a correction is below this share of the amplitudes, or of the tension.
CLOSE = 1e-11
MOST = 30
#: The chord is closed where what is left would change H by less than this share.
CLOSED = 1e-10
#: Of fewer links than this the tensions are taken one by one: arrays that run in lanes would cost more than they.
FEW = 6


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _planar_frames(ends, second, load, points, mass, rows):
    """Do what :func:`frames` does, of the same bits, in the plane, where numbers stay in registers: in a quarter of the time."""
    moving = second.shape[1] > 0
    first_point = 3 if moving else 2
    patterns = first_point - 1 + points.shape[0]
    for i in range(rows.shape[0]):
        x, y = ends[0, i] - ends[2, i], ends[1, i] - ends[3, i]  # against the chord
        c = math.sqrt(x * x + y * y)
        inverse = 1.0 / c
        x *= inverse
        y *= inverse
        k = i if load.shape[1] > 1 else 0
        push_x, push_y = load[0, k], load[1, k]
        if moving:
            push_x -= mass * second[0, i]
            push_y -= mass * second[1, i]
            turn_x, turn_y = mass * (second[0, i] - second[2, i]), mass * (second[1, i] - second[3, i])
            rows[i, 2] = turn_x * x + turn_y * y
            rows[i, 2 + patterns] = turn_x * y - turn_y * x
        rows[i, 0] = c
        rows[i, 1] = push_x * x + push_y * y
        rows[i, 1 + patterns] = push_x * y - push_y * x
        k = i if points.shape[2] > 1 else 0
        for j in range(points.shape[0]):
            rows[i, first_point + j] = points[j, 0, k] * x + points[j, 1, k] * y
            rows[i, first_point + patterns + j] = points[j, 0, k] * y - points[j, 1, k] * x


@njit(cache=True, error_model="numpy", nogil=True)
def frames(ends, second, load, points, reference, mass, rows):
    """Fill the rows from positions of the ends.

    Parameters
    ----------
    ends, second
        Positions and second rates of the ends, coordinate by coordinate, the lower end first (2 dims, steps) [m], [m/s^2];
        with damping by mass its rate times the rates of the ends is added to the latter.  `second` has no columns where no
        end moves.
    load, points
        Uniform load with weight (dims, steps or 1) [N/m]; point loads (loads, dims, steps or 1) [N].
    reference
        The axis to which the normal is closest, in spatial scenes.
    mass
        Per unstretched length [kg/m].
    rows
        Filled: (steps, 1 + patterns (1 + normals)).
    """
    dims, loads = load.shape[0], points.shape[0]
    if dims == 2:
        _planar_frames(ends, second, load, points, mass, rows)
        return
    moving = second.shape[1] > 0
    first_point = 3 if moving else 2
    patterns = first_point - 1 + loads
    axes = np.zeros((3, 3))  # against the chord, normal to it, across both
    push, turn = np.zeros(3), np.zeros(3)
    for i in range(rows.shape[0]):
        c = 0.0
        for d in range(dims):
            axes[0, d] = ends[d, i] - ends[dims + d, i]
            c += axes[0, d] * axes[0, d]
        c = math.sqrt(c)
        inverse = 1.0 / c
        for d in range(dims):
            axes[0, d] *= inverse
        part = axes[0, reference]
        inverse = 1.0 / math.sqrt(1.0 - part * part)
        for d in range(3):
            axes[1, d] = ((1.0 if d == reference else 0.0) - part * axes[0, d]) * inverse
        for d in range(3):
            j, k = (d + 1) % 3, (d + 2) % 3
            axes[2, d] = axes[1, j] * axes[0, k] - axes[1, k] * axes[0, j]
        k = i if load.shape[1] > 1 else 0
        for d in range(dims):
            push[d] = load[d, k]
            if moving:
                push[d] -= mass * second[d, i]
                turn[d] = mass * (second[d, i] - second[dims + d, i])
        rows[i, 0] = c
        at = 1
        for side in range(dims):
            along, growing = 0.0, 0.0
            for d in range(dims):
                along += push[d] * axes[side, d]
                growing += turn[d] * axes[side, d]
            rows[i, at] = along
            if moving:
                rows[i, at + 1] = growing
            at += patterns
        k = i if points.shape[2] > 1 else 0
        for j in range(loads):
            for side in range(dims):
                along = 0.0
                for d in range(dims):
                    along += points[j, d, k] * axes[side, d]
                rows[i, first_point + side * patterns + j] = along


# --- leading order ----------------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _straight(rows, at, means, stiffness, length):
    """H of a cable without deflection [N]."""
    h = stiffness * (rows[at, 0] / length - 1.0)
    for a in range(means.size):
        h -= rows[at, 1 + a] * means[a]
    return h


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _tension(q, rows, at, squares, means, stiffness, length):
    """Part H of the chordwise force that is the same all along, from the closure to leading order [N]."""
    grown = 0.0
    for i in range(q.size):
        grown += squares[i] * q[i] * q[i]
    return _straight(rows, at, means, stiffness, length) + 0.5 * stiffness / length * grown


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
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


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _turn(q, h, grips, f):
    """Add to accelerations f what test functions that are not the modes feel of the tension beside `squares`."""
    for i in range(q.size):
        total = 0.0
        for j in range(q.size):
            total += grips[i, j] * q[j]
        f[i] -= h * total


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
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


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
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


@njit(cache=True, error_model="numpy", nogil=True, fastmath=LOOSE)
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


@njit(cache=True, error_model="numpy", nogil=True)
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


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _solve(matrix, x):
    """Solve a small system in place by elimination with pivots; False where it has no solution.

    A stiff cable whose ends come closer is pushed, H < 0, until Newton's method has let it sag: the matrix is then indefinite,
    and Cholesky's method would give up.
    """
    n = x.size
    if n == 2:  # the common case, without loops; what it rounds more Newton's method takes back
        det = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
        if not abs(det) > 0.0:
            return False
        first = (x[0] * matrix[1, 1] - x[1] * matrix[0, 1]) / det
        x[1] = (x[1] * matrix[0, 0] - x[0] * matrix[1, 0]) / det
        x[0] = first
        return True
    for j in range(n):
        best = j
        for i in range(j + 1, n):
            if abs(matrix[i, j]) > abs(matrix[best, j]):
                best = i
        if not abs(matrix[best, j]) > 0.0:
            return False
        if best != j:
            for k in range(j, n):
                matrix[j, k], matrix[best, k] = matrix[best, k], matrix[j, k]
            x[j], x[best] = x[best], x[j]
        for i in range(j + 1, n):
            factor = matrix[i, j] / matrix[j, j]
            for k in range(j + 1, n):
                matrix[i, k] -= factor * matrix[j, k]
            x[i] -= factor * x[j]
    for back in range(n):
        i = n - 1 - back
        for k in range(i + 1, n):
            x[i] -= matrix[i, k] * x[k]
        x[i] /= matrix[i, i]
    return True


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _leading_tangent(q, rows, at, h, squares, bends, stiffness, length, tangent):
    """Fill the derivative of minus the accelerations (r, r)."""
    for i in range(q.size):
        for j in range(q.size):
            total = stiffness / length * squares[i] * q[i] * squares[j] * q[j]
            for a in range(bends.shape[0]):
                total += rows[at, 1 + a] * bends[a, i, j]
            tangent[i, j] = total
        tangent[i, i] += h * squares[i]


@njit(cache=True, error_model="numpy", nogil=True)
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


@njit(cache=True, error_model="numpy", nogil=True)
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


@njit(cache=True, error_model="numpy", nogil=True)
def leading_starts(
    ends, rates, second, load, reference, step, damping, mass, stiffness, length, squares, means, bends, pushes, norms,
    plane, bow, q, v, limit,
):  # fmt: skip
    """Find where many scenes start from: at rest but for the motion of their ends; velocities half a step before.

    Parameters
    ----------
    ends, rates, second
        Ends at the start, their rates, their second rates with those times damping (members, 2 dims, 1); the latter two
        without columns where no end moves.
    load, reference, mass, stiffness, length
        As in :func:`frames` and :func:`leading_verlet`, of each scene: (members, dims, 1), then (members,).
    step, damping
        [s], (members,) [1/s].
    squares, means, bends, pushes, norms, plane
        As in :func:`leading_verlet`, (members, ...) but for `plane`.
    bow
        Coordinates that a load of one across the chord would about give (members, r).
    q, v
        Filled (members, r).
    limit
        Filled: the largest stable step at the start [s]; nan where there is no equilibrium near.
    """
    members, r = q.shape
    patterns, dims = means.shape[1], load.shape[1]
    f, tangent, row = np.empty(r), np.empty((r, r)), np.empty((1, 1 + patterns * dims))
    still, nothing, points = np.zeros(second.shape[1:]), np.zeros((dims, 1)), np.empty((0, dims, 1))
    for m in range(members):
        about = stiffness[m], length[m], squares[m], None, means[m], bends[m], pushes[m]
        frames(ends[m], still, load[m], points, reference[m], mass[m], row)
        for i in range(r):
            q[m, i] = row[0, 1 + patterns * (1 if i < plane else 2)] * bow[m, i]
        if not leading_rest(q[m], row, *about):
            limit[m] = np.nan
            continue
        v[m] = 0.0
        if rates.shape[2]:
            # the particles are at rest, the frame is not: its rates show in the coordinates as its second rates do
            frames(ends[m], rates[m], nothing, points, reference[m], mass[m], row)
            for a in range(pushes.shape[1]):
                for i in range(r):
                    v[m, i] += row[0, 1 + patterns + a] * pushes[m, a, i]
        frames(ends[m], second[m], load[m], points, reference[m], mass[m], row)
        h = leading_force(q[m], row, 0, *about, f, tangent)
        sag, stray = 0.0, 0.0
        for i in range(r):
            sag += (squares[m, i] * q[m, i]) ** 2
        for a in range(patterns):
            stray += abs(row[0, 1 + a]) * norms[m, a]
        limit[m] = 2.0 / math.sqrt(abs(h) * squares[m].max() + stray + stiffness[m] / length[m] * sag)
        grow = math.expm1(0.5 * damping[m] * step)
        back = grow / damping[m] if damping[m] else 0.5 * step
        for i in range(r):
            v[m, i] = v[m, i] * (1.0 + grow) - back * f[i]


@njit(cache=True, error_model="numpy", nogil=True)
def leading_members(
    q, v, step, decay, kick, ends, second, load, reference, mass, stiffness, length, squares, means, bends, pushes, norms,
    knots, slopes, plane, taus, begin, steps, marks, first, last, saved, low, high, watch, series, bound, good,
):  # fmt: skip
    """Run one block of steps of many scenes by :func:`leading_verlet`, each of its own numbers (members, ...).

    Parameters
    ----------
    ends, second, load, reference, mass
        As in :func:`frames`; there may be more than `steps` columns.
    steps
        Number of steps.
    first, last
        Which of `marks`, and rows of `saved` (members, marks, r) and `series` (members, marks, links), are in the block.
    bound, good
        Of the coordinates, where they are sound (members,); whether a scene goes on (members,), changed.

    Other parameters are those of :func:`leading_verlet`; of these `step`, `plane`, `begin` and `marks` are the same for all.
    """
    rows = np.empty((steps, 1 + means.shape[1] * load.shape[1]))
    points, halves = np.empty((0, load.shape[1], 1)), np.empty((last - first, 2, q.shape[1]))
    for m in range(good.size):
        if not good[m]:
            continue
        frames(ends[m], second[m], load[m], points, reference[m], mass[m], rows)
        leading_verlet(
            q[m], v[m], step, decay[m], kick[m], rows, stiffness[m], length[m], squares[m], None, means[m], bends[m],
            pushes[m], norms[m], knots[m], slopes[m], plane, taus[m], begin, marks[first:last], saved[m, first:last], halves,
            low[m], high[m], watch[m], series[m, first:last],
        )  # fmt: skip
        for i in range(q.shape[1]):
            good[m] = good[m] and abs(q[m, i]) < bound[m]


@njit(cache=True, error_model="numpy", nogil=True)
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


# --- exact chordwise stretch ------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy", nogil=True, fastmath=LOOSE, forceinline=True)
def _close(h, chord, stiffness, green, force, z, work):
    """Find H and the chordwise stretch z for which the cable reaches from end to end.

    Parameters
    ----------
    h
        Unstretched lengths or weights of quadrature (m,) [m].
    chord, stiffness, green
        Distance of the ends [m], K [N], whether law (21) holds.
    force, z
        First guess of H [N] and, changed, of z (m,).
    work
        (6, m): chordwise force beside H [N] in row 3, squares of the slopes w' in row 4; on return the chordwise force in row
        0, dz/dN in row 1.

    Returns
    -------
    float
        H, not finite where the search did not end.
    """
    m, soft = z.size, 1.0 / stiffness
    for _ in range(MOST):
        # divisions are what takes the time
        if green:
            for j in range(m):
                n = force + work[3, j]
                give = 1.0 / (3.0 * z[j] * z[j] + work[4, j] - 1.0)
                work[2, j] = (2.0 * n * soft - z[j] * (z[j] * z[j] + work[4, j] - 1.0)) * give
                work[0, j] = n
                work[1, j] = 2.0 * soft * give
                work[5, j] = abs(3.0 * z[j] * give)
        else:
            for j in range(m):
                n = force + work[3, j]
                inverse = 1.0 / math.sqrt(z[j] * z[j] + work[4, j])
                bent = work[4, j] * inverse * inverse * inverse
                give = 1.0 / (1.0 - bent)
                work[2, j] = (n * soft - z[j] * (1.0 - inverse)) * give
                work[0, j] = n
                work[1, j] = soft * give
                work[5, j] = abs(1.5 * z[j] * bent * inverse * inverse * give)
        reach, longer = 0.0, 0.0
        for j in range(m):
            reach += h[j] * (z[j] + work[2, j])
            longer += h[j] * work[1, j]
        change = (chord - reach) / longer
        force += change
        # what the tangents leave out goes with the square of what z changed by: row 5, half the second derivative over the first,
        # and as much again, as the tangents are those of the old z
        left = 0.0
        for j in range(m):
            grown = work[2, j] + work[1, j] * change
            z[j] += grown
            work[0, j] += change
            left += h[j] * work[5, j] * grown * grown
        if 2.0 * left / abs(longer) <= CLOSED * abs(force) + 1e-16 * stiffness:
            return force
        if not abs(change) < np.inf:
            break
    return np.nan


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _carry(stretching, h, inertia, momentum):
    """Fill the product (m,) of links that stretch with the mass that they carry along the chord.

    A link that grows moves all particles above it, less what keeps the chord as it is.
    """
    m = h.size
    if inertia.shape[0] != 2:  # at points of quadrature
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += inertia[j, k] * stretching[k]
            momentum[j] = total
        return
    total = 0.0
    for j in range(m):
        total += h[j] * stretching[j]
        momentum[j] = total
    mean = 0.0
    for j in range(m):
        momentum[j] = inertia[0, j] * (momentum[j] - inertia[1, j] * total)
        mean += inertia[1, j] * momentum[j]
    above = -mean
    for back in range(m):
        j = m - 1 - back
        above += momentum[j]
        momentum[j] = h[j] * above


@njit(cache=True, error_model="numpy", nogil=True, fastmath=LOOSE, forceinline=True)
def exact_force(
    q, v, rows, at, slopes, tests, plane, taus, h, stiffness, green, pushes, inertia, guess, z, work, slope, speed, lever, f,
    tangent, mass,
):  # fmt: skip
    """Accelerations f of the coordinates with the chordwise stretch as it is; H on return, not finite where there is none.

    Parameters
    ----------
    q, v
        Amplitudes and rates (r,); the latter count only with chordwise inertia.
    rows, at
        See :func:`frames`; which of them.
    slopes, plane, taus, h, stiffness, green, pushes
        As in :func:`leading_verlet` and :func:`_close`, at the points of quadrature (m,).
    tests
        Slopes of the test functions (r, m) where they are not the modes; None otherwise.
    inertia
        Masses [kg] of the particles above the links and their relative arc lengths (2, m); at points of quadrature the mass
        matrix of stretching (m, m) [kg m^2]; or without entries: no chordwise inertia.
    guess
        First guess of H [N].
    z, work, slope, speed, lever
        First guess of the chordwise stretch (m,), changed into it; arrays to work in: (6, m); (2, m); (2, m); (2 r, m).
    f, tangent, mass
        Filled: forces (r,); the derivative of minus the forces (r, r), or without entries, close enough for Newton's method;
        the mass matrix (r, r) where there is inertia, else something to work in.
    """
    r, m = slopes.shape
    for j in range(m):
        slope[0, j] = 0.0
        slope[1, j] = 0.0
        work[3, j] = 0.0
    for i in range(r):
        k = 0 if i < plane else 1
        for j in range(m):
            slope[k, j] += slopes[i, j] * q[i]
    for a in range(taus.shape[0]):
        for j in range(m):
            work[3, j] += rows[at, 1 + a] * taus[a, j]
    for j in range(m):
        work[4, j] = slope[0, j] * slope[0, j] + slope[1, j] * slope[1, j]
    force = _close(h, rows[at, 0], stiffness, green, guess, z, work)
    # work[3]: the transverse stiffness N / z, with weights
    for j in range(m):
        work[3, j] = h[j] * work[0, j] / z[j]
    for i in range(r):
        k = 0 if i < plane else 1
        total = 0.0
        if tests is None:
            for j in range(m):
                total += work[3, j] * slopes[i, j] * slope[k, j]
        else:
            for j in range(m):
                total += work[3, j] * tests[i, j] * slope[k, j]
        f[i] = -total
    patterns = taus.shape[0]
    for a in range(pushes.shape[0]):
        g = rows[at, 1 + patterns + a]
        for i in range(r):
            f[i] += g * pushes[a, i]
    if tangent.size:
        give = 0.0
        for j in range(m):
            give += h[j] * work[1, j]
            # the derivative of z by w' at constant N is minus this times w'
            cube = 1.0 if green else math.sqrt(z[j] * z[j] + work[4, j]) ** 3
            speed[1, j] = stiffness * work[1, j] * z[j] / cube
        for i in range(r):
            k = 0 if i < plane else 1
            total = 0.0
            for j in range(m):
                total += h[j] * speed[1, j] * slope[k, j] * slopes[i, j]
            mass[i, i] = total / give  # change of H with this coordinate
        for j in range(m):
            work[3, j] *= 1.0 + speed[1, j] * work[4, j] / z[j]
        for i in range(r):
            if tests is None:
                for j in range(i + 1):
                    total = 0.0
                    if (i < plane) == (j < plane):
                        for k in range(m):
                            total += work[3, k] * slopes[i, k] * slopes[j, k]
                    tangent[i, j] = total + mass[i, i] * mass[j, j] * give
                    tangent[j, i] = tangent[i, j]
            else:
                k, felt = 0 if i < plane else 1, 0.0  # what the test function feels of a change of H
                for j in range(m):
                    felt += h[j] * speed[1, j] * slope[k, j] * tests[i, j]
                for j in range(r):
                    total = 0.0
                    if (i < plane) == (j < plane):
                        for k in range(m):
                            total += work[3, k] * tests[i, k] * slopes[j, k]
                    tangent[i, j] = total + felt * mass[j, j]
    if inertia.size:
        for j in range(m):
            speed[0, j] = 0.0
            speed[1, j] = 0.0
        for i in range(r):
            k = 0 if i < plane else 1
            for j in range(m):
                speed[k, j] += slopes[i, j] * v[i]
                lever[i, j] = -slope[k, j] * slopes[i, j] / z[j]
        for j in range(m):
            rate = (slope[0, j] * speed[0, j] + slope[1, j] * speed[1, j]) / z[j]
            speed[0, j] = -(speed[0, j] * speed[0, j] + speed[1, j] * speed[1, j] + rate * rate) / z[j]
        if tests is None:
            for i in range(r):
                _carry(lever[i], h, inertia, lever[r + i])
        else:
            for i in range(r):
                k = 0 if i < plane else 1
                for j in range(m):
                    work[5, j] = -slope[k, j] * tests[i, j] / z[j]
                _carry(work[5], h, inertia, lever[r + i])
        for i in range(r):
            total = 0.0
            for j in range(m):
                total += lever[r + i, j] * speed[0, j]
            f[i] -= total
            for k in range(i + 1 if tests is None else r):
                total = 0.0
                for j in range(m):
                    total += lever[r + i, j] * lever[k, j]
                mass[i, k] = total
                if tests is None:
                    mass[k, i] = total
            mass[i, i] += 1.0
    return force


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _extremes(z, work, stiffness, green, low, high):
    """Take tensions by the stretch xi into their extremes."""
    for j in range(low.size):
        xi = math.sqrt(z[j] * z[j] + work[4, j])
        size = 0.5 * stiffness * xi * (xi * xi - 1.0) if green else stiffness * (xi - 1.0)
        low[j] = min(low[j], size)
        high[j] = max(high[j], size)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _observe(begin, at, q, rows, force, work, squares, norms, stiffness, length, watch):
    """As :func:`_look`, with the chordwise force where it is least."""
    for j in range(work.shape[1]):
        if work[0, j] < watch[0]:
            watch[0], watch[1] = work[0, j], begin + at
    sag, top, stray = 0.0, 0.0, 0.0
    for j in range(q.size):
        sag += (squares[j] * q[j]) ** 2
        top = max(top, squares[j])
    for a in range(norms.size):
        stray += abs(rows[at, 1 + a]) * norms[a]
    fastest = abs(force) * top + stray + stiffness / length * sag
    if fastest > watch[2]:
        watch[2] = fastest
        if fastest >= watch[3]:
            watch[4] = min(watch[4], begin + at)


@njit(cache=True, error_model="numpy", nogil=True)
def exact_verlet(
    q, v, acc, step, decay, kick, rows, stiffness, length, squares, pushes, norms,
    slopes, tests, plane, taus, h, green, inertia, z, begin, marks, saved, halves, low, high, watch,
):  # fmt: skip
    """Velocity Verlet over the rows with the chordwise stretch as it is; `acc` are the accelerations of the last step.

    `z` (2, m) is the stretch that the next search begins with, carried on from the last two found, and the last one found;
    `watch[6]` the H to begin with and `watch[5]` the last one found.  Chordwise inertia sees the rates carried on from half a
    step before with the last accelerations.  Other parameters as in :func:`leading_verlet` and :func:`exact_force`.
    """
    r, m = slopes.shape
    f, rate, mass, none = np.empty(r), np.empty(r), np.empty((r, r)), np.empty((0, 0))
    work, slope, speed, lever = np.empty((6, m)), np.empty((2, m)), np.empty((2, m)), np.empty((2 * r, m))
    mark, ahead, found = 0, z[0], z[1]
    for i in range(rows.shape[0]):
        for j in range(r):
            rate[j] = v[j] + 0.5 * step * acc[j]
        guess, force = watch[6], np.nan
        for _ in range(2):
            force = exact_force(
                q, rate, rows, i, slopes, tests, plane, taus, h, stiffness, green, pushes, inertia, guess, ahead, work, slope,
                speed, lever, f, none, mass,
            )  # fmt: skip
            if abs(force) < np.inf:
                break
            # carried on too far: once more from what was found last
            guess = watch[5]
            for j in range(m):
                ahead[j] = found[j]
        if inertia.size:
            _solve(mass, f)
        _observe(begin, i, q, rows, force, work, squares, norms, stiffness, length, watch)
        if low.size:
            _extremes(ahead, work, stiffness, green, low, high)
        here = mark < marks.size and marks[mark] == begin + i
        if here:
            for j in range(r):
                saved[mark, j] = q[j]
                halves[mark, 0, j] = v[j]
        for j in range(r):
            new = decay * v[j] + kick * f[j]
            acc[j] = (new - v[j]) / step
            v[j] = new
        if here:
            for j in range(r):
                halves[mark, 1, j] = v[j]
            mark += 1
        for j in range(r):
            q[j] += step * v[j]
        # to the next search from both last ones, of which the start has but one: mostly one sweep does then
        on = 0.0 if begin + i == 0 else 1.0
        watch[5], watch[6] = force, force + on * (force - watch[5])
        for j in range(m):
            this = ahead[j]
            ahead[j] = this + on * (this - found[j])
            found[j] = this


@njit(cache=True, error_model="numpy", nogil=True)
def exact_implicit(
    q, v, acc, step, damping, rows, stiffness, length, squares, pushes, norms,
    slopes, tests, plane, taus, h, green, inertia, z, begin, marks, saved, halves, low, high, watch,
):  # fmt: skip
    """Trapezoidal rule with the chordwise stretch as it is; as :func:`leading_implicit` and :func:`exact_verlet`.

    Searches begin with the last stretch, ``z[0]``, and the last H.
    """
    r, m = slopes.shape
    f, tangent, mass = np.empty(r), np.empty((r, r)), np.empty((r, r))
    work, slope, speed, lever = np.empty((6, m)), np.empty((2, m)), np.empty((2, m)), np.empty((2 * r, m))
    change, start, rate, past, none = np.empty(r), np.empty(r), np.empty(r), acc.copy(), np.empty((0, 0))
    quarter, mark, last, found = 0.25 * step * step, 0, rows.shape[0] - 1, z[0]
    for i in range(rows.shape[0]):
        save = mark < marks.size and marks[mark] == begin + i
        if save:
            for j in range(r):
                saved[mark, j] = q[j]
                halves[mark, 0, j] = v[j] - 0.5 * step * acc[j]
                halves[mark, 1, j] = v[j] + 0.5 * step * acc[j]
            mark += 1
        # once more: of a stiff cable the last correction, however small, is much of the tension
        watch[5] = exact_force(
            q, v, rows, i, slopes, tests, plane, taus, h, stiffness, green, pushes, none, watch[5], found, work, slope,
            speed, lever, f, none, mass,
        )  # fmt: skip
        _observe(begin, i, q, rows, watch[5], work, squares, norms, stiffness, length, watch)
        if low.size:
            _extremes(found, work, stiffness, green, low, high)
        if i == last:
            break
        size = 0.0
        for j in range(r):
            start[j] = q[j]
            q[j] += step * v[j] + quarter * (3.0 * acc[j] - past[j])
            size = max(size, abs(q[j]))
        before, ended = 0.0, False  # of the first correction no gain is known
        for _ in range(MOST):
            for j in range(r):
                rate[j] = 2.0 / step * (q[j] - start[j]) - v[j]
            watch[5] = exact_force(
                q, rate, rows, i + 1, slopes, tests, plane, taus, h, stiffness, green, pushes, inertia, watch[5], found, work,
                slope, speed, lever, f, tangent, mass,
            )  # fmt: skip
            for j in range(r):
                if not inertia.size:
                    for k in range(r):
                        mass[j, k] = 1.0 if j == k else 0.0
                change[j] = quarter * f[j]
            for j in range(r):
                for k in range(r):
                    known = start[k] + step * v[k] + quarter * (acc[k] - damping * rate[k]) - q[k]
                    change[j] += mass[j, k] * known
                    tangent[j, k] = quarter * tangent[j, k] + (1.0 + 0.5 * step * damping) * mass[j, k]
            if not _solve(tangent, change):
                break
            largest = 0.0
            for j in range(r):
                q[j] += change[j]
                largest = max(largest, abs(change[j]))
            # the tangent is a little off: what is left shrinks by the last gain, no faster
            if largest * min(largest / before, 1.0) <= CLOSE * size or largest == 0.0:
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


@njit(cache=True, error_model="numpy", nogil=True)
def close_all(squared, tau, h, chord, stiffness, green, force, z):
    """Close many shapes: (times, m) squares of slopes, chordwise forces, stretches (filled); (times,) chords and H (filled)."""
    work = np.empty((6, h.size))
    guess, last = force[0], 0
    for i in range(chord.size):
        # from one shape to the next; where that is too far for Newton's method, by way of shapes between
        for parts in (1, 16):
            force[i] = guess
            if i:
                for j in range(h.size):
                    z[i, j] = z[last, j]
            for part in range(1, parts + 1):
                share = part / parts
                for j in range(h.size):
                    work[4, j] = (1.0 - share) * squared[last, j] + share * squared[i, j]
                    work[3, j] = (1.0 - share) * tau[last, j] + share * tau[i, j]
                reach = (1.0 - share) * chord[last] + share * chord[i]
                force[i] = _close(h, reach, stiffness, green, force[i], z[i], work)
            if i == 0 or abs(force[i]) < np.inf:
                break
        if abs(force[i]) < np.inf:
            guess, last = force[i], i


@njit(cache=True, error_model="numpy", nogil=True)
def error_growth(
    y, rate, acc, rows, step, damping, stiffness, slopes, plane, taus, h, green, pushes, inertia, first, guess, z, sigma, sizes
):  # fmt: skip
    """Integrate the error that the residual of a richer model drives, by the trapezoidal rule on sampled instants.

    Parameters
    ----------
    y, rate, acc
        Motion of the poorer model in the coordinates of the richer one, at the samples (samples, r).
    step
        Distance of the samples [s].
    first
        Error at the start (r,).
    sigma
        Relative arc length of the particles (n + 1,).
    sizes
        Filled: mean square of the error over the particles (samples,) [m^2], in the deflection and along the chord.

    The other parameters are those of :func:`exact_force` for the richer model.
    """
    r, m = slopes.shape
    f, tangent, mass = np.empty(r), np.empty((r, r)), np.empty((r, r))
    work, slope, speed, lever = np.empty((6, m)), np.empty((2, m)), np.empty((2, m)), np.empty((2 * r, m))
    error, v, a, ahead, moved = first.copy(), np.zeros(r), np.zeros(r), np.empty(r), np.empty((2, m))
    quarter = 0.25 * step * step
    for i in range(y.shape[0]):
        guess = exact_force(
            y[i], rate[i], rows, i, slopes, None, plane, taus, h, stiffness, green, pushes, inertia, guess, z, work, slope,
            speed, lever, f, tangent, mass,
        )  # fmt: skip
        for j in range(r):
            ahead[j] = error[j] if i == 0 else error[j] + step * v[j] + quarter * a[j]
        for j in range(r):
            # the residual, less what the error so far pulls back
            total = f[j]
            for k in range(r):
                known = rate[i, k] if i == 0 else rate[i, k] + v[k] + 0.5 * step * a[k]
                total -= mass[j, k] * (acc[i, k] + damping * known) + tangent[j, k] * ahead[k]
            f[j] = total
        for j in range(r):
            for k in range(r):
                if i:
                    mass[j, k] = (1.0 + 0.5 * step * damping) * mass[j, k] + quarter * tangent[j, k]
        if not _solve(mass, f):
            sizes[i:] = np.inf
            return
        for j in range(r):
            if i:
                error[j] = ahead[j] + quarter * f[j]
                v[j] += 0.5 * step * (a[j] + f[j])
            a[j] = f[j]
        for j in range(m):
            moved[0, j] = 0.0
            moved[1, j] = 0.0
        for k in range(r):
            s = 0 if k < plane else 1
            for j in range(m):
                moved[s, j] += slopes[k, j] * error[k]
        reach = 0.0
        for j in range(m):
            reach -= h[j] * (slope[0, j] * moved[0, j] + slope[1, j] * moved[1, j]) / z[j]
        normal, across, along, total = 0.0, 0.0, 0.0, 0.0
        for j in range(m):
            normal += h[j] * moved[0, j]
            across += h[j] * moved[1, j]
            along -= h[j] * (slope[0, j] * moved[0, j] + slope[1, j] * moved[1, j]) / z[j]
            shift = along - sigma[j + 1] * reach
            total += normal * normal + across * across + shift * shift
        sizes[i] = total / (m + 1)
