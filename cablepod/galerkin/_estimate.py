"""A-posteriori error estimate of the Galerkin model from the residual of an enriched model."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cablepod.condensed._estimate import MAX_ERROR, ErrorEquation, enriched_modes, sample_interval
from cablepod.condensed._fields import positions
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import SceneError
from cablepod.galerkin._model import GalerkinModel
from cablepod.galerkin._runs import GalerkinTrajectory
from cablepod.integrate._step_control import motion_scale

#: Relative tolerance of deflections: combinations of modes below it move the cable along the chord only.
DEFLECTION_RTOL = 1e-6
#: Interval of the residual samples times the angular frequency of the first truncated mode: shorter than for the condensed model,
#: because accelerations contain waves along the cable.
SAMPLING_PHASE = 0.3
#: Maximum number of samples converted to positions at once (bounds the memory).
BLOCK = 1024


def estimate(
    model: GalerkinModel,
    sample: Callable[[np.ndarray, float], GalerkinTrajectory],
    steps_per_second: float,
    end_time: float,
) -> float:
    """Estimate the largest error over time as a fraction of the motion.

    The deflection of the particles normal to the chord is inserted into an enriched condensed model of the same links.  That
    model has many more modes, the chordwise stretch that closes the chord, and chordwise inertia.  Its residual at sampled
    instants drives the error equation, see :func:`cablepod.condensed._estimate.estimate`.  The distance of the particles from
    their chordwise positions is added.  The time error of the step is not included.

    Parameters
    ----------
    model
        The model of the run.
    sample
        Function of instants [s] and steps per second that returns the trajectory there.
    steps_per_second
        Steps per second of the run.
    end_time
        End of the run [s].

    Returns
    -------
    float
        At most 2, an error larger than the motion.  nan if no estimate exists: the cable runs back along its chord, or the
        chord turns so far that in-plane and out-of-plane deflections mix.
    """
    if end_time == 0.0:
        return 0.0
    p = model.chain.p
    try:
        frame = _chord_frame(model, np.zeros(1), None)
        enriched, equation = _enriched_model(model, frame)
        omega_squared = _last_frequency_squared(model, enriched, end_time)
        interval = sample_interval(
            omega_squared, _modes_per_coordinate(model), steps_per_second, end_time, SAMPLING_PHASE
        )
        times = np.arange(int(end_time * steps_per_second) // interval + 1) * (interval / steps_per_second)
        trajectory = sample(times, steps_per_second)
        motion, chordwise, moved = _enriched_motion(model, enriched, trajectory, times)
    except SceneError:
        return math.nan
    if not np.isfinite(chordwise).all():
        return math.nan
    q, rates = motion[0][0], motion[1][0]
    if p.initial:
        initial_error = equation.coordinates(enriched.start_deflection()[:, 0]) - equation.change @ q
    else:
        initial_error = equation.error_at_rest(q, enriched.static_boundary_data)
    start_rates = enriched.start_deflection_rates
    initial_rate = np.zeros_like(initial_error)
    if start_rates is not None:
        initial_rate = equation.coordinates(start_rates) - equation.change @ rates
    boundary_data = enriched.boundary_data_at(times)
    deflection = equation.mean_squares(motion, boundary_data, interval / steps_per_second, initial_error, initial_rate)
    return min(math.sqrt((deflection + chordwise).max()) / moved, MAX_ERROR)


def _modes_per_coordinate(model: GalerkinModel) -> int:
    """Return the number of modes of each coordinate."""
    return len(model.modes) // (model.chain.p.dims if model.layout == "separate" else 1)


def _chord_frame(model: GalerkinModel, times: np.ndarray, reference: int | None) -> ChordFrame:
    """Chord frame of the ends at given instants [s]."""
    ends = model.chain.p.end_positions(times)
    return ChordFrame.of(ends[:, 1] - ends[:, 0], reference)


def _enriched_model(model: GalerkinModel, frame: ChordFrame) -> tuple[CondensedModel, ErrorEquation]:
    """Return the enriched model and the error equation of motions in its coordinates.

    Its modes contain the deflections of the mean shape and of all modes.
    """
    fields = np.concatenate([model.mean[None], model.fields])
    fields[:, [0, -1]] = 0.0
    sets = []
    for normal in frame.normals[0]:
        deflection = fields @ normal
        norm = np.sqrt(np.sum(deflection**2, axis=1))
        deflected = norm > DEFLECTION_RTOL * norm.max()
        basis = np.zeros((0, fields.shape[1]))
        if deflected.any():
            _, values, rows = np.linalg.svd(deflection[deflected] / norm[deflected, None], full_matrices=False)
            basis = rows[values > DEFLECTION_RTOL * values[0]]
        sets.append(basis)
    chain = LumpedChain(model.chain.p, model.chain.length, model.chain.arc_length, model.law)
    enriched = CondensedModel(chain, "inertial", enriched_modes(sets, chain.arc_length / chain.total_length))
    return enriched, ErrorEquation.of(chain, sets, enriched.shapes, enriched.n_in_plane, leading=False)


def _last_frequency_squared(model: GalerkinModel, enriched: CondensedModel, end_time: float) -> float:
    """Squared angular frequency of the last mode [1/s^2], as a sine of a taut string."""
    p, length = model.chain.p, model.chain.total_length
    ends = p.end_positions(np.linspace(0.0, end_time, 1001))
    chord = math.sqrt(square(ends[:, 1] - ends[:, 0]).max())
    tension = max(p.stiffness * (chord / length - 1.0), enriched.rest_tension, 1e-12 * p.stiffness)
    return tension / p.mass * (math.pi * _modes_per_coordinate(model) / length) ** 2


def _enriched_motion(
    model: GalerkinModel, enriched: CondensedModel, trajectory: GalerkinTrajectory, times: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray, float]:
    """Express a trajectory in the coordinates of the enriched model.

    Returns
    -------
    tuple of float arrays (times, r)
        Coordinates of the deflection, and their first and second time derivatives.
    float array (times,)
        Mean square distance of the particles from their positions in the enriched model [m^2]; infinite if they run back along
        the chord.
    float
        Largest rms displacement [m].
    """
    blocks, chordwise = [], np.empty(times.size)
    initial = model.positions(trajectory.q[:1], times[:1])[0]
    furthest, largest = initial, 0.0
    for begin in range(0, times.size, BLOCK):
        block = slice(begin, begin + BLOCK)
        frame = _chord_frame(model, times[block], enriched.reference)
        position = model.positions(trajectory.q[block], times[block])
        along, deflection = frame.split(position)
        # derivatives relative to the line between the ends, which the enriched model adds
        derivatives = [
            np.einsum("tpc,tkc->ktp", np.tensordot(rates[block], model.fields, axes=1), frame.normals)
            for rates in (trajectory.rates, trajectory.second_rates)
        ]
        blocks.append([enriched.coordinates(values) for values in (deflection, *derivatives)])
        ordered = np.diff(along, axis=1).min(axis=1) > 0.0
        closed = positions(enriched, blocks[-1][0], times[block])
        chordwise[block] = np.where(ordered, square(closed - position).mean(axis=1), np.inf)
        moved = square(position - initial).mean(axis=1)
        if moved.max() > largest:
            largest, furthest = moved.max(), position[moved.argmax()]
    q, v, a = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    chord = float(np.linalg.norm(initial[-1] - initial[0]))
    return (q, v, a), chordwise, motion_scale(furthest[None], initial, chord)
