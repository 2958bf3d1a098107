"""Rows of the state array of the explicit chain."""

from __future__ import annotations

# without the interpreter lock, so that runs in several threads go on side by side
# Rows of the state; column j is particle j, or link j, which is between the particles j and j + 1.
X, Y, Z = range(3)  #: positions [m]
VX, VY, VZ = range(3, 6)  #: velocities half a step before [m/s]; 0 at held ends
FX, FY, FZ = range(
    6, 9
)  #: forces of the links [N]; that of link j in column j + 1, so that a particle is between its two
STIFFNESS, LENGTH, INVERSE = range(9, 12)  #: of the links [N/m], unstretched [m], and for law (21) 1/length^2 [1/m^2]
PER_MASS = (
    12  #: step over mass [s/kg], 0 at held ends; with decay (1 - decay) / (damping mass), so that damping is exact
)
DRIVE_X, DRIVE_Y, DRIVE_Z = range(13, 16)  #: what loads add to the velocity in a step [m/s]; 0 at held ends
# only with loads that vary in time, which make the drive anew in each step
STEADY_X, STEADY_Y, STEADY_Z = range(16, 19)  #: the part of the drive that is constant [m/s]
# only with viscous links
UX, UY, UZ = range(19, 22)  #: velocities predicted for the step [m/s]
BX, BY, BZ = range(22, 25)  #: velocities a whole step before VX, VY, VZ [m/s]
# only where extremes are wanted
LOW, HIGH = range(25, 27)  #: of T |T| of the links [N^2], which needs no root; with law (21) compression is negative
ROWS = 27
LINE = 8  #: numbers in a cache line
