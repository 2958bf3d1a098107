"""Step control by comparison of runs: refinement, observed order."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from cablepod.errors import NotConvergedWarning, RunStopped, SceneError, user_stacklevel

#: Minimum observed order of a converging scheme: runs that differ whatever their steps seem to have 0.1 to 0.7.
MIN_ORDER = 0.8
#: Orders that are assumed where forces have kinks, and otherwise.
FIRST_ORDER, SECOND_ORDER = 1.0, 2.0
#: Maximum number of refinements after the first run, and maximum factor of the number of steps in one of them.
MAX_REFINEMENTS, MAX_FACTOR = 6, 4.0
#: Minimum factor of the number of steps; the same after a first run whose steps may be too long to show the order of the scheme.
MIN_FACTOR, MIN_FACTOR_UNRESOLVED = 1.25, 1.5
#: Tolerance over the expected error of the next refinement; the same, and margin of the first estimate, for :func:`fit_step`.
REFINEMENT_MARGIN, ECONOMICAL_MARGIN, FIRST_MARGIN = 4.0, 1.5, 1.5
#: Maximum number of steps of a run over that of the first (more steps would take long for a motion that is hardly resolved), but
#: for runs of MAX_TENSION_WORK or less.
MAX_GROWTH = 512.0
#: Maximum steps times links of a run without a given step (half an hour to some hours).  A run with a given step has no such
#: bound.
MAX_WORK = 1e12
#: Minimum number of steps in the shortest time scale of motions and loads: steps that are multiples of a period all see the same
#: phase, so that two wrong runs would agree.
STEPS_PER_CHANGE = 8.0
#: Maximum number of steps of a run over that of the first, and maximum steps times links (0.2 s) where that is more, if
#: the motion has converged and the tension alone has not: axial waves may need many more, as after a jump of the speed of an end.
MAX_TENSION_GROWTH, MAX_TENSION_WORK = 32.0, 1e8
#: Range of the tensions of a chain at rest over their rounding error: that of thousands of steps adds up to ten times as much.
ROUNDING_OF_STEPS = 30.0
#: Maximum of damping times an explicit step: the velocity half a step before the start grows by exp(c h / 2), and its square must
#: stay finite.
MAX_DAMPING_EXPONENT = 600.0
# Mantissas to which steps per second are rounded up: a step then hits round instants, and no bit of the result depends on the
# output times.
_PREFERRED_MANTISSAS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0, 10.0)


T = TypeVar("T")


class Wanted(NamedTuple):
    """A run that a search of the step needs next."""

    run: Callable[[float], Any]  #: computes a run from its steps per second; may raise RunStopped
    steps_per_second: float


#: Search of a step: yields the runs it needs and is sent their results, or thrown their RunStopped; so that the runs of many
#: searches can be computed together.  Ends with its result.
Search = Generator[Wanted, Any, T]


def complete(search: Search[T], wanted: Wanted | None = None) -> T:
    """Compute the runs that a search needs one after the other, `wanted` first if it has begun; returns its result."""
    try:
        wanted = wanted or next(search)
        while True:
            try:
                result = wanted.run(wanted.steps_per_second)
            except RunStopped as stopped:
                wanted = search.throw(stopped)
            else:
                wanted = search.send(result)
    except StopIteration as end:
        return end.value


def _without_kinks(run: Any) -> bool:
    """Default of :attr:`ComparableRuns.has_kinks`."""
    return False


def _unchanged(run: Any) -> Any:
    """Default of :attr:`ComparableRuns.finish`."""
    return run


def _no_note(run: Any, error: float) -> None:
    """Default of :attr:`ComparableRuns.note_tension`."""


@dataclass(frozen=True)
class ComparableRuns:
    """Runs of one scene with any step, and how two of them are compared."""

    run: Callable[
        [float], Any
    ]  #: computes a run from its steps per second; may raise :class:`cablepod.errors.RunStopped`
    position: Callable[[Any], np.ndarray]  #: positions of a run (time, particle, dims) [m]
    scale: Callable[[Any], float]  #: length by which distances of runs are divided, see :func:`motion_scale` [m]
    steps_per_second: float  #: of the first run
    end_time: float = 0.0  #: [s]
    links: int = 0  #: links, or nodes but one: the factor of the cost of a step
    #: Whether the forces of a run have kinks, as where links slacken and snap taut.  Each kink adds an error that depends on its
    #: place in the step, so that at most first order is assumed.
    has_kinks: Callable[[Any], bool] = _without_kinks
    order: float = SECOND_ORDER  #: of the scheme
    first_order: float = math.inf  #: the order assumed of the first two runs, where their steps are too long to show it
    #: Tensions of a run (rows, link) [N], where they are to converge as the motion does
    tension: Callable[[Any], np.ndarray] | None = None
    tension_rounding: float = 0.0  #: rounding error of tensions [N], which does not count
    #: Steps per second from which a run resolves all frequencies, of implicit schemes; with fewer the estimate takes first order
    resolved: float = 0.0
    finish: Callable[[Any], Any] = _unchanged  #: makes the result of the run taken, without instants of the comparison
    note_tension: Callable[[Any, float], None] = _no_note  #: takes a run and the estimated error of its tensions

    def distances(self, fine: Any, coarse: Any) -> tuple[float, float]:
        """Return the distances of the motions of two runs and of their tensions, the latter 0 where they do not count.

        They are the largest rms distance of the particles over the motion of the finer run, and the largest rms difference of
        the tensions over their range in it.
        """
        fine_position = self.position(fine)
        gap = fine_position - self.position(coarse)
        gap = gap.reshape(gap.shape[0], -1)
        motion = math.sqrt(np.einsum("ij,ij->i", gap, gap).max() / fine_position.shape[-2]) / self.scale(fine)
        if self.tension is None:
            return motion, 0.0
        tension = self.tension(fine)
        return motion, tension_distance(tension, self.tension(coarse), self.tension_rounding)

    def max_steps_per_second(self, work: float) -> float:
        """Return the steps per second at which a run has `work` steps times links."""
        return work / max(self.end_time * self.links, 1e-300)


def damped_growth(damping: float, step: float) -> float:
    """Return exp(c h / 2) - 1, the relative growth of a velocity traced back over half a step [s] against damping c [1/s]."""
    if damping * step > MAX_DAMPING_EXPONENT:
        raise SceneError(
            f"damping.mass_proportional: given {damping:g}; allowed: at most {MAX_DAMPING_EXPONENT / step:.4g} 1/s with explicit "
            f"steps of {step:.4g} s; an implicit scheme, or a shorter step, takes more"
        )
    return math.expm1(0.5 * damping * step)


def preferred_steps_per_second(steps_per_second: float) -> float:
    """Round a number of steps per second up to the next preferred one."""
    power = 10.0 ** math.floor(math.log10(steps_per_second))
    return next(p for p in _PREFERRED_MANTISSAS if p * power >= steps_per_second * (1.0 - 1e-12)) * power


def motion_scale(position: np.ndarray, initial: np.ndarray, chord: float) -> float:
    """Return the largest rms displacement from the initial shape, or the chord if nothing moves: the divisor of errors [m]."""
    largest = float(np.sqrt(np.mean(np.sum((position - initial) ** 2, axis=-1), axis=-1)).max(initial=0.0))
    return largest if largest > 1e-9 * chord else chord


def tension_distance(fine: np.ndarray, coarse: np.ndarray, rounding: float = 0.0) -> float:
    """Return the largest rms difference of tensions (rows, links) [N] over the largest range of a link in `fine`.

    Differences up to `rounding` [N] do not count.
    """
    span = float((fine.max(axis=0) - fine.min(axis=0)).max())
    largest = float(np.abs(fine).max())
    at_rest = span <= max(1e-9 * largest, ROUNDING_OF_STEPS * rounding)  # nothing changes but by rounding errors
    scale = max(largest, 1e-300) if at_rest else span
    return max(math.sqrt(float(((fine - coarse) ** 2).mean(axis=1).max())) - rounding, 0.0) / scale


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


def refine_step(runs: ComparableRuns, tolerance: float) -> tuple[Any, float, float]:
    """Run with rising numbers of steps per second until two runs agree within `tolerance`.

    Two runs tell the time error of the finer one only if the order is known.  A scheme of second order shows that order only for
    motion that its steps resolve (a jump in the velocity of an end makes waves that they do not).  So the distance of the first
    two runs counts as it is; from the third run on the observed order enters.

    Parameters
    ----------
    runs
        The runs and their comparison.
    tolerance
        Maximum error as a fraction of the motion.

    Returns
    -------
    tuple
        The finest run, its steps per second, the estimate of its error.

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
    return complete(refinement(runs, tolerance))


