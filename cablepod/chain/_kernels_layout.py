"""Rows of the state array of the explicit chain, and arguments of its steps.

Column j is particle j, or link j between the particles j and j + 1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

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


class Shared(NamedTuple):
    """Numbers that all chains of a call share."""

    links: int
    step: float  #: [s]
    green: bool  #: law (21) in place of the linear one
    extremes: bool  #: whether to update the extremes of the tensions


class Rates(NamedTuple):
    """Damping by the rates of the links."""

    viscosity: Any  #: of the links over their stiffness (chains,) [s], 0 without; by the linear law only
    tension_damping: Any  #: damping by the tension (chains,) [s], 0 without
    ends: Any  #: velocities of the moving ends at the steps from the first of a block on (chains, moving, steps + 1) [m/s]


class Attached(NamedTuple):
    """Dampers and springs."""

    particles: Any  #: (chains, attachments)
    numbers: Any  #: (chains, attachments, COLUMNS), see :mod:`cablepod.chain._kernels_attached`


class Air(NamedTuple):
    """Wind on one chain."""

    velocity: Any  #: of the air at the particles (samples, dims, n + 1) [m/s], linear between samples, from the start of the run
    drag: Any  #: half the density of the air times drag coefficient and diameter [kg/m2], mean of the cable
    bodies: Any  #: half the density of the air times drag area at the particles (n + 1,) [kg/m]; None without
    samples_per_second: Any  #: [1/s]
    hold: Any  #: number of steps from one evaluation of the drag to the next


class Loads(NamedTuple):
    """Time-dependent loads."""

    patterns: Any  #: velocity increments in a step at factor 1 (chains, loads, dims, n + 1) [m/s]
    factors: Any  #: at the steps from the first of a block on (chains, loads, steps + 1 or more)


class Ends(NamedTuple):
    """Moving coordinates of the ends."""

    rows: Any  #: places in the state (moving,)
    columns: Any  #: (moving,)
    positions: Any  #: values at the steps from the first of a block on (chains, moving, steps + 1 or more) [m]


class Block(NamedTuple):
    """Steps to take."""

    start: int  #: number of the first
    steps: int


class Record(NamedTuple):
    """What is saved; of one chain without the first dimension."""

    steps: Any  #: rising numbers of the steps to save within a block (saves,)
    at: Any  #: row of the arrays for the first of them
    positions: Any  #: of all blocks, as slices would be compiled anew (chains, all saves, dims, n + 1), filled
    half_velocities: (
        Any  #: half a step before and after (chains, all saves or none, 2, dims, n + 1), filled unless none
    )
