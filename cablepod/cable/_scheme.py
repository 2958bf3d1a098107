"""How a run of the cable chooses its scheme, its step and its elements."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from cablepod.cable._runs import SCHEMES, CableRun, ImplicitCableRun
from cablepod.discretisation._chain import square
from cablepod.errors import NotConvergedWarning
from cablepod.integrate._run import Trajectory
from cablepod.integrate._step_control import (
    STEPS_PER_CHANGE,
    halve_step_while_cheaper,
    motion_scale,
    observed_order,
    preferred_steps_per_second,
    refine_step,
)

#: Numbers of elements that are tried in turn.  The loops over elements of a run vectorise best where they are multiples of four.
ELEMENT_COUNTS = (4, 8, 12, 16, 24, 32, 48, 64, 96, 128)
#: Places at which two runs with different elements are compared.
COMPARED_POINTS = 65
#: An implicit step costs about as much as so many explicit ones, with the iterations of Newton's method.
IMPLICIT_COST = 30.0
#: Below so many seconds of explicit run time, at so many seconds per node and step, no other scheme is tried.
CHOICE_MIN_SECONDS, NODE_STEP = 0.3, 1.5e-8
#: Steps of the first implicit run in the period of the first transverse vibration.
STEPS_PER_PERIOD = 8.0


def step_limit_of(run: CableRun) -> float:
    """Stability limit of explicit steps at the start [s]."""
    return run.chain.step_limit(run.chain.tangent_stiffness_ratio(run.initial))


def work_size(run: CableRun) -> tuple[float, int]:
    """Until when a run lasts [s], and its number of nodes but one."""
    return float(run.times[-1]), run.chain.links


def choose_scheme(runs: dict[str, CableRun], goal: float) -> tuple[CableRun, tuple[Trajectory, float, float], str]:
    """Pick scheme and step for a tolerance: implicit as long as its steps are so long that it is the faster one."""
    explicit, implicit = (runs[name] for name in SCHEMES)
    rate = 1.0 / _first_step(explicit)
    cost = 3.0 * float(explicit.times[-1]) * rate * explicit.chain.links * NODE_STEP
    if cost < CHOICE_MIN_SECONDS:
        return explicit, refine_in_time(explicit, goal), f"explicit: all its runs take about {cost:.1g} s"
    most = rate / IMPLICIT_COST  # the explicit runs have this rate and twice as much, the implicit ones all up to it
    found = halve_step_while_cheaper(*comparison(implicit), goal, most, work_size(implicit))
    if found is not None:
        times = 1.0 / (found[1] * step_limit_of(explicit))
        return implicit, found, f"implicit: its steps may be {times:.3g} times the explicit limit"
    why = f"explicit: implicit steps would have to be shorter than {1 / most:.3g} s"
    return explicit, refine_in_time(explicit, goal), why


def refine_in_time(run: CableRun, goal: float) -> tuple[Trajectory, float, float]:
    """Shorten the step until two runs agree."""

    def slackened(state: Trajectory) -> bool:
        # law (21) pulls and pushes without a kink
        return not run.chain.green and bool((run.chain.stretch(state.position) < 1.0).any())

    return refine_step(*comparison(run), goal, slackened, work_size(run))


def comparison(
    run: CableRun,
) -> tuple[CableRun, Callable[[Trajectory], np.ndarray], Callable[[Trajectory], float], float]:
    """Return a run, how two of them are compared, and the number of steps per second to begin with."""

    def position(state: Trajectory) -> np.ndarray:
        return _at_places(run, state.position)

    def scale(state: Trajectory) -> float:
        return _scale(run, state)

    return run, position, scale, preferred_steps_per_second(1.0 / _first_step(run))


def _at_places(run: CableRun, position: np.ndarray) -> np.ndarray:
    """Positions at equal distances: nodes are not, and the error is an average over the cable."""
    return run.chain.interpolate(position, run.chain.total_length * np.linspace(0.0, 1.0, COMPARED_POINTS))


def _scale(run: CableRun, state: Trajectory) -> float:
    chord = float(np.linalg.norm(run.chain.p.upper - run.chain.p.lower))
    return motion_scale(_at_places(run, state.position), _at_places(run, run.initial), chord)


def _first_step(run: CableRun) -> float:
    """Choose the step to begin with [s]."""
    return min(unforced_step(run), run.chain.p.shortest_time_scale / STEPS_PER_CHANGE)


def unforced_step(run: CableRun) -> float:
    """Choose the step to begin with, but for what motions and loads ask for [s]."""
    mesh, until = run.chain, float(run.times[-1])
    if isinstance(run, ImplicitCableRun):
        tension = max(float(mesh.tensions_and_forces(run.initial)[0].mean()), 1e-300)
        period = 2.0 * mesh.total_length / np.sqrt(tension / mesh.p.mass)
        return float(max(min(until / 20.0, period / STEPS_PER_PERIOD), step_limit_of(run)))
    if not mesh.green:
        return 0.9 * step_limit_of(run)
    # for the stretch to come, as far as the ends enforce it, and waves on top
    return 0.8 * mesh.step_limit(
        np.maximum(mesh.tangent_stiffness_ratio(run.initial), mesh.largest_enforced_ratio(until))
    )


def refine_in_space(
    runs: Callable[[int], dict[str, CableRun]], run: CableRun, state: Trajectory, rate: float, goal: float
) -> tuple[CableRun, Trajectory, float]:
    """Raise the number of elements until two runs agree; steps are never longer than those found for the first.

    The distance of the first two runs counts as it is; from the third on the order that the distances show, but no more than 2:
    an end whose acceleration begins with a jump sends out waves with corners, for which no elements have a higher one.
    """
    last, factor = np.inf, np.inf
    counts = [n for n in ELEMENT_COUNTS if n > run.chain.sizes.size]
    for count in counts:
        finer = runs(count)[run.scheme]
        needed = 0.0 if isinstance(finer, ImplicitCableRun) else 1.0 / unforced_step(finer)
        new = finer(rate if rate >= needed else preferred_steps_per_second(needed))
        gap = _at_places(finer, new.position) - _at_places(run, state.position)
        distance = float(np.sqrt(np.mean(square(gap), axis=-1)).max()) / _scale(finer, new)
        growth = count / run.chain.sizes.size
        estimate = distance
        if last < np.inf:
            order = observed_order(distance / max(last, 1e-300), factor, growth)
            estimate = distance / (growth**order - 1.0)
        run, state, last, factor = finer, new, distance, growth
        if estimate <= (0.5 if count < counts[-1] else 1.0) * goal:  # with a margin while there is a choice
            return run, state, estimate
    warnings.warn(
        f"two numbers of elements disagree: an error of {estimate:.2g} of the motion is left with {run.chain.sizes.size} "
        f"elements, more than the tolerance {goal:.2g}; the motion is chaotic, or the cable goes slack and has corners; give a "
        "number of elements, or a larger tolerance",
        NotConvergedWarning,
        stacklevel=4,
    )
    return run, state, estimate
