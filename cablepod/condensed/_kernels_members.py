"""Compiled loops over members for what follows a run to leading order: error equations, positions and tensions.

Each member calls the kernels of a single run, so that its numbers are those of its run alone.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_error import error_at_rest, error_growth, exact_differences
from cablepod.condensed._kernels_fields import close_leading, deflections, positions
from cablepod.condensed._kernels_frame import frames
from cablepod.condensed._kernels_layout import ErrorTerms, LeadingTerms
from cablepod.condensed._kernels_recorder import link_tensions


@compiled
def errors_of_members(rest, motions, boundary_data, step, terms, work, drive, vectors, mean_squares, largest):
    """Integrate the error equations of many members, see :mod:`cablepod.condensed._kernels_error`.

    Parameters
    ----------
    rest
        Coordinates at rest (members, r); then, as ``frames`` takes them, with a leading dimension of members: ends at rest, zero
        accelerations of the ends (2 dims, 1 or 0), which members share, load with weight, axis of the normals, mass per length.
    motions
        Coordinates (members, samples, r), rates half a step before and after (members, samples, 2, r), steps per second.
    boundary_data
        Those of the samples (members, samples, columns).
    step
        Interval of the samples [s].
    terms
        Coefficients with a leading dimension of members, see :func:`cablepod.condensed._error_equation.scaled_terms`.
    work, drive, vectors
        Work arrays: those of :func:`exact_differences`, what it fills, and vectors of the error (members, 7, R), of which row 1
        holds the rate of the error at the start.
    mean_squares, largest
        Filled: as there, (members, samples) and (members, R + 1).
    """
    q, half_step_rates, steps_per_second = motions
    samples, r = q.shape[1], q.shape[2]
    rest_q, ends, no_accelerations, load, reference, mass = rest
    rates, accelerations, still = np.empty((samples, r)), np.empty((samples, r)), np.zeros((1, r))
    size, row, no_points = vectors.shape[2], np.empty((1, boundary_data.shape[2])), np.empty((0, load.shape[1], 1))
    tangent, tension, at_rest = np.empty((size, size)), np.empty(1), np.empty((3, size))
    y, difference, change, largest_force = drive
    for m in range(q.shape[0]):
        of_enriched = terms.enriched
        enriched = LeadingTerms(
            of_enriched.stiffness[m], of_enriched.inverse_length[m], of_enriched.sag_stiffness[m], of_enriched.kappa[m],
            of_enriched.mean_chordwise_forces[m], of_enriched.geometric_stiffness[m], of_enriched.load_projection[m],
        )  # fmt: skip
        own = ErrorTerms(
            terms.sizes, enriched, terms.change[m], terms.weights[m], terms.force_patterns[m], terms.slopes_of_motion[m],
            terms.slopes[m], terms.in_plane, terms.enriched_in_plane, terms.inertia[m], terms.damping[m], terms.green,
            terms.leading, terms.corrections,
        )  # fmt: skip
        frames(ends[m], no_accelerations, load[m], no_points, reference[m], mass[m], row)
        exact_differences(own, row, rest_q[m : m + 1], still, still, work, y, difference, change, largest_force)
        found = error_at_rest(
            enriched, terms.leading, row[0], y[0], difference[0], change[0], at_rest, tangent, tension
        )
        for i in range(size):
            vectors[m, 0, i] = at_rest[0, i] if found else 0.0
        for t in range(samples):
            for j in range(r):
                rates[t, j] = 0.5 * (half_step_rates[m, t, 0, j] + half_step_rates[m, t, 1, j])
                accelerations[t, j] = (half_step_rates[m, t, 1, j] - half_step_rates[m, t, 0, j]) * steps_per_second
        exact_differences(own, boundary_data[m], q[m], rates, accelerations, work, y, difference, change, largest_force)
        error_growth(
            terms.sizes, enriched, terms.leading, own.damping, step, boundary_data[m], y, difference, change, largest_force,
            vectors[m], mean_squares[m], largest[m],
        )  # fmt: skip


@compiled
def tensions_of_members(terms, boundary_data, q, slopes, in_plane, force_patterns, rows, tension):
    """Fill the tensions of links of many members, see :func:`cablepod.condensed._kernels_recorder.link_tensions`.

    All arrays have a leading dimension of members; those of `tension` (rows, times, links) are `rows` (members,).
    """
    for m in range(q.shape[0]):
        own = LeadingTerms(
            terms.stiffness[m], terms.inverse_length[m], terms.sag_stiffness[m], terms.kappa[m],
            terms.mean_chordwise_forces[m], terms.geometric_stiffness[m], terms.load_projection[m],
        )  # fmt: skip
        link_tensions(own, boundary_data[m], q[m], slopes[m], in_plane, force_patterns[m], tension[rows[m]])


@compiled
def fields_of_members(
    q, ends, accelerations, load, reference, largest_cosine, mass, stiffness, lengths, shapes, n_in_plane, patterns,
    slope_factors, links, rows, position, tension, has_frames,
):  # fmt: skip
    """Compute positions and tensions of many members, as ``close_chord`` and ``positions_of`` do for one.

    Parameters
    ----------
    q
        Coordinates (members, times, r).
    ends, accelerations
        Positions and accelerations of the ends, all coordinates of the lower one first (members, 2 dims, times) [m, m/s^2]; the
        latter without times where no end moves.
    load, reference, mass, stiffness
        Load with weight (members, dims, 1) [N/m], axis of the normals, mass per length [kg/m] and K [N] (members,).
    largest_cosine
        See :func:`cablepod.condensed._kernels_fields.positions`.
    lengths
        Unstretched lengths of the links (members, n) [m].
    shapes, n_in_plane
        Shapes (members, r, n + 1), and the number of those in the plane.
    patterns
        Chordwise force patterns (members, patterns, n).
    slope_factors
        Factors of the squared slopes (members, n).
    links
        Links whose tensions are computed (links,).
    rows
        Row of each member in the following two arrays (members,).
    position, tension
        Filled: positions (rows, times, n + 1, dims) [m] and tensions (rows, times, links) [N], or without times.
    has_frames
        Filled: whether there is a chord frame at all instants (members,); true without positions.
    """
    (members, times, _), dims = q.shape, load.shape[1]
    links_of_chain = lengths.shape[1]
    deflection, squared = np.empty((dims - 1, times, links_of_chain + 1)), np.empty((times, links_of_chain))
    reduced, tau, stretch = np.empty_like(squared), np.empty_like(squared), np.empty_like(squared)
    boundary_data = np.empty((times, 1 + patterns.shape[1] * dims))
    chord, chord_tension = np.empty(times), np.empty(times)
    both_ends, no_points = np.empty((times, 2, dims)), np.empty((0, dims, 1))
    for m in range(members):
        frames(ends[m], accelerations[m], load[m], no_points, reference[m], mass[m], boundary_data)
        deflections(q[m], shapes[m], n_in_plane, lengths[m], deflection, squared)
        for t in range(times):
            chord[t] = boundary_data[t, 0]
            for j in range(links_of_chain):
                reduced[t, j] = squared[t, j] * slope_factors[m, j]
                tau[t, j] = 0.0
                for a in range(patterns.shape[1]):
                    tau[t, j] += boundary_data[t, 1 + a] * patterns[m, a, j]
        close_leading(reduced, tau, lengths[m], chord, stiffness[m], chord_tension, stretch)
        has_frames[m] = True
        if position.shape[1]:
            for t in range(times):
                for end in range(2):
                    for d in range(dims):
                        both_ends[t, end, d] = ends[m, end * dims + d, t]
            has_frames[m] = positions(
                both_ends, reference[m], largest_cosine, stretch, lengths[m], deflection, position[rows[m]]
            )
        for t in range(tension.shape[1]):
            for k in range(links.size):
                j = links[k]
                tension[rows[m], t, k] = (chord_tension[t] + tau[t, j]) * math.sqrt(1.0 + squared[t, j])
