"""Compiled sums over the particles for deflections of other models: parts by each axis, distances along the chord."""

from __future__ import annotations

import numpy as np

from cablepod._jit import FUSED, compiled


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
