"""Rows of the work arrays and of the monitor that the condensed kernels share."""

from __future__ import annotations

import numpy as np

#: Kernels take the points of the drag in such numbers, filled up by points without weight: one vector of eight or two of four.
POINTS_IN_VECTOR = 8
# Monitor of a run: extremes over its steps, and the last two chord tensions.
MIN_FORCE, MIN_FORCE_STEP = 0, 1  #: least chordwise force [N] and number of its step
MAX_OMEGA_SQUARED, OMEGA_SQUARED_LIMIT = 2, 3  #: largest squared frequency so far, largest that the step allows [1/s^2]
UNSTABLE_STEP = 4  #: number of the first step whose frequency reached the limit; inf where none did
CHORD_TENSION, PREDICTED_TENSION = (
    5,
    6,
)  #: H of the last step, first guess of H for the next [N]; orders "exact", "inertial"
MONITOR_ROWS = 7
# Work array (CLOSURE_ROWS, m) of the closure and of the exact forces, a column for each link or quadrature point.
FORCE = 0  #: chordwise force N [N]
COMPLIANCE = 1  #: derivative of the chordwise stretch by N [1/N]
RESIDUAL = 2  #: Newton correction of the chordwise stretch at constant H
LOAD_FORCE = 3  #: chordwise force of the loads, tau = N - H [N]
WEIGHTED_STIFFNESS = 3  #: later, in place of LOAD_FORCE: weight times transverse stiffness, N / zeta'
SLOPE_SQUARED = 4  #: squared slope w'^2
CURVATURE = 5  #: half the second derivative of the law over its first
CLOSURE_ROWS = 6
# Work array (LINK_ROWS, n) of the link tensions to leading order.
SLOPE_IN_PLANE, SLOPE_OUT_OF_PLANE = 0, 1  #: slope of the deflection
LINK_FORCE = 2  #: chordwise force N [N]
LINK_ROWS = 3
# Numbers of a member in a lane (MEMBER_ROWS, lanes).
STIFFNESS, LENGTH, MASS = 0, 1, 2  #: K [N], L0 [m], mass per length [kg/m]
SAG_STIFFNESS, KAPPA_MAX = 3, 4  #: K / 2 L0 [N/m], largest squared slope norm [1/(kg m)]
INVERSE_LENGTH = 5  #: 1 / L0 [1/m]
UNIFORM, SAG = 6, 7  #: the squared slopes have the factor uniform + sag times the profile of those at rest
DAMPING_FACTOR, IMPULSE = 8, 9  #: factor of the rates by damping over a step, rate gained for unit acceleration [s]
MEMBER_ROWS = 10


def initial_monitor(omega_squared_limit: float, chord_tension: float) -> np.ndarray:
    """Return the monitor (MONITOR_ROWS,) before the first step, for a limit [1/s^2] and the initial H [N]."""
    monitor = np.zeros(MONITOR_ROWS)
    monitor[MIN_FORCE] = monitor[UNSTABLE_STEP] = np.inf
    monitor[OMEGA_SQUARED_LIMIT] = omega_squared_limit
    monitor[CHORD_TENSION] = monitor[PREDICTED_TENSION] = chord_tension
    return monitor
