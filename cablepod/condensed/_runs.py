"""Runs of the condensed model: choice of scheme and step, one scene on one set of modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, NoReturn

import numpy as np

from cablepod._resources import check_memory
from cablepod.condensed._fields import CondensedTrajectory, positions
from cablepod.condensed._kernels_layout import MAX_OMEGA_SQUARED, MIN_FORCE, UNSTABLE_STEP
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import attributes, dataset
from cablepod.condensed._stepper import CondensedStepper
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output import stop
from cablepod.integrate._request import Request, check_resolved, check_step
from cablepod.integrate._step_control import (
    STEPS_PER_CHANGE,
    ComparableRuns,
    motion_scale,
    preferred_steps_per_second,
    refine_step,
)

SCHEMES = ("velocity_verlet", "trapezoidal")
#: Minimum ratio of the explicit step limit to that of the tension alone; below, where the stretching of the sag governs, the
#: default scheme is implicit.
IMPLICIT_THRESHOLD = 0.3
#: First step of a refinement times the highest angular frequency (implicit: the lowest).  Free vibrations are undamped: with
#: longer steps their phase errors exceed a period, and the distance of two runs shows no convergence.
PHASE_PER_STEP = 0.4
#: Minimum number of implicit steps of the first run.
MIN_STEPS = 20.0


@dataclass(frozen=True, kw_only=True)
class CondensedRequest(Request):
    """Checked options of a run of the condensed model."""

    links: np.ndarray | None = None  #: indices, from 0, of the links whose tensions are computed; None for all


class CondensedResult(NamedTuple):
    """A run with the scheme and step that were chosen."""

    run: CondensedRun
    state: CondensedTrajectory
    steps_per_second: float
    limit: float  #: stability limit of explicit steps at the start [s]
    time_error: float | None  #: estimated time error as a fraction of the motion; None for a given step


def solve(
    model: CondensedModel, request: CondensedRequest, progress: Callable[[float], None] | None = None
) -> CondensedResult:
    """Run a model with a given scheme and step, or with those that meet the tolerance.

    Raises
    ------
    SceneError
        For instants that a record does not cover, and a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers, its frequencies outgrow a given step, or Newton's method fails.
    """
    p = model.chain.p
    times = request.instants(p)
    check_memory(times.size, model.chain.links, p.dims, key="times", variables=3)
    q0, v0 = model.initial()
    acceleration, _, chord_tension = model.force(q0, v0, model.initial_boundary_data)
    omega_squared = model.omega_max_squared(q0, model.initial_boundary_data, chord_tension)
    limit = 2.0 / math.sqrt(omega_squared)
    scheme, step = request.scheme, request.step
    if scheme is None:
        taut = max(abs(chord_tension) * model.slope_norms_squared.max(), 1e-300)
        explicit = limit >= IMPLICIT_THRESHOLD * 2.0 / math.sqrt(taut)
        scheme = SCHEMES[0] if explicit or (step is not None and step < limit) else SCHEMES[1]
    start = InitialState(q0, v0, acceleration, chord_tension)
    run = CondensedRun(model, times, start, request.outputs, request.links, progress, scheme)
    if step is not None:
        if run.explicit:
            check_step(step, limit, f"2 over the highest angular frequency, {2 / limit:.6g} rad/s")
        check_resolved(step, p.shortest_time_scale)
        return CondensedResult(run, run(1.0 / step), 1.0 / step, limit, None)
    first_step = min(_unforced_step(run, omega_squared), p.shortest_time_scale / STEPS_PER_CHANGE)
    chord = float(np.linalg.norm(p.upper - p.lower))
    initial = positions(model, q0[None], np.zeros(1))[0]

    def position(state: CondensedTrajectory) -> np.ndarray:
        return positions(model, state.q, state.instants.times)

    def motion(state: CondensedTrajectory) -> float:
        return motion_scale(position(state), initial, chord)

    steps_per_second = preferred_steps_per_second(1.0 / first_step)
    runs = ComparableRuns(run, position, motion, steps_per_second, float(times[-1]), model.chain.links)
    state, steps_per_second, estimate = refine_step(runs, request.tolerance)
    return CondensedResult(run, state, steps_per_second, limit, estimate)


def _unforced_step(run: CondensedRun, omega_squared: float) -> float:
    """Return the first step of a refinement [s] by free vibrations, for a bound of their squared frequency [1/s^2]."""
    end_time, kappa = float(run.times[-1]), run.model.slope_norms_squared
    if run.explicit:
        return PHASE_PER_STEP / math.sqrt(max(omega_squared, run.model.omega_taut_squared(end_time)))
    chord_tension = max(run.model.omega_taut_squared(end_time), 1e-300) / kappa.max()
    omega_min = math.sqrt(max(chord_tension, 1e-9 * run.model.chain.p.stiffness) * kappa.min())
    return min(max(end_time, 1e-300) / MIN_STEPS, PHASE_PER_STEP / omega_min)


class InitialState(NamedTuple):
    """Initial state of a run."""

    q: np.ndarray  #: coordinates (r,)
    rates: np.ndarray  #: their rates (r,)
    acceleration: np.ndarray  #: their undamped accelerations (r,)
    chord_tension: float  #: H [N]


@dataclass(frozen=True)
class CondensedRun:
    """One scene on one set of modes; a call with steps per second integrates it."""

    model: CondensedModel
    times: np.ndarray  #: instants of the output [s]
    start: InitialState
    outputs: tuple[str, ...]
    links: np.ndarray | None  #: indices, from 0, of the links whose tensions are computed; None for all
    progress: Callable[[float], None] | None
    scheme: str

    @property
    def explicit(self) -> bool:
        """Whether the scheme is velocity Verlet."""
        return self.scheme == SCHEMES[0]

    @property
    def leading(self) -> bool:
        """Whether the model is of order "leading"."""
        return self.model.order == "leading"

    def __call__(self, steps_per_second: float) -> CondensedTrajectory:
        """Integrate with a fixed number of steps per second.

        Raises
        ------
        RunStopped
            Where the frequencies outgrow the step, the coordinates diverge, or Newton's method fails.
        """
        stepper = CondensedStepper(self, steps_per_second)
        total = max(stepper.total, 1) if self.explicit else stepper.total
        failed_step = advance_in_blocks(stepper.advance, stepper.changed, total, self.progress)
        if stepper.total == 0:  # an implicit run of no length has only its start
            stepper.advance(0, 0)
        state = stepper.trajectory()
        if state.monitor[UNSTABLE_STEP] < np.inf:  # tested first, because it is the cause of a divergence
            self._stop_unstable(state, int(state.monitor[UNSTABLE_STEP]), steps_per_second)
        if failed_step is not None:
            self._stop_diverged(state, failed_step, steps_per_second)
        return state

    def sample(self, times: np.ndarray, steps_per_second: float) -> CondensedTrajectory:
        """Integrate with the same step, saved at other instants [s]."""
        return replace(self, times=times, outputs=(), progress=None)(steps_per_second)

    def _stop_unstable(self, state: CondensedTrajectory, step_number: int, steps_per_second: float) -> NoReturn:
        limit = 2 / math.sqrt(self.model.frequency_amplification * state.monitor[MAX_OMEGA_SQUARED])
        time = step_number / steps_per_second
        self._stop(
            state,
            time,
            f"the condensed model stiffened: from {time:.6g} s on its stability limit is below the step "
            f"{1.0 / steps_per_second:.6g} s ({self.scheme}), at least {limit:.6g} s; try a shorter step, or scheme "
            f"trapezoidal{self._growth()}",
        )

    def _stop_diverged(self, state: CondensedTrajectory, step_number: int, steps_per_second: float) -> NoReturn:
        time = step_number / steps_per_second
        self._stop(
            state,
            time,
            f"the condensed model left the finite numbers or found no equilibrium along the chord at {time:.6g} s "
            f"({self.scheme}, step {1 / steps_per_second:.4g} s, step number {step_number}, least chordwise force "
            f"{state.monitor[MIN_FORCE]:.3g} N); try a shorter step or, where the cable goes slack, "
            f"chain.simulate{self._growth()}",
        )

    def _growth(self) -> str:
        """Return the remedy of a run that trained test functions make unstable."""
        log_growth = self.model.unstable_growth_rate * float(self.times[-1])
        if log_growth < 1.0:
            return ""
        return (
            f"; with these test functions vibrations about rest grow by exp({log_growth:.3g}) over the run: "
            "train them nearer to this scene, or take the modes without them"
        )

    def _stop(self, state: CondensedTrajectory, time: float, why: str) -> NoReturn:
        """Raise :class:`cablepod.errors.RunStopped` with the result at the instants before `time` [s]."""
        instants, partial = state.instants.before_time(time), None
        if instants is not None:
            saved, half_step_rates = state.saved[: instants.steps.size], state.half_step_rates[: instants.steps.size]
            part = CondensedTrajectory(instants, saved, half_step_rates, None, state.monitor, self.scheme)
            partial = dataset(self.model, part, attributes(self.model, part, None), ("position",), "stopped")
        stop(partial, time, float(state.instants.times[-1]), why)
