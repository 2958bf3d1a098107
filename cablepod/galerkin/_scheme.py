"""Choice of scheme and step of the Galerkin model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from cablepod.errors import RunStopped
from cablepod.galerkin._implicit import ImplicitGalerkinRun
from cablepod.galerkin._record import GalerkinTrajectory
from cablepod.galerkin._runs import GalerkinRun
from cablepod.integrate._request import REDUCED_TOLERANCE, TIME_ERROR_SHARE, Request
from cablepod.integrate._scheme import Halving, SchemeChoice, Solution
from cablepod.integrate._step_control import Found, Refinement, complete, fit_step, refine_step

SCHEMES = ("velocity_verlet", "filtered_verlet", "trapezoidal")
EXPLICIT = SCHEMES[:2]
#: Maximum number of times that the steps are shortened because a finer run expects less of the model.
MAX_PASSES = 3
#: Cost of an implicit step in explicit steps, and its increase for each amplitude (measured with 40 links).
IMPLICIT_COST, COST_OF_AMPLITUDE = 4.0, 0.45
#: Run time of an explicit step, and its increase for each amplitude [s].
STEP_TIME, TIME_OF_AMPLITUDE = 2e-7, 2e-8
#: Maximum steps per second of halved implicit runs over those of the first (beyond it an order of convergence is observed).
TRIAL_RATIO = 16.0


class FittedSolution(NamedTuple):
    """A solution, its tolerance, and the estimated error of the model."""

    solution: Solution
    tolerance: float | None = None  #: of the time error, as a fraction of the motion; None for a given step
    model_error: float | None = None  #: as a fraction of the motion; None if it was not needed


def solve(
    runs: dict[str, GalerkinRun],
    limit: float,
    request: Request,
    steps_per_second: float | None,
    model_error: Callable[[GalerkinTrajectory], float],
) -> FittedSolution:
    """Integrate with the given scheme and step, or choose them by the tolerance, or by the error of the model.

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
    model_error
        Estimates the error of the model from a trajectory with samples; nan if that is impossible.
    """
    run = runs[request.scheme or SCHEMES[0]]
    if steps_per_second is not None:
        return FittedSolution(Solution(run, run(steps_per_second), steps_per_second, None))
    if request.scheme is not None:
        return FittedSolution(Solution(run, *_refine_in_time(run, limit, request.tolerance)), request.tolerance)
    fitted = None
    if request.given_tolerance is None:
        fitted = _fit_to_model(runs["filtered_verlet"], limit, model_error)
    if fitted is None:
        solution = _choose_scheme(runs, limit, request.tolerance, asked=request.given_tolerance is not None)
        return FittedSolution(solution, request.tolerance)
    return fitted


def _fit_to_model(
    run: GalerkinRun, limit: float, model_error: Callable[[GalerkinTrajectory], float]
) -> FittedSolution | None:
    """Run with a step whose error is a tenth of that of the model; None if that has no estimate or no such run is stable.

    The second run tells the error of the model, as the first may resolve the motion too badly.  The run that meets a tenth of it
    tells it again, and steps are shortened until that holds for its own estimate.
    """
    compared: Any = run.comparable_runs(limit)
    done: dict[float, GalerkinTrajectory] = {}
    errors: dict[float, float] = {}

    def kept(steps_per_second: float) -> GalerkinTrajectory:
        if steps_per_second not in done:
            done[steps_per_second] = compared.run(steps_per_second, sampled=bool(done))
        return done[steps_per_second]

    def tolerance(rate: float) -> float:
        errors[rate] = errors[rate] if rate in errors else model_error(kept(rate))
        # without an estimate any run will do, as it is not used
        return math.inf if math.isnan(errors[rate]) else max(TIME_ERROR_SHARE * errors[rate], REDUCED_TOLERANCE)

    runs = replace(compared, run=kept)

    try:
        fitted: Any = fit_step(runs, lambda second: tolerance(second.instants.steps_per_second))
        for _ in range(MAX_PASSES):
            expected = tolerance(fitted.steps_per_second)
            if fitted.error <= expected:
                break
            again = Refinement(replace(runs, steps_per_second=fitted.steps_per_second), expected, economical=True)
            fitted = complete(again)
    except RunStopped:
        return None
    if any(math.isnan(error) for error in errors.values()):
        return None
    reason = "explicit: vibrations that the step does not resolve are slowed"
    trajectory, rate, time_error = fitted
    return FittedSolution(Solution(run, trajectory, rate, time_error, reason), tolerance(rate), errors[rate])


def _choose_scheme(runs: dict[str, GalerkinRun], limit: float, tolerance: float, *, asked: bool) -> Solution:
    """Choose scheme and step for a tolerance: implicit if its steps are long enough to be faster."""
    explicit, implicit = runs["velocity_verlet"], runs["trapezoidal"]
    explicit_runs, amplitudes = explicit.comparable_runs(limit), explicit.q0.size
    steps_per_second = explicit_runs.steps_per_second
    seconds = 3.0 * explicit.end_time * steps_per_second * (STEP_TIME + TIME_OF_AMPLITUDE * amplitudes)
    search = SchemeChoice(
        explicit_runs,
        implicit.comparable_runs(limit),
        tolerance,
        step_limit=limit,
        explicit_seconds=None if asked else seconds,
        # two explicit runs take 1 + 2 times these steps, all implicit ones together at most twice the maximum
        max_steps_per_second=1.5 * steps_per_second / (IMPLICIT_COST + COST_OF_AMPLITUDE * amplitudes),
    )
    complete(search)
    return Solution.of(search)


def _refine_in_time(run: GalerkinRun, limit: float, tolerance: float) -> Found:
    """Shorten the step until two runs agree."""
    runs = run.comparable_runs(limit)
    if isinstance(run, ImplicitGalerkinRun):
        maximum = TRIAL_RATIO * runs.steps_per_second
        halved: Found | None = complete(Halving(runs, tolerance, maximum))
        if halved is not None:
            return halved
        runs = replace(runs, steps_per_second=maximum, resolved=1.0 / limit)
    return refine_step(runs, tolerance)
