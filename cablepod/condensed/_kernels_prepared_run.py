"""Compiled runs of a prepared model to leading order: another cable by scaling; boundary data, steps and end forces."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.catenary._kernels_solve import FOUND, solve
from cablepod.condensed._kernels_end_force import leading_end_forces
from cablepod.condensed._kernels_frame import _complete_axes, frames
from cablepod.condensed._kernels_host_layout import (
    AT_CANDIDATES,
    DIMS,
    FIRST_TRIBUTARY,
    IN_PLANE,
    KAPPA,
    LENGTH,
    MASS,
    MEANS,
    MOMENTS,
    NORMS,
    PATTERNS,
    PROJECTION,
    RANK,
    REACH_LOADS,
    REACH_MOMENT,
    REFERENCE,
    SECOND_MOMENT,
    SLOPES,
    STEADY_LOAD,
    STIFFNESS,
)
from cablepod.condensed._kernels_leading import _chord_tension, _leading_acceleration, leading_rest, leading_verlet

#: Status of a variant beside those of the catenary: the model found no equilibrium.
NO_REST = -1


@compiled
def scale_coefficients(base, result, length, mass):
    """Fill the coefficients of a cable whose length and mass per length are `length` and `mass` times those of `base`.

    Modes are functions of sigma = S / L0, so that all coefficients are powers of length and mass times those of `base`.
    Stiffness, loads and damping of `result` are given.
    """
    shape = 1.0 / math.sqrt(mass * length)
    square, loads = shape * shape, length * shape
    for i in (FIRST_TRIBUTARY, SECOND_MOMENT):
        result.numbers[i] = base.numbers[i] * length
    result.numbers[LENGTH] = base.numbers[LENGTH] * length
    result.numbers[REACH_MOMENT] = base.numbers[REACH_MOMENT] * length * length
    for row in range(base.by_coordinate.shape[0]):
        factor = loads
        if row == KAPPA:
            factor = square / length
        elif row == MOMENTS:
            factor = loads * mass
        for i in range(base.by_coordinate.shape[1]):
            result.by_coordinate[row, i] = base.by_coordinate[row, i] * factor
    for row in range(base.by_pattern.shape[0]):
        factor = length
        if row == NORMS:
            factor = square
        elif row == REACH_LOADS:
            factor = length * length * length
        for a in range(PATTERNS):
            result.by_pattern[row, a] = base.by_pattern[row, a] * factor
    for row in range(base.by_point.shape[0]):
        factor = length if row < SLOPES else shape / length
        for j in range(base.by_point.shape[1]):
            result.by_point[row, j] = base.by_point[row, j] * factor
    for a in range(PATTERNS):
        for i in range(base.geometric_stiffness.shape[1]):
            for j in range(base.geometric_stiffness.shape[2]):
                result.geometric_stiffness[a, i, j] = base.geometric_stiffness[a, i, j] * square


@compiled
def leading_variant(base, result, plane, reach, kind, value, parabola, q, solution):
    """Fill coefficients and coordinates at rest of another cable, to leading order.

    Parameters
    ----------
    base, result
        Coefficients of the prepared model, and of the other cable: filled, with stiffness, mass, loads and damping given.
    plane
        Span, rise, chord and load of the catenary (4,) [m, m, m, N/m].
    reach
        Vector from the lower end to the upper one (dims,) [m].
    kind, value
        Given quantity of the catenary, see :func:`cablepod.catenary._kernels_solve.solve`.
    parabola
        Integrals of the shapes of `base` times sigma (1 - sigma) (r,) [kg^-1/2 m].
    q, solution
        Filled: coordinates at rest (r,); solution of the catenary (6,).

    Returns
    -------
    int
        Status of the catenary, or NO_REST.
    """
    numbers = result.numbers
    status = solve(plane[0], plane[1], plane[2], plane[3], numbers[STIFFNESS], kind, value, solution)
    if status != FOUND:
        return status
    length, mass = solution[0] / base.numbers[LENGTH], numbers[MASS] / base.numbers[MASS]
    scale_coefficients(base, result, length, mass)
    dims, n_in_plane = result.sizes[DIMS], result.sizes[IN_PLANE]
    static, axes = np.zeros((1, 1 + PATTERNS * dims)), np.empty((dims, dims))
    for d in range(dims):
        axes[0, d] = -reach[d]
    static[0, 0] = _complete_axes(axes, dims, result.sizes[REFERENCE])
    for k in range(dims):
        for d in range(dims):
            static[0, 1 + PATTERNS * k] += numbers[STEADY_LOAD + d] * axes[k, d]
    # first guess: the parabola whose tension is that at rest
    sag = solution[0] * solution[0] / (solution[4] + solution[5]) * numbers[MASS] * length / math.sqrt(mass * length)
    for i in range(q.size):
        q[i] = sag * parabola[i] * static[0, 1 + PATTERNS * (1 if i < n_in_plane else 2)]
    found = leading_rest(
        q, static, numbers[STIFFNESS], numbers[LENGTH], result.by_coordinate[KAPPA], result.by_pattern[MEANS],
        result.geometric_stiffness, result.by_coordinate[PROJECTION:],
    )  # fmt: skip
    return FOUND if found else NO_REST


@compiled
def leading_run(
    coefficients, q, v, rates, step, factors, ends, accelerations, begin, output_steps, saved, half_step_rates,
    saved_ends, force, monitor,
):  # fmt: skip
    """Advance by velocity Verlet to leading order, and fill the forces on the upper end.

    Parameters
    ----------
    coefficients
        See :class:`cablepod.condensed._kernels_host_layout.HostCoefficients`.
    q, v, rates
        Coordinates, rates half a step before (not used at the first step) and at the start (r,); the first two are changed.
    step, factors
        Step [s]; factors of the rates by damping over a step and over half a step back, and the rates gained for unit
        acceleration in both [s].
    ends, accelerations
        As in :func:`cablepod.condensed._kernels_frame.frames`.
    begin, output_steps, saved, half_step_rates, monitor
        As in :func:`cablepod.condensed._kernels_leading.leading_verlet`.
    saved_ends, force
        Filled at the steps to save: both ends (outputs, 2, dims) [m]; force of the cable on the upper end (outputs, dims) [N],
        or without rows.
    """
    sizes, numbers, by_pattern = coefficients.sizes, coefficients.numbers, coefficients.by_pattern
    r, dims, steps = sizes[RANK], sizes[DIMS], ends.shape[1]
    kappa, projection = coefficients.by_coordinate[KAPPA], coefficients.by_coordinate[PROJECTION:]
    stiffness, length = numbers[STIFFNESS], numbers[LENGTH]
    boundary_data = np.empty((steps, 1 + PATTERNS * dims))
    load, no_points = numbers[STEADY_LOAD : STEADY_LOAD + dims].copy().reshape(dims, 1), np.empty((0, dims, 1))
    frames(ends, accelerations, load, no_points, sizes[REFERENCE], numbers[MASS], boundary_data)
    if begin == 0:
        f = np.empty(r)
        chord_tension = _chord_tension(q, boundary_data, 0, kappa, by_pattern[MEANS], stiffness, length)
        _leading_acceleration(
            q, boundary_data, 0, chord_tension, kappa, coefficients.geometric_stiffness, projection, f
        )
        for i in range(r):
            v[i] = factors[1] * rates[i] - factors[3] * f[i]
    none, no_links = np.empty(0), np.empty((PATTERNS, 0))
    leading_verlet(
        q, v, step, factors[0], factors[2], None, None, None, None, None, None, None, None, boundary_data, stiffness, length,
        kappa, by_pattern[MEANS], coefficients.geometric_stiffness, projection, by_pattern[NORMS],
        by_pattern[AT_CANDIDATES:].T.copy(), np.empty((r, 0)), sizes[IN_PLANE], no_links, begin, output_steps, saved,
        half_step_rates, none, none, monitor, np.empty((output_steps.size, 0)),
    )  # fmt: skip
    rows = np.empty((output_steps.size, boundary_data.shape[1]))
    for i in range(output_steps.size):
        k = output_steps[i] - begin
        for j in range(rows.shape[1]):
            rows[i, j] = boundary_data[k, j]
        for d in range(dims):
            saved_ends[i, 0, d], saved_ends[i, 1, d] = ends[d, k], ends[dims + d, k]
    if force.shape[0]:
        leading_end_forces(coefficients, saved, rows, saved_ends, force)
