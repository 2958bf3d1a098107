"""A-posteriori estimate of the error of the condensed model, from the residual of a richer one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cablepod.condensed_model import Model
from cablepod.condensed_output import State, positions
from cablepod.stepping import motion_scale

#: The richer model has so many coordinates of each deflection, but no more than the particles allow.
RICH = 16
#: Distance of the samples times the frequency of the first mode left out: what is retained is resolved, what drives it sampled.
SAMPLING = 0.7
#: No more samples than this: then they lie further apart, and the estimate is coarser.
MOST_SAMPLES = 20_000
#: An error above twice the motion says that nothing is right: the linear equation may grow beyond.
WORST = 2.0


def richer(model: Model) -> Model:
    """Make the model of order "inertial" on the same particles whose modes are those of `model` and sines besides."""
    sigma = model.chain.arc_length / model.chain.total_length
    sets = []
    for psi in model.modes:
        count = min(max(RICH, len(psi) + 6), sigma.size - 2)
        sines = np.sin(math.pi * np.outer(np.arange(1, count + 1), sigma))
        basis = np.linalg.qr(np.concatenate([psi, sines]).T)[0].T[:count]
        basis[:, [0, -1]] = 0.0
        sets.append(basis)
    return replace(model, order="inertial", modes=tuple(sets), quadrature=None)


def estimate(model: Model, run: Callable[[np.ndarray, float], State], rate: float, until: float) -> float:
    """Estimate the largest error over time as a fraction of the motion.

    The motion of the model is put into the equations of a richer one (more modes, the chordwise stretch as it is, inertia along
    the chord).  What they leave, the residual at sampled instants, drives the error, by the equations linearised about the
    motion: M e'' + K(t) e = residual.  So it sees modes that are missing, their effect on those retained as it builds up in time,
    and what the order leaves out, but not the error of the step.

    Parameters
    ----------
    model
        What was run.
    run
        Runs it with output at given instants and so many steps per second.
    rate
        Steps per second of the run.
    until
        Its end [s].
    """
    from cablepod.kernels import condensed as kernel  # numba is imported only to compute

    rich = richer(model)
    chain, p = rich.chain, rich.chain.p
    taut = max(model.taut_square(until), model.highest_square(*_start(model))) * (len(model.modes[0]) + 1.0) ** 2
    taut /= max(len(model.modes[0]), 1) ** 2
    if until == 0.0:
        return 0.0
    every = max(1, round(SAMPLING / math.sqrt(taut) * rate), math.ceil(until * rate / MOST_SAMPLES))
    count = int(until * rate) // every + 1
    times = np.arange(count) * every / rate
    state = run(times, rate)
    q = state.saved
    rates, second = 0.5 * (state.halves[:, 0] + state.halves[:, 1]), (state.halves[:, 1] - state.halves[:, 0]) * rate
    change = (rich.shapes * rich.mass) @ model.shapes.T
    change[: rich.plane, model.plane :] = change[rich.plane :, : model.plane] = 0.0
    rows = rich.rows_at(times)
    y = q @ change.T
    sizes = np.empty(count)
    kernel.error_growth(
        y, rates @ change.T, second @ change.T, rows, every / rate, p.mass_damping or 0.0, p.stiffness, rich.slopes, rich.plane,
        rich.taus, chain.length, rich.green, rich.pushes, rich.inertia, rich.initial()[0] - y[0], rich.guess(rows[0], y[0]),
        np.full(chain.links, rich.first_stretch(rows[0])), chain.arc_length / chain.total_length, sizes,
    )  # fmt: skip
    some = np.unique(np.linspace(0, count - 1, 200).astype(int))
    shapes = positions(model, q[some], times[some])
    chord = float(np.linalg.norm(p.upper - p.lower))
    error = math.sqrt(np.nan_to_num(sizes, nan=np.inf).max()) / motion_scale(shapes, shapes[0], chord)
    return min(error, WORST)


def _start(model: Model) -> tuple[np.ndarray, np.ndarray, float]:
    q, v = model.initial()
    return q, model.first_row, model.force(q, v, model.first_row)[2]
