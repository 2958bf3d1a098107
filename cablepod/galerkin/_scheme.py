"""Choice of scheme and step of the Galerkin model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cablepod.galerkin._implicit import ImplicitGalerkinRun
from cablepod.galerkin._runs import GalerkinRun, GalerkinTrajectory
from cablepod.integrate._step_control import (
    STEPS_PER_CHANGE,
    halve_step_while_cheaper,
    motion_scale,
    preferred_steps_per_second,
    refine_step,
)

SCHEMES = ("velocity_verlet", "trapezoidal", "energy_momentum")
#: An implicit step costs about as much as so many explicit ones, and so many more for each amplitude (40 links).
IMPLICIT_COST, COST_OF_AMPLITUDE = 4.0, 0.45
#: Below so many seconds of explicit run time no other scheme is tried unasked; seconds per step, and more for each amplitude.
CHOICE_MIN_SECONDS, STEP_TIME, TIME_OF_AMPLITUDE = 0.3, 2e-7, 2e-8
#: Steps of the first implicit run in the period of the first transverse vibration; and how many times as many resolve enough of
#: what moves for runs to show an order.
STEPS_PER_PERIOD, TRIAL_RATIO = 8.0, 16.0


def choose_scheme(
    runs: dict[str, GalerkinRun], limit: float, goal: float, *, asked: bool
) -> tuple[GalerkinRun, tuple[GalerkinTrajectory, float, float], str]:
    """Pick scheme and step for a tolerance: implicit as long as its steps are so long that it is the faster one."""
    explicit, implicit = runs["velocity_verlet"], runs["trapezoidal"]
    *_, rate = _comparison(explicit, limit)
    count = explicit.q0.size
    cost = 3.0 * float(explicit.times[-1]) * rate * (STEP_TIME + TIME_OF_AMPLITUDE * count)
    if not asked and cost < CHOICE_MIN_SECONDS:
        return explicit, refine_in_time(explicit, limit, goal), f"explicit: all its runs take about {cost:.1g} s"
    # the explicit runs have this rate and twice as much, the implicit ones all up to it
    most = 1.5 * rate / (IMPLICIT_COST + COST_OF_AMPLITUDE * count)
    found = halve_step_while_cheaper(*_comparison(implicit, limit), goal, most, _work_size(implicit))
    if found is not None:
        return implicit, found, f"implicit: its steps may be {1.0 / (found[1] * limit):.3g} times the explicit limit"
    why = f"explicit: implicit steps would have to be shorter than {1 / most:.3g} s"
    return explicit, refine_in_time(explicit, limit, goal), why


def refine_in_time(run: GalerkinRun, limit: float, goal: float) -> tuple[GalerkinTrajectory, float, float]:
    model = run.model

    def slackened(state: GalerkinTrajectory) -> bool:
        # law (21) pulls and pushes without a kink
        return model.law == "linear" and bool((model.chain.stretch(model.positions(state.q, run.times)) < 1.0).any())

    size = _work_size(run)
    run, position, scale, rate = _comparison(run, limit)
    if isinstance(run, ImplicitGalerkinRun):
        found = halve_step_while_cheaper(run, position, scale, rate, goal, TRIAL_RATIO * rate, size)
        if found is not None:
            return found
        rate *= TRIAL_RATIO
    return refine_step(run, position, scale, rate, goal, slackened, size)


def _work_size(run: GalerkinRun) -> tuple[float, int]:
    """Until when a run lasts [s], and its number of links."""
    return float(run.times[-1]), run.model.chain.links


def _comparison(
    run: GalerkinRun, limit: float
) -> tuple[GalerkinRun, Callable[[GalerkinTrajectory], np.ndarray], Callable[[GalerkinTrajectory], float], float]:
    """Return a run, how two of them are compared, and the number of steps per second to begin with."""
    model, p = run.model, run.model.chain.p
    chord = float(np.linalg.norm(p.upper - p.lower))
    initial = model.positions(run.q0[None], np.zeros(1))[0]

    def position(state: GalerkinTrajectory) -> np.ndarray:
        return model.positions(state.q, state.instants.times)

    def scale(state: GalerkinTrajectory) -> float:
        return motion_scale(position(state), initial, chord)

    first = 0.8 * limit
    if isinstance(run, ImplicitGalerkinRun):
        tension = max(float(model.tension(initial).mean()), 1e-300)
        period = 2.0 * model.chain.total_length / np.sqrt(tension / p.mass)
        first = float(max(min(float(run.times[-1]) / 20.0, period / STEPS_PER_PERIOD), limit))
    return run, position, scale, preferred_steps_per_second(1.0 / min(first, p.shortest_time_scale / STEPS_PER_CHANGE))
