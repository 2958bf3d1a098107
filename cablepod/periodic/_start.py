"""First periodic responses: grown from rest, or followed from another frequency."""

from __future__ import annotations

from dataclasses import replace

from cablepod.periodic._continuation import Branch, Limits, trace
from cablepod.periodic._solve import Solver, State

#: Share of the amplitude of the forcing by which it grows at first and at least.
FIRST_SHARE, LEAST_SHARE = 1.0, 0.02
#: Frequencies over the wanted one from which a response is followed where it does not grow from rest there.
SIDES = (0.93, 0.8, 1.07, 1.25)
#: Largest number of points on the way.
MAX_POINTS = 300


def grown_from_rest(solver: Solver, omega: float, harmonics: int, periods: int = 1) -> State:
    """Return a first guess of the response at a frequency without dimension, a solution if one is found."""
    first, solved = grown(solver, omega, harmonics, periods)
    if solved:
        return first
    for side in SIDES:
        start, solved = grown(solver, side * omega, harmonics, periods)
        found = _followed(solver, start, omega) if solved else None
        if found is not None:
            return found
    return first


def grown(solver: Solver, omega: float, harmonics: int, periods: int = 1) -> tuple[State, bool]:
    """Grow a response from rest with the amplitude of the forcing alone; tell whether all of it is reached."""
    state = replace(solver.rest(omega, harmonics), periods=periods)
    share, step = 0.0, FIRST_SHARE
    while share < 1.0 and step >= LEAST_SHARE:
        reached = min(share + step, 1.0)
        other = solver if reached == 1.0 else type(solver)(solver.model.with_amplitude(reached))
        found, _, iterations = other.at_frequency(state)
        if iterations > 0:
            state, share = found, reached
        else:
            step *= 0.5
    return state, share == 1.0


def _followed(solver: Solver, start: State, omega: float) -> State | None:
    """Follow a response to another frequency; None where the branch does not get there."""
    state, direction, iterations = solver.at_frequency(start)
    if iterations < 0:
        return None
    if (omega - state.omega) * direction[-1] < 0.0:
        direction = -direction
    branch, limits = Branch(0), Limits(min(state.omega, omega), max(state.omega, omega), MAX_POINTS)
    trace(solver, branch, state, direction, limits, lambda branch, is_least: True, stability=False)
    found = branch.points[-1].state
    return found if abs(found.omega / omega - 1.0) < 1e-12 else None  # rounding of the last correction
