"""A-posteriori error estimate of reduced models from the residual of an enriched condensed model.

What the rank leaves is the residual in more modes, ``_error_equation.py``; what the closure to leading order leaves, the exact
forces, and the growth of the error in time are in ``_kernels_error.py``; waves and rotations in ``_estimate_neglected.py``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from cablepod.chain._start import start
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._error_equation import ErrorEquation
from cablepod.condensed._estimate_forces import EnrichedDrag, forces_by_rates
from cablepod.condensed._estimate_neglected import Neglected, waves
from cablepod.condensed._fields import CondensedTrajectory, close_chord_of, running_sum
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._lifting import line_between
from cablepod.integrate._comparison import motion_or_chord

#: Points along the cable for a motion of order "leading": POINTS plus POINTS_PER_MODE for each mode.  Other motions obey the
#: exact closure on all links, and their residual is taken there.
POINTS, POINTS_PER_MODE = 4, 2
#: Maximum interval of the residual samples times the angular frequency of the first truncated mode.
SAMPLING_PHASE = 2.0
#: Minimum number of samples in the shortest time scale of ends and loads.
SAMPLES_PER_CHANGE = 4.0
#: Minimum number of intervals between the samples of a run that has as many steps.
MIN_INTERVALS = 4
#: Maximum number of samples (longer runs are sampled at longer intervals).
MAX_SAMPLES = 20_000
#: Maximum estimate: above twice the motion it only says that nothing is right.
MAX_ERROR = 2.0
#: Minimum change of an error over its maximum that counts as a motion which a model at rest misses (of a cable at rest: 1e-9).
MISSED_MOTION = 1e-3
#: Maximum number of instants at which the scale of the motion is computed.
MOTION_SAMPLES = 200
#: Number of models whose error equations are kept.
KEPT_EQUATIONS = 32


def sample_interval(
    omega_squared: float,
    modes: int,
    steps_per_second: float,
    end_time: float,
    phase: float = SAMPLING_PHASE,
    time_scale: float = math.inf,
) -> int:
    """Choose the number of steps between two samples of the residual.

    Parameters
    ----------
    omega_squared
        Squared angular frequency of the last retained mode [1/s^2].
    modes
        Number of retained modes.
    steps_per_second, end_time
        Steps per second of the run, and its end [s].
    phase
        Maximum interval of the samples times the angular frequency of the first truncated mode (one step may be longer).
    time_scale
        Shortest time scale of ends and loads [s].
    """
    omega_truncated = math.sqrt(omega_squared) * (modes + 1.0) / max(modes, 1)
    longest = min(phase / omega_truncated, time_scale / SAMPLES_PER_CHANGE, end_time / MIN_INTERVALS)
    return max(
        1,
        math.floor(longest * steps_per_second),
        math.ceil(end_time * steps_per_second / MAX_SAMPLES),
    )


def estimate(model: CondensedModel, state: CondensedTrajectory, scale: float, air: CondensedAir | None = None) -> float:
    """Estimate the largest error over time as a fraction of the motion.

    The motion of the model is put into the equations of an enriched one (more modes, exact chordwise stretch, chordwise inertia).
    Their residual at sampled instants drives the error, by the equation e'' + F(y) - F(y + e) = residual with the forces F to
    leading order, whose coefficients are those of the motion.  The estimate contains the truncated modes, their effect on the
    retained ones over time, and the terms that the order neglects, but not the error of the step.  Of orders "exact" and
    "inertial" these include the rotation of the chord, see ``_estimate_neglected``; to leading order others are larger.  The
    displacement of waves along the cable by the ends is added, see ``waves`` there; how they act on the deflection is not
    contained.  In wind the residual contains the drag on the enriched model, and the error is damped as a motion across the wind;
    with damping by the tension it is damped as its slowest mode.

    Parameters
    ----------
    model
        Model of the run.
    state
        Trajectory of the run with samples, see :attr:`CondensedTrajectory.sample_interval`.
    scale
        The motion, see :func:`motion_of` [m].
    air
        Air along the cable; None for still air.
    """
    rows, interval = state.samples, state.sample_interval
    rate = state.instants.steps_per_second / interval
    motion = state.saved[rows], state.saved_rates[rows], state.saved_accelerations[rows]
    equation, error, error_rate = _error_at_start(model, air)
    kept = state.boundary_data
    boundary_data = model.boundary_data(0, len(motion[0]) - 1, rate) if kept is None else kept[rows]
    displaced: Any = 0.0
    further = []
    if model.order != "leading" and len(motion[0]) > 2:
        forces, displaced = Neglected(model, equation).of(motion, np.arange(len(motion[0])) / rate)
        further.append((forces, 0.0))
    p = model.chain.p
    is_held = any(attachment.damper or attachment.spring for attachment in p.attachments)
    if air is not None or p.tension_damping is not None or p.damping_ratios is not None or is_held:
        times = np.arange(len(motion[0])) / rate
        q, rates, accelerations = motion
        forces, damping = forces_by_rates(equation, model, air, times, q, rates, boundary_data)
        motion = q, rates, accelerations - damping * rates  # the kernel adds the damping of the error to the motion
        further.append((forces, damping))
    for forces, damping in further:
        equation, boundary_data = equation.with_forces(damping), np.concatenate([boundary_data, forces], axis=1)
    squares = equation.mean_squares(motion, boundary_data, 1.0 / rate, error, error_rate) + displaced
    along = waves_of(model, float(state.instants.times[-1]), air if p.initial else None)
    if air is not None or p.initial or p.time_functions():  # otherwise the cable stands still as the model does
        scale = motion_or_missed(scale, model.chain.chord, squares)
    return min(math.sqrt(squares.max() + along * along) / scale, MAX_ERROR)


@lru_cache(KEPT_EQUATIONS)
def waves_of(model: CondensedModel, end_time: float, air: CondensedAir | None = None) -> float:
    """Return the rms displacement of waves along the cable [m], of a given start in air; kept as long as the model is."""
    p, length = model.chain.p, model.chain.total_length
    if model.is_uniform:
        return waves(p, length, end_time)
    of_ends = waves(replace(p, mass=model.root_total_mass**2 / length), length, end_time)  # in a bar of the same mass
    return math.hypot(of_ends, _displacement_at_start(model, air) if p.initial else 0.0)


def _displacement_at_start(model: CondensedModel, air: CondensedAir | None) -> float:
    """Return the rms distance along the chord of a given start from that of the model [m].

    Parts of different stiffness that start with another tension than that of their rest are not balanced along the chord.
    """
    chain, q = model.chain, (model if air is None else air).initial()[0]
    position = start(chain, None if air is None else air.of_chain)
    stretch = close_chord_of(model, q[None], model.boundary_data_at(np.zeros(1)))[0]
    given = ChordFrame.of((position[-1] - position[0])[None], model.reference).split(position[None])[0]
    squares = (running_sum(stretch * chain.length) - given)[0] ** 2
    return math.sqrt(squares @ chain.tributary_length / chain.total_length)


@lru_cache(KEPT_EQUATIONS)
def _error_at_start(
    model: CondensedModel, air: CondensedAir | None = None
) -> tuple[ErrorEquation, np.ndarray, np.ndarray]:
    """Return the error equation of a model, the error at the start and its rate (R,); kept as long as the model is."""
    leading = model.order == "leading"
    points = POINTS + POINTS_PER_MODE * max(len(part) for part in model.modes) if leading else 0
    if model.is_uniform:
        equation = ErrorEquation.of(
            model.chain, model.modes, model.shapes, model.n_in_plane, leading=leading, points=points
        )
    else:
        equation = ErrorEquation.of_nonuniform(model)
    q = (model if air is None else air).initial()[0]
    if model.chain.p.initial:
        deflection = model.start_deflection() if air is None else air.start_deflection
        error = equation.coordinates(deflection[:, 0]) - equation.change @ q
    elif air is None:
        error = equation.error_at_rest(q, model.static_boundary_data)
    else:
        static = model.static_boundary_data
        drag = EnrichedDrag.of(equation, air).at_rest(q, static)
        error = equation.with_forces().error_at_rest(q, np.concatenate([static, drag]))
    error_rate = np.zeros_like(error)
    start_rates = model.start_deflection_rates
    if start_rates is not None:
        error_rate = equation.coordinates(start_rates) - equation.change @ model.coordinates(start_rates[:, None])[0]
    return equation, error, error_rate


def motion_of(model: CondensedModel, state: CondensedTrajectory) -> float:
    """Return the largest rms displacement from the initial shape [m]; the chord where nothing moves.

    Displacements of the ends and changes of the deflection count, normal to the initial chord.
    """
    q, p = state.saved[state.samples], model.chain.p
    stride = -(-len(q) // MOTION_SAMPLES)
    q = q[::stride]
    ends = None
    if p.motions:
        ends = p.end_positions(np.arange(len(q)) * (stride * state.sample_interval / state.instants.steps_per_second))
    if not model.is_uniform:
        return _motion_of_particles(model, q, ends)
    means = [array[None] for array in _means_of_shapes(model)]
    of_ends = None if ends is None else ends[None]
    return float(largest_motions(q[None], of_ends, model.chain.chord, model.root_total_mass**2, *means)[0])


def _motion_of_particles(model: CondensedModel, q: np.ndarray, ends: np.ndarray | None) -> float:
    """Do :func:`motion_of` for coordinates (samples, r) and ends (samples, 2, dims), where masses are not as the lengths."""
    chain, initial = model.chain, model.chain.p.initial_ends
    normals = ChordFrame.of((initial[1] - initial[0])[None], model.reference).normals[0]
    moved = np.zeros((len(q), chain.links + 1, chain.p.dims))
    if ends is not None:
        moved += line_between(ends - ends[:1], chain.arc_length / chain.total_length)
    for which, normal in zip(model.sets, normals, strict=True):
        moved += ((q - q[:1])[:, which] @ model.shapes[which])[:, :, None] * normal
    squares = (moved * moved).sum(axis=2) @ chain.tributary_length / chain.total_length
    return float(motion_or_chord(math.sqrt(squares.max()), chain.chord))


def largest_motions(
    q: np.ndarray,
    ends: np.ndarray | None,
    chord: float | np.ndarray,
    mass: float | np.ndarray,
    normals: np.ndarray,
    of_lower: np.ndarray,
    of_upper: np.ndarray,
) -> np.ndarray:
    """Return the largest rms displacements from the start, of the line between the ends and of the deflection [m].

    With displacements a and b of the ends and changes d of the coordinates their square is (a.a + a.b + b.b) / 3 plus the sums of
    2 d (a.n u + b.n v) and of d^2 over the mass.

    Parameters
    ----------
    q, ends
        Coordinates (members, samples, r), and positions of the ends (members, samples, 2, dims) [m]; None where no end moves.
    chord
        Distance of the ends, for members that do not move, a number or (members,) [m].
    mass
        Mass of the cable, a number or (members, 1) [kg].
    normals, of_lower, of_upper
        Normal of each coordinate (members, r, dims); means u and v of its shape times 1 - sigma and sigma (members, r) [kg^-1/2].
    """
    change = q - q[:, :1]
    square = (change * change).sum(axis=2) / mass
    if ends is not None:
        moved = ends - ends[:, :1]
        lower, upper = moved[:, :, 0], moved[:, :, 1]
        square += ((lower + upper) * lower + upper * upper).sum(axis=2) / 3.0
        normal = np.swapaxes(normals, 1, 2)
        across = lower @ (normal * of_lower[:, None]) + upper @ (normal * of_upper[:, None])
        square += 2.0 * (change * across).sum(axis=2)
    return np.asarray(motion_or_chord(np.sqrt(np.maximum(square.max(axis=1), 0.0)), chord))


def motion_or_missed(motion: float, chord: float, squares: np.ndarray) -> float:
    """Return a motion [m], or that which a model at rest misses: the largest change of its error from the start.

    A model whose modes no load excites stands still, and its motion counts as the chord; that of the cable is in the error.

    Parameters
    ----------
    motion, chord
        Motion, equal to the chord where nothing moves [m].
    squares
        Mean squares of the error (samples,) [m^2].
    """
    error = np.sqrt(squares)
    missed = float(np.abs(error - error[0]).max())
    is_missed = motion == chord and missed > MISSED_MOTION * error.max()
    return float(motion_or_chord(missed, chord)) if is_missed else motion  # the chord where the cable stands still too


@lru_cache(KEPT_EQUATIONS)
def _means_of_shapes(model: CondensedModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return of each coordinate the normal (r, dims), and means over the length of two products of its shape (r,).

    The first is that with 1 - sigma, which moves with the lower end, the second that with sigma.  Normals are those at the start.
    """
    chain, mass = model.chain, model.root_total_mass**2
    ends = chain.p.initial_ends
    normals = ChordFrame.of((ends[1] - ends[0])[None], model.reference).normals[0]
    weighted = model.shapes * model.mass
    of_upper = weighted @ (chain.arc_length / chain.total_length) / mass
    of_lower = weighted.sum(axis=1) / mass - of_upper
    return np.repeat(normals, [len(of_lower[which]) for which in model.sets], axis=0), of_lower, of_upper
