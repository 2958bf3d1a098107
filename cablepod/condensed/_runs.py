"""Runs of the condensed model: choice of scheme and step, one scene on one set of modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr

from cablepod._resources import ARRAYS_OF_RUN, check_memory
from cablepod.condensed._air import CondensedAir, with_loads_of_air
from cablepod.condensed._estimate import MAX_SAMPLES, estimate, motion_of, sample_interval
from cablepod.condensed._fields import CondensedTrajectory, close_outputs, positions
from cablepod.condensed._kernels_layout import UNSTABLE_STEP
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import stop_diverged, stop_open, stop_unstable
from cablepod.condensed._stepper import FOURTH_ORDER, CondensedStepper
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._step_limit import verlet_step_limit
from cablepod.errors import scene_error
from cablepod.integrate._comparison import SECOND_ORDER, motion_scale
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output_times import preferred_steps_per_second
from cablepod.integrate._particle_air import OF_DRAG
from cablepod.integrate._request import REDUCED_TOLERANCE, TIME_ERROR_SHARE, Request, check_resolved, check_step
from cablepod.integrate._run import Run
from cablepod.integrate._step_control import fit_step, refine_step
from cablepod.wind._air import air_of
from cablepod.wind._drag import STEP_OVER_DRAG_LIMIT

SCHEMES = ("velocity_verlet", "trapezoidal", FOURTH_ORDER)
#: Schemes by order of the model.
SCHEMES_OF = {"leading": SCHEMES, "exact": SCHEMES[:2], "inertial": SCHEMES[:2]}
#: Longest stable step times the highest angular frequency.
STABLE_PHASE = {"velocity_verlet": 2.0, "trapezoidal": math.inf, FOURTH_ORDER: math.sqrt(12.0)}
#: Minimum ratio of the explicit step limit to that of the tension alone; below, where the stretching of the sag governs, the
#: default scheme is implicit.
IMPLICIT_THRESHOLD = 0.3
#: First step of a refinement times the highest angular frequency (implicit: the lowest).  Free vibrations are undamped: with
#: longer steps their phase errors exceed a period, and the distance of two runs shows no convergence.
PHASE_PER_STEP = 0.4
#: The same, below which the scheme of fourth order is not the default.
FOURTH_ORDER_THRESHOLD = 0.03
#: Number of intervals in which the longest chord is looked for before a run whose step is fitted.
FIT_INTERVALS = 200
#: Maximum default time error as a fraction of the motion.
MAX_TOLERANCE = 1e-2
#: Default time error as a fraction of the motion where the error of the model is not estimated.
DEFAULT_TOLERANCE = 1e-3
#: First step of the scheme of fourth order times the highest angular frequency; phases err by (omega h)^4 / 720 of themselves.
FOURTH_ORDER_PHASE = 1.35
#: Order that is assumed of its first two runs: where the phase of the first one has drifted away, their distance does not fall as
#: the error of the second (with 3 its estimate is above half of the error in 97 % of the prediction study).
FOURTH_ORDER_AT_FIRST = 3.0
#: Minimum number of implicit steps of the first run.
MIN_STEPS = 20.0
#: Minimum number of steps of an explicit first run: the error estimate is that of the motion in its steps, and in lanes the first
#: one needs the loads of three instants.
MIN_EXPLICIT_STEPS = 2


@dataclass(frozen=True, kw_only=True)
class CondensedRequest(Request):
    """Checked options of a run of the condensed model."""

    links: np.ndarray | None = None  #: indices, from 0, of the links whose tensions are computed; None for all
    wind: xr.Dataset | None = None  #: field of the wind, in place of that of the scene


class CondensedResult(NamedTuple):
    """A run with the scheme and step that were chosen."""

    run: CondensedRun
    state: CondensedTrajectory
    steps_per_second: float
    limit: float  #: stability limit of explicit steps at the start [s]
    time_error: float | None  #: estimated time error as a fraction of the motion; None for a given step
    tolerance: float | None  #: of the time error; None for a given step
    model_error: float  #: estimated error of the model as a fraction of the motion; nan where it was not computed


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
    check_memory(times.size, model.chain.links, p.dims, key="times", variables=ARRAYS_OF_RUN)
    cable_air = air_of(p, float(times[-1]), request.wind)
    air = None if cable_air is None else CondensedAir(model, cable_air, float(times[-1]))
    if air is not None and not model.is_uniform:
        air = with_loads_of_air(air)
        model = air.model
    start, end_time = initial_state(model, air), float(times[-1])
    omega_squared = model.omega_max_squared(start.q, model.initial_boundary_data, start.chord_tension)
    limit = verlet_step_limit(math.sqrt(omega_squared))
    scheme, step = request.scheme, request.step
    fits = step is None and request.given_tolerance is None
    estimates = "error_estimate" in request.outputs
    has_rates = p.tension_damping is not None or air is not None
    scheme = _scheme_of(model, scheme, limit, step, fits=fits, has_rates=has_rates)
    if step is None or estimates:
        omega_squared = max(omega_squared, model.omega_taut_squared(end_time, FIT_INTERVALS if fits else 1000))
    sampled = omega_squared if (estimates or fits) and end_time > 0.0 else 0.0
    run = CondensedRun(model, start, scheme, request.links, sampled, air, **request.of_run(times, progress=progress))
    highest = 2.0 / limit
    if run.explicit:  # lower with damping by the tension or by ratios
        limit = run.stable_phase / highest
    if step is not None:
        if run.stable_phase < math.inf:
            of_phase = f"{run.stable_phase:.4g} over the highest angular frequency, {highest:.6g} rad/s"
            check_step(step, run.stable_phase / highest, of_phase)
        if air is not None:
            check_step(step, air.step_limit, OF_DRAG)
        check_resolved(step, p.shortest_time_scale)
        state = run(1.0 / step)
        return CondensedResult(
            run, state, 1.0 / step, limit, None, None, run.model_error(state) if estimates else np.nan
        )
    first_step = _unforced_step(run, omega_squared)
    if fits:
        return _fitted(run, first_step, limit)
    tolerance = request.tolerance if request.given_tolerance is not None else DEFAULT_TOLERANCE
    # where the third derivative of a motion or load jumps, the scheme of fourth order is of second order
    jumps = any(function.has_kinks for function in p.time_functions().values())
    runs = run.comparable(
        first_step,
        order=SECOND_ORDER if jumps else run.order,
        resolved=1.0 / limit if scheme == "trapezoidal" else 0.0,
    )
    state, steps_per_second, time_error = refine_step(runs, tolerance)
    error = run.model_error(state) if estimates else np.nan
    return CondensedResult(run, state, steps_per_second, limit, time_error, tolerance, error)


def initial_state(model: CondensedModel, air: CondensedAir | None) -> InitialState:
    """Return the initial state, with the drag of the air along the cable; None for still air."""
    if air is None:
        acceleration, chord_tension, _ = model.initial_forces
        return InitialState(*model.initial(), acceleration, chord_tension)
    q, rates = air.initial()
    acceleration, _, chord_tension = model.force(q, rates, model.initial_boundary_data)
    return InitialState(q, rates, acceleration + air.acceleration(q, rates), chord_tension)


def _scheme_of(
    model: CondensedModel, scheme: str | None, limit: float, step: float | None, *, fits: bool, has_rates: bool
) -> str:
    """Return the given scheme, or the default one for a stability limit of explicit steps [s].

    `fits` is whether the run chooses step and tolerance; `has_rates`, whether forces depend on the rates beyond the damping by
    mass or by ratios, which velocity Verlet alone contains.
    """
    has_ratios, has_dampers = model.chain.p.damping_ratios is not None, model.damper_matrix.size > 0
    if scheme is not None:
        if scheme not in SCHEMES_OF[model.order]:
            names = ", ".join(f'"{name}"' for name in SCHEMES_OF[model.order])
            raise scene_error("scheme", scheme, f'one of {names} with order "{model.order}"')
        if has_rates and scheme != SCHEMES[0]:
            raise scene_error("scheme", scheme, f'"{SCHEMES[0]}" with wind or damping.tension_proportional')
        if has_ratios and scheme == FOURTH_ORDER:
            raise scene_error(
                "scheme", scheme, f'"{SCHEMES[0]}" or "{SCHEMES[1]}" with damping.ratio or damping.ratios'
            )
        if has_dampers and scheme == FOURTH_ORDER:
            raise scene_error("scheme", scheme, f'"{SCHEMES[0]}" or "{SCHEMES[1]}" with a damper')
        return scheme
    if has_rates:
        return SCHEMES[0]
    _, chord_tension, omega_squared = model.initial_forces
    of_tension = taut_limit(chord_tension, model.slope_norms_squared.max())
    may_be_fourth = fits and model.order == "leading" and not (has_ratios or has_dampers)
    if may_be_fourth and suits_fourth_order(limit, of_tension, model.chain.p.damping, omega_squared):
        return FOURTH_ORDER
    explicit = limit >= IMPLICIT_THRESHOLD * of_tension
    return SCHEMES[0] if explicit or (step is not None and step < limit) else SCHEMES[1]


def taut_limit(chord_tension: Any, kappa: Any) -> Any:
    """Return the stability limit of explicit steps by the tension alone [s], without that of the sag; numbers or members.

    `kappa` is the largest squared slope norm.
    """
    return verlet_step_limit(np.sqrt(np.maximum(np.abs(chord_tension) * kappa, 1e-300)))


def suits_fourth_order(limit: Any, of_tension: Any, damping: Any, omega_squared: Any) -> Any:
    """Tell where the scheme of fourth order is the default; numbers or members.

    Parameters
    ----------
    limit, of_tension
        Stability limit of explicit steps [s], and that by the tension alone.
    damping, omega_squared
        Damping per mass [1/s] and the highest squared frequency [1/s^2] at the start: the steps have to resolve the damping.
    """
    return (limit >= FOURTH_ORDER_THRESHOLD * of_tension) & (0.25 * damping**2 <= omega_squared)


def fourth_order_step(omega_squared: Any, damping: Any) -> Any:
    """Return the first step of the scheme of fourth order [s] by free vibrations, damped by mass [1/s]; numbers or members."""
    return FOURTH_ORDER_PHASE / np.sqrt(omega_squared + 0.25 * damping**2)


def time_tolerance(error: Any) -> Any:
    """Return the tolerance of the time error for the estimated error of the model; numbers or members."""
    return np.clip(TIME_ERROR_SHARE * error, REDUCED_TOLERANCE, MAX_TOLERANCE)


def _fitted(run: CondensedRun, first_step: float, limit: float) -> CondensedResult:
    """Run with a step whose error is a tenth of that expected of the model, which the second run tells.

    Both errors are rms values over the length; that of the step counts the deflection only.  The first run is too coarse for an
    estimate, and a third one only changes its time error.
    """
    model, end_time, scale = run.model, run.end_time, 1.0
    error, tolerance, root_mass = 0.0, math.inf, model.root_total_mass
    orders = {"order": run.order, "first_order": FOURTH_ORDER_AT_FIRST}
    runs = run.comparable(first_step, whole_steps_per_second, **orders)
    run = cast(CondensedRun, runs.run)
    runs_done = 0

    def integrate(steps_per_second: float) -> CondensedTrajectory:
        nonlocal runs_done
        state = run(steps_per_second, samples=runs_done == 1)
        runs_done += 1  # those that stop do not count
        return state

    def tolerance_of(state: CondensedTrajectory) -> float:
        nonlocal error, scale, tolerance
        if end_time > 0.0:
            scale = motion_of(model, state)
            error = estimate(model, state, scale, run.air)
        tolerance = float(time_tolerance(error))
        return tolerance

    runs = replace(runs, run=integrate, position=lambda state: state.q[:, None] / root_mass, scale=lambda _: scale)
    state, steps_per_second, time_error = fit_step(runs, tolerance_of)
    return CondensedResult(run, state, steps_per_second, limit, time_error, tolerance, error)


def whole_steps_per_second(steps_per_second: float) -> float:
    """Round a number of steps per second up to a preferred one whose steps hit whole seconds, where most outputs are."""
    steps_per_second = preferred_steps_per_second(steps_per_second)
    while steps_per_second > 1.0 and steps_per_second % 1.0:
        steps_per_second = preferred_steps_per_second(1.01 * steps_per_second)
    return steps_per_second


def _unforced_step(run: CondensedRun, omega_squared: float) -> float:
    """Return the first step of a refinement [s] by free vibrations, for a bound of their squared frequency [1/s^2]."""
    end_time, kappa, is_explicit = run.end_time, run.model.slope_norms_squared, run.stable_phase < math.inf
    longest = end_time / (MIN_EXPLICIT_STEPS if is_explicit else MIN_STEPS) if end_time > 0.0 else math.inf
    if is_explicit:
        if run.scheme == FOURTH_ORDER:
            return min(longest, float(fourth_order_step(omega_squared, run.model.chain.p.damping)))
        return min(longest, min(PHASE_PER_STEP, 0.5 * run.stable_phase) / math.sqrt(omega_squared))
    chord_tension = max(run.model.omega_taut_squared(end_time), 1e-300) / kappa.max()
    omega_min = math.sqrt(max(chord_tension, 1e-9 * run.model.chain.p.stiffness) * kappa.min())
    return min(longest, PHASE_PER_STEP / omega_min)


class InitialState(NamedTuple):
    """Initial state of a run."""

    q: np.ndarray  #: coordinates (r,)
    rates: np.ndarray  #: their rates (r,)
    acceleration: np.ndarray  #: their undamped accelerations (r,)
    chord_tension: float  #: H [N]


@dataclass(frozen=True)
class CondensedRun(Run):
    """One scene on one set of modes; a call with steps per second integrates it."""

    model: CondensedModel
    start: InitialState
    scheme: str
    links: np.ndarray | None = None  #: indices, from 0, of the links whose tensions are computed; None for all
    #: Bound of the squared frequencies that samples for the error estimate resolve [1/s^2]; 0 for none
    sampled_omega_squared: float = 0.0
    air: CondensedAir | None = None  #: along the cable; None for still air

    @property
    def cells(self) -> LumpedChain:
        """Discretisation of the cable in space."""
        return self.model.chain

    @property
    def step_of_air(self) -> float:
        """Longest step that resolves the wind [s]."""
        air = self.air
        return math.inf if air is None else min(0.5 * air.air.interval, STEP_OVER_DRAG_LIMIT * air.step_limit)

    def compared(self, state: CondensedTrajectory) -> np.ndarray:
        """Return the positions of a trajectory that are compared (times, n + 1, dims) [m]."""
        return positions(self.model, state.q, state.instants.times)

    def motion(self, state: CondensedTrajectory) -> float:
        """Return the largest rms displacement of a trajectory, or the chord if nothing moves [m]."""
        initial = positions(self.model, self.start.q[None], np.zeros(1))[0]
        return motion_scale(self.compared(state), initial, self.model.chain.chord)

    @property
    def explicit(self) -> bool:
        """Whether the scheme is velocity Verlet."""
        return self.scheme == SCHEMES[0]

    @property
    def stable_phase(self) -> float:
        """Longest stable step times the highest angular frequency."""
        p = self.model.chain.p
        if self.explicit and (p.tension_damping is not None or p.damping_ratios is not None):
            omega = math.sqrt(self.model.initial_forces[2])
            return omega * verlet_step_limit(omega, p.tension_damping or 2.0 * max(p.damping_ratios or ()) / omega)
        return STABLE_PHASE[self.scheme]

    @property
    def order(self) -> float:
        """Order of the scheme."""
        return 4.0 if self.scheme == FOURTH_ORDER else SECOND_ORDER

    @property
    def leading(self) -> bool:
        """Whether the model is of order "leading"."""
        return self.model.order == "leading"

    def __call__(self, steps_per_second: float, *, samples: bool = True) -> CondensedTrajectory:
        """Integrate with a fixed number of steps per second, with samples for the error estimate where it has some.

        Raises
        ------
        RunStopped
            Where the frequencies outgrow the step, the coordinates diverge, Newton's method fails, or the chord does not close
            at an instant of the output.
        """
        stepper = CondensedStepper(self, steps_per_second, samples=samples)
        total = max(stepper.total, 1) if self.explicit else stepper.total
        # to leading order the arrays hold the chosen links only
        extremes = (stepper.low, stepper.high) if stepper.low.size else None
        chosen = None if self.leading else self.links
        watch = self.watch(steps_per_second, total, extremes, with_end=not self.explicit, chosen=chosen)
        failed_step = advance_in_blocks(stepper.advance, stepper.changed, total, self.progress, watch)
        times = None
        if watch is not None and failed_step is None:
            times = watch.finish(stepper.advance, stepper.changed, steps_per_second)
        if stepper.total == 0:  # an implicit run of no length has only its start
            stepper.advance(0, 0)
        state = stepper.trajectory(times)
        if state.monitor[UNSTABLE_STEP] < np.inf:  # tested first, because it is the cause of a divergence
            stop_unstable(self, state, int(state.monitor[UNSTABLE_STEP]))
        if failed_step is not None:
            stop_diverged(self, state, failed_step)
        if not self.leading and (time := close_outputs(self.model, state, self.outputs, self.links)) is not None:
            stop_open(self, state, time)
        return state

    def sample_interval(self, steps_per_second: float) -> int:
        """Return the number of steps between the samples for the error estimate; 0 without."""
        if not self.sampled_omega_squared:
            return 0
        end_time, modes = self.end_time, self.model.n_in_plane
        time_scale = self.model.chain.p.shortest_time_scale
        interval = sample_interval(self.sampled_omega_squared, modes, steps_per_second, end_time, time_scale=time_scale)
        if self.air is not None:  # samples as close as those of the gusts, unless these are too many
            of_gusts = steps_per_second * self.air.air.interval
            interval = max(math.floor(min(interval, of_gusts)), 1, math.ceil(end_time * steps_per_second / MAX_SAMPLES))
        return interval

    def model_error(self, state: CondensedTrajectory) -> float:
        """Return the estimated error of the model as a fraction of the motion, from a trajectory with samples."""
        return estimate(self.model, state, motion_of(self.model, state), self.air) if state.sample_interval else 0.0
