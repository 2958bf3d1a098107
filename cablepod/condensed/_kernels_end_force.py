"""Compiled force of the cable on its upper end, from moments of the load.

Tangential and normal force are N(L0) = H + tau(L0) and V.  The balance of moments about the lower end gives V,

    c V = integral of N w' - h_0 integral of zeta + c (sum of m_i F_i - h_1 integral of sigma^2)

with the chord c, the loads h_0 + h_1 sigma along the normal, the moments m_i = integral of mu sigma phi_i of the shapes and their
accelerations F_i.  No slope of a mode at the end is in it: few modes give slopes badly.
"""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import _complete_axes
from cablepod.condensed._kernels_host_layout import (
    ARMS,
    AT_END,
    DIMS,
    FIRST_TRIBUTARY,
    IN_PLANE,
    KAPPA,
    LENGTH,
    MEANS,
    MOMENTS,
    PATTERNS,
    PROJECTION,
    RANK,
    REACH_LOADS,
    REACH_MOMENT,
    REFERENCE,
    SECOND_MOMENT,
    SLOPE_MOMENTS,
    SLOPES,
    STIFFNESS,
    WEIGHTS,
)
from cablepod.condensed._kernels_leading import _chord_tension, _leading_acceleration


@compiled(inline="always")
def _end_force(coefficients, f, boundary_data, row, along_force, first, second, reach, axes, force):
    """Fill the force of the cable on the upper end (dims,) [N].

    Parameters
    ----------
    coefficients, f
        See :class:`cablepod.condensed._kernels_host_layout.HostCoefficients`; undamped accelerations (r,).
    boundary_data, row
        See :func:`cablepod.condensed._kernels_frame.frames`; index of the row.
    along_force
        N(L0) [N].
    first, second
        Integrals of N w' along both normals [N m].
    reach
        Integral of zeta [m^2].
    axes, force
        Direction from the upper end to the lower one and normals (dims, dims); filled (dims,).
    """
    sizes, numbers, moments = coefficients.sizes, coefficients.numbers, coefficients.by_coordinate[MOMENTS]
    r, dims, n_in_plane = sizes[RANK], sizes[DIMS], sizes[IN_PLANE]
    inverse = 1.0 / boundary_data[row, 0]
    for d in range(dims):
        force[d] = along_force * axes[0, d]
    for k in range(dims - 1):
        uniform, growing = boundary_data[row, 1 + PATTERNS * (1 + k)], boundary_data[row, 2 + PATTERNS * (1 + k)]
        transverse = ((first if k == 0 else second) - uniform * reach) * inverse - growing * numbers[SECOND_MOMENT]
        for i in range(0 if k == 0 else n_in_plane, n_in_plane if k == 0 else r):
            transverse += moments[i] * f[i]
        for d in range(dims):
            force[d] -= transverse * axes[1 + k, d]


@compiled(inline="always")
def _leading_end_force(coefficients, q, f, boundary_data, row, chord_tension, axes, force):
    """Fill the force of the cable on the upper end (dims,) [N] to leading order; see :func:`_end_force`."""
    numbers, by_pattern = coefficients.numbers, coefficients.by_pattern
    kappa, uniform_stiffness = coefficients.by_coordinate[KAPPA], coefficients.geometric_stiffness[0]
    r, n_in_plane = coefficients.sizes[RANK], coefficients.sizes[IN_PLANE]
    beyond, compliance = numbers[LENGTH] - numbers[FIRST_TRIBUTARY], 1.0 / numbers[STIFFNESS]
    along, first, second = chord_tension, 0.0, 0.0
    reach = numbers[REACH_MOMENT] * (1.0 + chord_tension * compliance)
    for a in range(PATTERNS):
        g = boundary_data[row, 1 + a]
        along += g * by_pattern[AT_END, a]
        reach += g * by_pattern[REACH_LOADS, a] * compliance
        for i in range(n_in_plane):
            first += g * coefficients.by_coordinate[SLOPE_MOMENTS + a, i] * q[i]
        for i in range(n_in_plane, r):
            second += g * coefficients.by_coordinate[SLOPE_MOMENTS + a, i] * q[i]
    for i in range(r):
        total = beyond * kappa[i] * q[i]
        for j in range(r):
            total -= uniform_stiffness[i, j] * q[j]
        reach -= 0.5 * total * q[i]
    _end_force(coefficients, f, boundary_data, row, along, first, second, reach, axes, force)


