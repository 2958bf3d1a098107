"""Runs of the condensed model: one scene on one set of modes, with any step, and the choice of scheme and step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.condensed._fields import CondensedTrajectory, positions
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import attributes, dataset
from cablepod.errors import RunStopped
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._request import Request, check_resolved, check_step
from cablepod.integrate._step_control import (
    STEPS_PER_CHANGE,
    damped_growth,
    motion_scale,
    preferred_steps_per_second,
    refine_step,
)

SCHEMES = ("velocity_verlet", "trapezoidal")
#: Where the stretching of the sag takes the explicit limit below this share of what the tension alone would allow, steps are
#: implicit by default.
IMPLICIT_THRESHOLD = 0.3
#: First step of a search times the highest frequency (implicit: the lowest).  Nothing damps free vibrations, so that with longer
#: steps their phases are off by turns at the end of a run, and two runs tell nothing of each other.
PHASE_PER_STEP = 0.4


@dataclass(frozen=True, kw_only=True)
class CondensedRequest(Request):
    """What is asked of a run of the condensed model, checked."""

    links: np.ndarray | None = None  #: links whose tensions count, from 0; all by default


class CondensedResult(NamedTuple):
    """A run and how it was chosen."""

    run: CondensedRun
    state: CondensedTrajectory
    steps_per_second: float  #: steps per second
    limit: float  #: largest stable explicit step at the start [s]
    time_error: float | None  #: estimate of the error of the step, where a tolerance chose it


def solve(
    model: CondensedModel, request: CondensedRequest, progress: Callable[[float], None] | None = None
) -> CondensedResult:
    """Run a model with the scheme and step given, or chosen by tolerance.

    Raises
    ------
    SceneError
        For instants that a record does not cover, and a step above the stability limit.
    RunStopped
        Where the motion leaves the finite numbers, its frequencies outgrow a given step, or Newton's method fails.
    """
    p = model.chain.p
    instants = request.instants(p)
    check_memory(instants.size, model.chain.links, p.dims, key="times", variables=3)
    q0, v0 = model.initial()
    push, _, h = model.force(q0, v0, model.initial_boundary_data)
    fastest = model.omega_max_squared(q0, model.initial_boundary_data, h)
    limit = 2.0 / math.sqrt(fastest)
    scheme, step = request.scheme, request.step
    if scheme is None:
        explicit = limit >= IMPLICIT_THRESHOLD * 2.0 / math.sqrt(max(abs(h) * model.spectral_basis[1].max(), 1e-300))
        scheme = SCHEMES[0] if explicit or (step is not None and step < limit) else SCHEMES[1]
    run = CondensedRun(model, instants, InitialState(q0, v0, push, h), request.outputs, request.links, progress, scheme)
    if step is not None:
        if scheme == SCHEMES[0]:
            check_step(step, limit, f"2 over the highest angular frequency, {2 / limit:.6g} rad/s")
        check_resolved(step, p.shortest_time_scale)
        return CondensedResult(run, run(1.0 / step), 1.0 / step, limit, None)
    first = min(_unforced_step(run, fastest), p.shortest_time_scale / STEPS_PER_CHANGE)
    chord = float(np.linalg.norm(p.upper - p.lower))
    initial = positions(model, q0[None], np.zeros(1))[0]

    def position(state: CondensedTrajectory) -> np.ndarray:
        return positions(model, state.q, state.instants.times)

    state, rate, estimate = refine_step(
        run,
        position,
        lambda s: motion_scale(position(s), initial, chord),
        preferred_steps_per_second(1.0 / first),
        request.tolerance,
        size=(float(instants[-1]), model.chain.links),
    )
    return CondensedResult(run, state, rate, limit, estimate)


def _unforced_step(run: CondensedRun, fastest: float) -> float:
    until = float(run.times[-1])
    if run.scheme == SCHEMES[0]:
        return PHASE_PER_STEP / math.sqrt(max(fastest, run.model.omega_taut_squared(until)))
    h = max(run.model.omega_taut_squared(until), 1e-300) / run.model.spectral_basis[1].max()
    slowest = math.sqrt(max(h, 1e-9 * run.model.chain.p.stiffness) * run.model.spectral_basis[1].min())
    return min(max(until, 1e-300) / 20.0, PHASE_PER_STEP / slowest)


class InitialState(NamedTuple):
    """What a run starts from."""

    q: np.ndarray  #: coordinates (r,)
    rates: np.ndarray  #: their rates
    push: np.ndarray  #: their accelerations but for damping
    h: float  #: H [N]


@dataclass(frozen=True)
class CondensedRun:
    """One scene on one set of modes, ready to be run with any step."""

    model: CondensedModel
    times: np.ndarray
    start: InitialState
    outputs: tuple[str, ...]
    wanted: np.ndarray | None  #: links whose extremes of tension are kept, from 0; None for all
    progress: Callable[[float], None] | None
    scheme: str

    def __call__(self, rate: float) -> CondensedTrajectory:
        """Run with so many steps per second."""
        from cablepod.condensed import _kernels_exact as kernel_exact
        from cablepod.condensed import _kernels_leading as kernel_leading  # numba is imported only to compute

        model, step = self.model, 1.0 / rate
        chain, p, r = model.chain, model.chain.p, len(model.shapes)
        instants = OutputTimes.of(self.times, rate)
        explicit, leading = self.scheme == SCHEMES[0], model.order == "leading"
        damping = p.mass_damping or 0.0
        q, v, acc, z = self._first_state(step, explicit)
        saved, halves = np.empty((instants.steps.size, r)), np.empty((instants.steps.size, 2, r))
        links = (model.slopes, model.n_in_plane, model.chordwise_force_patterns)
        alone = leading and self.wanted is not None  # to leading order a link needs no other
        if alone:
            links = (model.slopes[:, self.wanted], model.n_in_plane, model.chordwise_force_patterns[:, self.wanted])
        wanted = links[0].shape[1] if "tension_extremes" in self.outputs else 0
        low, high = np.full(wanted, np.inf), np.full(wanted, -np.inf)
        kept_too = alone and explicit and "tension" in self.outputs and not instants.needs_interpolation
        series = np.empty((instants.steps.size, links[0].shape[1] if kept_too else 0))
        # kernels know the squares of the frequencies but for the gain by test functions
        highest = 4.0 * rate**2 / model.frequency_amplification if explicit else np.inf
        watch = np.array([np.inf, 0.0, 0.0, highest, np.inf, self.start.h, self.start.h])
        decay = math.exp(-damping * step)
        kick = -math.expm1(-damping * step) / damping if damping else step
        total = int(instants.steps[-1]) + (1 if explicit else 0)
        about = (p.stiffness, chain.total_length, model.spectral_basis[1])
        norms = model.geometric_stiffness_norms / model.frequency_amplification
        bound = 1e6 * math.sqrt(model.mass.sum()) * chain.total_length

        def advance(begin: int, steps: int) -> bool:
            final = begin + steps == total
            first = np.searchsorted(instants.steps, begin)
            last = np.searchsorted(instants.steps, begin + steps + (1 if final and not explicit else 0))
            rows = model.boundary_data(begin, steps - 1 if explicit else steps, rate)
            kept = (begin, instants.steps[first:last], saved[first:last], halves[first:last], low, high, watch)
            done = steps
            if leading:
                rest: tuple[Any, ...] = (
                    *about,
                    model.test_stiffness_defect,
                    model.mean_chordwise_forces,
                    model.geometric_stiffness,
                    model.load_projection,
                    norms,
                    model.chordwise_forces_at_candidates,
                    *links,
                    *kept,
                    *((series[first:last],) if explicit else ()),
                )
                if explicit:
                    kernel_leading.leading_verlet(q, v, step, decay, kick, rows, *rest)
                else:
                    done = kernel_leading.leading_implicit(q, v, acc, step, damping, rows, *rest)
            else:
                slopes, taus, weights = model.rule
                along = (slopes, model.test_slopes_at_points, model.n_in_plane, taus, weights)
                rest = (*about, model.load_projection, norms, *along, model.green, model.inertia, z, *kept)
                if explicit:
                    kernel_exact.exact_verlet(q, v, acc, step, decay, kick, rows, *rest)
                else:
                    done = kernel_exact.exact_implicit(q, v, acc, step, damping, rows, *rest)
            return done == steps and bool(np.isfinite(q).all()) and float(np.abs(q).max()) < bound

        failed = advance_in_blocks(advance, (q, v, acc, z, watch), max(total, 1) if explicit else total, self.progress)
        if total == 0:  # an implicit run of no length has only its start
            advance(0, 0)
        if wanted and self.wanted is not None and not leading:
            low, high = low[self.wanted], high[self.wanted]
        extremes = (low, high) if wanted else None
        state = CondensedTrajectory(instants, saved, halves, extremes, watch, self.scheme, series if kept_too else None)
        if watch[4] < np.inf:  # before any breakdown, whose cause it is
            first = int(watch[4])
            raise RunStopped(
                f"the condensed model stiffened: from {first / rate:.6g} s on its stability limit is below the step "
                f"{step:.6g} s ({self.scheme}), at least {2 / math.sqrt(model.frequency_amplification * watch[2]):.6g} s; try a shorter step, "
                f"or scheme trapezoidal{self._growth()}",
                self._partial(state, first, rate),
            )
        if failed is not None:
            self._stop(state, failed, rate)
        return state

    def sample(self, times: np.ndarray, rate: float) -> CondensedTrajectory:
        """Return the trajectory at other instants [s]: the run with so many steps per second, saved there."""
        return replace(self, times=times, outputs=(), progress=None)(rate)

    def _first_state(self, step: float, explicit: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates, rates (half a step before the start for explicit steps), accelerations, chordwise stretch."""
        model, damping = self.model, self.model.chain.p.mass_damping or 0.0
        q, rates, push, _ = self.start
        z = np.full(
            (2, model.rule[2].size if model.order != "leading" else 0), model.first_stretch(model.initial_boundary_data)
        )
        if not explicit:
            return q.copy(), rates.copy(), push - damping * rates, z
        grow = damped_growth(damping, step)
        back = 0.5 * step if not damping else grow / damping
        return q.copy(), rates * (1.0 + grow) - back * push, push - damping * rates, z

    def _growth(self) -> str:
        """Tell what test functions have to do with a run that stops."""
        count = self.model.unstable_growth_rate * float(self.times[-1])
        if count < 1.0:
            return ""
        return (
            f"; with these test functions small vibrations about rest grow by a factor of e to the {count:.3g} over the run: "
            "train them nearer to this scene, or take the modes without them"
        )

    def _stop(self, state: CondensedTrajectory, done: int, rate: float) -> None:
        raise RunStopped(
            f"the condensed model left the finite numbers or found no equilibrium along the chord at {done / rate:.6g} s "
            f"({self.scheme}, step {1 / rate:.4g} s, step number {done}, least chordwise force {state.watch[0]:.3g} N); try a "
            f"shorter step or, where the cable goes slack, the chain itself{self._growth()}",
            self._partial(state, done, rate),
        )

    def _partial(self, state: CondensedTrajectory, done: int, rate: float) -> xr.Dataset | None:
        """Make a Dataset of the instants before the step number `done`."""
        count = int(np.searchsorted(state.instants.times, done / rate * (1.0 - 1e-12)))
        if not count:
            return None
        few = OutputTimes.of(state.instants.times[:count], rate)
        saved, halves = state.saved[: few.steps.size], state.halves[: few.steps.size]
        part = CondensedTrajectory(few, saved, halves, None, state.watch, self.scheme)
        result = dataset(self.model, part, attributes(self.model, part, None), ("position",), "stopped")
        result.attrs["incomplete"] = f"stopped at {done / rate:.6g} s of {state.instants.times[-1]:.6g} s"
        return result
