"""Compiled tangent stiffness, equilibrium and trapezoidal steps of the spectral elements."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.cable._kernels_forces import _extremes, _gather, _gradient, _law, _note_slack, _products, forces

MOST_ITERATIONS = 30


# --- implicit steps and rest ------------------------------------------------------------------------------------------


@compiled
def _stiffening(square, weight, stiffness, green, viscosity, rate, s, b):
    """Weight times the part of the tangent along the cable, over g g^T [N]; s as of :func:`_law`."""
    for q in range(b.shape[0]):
        for e in range(b.shape[1]):
            if green is not None:
                b[q, e] = weight[q] * stiffness
            else:
                part = weight[q] * stiffness / (square[q, e] * math.sqrt(square[q, e]))
                if viscosity is not None:
                    # the exact tangent has more terms; without them Newton's method converges all the same
                    part += weight[q] * viscosity * stiffness * rate / square[q, e]
                b[q, e] = part if s[q, e] > 0.0 else 0.0


@compiled
def _tangent(g, s, b, pairs, scale, fixed, first, line, coefficient, band):
    """Add the tangent stiffness of all elements to a matrix in bands.

    Parameters
    ----------
    g, s, b : float arrays (dims, p + 1, elements), (p + 1, elements), (p + 1, elements)
        Derivative of the position, and what stands before the identity and g g^T [N].
    pairs : float array (p + 1, p + 1, p + 1)
        Products D_qi D_qj at [i, j, q].
    scale, fixed : float array (elements,), tuple or None
        2 over the lengths of the elements [1/m]; its length is p + 1.
    first : int
        The first free node.
    line, coefficient : float arrays (elements,), (p + 1, elements)
        To work in.
    band : float array (unknowns, width)
        Entry (row, column) of the lower half stands at [column, row - column]; unknowns are dims (node - first) + coordinate.
    """
    dims, count, elements = g.shape[0], g.shape[1] if fixed is None else len(fixed), g.shape[2]
    free = band.shape[0] // dims
    for c in range(dims):
        for k in range(c + 1):
            for q in range(count):
                for e in range(elements):
                    coefficient[q, e] = b[q, e] * g[c, q, e] * g[k, q, e]
                    if c == k:
                        coefficient[q, e] += s[q, e]
            for i in range(count):
                for j in range(i + 1 if c == k else count):
                    for e in range(elements):
                        total = 0.0
                        for q in range(count):
                            total += pairs[i, j, q] * coefficient[q, e]
                        line[e] = total * scale[e]
                    for e in range(elements):
                        n, m = e * (count - 1) + i - first, e * (count - 1) + j - first
                        if 0 <= n < free and 0 <= m < free:
                            row, column = dims * n + c, dims * m + k
                            if row >= column:
                                band[column, row - column] += line[e]
                            else:
                                band[row, column - row] += line[e]


@compiled
def _heights(first, free, order, dims):
    """How far below the diagonal each column reaches."""
    height = np.empty(free * dims, dtype=np.int64)
    for n in range(free):
        node = n + first
        last = min((node // order + 1) * order - first, free - 1)
        for c in range(dims):
            height[dims * n + c] = dims * (last + 1) - 1 - (dims * n + c)
    return height


@compiled
def _solve(band, height, right):
    """Solve a symmetric system in bands by L D L^T without pivots, in place; elements fill no more than their own blocks."""
    for j in range(right.size):
        h = height[j]
        inverse = 1.0 / band[j, 0]
        column = band[j]
        value = right[j] * inverse
        for k in range(1, h + 1):
            right[j + k] -= column[k] * value
            factor = column[k] * inverse
            tail = column[k : h + 1]
            target = band[j + k, : h + 1 - k]
            for m in range(tail.size):
                target[m] -= factor * tail[m]
        band[j, 0] = inverse
        right[j] = value
    for j in range(right.size - 1, -1, -1):
        total = 0.0
        for k in range(1, height[j] + 1):
            total += band[j, k] * right[j + k]
        right[j] -= total * band[j, 0]


@compiled
def _pairs(d):
    count = d.shape[0]
    pairs = np.empty((count, count, count))
    for i in range(count):
        for j in range(count):
            for q in range(count):
                pairs[i, j, q] = d[q, i] * d[q, j]
    return pairs


@compiled
def tangent(x, first, free, d, weight, scale, stiffness, green):
    """Tangent stiffness at positions x (dims, N) [N/m], in bands as in :func:`_tangent`."""
    dims = x.shape[0]
    shape = (weight.size, scale.size)
    g, square, s, b = np.empty((dims, *shape)), np.empty(shape), np.empty(shape), np.empty(shape)
    spread, line = np.empty(shape), np.empty(scale.size)
    for c in range(dims):
        _gradient(x[c], d, scale, None, spread, g[c])
    _products(g, g, square)
    _law(square, square, weight, stiffness, green, None, s)
    _stiffening(square, weight, stiffness, green, None, 0.0, s, b)
    band = np.zeros((free * dims, weight.size * dims))
    _tangent(g, s, b, _pairs(d), scale, None, first, line, spread, band)
    return band


@compiled
def equilibrium(x, first, free, d, weight, scale, stiffness, green, loads, enough):
    """Bring a cable to rest by Newton's method from positions near it.

    Parameters
    ----------
    x : float array (dims, N)
        Positions [m]; overwritten.
    first, free : int
        The first free node, and their number.
    d, weight, scale, stiffness, green
        As in :func:`verlet`.
    loads : float array (dims, free)
        Loads [N].
    enough : float
        A correction as small as this ends it [m].

    Returns
    -------
    tuple of bool and float
        Whether corrections became so small, and the last one [m].
    """
    dims = x.shape[0]
    height = _heights(first, free, weight.size - 1, dims)
    right = np.empty(free * dims)
    size, before = np.inf, np.inf
    for _ in range(MOST_ITERATIONS):
        f = forces(x, x, d, weight, scale, stiffness, green, None)
        band = tangent(x, first, free, d, weight, scale, stiffness, green)
        for n in range(free):
            for c in range(dims):
                right[dims * n + c] = f[c, first + n] + loads[c, n]
        _solve(band, height, right)
        size = 0.0
        for j in range(right.size):
            if not abs(right[j]) <= size:
                size = abs(right[j])
        if not size < 1e3 * before:  # it runs away, or is not a number
            return False, size
        for n in range(free):
            for c in range(dims):
                x[c, first + n] += right[dims * n + c]
        if size <= enough:
            return True, size
        before = min(before, size)
    return False, size


@compiled
def trapezoidal(
    x, v, a, first, d, weight, scale, fixed, stiffness, green, mass, damping, loads, patterns, factors, viscosity,
    rows, columns, ends, end_rates, step, enough, start, steps, save_steps, saved, link_element, link_rows, low, high, slack,
):  # fmt: skip
    """Advance a cable by `steps` steps of the trapezoidal rule (average acceleration), each solved by Newton's method.

    Parameters
    ----------
    x : float array (dims, N)
        Positions [m]; advanced in place.
    v, a : float arrays (dims, m)
        Velocities [m/s] and accelerations [m/s2] of the free nodes; advanced in place.
    mass, damping : float array (m,), float
        [kg]; damping per mass [1/s], 0 without.
    loads : float array (dims, m)
        Constant loads [N].
    enough : float
        A correction as small as this ends Newton's method [m].
    saved : float array (saves, 3, dims, N)
        Filled with positions, velocities and accelerations.

    All other parameters are those of :func:`verlet`.

    Returns
    -------
    tuple of int
        Steps done, fewer than `steps` where Newton's method did not converge (the state is then that before the step), and
        iterations.
    """
    dims, m = v.shape
    last = x.shape[1] - 1
    shape = (weight.size, scale.size)
    f = np.zeros(x.shape)
    g, rates = np.zeros((dims, *shape)), np.zeros((dims, *shape))
    square, growth, s, b = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    spread, coefficient, line = np.zeros(shape), np.zeros(shape), np.zeros(scale.size)
    d_transposed, pairs = np.ascontiguousarray(d.T), _pairs(d)
    height = _heights(first, m, weight.size - 1, dims)
    band, right = np.zeros((dims * m, dims * weight.size)), np.zeros(dims * m)
    move, trial, u = np.zeros((dims, m)), x.copy(), np.zeros(x.shape)
    inertia, rate = 4.0 / (step * step), 2.0 / step
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1, :, first : first + m] = v
            saved[save, 2, :, first : first + m] = a
            save += 1
        if low.size > 0:
            if viscosity is not None:
                for c in range(dims):
                    u[c, 0], u[c, last] = end_rates[i, 0, c], end_rates[i, 1, c]
                    u[c, first : first + m] = v[c]
            _extremes(x, u, weight.size - 1, link_element, link_rows, stiffness, green, viscosity, low, high)
        for c in range(dims):
            for j in range(m):
                move[c, j] = step * (v[c, j] + 0.5 * step * a[c, j])
                trial[c, first + j] = x[c, first + j] + move[c, j]
        for q in range(rows.size):
            trial[rows[q], columns[q]] = ends[q, i + 1]
        converged, below = False, False
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            for c in range(dims):
                _gradient(trial[c], d, scale, fixed, spread, g[c])
            _products(g, g, square)
            if viscosity is not None:
                for c in range(dims):
                    u[c, 0], u[c, last] = end_rates[i + 1, 0, c], end_rates[i + 1, 1, c]
                    for j in range(m):
                        u[c, first + j] = 2.0 * move[c, j] / step - v[c, j]
                    _gradient(u[c], d, scale, fixed, spread, rates[c])
                _products(g, rates, growth)
            below = _law(square, growth, weight, stiffness, green, viscosity, s)
            _stiffening(square, weight, stiffness, green, viscosity, rate, s, b)
            band[:] = 0.0
            _tangent(g, s, b, pairs, scale, fixed, first, line, coefficient, band)
            for c in range(dims):
                _gather(g[c], s, d_transposed, fixed, spread, f[c])
                for j in range(m):
                    total = f[c, first + j] + loads[c, j]
                    for load in range(patterns.shape[0]):
                        total += factors[i + 1, load] * patterns[load, c, j]
                    new = inertia * (move[c, j] - step * v[c, j]) - a[c, j]
                    total -= damping * mass[j] * (2.0 * move[c, j] / step - v[c, j])
                    right[dims * j + c] = total - mass[j] * new
                    band[dims * j + c, 0] += mass[j] * (inertia + damping * rate)
            _solve(band, height, right)
            size = 0.0
            for c in range(dims):
                for j in range(m):
                    correction = right[dims * j + c]
                    move[c, j] += correction
                    trial[c, first + j] = x[c, first + j] + move[c, j]
                    if not abs(correction) <= size:  # also where it is not a number
                        size = abs(correction)
            if size <= enough:
                converged = True
                break
            if not size < 1e300:
                break
        if not converged:
            return i, iterations
        if below:
            _note_slack(square, start + i + 1, slack)
        for c in range(dims):
            for j in range(m):
                new = inertia * (move[c, j] - step * v[c, j]) - a[c, j]
                v[c, j] = 2.0 * move[c, j] / step - v[c, j]
                a[c, j] = new
            for j in range(last + 1):
                x[c, j] = trial[c, j]
    return steps, iterations
