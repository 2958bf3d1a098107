"""Arguments of the kernels of masts: named arrays, those of the mast, of its air, of what is kept, and of each kind of guys.

Arrays of guys have them as the last dimension, "lanes"; those of condensed guys are padded.  Work arrays are here too: a kernel
that makes no array counts no references.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

#: How a run ended.
DONE, DIVERGED, UNSTABLE = range(3)
#: Samples of the air through which it is interpolated in time.
TAPS = 6
#: Lanes of condensed guys, their modes and nodes of masts are padded to multiples of these numbers.
LANES, MODES_TOGETHER, NODES_TOGETHER = 16, 4, 8
# Numbers of the condensed guys (rows, lanes).
STIFFNESS, LENGTH, WEIGHT = 0, 1, 2  #: K [N], unstretched length [m], weight [N/m]
SOFTENING, STIFFENING = 3, 4  #: 1 - 2 e, e N0 [N], with strain e and force N0 at rest
LARGEST_KAPPA = 5  #: largest fitted kappa [1/(kg m)]
SCALE, SLOPE_SCALE = 6, 7  #: of the shapes [kg^-1/2], of their slopes [kg^-1/2 1/m]
#: Rows of the upper ends of condensed guys: displacement from rest in x, y, z [m], its rates in x and z [m/s].
X, Y, Z, RATE_X, RATE_Z = range(5)
#: Rows of the links of chains: stiffness [N/m], length [m]; and of their particles: inverse of the mass [1/kg], place between
#: the points of the air, drag on the links beside [kg/m2], on what is attached [kg/m].
LINK_STIFFNESS, LINK_LENGTH = range(2)
PER_MASS, PLACE, DRAG, BODY = range(4)


class Pace(NamedTuple):
    """Steps of a run."""

    step: float  #: [s]
    every: int  #: steps from one output to the next
    steps: int  #: number of steps
    hold: int  #: steps over which the drag on the mast, and on condensed guys, is held
    first: int  #: first step of extremes and sums
    last: int  #: last one


class Beam(NamedTuple):
    """The mast in its modal coordinates."""

    constant: np.ndarray  #: constant modal forces (modes,)
    stiffness: np.ndarray  #: at rest, without guys (modes, modes)
    keep: np.ndarray  #: transposed matrix A1 of a step (modes, modes)
    gain: np.ndarray  #: transposed matrix A2 of a step (modes, modes)
    level_rows: np.ndarray  #: displacement of the levels in x and z by the modes (levels, 2, modes)
    level_rest: np.ndarray  #: the same at rest (levels, 2) [m]
    geometric: np.ndarray  #: geometric stiffness G of a unit pull at each level (levels, modes, modes)
    geometric_rest: np.ndarray  #: the same times the displacement at rest (levels, modes)


class BeamState(NamedTuple):
    """State of the mast and work arrays; all are changed."""

    a: np.ndarray  #: modal coordinates (modes,)
    v: np.ndarray  #: their rates half a step after (modes,)
    before: np.ndarray  #: half a step before (modes,)
    rate: np.ndarray  #: at the middle of the steps over which drag is held (modes,)
    force: np.ndarray  #: modal forces (modes,)
    upper: np.ndarray  #: displacement of the levels in x and z, level by level (2 levels,) [m]
    upper_rate: np.ndarray  #: rates of the levels (levels, 2) [m/s]
    lowered: np.ndarray  #: vertical displacement of the levels from rest (levels,) [m]
    gradient: np.ndarray  #: its derivative by the modal coordinates (levels, modes)
    pull: np.ndarray  #: vertical force of the guys on the levels at rest (levels,) [N]
    level_force: np.ndarray  #: force of the guys in x, y, z (levels, 3) [N]
    acceleration: np.ndarray  #: of the levels in x and z (levels, 2) [m/s2]

    @classmethod
    def of(cls, levels: int, modes: int) -> BeamState:
        """Return the state at rest."""
        at_levels = ((2 * levels,), (levels, 2), (levels,), (levels, modes), (levels,), (levels, 3), (levels, 2))
        return cls(*(np.zeros(modes) for _ in range(5)), *map(np.zeros, at_levels))


class Loads(NamedTuple):
    """Loads with a time factor; without entries where there are none."""

    vectors: np.ndarray  #: on the modes (loads, modes)
    factors: np.ndarray  #: (loads, steps + 1)


class MastWind(NamedTuple):
    """Wind on the mast."""

    samples_per_step: float
    table: np.ndarray  #: weights of the samples at equal parts of an interval (parts, TAPS)
    velocity: np.ndarray  #: at the nodes but the foot in x, then in z (samples, 2 nodes) [m/s]
    columns: np.ndarray  #: displacement of what the nodes carry by the modes (2, modes, nodes)
    rows: np.ndarray  #: the same (2, nodes, modes)
    drag: np.ndarray  #: half the density of the air times drag area (nodes,) [kg/m]
    weights: np.ndarray  #: work: of the samples (TAPS,)
    air: np.ndarray  #: work: velocity at an instant (2 nodes,) [m/s]
    x: np.ndarray  #: work: drag in x (nodes,) [N]
    z: np.ndarray  #: work: drag in z (nodes,) [N]
    force: np.ndarray  #: work: modal forces of the drag that is held (modes,)


class GuyEnds(NamedTuple):
    """What the mast knows of its guys, whatever their kind."""

    level: np.ndarray  #: at which each is fastened (guys,)
    breaks: np.ndarray  #: step from which on it carries no force (guys,)
    end_mass: np.ndarray  #: mass at the mast: rows of force in x, y, z by acceleration in x and z (6, lanes) [kg]
    force: np.ndarray  #: filled: on the mast (3, lanes) [N]
    tension: np.ndarray  #: filled: (lanes,) [N]
    least: np.ndarray  #: filled: least force of each before it breaks, not of static guys (lanes,) [N]
    least_step: np.ndarray  #: filled: step of it (lanes,)

    @classmethod
    def of(cls, level: np.ndarray, breaks: np.ndarray, end_mass: np.ndarray) -> GuyEnds:
        """Return the ends of guys with masses (6, lanes) [kg], or (guys,) of those that follow the mast in x and z."""
        if end_mass.ndim == 1:
            end_mass = np.outer([1.0, 0.0, 0.0, 0.0, 0.0, 1.0], end_mass)
        lanes = end_mass.shape[1]
        start = np.full(lanes, np.inf), np.zeros(lanes)
        return cls(level, breaks, end_mass, np.zeros((3, lanes)), np.zeros(lanes), *start)


class Extremes(NamedTuple):
    """Extremes of values over the steps of a window, and what means are made of; all are filled."""

    least: np.ndarray
    largest: np.ndarray
    least_step: np.ndarray  #: step at which it occurs
    largest_step: np.ndarray
    total: np.ndarray  #: sums
    squares: np.ndarray  #: sums of squares

    @classmethod
    def of(cls, count: int) -> Extremes:
        """Return those before a run."""
        return cls(np.full(count, np.inf), np.full(count, -np.inf), *(np.zeros(count) for _ in range(4)))


class MastRecord(NamedTuple):
    """What is kept of a run; all are filled."""

    modal: np.ndarray  #: modal coordinates at the outputs (outputs, modes)
    rates: np.ndarray  #: rates half a step before and after (outputs, 2, modes)
    force: np.ndarray  #: of the guys on the mast (outputs, guys, 3) [N]
    tension: np.ndarray  #: (outputs, guys) [N]
    drag: np.ndarray  #: on the nodes (outputs, 2, nodes) [N], or without rows
    of_levels: Extremes  #: of displacements in x and z, level by level (2 levels,) [m]
    of_tensions: Extremes  #: (lanes,) [N]


class CondensedTerms(NamedTuple):
    """Condensed guys; r modes of each deflection, that in the vertical plane first."""

    numbers: np.ndarray  #: see the head of this file (8, lanes)
    sizes: Any  #: :class:`cablepod.condensed._kernels_layout.Sizes` of both deflections
    terms: Any  #: :class:`cablepod.condensed._kernels_layout.LeadingTerms` of both deflections
    kappa: np.ndarray  #: squared slope norms (2, r, lanes) [1/(kg m)]
    moments: np.ndarray  #: of the shapes, with the mass and the distance from the anchor (2, r, lanes) [kg^1/2]
    loads: np.ndarray  #: of a unit load across the chord, 0 out of the plane (2, r, lanes) [m kg^-1/2]
    tilt: np.ndarray  #: of shapes of unit mass (2, r, r)
    reach: np.ndarray  #: from mast to anchor at rest (3, lanes) [m]
    axes: np.ndarray  #: along the chord and normal to it at rest (9, lanes)


class CondensedScheme(NamedTuple):
    """What steps of a length add to condensed guys."""

    keep: float  #: factor of rates in a step
    gain: np.ndarray  #: factors of forces (2, r, lanes)
    damping: Any  #: matrices D and A of the damping by ratios (2, 2, r, r, lanes), or None


class CondensedState(NamedTuple):
    """State of condensed guys and work arrays; all are changed."""

    p: np.ndarray  #: momentum coordinates (2, r, lanes)
    rates: np.ndarray  #: their rates half a step after (2, r, lanes)
    before: np.ndarray  #: half a step before (2, r, lanes)
    q: np.ndarray  #: deflections (2, r, lanes) [kg^1/2 m]
    own: np.ndarray  #: rates of the deflections (2, r, lanes)
    on_q: np.ndarray  #: forces on the coordinates (2, r, lanes)
    damped: np.ndarray  #: the same less damping (2, r, lanes)
    ends: np.ndarray  #: upper ends, see the head of this file (5, lanes)
    moved: np.ndarray  #: ends along both normals: displacements, rates; later moments times forces (2, lanes)
    axis_x: np.ndarray  #: axis along the chord (lanes,)
    axis_y: np.ndarray  #: the same
    axis_z: np.ndarray  #: the same
    level: np.ndarray  #: vertical component of the normal (lanes,)
    normal_x: np.ndarray  #: the normal (lanes,)
    normal_z: np.ndarray  #: the same
    chord: np.ndarray  #: chord lengths (lanes,) [m]
    stretch: np.ndarray  #: the same over the unstretched lengths (lanes,)
    end_along: np.ndarray  #: rates of the ends along the chords (lanes,) [m/s]
    tension: np.ndarray  #: chordwise forces H (lanes,) [N]
    sag: np.ndarray  #: stiffness of the sag (lanes,) [1/s2]
    straight: np.ndarray  #: minus the straight tension (lanes,) [N]
    along: np.ndarray  #: weight along the chord (lanes,) [N/m]
    normal: np.ndarray  #: load across it (lanes,) [N/m]
    quadratic: np.ndarray  #: work of the tilt (lanes,)
    linear: np.ndarray  #: work of the load (lanes,)
    tilted: np.ndarray  #: a row of the tilt times the coordinates (lanes,)
    saved: np.ndarray  #: deflections, rates half a step before and after (outputs, 3, 2, r, lanes), or no rows

    @classmethod
    def of(cls, p: np.ndarray, saved: np.ndarray) -> CondensedState:
        """Return the state at rest with coordinates `p`, whose forces on the mast are not yet known."""
        lanes = p.shape[2]
        shapes = [p.shape] * 6 + [(5, lanes), (2, lanes)] + [(lanes,)] * 17
        return cls._make([p.copy(), *map(np.zeros, shapes), saved])


class CondensedWind(NamedTuple):
    """Wind along condensed guys at points of quadrature."""

    velocity: np.ndarray  #: (samples, 3 points lanes) [m/s]
    drag: np.ndarray  #: half the density of the air times drag area of a point (points, lanes) [kg/m]
    sigma: np.ndarray  #: places of the points (points,)
    shapes: np.ndarray  #: of unit length and mass (2, points, r)
    slopes: np.ndarray  #: their slopes (2, points, r)
    air: np.ndarray  #: work: velocity at an instant (3 points lanes,) [m/s]
    slope: np.ndarray  #: work: (2, lanes)
    rate: np.ndarray  #: work: (2, lanes)
    chordwise: np.ndarray  #: work: drag along the chords (points, lanes) [N]
    across: np.ndarray  #: work: drag along both normals (2, points, lanes) [N]
    sums: np.ndarray  #: work: of drag times place (3, lanes) [N]
    held_q: np.ndarray  #: forces on the coordinates that are held (2, r, lanes); changed
    held: np.ndarray  #: forces on the mast that are held (3, lanes) [N]; changed

    @classmethod
    def of(
        cls, velocity: np.ndarray, drag: np.ndarray, sigma: np.ndarray, shapes: np.ndarray, slopes: np.ndarray
    ) -> CondensedWind:
        """Return the wind with work arrays."""
        points, lanes = drag.shape
        work = ((3 * points * lanes,), (2, lanes), (2, lanes), (points, lanes), (2, points, lanes), (3, lanes))
        held = (2, shapes.shape[2], lanes), (3, lanes)
        return cls(velocity, drag, sigma, shapes, slopes, *map(np.zeros, work + held))


class ChainTerms(NamedTuple):
    """Guys of lumped masses and links that only pull, and their state."""

    x: np.ndarray  #: positions of the particles from anchor to mast (guys, 3, n + 1) [m]; changed
    rates: np.ndarray  #: half a step before (guys, 3, n + 1) [m/s]; changed
    heights: np.ndarray  #: of the upper ends at rest (guys,) [m]
    links: np.ndarray  #: see the head of this file (guys, 2, n)
    particles: np.ndarray  #: see the head of this file (guys, 4, n + 1)
    end_mass: np.ndarray  #: of the upper particles (guys,) [kg]
    first: np.ndarray  #: first damper or spring of each guy, and their number (guys + 1,)
    attached: np.ndarray  #: their particles (attachments,)
    numbers: np.ndarray  #: (attachments, COLUMNS), see :mod:`cablepod.chain._kernels_attached`
    viscosity: float  #: damping force of a link per axial stiffness and strain rate [s]
    gravity: float  #: [m/s2]
    mass_damping: float  #: [1/s]
    forces: np.ndarray  #: work: of the links on their lower particles (3, n) [N]
    drags: np.ndarray  #: drag on the particles that is held (guys, 3, n + 1) [N]; changed


class ChainWind(NamedTuple):
    """Wind along chains, at equally spaced points."""

    velocity: np.ndarray  #: (samples, guys, points, 3) [m/s]
    samples_per_step: float
    hold: int  #: steps from one evaluation of the drag to the next


class StaticTerms(NamedTuple):
    """Static guys: their forces as splines (guys, intervals, 4), highest power first, over the distance of their ends."""

    anchors: np.ndarray  #: in x and z (guys, 2) [m]
    first: np.ndarray  #: least distance of the table (guys,) [m]
    spacing: np.ndarray  #: interval of the table (guys,) [m]
    horizontal: np.ndarray  #: horizontal force over distance [N/m]
    vertical: np.ndarray  #: vertical force on the mast [N]
    places: np.ndarray  #: filled: least and largest place in the tables, in intervals (2, guys)


class StaticWind(NamedTuple):
    """Part of the drag on static guys that the mast carries."""

    reaction: np.ndarray  #: in x and z (samples, guys, 2) [N]
    samples_per_step: float