@compiled
def leading_end_forces(coefficients, q, boundary_data, ends, force):
    """Fill the forces of the cable on the upper end (times, dims) [N] of a run to leading order, inertia included.

    Parameters
    ----------
    coefficients
        See :class:`cablepod.condensed._kernels_host_layout.HostCoefficients`; the lower end is that of `ends`.
    q, boundary_data
        Coordinates (times, r); rows of :func:`cablepod.condensed._kernels_frame.frames` at the same instants.
    ends
        Positions of the ends (times, 2, dims) [m].
    force
        Filled.
    """
    r, dims, by_pattern = coefficients.sizes[RANK], coefficients.sizes[DIMS], coefficients.by_pattern
    kappa, projection = coefficients.by_coordinate[KAPPA], coefficients.by_coordinate[PROJECTION:]
    stiffness, length = coefficients.numbers[STIFFNESS], coefficients.numbers[LENGTH]
    f, axes = np.empty(r), np.empty((3, 3))
    for i in range(q.shape[0]):
        for d in range(dims):
            axes[0, d] = ends[i, 0, d] - ends[i, 1, d]
        _complete_axes(axes, dims, coefficients.sizes[REFERENCE])
        chord_tension = _chord_tension(q[i], boundary_data, i, kappa, by_pattern[MEANS], stiffness, length)
        _leading_acceleration(
            q[i], boundary_data, i, chord_tension, kappa, coefficients.geometric_stiffness, projection, f
        )
        _leading_end_force(coefficients, q[i], f, boundary_data, i, chord_tension, axes, force[i])


@compiled
def exact_end_forces(coefficients, stretch, chordwise_force, slopes, boundary_data, ends, force):
    """Fill the same forces of a run with the exact chordwise stretch.

    Parameters
    ----------
    stretch, chordwise_force, slopes
        Of the links: chordwise stretch, N [N] (times, n), slopes of the deflections (normals, times, n).
    coefficients, boundary_data, ends, force
        As in :func:`leading_end_forces`.
    """
    r, dims, n_in_plane = coefficients.sizes[RANK], coefficients.sizes[DIMS], coefficients.sizes[IN_PLANE]
    by_point, projection = coefficients.by_point, coefficients.by_coordinate[PROJECTION:]
    f, axes, integrals = np.empty(r), np.empty((3, 3)), np.zeros(2)
    for i in range(stretch.shape[0]):
        for d in range(dims):
            axes[0, d] = ends[i, 0, d] - ends[i, 1, d]
        _complete_axes(axes, dims, coefficients.sizes[REFERENCE])
        along, reach = chordwise_force[i, 0], 0.0
        for a in range(PATTERNS):
            along += boundary_data[i, 1 + a] * coefficients.by_pattern[AT_END, a]
        for j in range(r):
            k, total = (0 if j < n_in_plane else 1), 0.0
            for m in range(stretch.shape[1]):
                total += (
                    by_point[WEIGHTS, m]
                    * chordwise_force[i, m]
                    / stretch[i, m]
                    * by_point[SLOPES + j, m]
                    * slopes[k, i, m]
                )
            f[j] = -total
            for a in range(projection.shape[0]):
                f[j] += boundary_data[i, 1 + PATTERNS + a] * projection[a, j]
        for k in range(dims - 1):
            integrals[k] = 0.0
            for m in range(stretch.shape[1]):
                integrals[k] += by_point[WEIGHTS, m] * chordwise_force[i, m] * slopes[k, i, m]
        for m in range(stretch.shape[1]):
            reach += by_point[WEIGHTS, m] * by_point[ARMS, m] * stretch[i, m]
        _end_force(coefficients, f, boundary_data, i, along, integrals[0], integrals[1], reach, axes, force[i])
