"""The continuous cable in spectral elements: forces, tangent, velocity Verlet, the trapezoidal rule, and rest.

An element of order p has p + 1 Gauss-Lobatto-Legendre (GLL) nodes, which are its points of quadrature too: the mass is diagonal,
and what is integrated is the energy sum of w W(xi) over the points, so that explicit steps keep it as those of a chain do.
Nodes are numbered through; element e has the nodes e p ... (e + 1) p.  No fastmath; sums over the nodes of an element run in
their order, so that planar and spatial runs give the same bits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

_options: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True}
MOST_ITERATIONS = 30


# --- forces -----------------------------------------------------------------------------------------------------------
# Work on elements has the shape (node or point, element): the loop over elements is the inner one that vectorises.  `fixed` is a
# tuple with one entry for each node of an element, whose length the compiler knows, so that it unrolls sums over nodes; or None.


@njit(**_options)
def _gradient(x, d, scale, fixed, spread, g):
    """Compute the derivative g (points, elements) of x (N,) by arc length."""
    count = d.shape[0] if fixed is None else len(fixed)
    elements = scale.size
    for e in range(elements):
        for i in range(count):
            spread[i, e] = x[e * (count - 1) + i]
    for q in range(count):
        for e in range(elements):
            total = 0.0
            for i in range(count):
                total += d[q, i] * spread[i, e]
            g[q, e] = total * scale[e]


@njit(**_options)
def _gather(g, s, d_transposed, fixed, spread, f):
    """Take what the points pull with, s g each, to the nodes: f = -D^T (s g); g is overwritten."""
    count = d_transposed.shape[0] if fixed is None else len(fixed)
    elements = g.shape[1]
    for q in range(count):
        for e in range(elements):
            g[q, e] *= s[q, e]
    for i in range(count):
        for e in range(elements):
            total = 0.0
            for q in range(count):
                total += d_transposed[i, q] * g[q, e]
            spread[i, e] = total
    for j in range(f.size):
        f[j] = 0.0
    for e in range(elements):
        for i in range(count):
            f[e * (count - 1) + i] -= spread[i, e]


@njit(**_options)
def _law(square, growth, weight, stiffness, green, viscosity, s):
    """Weight times tension over stretch [N] at the points; tells whether the stretch is below 1 anywhere.

    Law (21): T / xi = K (xi^2 - 1) / 2.  Linear law: K (1 - 1/xi) where xi > 1, else 0; viscous parts as in the chain.
    """
    below = False
    for q in range(s.shape[0]):
        w = weight[q]
        if green is not None:
            half = 0.5 * stiffness * w
            for e in range(s.shape[1]):
                strain = square[q, e] - 1.0
                below |= strain < 0.0
                s[q, e] = half * strain
        elif viscosity is None:
            for e in range(s.shape[1]):
                value = stiffness * (1.0 - 1.0 / math.sqrt(square[q, e]))
                below |= value < 0.0
                s[q, e] = w * (value if value > 0.0 else 0.0)
        else:
            for e in range(s.shape[1]):
                value = stiffness * (1.0 - 1.0 / math.sqrt(square[q, e]))
                below |= value < 0.0
                total = value + viscosity * stiffness * growth[q, e] / square[q, e]
                s[q, e] = w * (total if value > 0.0 and total > 0.0 else 0.0)
    return below


@njit(**_options)
def _products(g, h, result):
    """Scalar products of the vectors g and h (dims, points, elements)."""
    for q in range(result.shape[0]):
        for e in range(result.shape[1]):
            result[q, e] = g[0, q, e] * h[0, q, e] + g[1, q, e] * h[1, q, e]
    if g.shape[0] == 3:
        for q in range(result.shape[0]):
            for e in range(result.shape[1]):
                result[q, e] += g[2, q, e] * h[2, q, e]


@njit(**_options)
def _note_slack(square, step, slack):
    """Note the stretch below 1: slack is (first step, its place, step of the least, its place, least square)."""
    for e in range(square.shape[1]):
        for q in range(square.shape[0]):
            if square[q, e] < 1.0 and slack[0] < 0.0:
                slack[0] = step
                slack[1] = e * square.shape[0] + q
            if square[q, e] < slack[4]:
                slack[2] = step
                slack[3] = e * square.shape[0] + q
                slack[4] = square[q, e]


@njit(**_options)
def _pull(
    x, u, d, d_transposed, weight, scale, fixed, stiffness, green, viscosity, f, g, rate, square, growth, s, spread, step, slack
):  # fmt: skip
    """Compute the forces f (dims, N) [N] of the cable on its nodes at positions x; u are velocities, only with viscosity."""
    dims = x.shape[0]
    for c in range(dims):
        _gradient(x[c], d, scale, fixed, spread, g[c])
    _products(g, g, square)
    if viscosity is not None:
        for c in range(dims):
            _gradient(u[c], d, scale, fixed, spread, rate[c])
        _products(g, rate, growth)
    if _law(square, growth, weight, stiffness, green, viscosity, s):
        _note_slack(square, step, slack)
    for c in range(dims):
        _gather(g[c], s, d_transposed, fixed, spread, f[c])


@njit(**_options)
def forces(x, u, d, weight, scale, stiffness, green, viscosity):
    """Compute the forces of the cable on its nodes (dims, N) [N]; parameters as in :func:`verlet`, u only with viscosity."""
    shape = (weight.size, scale.size)
    f = np.empty_like(x)
    g, rate = np.empty((x.shape[0], *shape)), np.empty((x.shape[0], *shape))
    _pull(
        x, u, d, np.ascontiguousarray(d.T), weight, scale, None, stiffness, green, viscosity, f, g, rate, np.empty(shape),
        np.empty(shape), np.empty(shape), np.empty(shape), 0, np.array([-1.0, 0.0, 0.0, 0.0, 1.0]),
    )  # fmt: skip
    return f


@njit(**_options)
def _extremes(x, u, order, link_element, link_rows, stiffness, green, viscosity, low, high):
    """Update the extremes of the tensions [N] at places between particles."""
    dims = x.shape[0]
    for j in range(low.size):
        a = link_element[j] * order
        square, growth = 0.0, 0.0
        for c in range(dims):
            g, rate = 0.0, 0.0
            for i in range(order + 1):
                g += link_rows[j, i] * x[c, a + i]
                if viscosity is not None:
                    rate += link_rows[j, i] * u[c, a + i]
            square += g * g
            growth += g * rate
        size = math.sqrt(square)
        if green is not None:
            tension = 0.5 * stiffness * (square - 1.0) * size
        else:
            tension = stiffness * (size - 1.0)
            total = tension
            if viscosity is not None:
                total += viscosity * stiffness * growth / size
            tension = total if tension > 0.0 and total > 0.0 else 0.0
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


# --- explicit steps ---------------------------------------------------------------------------------------------------


@njit(**_options)
def _kick(v, f, per_mass, drive, decay):
    for j in range(v.size):
        v[j] = decay * v[j] + f[j] * per_mass[j] + drive[j]


@njit(**_options)
def _push(v, pattern, factor, per_mass):
    for j in range(v.size):
        v[j] += per_mass[j] * factor * pattern[j]


@njit(**_options)
def _drift(x, v, step):
    for j in range(x.size):
        x[j] += step * v[j]


@njit(**_options)
def verlet(
    x, v, first, d, weight, scale, fixed, stiffness, green, per_mass, drive, step, decay, rows, columns, ends, patterns,
    factors, viscosity, before, end_rates, steps, start, save_steps, saved, saved_half, link_element, link_rows, low, high, slack,
):  # fmt: skip
    """Advance a cable by `steps` steps of velocity Verlet in leapfrog form.

    Entering and leaving, positions are those of step `start`, velocities those half a step before it.

    Parameters
    ----------
    x : float array (dims, N)
        Positions of all nodes [m]; advanced in place.
    v : float array (dims, m)
        Velocities of the free nodes first ... first + m - 1 half a step before [m/s]; advanced in place.
    first : int
        The first free node.
    d : float array (p + 1, p + 1)
        Derivative at the points (rows) of an element of length 2 by its nodes.
    weight : float array (p + 1,)
        Of the points, with sum 2.
    scale : float array (elements,)
        2 over the unstretched lengths of the elements [1/m].
    fixed : tuple of p + 1 floats or None
        Its length lets the compiler unroll sums over nodes; a kernel is compiled anew for each.
    stiffness : float
        Axial stiffness [N].
    green : bool or None
        Not None for law (21), None for the linear law with tension only.
    per_mass, drive : float arrays (m,), (dims, m)
        Step over mass [s/kg] (with decay (1 - decay) / (damping mass)); what constant loads add to the velocity in a step [m/s].
    step : float
        [s].
    decay : float
        exp(-damping step), damping per mass; 1 without.  This and what follows costs so little beside the forces of elements that
        an absent term is an array without entries: each term that may be None is a kernel more to compile.
    rows, columns : int arrays (moving,)
        Which coordinates of which nodes are prescribed.
    ends : float array (moving, steps + 1)
        Their values at the steps from `start` on [m].
    patterns, factors : float arrays (loads, dims, m), (steps + 1, loads)
        Loads that vary in time [N] and their factors at the steps.
    viscosity : float or None
        Viscosity over stiffness [s]; only with the linear law.
    before : float array (dims, m) or None
        Velocities a whole step before those in `v`; only with viscosity.
    end_rates : float array (steps + 1, 2, dims) or None
        Velocities of the ends [m/s]; only with viscosity.
    steps, start : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, dims, N)
        Filled with positions.
    saved_half : float array (saves, 2, dims, m)
        Filled with the velocities half a step before and half a step after, where it has entries.
    link_element, link_rows : int array (links,), float array (links, p + 1)
        Where tensions are watched: the element, and the derivative by its nodes [1/m].
    low, high : float arrays (links,)
        Extremes of the tensions there, updated [N], where they have entries.
    slack : float array (5,)
        First step with a stretch below 1 (-1 before), its place; step and place of the least stretch below 1, and its square.
    """
    dims, m = v.shape
    last = x.shape[1] - 1
    shape = (weight.size, scale.size)
    f = np.zeros(x.shape)
    g, rate = np.zeros((dims, *shape)), np.zeros((dims, *shape))
    square, growth, s, spread = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    d_transposed = np.ascontiguousarray(d.T)
    u = np.zeros(x.shape)
    save = 0
    for i in range(steps):
        if viscosity is not None:
            for c in range(dims):
                u[c, 0], u[c, last] = end_rates[i, 0, c], end_rates[i, 1, c]
                for j in range(m):
                    u[c, first + j] = 1.5 * v[c, j] - 0.5 * before[c, j]
                    before[c, j] = v[c, j]
        _pull(
            x, u, d, d_transposed, weight, scale, fixed, stiffness, green, viscosity, f, g, rate, square, growth, s, spread,
            start + i, slack,
        )  # fmt: skip
        if low.size > 0:
            _extremes(x, u, weight.size - 1, link_element, link_rows, stiffness, green, viscosity, low, high)
        saving = save < save_steps.size and save_steps[save] == start + i
        if saving:
            saved[save] = x
            if saved_half.shape[0] > 0:
                saved_half[save, 0] = v
        for c in range(dims):
            _kick(v[c], f[c, first : first + m], per_mass, drive[c], decay)
            for load in range(patterns.shape[0]):
                _push(v[c], patterns[load, c], factors[i, load], per_mass)
            _drift(x[c, first : first + m], v[c], step)
        for k in range(rows.size):
            x[rows[k], columns[k]] = ends[k, i + 1]
        if saving:
            if saved_half.shape[0] > 0:
                saved_half[save, 1] = v
            save += 1


# --- implicit steps and rest ------------------------------------------------------------------------------------------


@njit(**_options)
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


@njit(**_options)
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


@njit(**_options)
def _heights(first, free, order, dims):
    """How far below the diagonal each column reaches."""
    height = np.empty(free * dims, dtype=np.int64)
    for n in range(free):
        node = n + first
        last = min((node // order + 1) * order - first, free - 1)
        for c in range(dims):
            height[dims * n + c] = dims * (last + 1) - 1 - (dims * n + c)
    return height


@njit(**_options)
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


@njit(**_options)
def _pairs(d):
    count = d.shape[0]
    pairs = np.empty((count, count, count))
    for i in range(count):
        for j in range(count):
            for q in range(count):
                pairs[i, j, q] = d[q, i] * d[q, j]
    return pairs


@njit(**_options)
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


@njit(**_options)
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


@njit(**_options)
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
