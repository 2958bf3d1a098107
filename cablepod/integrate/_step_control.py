"""Choice of the step: a search says which run it wants next, and takes it.

The error of a run from runs with other steps, and what follows from it, is in ``_refinement.py``.  :func:`complete` computes the
runs of one search in turn; a batch computes those of many searches together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cablepod.errors import NotConvergedWarning, RunStopped, SceneError, warn
from cablepod.integrate._comparison import ComparableRuns
from cablepod.integrate._refinement import MAX_WORK, Compared, Rules, Verdict, judge

#: Minimum number of steps in the shortest time scale of motions and loads: steps that are multiples of a period all see the same
#: phase, so that two wrong runs would agree.
STEPS_PER_CHANGE = 8.0
#: Maximum number of times that the step of a first run that breaks down is halved.
MAX_HALVINGS = 2


class Found(NamedTuple):
    """What a search has found."""

    trajectory: Any
    steps_per_second: float
    error: float | None  #: estimated time error as a fraction of the motion; None for a given step


class Search:
    """Search of a step by runs of one scene."""

    run: Callable[[float], Any]  #: computes a run from its steps per second; may raise RunStopped
    wanted: float | None  #: steps per second of the run that is needed next; None at the end
    found: Found | None = None  #: at the end; None if the search was in vain
    reason: str = "given"  #: for the scheme

    def take(self, trajectory: Any) -> None:
        """Take the run that was wanted."""
        raise NotImplementedError

    def go_on_after_stop(self) -> bool:
        """Take account of a run that stopped; returns whether the search goes on."""
        return False


def complete(search: Search) -> Any:
    """Compute the runs that a search wants, one after the other; returns what it finds."""
    while search.wanted is not None:
        try:
            trajectory = search.run(search.wanted)
        except RunStopped:
            if not search.go_on_after_stop():
                raise
        else:
            search.take(trajectory)
    return search.found


class GivenStep(Search):
    """The one run with a given number of steps per second."""

    def __init__(self, run: Callable[[float], Any], steps_per_second: float) -> None:
        self.run, self.wanted = run, steps_per_second

    def take(self, trajectory: Any) -> None:
        """Take the run that was wanted."""
        assert self.wanted is not None
        self.found, self.wanted = Found(trajectory, self.wanted, None), None


class Refinement(Search):
    """Runs with rising numbers of steps per second until two of them agree within a tolerance.

    Two runs tell the time error of the finer one only if the order is known.  A scheme of second order shows that order only for
    motion that its steps resolve (a jump in the velocity of an end makes waves that they do not).  So the distance of the first
    two runs counts as it is; from the third run on the observed order enters.  A first run that breaks down is repeated with half
    and a quarter of the step.

    Parameters
    ----------
    runs
        The runs and their comparison.
    tolerance
        Maximum error as a fraction of the motion, or a function that returns it for the second run.
    economical
        Whether steps are hardly shorter than needed: the order is assumed of the first two runs too.

    Raises
    ------
    SceneError
        For a first run that costs more than :func:`check_work` allows.  No later run costs more, except for the second one,
        which has twice the steps of the first.

    Warns
    -----
    NotConvergedWarning
        If shorter steps do not bring the runs together, or only too slowly.
    """

    def __init__(
        self, runs: ComparableRuns, tolerance: float | Callable[[Any], float], *, economical: bool = False
    ) -> None:
        check_work(runs.steps_per_second, runs.end_time, runs.links)
        self.run, self.wanted = runs.run, runs.steps_per_second
        self._runs, self._tolerance, self._economical = runs, tolerance, economical
        self._last: tuple[Any, float] | None = None  # run and its steps per second
        self._halvings, self._history = 0, list[Verdict]()

    def go_on_after_stop(self) -> bool:
        """Halve the step of a first run that stopped; returns whether the search goes on."""
        if self._last is not None or self._halvings == MAX_HALVINGS or self.wanted is None:
            return False
        self._halvings += 1
        self.wanted *= 2.0
        return True

    def take(self, trajectory: Any) -> None:
        """Take the run that was wanted."""
        rate, last, runs = self.wanted, self._last, self._runs
        assert rate is not None
        self._last = trajectory, rate
        if last is None:
            self.wanted = 2.0 * rate  # no preferred number, so that both runs share their instants
            return
        coarse, before = last
        if not self._history:
            tolerance = self._tolerance(trajectory) if callable(self._tolerance) else self._tolerance
            self._rules = Rules(runs, before, tolerance, self._economical)
        now = Compared(rate, rate / before, *runs.distances(trajectory, coarse), runs.has_kinks(trajectory))
        verdict = judge(self._rules, now, self._history)
        self._history.append(verdict)
        runs.note_tension(trajectory, verdict.tension_error)
        self.wanted = verdict.wanted
        if self.wanted is None:
            if not verdict.is_accepted:
                _warn_not_converged(verdict, self._rules.tolerance)
            self.found = Found(runs.finish(trajectory), rate, verdict.error)


def refine_step(runs: ComparableRuns, tolerance: float) -> Found:
    """Run as :class:`Refinement` says; returns the finest run, its steps per second, the estimate of its error."""
    return complete(Refinement(runs, tolerance))


def fit_step(runs: ComparableRuns, tolerance_of: Callable[[Any], float]) -> Found:
    """Run economically until two runs agree within a tolerance that the second one tells, which is often the last.

    That suits a time error that only has to be small beside another error.  Returns as :func:`refine_step`.
    """
    return complete(Refinement(runs, tolerance_of, economical=True))


def check_work(steps_per_second: float, end_time: float, links: int) -> None:
    """Refuse a run whose steps times links exceed MAX_WORK.

    Raises
    ------
    SceneError
        With the number of steps, and what to change.
    """
    if steps_per_second * end_time * links > MAX_WORK:
        raise SceneError(
            f"time.duration: given {end_time:g} s, which with {links} links needs {steps_per_second * end_time:.3g} steps of "
            f"{1.0 / steps_per_second:.3g} s; allowed: {MAX_WORK:g} steps times links if no step is given; try a "
            f"shorter duration, fewer links, another scheme, or step={1.0 / steps_per_second:.3g}, which has no such bound"
        )


def _warn_not_converged(verdict: Verdict, tolerance: float) -> None:
    """Warn of motion, or of tension alone, that has not converged within the tolerance."""
    step = 1.0 / verdict.compared.steps_per_second
    if verdict.motion_is_accepted:
        text = (
            f"tension not converged in time: an error of {verdict.tension_error:.3g} of its range is left at step {step:.3g} s, "
            f"and of {verdict.error:.2g} of the motion, more than the tolerance {tolerance:.2g}; axial waves or snaps are not "
            "resolved; give a ramp to motions that start with a jump, a shorter step, or a larger tolerance"
        )
    else:
        text = (
            f"not converged in time: an error of {verdict.error:.3g} of the motion is left at step {step:.3g} s, more than the "
            f"tolerance {tolerance:.2g}; the motion is chaotic (judge it by statistics) or too abrupt for this scheme; give a "
            "shorter step, or a larger tolerance"
        )
    warn(text, NotConvergedWarning)
