"""Compiled initial states to leading order of many members."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_frame import frames
from cablepod.condensed._kernels_layout import LeadingTerms
from cablepod.condensed._kernels_leading import leading_force, leading_rest


@compiled
def leading_starts(
    ends, end_rates, end_accelerations, load, reference, step, damping, mass, terms, norms, n_in_plane, parabola, q, v, limit,
    chord_tensions,
):  # fmt: skip
    """Compute equilibrium, initial rates and step limit of many members.

    Parameters
    ----------
    ends, end_rates, end_accelerations
        Positions, velocities and accelerations (see ``frames``) of the ends at the start (members, 2 dims, 1); the latter
        two without columns where no end moves.
    load, reference, mass
        As in ``frames``: (members, dims, 1), the others (members,).
    step, damping
        Step [s], 0 for the rates at the start; mass damping (members,) [1/s].
    terms, norms
        See :class:`cablepod.condensed._kernels_layout.LeadingTerms`, one lane each, with a leading dimension of members; spectral
        norms of the geometric stiffness (members, patterns).
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
    patterns, dims, columns = norms.shape[1], load.shape[1], 1 + norms.shape[1] * load.shape[1]
    f, first, tangent, rows, tension = np.empty(r), np.empty(r), np.empty((r, r)), np.empty((1, columns)), np.empty(1)
    static_accelerations, no_load, no_points = (
        np.zeros(end_accelerations.shape[1:]), np.zeros((dims, 1)), np.empty((0, dims, 1))
    )  # fmt: skip
    row = rows[0]
    for m in range(members):
        own = LeadingTerms(
            terms.stiffness[m], terms.inverse_length[m], terms.sag_stiffness[m], terms.kappa[m],
            terms.mean_chordwise_forces[m], terms.geometric_stiffness[m], terms.load_projection[m],
        )  # fmt: skip
        frames(ends[m], static_accelerations, load[m], no_points, reference[m], mass[m], rows)
        for i in range(r):
            q[m, i] = row[1 + patterns * (1 if i < n_in_plane else 2)] * parabola[m, i]
        if not leading_rest(own, row, q[m], first, f, tangent, tension):
            limit[m] = np.nan
            continue
        for i in range(r):
            v[m, i] = 0.0
        if end_rates.shape[2]:
            # the particles are at rest, the chord frame moves: its velocity is projected as its acceleration is
            frames(ends[m], end_rates[m], no_load, no_points, reference[m], mass[m], rows)
            for a in range(own.load_projection.size // r):
                for i in range(r):
                    v[m, i] += row[1 + patterns + a] * own.load_projection[a * r + i]
        frames(ends[m], end_accelerations[m], load[m], no_points, reference[m], mass[m], rows)
        leading_force(own, row, q[m], f, tangent, tension)
        chord_tensions[m] = tension[0]
        sag, steepest, load_frequency_bound = 0.0, 0.0, 0.0
        for i in range(r):
            sag += (own.kappa[i] * q[m, i]) ** 2
            steepest = max(steepest, own.kappa[i])
        for a in range(patterns):
            load_frequency_bound += abs(row[1 + a]) * norms[m, a]
        limit[m] = 2.0 / math.sqrt(abs(tension[0]) * steepest + load_frequency_bound + 2.0 * own.sag_stiffness[0] * sag)
        damped_growth = math.expm1(0.5 * damping[m] * step)
        impulse_back = damped_growth / damping[m] if damping[m] else 0.5 * step
        for i in range(r):
            v[m, i] = v[m, i] * (1.0 + damped_growth) - impulse_back * f[i]
