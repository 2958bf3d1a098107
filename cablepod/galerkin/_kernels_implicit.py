"""Compiled implicit steps of the Galerkin model."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.galerkin._kernels_energy import LINEAR_LINKS, PACKED, _strains, _stresses
from cablepod.galerkin._kernels_explicit import _work_of_ends

#: A step in which Newton's method needs more has failed.
MOST_ITERATIONS = 25


# --- implicit ---------------------------------------------------------------------------------------------------------


@compiled(fastmath=FAST_DIVISION)
def _rows(y, law, table, offset, first, second, linked, reach, e, jacobian):
    """Strains e of the rows and their derivatives by the coordinates (coordinates, rows), which are linear in y."""
    count = y.size
    if law == PACKED:
        jacobian[:] = table[:count]
        for pair in range(first.size):
            a, b = first[pair], second[pair]
            ya, yb = y[a], y[b]
            for i in range(offset.size):
                jacobian[a, i] += table[count + pair, i] * yb
            for i in range(offset.size):
                jacobian[b, i] += table[count + pair, i] * ya
        e[:] = offset
        for k in range(count):
            half = 0.5 * y[k]
            for i in range(offset.size):
                e[i] += half * (table[k, i] + jacobian[k, i])
        return
    shape, strain, rates, used, _ = linked
    _strains(y, shape, strain, rates, used, reach, e)
    for k in range(count):
        for j in range(strain.size):
            jacobian[k, j] = 0.0
        for c in range(shape.shape[0]):
            if used[k, c]:
                for j in range(strain.size):
                    jacobian[k, j] += reach[c, j] * rates[k, c, j]


@compiled(fastmath=FAST_DIVISION)
def _tangent_stresses(law, conserving, stiffness, e0, e, s, ds):
    """Stresses s of the rows over a step, and their derivatives by the strains e at its end.

    With `conserving` the difference quotients of the energies; else the stresses at the end.
    """
    if law != LINEAR_LINKS:
        share = 0.5 if conserving else 1.0
        for j in range(e.size):
            s[j] = stiffness[j] * (share * e[j] + (1.0 - share) * e0[j])
            ds[j] = stiffness[j] * share
        return
    for j in range(e.size):
        xi = math.sqrt(1.0 + 2.0 * e[j])
        before = math.sqrt(1.0 + 2.0 * e0[j]) if conserving else xi
        if not conserving or (e[j] > 0.0 and e0[j] > 0.0):
            both = xi + before
            taut = 1.0 if e[j] > 0.0 else 0.0
            mate = e0[j] if conserving else e[j]
            s[j] = taut * stiffness[j] * 2.0 * (e[j] / (1.0 + xi) + mate / (1.0 + before)) / both
            ds[j] = taut * stiffness[j] * (2.0 if conserving else 4.0) / (both * both * xi)
        else:  # slack at the one end of the step or at both
            between = e[j] - e0[j]
            longer = max(2.0 * e[j] / (1.0 + xi), 0.0)
            shorter = max(2.0 * e0[j] / (1.0 + before), 0.0)
            s[j] = 0.5 * stiffness[j] * (longer * longer - shorter * shorter) / between if between != 0.0 else 0.0
            ds[j] = (stiffness[j] * longer / xi - s[j]) / between if between != 0.0 else 0.0


@compiled(fastmath=FAST_DIVISION)
def _mean(a, b, result):
    for k in range(a.shape[0]):
        for j in range(a.shape[1]):
            result[k, j] = 0.5 * (a[k, j] + b[k, j])


@compiled(fastmath=FAST_DIVISION)
def _gradient(jacobian, s, gradient):
    for k in range(jacobian.shape[0]):
        total = 0.0
        for j in range(s.size):
            total += jacobian[k, j] * s[j]
        gradient[k] = total


@compiled(fastmath=FAST_DIVISION)
def _tangent(law, share, middle, jacobian, s, ds, table, first, second, rates, used, scaled, weighted, tangent):
    """Differentiate the gradient, middle s, by the amplitudes at the end of the step, whose share of the middle is `share`."""
    modes, rows = tangent.shape[0], s.size
    symmetric = share == 1.0
    for k in range(modes):
        for j in range(rows):
            scaled[j] = ds[j] * middle[k, j]
        for m in range(k + 1 if symmetric else modes):
            total = 0.0
            for j in range(rows):
                total += scaled[j] * jacobian[m, j]
            tangent[k, m] = total
    if law == PACKED:
        count = jacobian.shape[0]
        for pair in range(first.size):
            a, b = first[pair], second[pair]
            if a < modes and b < modes:
                slope = 0.0
                for i in range(rows):
                    slope += table[count + pair, i] * s[i]
                tangent[b, a] += share * slope
                if a == b or not symmetric:
                    tangent[a, b] += share * slope
    else:
        for k in range(modes):
            for c in range(weighted.shape[0]):
                if not used[k, c]:
                    continue
                for j in range(rows):
                    weighted[c, j] = share * s[j] * rates[k, c, j]
                for m in range(k + 1):
                    if used[m, c]:
                        total = 0.0
                        for j in range(rows):
                            total += weighted[c, j] * rates[m, c, j]
                        tangent[k, m] += total
                        if m < k and not symmetric:
                            tangent[m, k] += total
    if symmetric:
        for k in range(modes):
            for m in range(k):
                tangent[m, k] = tangent[k, m]


@compiled(fastmath=FAST_DIVISION)
def solve(a, b):
    """Solve a x = b by elimination with rows exchanged; b becomes x, a is destroyed."""
    n = b.size
    for k in range(n):
        pivot, largest = k, abs(a[k, k])
        for i in range(k + 1, n):
            if abs(a[i, k]) > largest:
                pivot, largest = i, abs(a[i, k])
        if pivot != k:
            for j in range(k, n):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            b[k], b[pivot] = b[pivot], b[k]
        inverse = 1.0 / a[k, k]
        a[k, k] = inverse
        for i in range(k + 1, n):
            m = a[i, k] * inverse
            for j in range(k + 1, n):
                a[i, j] -= m * a[k, j]
            b[i] -= m * b[k]
    for k in range(n - 1, -1, -1):
        total = b[k]
        for j in range(k + 1, n):
            total -= a[k, j] * b[j]
        b[k] = total * a[k, k]


@compiled(fastmath=FAST_DIVISION)
def _place(y, p, d, ends, coupling):
    """Coordinates y where the particles have moved by d from p and the ends are displaced by `ends`."""
    moving, modes = coupling.shape
    for k in range(modes):
        y[k] = p[k] + d[k]
    for f in range(moving):
        here = ends[f]
        y[modes + f] = here
        for k in range(modes):
            y[k] -= here * coupling[f, k]


@compiled(fastmath=FAST_DIVISION)
def _save(saved, saved_energy, p, velocity, load, gradient, damping, energy, account):
    for k in range(p.size):
        saved[0, k] = p[k]
        saved[1, k] = velocity[k]
        saved[2, k] = load[k] - gradient[k] - damping * velocity[k]
    saved_energy[0] = energy
    saved_energy[1:] = account


@compiled(fastmath=FAST_DIVISION)
def implicit(
    p, velocity, history, account, step, conserving, damping, coupling, loads, ends, law, table, packed, linked, stiffness,
    turns, enough, rounding, start, steps, save_steps, saved, saved_energy,
):  # fmt: skip
    """Advance the amplitudes by `steps` steps of the trapezoidal rule or the energy-momentum method (Simo and Tarnow 1992).

    Both are (v1 - v0)/h = load - g - damping (v0 + v1)/2, (p1 - p0)/h = (v0 + v1)/2, with the mean of the loads at both ends
    of the step.  By the trapezoidal rule g is the mean of the gradients there; by the other the discrete gradient, the mean of
    the derivatives of the strains times the difference quotients of the energies of the rows, so that energy changes by what
    loads, ends and damping do, at any step, as far as Newton's method is carried.

    Parameters
    ----------
    p, velocity, account, coupling, law, linked, start, steps, save_steps, saved, saved_energy
        As in :func:`verlet`, rates at the step; a last saved step may be start + steps.
    history : float array (3, modes)
        Mean accelerations of the last three steps, the last first; advanced in place.
    step, damping : float
        [s], [1/s].
    conserving : bool
        Whether the energy is to be kept.
    loads : float array (steps + 1 or 1, modes)
        Generalised loads.
    ends : float array (steps + 1, displacements)
        Displacements of the ends [m].
    table : float array (monomials, rows)
        R transposed; of size 0 where not packed.
    packed : tuple (offset, first, second)
        As in :func:`verlet`.
    stiffness : float array (rows,)
        Of the rows: K l, or 1 where packed.
    turns : float array (modes,)
        By how much an amplitude turns and stretches the links, in the mean [kg^-1/2 m^-1].
    enough, rounding : float
        Newton's method ends with a correction that turns the links by as little as `enough`; with `conserving`, as what is left
        adds up, when what it would leave is below rounding or it has ceased to converge.

    Returns
    -------
    tuple of int
        Steps done, fewer than `steps` where Newton's method did not converge (the state is then that before the step), and
        iterations.
    """
    modes, moving = p.size, ends.shape[1]
    offset, first, second = packed
    rates, used = linked[2], linked[3]
    rows, count, dims = stiffness.size, modes + moving, rates.shape[1]
    y, gradient, force, reach = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros((dims, linked[1].size))
    before, jacobian, middle = np.zeros((count, rows)), np.zeros((count, rows)), np.zeros((count, rows))
    e0, e, s, ds, scaled = np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(rows)
    weighted, tangent = np.zeros((dims, rows)), np.zeros((modes, modes))
    d, b, held = np.zeros(modes), np.zeros(modes), np.zeros(modes)
    varying, save, iterations = loads.shape[0] > 1, 0, 0
    share = 0.5 if conserving else 1.0
    # the balance, twice of it by the trapezoidal rule, where half of the force is that of the start
    double = 1.0 if conserving else 2.0
    diagonal = double * (2.0 / (step * step) + damping / step)
    _place(y, p, d, ends[0], coupling)
    _rows(y, law, table, offset, first, second, linked, reach, e0, before)
    energy = _stresses(law, e0, stiffness, s)
    _gradient(before, s, gradient)
    for i in range(steps):
        now, then = (i, i + 1) if varying else (0, 0)
        if save < save_steps.size and save_steps[save] == start + i:
            _save(saved[save], saved_energy[save], p, velocity, loads[now], gradient, damping, energy, account)
            save += 1
        for k in range(modes):
            if start + i == 0:
                history[:, k] = loads[now, k] - gradient[k] - damping * velocity[k]
            # what is resolved goes on linearly, what is not swings from step to step: this is right for both
            mean = history[0, k] + history[1, k] - history[2, k]
            d[k] = step * (velocity[k] + 0.5 * step * mean)
            held[k] = double * (0.5 * (loads[now, k] + loads[then, k]) + 2.0 * velocity[k] / step)
            if not conserving:
                held[k] -= gradient[k]
        converged, last_size = False, 0.0
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            _place(y, p, d, ends[i + 1], coupling)
            _rows(y, law, table, offset, first, second, linked, reach, e, jacobian)
            _tangent_stresses(law, conserving, stiffness, e0, e, s, ds)
            if conserving:
                _mean(before, jacobian, middle)
            mid = middle if conserving else jacobian
            _gradient(mid, s, force)
            _tangent(law, share, mid, jacobian, s, ds, table, first, second, rates, used, scaled, weighted, tangent)
            size = 0.0
            for k in range(modes):
                b[k] = held[k] - diagonal * d[k] - force[k]
                tangent[k, k] += diagonal
            solve(tangent, b)
            for k in range(modes):
                d[k] += b[k]
                size += abs(b[k]) * turns[k]
            if not size < 1e300:
                break
            if not conserving:
                converged = size <= enough
            elif size <= rounding:
                converged = True
            elif last_size > 0.0 and size <= enough:
                # quadratic convergence leaves so much, and none is possible below rounding
                converged = size * (size / last_size) ** 2 <= rounding or size > 0.5 * last_size
            if converged:
                break
            last_size = size
        if not converged:
            return i, iterations
        for k in range(modes):
            mean = 2.0 * (d[k] / step - velocity[k])
            history[2, k], history[1, k], history[0, k] = history[1, k], history[0, k], mean / step
            velocity[k] += mean
            account[0] += 0.5 * (loads[now, k] + loads[then, k]) * d[k]
            account[2] += damping * d[k] * d[k] / step
        _place(y, p, d, ends[i + 1], coupling)
        _rows(y, law, table, offset, first, second, linked, reach, e, jacobian)
        if conserving and moving:  # after the last correction, as force and displacement must belong together
            _tangent_stresses(law, conserving, stiffness, e0, e, s, ds)
            _mean(before, jacobian, middle)
            _gradient(middle, s, force)
            _work_of_ends(account, 1.0, force, coupling, ends[i], ends[i + 1])
        elif moving:
            _work_of_ends(account, 0.5, gradient, coupling, ends[i], ends[i + 1])
        before, jacobian = jacobian, before
        e0, e = e, e0
        energy = _stresses(law, e0, stiffness, s)
        _gradient(before, s, gradient)
        if moving and not conserving:
            _work_of_ends(account, 0.5, gradient, coupling, ends[i], ends[i + 1])
        for k in range(modes):
            p[k] += d[k]
    if save < save_steps.size and save_steps[save] == start + steps:
        row = steps if varying else 0
        _save(saved[save], saved_energy[save], p, velocity, loads[row], gradient, damping, energy, account)
    return steps, iterations
