"""A-posteriori estimate of the error of reduced models, from the residual of a richer one, and of the condensed model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from cablepod.condensed._fields import CondensedTrajectory, positions
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain
from cablepod.integrate._step_control import motion_scale

#: The richer model has so many coordinates of each deflection, but no more than the particles allow.
MIN_ENRICHED_MODES = 16
#: Distance of the samples times the frequency of the first mode left out: what is retained is resolved, what drives it sampled.
SAMPLING_PHASE = 0.7
#: No more samples than this: then they lie further apart, and the estimate is coarser.
MAX_SAMPLES = 20_000
#: An error above twice the motion says that nothing is right: the linear equation may grow beyond.
MAX_ERROR = 2.0


def enriched_model(chain: LumpedChain, sets: Sequence[np.ndarray]) -> CondensedModel:
    """Make the model of order "inertial" on the links of a chain with modes as given (mode, particle) and sines besides."""
    sigma = chain.arc_length / chain.total_length
    modes = []
    for psi in sets:
        count = min(max(MIN_ENRICHED_MODES, len(psi) + 6), sigma.size - 2)
        sines = np.sin(math.pi * np.outer(np.arange(1, count + 1), sigma))
        basis = np.linalg.qr(np.concatenate([psi, sines]).T)[0].T[:count]
        basis[:, [0, -1]] = 0.0
        modes.append(basis)
    return CondensedModel(chain, "inertial", tuple(modes))


def sample_steps(square: float, modes: int, rate: float, until: float) -> np.ndarray:
    """Choose the steps at which the residual is taken.

    Parameters
    ----------
    square
        Square of the frequency of the last mode [1/s^2].
    modes
        Number of modes.
    rate, until
        Steps per second, end [s].
    """
    left_out = math.sqrt(square) * (modes + 1.0) / max(modes, 1)
    every = max(1, round(SAMPLING_PHASE / left_out * rate), math.ceil(until * rate / MAX_SAMPLES))
    return np.arange(int(until * rate) // every + 1) * every


def integrate_error(
    rich: CondensedModel,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    steps: np.ndarray,
    rate: float,
    first: np.ndarray,
) -> np.ndarray:
    """Mean square of the error over the particles [m^2] at sampled steps, as the residual of a richer model drives it.

    Parameters
    ----------
    rich
        The richer model.
    motion
        Its coordinates in the motion that is judged (samples, r), their rates and second rates.
    steps, rate
        Numbers of the steps, how many there are per second.
    first
        Error at the start (r,).
    """
    from cablepod.condensed import _kernels_error as kernel  # numba is imported only to compute

    chain, p, q = rich.chain, rich.chain.p, motion[0]
    rows = rich.boundary_data_at(steps / rate)
    sizes = np.empty(steps.size)
    every = float(steps[1] - steps[0]) if steps.size > 1 else 1.0
    kernel.error_growth(
        *motion, rows, every / rate, p.mass_damping or 0.0, p.stiffness, rich.slopes, rich.n_in_plane, rich.chordwise_force_patterns, chain.length,
        rich.green, rich.load_projection, rich.inertia, first, rich.guess(rows[0], q[0]),
        np.full(chain.links, rich.first_stretch(rows[0])), chain.arc_length / chain.total_length, sizes,
    )  # fmt: skip
    return np.nan_to_num(sizes, nan=np.inf)


def estimate(
    model: CondensedModel, sample: Callable[[np.ndarray, float], CondensedTrajectory], rate: float, until: float
) -> float:
    """Estimate the largest error over time as a fraction of the motion.

    The motion of the model is put into the equations of a richer one (more modes, the chordwise stretch as it is, inertia along
    the chord).  What they leave, the residual at sampled instants, drives the error, by the equations linearised about the
    motion: M e'' + K(t) e = residual.  So it sees modes that are missing, their effect on those retained as it builds up in time,
    and what the order leaves out, but not the error of the step.

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
    """
    if until == 0.0:
        return 0.0
    rich = enriched_model(model.chain, model.modes)
    p = rich.chain.p
    steps = sample_steps(
        max(model.omega_taut_squared(until), model.omega_max_squared(*_start(model))), model.n_in_plane, rate, until
    )
    times = steps / rate
    state = sample(times, rate)
    rates, second = 0.5 * (state.halves[:, 0] + state.halves[:, 1]), (state.halves[:, 1] - state.halves[:, 0]) * rate
    change = (rich.shapes * rich.mass) @ model.shapes.T
    change[: rich.n_in_plane, model.n_in_plane :] = change[rich.n_in_plane :, : model.n_in_plane] = 0.0
    q = state.saved @ change.T
    sizes = integrate_error(rich, (q, rates @ change.T, second @ change.T), steps, rate, rich.initial()[0] - q[0])
    some = np.unique(np.linspace(0, times.size - 1, 200).astype(int))
    shapes = positions(model, state.saved[some], times[some])
    motion = motion_scale(shapes, shapes[0], float(np.linalg.norm(p.upper - p.lower)))
    return min(math.sqrt(sizes.max()) / motion, MAX_ERROR)


def _start(model: CondensedModel) -> tuple[np.ndarray, np.ndarray, float]:
    q, v = model.initial()
    return q, model.initial_boundary_data, model.force(q, v, model.initial_boundary_data)[2]
