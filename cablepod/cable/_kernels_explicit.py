"""Compiled velocity Verlet steps of the spectral elements."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.cable._kernels_air import drag_forces
from cablepod.cable._kernels_forces import _extremes, _nodal_forces
from cablepod.chain._kernels_attached import apply_along, note_along
from cablepod.integrate._kernels_assign import assign


@compiled
def _update_velocity(v, f, per_mass, load_increment, damping_factor):
    for j in range(v.size):
        v[j] = damping_factor * v[j] + f[j] * per_mass[j] + load_increment[j]


@compiled
def _add_load(v, pattern, factor, per_mass):
    for j in range(v.size):
        v[j] += per_mass[j] * factor * pattern[j]


@compiled
def _update_position(x, v, step):
    for j in range(x.size):
        x[j] += step * v[j]


@compiled
def _move_back(x, v, first, end_rates, i, step, half_x, u):
    """Fill positions and velocities (dims, N) of all nodes half a step before step `i` of the tables."""
    dims, m = v.shape
    last = x.shape[1] - 1
    for c in range(dims):
        u[c, 0], u[c, last] = end_rates[i, 0, c], end_rates[i, 1, c]
        for j in range(m):
            u[c, first + j] = v[c, j]
        for j in range(last + 1):
            half_x[c, j] = x[c, j] - 0.5 * step * u[c, j]


@compiled
def _hold_drag(force, first, per_mass, load_increment, is_first, before, increments):
    """Fill the velocity increments by loads and drag until the next evaluation (dims, m), from the last two evaluations.

    These are half a step before, and extrapolated by 3/2 and -1/2 to the middle of the steps until the next one.
    """
    for c in range(increments.shape[0]):
        for j in range(increments.shape[1]):
            now = per_mass[j] * force[c, first + j]
            if is_first:
                before[c, j] = now
            increments[c, j] = load_increment[c, j] + 1.5 * now - 0.5 * before[c, j]
            before[c, j] = now


@compiled
def verlet(
    x, v, first, d, weight, scale, unrolled, stiffness, green, ratios, per_mass, load_increment, step, damping_factor, rows,
    columns, ends, patterns, factors, viscosity, tension_damping, particles, numbers, v_before, wind, drag, bodies,
    samples_per_second, hold, drag_before, drag_increment, end_rates, steps, start, save_steps, saved, saved_half,
    link_element, link_rows, low, high, slack,
):  # fmt: skip
    """Advance a cable by `steps` steps of velocity Verlet in leapfrog form.

    On entry positions are those of step `start` and velocities those half a step before; on exit the same holds for the next
    step.

    Parameters
    ----------
    x : float array (dims, N)
        Positions of all nodes [m]; advanced in place.
    v : float array (dims, m)
        Velocities of the free nodes first ... first + m - 1 half a step before [m/s]; advanced in place.
    first : int
        Number of the first free node.
    d : float array (p + 1, p + 1)
        Derivative matrix of the reference element of length 2, points in rows and nodes in columns.
    weight : float array (p + 1,)
        Quadrature weights, with sum 2.
    scale : float array (elements,)
        2 over the unstretched lengths of the elements [1/m].
    unrolled : tuple of p + 1 floats or None
        Its length lets the compiler unroll sums over nodes; each length is compiled anew.
    stiffness : float
        Axial stiffness [N].
    green : bool
        Whether law (21) holds in place of the linear one.
    ratios : float array (2, elements) or None
        Axial stiffness and drag of the elements over those of the cable; None for a uniform cable.
    per_mass, load_increment : float arrays (m,), (dims, m)
        Step over mass [s/kg], with damping (1 - damping_factor) / (damping mass); velocity increment by constant loads [m/s].
    step : float
        Time step [s].
    damping_factor : float
        exp(-damping step) with the damping per mass, 1 without.  Absent terms from here on are empty arrays: they cost
        little, and each argument that may be None doubles the number of compiled kernels.
    rows, columns : int arrays (moving,)
        Coordinates and nodes that are prescribed.
    ends : float array (moving, steps + 1)
        Prescribed values at the steps from `start` on [m].
    patterns, factors : float arrays (loads, dims, m), (steps + 1, loads)
        Patterns of time-dependent loads [N] and their factors at the steps.
    viscosity : float
        Viscosity over stiffness [s], 0 without; only with the linear law.
    tension_damping : float
        Damping by the tension [s], 0 without, see :func:`cablepod.cable._kernels_forces._add_tension_damping`.
    particles, numbers : int array (attachments,), float array (attachments, COLUMNS), or None
        Nodes with dampers and springs to the ground, and their numbers, see :mod:`cablepod.chain._kernels_attached`.
    v_before : float array (dims, m) or None
        Velocities one step before those in `v`; only with these dampings.
    wind, drag, bodies, samples_per_second : float array (samples, dims, N), float, float array (N,), float, or None
        See :func:`cablepod.cable._kernels_air.drag_forces`; samples of the wind per second, from the start of the run on.
    hold : int
        Number of steps from one evaluation of the drag to the next.
    drag_before, drag_increment : float arrays (dims, m) or None
        Velocity increments by the last drag, and by loads and drag until the next evaluation [m/s]; advanced in place.
    end_rates : float array (steps + 1, 2, dims) or None
        Velocities of the ends [m/s]; only where a force depends on velocities.
    steps, start : int
        Number of steps, and number of the first.
    save_steps : int array (saves,)
        Increasing numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, dims, N)
        Filled with positions.
    saved_half : float array (saves, 2, dims, m)
        Filled with the velocities half a step before and after, unless empty.
    link_element, link_rows : int array (links,), float array (links, p + 1)
        Element and nodal derivative weights [1/m] of the points for tension extremes.
    low, high : float arrays (links,)
        Minimum and maximum tensions there [N], updated unless empty.
    slack : float array (5,)
        First step with a stretch below 1 (-1 if none) and its point; step, point and square of the minimum stretch below 1.
    """
    dims, m = v.shape
    last = x.shape[1] - 1
    shape = (weight.size, scale.size)
    f = np.zeros(x.shape)
    g, g_dot = np.zeros((dims, *shape)), np.zeros((dims, *shape))
    square, stretching, s, nodal = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    d_transposed = np.ascontiguousarray(d.T)
    u = np.zeros(x.shape)
    half_x, half_u = np.empty(x.shape), np.empty(x.shape)
    air_force = np.empty(x.shape)
    increments = load_increment if wind is None else drag_increment
    save = 0
    for i in range(steps):
        if wind is not None and (start + i) % hold == 0:
            place = (start + i - 0.5) * step * samples_per_second
            _move_back(x, v, first, end_rates, i, step, half_x, half_u)
            drag_forces(
                half_x, half_u, wind, place, drag, ratios, bodies, d, weight, scale, unrolled, nodal, g, air_force
            )
            _hold_drag(air_force, first, per_mass, load_increment, start + i == 0, drag_before, drag_increment)
        if v_before is not None:
            for c in range(dims):
                u[c, 0], u[c, last] = end_rates[i, 0, c], end_rates[i, 1, c]
                for j in range(m):
                    u[c, first + j] = 1.5 * v[c, j] - 0.5 * v_before[c, j]
                    v_before[c, j] = v[c, j]
        _nodal_forces(
            x, u, d, d_transposed, weight, scale, unrolled, stiffness, green, ratios, viscosity, tension_damping, f, g, g_dot,
            square, stretching, s, nodal, start + i, slack,
        )  # fmt: skip
        if low.size > 0:
            _extremes(x, u, weight.size - 1, link_element, link_rows, stiffness, green, ratios, viscosity, low, high)
        if particles is not None:
            note_along(x, v, first, particles, numbers)
        saving = save < save_steps.size and save_steps[save] == start + i
        if saving:
            assign(saved[save], x)
            if saved_half.shape[0] > 0:
                assign(saved_half[save, 0], v)
        for c in range(dims):
            _update_velocity(v[c], f[c, first : first + m], per_mass, increments[c], damping_factor)
            for load in range(patterns.shape[0]):
                _add_load(v[c], patterns[load, c], factors[i, load], per_mass)
            _update_position(x[c, first : first + m], v[c], step)
        if particles is not None:
            apply_along(x, v, first, particles, numbers, per_mass, 1.0, step)
        for k in range(rows.size):
            x[rows[k], columns[k]] = ends[k, i + 1]
        if saving:
            if saved_half.shape[0] > 0:
                assign(saved_half[save, 1], v)
            save += 1
