"""Choice of scheme: long implicit steps, halved while they are cheaper than explicit ones."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr

from cablepod.discretisation._chain import LumpedChain
from cablepod.errors import NotConvergedWarning, warn
from cablepod.integrate._comparison import ComparableRuns
from cablepod.integrate._energy_check import ENERGY_WARN
from cablepod.integrate._step_control import Found, Refinement, Search

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


class Halving(Search):
    """Long implicit steps, halved until two runs agree well within `tolerance`; in vain if no two runs agree.

    Long implicit steps do not resolve all frequencies, and so show no order: the distance of two runs counts as it is, and must
    be smaller than the tolerance by HALVING_MARGIN.  No run has more than `max_steps_per_second`, beyond which explicit steps are
    cheaper, nor more than MAX_TRIAL_WORK steps times links.
    """

    def __init__(self, runs: ComparableRuns, tolerance: float, max_steps_per_second: float) -> None:
        self.run, self._runs, self._tolerance = runs.run, runs, tolerance
        self._most = min(max_steps_per_second, runs.max_steps_per_second(MAX_TRIAL_WORK))
        self._coarse: Any = None  # the run before; None if it stopped
        self.tried: list[float] = []  #: steps per second of the runs so far
        self.wanted = self._allowed(runs.steps_per_second)

    def _allowed(self, steps_per_second: float) -> float | None:
        """Return steps per second, or None if they are too many."""
        return steps_per_second if steps_per_second <= self._most else None

    def go_on_after_stop(self) -> bool:
        """Go on after a run that stopped."""
        self.take(None)
        return True

    def take(self, trajectory: Any) -> None:
        """Take the run that was wanted, None if it stopped."""
        rate = self.wanted
        assert rate is not None
        self.tried.append(rate)
        if trajectory is not None and self._coarse is not None:
            motion, tension = self._runs.distances(trajectory, self._coarse)
            if max(motion, tension) <= self._tolerance / HALVING_MARGIN:
                self._runs.note_tension(trajectory, tension)
                self.found, self.wanted = Found(self._runs.finish(trajectory), rate, motion), None
                return
        self._coarse, self.wanted = trajectory, self._allowed(2.0 * rate)


class Solution(NamedTuple):
    """A run, its trajectory, and the reason for scheme and step."""

    run: Any
    trajectory: Any
    steps_per_second: float
    time_error: float | None  #: estimate as a fraction of the motion; None for a given step
    reason: str = "given"  #: for the scheme
    space_error: float | None = None  #: estimate as a fraction of the motion; None unless it is an output

    @classmethod
    def of(cls, search: Search) -> Self:
        """Return what a search has found at its end."""
        assert search.found is not None
        return cls(search.run, *search.found, search.reason)

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the result in addition to those of the run."""
        estimate = {} if self.time_error is None else {"time_error_estimate": self.time_error}
        if self.space_error is not None:
            estimate["space_error_estimate"] = self.space_error
        return estimate | {"choice_of_scheme": self.reason}

    def warn_of_energy_excess(self, holder: str, remedy: str) -> None:
        """Warn if `holder`, with a given step, holds excessive strain energy; `remedy` is what to compare with."""
        excess = self.trajectory.diagnostics["energy_excess"]
        if self.time_error is None and excess > ENERGY_WARN:
            warn(
                f"{holder} up to {excess:.2g} times the energy that rest, loads and ends explain: a resonance, or a step too "
                f"long for a cable that slackens and snaps taut; compare with {remedy}",
                NotConvergedWarning,
            )

    def dataset(self) -> xr.Dataset:
        """Make the result of the run."""
        result = self.run.dataset(self.trajectory)
        result.attrs.update(self.attributes)
        return result


class SchemeChoice(Search):
    """Search of scheme and step for a tolerance: implicit if its steps are long enough to be faster.

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

    def __init__(
        self,
        explicit: ComparableRuns,
        implicit: ComparableRuns,
        tolerance: float,
        *,
        step_limit: float,
        explicit_seconds: float | None,
        max_steps_per_second: float,
    ) -> None:
        self._explicit, self._tolerance = explicit, tolerance
        self._step_limit, self._most = step_limit, max_steps_per_second
        self._halving = Halving(implicit, tolerance, max_steps_per_second)
        self._search: Search = self._halving
        if explicit_seconds is not None and explicit_seconds < CHOICE_MIN_SECONDS:
            self.reason = (
                f"explicit: its runs were expected to take {explicit_seconds:.1g} s, too little to try another scheme"
            )
            self._search = Refinement(explicit, tolerance)
        self._follow()

    @classmethod
    def of_runs(
        cls, explicit: Any, implicit: Any, tolerance: float, *, implicit_cost: float, step_time: float | None
    ) -> Self:
        """Return the search of two :class:`cablepod.integrate._chain_run.ChainRun`, one by either scheme.

        `implicit_cost` is that of an implicit step in explicit steps, `step_time` the run time of an explicit step for each link
        [s], None to try implicit steps in any case.
        """
        steps_per_second = 1.0 / explicit.resolving(explicit.unforced_step)
        steps = 3.0 * explicit.end_time * steps_per_second
        return cls(
            explicit.comparable_runs(),
            implicit.comparable_runs(),
            tolerance,
            step_limit=explicit.step_limit,
            explicit_seconds=None if step_time is None else steps * explicit.cells.links * step_time,
            max_steps_per_second=steps_per_second / implicit_cost,
        )

    def take(self, trajectory: Any) -> None:
        """Take the run that was wanted."""
        self._search.take(trajectory)
        self._follow()

    def go_on_after_stop(self) -> bool:
        """Take account of a run that stopped; returns whether the search goes on."""
        goes_on = self._search.go_on_after_stop()
        self._follow()
        return goes_on

    def _follow(self) -> None:
        """Say what the present search says; go on with explicit steps where implicit ones were in vain."""
        halving = self._halving
        if self._search is halving and halving.wanted is None:
            if halving.found is not None:
                ratio = 1.0 / (halving.found.steps_per_second * self._step_limit)
                self.reason = (
                    f"implicit: two runs with steps of {ratio:.3g} and {2 * ratio:.3g} times the explicit limit agreed"
                )
            else:
                self.reason = (
                    f"explicit: no two implicit runs have steps above {1 / self._most:.3g} s, where they are cheaper"
                )
                if len(halving.tried) > 1:
                    self.reason = (
                        f"explicit: implicit runs with steps down to {1 / halving.tried[-1]:.3g} s did not agree"
                    )
                self._search = Refinement(self._explicit, self._tolerance)
        self.run, self.wanted, self.found = self._search.run, self._search.wanted, self._search.found
