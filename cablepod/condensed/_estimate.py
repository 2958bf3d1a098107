"""A-posteriori error estimate of reduced models from the residual of an enriched condensed model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from cablepod.condensed._fields import CondensedTrajectory, positions
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain
from cablepod.integrate._step_control import motion_scale

#: Minimum number of modes of each deflection in the enriched model (fewer where there are fewer particles).
MIN_ENRICHED_MODES = 16
#: Interval of the residual samples times the angular frequency of the first truncated mode.
SAMPLING_PHASE = 0.7
#: Maximum number of samples (longer runs are sampled at longer intervals).
MAX_SAMPLES = 20_000
#: Maximum estimate: above twice the motion the linearised error equation means nothing.
MAX_ERROR = 2.0
#: Maximum number of instants at which the scale of the motion is computed.
MOTION_SAMPLES = 200


def enriched_model(chain: LumpedChain, sets: Sequence[np.ndarray]) -> CondensedModel:
    """Make a model of order "inertial" on the links of a chain, with modes (mode, particle) and sines."""
    sigma = chain.arc_length / chain.total_length
    modes = []
    for psi in sets:
        count = min(max(MIN_ENRICHED_MODES, len(psi) + 6), sigma.size - 2)
        sines = np.sin(math.pi * np.outer(np.arange(1, count + 1), sigma))
        basis = np.linalg.qr(np.concatenate([psi, sines]).T)[0].T[:count]
        basis[:, [0, -1]] = 0.0
        modes.append(basis)
    return CondensedModel(chain, "inertial", tuple(modes))


def sample_steps(omega_squared: float, modes: int, steps_per_second: float, end_time: float) -> np.ndarray:
    """Choose the steps at which the residual is sampled.

    Parameters
    ----------
    omega_squared
        Squared angular frequency of the last retained mode [1/s^2].
    modes
        Number of retained modes.
    steps_per_second, end_time
        Steps per second of the run, and its end [s].
    """
    omega_truncated = math.sqrt(omega_squared) * (modes + 1.0) / max(modes, 1)
    interval = max(
        1,
        round(SAMPLING_PHASE / omega_truncated * steps_per_second),
        math.ceil(end_time * steps_per_second / MAX_SAMPLES),
    )
    return np.arange(int(end_time * steps_per_second) // interval + 1) * interval


def integrate_error(
    enriched: CondensedModel,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    steps: np.ndarray,
    steps_per_second: float,
    initial_error: np.ndarray,
) -> np.ndarray:
    """Integrate the linearised error equation, driven by the residual of the enriched model.

    Parameters
    ----------
    enriched
        Enriched model.
    motion
        Reduced motion in its coordinates (samples, r), with rates and accelerations.
    steps, steps_per_second
        Numbers of the sampled steps, and steps per second.
    initial_error
        Error at the start (r,).

    Returns
    -------
    numpy.ndarray
        Mean square of the error over the particles (samples,) [m^2].
    """
    from cablepod.condensed import _kernels_error as kernel  # numba is imported only to compute

    chain, p, q = enriched.chain, enriched.chain.p, motion[0]
    boundary_data = enriched.boundary_data_at(steps / steps_per_second)
    mean_squares = np.empty(steps.size)
    interval = float(steps[1] - steps[0]) if steps.size > 1 else 1.0
    kernel.error_growth(
        *motion, boundary_data, interval / steps_per_second, p.damping, p.stiffness, enriched.slopes,
        enriched.n_in_plane, enriched.chordwise_force_patterns, chain.length, enriched.green,
        enriched.load_projection, enriched.inertia, initial_error, enriched.tension_guess(boundary_data[0], q[0]),
        np.full(chain.links, enriched.stretch_guess(boundary_data[0])), chain.arc_length / chain.total_length,
        mean_squares,
    )  # fmt: skip
    return np.nan_to_num(mean_squares, nan=np.inf)


def estimate(
    model: CondensedModel,
    sample: Callable[[np.ndarray, float], CondensedTrajectory],
    steps_per_second: float,
    end_time: float,
) -> float:
    """Estimate the largest error over time as a fraction of the motion.

    The motion of the model is put into the equations of an enriched one (more modes, exact chordwise stretch, chordwise inertia).
    Their residual at sampled instants drives the error, by the equations linearised about the motion: M e'' + K(t) e = residual.
    The estimate contains the truncated modes, their effect on the retained ones over time, and the terms that the order neglects,
    but not the error of the step.

    Parameters
    ----------
    model
        Model of the run.
    sample
        Returns the trajectory of the run at given instants [s], for given steps per second.
    steps_per_second
        Steps per second of the run.
    end_time
        End of the run [s].
    """
    if end_time == 0.0:
        return 0.0
    enriched = enriched_model(model.chain, model.modes)
    p = enriched.chain.p
    q, v = model.initial()
    boundary_data = model.initial_boundary_data
    initial_omega_squared = model.omega_max_squared(q, boundary_data, model.force(q, v, boundary_data)[2])
    omega_squared = max(model.omega_taut_squared(end_time), initial_omega_squared)
    steps = sample_steps(omega_squared, model.n_in_plane, steps_per_second, end_time)
    times = steps / steps_per_second
    state = sample(times, steps_per_second)
    change = (enriched.shapes * enriched.mass) @ model.shapes.T  # of coordinates
    in_plane, enriched_in_plane = model.n_in_plane, enriched.n_in_plane
    change[:enriched_in_plane, in_plane:] = change[enriched_in_plane:, :in_plane] = 0.0
    motion = tuple(array @ change.T for array in (state.saved, state.saved_rates, state.saved_accelerations))
    initial_error = enriched.initial()[0] - motion[0][0]
    mean_squares = integrate_error(enriched, motion, steps, steps_per_second, initial_error)
    sample_indices = np.unique(np.linspace(0, times.size - 1, MOTION_SAMPLES).astype(int))
    shapes = positions(model, state.saved[sample_indices], times[sample_indices])
    scale = motion_scale(shapes, shapes[0], float(np.linalg.norm(p.upper - p.lower)))
    return min(math.sqrt(mean_squares.max()) / scale, MAX_ERROR)
