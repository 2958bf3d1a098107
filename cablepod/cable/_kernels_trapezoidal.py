"""Compiled tangent stiffness and trapezoidal steps of the spectral elements."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.cable._kernels_air import _nodal_drag
from cablepod.cable._kernels_forces import (
    _add_tension_damping,
    _assemble,
    _extremes,
    _gradient,
    _is_inside,
    _law,
    _pairs,
    _products,
    _record_slack,
    _scale_elements,
)
from cablepod.chain._kernels_attached import add_bodies, attached_forces, attached_tangent
from cablepod.discretisation._kernels_modal_damping import damping_forces
from cablepod.integrate._kernels_assign import assign

#: Maximum number of Newton iterations.
MAX_ITERATIONS = 30
#: Iterations after which a step is predicted anew without the acceleration, and so are further steps until one takes more:
#: axial vibrations that the steps do not resolve stay in the acceleration, undamped.
MANY_ITERATIONS = 6
#: With drag: tolerance of what remains over that of the last correction.
REMAINDER = 0.1


@compiled
def _axial_tangent(square, weight, stiffness, green, viscosity, velocity_factor, s, b):
    """Fill b with weight times the coefficient of g g^T in the tangent stiffness [N]; s is that of ``_law``."""
    for q in range(b.shape[0]):
        if green:
            for e in range(b.shape[1]):
                b[q, e] = weight[q] * stiffness
        else:
            for e in range(b.shape[1]):
                part = weight[q] * stiffness / (square[q, e] * math.sqrt(square[q, e]))
                # further viscous terms of the exact tangent are omitted; Newton's method converges without them
                part += weight[q] * viscosity * stiffness * velocity_factor / square[q, e]
                b[q, e] = part if s[q, e] > 0.0 else 0.0


@compiled
def _tangent(g, s, b, pairs, scale, unrolled, first, line, coefficient, band):
    """Add the tangent stiffness of all elements to a band matrix.

    Parameters
    ----------
    g, s, b : float arrays (dims, p + 1, elements), (p + 1, elements), (p + 1, elements)
        Derivative of the position, and coefficients of the identity and of g g^T [N].
    pairs : float array (p + 1, p + 1, p + 1)
        Products D_qi D_qj at [i, j, q].
    scale, unrolled : float array (elements,), tuple or None
        2 over the lengths of the elements [1/m]; see :func:`cablepod.cable._kernels_explicit.verlet`.
    first : int
        Number of the first free node.
    line, coefficient : float arrays (elements,), (p + 1, elements)
        Work arrays.
    band : float array (unknowns, width)
        Lower triangle: entry (row, column) is at [column, row - column]; unknowns are dims (node - first) + coordinate.
    """
    dims, count, elements = g.shape[0], g.shape[1] if unrolled is None else len(unrolled), g.shape[2]
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
def _column_heights(first, free, order, dims):
    """Return the number of entries below the diagonal of each column (unknowns,)."""
    height = np.empty(free * dims, dtype=np.int64)
    for n in range(free):
        node = n + first
        last = min((node // order + 1) * order - first, free - 1)
        for c in range(dims):
            height[dims * n + c] = dims * (last + 1) - 1 - (dims * n + c)
    return height


@compiled
def _solve(band, height, right):
    """Solve a symmetric band system in place by L D L^T without pivoting, within the column heights of element blocks."""
    for j in range(right.size):
        height_j = height[j]
        inverse = 1.0 / band[j, 0]
        column = band[j]
        value = right[j] * inverse
        for k in range(1, height_j + 1):
            right[j + k] -= column[k] * value
            factor = column[k] * inverse
            tail = column[k : height_j + 1]
            target = band[j + k, : height_j + 1 - k]
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
def _add_blocks(own, first, band):
    """Add symmetric blocks of the nodes (3 or 6, N) [N/m] to the band of the free ones, see :func:`_tangent`."""
    dims = 2 if own.shape[0] == 3 else 3
    for j in range(band.shape[0] // dims):
        row = 0
        for c in range(dims):
            for k in range(c, dims):
                band[dims * j + c, k - c] += own[row, first + j]
                row += 1


@compiled
def _predict(x, v, a, first, step, has_acceleration, increment, trial):
    """Predict the increments of the free nodes and their positions after a step, from their velocities or accelerations too."""
    for c in range(v.shape[0]):
        for j in range(v.shape[1]):
            increment[c, j] = step * v[c, j]
            if has_acceleration:
                increment[c, j] += 0.5 * step * step * a[c, j]
            trial[c, first + j] = x[c, first + j] + increment[c, j]


@compiled
def trapezoidal(
    x, v, a, first, d, weight, scale, unrolled, stiffness, green, ratios, mass, damping, loads, patterns, factors, viscosity,
    tension_damping, modal, particles, numbers, wind, wind_places, drag, bodies, rows, columns, ends, end_rates, step,
    tolerance, bound, start, steps, save_steps, saved, link_element, link_rows, low, high, slack,
):  # fmt: skip
    """Advance a cable by `steps` steps of the trapezoidal rule (average acceleration), each solved by Newton's method.

    Parameters
    ----------
    x : float array (dims, N)
        Positions [m]; advanced in place.
    v, a : float arrays (dims, m)
        Velocities [m/s] and accelerations [m/s^2] of the free nodes; advanced in place.
    mass, damping : float array (m,), float
        Mass [kg]; damping per mass [1/s], 0 without.
    loads : float array (dims, m)
        Constant loads [N].
    modal : NodalDamping
        Damping by ratios, see :class:`cablepod.discretisation._modal_damping.NodalDamping`; it needs `end_rates`.
    wind_places : float array (steps + 1,) or None
        Places of the steps between the samples of the wind.
    end_rates : float array (steps + 1, 2, dims)
        Velocities of both ends [m/s]; of no steps where no force depends on velocities.
    tolerance : float
        Tolerance of the last Newton correction [m].
    bound : float
        Coordinate above which the cable is considered divergent [m].
    saved : float array (saves, 3, dims, N)
        Filled with positions, velocities and accelerations.

    All other parameters are those of :func:`cablepod.cable._kernels_explicit.verlet`.

    Returns
    -------
    tuple of int
        Number of completed steps, fewer than `steps` if Newton's method did not converge (the state is then that before the
        failed step) or the last of them left the bound, and number of iterations.
    """
    dims, m = v.shape
    last = x.shape[1] - 1
    shape = (weight.size, scale.size)
    f = np.zeros(x.shape)
    g, g_dot = np.zeros((dims, *shape)), np.zeros((dims, *shape))
    square, stretching, s, b = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    nodal, coefficient, line = np.zeros(shape), np.zeros(shape), np.zeros(scale.size)
    d_transposed, pairs = np.ascontiguousarray(d.T), _pairs(d)
    height = _column_heights(first, m, weight.size - 1, dims)
    band, right = np.zeros((dims * m, dims * weight.size)), np.zeros(dims * m)
    increment, trial, u = np.zeros((dims, m)), x.copy(), np.zeros(x.shape)
    own, attached_force = np.zeros((dims * (dims + 1) // 2, last + 1)), np.zeros(x.shape)
    inertia, velocity_factor = 4.0 / (step * step), 2.0 / step
    air_force, air_tangent, s_tangent = np.zeros(x.shape), np.zeros((dims, dims, last + 1)), s
    if tension_damping > 0.0:
        s_tangent = np.zeros(shape)
    damping_force, lag = np.zeros(x.shape), modal.half_ratio * velocity_factor * velocity_factor
    is_linear = wind is not None or modal.matrix.size > 0
    needs_rates = end_rates.size > 0
    iterations, save, has_acceleration = 0, 0, True
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            assign(saved[save, 0], x)
            assign(saved[save, 1, :, first : first + m], v)
            assign(saved[save, 2, :, first : first + m], a)
            save += 1
        if low.size > 0:
            if needs_rates:  # of which the viscosity takes the velocities
                for c in range(dims):
                    u[c, 0], u[c, last] = end_rates[i, 0, c], end_rates[i, 1, c]
                assign(u[:, first : first + m], v)
            _extremes(x, u, weight.size - 1, link_element, link_rows, stiffness, green, ratios, viscosity, low, high)
        for q in range(rows.size):
            trial[rows[q], columns[q]] = ends[q, i + 1]
        converged, below, before, started = False, False, 0.0, has_acceleration
        for k in range(MAX_ITERATIONS):
            iterations += 1
            has_acceleration = has_acceleration and k < MANY_ITERATIONS
            if k == 0 or (k == MANY_ITERATIONS and started):
                _predict(x, v, a, first, step, has_acceleration, increment, trial)
            for c in range(dims):
                _gradient(trial[c], d, scale, unrolled, nodal, g[c])
            _products(g, g, square)
            if needs_rates:
                for c in range(dims):
                    u[c, 0], u[c, last] = end_rates[i + 1, 0, c], end_rates[i + 1, 1, c]
                    for j in range(m):
                        u[c, first + j] = 2.0 * increment[c, j] / step - v[c, j]
                    _gradient(u[c], d, scale, unrolled, nodal, g_dot[c])
                _products(g, g_dot, stretching)
            if wind is not None:
                _nodal_drag(u, g, wind, wind_places[i + 1], drag, ratios, weight, scale, air_force, air_tangent)
            below = _law(square, stretching, weight, stiffness, green, viscosity, s)
            _axial_tangent(square, weight, stiffness, green, viscosity, velocity_factor, s, b)
            if ratios is not None:
                _scale_elements(s, ratios[0])
                _scale_elements(b, ratios[0])
            band[:] = 0.0
            if modal.matrix.size > 0:
                for row in range(band.shape[0]):
                    for column in range(band.shape[1]):
                        band[row, column] = modal.stiffness[row, column]
                damping_forces(modal, u, first, np.empty(u.size), damping_force)
            if bodies is not None:
                own[:] = 0.0
                add_bodies(u, wind, wind_places[i + 1], bodies, air_force, velocity_factor, own)
                _add_blocks(own, first, band)
            if tension_damping > 0.0:
                for q in range(weight.size):
                    for e in range(scale.size):
                        s_tangent[q, e] = s[q, e] + max(s[q, e], 0.0) * tension_damping * velocity_factor
            _tangent(g, s_tangent, b, pairs, scale, unrolled, first, line, coefficient, band)
            for c in range(dims):
                if tension_damping > 0.0:
                    _add_tension_damping(g[c], g_dot[c], s, tension_damping)
                _assemble(g[c], s, d_transposed, unrolled, nodal, f[c])
                for j in range(m):
                    total = f[c, first + j] + loads[c, j]
                    if wind is not None:
                        total += air_force[c, first + j]
                        for k in range(c, dims):
                            band[dims * j + c, k - c] += velocity_factor * air_tangent[c, k, first + j]
                    for load in range(patterns.shape[0]):
                        total += factors[i + 1, load] * patterns[load, c, j]
                    new = inertia * (increment[c, j] - step * v[c, j]) - a[c, j]
                    total += damping_force[c, first + j]
                    total -= damping * mass[j] * (2.0 * increment[c, j] / step - v[c, j])
                    right[dims * j + c] = total - mass[j] * new
                    band[dims * j + c, 0] += mass[j] * (inertia + damping * velocity_factor + lag)
            if particles is not None:
                attached_force[:] = 0.0
                attached_forces(trial, u, particles, numbers, attached_force)
                own[:] = 0.0
                attached_tangent(particles, numbers, 1.0, velocity_factor, own)
                _add_blocks(own, first, band)
                for k in range(particles.size):
                    for c in range(dims):
                        right[dims * (particles[k] - first) + c] += attached_force[c, particles[k]]
            _solve(band, height, right)
            norm = 0.0
            for c in range(dims):
                for j in range(m):
                    correction = right[dims * j + c]
                    increment[c, j] += correction
                    trial[c, first + j] = x[c, first + j] + increment[c, j]
                    if not abs(correction) <= norm:  # also for nan
                        norm = abs(correction)
            # the tangent leaves out that the drag turns with the cable, and approximates the damping by ratios: what remains is
            # norm^2 / before, not the square of norm
            remainder = (norm * norm / before if before > norm else norm) if is_linear else 0.0
            if norm <= tolerance and remainder <= REMAINDER * tolerance:
                converged = True
                break
            if not norm < 1e300 and not has_acceleration:
                break
            before = norm
        if not converged:
            return i, iterations
        has_acceleration = has_acceleration or (not started and k >= MANY_ITERATIONS)
        if below:
            _record_slack(square, start + i + 1, slack)
        for c in range(dims):
            for j in range(m):
                new = inertia * (increment[c, j] - step * v[c, j]) - a[c, j]
                v[c, j] = 2.0 * increment[c, j] / step - v[c, j]
                a[c, j] = new
        assign(x, trial)
        if not _is_inside(x, bound):
            return i + 1, iterations
    return steps, iterations
