"""Why runs of the condensed model stop, with the result until then."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from cablepod.condensed._fields import CondensedTrajectory, close_outputs
from cablepod.condensed._kernels_layout import MAX_OMEGA_SQUARED, MIN_FORCE
from cablepod.condensed._output import attributes, dataset

if TYPE_CHECKING:
    from cablepod.condensed._runs import CondensedRun


def stop_unstable(run: CondensedRun, state: CondensedTrajectory, step_number: int) -> NoReturn:
    """Stop a run whose frequencies have outgrown the step."""
    limit = 2 / math.sqrt(state.monitor[MAX_OMEGA_SQUARED])
    rate = state.instants.steps_per_second
    time = step_number / rate
    why = (
        f"the condensed model stiffened: from {time:.6g} s on its stability limit is below the step "
        f"{1.0 / rate:.6g} s ({run.scheme}), at least {limit:.6g} s; try a shorter step, or scheme trapezoidal"
    )
    _stop(run, state, time, why)


def stop_diverged(run: CondensedRun, state: CondensedTrajectory, step_number: int) -> NoReturn:
    """Stop a run that has left the finite numbers, or whose steps found no equilibrium along the chord."""
    rate = state.instants.steps_per_second
    time = step_number / rate
    why = (
        f"the condensed model left the finite numbers or found no equilibrium along the chord at {time:.6g} s "
        f"({run.scheme}, step {1.0 / rate:.4g} s, step number {step_number}, least chordwise force "
        f"{state.monitor[MIN_FORCE]:.3g} N); try a shorter step or, where the cable goes slack, chain.simulate"
    )
    _stop(run, state, time, why)


def stop_open(run: CondensedRun, state: CondensedTrajectory, time: float) -> NoReturn:
    """Stop a run at the first instant [s] whose chord does not close."""
    why = (
        f"the condensed model found no equilibrium along the chord at {time:.6g} s: the ends are nearer to each other than links "
        f"of these slopes can be pushed together ({run.scheme}, step {1.0 / state.instants.steps_per_second:.4g} s, least "
        f"chordwise force {state.monitor[MIN_FORCE]:.3g} N); try chain.simulate"
    )
    _stop(run, state, time, why)


def _stop(run: CondensedRun, state: CondensedTrajectory, time: float, why: str) -> NoReturn:
    """Raise :class:`cablepod.errors.RunStopped` with the result at the instants before `time` [s]."""
    instants, partial = state.only(run.times).instants.before_time(time), None
    if instants is not None:
        rows = np.searchsorted(state.instants.steps, instants.steps)
        saved, half_step_rates = state.saved[rows], state.half_step_rates[rows]
        part = CondensedTrajectory(instants, saved, half_step_rates, None, state.monitor, run.scheme)
        if not run.leading and (earlier := close_outputs(run.model, part)) is not None:
            stop_open(run, state, earlier)
        partial = dataset(run.model, part, attributes(run.model, part, None), ("position",), "stopped")
    run.stop(partial, time, why)
