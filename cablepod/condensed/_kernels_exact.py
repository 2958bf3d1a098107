"""Compiled forces and steps of the condensed model with the exact chordwise stretch."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import CLOSE, MOST, _carry, _close
from cablepod.condensed._kernels_dense import _solve


@compiled(fastmath=REORDERED_FUSED, forceinline=True)
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


@compiled(inline="always")
def _extremes(z, work, stiffness, green, low, high):
    """Take tensions by the stretch xi into their extremes."""
    for j in range(low.size):
        xi = math.sqrt(z[j] * z[j] + work[4, j])
        size = 0.5 * stiffness * xi * (xi * xi - 1.0) if green else stiffness * (xi - 1.0)
        low[j] = min(low[j], size)
        high[j] = max(high[j], size)


@compiled(inline="always")
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


@compiled
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


@compiled
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
