"""Rows and entries of the arrays of a prepared model, for the kernels and for compiled hosts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cablepod.condensed._kernels_layout import CLOSURE_ROWS

#: Status of a step.
(
    DONE, INVALID_NUMBER, INVALID_STEP, CHORD_OUT_OF_RANGE, CHORD_ALONG_AXIS, STEP_ABOVE_LIMIT, NO_EQUILIBRIUM, STIFFENED,
    DIVERGED, CHORD_REVERSED,
) = range(10)  # fmt: skip
#: Number of load patterns: uniform, and growing with sigma.
PATTERNS = 2
# Entries of `sizes`.
RANK, DIMS, IN_PLANE, REFERENCE = range(4)
# Entries of `numbers`.
STIFFNESS, LENGTH, MASS, DAMPING = 0, 1, 2, 3  #: K [N], L0 [m], mass per length [kg/m], mass-proportional damping [1/s]
FIRST_TRIBUTARY = 4  #: length carried by the lower end [m]
SECOND_MOMENT = 5  #: integral of sigma^2 [m]
REACH_MOMENT = 6  #: integral of L0 - S [m^2]
SHORTEST, LONGEST, ALONG_AXIS = 7, 8, 9  #: bounds of the chord [m], of its cosine with the reference axis
DIVERGED_ABOVE = 10  #: bound of the coordinates [kg^1/2 m]
LOWER, STEADY_LOAD, END_MASS = 11, 14, 17  #: (3,): lower end [m]; load [N/m]; end mass along chord and normals [kg]
NUMBERS = 20
# Rows of `by_coordinate` (rows, r), `by_pattern` (rows, patterns) and `by_point` (rows, m).
KAPPA, MOMENTS, SLOPE_MOMENTS, PROJECTION = 0, 1, 2, 4
MEANS, NORMS, AT_END, REACH_LOADS, AT_CANDIDATES = 0, 1, 2, 3, 4
WEIGHTS, ARMS, FORCES, SLOPES = 0, 1, 2, 4
# Rows of a state, and entries of its first one.
CLOCK, MONITOR, END, VELOCITY, MEAN_VELOCITY, VELOCITY_SLOPE, BOUNDARY, END_FORCE, Q, RATES, UNDAMPED = range(11)
PREDICTED_STRETCH, LAST_STRETCH, AXES, LEADING_ROWS = 11, 12, 13, 16
# Rows that states of order "exact" have beside these: arrays of the closure, and slopes of both deflections.  A step that made
# them anew would take a quarter longer.
WORK, SLOPE = LEADING_ROWS, LEADING_ROWS + CLOSURE_ROWS
EXACT_ROWS = SLOPE + 2
#: Rows that states in wind have beyond these: rates at the end of a step, moments of the drag, and the air in the chord frame
#: (dims rows), with as many for the slopes at its points.
AIR_RATES, AIR_MOMENTS, AIR_VELOCITY = 0, 1, 2
TIME, STEP, COUNT, BETWEEN, FACTOR, IMPULSE = range(6)


class HostAir(NamedTuple):
    """Air along a cable, for the steps of a host."""

    velocity: np.ndarray  #: of the air, from time 0 on, linear between the samples (samples, dims, points) [m/s]
    samples_per_second: float  #: [1/s]
    drag: (
        np.ndarray
    )  #: quadrature weights [m] times half the density of the air, drag coefficient and diameter (points,)
    sigma: np.ndarray  #: relative arc lengths of the points (points,)
    shapes: np.ndarray  #: shapes and slopes at the points (2, r, points)


class HostCoefficients(NamedTuple):
    """Coefficients of a prepared model, with the rows and entries that the constants of this file name."""

    sizes: np.ndarray
    numbers: np.ndarray
    geometric_stiffness: np.ndarray  #: (patterns, r, r) [1/kg]
    by_coordinate: np.ndarray
    by_pattern: np.ndarray
    by_point: np.ndarray  #: (rows, m); without columns to leading order
    air: HostAir | None = None  #: None for still air
