"""Compiled fields of a condensed trajectory: deflections, chordwise stretch to leading order, positions."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FUSED, REORDERED_FUSED, compiled
from cablepod.condensed._kernels_frame import _complete_axes


@compiled(fastmath=FUSED)
def deflections(q, shapes, n_in_plane, length, deflection, squared):
    """Sum the shapes to deflections w = q . shapes, and their squared slopes w'^2.

    Parameters
    ----------
    q
        Coordinates (times, r).
    shapes, n_in_plane
        Mass-orthonormal shapes (r, n + 1), and the number of those in the plane, which come first.
    length
        Unstretched lengths of the links (n,) [m].
    deflection, squared
        Filled: deflections (normals, times, n + 1) [m]; squared slopes, summed over the normals (times, n).
    """
    for i in range(q.shape[0]):
        for plane in range(deflection.shape[0]):
            w = deflection[plane, i]
            w[:] = 0.0
            begin, end = (0, n_in_plane) if plane == 0 else (n_in_plane, q.shape[1])
            for k in range(begin, end):
                amplitude = q[i, k]
                for j in range(w.size):
                    w[j] += amplitude * shapes[k, j]
            for j in range(length.size):
                slope = (w[j + 1] - w[j]) / length[j]
                squared[i, j] = slope * slope + (0.0 if plane == 0 else squared[i, j])


@compiled(fastmath=FUSED)
def project_on_normals(by_axis, normals, n_in_plane, coordinates):
    """Sum the parts of coordinates by each axis: c_i = sum over axes of part_i times that component of the normal of i.

    Parameters
    ----------
    by_axis
        Parts of the coordinates (derivatives, times, dims, r).
    normals, n_in_plane
        Normals (times, dims - 1, dims), and the number of coordinates along the first of them, which come first.
    coordinates
        Filled: (derivatives, times, r).
    """
    for derivative in range(by_axis.shape[0]):
        for i in range(by_axis.shape[1]):
            for j in range(by_axis.shape[3]):
                k, total = 0 if j < n_in_plane else 1, 0.0
                for axis in range(by_axis.shape[2]):
                    total += by_axis[derivative, i, axis, j] * normals[i, k, axis]
                coordinates[derivative, i, j] = total


@compiled(fastmath=FUSED)
def distances_along_chord(position, closed, along, squares):
    """Fill the mean square distances of particles from other positions (times,) [m^2]; infinite where they run back.

    Parameters
    ----------
    position, closed
        Positions (times, particle, dims) [m].
    along
        Directions along the chord (times, dims).
    squares
        Filled.
    """
    count, particles, dims = position.shape
    for i in range(count):
        total, ordered = 0.0, True
        for j in range(particles):
            advance = 0.0
            for d in range(dims):
                distance = closed[i, j, d] - position[i, j, d]
                total += distance * distance
                if j > 0:
                    advance += (position[i, j, d] - position[i, j - 1, d]) * along[i, d]
            if j > 0 and not advance > 0.0:
                ordered = False
        squares[i] = total / particles if ordered else np.inf


@compiled(fastmath=FUSED)
def largest_motion(q, stride, ends, mass, normals, of_lower, of_upper):
    """Return the largest mean square displacement from the start: of the line between the ends and of the deflection [m^2].

    With displacements a and b of the ends and changes d of the coordinates it is (a.a + a.b + b.b) / 3 plus the sums of
    2 d (a.n u + b.n v) and of d^2 over the mass.

    Parameters
    ----------
    q, stride
        Coordinates (samples, r), and the number of samples from one that counts to the next.
    ends
        Positions of the ends at the samples that count (counting, 2, dims) [m]; none where no end moves.
    mass
        Mass of the cable [kg].
    normals, of_lower, of_upper
        Normal of each coordinate (r, dims); means u and v of its shape times 1 - sigma and sigma (r,) [kg^-1/2].
    """
    largest = 0.0
    for k in range((q.shape[0] + stride - 1) // stride):
        square = 0.0
        for j in range(q.shape[1]):
            change = q[k * stride, j] - q[0, j]
            square += change * change / mass
        if ends.shape[0]:
            for d in range(ends.shape[2]):
                lower, upper = ends[k, 0, d] - ends[0, 0, d], ends[k, 1, d] - ends[0, 1, d]
                square += ((lower + upper) * lower + upper * upper) / 3.0
                for j in range(q.shape[1]):
                    change = q[k * stride, j] - q[0, j]
                    square += 2.0 * change * normals[j, d] * (lower * of_lower[j] + upper * of_upper[j])
        largest = max(largest, square)
    return largest


@compiled(fastmath=REORDERED_FUSED)
def close_leading(squared, tau, length, chord, stiffness, chord_tension, stretch):
    """Close the chord to leading order: zeta' = 1 + (H + tau) / K - w'^2 / 2, whose integral is the chord.

    Parameters
    ----------
    squared, tau
        Squared slopes, and chordwise forces of the loads [N] (times, n).
    length, chord, stiffness
        Unstretched lengths of the links (n,) [m], distance of the ends (times,) [m], axial stiffness K [N].
    chord_tension, stretch
        Filled: H (times,) [N] and chordwise stretch zeta' (times, n).
    """
    total = 0.0
    for j in range(length.size):
        total += length[j]
    for i in range(chord.size):
        sag, mean = 0.0, 0.0
        for j in range(length.size):
            sag += squared[i, j] * length[j]
            mean += tau[i, j] * length[j]
        chord_tension[i] = stiffness * (chord[i] / total - 1.0 + 0.5 * sag / total) - mean / total
        for j in range(length.size):
            stretch[i, j] = 1.0 + (chord_tension[i] + tau[i, j]) / stiffness - 0.5 * squared[i, j]


@compiled(fastmath=FUSED)
def positions(ends, reference, largest_cosine, stretch, length, deflection, position):
    """Place the particles in the chord frame: x = x_lower + zeta e + w n, with zeta the sum of stretched lengths.

    The frames are those of :class:`cablepod.discretisation._chord_frame.ChordFrame`.

    Parameters
    ----------
    ends
        Positions of the ends (times, 2, dims) [m].
    reference, largest_cosine
        Axis that defines the first normal in space, and largest cosine between it and the chord.
    stretch, length
        Chordwise stretch (times, n) and unstretched lengths (n,) [m] of the links.
    deflection
        Deflections (normals, times, n + 1) [m].
    position
        Filled: positions (times, n + 1, dims) [m].

    Returns
    -------
    bool
        Whether there is a frame at all instants: the ends do not meet, and in space the chord stays away from the reference.
    """
    count, particles, dims = position.shape
    axes = np.zeros((3, 3))  # direction from the upper end to the lower one, first and second normal
    for i in range(count):
        chord = 0.0
        for d in range(dims):
            axes[0, d] = ends[i, 0, d] - ends[i, 1, d]
            chord += axes[0, d] * axes[0, d]
        chord = math.sqrt(chord)
        if not chord > 0.0 or (dims == 3 and abs(axes[0, reference]) >= largest_cosine * chord):
            return False
        _complete_axes(axes, dims, reference)
        along = 0.0
        for j in range(particles - 1):
            for d in range(dims):
                place = ends[i, 0, d] - along * axes[0, d]
                for plane in range(deflection.shape[0]):
                    place += deflection[plane, i, j] * axes[1 + plane, d]
                position[i, j, d] = place
            along += stretch[i, j] * length[j]
        for d in range(dims):  # free of rounding, and of modes that are not exactly zero there
            position[i, particles - 1, d] = ends[i, 1, d]
    return True
