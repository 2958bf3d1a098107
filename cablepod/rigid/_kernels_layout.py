"""Rows of the state array of the rigid links, and states of a run."""

from __future__ import annotations

# without the interpreter lock, so that runs in several threads go on side by side
# Rows of the state; column j is particle j, or link j, which is between the particles j and j + 1.  Vectors take three rows.
X, V = 0, 3  #: positions [m], velocities [m/s]
E = 6  #: link vectors over their lengths at X
NX, N = 9, 12  #: positions that are looked for [m], and their link vectors over lengths
BASE = 15  #: positions before the constraint acts [m]
HALF = 18  #: velocities between two steps, or at a stage [m/s]
FORCE = 21  #: T e of link j in column j + 1, so that a particle is between its two; columns 0 and n + 1 are 0
DRIVE = 24  #: accelerations by the loads [m/s2], 0 at held ends
STEADY = 27  #: the part of the drive that is constant [m/s2]; only with loads that vary in time
ACCELERATION = 30  #: [m/s2]
SUM_X, SUM_V = 33, 36  #: sums over the stages of the Runge-Kutta scheme
INVERSE_MASS, MASS = 39, 40  #: [1/kg], 0 at held ends, where the mass is 0 too, as it takes no part in the energy
LENGTH, INVERSE_LENGTH = 41, 42  #: of the links [m], [1/m]
T, T_BEFORE = 43, 44  #: multipliers of the last step and of the one before [N]
RIGHT, CORRECTION, PIVOT = 45, 46, 47  #: of the tridiagonal systems
LOW, HIGH = 48, 49  #: extremes of the tensions [N]
ROWS = 50
# What a run keeps count of [J] but where it says otherwise.
KINETIC, LOADS, ENDS, LOST = range(4)  #: energy of the particles; work of the loads, of the ends; taken by damping
BALANCE, MOST_KINETIC, MOST_LOADS, MOST_ENDS = range(4, 8)  #: largest sizes so far; the balance should be 0
LENGTH_ERROR, ITERATIONS = 8, 9  #: largest relative one; number of Newton's method
FIRST_KINETIC, FLOOR = 10, 11  #: energy at the start; an imbalance that nobody need mind
TURN = 12  #: square of the largest rate at which a link has turned [1/s2]
COUNTS = 13
DONE, NOT_CONVERGED, SINGULAR, BROKEN = range(4)  #: how a step went
