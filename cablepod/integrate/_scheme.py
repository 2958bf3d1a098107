"""Choice of scheme: long implicit steps, halved while they are cheaper than explicit ones."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.discretisation._chain import LumpedChain
from cablepod.errors import RunStopped
from cablepod.integrate._step_control import ComparableRuns, Search, Wanted, refinement

#: Maximum steps times links of a trial run with long implicit steps (a minute or two).
MAX_TRIAL_WORK = 1e9
#: Steps of the first implicit run in a period of the first transverse vibration.
STEPS_PER_PERIOD = 8.0
#: Tolerance over the distance at which two implicit runs agree: their long steps need not resolve all frequencies.
HALVING_MARGIN = 4.0
#: Minimum explicit run time at which an implicit scheme is tried unless a tolerance is given [s].
CHOICE_MIN_SECONDS = 0.3


def first_implicit_step(chain: LumpedChain, tension: np.ndarray, end_time: float, limit: float) -> float:
    """Return the first implicit step [s], by the first transverse period at `tension` (links,) [N], not below `limit` [s]."""
    period = 2.0 * chain.total_length / math.sqrt(max(float(tension.mean()), 1e-300) / chain.p.mass)
    return max(min(end_time / 20.0, period / STEPS_PER_PERIOD), limit)


def halve_step_while_cheaper(
    runs: ComparableRuns, tolerance: float, max_steps_per_second: float
) -> Search[tuple[Any, float, float] | None]:
    """Search with halved long implicit steps until two runs agree well within `tolerance`.

    Long implicit steps do not resolve all frequencies, and so show no order: the distance of two runs counts as it is, and must
    be smaller than the tolerance by HALVING_MARGIN.  No run has more than `max_steps_per_second`, beyond which explicit steps are
    cheaper, nor more than MAX_TRIAL_WORK steps times links.

    Returns
    -------
    tuple or None
        The finer of the two runs, its steps per second, their distance; None if no two runs agree.
    """
    coarse = None
    for steps_per_second in halving_rates(runs, max_steps_per_second):
        try:
            fine = yield Wanted(runs.run, steps_per_second)
        except RunStopped:
            fine = None
        if fine is not None and coarse is not None:
            motion, tension = runs.distances(fine, coarse)
            if max(motion, tension) <= tolerance / HALVING_MARGIN:
                runs.note_tension(fine, tension)
                return runs.finish(fine), steps_per_second, motion
        coarse = fine
    return None


def halving_rates(runs: ComparableRuns, max_steps_per_second: float) -> list[float]:
    """Return the steps per second that :func:`halve_step_while_cheaper` tries in turn."""
    upper_limit = min(max_steps_per_second, runs.max_steps_per_second(MAX_TRIAL_WORK))
    rates = [runs.steps_per_second]
    while rates[-1] <= upper_limit:
        rates.append(2.0 * rates[-1])
    return rates[:-1]


class Solution(NamedTuple):
    """A run, its trajectory, and the reason for scheme and step."""

    run: Any
    trajectory: Any
    steps_per_second: float
    time_error: float | None  #: estimate as a fraction of the motion; None for a given step
    reason: str = "given"  #: for the scheme
    space_error: float | None = None  #: estimate as a fraction of the motion; None unless it is an output

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the result in addition to those of the run."""
        estimate = {} if self.time_error is None else {"time_error_estimate": self.time_error}
        if self.space_error is not None:
            estimate["space_error_estimate"] = self.space_error
        return estimate | {"choice_of_scheme": self.reason}

    def dataset(self) -> xr.Dataset:
        """Make the result of the run."""
        result = self.run.dataset(self.trajectory)
        result.attrs.update(self.attributes)
        return result


def choose_scheme(
    explicit: ComparableRuns,
    implicit: ComparableRuns,
    tolerance: float,
    *,
    step_limit: float,
    explicit_seconds: float | None,
    max_steps_per_second: float,
) -> Search[Solution]:
    """Search scheme and step for a tolerance: implicit if its steps are long enough to be faster.

    Parameters
    ----------
    explicit, implicit
        Runs by either scheme.
    tolerance
        Time error as a fraction of the motion.
    step_limit
        Stability limit of explicit steps [s].
    explicit_seconds
        Estimated run time of all explicit runs [s], below which no other scheme is tried; None to try in any case.
    max_steps_per_second
        Of implicit runs; beyond it explicit steps are cheaper.
    """
    if explicit_seconds is not None and explicit_seconds < CHOICE_MIN_SECONDS:
        reason = f"explicit: its runs were expected to take {explicit_seconds:.1g} s, too little to try another scheme"
        return Solution(explicit.run, *(yield from refinement(explicit, tolerance)), reason)
    halved = yield from halve_step_while_cheaper(implicit, tolerance, max_steps_per_second)
    if halved is not None:
        ratio = 1.0 / (halved[1] * step_limit)
        reason = f"implicit: two runs with steps of {ratio:.3g} and {2 * ratio:.3g} times the explicit limit agreed"
        return Solution(implicit.run, *halved, reason)
    rates = halving_rates(implicit, max_steps_per_second)
    reason = f"explicit: no two implicit runs have steps above {1 / max_steps_per_second:.3g} s, where they are cheaper"
    if len(rates) > 1:
        reason = f"explicit: implicit runs with steps down to {1 / rates[-1]:.3g} s did not agree"
    return Solution(explicit.run, *(yield from refinement(explicit, tolerance)), reason)
