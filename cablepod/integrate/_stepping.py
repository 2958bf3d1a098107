"""What all time steppers share: instants, steps of preferred size, dense output, and the check by a second step."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import OUTPUTS
from cablepod.parameters._schema import SceneError, number, refuse

#: Steps between two looks at the state: few enough to stop early, many enough to cost nothing.
BLOCK = 65536
#: Time error that a run without scheme, step or tolerance keeps, as a fraction of the motion.
DEFAULT_TOLERANCE = 1e-6
#: A scheme that twice shows less than this order is not converging: runs that differ whatever their steps seem to have 0.1 to
#: 0.7.  One that converges may take so many runs after the first, each at most so many times finer than the last.
LEAST_ORDER, FIRST_ORDER, SECOND_ORDER, MOST_REFINEMENTS, LARGEST_FACTOR = 0.8, 1.0, 2.0, 6, 4.0
#: A run with more than so many times the steps of the first is not begun: the user would wait long for a motion that is hardly
#: resolved.
MOST_GROWTH = 512.0
#: A run whose step is not given begins with at most so many steps times links, half an hour (chain) to some hours; one that only
#: looks whether long implicit steps will do has at most so many, a minute or two.  A given step runs however long it takes.
MOST_WORK, MOST_TRIED = 1e12, 1e9
#: Steps are counted in doubles.
MOST_STEPS = 2.0**53
#: No run that chooses its step has fewer steps in the shortest time over which motions and loads change.  Steps that are
#: multiples of a period all see the same phase: two runs would agree, and both be wrong.
STEPS_PER_CHANGE = 8.0
#: A given step longer than this part of that time is warned of.
LONGEST_PART = 0.25
#: Two implicit runs must agree by so much better than the tolerance: their steps need not resolve all that moves.
CAUTION = 4.0
#: Damping times an explicit step, at most: velocities half a step before the start, exp(c h / 2) times larger, and their squares
#: stay finite.
MOST_DAMPED = 600.0
# Steps per second are rounded up to one of these times a power of ten: a step then hits round instants, and neither it nor
# any bit of the result depends on the instants asked for.
_PREFERRED = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0, 10.0)


class RunStopped(RuntimeError):  # it names what happened; the run may have been asked to end there
    """A run left the finite numbers; `partial` is the Dataset computed until then, marked incomplete."""

    def __init__(self, message: str, partial: xr.Dataset | None = None) -> None:
        super().__init__(message)
        self.partial = partial


class NotConvergedWarning(UserWarning):
    """Two steps disagree by more than the tolerance: the motion is chaotic or needs a shorter step."""


def check_times(times: Any) -> np.ndarray:
    """Check instants that a caller gives: finite, from 0 on, rising; returns them as floats [s]."""
    try:
        result = np.atleast_1d(np.asarray(times, dtype=float))
    except (TypeError, ValueError):
        raise refuse("times", times, "finite, rising instants from 0 on [s]") from None
    if (
        result.ndim != 1
        or result.size == 0
        or not np.isfinite(result).all()
        or result[0] < 0
        or (np.diff(result) <= 0).any()
    ):
        raise refuse("times", times, "finite, rising instants from 0 on [s]")
    return result


def check_outputs(outputs: Any, allowed: tuple[str, ...] = OUTPUTS) -> tuple[str, ...]:
    """Check the names of the outputs."""
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    for name in names:
        if name not in allowed:
            raise refuse("outputs", name, "some of " + ", ".join(allowed))
    return names


def check_positive(key: str, value: Any) -> float:
    """Check an option that must be a finite positive number."""
    return number(above=0.0)(key, value)


def damped_growth(damping: float, step: float) -> float:
    """Return exp(c h / 2) - 1, by which a velocity grows that is followed back over half a step against damping c [1/s]."""
    if damping * step > MOST_DAMPED:
        raise SceneError(
            f"damping.mass_proportional: given {damping:g}; allowed: at most {MOST_DAMPED / step:.4g} 1/s with explicit steps of "
            f"{step:.4g} s; an implicit scheme, or a shorter step, takes more"
        )
    return math.expm1(0.5 * damping * step)


def preferred_rate(rate: float) -> float:
    """Round a number of steps per second up to the next preferred one."""
    power = 10.0 ** math.floor(math.log10(rate))
    return next(p for p in _PREFERRED if p * power >= rate * (1.0 - 1e-12)) * power


@dataclass(frozen=True)
class Instants:
    """Which steps to save for the instants asked for, and how to get from the former to the latter."""

    times: np.ndarray  #: (times,) [s]
    rate: float  #: steps per second
    steps: np.ndarray  #: numbers of the steps to save, rising
    left: np.ndarray  #: for each instant the index in `steps` of the step at or before it
    fraction: np.ndarray  #: how far it lies beyond, in steps; 0 where it is a step

    @classmethod
    def of(cls, times: np.ndarray, rate: float) -> Instants:
        """Place `times` [s] on the grid of `rate` steps per second."""
        place = times * rate
        if not place[-1] <= MOST_STEPS:
            raise refuse("step", 1.0 / rate, f"at least {times[-1] / MOST_STEPS:.3g} s, for {times[-1]:g} s of time")
        nearest = np.rint(place)
        on = np.abs(place - nearest) <= 1e-9 * np.maximum(1.0, 1e-3 * nearest)
        if on.all():  # the common case, in a third of the time
            steps = nearest.astype(np.int64)
            if (steps[1:] > steps[:-1]).all():
                return cls(times, rate, steps, np.arange(steps.size), np.zeros(steps.size))
        floor = np.where(on, nearest, np.floor(place)).astype(np.int64)
        fraction = np.where(on, 0.0, place - floor)
        steps = np.unique(np.concatenate([floor, floor[~on] + 1]))
        return cls(times, rate, steps, np.searchsorted(steps, floor), fraction)

    @property
    def dense(self) -> bool:
        """Whether any instant lies between two steps."""
        return bool((self.fraction > 0).any())

    def at_times(self, x: np.ndarray, v: np.ndarray | None, a: np.ndarray | None) -> np.ndarray:
        """Values at the instants from those at the saved steps, by the quintic with values, rates, second rates."""
        result = x[self.left]
        between = np.flatnonzero(self.fraction)
        if between.size == 0:
            return result
        if v is None or a is None:
            raise ValueError("dense output needs rates")
        i = self.left[between]
        s = self.fraction[between].reshape(-1, *[1] * (x.ndim - 1))
        h = 1.0 / self.rate
        b = [
            1 - 10 * s**3 + 15 * s**4 - 6 * s**5,
            h * (s - 6 * s**3 + 8 * s**4 - 3 * s**5),
            h * h * (s**2 - 3 * s**3 + 3 * s**4 - s**5) / 2,
            10 * s**3 - 15 * s**4 + 6 * s**5,
            h * (-4 * s**3 + 7 * s**4 - 3 * s**5),
            h * h * (s**3 - 2 * s**4 + s**5) / 2,
        ]
        values = (x[i], v[i], a[i], x[i + 1], v[i + 1], a[i + 1])
        result[between] = sum(weight * value for weight, value in zip(b, values, strict=True))
        return result


def march(
    advance: Callable[[int, int], bool],
    state: tuple[np.ndarray, ...],
    total: int,
    progress: Callable[[float], None] | None,
) -> int | None:
    """Advance a state by `total` steps in blocks, looking at it between them.

    Parameters
    ----------
    advance
        Takes the number of the first step and how many, changes `state`, tells whether it is still sound.
    state
        All arrays that a step changes.
    total
        Number of steps.
    progress
        Called with the part that is done.

    Returns
    -------
    int or None
        The step that left the finite numbers, None where none did.
    """
    done = 0
    while done < total:
        steps = min(BLOCK, total - done)
        keep = [array.copy() for array in state]
        if not advance(done, steps):
            for target, source in zip(state, keep, strict=True):
                target[:] = source
            end = done + steps
            while done < end and advance(done, 1):  # once more, step by step, to say when
                done += 1
            if done < end:
                return done
            # iterations that begin anew at each step may succeed where those of the block did not
        else:
            done += steps
        if progress is not None:
            progress(done / total)
    return None


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
    if rate * until * links > MOST_WORK:
        raise SceneError(
            f"time.duration: given {until:g} s, which {links} links take {rate * until:.3g} steps of {1.0 / rate:.3g} s for; "
            f"allowed: {MOST_WORK:g} steps times links where no step is given; take a shorter duration or times, fewer links, "
            f"another scheme, or step={1.0 / rate:.3g}, which is run however long it takes"
        )


def refine(
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
    coarse, rate = _first_sound_run(run, rate)
    most = min(MOST_GROWTH * rate, _most_rate(MOST_WORK, size))
    factor, last, last_factor, slow = 2.0, math.inf, math.inf, 0
    for _ in range(MOST_REFINEMENTS):
        # the first doubling is exact, so that its runs share their instants; later rates are preferred ones again
        new = 2.0 * rate if last == math.inf else preferred_rate(rate * factor)
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
        slow = slow + 1 if order < LEAST_ORDER else 0
        if slow == 2 or rate >= (1.0 - 1e-9) * most:  # once may be a wave that the steps only begin to resolve
            break
        coarse, last, last_factor = fine, distance, factor
        expected = distance / (factor**order - 1.0)
        factor = min(LARGEST_FACTOR, most / rate, max(1.25, (4.0 * expected / tolerance) ** (1.0 / order)))
    warnings.warn(
        f"two steps disagree: an error of {estimate:.2g} of the motion is left at step {1 / rate:.3g} s, more than the tolerance "
        f"{tolerance:.2g}; the motion is chaotic (judge it by statistics) or too abrupt for this scheme; give a shorter "
        "step, or a larger tolerance",
        NotConvergedWarning,
        stacklevel=4,
    )
    return fine, rate, estimate


def halve(
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
    coarse, most_rate = None, min(most_rate, _most_rate(MOST_TRIED, size))
    while rate <= most_rate:
        try:
            fine = run(rate)
        except RunStopped:
            fine = None
        if fine is not None and coarse is not None:
            distance = _distance(position(fine), position(coarse)) / scale(fine)
            if distance <= tolerance / CAUTION:
                return fine, rate, distance
        coarse, rate = fine, 2.0 * rate
    return None


def _most_rate(work: float, size: tuple[float, int]) -> float:
    """Return the most steps per second that a run of some size may have for so many steps times links."""
    until, links = size
    return work / max(until * links, 1e-300)


def _first_sound_run(run: Callable[[float], Any], rate: float) -> tuple[Any, float]:
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


def check_scheme(scheme: str | None, allowed: tuple[str, ...]) -> str:
    """Check the name of a scheme; None means the first of those allowed."""
    if scheme is None:
        return allowed[0]
    if scheme not in allowed:
        raise refuse("scheme", scheme, "one of " + ", ".join(f'"{name}"' for name in allowed))
    return scheme


def implicit_rate(step: Any, until: float, time_scale: float) -> float:
    """Return the steps per second of an implicit run to a time [s], whose step a caller gives; see :func:`check_resolved`."""
    value = number(above=0.0, most=until or math.inf)("step", step)
    check_resolved(value, time_scale, stacklevel=5)
    return 1.0 / value


def check_resolved(step: float, time_scale: float, *, stacklevel: int = 4) -> None:
    """Warn where a given step [s] does not resolve motions and loads that change within `time_scale` [s].

    Warns
    -----
    NotConvergedWarning
        With both numbers; no limit of stability forbids such steps.
    """
    if step > LONGEST_PART * time_scale:
        warnings.warn(
            f"step: given {step:.6g} s, of which only {time_scale / step:.2g} fit into the shortest time over which motions and "
            f"loads change, {time_scale:.4g} s: they are not resolved, though the run is stable; give a step below "
            f"{LONGEST_PART * time_scale:.3g} s, or a tolerance instead",
            NotConvergedWarning,
            stacklevel=stacklevel,
        )


def check_step(step: Any, limit: float, what: str) -> float:
    """Check a step that a caller gives against the stability limit [s].

    Raises
    ------
    SceneError
        With both numbers.
    """
    value = check_positive("step", step)
    if value >= limit:
        raise SceneError(f"step: given {value:.6g} s; allowed: below the stability limit, {limit:.6g} s, {what}")
    return value