def refinement(runs: ComparableRuns, tolerance: float) -> Search[tuple[Any, float, float]]:
    """Return the search of :func:`refine_step`."""
    check_work(runs.steps_per_second, runs.end_time, runs.links)
    coarse, rate = yield from _first_finite_run(runs)
    return (yield from _refine(runs, coarse, rate, tolerance, economical=False))


def fit_step(
    runs: ComparableRuns, tolerance_of: Callable[[Any], float], *, by_second: bool = False
) -> tuple[Any, float, float, float]:
    """Run with rising numbers of steps per second until two runs agree within a tolerance that the first run tells.

    Steps are hardly shorter than needed: second order is assumed for the distance of the first two runs.  That suits a time error
    that only has to be small beside another error.

    Parameters
    ----------
    runs
        The runs and their comparison.
    tolerance_of
        Returns the maximum error as a fraction of the motion for the first run.
    by_second
        Whether it takes the second run instead, which is often the last.

    Returns
    -------
    tuple
        The finest run, its steps per second, the estimate of its error, the tolerance.

    Raises
    ------
    SceneError, NotConvergedWarning
        As :func:`refine_step`.
    """
    check_work(runs.steps_per_second, runs.end_time, runs.links)
    coarse, rate = complete(_first_finite_run(runs))
    if not by_second:
        tolerance = tolerance_of(coarse)
        return (*complete(_refine(runs, coarse, rate, tolerance, economical=True)), tolerance)
    told = []

    def by_finer(fine: Any) -> float:
        told.append(tolerance_of(fine))
        return told[0]

    return (*complete(_refine(runs, coarse, rate, by_finer, economical=True)), told[0])


