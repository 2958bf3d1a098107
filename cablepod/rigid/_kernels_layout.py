"""Rows of the state array of the rigid links, energy account and status of a run.

Column j is particle j, or link j between the particles j and j + 1.  Vectors take three rows.
"""

import numpy as np

X, V = 0, 3  #: positions [m], velocities [m/s]
E = 6  #: link vectors over their lengths at X
NX, N = 9, 12  #: new positions [m], and their link vectors over lengths
BASE = 15  #: positions before the constraint forces act [m]
HALF = 18  #: velocities between two steps, or at a stage [m/s]
FORCE = 21  #: T e of link j in column j + 1, so that a particle lies between its two links; columns 0 and n + 1 are 0
LOAD = 24  #: accelerations by the loads [m/s2], 0 at held ends
STEADY = 27  #: accelerations by the constant loads [m/s2]; only with time-dependent loads
ACCELERATION = 30  #: [m/s2]
SUM_X, SUM_V = 33, 36  #: sums over the stages of the Runge-Kutta scheme; displacements in a step of RATTLE
INVERSE_MASS, MASS = 39, 40  #: [1/kg], [kg]; both 0 at held ends, which take no part in the energy
LENGTH, INVERSE_LENGTH = 41, 42  #: of the links [m], [1/m]
T, T_BEFORE = 43, 44  #: multipliers of the last step and of the one before [N]
RIGHT, CORRECTION, PIVOT = 45, 46, 47  #: right side, solution and elimination factors of the tridiagonal systems
LOW, HIGH = 48, 49  #: extremes of the tensions [N]
ROWS = 50
# Energy account of a run [J], with other units where given.
KINETIC, LOADS, ENDS, LOST = range(4)  #: kinetic energy; work of the loads, of the ends; energy dissipated by damping
#: Maximum magnitudes so far: of the balance, which should be 0, of kinetic energy and of both works.
BALANCE, MAX_KINETIC, MAX_LOADS, MAX_ENDS = range(4, 8)
LENGTH_ERROR, ITERATIONS = 8, 9  #: maximum relative length error [1]; number of Newton iterations [1]
FIRST_KINETIC, FLOOR = 10, 11  #: kinetic energy at the start; imbalance that never stops a run
MAX_ROTATION_SQUARED = 12  #: square of the maximum rotation rate of a link [1/s2]
COUNTS = 13
DONE, NOT_CONVERGED, SINGULAR, OUT_OF_BALANCE = range(4)  #: status of a step


def new_state(links):
    """Allocate a state of zeros (ROWS, at least links + 2), with an odd number of cache lines per row."""
    return np.zeros((ROWS, 8 * ((links + 9) // 8 | 1)))
