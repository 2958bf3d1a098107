"""Compiled velocity Verlet steps of the spectral elements."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.cable._kernels_forces import _extremes, _pull

# --- explicit steps ---------------------------------------------------------------------------------------------------


@compiled
def _kick(v, f, per_mass, drive, decay):
    for j in range(v.size):
        v[j] = decay * v[j] + f[j] * per_mass[j] + drive[j]


@compiled
def _push(v, pattern, factor, per_mass):
    for j in range(v.size):
        v[j] += per_mass[j] * factor * pattern[j]


@compiled
def _drift(x, v, step):
    for j in range(x.size):
        x[j] += step * v[j]


@compiled
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
