"""What two runs tell: the error of the finer one, whether it is accepted, and the steps per second of the next run.

Run i has f_i times as many steps as run i - 1, and d_i is their distance.  Where the error of a run falls with the step h as h^p,
that of run i is e_i = d_i / (f_i^p - 1) (Richardson 1911), and the order p follows from two distances, :func:`observed_order`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from cablepod.integrate._comparison import FIRST_ORDER, SECOND_ORDER, ComparableRuns
from cablepod.integrate._output_times import preferred_steps_per_second

#: Minimum observed order of a converging scheme: runs that differ whatever their steps seem to have 0.1 to 0.7.
MIN_ORDER = 0.8
#: Maximum number of refinements after the first run, and maximum factor of the number of steps in one of them.
MAX_REFINEMENTS, MAX_FACTOR = 6, 4.0
#: Minimum factor of the number of steps; the same after a first run whose steps may be too long to show the order of the scheme.
MIN_FACTOR, MIN_FACTOR_UNRESOLVED = 1.25, 1.5
#: Accepted error over the tolerance while finer runs are possible.
SAFETY = 0.5
#: Tolerance over the expected error of the next refinement; the same, and margin of the first estimate, of economical rules.
REFINEMENT_MARGIN, ECONOMICAL_MARGIN, FIRST_MARGIN = 4.0, 1.5, 1.5
#: Maximum number of steps of a run over that of the first (more steps would take long for a motion that is hardly resolved), but
#: for runs of MAX_TENSION_WORK or less.
MAX_GROWTH = 512.0
#: Maximum steps times links of a run without a given step (half an hour to some hours).  A run with a given step has no such
#: bound.
MAX_WORK = 1e12
#: Maximum number of steps of a run over that of the first, and maximum steps times links (0.2 s) where that is more, if
#: the motion has converged and the tension alone has not: axial waves may need many more, as after a jump of the speed of an end.
MAX_TENSION_GROWTH, MAX_TENSION_WORK = 32.0, 1e8


@dataclass(frozen=True)
class Rules:
    """What a refinement has to reach, and what its runs may cost."""

    runs: ComparableRuns
    first: float  #: steps per second of the first run
    tolerance: float  #: of the error, as a fraction of the motion, and of the range of the tensions
    economical: bool  #: whether steps are hardly shorter than needed: then the first two runs are taken at their order

    @property
    def max_rate(self) -> float:
        """Maximum steps per second."""
        most = self.runs.max_steps_per_second
        return min(max(MAX_GROWTH * self.first, most(MAX_TENSION_WORK)), most(MAX_WORK))

    @property
    def max_tension_rate(self) -> float:
        """Maximum steps per second where the tension alone has not converged."""
        quick = self.runs.max_steps_per_second(MAX_TENSION_WORK)
        return min(self.max_rate, max(MAX_TENSION_GROWTH * self.first, quick))


class Compared(NamedTuple):
    """Comparison of a run with the one before."""

    steps_per_second: float
    factor: float  #: steps per second over those of the run before
    motion: float  #: distance of the motions
    tension: float  #: distance of the tensions
    has_kinks: bool  #: whether the forces have kinks


class Verdict(NamedTuple):
    """What a comparison tells."""

    compared: Compared
    order: float  #: of the motion
    error: float  #: of the motion
    tension_error: float
    limit: float  #: up to which errors are accepted
    wanted: float | None = None  #: steps per second of the next run; None at the end

    @property
    def motion_is_accepted(self) -> bool:
        """Whether the motion is accepted."""
        return self.error <= self.limit

    @property
    def is_accepted(self) -> bool:
        """Whether motion and tension are accepted."""
        return self.motion_is_accepted and self.tension_error <= self.limit

    @property
    def is_slow(self) -> bool:
        """Whether the motion hardly converges."""
        return self.order < MIN_ORDER and not self.motion_is_accepted


def judge(rules: Rules, now: Compared, history: Sequence[Verdict]) -> Verdict:
    """Judge a comparison, given the verdicts on those before.

    From the second comparison on errors follow from observed orders.  Of the first one the distance itself counts, or with
    economical rules the error by the assumed order.  The search ends with an accepted run, with the second slow one in a
    row, with the last of MAX_REFINEMENTS, and where the next run would cost too much.
    """
    runs, distances = rules.runs, (now.motion, now.tension)
    highest = FIRST_ORDER if now.has_kinks else runs.order
    limit = rules.tolerance if rules.economical or now.steps_per_second >= rules.max_rate else SAFETY * rules.tolerance
    if history:
        last = history[-1].compared
        before = last.motion, last.tension
        orders = [_order(d, e, last.factor, now.factor, highest) for d, e in zip(distances, before, strict=True)]
        # vibrations that are not resolved differ as much at the next step, while the order is seen at the others
        counted = FIRST_ORDER if now.steps_per_second < now.factor * runs.resolved else runs.order
        errors = [d / (now.factor ** min(p, counted) - 1.0) for d, p in zip(distances, orders, strict=True)]
    else:
        order = min(highest, runs.first_order)
        orders = [order, order]
        # the order is not observed yet, so the estimate does not use it, or with a margin
        errors = [economical_error(d, now.factor, order) if rules.economical else d for d in distances]
        limit = rules.tolerance if order > FIRST_ORDER else limit
    verdict = Verdict(now, orders[0], errors[0], errors[1], limit)
    # slow once may be a wave that the steps only begin to resolve
    is_hopeless = verdict.is_slow and bool(history) and history[-1].is_slow
    is_last = verdict.is_accepted or is_hopeless or len(history) + 1 == MAX_REFINEMENTS
    wanted = None if is_last else _next(rules, verdict, orders)
    return verdict._replace(wanted=wanted, limit=rules.tolerance if wanted is None else limit)


def economical_error(distance: Any, factor: float, order: float) -> Any:
    """Return the estimated error of the finer of two runs, with a margin as their order is assumed and not observed."""
    return distance / ((factor**order - 1.0) / FIRST_MARGIN)


def _next(rules: Rules, verdict: Verdict, orders: Sequence[float]) -> float | None:
    """Return the steps per second that are expected to reach the tolerance with a margin; None if they would be too many."""
    now, aim = verdict.compared, ECONOMICAL_MARGIN if rules.economical else REFINEMENT_MARGIN
    needed, of_tension = (
        (aim * distance / (now.factor**order - 1.0) / rules.tolerance) ** (1.0 / order)
        for distance, order in ((now.motion, orders[0]), (now.tension, max(orders[1], MIN_ORDER)))
    )
    rate = now.steps_per_second
    if (
        rate * of_tension > rules.max_tension_rate
        if verdict.motion_is_accepted
        else rate >= (1.0 - 1e-9) * rules.max_rate
    ):
        return None
    least = MIN_FACTOR if rules.runs.first_order >= rules.runs.order else MIN_FACTOR_UNRESOLVED
    needed = max(least, needed, min(of_tension, rules.max_tension_rate / rate))
    return preferred_steps_per_second(rate * min(MAX_FACTOR, rules.max_rate / rate, needed))


def _order(distance: float, last: float, last_factor: float, factor: float, highest: float) -> float:
    """Return the observed order of distances of successive runs; the highest one where nothing differed before."""
    return observed_order(distance / last, last_factor, factor, highest) if last > 0.0 else highest


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