def _refine(
    runs: ComparableRuns, coarse: Any, rate: float, tolerance: float | Callable[[Any], float], *, economical: bool
) -> Search[tuple[Any, float, float]]:
    """Refine a first run with `rate` steps per second, see :func:`refine_step` and, economically, :func:`fit_step`.

    `tolerance` may be a function of the second run.
    """
    aim = ECONOMICAL_MARGIN if economical else REFINEMENT_MARGIN
    short = runs.max_steps_per_second(MAX_TENSION_WORK)
    max_rate = min(max(MAX_GROWTH * rate, short), runs.max_steps_per_second(MAX_WORK))
    of_tension_rate = min(max_rate, max(MAX_TENSION_GROWTH * rate, short))
    factor, last, last_factor, slow = 2.0, (math.inf, math.inf), math.inf, 0
    for _ in range(MAX_REFINEMENTS):
        # the first doubling is exact, so that its runs share their instants; later numbers are preferred ones again
        new_rate = 2.0 * rate if last_factor == math.inf else preferred_steps_per_second(rate * factor)
        factor, rate = new_rate / rate, new_rate
        fine = yield Wanted(runs.run, rate)
        if callable(tolerance):
            tolerance = tolerance(fine)
        distances = runs.distances(fine, coarse)
        max_order = FIRST_ORDER if runs.has_kinks(fine) else runs.order
        limit = (0.5 if rate < max_rate and not economical else 1.0) * tolerance  # while a finer run is possible
        if last_factor == math.inf:
            order = min(max_order, runs.first_order)
            # second order is not observed yet, so the estimate does not use it, or with a margin
            divisor = (factor**order - 1.0) / FIRST_MARGIN if economical else 1.0
            limit = tolerance if order > FIRST_ORDER else limit
            orders = order, order
        else:
            orders = (
                _order(distances[0], last[0], last_factor, factor, max_order),
                _order(distances[1], last[1], last_factor, factor, max_order),
            )
            divisor = 1.0
        # vibrations that are not resolved differ as much at the next step, while the order is seen at the others
        highest = FIRST_ORDER if rate < factor * runs.resolved else runs.order
        estimate, of_tension = (
            distance / (divisor if last_factor == math.inf else factor ** min(order, highest) - 1.0)
            for distance, order in zip(distances, orders, strict=True)
        )
        runs.note_tension(fine, of_tension)
        if estimate <= limit and of_tension <= limit:
            return runs.finish(fine), rate, estimate
        needed, of_waves = (
            (aim * distance / (factor**order - 1.0) / tolerance) ** (1.0 / order)
            for distance, order in zip(distances, (orders[0], max(orders[1], MIN_ORDER)), strict=True)
        )
        only_tension = estimate <= limit
        slow = slow + 1 if orders[0] < MIN_ORDER and not only_tension else 0
        # once may be a wave that the steps only begin to resolve
        if slow == 2 or (rate * of_waves > of_tension_rate if only_tension else rate >= (1.0 - 1e-9) * max_rate):
            break
        of_waves = min(of_waves, of_tension_rate / rate)
        coarse, last, last_factor = fine, distances, factor
        least = MIN_FACTOR if runs.first_order >= runs.order else MIN_FACTOR_UNRESOLVED
        factor = min(MAX_FACTOR, max_rate / rate, max(least, needed, of_waves))
    assert not callable(tolerance)
    _warn_not_converged(estimate, of_tension, limit, tolerance, rate)
    return runs.finish(fine), rate, estimate


