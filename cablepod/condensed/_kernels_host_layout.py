"""Rows and entries of the arrays of a prepared model, for the kernels and for compiled hosts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cablepod.condensed._kernels_layout import MONITOR_ROWS

#: Status of a step.
(
    DONE, INVALID_NUMBER, INVALID_STEP, CHORD_OUT_OF_RANGE, CHORD_ALONG_AXIS, STEP_ABOVE_LIMIT, NO_EQUILIBRIUM, STIFFENED,
    DIVERGED, CHORD_REVERSED,
) = range(10)  # fmt: skip
#: Number of load patterns: uniform, and growing with sigma.
PATTERNS = 2
# Entries of `sizes`.
RANK, DIMS, IN_PLANE = range(3)
# Entries of `numbers`.
STIFFNESS, LENGTH, MASS, DAMPING = 0, 1, 2, 3  #: K [N], L0 [m], mass per length [kg/m], mass-proportional damping [1/s]
INVERSE_LENGTH, SAG_STIFFNESS = 4, 5  #: 1 / L0 [1/m], K / 2 L0 [N/m]
FIRST_TRIBUTARY = 6  #: length carried by the lower end [m]
SECOND_MOMENT = 7  #: integral of sigma^2 [m]
REACH_MOMENT = 8  #: integral of L0 - S [m^2]
SHORTEST, LONGEST, ALONG_AXIS = 9, 10, 11  #: bounds of the chord [m], of its cosine with the first normal at the start
DIVERGED_ABOVE = 12  #: bound of the coordinates [kg^1/2 m]
LOWER, STEADY_LOAD, END_MASS = 13, 16, 19  #: (3,): lower end [m]; load [N/m]; end mass along chord and normals [kg]
FIRST_NORMAL = 22  #: (3,): at the start
NUMBERS = 25
# Rows of `by_coordinate` (rows, r) and `by_pattern` (rows, patterns).
KAPPA, MOMENTS, SLOPE_MOMENTS = 0, 1, 2
MEANS, NORMS, AT_END, REACH_LOADS, AT_CANDIDATES = 0, 1, 2, 3, 4
# Rows of a state.
CLOCK, MONITOR, END, VELOCITY, MEAN_VELOCITY, VELOCITY_SLOPE, BOUNDARY, END_FORCE, Q, RATES, UNDAMPED, AXES = range(12)
ROWS = AXES + 3
#: Rows that states in wind have beyond these: rates at the end of a step, moments of the drag, and the air in the chord frame
#: (dims rows), with as many for the slopes at its points.
AIR_RATES, AIR_MOMENTS, AIR_VELOCITY = ROWS, ROWS + 1, ROWS + 2
# Entries of the first row of a state; least chordwise force of the step [N], after the monitor.
TIME, STEP, COUNT, BETWEEN, FACTOR, IMPULSE = range(6)
LEAST_FORCE = MONITOR_ROWS


class HostAir(NamedTuple):
    """Air along a cable, for the steps of a host."""

    velocity: np.ndarray  #: of the air, from time 0 on, linear between the samples (samples, dims, points) [m/s]
    samples_per_second: float  #: [1/s]
    #: quadrature weights [m] times half the density of the air, drag coefficient and diameter (points,)
    drag: np.ndarray
    sigma: np.ndarray  #: relative arc lengths of the points (points,)
    shapes: np.ndarray  #: shapes and slopes at the points (2, r, points)


class HostCoefficients(NamedTuple):
    """Coefficients of a prepared model, with the rows and entries that the constants of this file name.

    The kernels make named terms of them: each array that Python passes to a kernel takes a tenth of a microsecond.
    """

    sizes: np.ndarray
    numbers: np.ndarray
    geometric_stiffness: np.ndarray  #: (patterns r r) [1/kg]
    load_projection: np.ndarray  #: of unit loads along the normals (normals patterns r) [kg^-1/2 m]
    by_coordinate: np.ndarray
    by_pattern: np.ndarray
    air: HostAir | None = None  #: None for still air
