"""A-posteriori estimate of the error of the Galerkin model, from the residual of a richer one."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cablepod.condensed._estimate import MAX_ERROR, enriched_model, integrate_error, sample_steps
from cablepod.condensed._fields import positions
from cablepod.condensed._model import CondensedModel as Condensed
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import SceneError
from cablepod.galerkin._model import GalerkinModel
from cablepod.galerkin._runs import GalerkinTrajectory
from cablepod.integrate._step_control import motion_scale

#: Combinations of the modes whose deflection is smaller than this share of that of others move along the chord only.
CHORDWISE_SHARE = 1e-6
#: Samples taken to positions at once, which bounds the memory.
BLOCK = 1024


def estimate(
    model: GalerkinModel, sample: Callable[[np.ndarray, float], GalerkinTrajectory], rate: float, until: float
) -> float:
    """Estimate the largest error over time as a fraction of the motion.

    What the particles of the model do normal to the chord is put into the equations of a richer model of the same links: many
    more modes of the deflection, the stretch along the chord as the links need it to reach from end to end, its inertia.  There
    the residual at sampled instants drives the error, see :func:`cablepod.condensed._estimate.estimate`; what the particles are
    off along the chord is added.  The error of the step is not seen.

    Parameters
    ----------
    model
        What was run.
    sample
        Returns its trajectory at given instants [s], for so many steps per second.
    rate
        Steps per second of the run.
    until
        Its end [s].

    Returns
    -------
    float
        At most 2, where nothing is right.  Not a number where there is no such estimate: the cable runs back along its chord, or
        the chord turns so far that it does not tell deflection in the plane from that out of it.
    """
    if until == 0.0:
        return 0.0
    p = model.chain.p
    try:
        frame = _frame(model, np.zeros(1), None)
        rich = _richer(model, frame)
        steps = sample_steps(_square(model, rich, until), _count(model), rate, until)
        times = steps / rate
        state = sample(times, rate)
        motion, off, moved = _motion(model, rich, state, times)
    except SceneError:
        return math.nan
    if not np.isfinite(off).all():
        return math.nan
    rest = rich.initial()[0] if p.initial else rich.equilibrium(motion[0][0])
    first = np.zeros(motion[0].shape[1]) if rest is None else rest - motion[0][0]
    return min(math.sqrt((integrate_error(rich, motion, steps, rate, first) + off).max()) / moved, MAX_ERROR)


def _count(model: GalerkinModel) -> int:
    """Modes of each coordinate."""
    return len(model.modes) // (model.chain.p.dims if model.layout == "separate" else 1)


def _frame(model: GalerkinModel, times: np.ndarray, reference: int | None) -> ChordFrame:
    ends = model.chain.p.end_positions(times)
    return ChordFrame.of(ends[:, 1] - ends[:, 0], reference)


def _richer(model: GalerkinModel, frame: ChordFrame) -> Condensed:
    """Make the richer model, whose modes hold the deflection of the mean shape and of all modes."""
    fields = np.concatenate([model.mean[None], model.fields])
    fields[:, [0, -1]] = 0.0
    sets = []
    for normal in frame.normals[0]:
        deflection = fields @ normal
        size = np.sqrt(np.sum(deflection**2, axis=1))
        some = size > CHORDWISE_SHARE * size.max()
        kept = np.zeros((0, fields.shape[1]))
        if some.any():
            _, values, rows = np.linalg.svd(deflection[some] / size[some, None], full_matrices=False)
            kept = rows[values > CHORDWISE_SHARE * values[0]]
        sets.append(kept)
    chain = LumpedChain(model.chain.p, model.chain.length, model.chain.arc_length, model.law)
    return enriched_model(chain, sets)


def _square(model: GalerkinModel, rich: Condensed, until: float) -> float:
    """Square of the frequency of the last mode, taken for a sine of a taut string [1/s^2]."""
    p, length = model.chain.p, model.chain.total_length
    ends = p.end_positions(np.linspace(0.0, until, 1001))
    reach = math.sqrt(square(ends[:, 1] - ends[:, 0]).max())
    tension = max(p.stiffness * (reach / length - 1.0), rich.rest_tension, 1e-12 * p.stiffness)
    return tension / p.mass * (math.pi * _count(model) / length) ** 2


def _motion(
    model: GalerkinModel, rich: Condensed, state: GalerkinTrajectory, times: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray, float]:
    """Deflection with its rates and second rates in the richer coordinates, what is off along the chord, the motion.

    Returns
    -------
    tuple of float arrays (times, r)
    float array (times,)
        Mean square over the particles of the distance from where the links would be by themselves [m^2]; infinite where they run
        back along the chord.
    float
        Largest rms displacement [m].
    """
    parts, off = [], np.empty(times.size)
    first = model.positions(state.q[:1], times[:1])[0]
    furthest, most = first, 0.0
    for begin in range(0, times.size, BLOCK):
        at = slice(begin, begin + BLOCK)
        frame = _frame(model, times[at], rich.reference)
        position = model.positions(state.q[at], times[at])
        along, deflection = frame.split(position)
        # rates of particles against the line between the ends, whose own the richer model knows
        rates = [
            np.einsum("tpc,tkc->ktp", np.tensordot(item[at], model.fields, axes=1), frame.normals)
            for item in (state.rates, state.second)
        ]
        parts.append([rich.coordinates(item) for item in (deflection, *rates)])
        ahead = np.diff(along, axis=1).min(axis=1) > 0.0
        closed = positions(rich, parts[-1][0], times[at])
        off[at] = np.where(ahead, square(closed - position).mean(axis=1), np.inf)
        moved = square(position - first).mean(axis=1)
        if moved.max() > most:
            most, furthest = moved.max(), position[moved.argmax()]
    q, v, a = (np.concatenate(item) for item in zip(*parts, strict=True))
    return (q, v, a), off, motion_scale(furthest[None], first, float(np.linalg.norm(first[-1] - first[0])))
