"""Bifurcations between two points of a branch, located by their test functions, and the branches that leave there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cablepod.periodic._continuation import Branch, Point, distance, meets_parent, resized_direction, zero_between
from cablepod.periodic._multipliers import product
from cablepod.periodic._solve import IN_PLANE, NEUTRAL, OUT_OF_PLANE, Solver, State, sets_of

FOLD, PITCHFORK, DOUBLING, TORUS = "fold", "pitchfork", "period_doubling", "torus"
#: Relative tolerance that locates a bifurcation.
LOCATE_RTOL = 1e-11
#: Largest distance of a multiplier from its value at the bifurcation, above which a change of sign is none.
MAX_DISTANCE = 1e-3
#: Step onto a branch that leaves, over that of the smallest, without dimension.
SWITCH_STEPS = (1e-2, 3e-2, 3e-3, 0.1)


@dataclass(eq=False)
class Event:
    """A bifurcation."""

    kind: str
    which: str  #: set of coordinates whose multiplier crosses the unit circle
    state: State
    branch: int
    leads_to: int = 0  #: number of the branch that leaves; 0 for none
    direction: np.ndarray | None = None  #: of the branch there


class Signs(NamedTuple):
    """Test functions at a point, set by set: each changes sign where multipliers cross the unit circle."""

    at_one: np.ndarray  #: product of 1 - multiplier, see :func:`cablepod.periodic._multipliers.product`
    at_minus_one: np.ndarray  #: product of 1 + multiplier
    complex_outside: np.ndarray  #: number of complex pairs outside of the circle
    real_outside: np.ndarray  #: numbers of real multipliers above 1 and below -1 (sets, 2)


def signs(solver: Solver, point: Point) -> Signs:
    """Return the test functions at a point."""
    rows = []
    for _, which in sets_of(solver.model, point.state):
        mu = point.multipliers[which]
        real = np.abs(mu.imag) < NEUTRAL
        outside = (np.abs(mu) > 1.0 + NEUTRAL) & (mu.imag > NEUTRAL)
        rows.append(
            (
                product(1.0 - mu),
                product(1.0 + mu),
                int(outside.sum()),
                [int((real & (mu.real > 1.0)).sum()), int((real & (mu.real < -1.0)).sum())],
            )
        )
    return Signs(*(np.array(column) for column in zip(*rows, strict=True)))


def can_be_told_apart(before: Signs, after: Signs) -> bool:
    """Return whether no two multipliers of one set can have crossed the circle at the same place.

    A complex pair outside of the circle may become two real multipliers there, and the other way round, without crossing it.
    """
    real = after.real_outside - before.real_outside
    pairs = 2 * (after.complex_outside - before.complex_outside)[:, None]
    return bool(((np.abs(real) <= 1) | (real == -pairs)).all())


def events_between(solver: Solver, branch: Branch, before: Signs, after: Signs) -> tuple[list[Event], bool]:
    """Locate the bifurcations between the last two points of a branch, in their order; tell whether all are found.

    Where a test function that is continuous has no zero, the last point lies on another branch.
    """
    first, second = branch.points[-2], branch.points[-1]
    names = sets_of(solver.model, second.state)
    found: list[tuple[float, Event]] = []
    missed = set()

    def locate(kind: str, name: str, test: Callable[[Point], float], check: Callable[[Point], bool]) -> None:
        place = _locate(solver, first, second, test)
        if place is not None and check(place[1]):
            found.append((place[0], Event(kind, name, place[1].state, branch.number, direction=place[1].direction)))
        else:
            missed.add(kind)

    folds = first.direction[-1] * second.direction[-1] < 0.0
    if folds:
        name = names[0][0]
        locate(FOLD, name, lambda point: point.direction[-1], lambda point: True)
        if before.at_one[0] * after.at_one[0] > 0.0:  # with another multiplier beside that of the fold
            missed.add(PITCHFORK)
    for k, (name, which) in enumerate(names):

        def real(kind: str, value: float, name: str = name, which: slice = which) -> None:
            """Locate where a real multiplier has a value, 1 or -1."""
            locate(
                kind,
                name,
                lambda point: product(1.0 - value * point.multipliers[which]),
                lambda point: np.abs(point.multipliers[which] - value).min() < MAX_DISTANCE,
            )

        def radius(point: Point, which: slice = which) -> float:
            mu = point.multipliers[which]
            return float(np.abs(mu[np.abs(mu.imag) > NEUTRAL]).max(initial=0.0)) - 1.0

        def is_on_circle(point: Point, radius: Callable[[Point], float] = radius) -> bool:
            return abs(radius(point)) < MAX_DISTANCE

        if before.at_one[k] * after.at_one[k] < 0.0 and not (folds and k == 0):
            real(PITCHFORK, 1.0)
        if before.at_minus_one[k] * after.at_minus_one[k] < 0.0:
            real(DOUBLING, -1.0)
        if before.complex_outside[k] != after.complex_outside[k] and radius(first) * radius(second) < 0.0:
            locate(TORUS, name, radius, is_on_circle)
    # a complex pair may become real multipliers within a step
    return [event for _, event in sorted(found, key=lambda pair: pair[0])], missed <= {TORUS}


def entering(solver: Solver, events: list[Event]) -> Callable[[Branch, bool], bool]:
    """Return what :func:`cablepod.periodic._continuation.trace` calls after each point; it adds bifurcations to `events`."""
    tests: list[Signs] = []

    def on_point(branch: Branch, is_least: bool) -> bool:
        del tests[len(branch.points) - 1 :]  # of a point that was taken back
        tests.append(signs(solver, branch.points[-1]))
        if len(tests) == 1 or meets_parent(branch):
            return True
        apart = can_be_told_apart(tests[-2], tests[-1])
        if not (apart or is_least):
            return False
        found, complete = events_between(solver, branch, tests[-2], tests[-1])
        if complete or is_least:
            events.extend(found)
        return apart and complete

    return on_point


def _locate(solver: Solver, first: Point, second: Point, test: Callable[[Point], float]) -> tuple[float, Point] | None:
    """Find the zero of a test function between two points, see :func:`cablepod.periodic._continuation.zero_between`."""
    harmonics, stride = max(first.state.harmonics, second.state.harmonics), max(first.stride, second.stride)
    way = distance(first.state, second.state)
    length = float(np.linalg.norm(way))
    direction = way / length
    if resized_direction(first.direction, first.state, harmonics) @ direction < 0.0:
        return None

    def corrected(guess: State) -> Point | None:
        state, tangent, iterations = solver.correct(guess, direction)
        return None if iterations < 0 else Point(state, tangent, solver.stability(state, stride), stride)

    def between(low: Point, high: Point, share: float) -> Point | None:
        return corrected(low.state.towards(high.state, share))

    start, end = (corrected(point.state.resized(harmonics)) for point in (first, second))
    if start is None or end is None:
        return None
    return zero_between((start, end), between, test, LOCATE_RTOL / length)


# --- branches that leave ------------------------------------------------------------------------------------------------


def leaving(solver: Solver, event: Event) -> tuple[State, np.ndarray, Callable[[State], np.ndarray]] | None:
    """Return the state at a pitchfork out of the plane or a period doubling as the branch that leaves sees it.

    Returns
    -------
    tuple or None
        The state with the periods and coordinates of that branch, the direction of the branch, and a function that gives the
        coefficients that vanish at the bifurcation; None where no such branch is known.
    """
    state, n = event.state, solver.model.n_in_plane
    doubles = event.kind == DOUBLING
    if not doubles and not (event.kind == PITCHFORK and event.which == OUT_OF_PLANE):
        return None
    if doubles:
        state = state.doubled()
    spatial = not state.planar or event.which == OUT_OF_PLANE
    if spatial:
        state = state.full(solver.model)
    if state.harmonics > state.most_harmonics:
        state = state.resized(state.most_harmonics)
    mask = np.ones((1 + 2 * state.harmonics, state.size), dtype=bool)
    if doubles:
        mask[:] = False
        mask[1::4], mask[2::4] = True, True  # odd harmonics
    if event.which == OUT_OF_PLANE:
        mask[:, :n] = False
    elif event.which == IN_PLANE:
        mask[:, n:] = False
    rows = np.flatnonzero(mask.ravel())
    jacobian = solver.jacobian(state)[np.ix_(rows, rows)]
    null = np.linalg.svd(jacobian)[2][-1]
    direction = np.zeros(state.z.size)
    direction[rows] = null

    def asymmetric(state: State) -> np.ndarray:
        return _asymmetric_part(state, doubles, event.which == OUT_OF_PLANE, n)

    return state, direction, asymmetric


def _asymmetric_part(state: State, odd: bool, outside: bool, n: int) -> np.ndarray:
    """Return the odd harmonics or all, of the coordinates out of the plane or all, low harmonics first."""
    c = state.coefficients
    if outside:
        c = c[:, n:]
    if odd:
        harmonics = np.arange(1, state.harmonics + 1, 2)
        c = c[np.ravel(np.stack([2 * harmonics - 1, 2 * harmonics], axis=1))]
    return c.ravel()


def first_point(solver: Solver, state: State, direction: np.ndarray) -> tuple[State, np.ndarray] | None:
    """Step from a bifurcation onto the branch that leaves; None where no step succeeds."""
    for step in SWITCH_STEPS:
        found, tangent, iterations = solver.correct(replace(state, z=state.z + step * direction), direction)
        if iterations > 0 and abs(found.omega - state.omega) < 10.0 * step:
            return found, tangent
    return None
