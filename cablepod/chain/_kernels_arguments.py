"""Arguments of the implicit kernels of the chain: named arrays of members side by side.

Members lie in lanes, the last dimension of all arrays, most of which are flat: entry (j, m) of (n, lanes) has the index
j lanes + m.  Coordinates come one after the other, (dims, n + 1, lanes).  A run alone is one lane.  What a scene does not have is
an array without entries.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Sizes(NamedTuple):
    """Numbers as lengths of tuples, which are constants of the compiled code."""

    lanes: tuple[int, ...]  #: members side by side
    dims: tuple[int, ...]  #: coordinates


class Chain(NamedTuple):
    """Numbers of links and particles."""

    first: int  #: first free particle
    last: int  #: one after the last free particle
    k: np.ndarray  #: stiffness of the links (n lanes) [N/m]
    length: np.ndarray  #: unstretched length (n lanes) [m]
    inverse_squares: np.ndarray  #: 1 / length^2 for law (21), else without entries (n lanes) [1/m^2]
    viscosity: np.ndarray  #: stiffness times viscosity (n lanes) [N s/m]
    tension_damping: np.ndarray  #: damping by the tension (n lanes) [s]
    #: 1 / length at the first particle of each link, 0 at the last one (dims (n + 1) lanes) [1/m]
    per_length: np.ndarray
    mass: np.ndarray  #: for each coordinate, 0 at held particles (dims (n + 1) lanes) [kg]
    damped_mass: np.ndarray  #: mass times damping by mass (dims (n + 1) lanes) [kg/s]
    loads: np.ndarray  #: constant loads, 0 at held particles (dims (n + 1) lanes) [N]
    patterns: np.ndarray  #: time-dependent loads (loads, dims (n + 1) lanes) [N]


class RateTerms(NamedTuple):
    """Forces on particles that depend on velocities, of one lane."""

    modal: Any  #: damping by ratios, see :class:`cablepod.discretisation._modal_damping.NodalDamping`
    particles: np.ndarray  #: particles with dampers or springs (attachments,)
    attached: np.ndarray  #: their numbers (attachments, COLUMNS), see :mod:`cablepod.chain._kernels_attached`
    wind: np.ndarray  #: velocity of the air at the particles, linear between the samples (samples, dims, n + 1) [m/s]
    drag: np.ndarray  #: half the density of the air times drag coefficient and diameter (n + 1,) [kg/m2]
    bodies: np.ndarray  #: half the density of the air times drag area at the particles (n + 1,) [kg/m]


class Tables(NamedTuple):
    """What changes from step to step, at the steps of a call."""

    factors: np.ndarray  #: of the time-dependent loads (steps + 1, loads, lanes)
    lower: np.ndarray  #: positions of the lower end, if it moves (steps + 1, dims, lanes) [m]
    upper: np.ndarray  #: positions of the upper end, if it moves (steps + 1, dims, lanes) [m]
    end_rates: np.ndarray  #: velocities of both ends, if forces depend on them (steps + 1, 2, dims, lanes) [m/s]
    places: np.ndarray  #: places between the samples of the wind (steps + 1,)


class Lanes(NamedTuple):
    """Marks and limits of the lanes."""

    is_running: np.ndarray  #: lanes to advance; those that leave their bound are taken out (lanes,)
    failed: np.ndarray  #: filled: lanes in which Newton's method did not converge in the last step (lanes,)
    iterations: np.ndarray  #: raised by the iterations taken (lanes,)
    #: root mean square rotation of the links by the last correction; that by rounding, at which iterations end that do not
    #: get better (lanes,)
    tolerance: np.ndarray
    rounding: np.ndarray
    remainder: float  #: tolerance of what remains after the last correction over the other one; 0 with an exact tangent
    bound: np.ndarray  #: coordinate above which a chain is considered divergent (lanes,) [m]


class Record(NamedTuple):
    """What is kept of a run."""

    start: int  #: number of the first step
    steps: np.ndarray  #: rising numbers of the steps to save (saves,)
    at: int  #: place of the first of them in `saved`
    #: filled: positions, or positions, velocities and accelerations (members, all saves, 1 or 3, dims (n + 1))
    saved: np.ndarray
    low: np.ndarray  #: least tensions at the steps, updated (n lanes) [N]
    high: np.ndarray  #: largest tensions at the steps, updated (n lanes) [N]


class Newton(NamedTuple):
    """Tangent of the inertia, and work arrays of Newton's method."""

    diagonal: np.ndarray  #: inertia and damping by mass: force for a unit displacement (dims (n + 1) lanes) [N/m]
    block: np.ndarray  #: what is added to the tangent of the links at each particle (3 or 6, n + 1, lanes) [N/m]
    #: the same without forces on particles: in the tangent, damping by ratios counts as more inertia (n + 1, lanes) [N/m]
    solved: np.ndarray
    reach: np.ndarray  #: vectors of the links (dims, n, lanes) [m]
    t: np.ndarray  #: tension over length (n, lanes) [N/m]
    g: np.ndarray  #: derivative of this by half the squared length (n, lanes) [N/m^3]
    f: np.ndarray  #: forces of the links, zeros before the first and after the last (dims (n + 1) + 1, lanes) [N]
    s: np.ndarray  #: their tangent: xx, xy, yy, or xx, xy, xz, yy, yz, zz (3 or 6, n + 2, lanes) [N/m]
    d: np.ndarray  #: displacements in the step (dims (n + 1) lanes) [m]
    b: np.ndarray  #: right side, then correction (dims (n + 1) lanes)
    fixed: np.ndarray  #: forces that do not change in the step (dims (n + 1) lanes) [N]
    known: np.ndarray  #: the same with forces on particles by rates (dims (n + 1) lanes) [N]
    trial: np.ndarray  #: positions at the end of the step (dims (n + 1) lanes) [m]
    middle: np.ndarray  #: positions in the middle of the step (dims (n + 1) lanes) [m]
    rates: np.ndarray  #: velocities (dims (n + 1) lanes) [m/s]
    force: np.ndarray  #: forces on particles by rates (dims (n + 1) lanes) [N]
    #: size of the drag over that of the relative velocity across the cable (n + 1, lanes) [kg/s]
    air_damping: np.ndarray
    matrix: np.ndarray  #: of the elimination (n + 1, 4 or 6, lanes)
    carry: np.ndarray  #: of the elimination from both ends (2, 5 or 9, lanes)
    rotation: np.ndarray  #: of the links by the last two corrections (2, lanes)
    active: np.ndarray  #: 1 in lanes that have not converged (lanes,)
    before: np.ndarray  #: state before a step in which lanes fail (arrays, dims (n + 1) lanes)

    @classmethod
    def of(cls, dims: int, links: int, lanes: int) -> Newton:
        """Return arrays of zeros."""
        particles, symmetric, carried = links + 1, 3 * dims - 3, (10 if dims == 2 else 18)
        rows = dims * particles
        sizes = (
            *(rows, symmetric * particles, particles, dims * links, links, links, rows + 1, symmetric * (links + 2)),
            *(rows,) * 8,
            *(particles, (4 if dims == 2 else 6) * particles, carried, 2, 1, 6 * rows),
        )
        return cls(*(np.zeros(size * lanes) for size in sizes))

    def start_blocks(self, dims: int) -> None:
        """Fill the blocks without forces on particles."""
        row = 0
        self.block[:] = 0.0
        for c in range(dims):
            self.block[row * self.solved.size : (row + 1) * self.solved.size] = self.solved
            row += dims - c


class State(NamedTuple):
    """State of a run, advanced in place (dims (n + 1) lanes) each; all but the positions are 0 at held particles."""

    x: np.ndarray  #: positions [m]
    v: np.ndarray  #: velocities [m/s]
    a: np.ndarray  #: accelerations [m/s2]; energy-momentum: displacement in the last step [m]
    g: np.ndarray  #: total forces [N]; not energy-momentum, as the following
    last_a: np.ndarray  #: accelerations one step before [m/s2]
    first_a: np.ndarray  #: accelerations two steps before [m/s2]
