"""Compiled boundary data of the chord frame: chord length and projected loads."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled


@compiled(inline="always")
def _planar_frames(ends, second, load, points, mass, rows):
    """Do what :func:`frames` does, of the same bits, in the plane, where numbers stay in registers: in a quarter of the time."""
    moving = second.shape[1] > 0
    first_point = 3 if moving else 2
    patterns = first_point - 1 + points.shape[0]
    for i in range(rows.shape[0]):
        x, y = ends[0, i] - ends[2, i], ends[1, i] - ends[3, i]  # against the chord
        c = math.sqrt(x * x + y * y)
        inverse = 1.0 / c
        x *= inverse
        y *= inverse
        k = i if load.shape[1] > 1 else 0
        push_x, push_y = load[0, k], load[1, k]
        if moving:
            push_x -= mass * second[0, i]
            push_y -= mass * second[1, i]
            turn_x, turn_y = mass * (second[0, i] - second[2, i]), mass * (second[1, i] - second[3, i])
            rows[i, 2] = turn_x * x + turn_y * y
            rows[i, 2 + patterns] = turn_x * y - turn_y * x
        rows[i, 0] = c
        rows[i, 1] = push_x * x + push_y * y
        rows[i, 1 + patterns] = push_x * y - push_y * x
        k = i if points.shape[2] > 1 else 0
        for j in range(points.shape[0]):
            rows[i, first_point + j] = points[j, 0, k] * x + points[j, 1, k] * y
            rows[i, first_point + patterns + j] = points[j, 0, k] * y - points[j, 1, k] * x


@compiled
def frames(ends, second, load, points, reference, mass, rows):
    """Fill the rows from positions of the ends.

    Parameters
    ----------
    ends, second
        Positions and second rates of the ends, coordinate by coordinate, the lower end first (2 dims, steps) [m], [m/s^2];
        with damping by mass its rate times the rates of the ends is added to the latter.  `second` has no columns where no
        end moves.
    load, points
        Uniform load with weight (dims, steps or 1) [N/m]; point loads (loads, dims, steps or 1) [N].
    reference
        The axis to which the normal is closest, in spatial scenes.
    mass
        Per unstretched length [kg/m].
    rows
        Filled: (steps, 1 + patterns (1 + normals)).
    """
    dims, loads = load.shape[0], points.shape[0]
    if dims == 2:
        _planar_frames(ends, second, load, points, mass, rows)
        return
    moving = second.shape[1] > 0
    first_point = 3 if moving else 2
    patterns = first_point - 1 + loads
    axes = np.zeros((3, 3))  # against the chord, normal to it, across both
    push, turn = np.zeros(3), np.zeros(3)
    for i in range(rows.shape[0]):
        c = 0.0
        for d in range(dims):
            axes[0, d] = ends[d, i] - ends[dims + d, i]
            c += axes[0, d] * axes[0, d]
        c = math.sqrt(c)
        inverse = 1.0 / c
        for d in range(dims):
            axes[0, d] *= inverse
        part = axes[0, reference]
        inverse = 1.0 / math.sqrt(1.0 - part * part)
        for d in range(3):
            axes[1, d] = ((1.0 if d == reference else 0.0) - part * axes[0, d]) * inverse
        for d in range(3):
            j, k = (d + 1) % 3, (d + 2) % 3
            axes[2, d] = axes[1, j] * axes[0, k] - axes[1, k] * axes[0, j]
        k = i if load.shape[1] > 1 else 0
        for d in range(dims):
            push[d] = load[d, k]
            if moving:
                push[d] -= mass * second[d, i]
                turn[d] = mass * (second[d, i] - second[dims + d, i])
        rows[i, 0] = c
        at = 1
        for side in range(dims):
            along, growing = 0.0, 0.0
            for d in range(dims):
                along += push[d] * axes[side, d]
                growing += turn[d] * axes[side, d]
            rows[i, at] = along
            if moving:
                rows[i, at + 1] = growing
            at += patterns
        k = i if points.shape[2] > 1 else 0
        for j in range(loads):
            for side in range(dims):
                along = 0.0
                for d in range(dims):
                    along += points[j, d, k] * axes[side, d]
                rows[i, first_point + side * patterns + j] = along
