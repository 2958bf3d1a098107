"""Arguments of the condensed kernels: named arrays, rows of work arrays and of the monitor.

Members lie in lanes, the last dimension of all arrays of steps to leading order, which are flat: entry (j, m) of (r, lanes) has
the index j lanes + m.  A run alone is one lane.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

#: Velocity of the air along the chord and two normals, and slopes of both deflections: rows of the work array of the drag.
AIR_ROWS = 5
# Monitor of a run: extremes over its steps, and the last two chord tensions.
MIN_FORCE, MIN_FORCE_STEP = 0, 1  #: least chordwise force [N] and number of its step
MAX_OMEGA_SQUARED, OMEGA_SQUARED_LIMIT = 2, 3  #: largest squared frequency so far, largest that the step allows [1/s^2]
UNSTABLE_STEP = 4  #: number of the first step whose frequency reached the limit; inf where none did
CHORD_TENSION, PREDICTED_TENSION = 5, 6  #: orders "exact", "inertial": H of the last step, first guess for the next [N]
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


class Sizes(NamedTuple):
    """Numbers of lanes, coordinates and loads, as lengths.

    Of a tuple the length is a constant of the compiled code, whose loops then need no remainder; that of an array is not, and one
    compilation serves all.
    """

    lanes: Any  #: members side by side
    modes: Any  #: coordinates r
    patterns: Any  #: load patterns, as many loads along the chord
    normal_loads: Any  #: loads along the normals, all patterns of the first normal first


class LeadingTerms(NamedTuple):
    """Coefficients of the forces to leading order on r coordinates."""

    stiffness: np.ndarray  #: K (lanes) [N]
    inverse_length: np.ndarray  #: 1 / L0 (lanes) [1/m]
    sag_stiffness: np.ndarray  #: K / 2 L0 (lanes) [N/m]
    kappa: np.ndarray  #: squared slope norms (r, lanes) [1/(kg m)]
    #: means of the chordwise force patterns (patterns, lanes) [m], of point loads [1]
    mean_chordwise_forces: np.ndarray
    #: of unit chordwise force patterns (patterns, r, r, lanes) [1/kg], point loads [1/(kg m)]
    geometric_stiffness: np.ndarray
    #: of unit loads along the normals (normal loads, r, lanes) [kg^-1/2 m], point loads [kg^-1/2]
    load_projection: np.ndarray

    @classmethod
    def of(cls, stiffness: Any, length: Any, *coefficients: np.ndarray) -> LeadingTerms:
        """Return the coefficients of cables in a lane each, with a leading dimension of cables.

        `stiffness` and `length` are K [N] and L0 [m], of one cable or (cables,); the others are as the fields (cables, ...).
        """
        k, length = np.reshape(stiffness, (-1, 1)), np.reshape(length, (-1, 1))
        return cls(k, 1.0 / length, 0.5 * k / length, *(values.reshape(len(k), -1) for values in coefficients))

    def take(self, part: Any) -> LeadingTerms:
        """Return those of some members, by an index of their dimension; None adds that dimension."""
        return LeadingTerms(*(array[part] for array in self))


#: Array without entries, which stands for an absent term.
NOTHING = np.empty(0)


class RateTerms(NamedTuple):
    """Damping beside that by mass."""

    tension_damping: float  #: damping by the tension [s]; 0 without
    modal_damping: np.ndarray  #: damping matrix of ratios about rest (r r,) [1/s]; without entries: none
    #: velocity Verlet: part of the sum of the rates before and after a step that attached dampers take away (r r,); without
    #: entries: none
    dampers: np.ndarray = NOTHING


class Bodies(NamedTuple):
    """Bodies on the cable, at points of the air whose drag as parts of the cable is 0."""

    points: np.ndarray  #: their numbers (bodies,)
    drag: np.ndarray  #: half the density of the air times drag area (bodies,) [kg/m]


class RunAir(NamedTuple):
    """Air along a cable, and how it is held over steps."""

    velocity: np.ndarray  #: at the points along the chord, then along each normal (samples, (1 + normals) points) [m/s]
    samples_per_second: float  #: of the air, from the start of the run on [1/s]
    drag: np.ndarray  #: weights of the points, see :func:`cablepod.condensed._kernels_drag._add_drag` (points,) [kg/m]
    shapes: np.ndarray  #: shapes at the points, slopes, and shapes that loads act on (3, r, points)
    in_plane: int  #: number of in-plane coordinates
    hold: int  #: number of steps from one evaluation of the drag to the next
    held: np.ndarray  #: accelerations by the drag until then, and at the last three evaluations (4, r); changed
    work: np.ndarray  #: work array (AIR_ROWS points,)
    bodies: Any  #: Bodies, or None without any


class Bounds(NamedTuple):
    """What the monitor compares."""

    norms: np.ndarray  #: spectral norms of the geometric stiffness (patterns, lanes)
    candidates: np.ndarray  #: chordwise force patterns where their sum may be least (candidates, patterns, lanes)
    least: np.ndarray  #: work: least chordwise force of a step (lanes) [N]


class Links(NamedTuple):
    """Tables of the links whose extremes of tension are kept, and the extremes; without links: of steps that do not count."""

    slopes: np.ndarray  #: slopes of the coordinates (r, links lanes)
    in_plane: int  #: number of in-plane coordinates
    force_patterns: np.ndarray  #: chordwise force patterns (patterns, links lanes)
    low: np.ndarray  #: least tensions (links lanes) [N]; changed
    high: np.ndarray  #: largest tensions (links lanes) [N]; changed

    @classmethod
    def of(
        cls, slopes: np.ndarray, in_plane: int, force_patterns: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> Links:
        """Return tables in C order, and extremes."""
        return cls(np.ascontiguousarray(slopes), in_plane, np.ascontiguousarray(force_patterns), low, high)


class Damped(NamedTuple):
    """Step and damping by mass c; arrays (r, lanes), flat as the coordinates are."""

    step: float  #: h [s]
    damping: np.ndarray  #: c [1/s]
    decay: np.ndarray  #: of the coordinates over a step, exp(-c h / 2); velocity Verlet: of the rates, exp(-c h)
    impulse: np.ndarray  #: exp(c h / 2); velocity Verlet: rate gained in a step for unit acceleration [s]


class ExplicitState(NamedTuple):
    """State of a run and work arrays, (r, lanes) each; all are changed."""

    q: np.ndarray  #: coordinates
    v: np.ndarray  #: rates; what they are between two steps depends on the scheme
    before: np.ndarray  #: Numerov: forces plus c^2 q / 4 one step before
    earlier: np.ndarray  #: Numerov: the same two steps before
    f: np.ndarray  #: accelerations
    predicted: np.ndarray  #: Numerov: predicted coordinates
    new_f: np.ndarray  #: Numerov: forces there
    tension: np.ndarray  #: H (lanes) [N]

    @classmethod
    def of(cls, q: np.ndarray, v: np.ndarray, before: np.ndarray, lanes: int = 1) -> ExplicitState:
        """Return the state at the start, (r lanes,) each."""
        earlier, f, predicted, new_f = np.zeros((4, q.size))
        return cls(q.copy(), v.copy(), before.copy(), earlier, f, predicted, new_f, np.empty(lanes))


class Record(NamedTuple):
    """Steps that are saved, and where."""

    steps: np.ndarray  #: numbers of the steps (outputs,)
    first: int  #: index of the first one from which a kernel saves
    coordinates: np.ndarray  #: filled: coordinates (lanes, outputs, r)
    half_step_rates: np.ndarray  #: filled: rates half a step before and after (lanes, outputs or 0, 2, r)

    @classmethod
    def at(cls, begin: int, steps: np.ndarray, coordinates: np.ndarray, half_step_rates: np.ndarray) -> Record:
        """Return the record of a run that goes on from step number `begin`."""
        return cls(steps, int(np.searchsorted(steps, begin)), coordinates, half_step_rates)


class ExactTerms(NamedTuple):
    """Coefficients of the exact forces, at the links or quadrature points (m)."""

    stiffness: float  #: K [N]
    green: Any  #: True for law (21), None for the linear law, which is compiled alone
    slopes: np.ndarray  #: slopes of the coordinates (r, m)
    in_plane: int  #: number of in-plane coordinates
    force_patterns: np.ndarray  #: chordwise force patterns (patterns, m)
    weights: np.ndarray  #: unstretched lengths of the links, or quadrature weights (m,) [m]
    load_projection: np.ndarray  #: of unit loads along the normals (normal loads, r)
    #: masses [kg] of the particles above the links and their relative arc lengths (2, m); at quadrature points the chordwise mass
    #: matrix (m, m) [kg m^2]; None without chordwise inertia
    inertia: np.ndarray | None


class ExactWork(NamedTuple):
    """Stretch of a run and work arrays of the exact forces."""

    #: chordwise stretch (2, m): row 0 is the first guess of the closure, changed into the solution; row 1 is velocity Verlet's of
    #: the last step, from which the next guess is extrapolated
    stretch: np.ndarray
    closure: np.ndarray  #: of the closure (CLOSURE_ROWS, m)
    slope: np.ndarray  #: slopes of the deflections (2, m)
    slope_rate: np.ndarray  #: their rates (2, m)
    stretch_jacobian: np.ndarray  #: derivatives of the stretch by the coordinates, and momenta of these (2 r, m, 1)
    #: negative derivative of the forces (r, r), accurate enough for Newton's method; without entries: unasked
    tangent: np.ndarray
    mass: np.ndarray  #: mass matrix with chordwise inertia (r, r), otherwise a work array
    vectors: np.ndarray  #: forces and others of a step (5, r)
    tension: np.ndarray  #: H (1,) [N]

    @classmethod
    def of(cls, r: int, m: int, stretch: float, *, tangent: bool) -> ExactWork:
        """Return the arrays with the same first guess everywhere, and the identity as mass."""
        of_tangent, (slope, slope_rate) = np.empty((r, r) if tangent else (0, 0)), np.empty((2, 2, m))
        closure, jacobian, vectors = np.empty((CLOSURE_ROWS, m)), np.empty((2 * r, m, 1)), np.empty((5, r))
        start, tension = np.full((2, m), stretch), np.empty(1)
        return cls(start, closure, slope, slope_rate, jacobian, of_tangent, np.eye(r), vectors, tension)


class ErrorTerms(NamedTuple):
    """Coefficients of the error equation: of the enriched model, R coordinates, and of points along the cable.

    All arrays have a leading dimension of members.
    """

    sizes: Sizes  #: of the enriched model, one lane
    enriched: LeadingTerms
    change: np.ndarray  #: matrix from the motion's coordinates to the enriched ones (R, r)
    weights: np.ndarray  #: of the points (m,) [m]
    flexibility: np.ndarray  #: 1 / K at the points (m,) [1/N]
    force_patterns: np.ndarray  #: chordwise force patterns (m, patterns)
    slopes_of_motion: np.ndarray  #: slopes of the motion's coordinates (m, r)
    slopes: np.ndarray  #: slopes of the enriched ones (R, m)
    in_plane: int  #: number of the motion's in-plane coordinates
    enriched_in_plane: int  #: the same of the enriched model
    #: chordwise mass matrix of rates of stretch, see :func:`_kernels_exact_closure._chordwise_momentum`
    inertia: np.ndarray
    damping: np.ndarray  #: by mass, a number of each member [1/s]
    #: roots of stiffnesses times shapes of attached springs (springs, R) [1/s]; None without
    springs: np.ndarray | None
    green: Any  #: True for law (21), None for the linear law, which is compiled alone
    leading: bool  #: whether the motion obeys the closure to leading order
    corrections: int  #: number of joint Newton corrections of the closure


class Drive(NamedTuple):
    """What drives the errors of members: exact forces less those to leading order, less accelerations of the motion."""

    #: Boundary data of the samples (members, samples, columns), with the chord at which the closure to leading order has the
    #: change of H by the exact closure; what the closure of a motion to leading order misses acts on the whole shape.
    rows: np.ndarray
    y: np.ndarray  #: motion in enriched coordinates (members, samples, R)
    difference: np.ndarray  #: D less its accelerations with damping (members, samples, R)
    largest_force: np.ndarray  #: largest chordwise force (members, samples) [N]


# --- prepared models, also of compiled hosts ----------------------------------------------------------------------------

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
    shapes: np.ndarray  #: shapes at the points, slopes, and shapes that loads act on (3, r, points)


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


# --- arguments that Python makes ---------------------------------------------------------------------------------------


def initial_monitor(omega_squared_limit: float, chord_tension: float) -> np.ndarray:
    """Return the monitor (MONITOR_ROWS,) before the first step, for a limit [1/s^2] and the initial H [N]."""
    monitor = np.zeros(MONITOR_ROWS)
    monitor[MIN_FORCE] = monitor[UNSTABLE_STEP] = np.inf
    monitor[OMEGA_SQUARED_LIMIT] = omega_squared_limit
    monitor[CHORD_TENSION] = monitor[PREDICTED_TENSION] = chord_tension
    return monitor


def constant_sizes(size: int, patterns: int, normal_loads: int, lanes: int = 1) -> Sizes:
    """Return numbers that are constants of the compiled code, which is compiled for each of them."""
    return Sizes(*((0,) * number for number in (lanes, size, patterns, normal_loads)))


def runtime_sizes(size: int, patterns: int, normal_loads: int) -> Sizes:
    """Return numbers of one lane that one compilation serves."""
    return Sizes((0,), *(np.empty(number) for number in (size, patterns, normal_loads)))
