"""Pseudo-arclength continuation of periodic solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import numpy as np

from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import (
    MIN_HARMONICS,
    MORE_HARMONICS,
    NO_MOTION,
    TAIL_RTOL,
    Solver,
    Stability,
    State,
    along_frequency,
)

#: Arc length of the first, the smallest and, at small motion, the largest step, without dimension.
FIRST_STEP, LEAST_STEP, LARGEST_STEP = 5e-3, 1e-7, 0.05
#: The largest step is at least the first number, and otherwise this multiple of the width of the narrowest resonance.
LEAST_LARGEST_STEP, STEPS_PER_WIDTH = 4e-3, 2.0
#: Largest step over the size of the motion.
STEP_OVER_MOTION = 0.1
#: Frequency over the highest one of the model above which nothing resonates, and largest step there over the frequency.
FAR, STEP_OVER_FREQUENCY = 4.0, 0.02
#: Least cosine between the directions of two successive points, and that above which the step may grow.
MIN_COSINE, GOOD_COSINE = 0.9, 0.98
#: Number of Newton iterations below which the step grows, and above which it shrinks.
FEW_ITERATIONS, MANY_ITERATIONS = 4, 6
#: Largest change of the motion in a step over its size, which draws a small resonance too, and that above which no step grows.
MAX_CHANGE, GOOD_CHANGE = 0.25, 0.18
#: Largest distance of the motion from its prediction over its size, which tells of a narrow resonance between two points, and
#: that above which no step grows: it is of second order in the step.
MAX_ERROR, GOOD_ERROR = 0.02, 0.01
#: Distance from the start of a branch, over the step, that counts as having come back.
LOOP_RTOL = 0.3
#: Size of a test function at its zero, over that at the ends, above which it jumps there; number of evaluations that tell it, as
#: a square root is that small within the square of the size, 2^-20.
MAX_JUMP, MANY_EVALUATIONS = 1e-3, 30
#: Number of points before which a branch cannot have come back.
LOOP_POINTS = 10
#: Reasons why branches end.
RANGE, LOOP, POINTS, SLACK, DIVERGED, AMPLITUDE = "range", "loop", "points", "slack", "diverged", "amplitude"

T = TypeVar("T")


@dataclass(eq=False)
class Point:
    """A solution on a branch."""

    state: State
    direction: np.ndarray  #: of the branch, of unit norm
    stability: Stability | None
    stride: int  #: number of steps of the scheme for multipliers for each sample

    @property
    def multipliers(self) -> np.ndarray:
        """Floquet multipliers (2 r,)."""
        assert self.stability is not None
        return self.stability.multipliers


@dataclass(eq=False)
class Branch:
    """A branch of solutions."""

    number: int
    points: list[Point] = field(default_factory=list)
    ended: str = ""
    #: Coefficients that vanish on the parent branch, as a function of a state; None for main branches
    asymmetric: Callable[[State], np.ndarray] | None = None


@dataclass(frozen=True)
class Limits:
    """Where a branch ends."""

    low: float  #: of the angular frequency, without dimension
    high: float
    points: int
    #: Any other reason to end, from the last point; empty to go on
    reason: Callable[[Point], str] = lambda point: ""


def adapted(
    solver: Solver,
    state: State,
    direction: np.ndarray,
    active: Callable[[State], np.ndarray] | None = None,
) -> tuple[State, np.ndarray, int]:
    """Correct a state, and again with more harmonics until the last two hold no more than `TAIL_RTOL`.

    `active` gives the numbers of the unknowns that change, see :meth:`Solver.correct`; None for all.
    """
    most = state.most_harmonics
    while True:
        numbers = () if active is None else (active(state),)
        found, tangent, iterations = solver.correct(state, direction, *numbers)
        if iterations < 0 or found.tail <= TAIL_RTOL or found.harmonics >= most:
            return found, tangent, iterations
        harmonics = min(found.harmonics + MORE_HARMONICS * found.periods, most)
        direction, state = resized_direction(direction, found, harmonics), found.resized(harmonics)


def adapted_at(solver: Solver, state: State) -> tuple[State, np.ndarray, int]:
    """Correct a state at its frequency, with as many harmonics as :func:`adapted` takes."""
    return adapted(solver, state, along_frequency(state))


def zero_between(
    ends: tuple[T, T], between: Callable[[T, T, float], T | None], test: Callable[[T], float], tolerance: float
) -> tuple[float, T] | None:
    """Find where a test function of the points of a segment changes its sign, by Brent's method.

    Parameters
    ----------
    ends
        First and last point.
    between
        Point at a share of the way from one known point to another; None for none.
    test
        The test function.
    tolerance
        Of the share of the whole way.

    Returns
    -------
    tuple or None
        Share of the whole way and point there; None without a change of sign, with one by a jump, or where the points that are
        there are not near the zero.
    """
    from scipy.optimize import brentq  # costly to import

    points = dict(zip((0.0, 1.0), ends, strict=True))
    values = {0.0: test(ends[0]), 1.0: test(ends[1])}
    if not values[0.0] * values[1.0] <= 0.0:
        return None
    small = MAX_JUMP * max(map(abs, values.values()))

    def value(share: float) -> float:
        if share not in values:
            low, high = max(s for s in points if s < share), min(s for s in points if s > share)
            point = between(points[low], points[high], (share - low) / (high - low))
            values[share] = np.nan if point is None else test(point)
            if point is not None and np.isfinite(values[share]):
                points[share] = point
        jumps = len(values) > MANY_EVALUATIONS and min(map(abs, values.values())) > small
        return 0.0 if share not in points or jumps else values[share]  # 0 ends the search

    brentq(value, 0.0, 1.0, xtol=tolerance, disp=False)
    share = min(points, key=lambda share: abs(values[share]))
    return (share, points[share]) if abs(values[share]) <= small else None


def resized_direction(direction: np.ndarray, state: State, harmonics: int) -> np.ndarray:
    """Return a direction for another number of harmonics than that of the state."""
    return replace(state, z=direction).resized(harmonics).z


def thinned(state: State, direction: np.ndarray) -> tuple[State, np.ndarray]:
    """Leave out harmonics that are far smaller than needed."""
    fewer = state.harmonics - MORE_HARMONICS * state.periods
    if fewer < MIN_HARMONICS * state.periods:
        return state, direction
    shorter = state.resized(fewer)
    if shorter.tail > 0.01 * TAIL_RTOL:
        return state, direction
    direction = resized_direction(direction, state, fewer)
    return shorter, direction / np.linalg.norm(direction)


def distance(first: State, second: State) -> np.ndarray:
    """Return the difference of two states, with the harmonics of the one that has more."""
    harmonics = max(first.harmonics, second.harmonics)
    return second.resized(harmonics).z - first.resized(harmonics).z


class Step(NamedTuple):
    """A step along a branch, between two solutions."""

    iterations: int  #: of Newton's method
    cosine: float  #: between the directions at its ends
    change: float  #: of the motion, over its size
    error: float  #: of the motion predicted, over its size
    leaves: bool  #: whether it ends at the end of the range

    def is_good(self, is_least: bool) -> bool:
        """Return whether it stays on its branch and, unless it is as small as it gets, draws it."""
        draws = self.change < MAX_CHANGE and self.error < MAX_ERROR
        return self.cosine > MIN_COSINE and (draws or is_least)

    def next_length(self, length: float, largest: float) -> float:
        """Return the arc length of the next step after this one of a length."""
        draws = self.change < GOOD_CHANGE and self.error < GOOD_ERROR
        if self.iterations <= FEW_ITERATIONS and self.cosine > GOOD_COSINE and draws:
            return min(1.4 * length, largest)
        return 0.7 * length if self.iterations > MANY_ITERATIONS or self.cosine < GOOD_COSINE else length


def _largest_step(model: PeriodicModel) -> float:
    """Return the largest arc length of a step at small motion."""
    if not (model.damping or model.is_damped_beside_mass):
        return LARGEST_STEP
    width = 2.0 * model.slowest_decays[0]  # of the narrowest resonance
    return min(max(STEPS_PER_WIDTH * width, LEAST_LARGEST_STEP), LARGEST_STEP)


def trace(
    solver: Solver,
    branch: Branch,
    start: State,
    direction: np.ndarray,
    limits: Limits,
    on_point: Callable[[Branch, bool], bool],
    *,
    stability: bool = True,
) -> None:
    """Append points to a new branch from a solution on, until it ends; `ended` tells why.

    A branch that leaves the range has its last point at the end of the range.

    Parameters
    ----------
    solver, branch
        Solver of the model, and the branch, changed.
    start, direction
        A solution, and the direction in which to leave it.
    limits
        Where the branch ends.
    on_point
        Called after each point; false where the last one is to be taken back and the step halved, because events between the
        last two cannot be told apart or located.  Its second argument tells whether the step is as small as it gets.
    stability
        Whether multipliers are computed.
    """
    largest = _largest_step(solver.model)
    step = min(FIRST_STEP, largest)

    def point_of(state: State, direction: np.ndarray) -> Point:
        if not stability:
            return Point(state, direction, None, 0)
        stride = solver.stride(state)
        return Point(state, direction, solver.stability(state, stride), stride)

    if not _append(branch, point_of(start, direction)):
        return
    on_point(branch, True)
    if not limits.low <= start.omega <= limits.high:
        branch.ended = RANGE
    state, direction = start, direction / np.linalg.norm(direction)
    while not branch.ended:
        found, tangent, taken = _step(solver, state, direction, step, limits)
        is_least = step <= 100.0 * LEAST_STEP
        good = taken is not None and taken.is_good(is_least)
        if good:
            if not _append(branch, point_of(found, tangent)):
                return
            if not on_point(branch, is_least) and not is_least:
                branch.points.pop()
                good = False
        if taken is None or not good:
            step *= 0.5
            if step < LEAST_STEP:
                branch.ended = DIVERGED
            continue
        branch.ended = RANGE if taken.leaves else _end(branch, limits, step)
        motion = float(np.linalg.norm(found.coefficients[1:]))
        far = found.omega > FAR * solver.model.highest_frequency
        along = STEP_OVER_FREQUENCY * found.omega if far else 0.0
        step = taken.next_length(step, max(largest, STEP_OVER_MOTION * motion, along))
        state, direction = thinned(found, tangent)


def _step(
    solver: Solver, state: State, direction: np.ndarray, length: float, limits: Limits
) -> tuple[State, np.ndarray, Step | None]:
    """Return the solution a step further, or at the end of the range on the way, the direction there and the step; None: none."""
    predicted = replace(state, z=state.z + length * direction)
    found, tangent, iterations = adapted(solver, predicted, direction)
    if iterations < 0:
        return found, tangent, None
    error, end = _change_of_motion(predicted, found), min(max(found.omega, limits.low), limits.high)
    leaves = found.omega != end
    if leaves:
        found, tangent, iterations = _at_end(solver, state, direction, found, end)
        if iterations < 0:
            return found, tangent, None
    before = resized_direction(direction, state, found.harmonics)
    cosine = float(before @ tangent) / float(np.linalg.norm(before))
    return found, tangent, Step(iterations, cosine, _change_of_motion(state, found), error, leaves)


def _at_end(
    solver: Solver, state: State, direction: np.ndarray, beyond: State, omega: float
) -> tuple[State, np.ndarray, int]:
    """Return the solution at the end of the range between a state and one beyond it, as :meth:`Solver.correct` does."""
    before = state.resized(beyond.harmonics)
    guess = before.towards(beyond, (omega - before.omega) / (beyond.omega - before.omega))
    found, tangent, iterations = adapted_at(solver, guess)
    if resized_direction(direction, state, found.harmonics) @ tangent < 0.0:
        tangent = -tangent
    near = np.abs(distance(guess, found)).max() <= np.abs(beyond.z - before.z).max()
    return found, tangent, iterations if near and state.omega != omega else -1


def _change_of_motion(first: State, second: State) -> float:
    """Return the difference of two motions, without their means, over the size of the larger one; 0 for none but rounding."""
    change = distance(first, second)[:-1].reshape(-1, second.size)[1:]
    sizes = [float(np.linalg.norm(state.coefficients[1:])) for state in (first, second)]
    least = NO_MOTION * float(np.linalg.norm(second.coefficients))
    return float(np.linalg.norm(change)) / max(*sizes, least, 1e-300)


def _append(branch: Branch, point: Point) -> bool:
    """Append a point; where its multipliers are not finite, end the branch before it and return False."""
    if point.stability is None or np.isfinite(point.multipliers).all():
        branch.points.append(point)
        return True
    branch.ended = SLACK if point.stability.smallest_force < 0.0 else DIVERGED
    return False


def _end(branch: Branch, limits: Limits, step: float) -> str:
    """Return why a branch ends at its last point; empty where it goes on."""
    last, before = branch.points[-1], branch.points[-2].state
    state = last.state
    reason = limits.reason(last)
    if reason:
        return reason
    if last.stability is not None and last.stability.smallest_force < 0.0:
        return SLACK
    if meets_parent(branch):
        return LOOP
    if len(branch.points) > LOOP_POINTS and _passes(branch.points[0].state, before, state, step):
        return LOOP
    if limits.points <= len(branch.points):
        return POINTS
    return ""


def meets_parent(branch: Branch) -> bool:
    """Return whether the last two points are on either side of the branch that this one left: mirror images from there on."""
    if branch.asymmetric is None or len(branch.points) <= LOOP_POINTS:
        return False
    first, second = (branch.asymmetric(point.state) for point in branch.points[-2:])
    count = min(first.size, second.size)  # zeros beyond
    return bool(first[:count] @ second[:count] < 0.0)


def _passes(point: State, before: State, after: State, step: float) -> bool:
    """Return whether the segment between two states passes near a point."""
    harmonics = max(point.harmonics, before.harmonics, after.harmonics)
    a, b, c = (state.resized(harmonics).z for state in (before, after, point))
    segment = b - a
    share = float((c - a) @ segment) / float(segment @ segment)
    return -0.01 <= share <= 1.01 and float(np.linalg.norm(c - a - share * segment)) < LOOP_RTOL * step
