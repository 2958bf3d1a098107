"""Step control by comparison of runs: refinement, halving, observed order."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from cablepod.errors import NotConvergedWarning, RunStopped, SceneError

#: A scheme that twice shows less than this order is not converging: runs that differ whatever their steps seem to have 0.1 to
#: 0.7.  One that converges may take so many runs after the first, each at most so many times finer than the last.
MIN_ORDER, FIRST_ORDER, SECOND_ORDER, MAX_REFINEMENTS, MAX_FACTOR = 0.8, 1.0, 2.0, 6, 4.0
#: A run with more than so many times the steps of the first is not begun: the user would wait long for a motion that is hardly
#: resolved.
MAX_GROWTH = 512.0
#: A run whose step is not given begins with at most so many steps times links, half an hour (chain) to some hours; one that only
#: looks whether long implicit steps will do has at most so many, a minute or two.  A given step runs however long it takes.
MAX_WORK, MAX_TRIAL_WORK = 1e12, 1e9
#: No run that chooses its step has fewer steps in the shortest time over which motions and loads change.  Steps that are
#: multiples of a period all see the same phase: two runs would agree, and both be wrong.
STEPS_PER_CHANGE = 8.0
#: Two implicit runs must agree by so much better than the tolerance: their steps need not resolve all that moves.
HALVING_MARGIN = 4.0
#: Damping times an explicit step, at most: velocities half a step before the start, exp(c h / 2) times larger, and their squares
#: stay finite.
MAX_DAMPING_EXPONENT = 600.0
# Steps per second are rounded up to one of these times a power of ten: a step then hits round instants, and neither it nor
# any bit of the result depends on the instants asked for.
_PREFERRED_MANTISSAS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0, 10.0)


def damped_growth(damping: float, step: float) -> float:
    """Return exp(c h / 2) - 1, by which a velocity grows that is followed back over half a step against damping c [1/s]."""
    if damping * step > MAX_DAMPING_EXPONENT:
        raise SceneError(
            f"damping.mass_proportional: given {damping:g}; allowed: at most {MAX_DAMPING_EXPONENT / step:.4g} 1/s with explicit steps of "
            f"{step:.4g} s; an implicit scheme, or a shorter step, takes more"
        )
    return math.expm1(0.5 * damping * step)


def preferred_steps_per_second(rate: float) -> float:
    """Round a number of steps per second up to the next preferred one."""
    power = 10.0 ** math.floor(math.log10(rate))
    return next(p for p in _PREFERRED_MANTISSAS if p * power >= rate * (1.0 - 1e-12)) * power


def motion_scale(position: np.ndarray, initial: np.ndarray, chord: float) -> float:
    """Largest rms displacement from the initial shape, or the chord where nothing moves: what errors are divided by [m]."""
    largest = float(np.sqrt(np.mean(np.sum((position - initial) ** 2, axis=-1), axis=-1)).max(initial=0.0))
    return largest if largest > 1e-9 * chord else chord


def check_work(rate: float, until: float, links: int) -> None:
    """Refuse a run that nobody means, with so many steps per second until a time [s], where no step is given.

    Raises
    ------
    SceneError
        With the number of steps, and what to do about it.
    """
    if rate * until * links > MAX_WORK:
        raise SceneError(
            f"time.duration: given {until:g} s, which {links} links take {rate * until:.3g} steps of {1.0 / rate:.3g} s for; "
            f"allowed: {MAX_WORK:g} steps times links where no step is given; take a shorter duration or times, fewer links, "
            f"another scheme, or step={1.0 / rate:.3g}, which is run however long it takes"
        )


def refine_step(
    run: Callable[[float], Any],
    position: Callable[[Any], np.ndarray],
    scale: Callable[[Any], float],
    rate: float,
    tolerance: float,
    kinked: Callable[[Any], bool] = lambda run: False,
    size: tuple[float, int] = (0.0, 0),
) -> tuple[Any, float, float]:
    """Run with rising numbers of steps per second until two runs agree within `tolerance`.

    Two runs alone tell the time error of the finer one only if the order is known, and a scheme of second order has it only for
    motion that its steps resolve (a jump in the velocity of an end makes waves that they do not).  So the distance of the first
    two runs counts as it is, and from the third run on the order that the distances show.

    Parameters
    ----------
    run
        Makes a run from a number of steps per second; may raise :class:`RunStopped`.
    position, scale
        Take the positions (time, particle, dims) from a run, and the length that counts as its motion [m].
    rate
        First number of steps per second.
    tolerance
        Wanted error as a fraction of the motion.
    kinked
        Tells of a run whether its forces had kinks, as where links slacken and snap taut.  Then each kink adds an error that
        depends on where in a step it falls: distances fall by luck as well as by order, and no more than first order is believed.
    size
        Until when a run lasts [s], and its number of links: the first run must not be longer than :func:`check_work` allows, and
        no later one is, but for one that is twice the first.

    Returns
    -------
    tuple
        The finest run, its steps per second, the estimate of its error.

    Raises
    ------
    SceneError
        For a run that would be absurdly long.

    Warns
    -----
    NotConvergedWarning
        Where shorter steps do not bring the runs together, or only too slowly.
    """
    check_work(rate, *size)
    coarse, rate = _first_finite_run(run, rate)
    most = min(MAX_GROWTH * rate, _max_steps_per_second(MAX_WORK, size))
    factor, last, last_factor, slow = 2.0, math.inf, math.inf, 0
    for _ in range(MAX_REFINEMENTS):
        # the first doubling is exact, so that its runs share their instants; later rates are preferred ones again
        new = 2.0 * rate if last == math.inf else preferred_steps_per_second(rate * factor)
        factor, rate = new / rate, new
        fine = run(rate)
        distance = _distance(position(fine), position(coarse)) / scale(fine)
        most_order = FIRST_ORDER if kinked(fine) else SECOND_ORDER
        margin = 0.5 if rate < most else 1.0  # while there is a choice
        if last == math.inf:
            order = most_order
            # the order is not known to be the second yet, so nothing is gained from it
            estimate, accepted = distance, distance <= (tolerance if order > FIRST_ORDER else margin * tolerance)
        else:
            order = min(most_order, observed_order(distance / last, last_factor, factor))
            estimate = distance / (factor**order - 1.0)
            accepted = estimate <= margin * tolerance
        if accepted:
            return fine, rate, estimate
        slow = slow + 1 if order < MIN_ORDER else 0
        if slow == 2 or rate >= (1.0 - 1e-9) * most:  # once may be a wave that the steps only begin to resolve
            break
        coarse, last, last_factor = fine, distance, factor
        expected = distance / (factor**order - 1.0)
        factor = min(MAX_FACTOR, most / rate, max(1.25, (4.0 * expected / tolerance) ** (1.0 / order)))
    warnings.warn(
        f"two steps disagree: an error of {estimate:.2g} of the motion is left at step {1 / rate:.3g} s, more than the tolerance "
        f"{tolerance:.2g}; the motion is chaotic (judge it by statistics) or too abrupt for this scheme; give a shorter "
        "step, or a larger tolerance",
        NotConvergedWarning,
        stacklevel=4,
    )
    return fine, rate, estimate


def halve_step_while_cheaper(
    run: Callable[[float], Any],
    position: Callable[[Any], np.ndarray],
    scale: Callable[[Any], float],
    rate: float,
    tolerance: float,
    most_rate: float,
    size: tuple[float, int] = (0.0, 0),
) -> tuple[Any, float, float] | None:
    """Run with halved steps, as long as they are so long that they pay, until two runs agree well within `tolerance`.

    Long implicit steps do not resolve all that moves, and so show no order: the distance of two runs counts as it is, and must
    be smaller than the tolerance by a margin.  Parameters as in :func:`refine`; no run with more than `most_rate` steps per
    second is begun, nor one with more than :data:`MOST_TRIED` steps times links.

    Returns
    -------
    tuple or None
        The finer of the two runs, its steps per second, their distance; None where none met the tolerance.
    """
    coarse, most_rate = None, min(most_rate, _max_steps_per_second(MAX_TRIAL_WORK, size))
    while rate <= most_rate:
        try:
            fine = run(rate)
        except RunStopped:
            fine = None
        if fine is not None and coarse is not None:
            distance = _distance(position(fine), position(coarse)) / scale(fine)
            if distance <= tolerance / HALVING_MARGIN:
                return fine, rate, distance
        coarse, rate = fine, 2.0 * rate
    return None


def _max_steps_per_second(work: float, size: tuple[float, int]) -> float:
    """Return the most steps per second that a run of some size may have for so many steps times links."""
    until, links = size
    return work / max(until * links, 1e-300)


def _first_finite_run(run: Callable[[float], Any], rate: float) -> tuple[Any, float]:
    """Run with `rate`, or twice or four times as many steps where that breaks down."""
    for _ in range(2):
        try:
            return run(rate), rate
        except RunStopped:
            rate *= 2.0
    return run(rate), rate


def observed_order(ratio: float, factor: float, next_factor: float) -> float:
    """Order p between 0.1 and 2 that explains how the distance of two runs fell.

    With errors C h^p the distances of a run to the next, whose steps are `factor` and then `next_factor` times shorter, have the
    ratio factor^-p (1 - next_factor^-p) / (1 - factor^-p).
    """

    def expected(p: float) -> float:
        return factor**-p * (1.0 - next_factor**-p) / (1.0 - factor**-p)

    low, high = 0.1, SECOND_ORDER
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if expected(middle) > ratio else (low, middle)
    return 0.5 * (low + high)


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=-1), axis=-1)).max())