def _order(distance: float, last: float, last_factor: float, factor: float, highest: float) -> float:
    """Return the observed order of distances of successive runs; the highest one where nothing differed before."""
    return observed_order(distance / last, last_factor, factor, highest) if last > 0.0 else highest


def _warn_not_converged(estimate: float, of_tension: float, limit: float, tolerance: float, rate: float) -> None:
    """Warn of motion, or of tension alone, that has not converged within the tolerance."""
    if estimate <= limit:
        warnings.warn(
            f"tension not converged in time: an error of {of_tension:.3g} of its range is left at step {1 / rate:.3g} s, and of "
            f"{estimate:.2g} of the motion, more than the tolerance {tolerance:.2g}; axial waves or snaps are not resolved; give "
            "a ramp to motions that start with a jump, a shorter step, or a larger tolerance",
            NotConvergedWarning,
            stacklevel=user_stacklevel(),
        )
        return
    warnings.warn(
        f"not converged in time: an error of {estimate:.3g} of the motion is left at step {1 / rate:.3g} s, more than the "
        f"tolerance {tolerance:.2g}; the motion is chaotic (judge it by statistics) or too abrupt for this scheme; give a "
        "shorter step, or a larger tolerance",
        NotConvergedWarning,
        stacklevel=user_stacklevel(),
    )


def _first_finite_run(runs: ComparableRuns) -> Search[tuple[Any, float]]:
    """Run with the first step, or a half or a quarter of it if that breaks down."""
    steps_per_second = runs.steps_per_second
    for _ in range(2):
        try:
            return (yield Wanted(runs.run, steps_per_second)), steps_per_second
        except RunStopped:
            steps_per_second *= 2.0
    return (yield Wanted(runs.run, steps_per_second)), steps_per_second


def observed_order(ratio: float, factor: float, next_factor: float, highest: float = SECOND_ORDER) -> float:
    """Return the order p, from 0.1 to `highest`, that explains the ratio of successive distances of runs.

    With errors C h^p the distances of a run to the next, whose steps are `factor` and then `next_factor` times shorter, have the
    ratio factor^-p (1 - next_factor^-p) / (1 - factor^-p).
    """

    def expected(p: float) -> float:
        return factor**-p * (1.0 - next_factor**-p) / (1.0 - factor**-p)

    low, high = 0.1, highest
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if expected(middle) > ratio else (low, middle)
    return 0.5 * (low + high)
