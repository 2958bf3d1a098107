"""Choice of scheme and step of the Galerkin model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cablepod.galerkin._implicit import ImplicitGalerkinRun
from cablepod.galerkin._runs import GalerkinRun, GalerkinTrajectory
from cablepod.integrate._request import Request
from cablepod.integrate._step_control import (
    STEPS_PER_CHANGE,
    ComparableRuns,
    Solution,
    choose_scheme,
    first_implicit_step,
    halve_step_while_cheaper,
    motion_scale,
    preferred_steps_per_second,
    refine_step,
)

SCHEMES = ("velocity_verlet", "trapezoidal", "energy_momentum")
#: Cost of an implicit step in explicit steps, and its increase for each amplitude (measured with 40 links).
IMPLICIT_COST, COST_OF_AMPLITUDE = 4.0, 0.45
#: Run time of an explicit step, and its increase for each amplitude [s].
STEP_TIME, TIME_OF_AMPLITUDE = 2e-7, 2e-8
#: Maximum steps per second of halved implicit runs over those of the first (beyond it an order of convergence is observed).
TRIAL_RATIO = 16.0


def solve(runs: dict[str, GalerkinRun], limit: float, request: Request, steps_per_second: float | None) -> Solution:
    """Integrate with the given scheme and step, or choose them by the tolerance.

    Parameters
    ----------
    runs
        The run of each scheme.
    limit
        Stability limit of explicit steps [s].
    request
        Scheme and tolerance, as far as given.
    steps_per_second
        Of the given step; None if the step is to be chosen.
    """
    run = runs[request.scheme or SCHEMES[0]]
    if steps_per_second is not None:
        return Solution(run, run(steps_per_second), steps_per_second, None)
    if request.scheme is not None:
        return Solution(run, *_refine_in_time(run, limit, request.tolerance))
    return _choose_scheme(runs, limit, request.tolerance, asked=request.given_tolerance is not None)


def _choose_scheme(runs: dict[str, GalerkinRun], limit: float, tolerance: float, *, asked: bool) -> Solution:
    """Choose scheme and step for a tolerance: implicit if its steps are long enough to be faster."""
    explicit, implicit = runs["velocity_verlet"], runs["trapezoidal"]
    explicit_runs, amplitudes = _comparable_runs(explicit, limit), explicit.q0.size
    steps_per_second = explicit_runs.steps_per_second
    seconds = 3.0 * float(explicit.times[-1]) * steps_per_second * (STEP_TIME + TIME_OF_AMPLITUDE * amplitudes)
    return choose_scheme(
        explicit_runs,
        _comparable_runs(implicit, limit),
        tolerance,
        step_limit=limit,
        explicit_seconds=None if asked else seconds,
        # two explicit runs take 1 + 2 times these steps, all implicit ones together at most twice the maximum
        max_steps_per_second=1.5 * steps_per_second / (IMPLICIT_COST + COST_OF_AMPLITUDE * amplitudes),
    )


def _refine_in_time(run: GalerkinRun, limit: float, tolerance: float) -> tuple[GalerkinTrajectory, float, float]:
    """Shorten the step until two runs agree; return trajectory, steps per second and time error."""
    runs = _comparable_runs(run, limit)
    if isinstance(run, ImplicitGalerkinRun):
        maximum = TRIAL_RATIO * runs.steps_per_second
        halved = halve_step_while_cheaper(runs, tolerance, maximum)
        if halved is not None:
            return halved
        runs = replace(runs, steps_per_second=maximum)
    return refine_step(runs, tolerance)


def _comparable_runs(run: GalerkinRun, limit: float) -> ComparableRuns:
    """Describe runs with any step for the step control."""
    model, p = run.model, run.model.chain.p
    chord = float(np.linalg.norm(p.upper - p.lower))
    initial = model.positions(run.q0[None], np.zeros(1))[0]

    def positions(trajectory: GalerkinTrajectory) -> np.ndarray:
        return model.positions(trajectory.q, trajectory.instants.times)

    def motion(trajectory: GalerkinTrajectory) -> float:
        return motion_scale(positions(trajectory), initial, chord)

    def slackened(trajectory: GalerkinTrajectory) -> bool:
        # only the linear law has a kink at stretch 1
        position = model.positions(trajectory.q, run.times)
        return model.law == "linear" and bool((model.chain.stretch(position) < 1.0).any())

    step = 0.8 * limit
    if isinstance(run, ImplicitGalerkinRun):
        step = first_implicit_step(model.chain, model.tension(initial), float(run.times[-1]), limit)
    steps_per_second = preferred_steps_per_second(1.0 / min(step, p.shortest_time_scale / STEPS_PER_CHANGE))
    return ComparableRuns(run, positions, motion, steps_per_second, float(run.times[-1]), model.chain.links, slackened)
