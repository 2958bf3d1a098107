"""Rows of the state array of the explicit chain.

Column j is particle j, or link j between the particles j and j + 1.
"""

from __future__ import annotations

X, Y, Z = range(3)  #: positions [m]
VX, VY, VZ = range(3, 6)  #: velocities half a step before [m/s]; 0 at held ends
#: Forces of the links [N]; that of link j in column j + 1, so that a particle lies between its two links.
FX, FY, FZ = range(6, 9)
STIFFNESS, LENGTH, INVERSE = range(9, 12)  #: of the links [N/m], unstretched [m], and for law (21) 1/length^2 [1/m^2]
#: Step over mass [s/kg], 0 at held ends; with damping (1 - damping factor) / (damping mass), which integrates damping exactly.
PER_MASS = 12
LOAD_X, LOAD_Y, LOAD_Z = range(13, 16)  #: velocity increments by the loads in a step [m/s]; 0 at held ends
# only with time-dependent loads, for which the increments change in each step
STEADY_X, STEADY_Y, STEADY_Z = range(16, 19)  #: velocity increments by the constant loads in a step [m/s]
# only with viscous links
UX, UY, UZ = range(19, 22)  #: velocities predicted for the step [m/s]
BX, BY, BZ = range(22, 25)  #: velocities a whole step before VX, VY, VZ [m/s]
# only if extremes are an output
LOW, HIGH = range(25, 27)  #: of T |T| of the links [N^2], which needs no root; with law (21) compression is negative
# only with wind
BASE_X, BASE_Y, BASE_Z = range(27, 30)  #: velocity increments by the constant loads in a step without drag [m/s]
DRAG_PER_MASS = 39  #: PER_MASS times the drag of the cable at the particle over the mean of the cable
DRAG_X = 30  #: velocity increments by the drag [m/s], of the last three evaluations by turns; 0 at held ends
ROWS = 40
LINE = 8  #: numbers in a cache line
