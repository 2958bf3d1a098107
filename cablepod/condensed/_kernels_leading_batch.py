"""Compiled initial states to leading order of many members."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import frames
from cablepod.condensed._kernels_leading import leading_force, leading_rest


@compiled
def leading_starts(
    ends, end_rates, end_accelerations, load, reference, step, damping, mass, stiffness, length, kappa,
    mean_chordwise_forces, geometric_stiffness, load_projection, geometric_stiffness_norms, n_in_plane, parabola, q,
    v, limit, chord_tensions,
):  # fmt: skip
    """Compute equilibrium, initial rates and step limit of many members.

    Parameters
    ----------
    ends, end_rates, end_accelerations
        Positions, velocities and accelerations (see ``frames``) of the ends at the start (members, 2 dims, 1); the latter
        two without columns where no end moves.
    load, reference, mass, stiffness, length
        As in ``frames`` and ``leading_verlet``: (members, dims, 1), the others (members,).
    step, damping
        Step [s], 0 for the rates at the start; mass damping (members,) [1/s].
    kappa, mean_chordwise_forces, geometric_stiffness, load_projection, geometric_stiffness_norms
        As in :func:`cablepod.condensed._kernels_leading.leading_verlet`, with a leading dimension of members.
    n_in_plane
        Number of in-plane coordinates.
    parabola
        Coordinates of the parabola under unit transverse load, the first guess (members, r) [per N/m].
    q, v
        Filled: coordinates, rates half a step before the start (members, r).
    limit
        Filled: stability limit of the step at the start (members,) [s]; nan where no equilibrium is found.
    chord_tensions
        Filled: H at the start (members,) [N].
    """
    members, r = q.shape
    patterns, dims = mean_chordwise_forces.shape[1], load.shape[1]
    f, tangent, boundary_row = np.empty(r), np.empty((r, r)), np.empty((1, 1 + patterns * dims))
    static_accelerations, no_load, no_points = (
        np.zeros(end_accelerations.shape[1:]),
        np.zeros((dims, 1)),
        np.empty((0, dims, 1)),
    )
    for m in range(members):
        coefficients = (
            stiffness[m],
            length[m],
            kappa[m],
            mean_chordwise_forces[m],
            geometric_stiffness[m],
            load_projection[m],
        )
        frames(ends[m], static_accelerations, load[m], no_points, reference[m], mass[m], boundary_row)
        for i in range(r):
            q[m, i] = boundary_row[0, 1 + patterns * (1 if i < n_in_plane else 2)] * parabola[m, i]
        if not leading_rest(q[m], boundary_row, *coefficients):
            limit[m] = np.nan
            continue
        v[m] = 0.0
        if end_rates.shape[2]:
            # the particles are at rest, the chord frame moves: its velocity is projected as its acceleration is
            frames(ends[m], end_rates[m], no_load, no_points, reference[m], mass[m], boundary_row)
            for a in range(load_projection.shape[1]):
                for i in range(r):
                    v[m, i] += boundary_row[0, 1 + patterns + a] * load_projection[m, a, i]
        frames(ends[m], end_accelerations[m], load[m], no_points, reference[m], mass[m], boundary_row)
        chord_tension = leading_force(q[m], boundary_row, 0, *coefficients, f, tangent)
        chord_tensions[m] = chord_tension
        sag, load_frequency_bound = 0.0, 0.0
        for i in range(r):
            sag += (kappa[m, i] * q[m, i]) ** 2
        for a in range(patterns):
            load_frequency_bound += abs(boundary_row[0, 1 + a]) * geometric_stiffness_norms[m, a]
        limit[m] = 2.0 / math.sqrt(
            abs(chord_tension) * kappa[m].max() + load_frequency_bound + stiffness[m] / length[m] * sag
        )
        damped_growth = math.expm1(0.5 * damping[m] * step)
        impulse_back = damped_growth / damping[m] if damping[m] else 0.5 * step
        for i in range(r):
            v[m, i] = v[m, i] * (1.0 + damped_growth) - impulse_back * f[i]
