"""Choice of scheme, step and number of elements of the continuous cable."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from cablepod.cable._equilibrium import TooFewElements
from cablepod.cable._mesh import part_borders
from cablepod.cable._runs import SCHEMES, CableRun, ImplicitCableRun
from cablepod.discretisation._chain import square
from cablepod.errors import NotConvergedWarning, RunStopped, SceneError, warn
from cablepod.integrate._output_times import preferred_steps_per_second
from cablepod.integrate._refinement import observed_order
from cablepod.integrate._request import Request
from cablepod.integrate._scheme import SchemeChoice, Solution
from cablepod.integrate._space_error import (
    CLOSE_TO_LIMIT,
    FEWER_IMPLICIT_STEPS,
    FEWER_STEPS,
    companion_cells,
    companion_steps,
    extrapolated,
)
from cablepod.integrate._step_control import GivenStep, Refinement, Search, complete

#: Numbers of elements, tried in turn (multiples of four, for which the loops over elements vectorise best).  With 40 and 80 the
#: points of a field of gusts, between which it is linear, are borders of elements: within them the motion is smooth.
ELEMENT_COUNTS = (4, 8, 12, 16, 24, 40, 80, 128)
#: Minimum ratio of two numbers of elements whose difference is taken as an error: that of 12 and 16.
MIN_REFINEMENT = 4.0 / 3.0
#: Orders by which a companion of as many elements is lower, by one more where the step is given and cannot be much longer.
LOWER_ORDER = 2
#: Cost of an implicit step in explicit steps, with the iterations of Newton's method.
IMPLICIT_COST = 30.0
#: Run time of an explicit step for each node [s].
NODE_STEP = 1.5e-8


def element_counts(least: int) -> list[int]:
    """Return the numbers of elements to try in turn: two or more, from the minimum for the point loads of a scene on.

    For many point loads they are the minimum and twice as many, which halves each element between equidistant loads.
    """
    counts = [count for count in ELEMENT_COUNTS if count >= least]
    return counts if len(counts) > 1 else [least, 2 * least]


def first_runs(runs: Callable[[int], dict[str, CableRun]], counts: list[int]) -> dict[str, CableRun]:
    """Return the runs with the first number of elements that follow the cable at rest; `runs` and `counts` as elsewhere here."""
    for count in counts[:-1]:
        with suppress(TooFewElements):
            return runs(count)
    return runs(counts[-1])


def solve(runs: dict[str, CableRun], request: Request, steps_per_second: float | None) -> Solution:
    """Integrate with the given scheme and step, or choose them by the tolerance.

    Parameters
    ----------
    runs
        The run of each scheme, with the same elements.
    request
        Scheme and tolerance, as far as given.
    steps_per_second
        Of the given step; None if the step is to be chosen.
    """
    search = _search_of(runs, request, steps_per_second)
    complete(search)
    return Solution.of(search)


def _search_of(runs: dict[str, CableRun], request: Request, steps_per_second: float | None) -> Search:
    """Return the search of :func:`solve`."""
    run = runs[request.scheme or SCHEMES[0]]
    if steps_per_second is not None:
        return GivenStep(run, steps_per_second)
    if request.scheme is not None:
        return Refinement(run.comparable_runs(), request.tolerance)
    explicit, implicit = (runs[name] for name in SCHEMES)
    return SchemeChoice.of_runs(explicit, implicit, request.tolerance, implicit_cost=IMPLICIT_COST, step_time=NODE_STEP)


def refine_in_space(
    runs: Callable[[int], dict[str, CableRun]], solution: Solution, tolerance: float
) -> tuple[Solution, float]:
    """Raise the number of elements until two runs agree; return the finest run and its space error.

    The error estimate is the distance of the first two runs, and from the third run on follows from the observed order, at most
    2.  An end whose acceleration starts with a jump sends out waves with corners, for which no elements have a higher order.

    Parameters
    ----------
    runs
        Function of the number of elements that returns the run of each scheme.
    solution
        First run.  Later steps are not longer than its step.
    tolerance
        Tolerance of the space error as a fraction of the motion.
    """
    run, trajectory, steps_per_second = solution[:3]
    last, factor = np.inf, np.inf
    first = run.chain.sizes.size
    counts = [count for count in element_counts(first) if count >= MIN_REFINEMENT * first]
    for count in counts:
        finer = runs(count)[run.scheme]
        minimum = 0.0 if isinstance(finer, ImplicitCableRun) else 1.0 / finer.unforced_step
        finer_trajectory = finer(
            steps_per_second if steps_per_second >= minimum else preferred_steps_per_second(minimum)
        )
        gap = finer.compared(finer_trajectory) - run.compared(trajectory)
        distance = float(np.sqrt(np.mean(square(gap), axis=-1)).max()) / finer.motion(finer_trajectory)
        refinement = count / run.chain.sizes.size
        estimate = distance
        if last < np.inf:
            order = observed_order(distance / max(last, 1e-300), factor, refinement)
            estimate = distance / (refinement**order - 1.0)
        run, trajectory, last, factor = finer, finer_trajectory, distance, refinement
        if estimate <= (0.5 if count < counts[-1] else 1.0) * tolerance:  # with a margin if a finer mesh is left
            break
    else:
        warn(
            f"not converged in space: estimated error {estimate:.2g} of the motion with {run.chain.sizes.size} elements, "
            f"tolerance {tolerance:.2g} (the motion is chaotic, or the cable goes slack and has corners); give a number of "
            "elements, or a larger tolerance",
            NotConvergedWarning,
        )
    return solution._replace(run=run, trajectory=trajectory), estimate


def space_error_of(runs: Callable[..., dict[str, CableRun]], solution: Solution) -> float:
    """Estimate the space error of a given number of elements by a companion run with fewer; nan if that stops.

    A single element, or one for each part between point loads, gets a companion of lower order.  Elements of an order above 1
    converge fast for smooth motion only, see :func:`refine_in_space`, so that the estimate assumes the first order, and is mostly
    too large.

    Parameters
    ----------
    runs
        Function of the number of elements and of their order that returns the run of each scheme.
    solution
        The run.
    """
    run, rate = solution.run, solution.steps_per_second
    mesh = run.chain
    elements, order = mesh.sizes.size, mesh.order
    is_given = solution.time_error is None
    part = 1.0 / (rate * run.step_limit) if run.scheme == SCHEMES[0] else None
    fewer = companion_cells(elements, part, is_given=is_given)
    lower = LOWER_ORDER + (is_given and (part is None or part > CLOSE_TO_LIMIT))
    coarser = (fewer, order) if fewer >= part_borders(mesh.p).size - 1 else (elements, order - lower)
    if min(coarser) < 1 or math.prod(coarser) < 2:  # no inner node
        return math.nan
    try:
        companion = runs(*coarser)[run.scheme].as_companion()
        limits = 1.0 if part is None else run.step_limit / companion.step_limit
        given = FEWER_IMPLICIT_STEPS if part is None else FEWER_STEPS
        state = companion(rate * companion_steps(given if is_given else limits, part, limits))
    except (RunStopped, SceneError):
        return math.nan
    compared = run.compared(solution.trajectory)
    gap = companion.compared(state) - compared
    distance = float(np.sqrt(np.mean(square(gap), axis=-1)).max()) / run.motion_of(compared)
    return extrapolated(distance, elements / fewer, 2 if order == 1 else 1) if coarser[0] < elements else distance
