"""Output times on the steps of a run, and dense output between the steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cablepod.conventions import is_rising
from cablepod.errors import scene_error

#: Maximum number of steps: doubles count them exactly up to here.
MAX_STEPS = 2.0**53
#: Instants of a run at which runs are compared where the output times leave gaps.
JUDGED_INSTANTS = 64
# Mantissas to which steps per second are rounded up: a step then hits round instants, and no bit of the result depends on the
# output times.
_PREFERRED_MANTISSAS = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0, 10.0)


def preferred_steps_per_second(steps_per_second: float) -> float:
    """Round a number of steps per second up to the next preferred one."""
    power = 10.0 ** math.floor(math.log10(steps_per_second))
    return next(p for p in _PREFERRED_MANTISSAS if p * power >= steps_per_second * (1.0 - 1e-12)) * power


@dataclass(frozen=True)
class OutputTimes:
    """Steps to save for the output times, and the place of each output time between two of them."""

    times: np.ndarray  #: (times,) [s]
    steps_per_second: float  #: [1/s]
    steps: np.ndarray  #: numbers of the steps to save, rising
    left: np.ndarray  #: index in `steps` of the step at or before each output time (times,)
    fraction: np.ndarray  #: time after that step, in steps, from 0 to below 1 (times,)

    @classmethod
    def of(cls, times: np.ndarray, steps_per_second: float) -> OutputTimes:
        """Place `times` [s] on a grid of equal steps."""
        place = times * steps_per_second
        if not place[-1] <= MAX_STEPS:
            raise scene_error(
                "step", 1.0 / steps_per_second, f"at least {times[-1] / MAX_STEPS:.3g} s, for {times[-1]:g} s of time"
            )
        nearest = np.rint(place)
        distance = np.abs(place - nearest)
        if distance.max() <= 1e-9:  # the common case takes a third of the time
            steps = nearest.astype(np.int64)
            if is_rising(steps):
                return cls(times, steps_per_second, steps, np.arange(steps.size), np.zeros(steps.size))
        on_step = distance <= 1e-9 * np.maximum(1.0, 1e-3 * nearest)
        floor = np.where(on_step, nearest, np.floor(place)).astype(np.int64)
        fraction = np.where(on_step, 0.0, place - floor)
        steps = np.unique(np.concatenate([floor, floor[~on_step] + 1]))
        return cls(times, steps_per_second, steps, np.searchsorted(steps, floor), fraction)

    @cached_property
    def needs_interpolation(self) -> bool:
        """Whether any output time lies between two steps."""
        return bool((self.fraction > 0).any())

    def with_multiples(self, interval: int) -> OutputTimes:
        """Return the same output times with all multiples of a number of steps, up to the last step, among the steps to save."""
        steps = np.arange(int(self.steps[-1]) // interval + 1) * interval
        return self._saving(union(steps, self.steps) if (self.steps % interval).any() else steps)

    def with_steps(self, steps: np.ndarray) -> OutputTimes:
        """Return the same output times with other steps, none after the last one, among the steps to save."""
        return self._saving(union(steps, self.steps))

    def _saving(self, steps: np.ndarray) -> OutputTimes:
        """Return the same output times with `steps`, those to save now among them, as the steps to save."""
        left = np.searchsorted(steps, self.steps)[self.left]
        return OutputTimes(self.times, self.steps_per_second, steps, left, self.fraction)

    def only(self, times: np.ndarray) -> OutputTimes:
        """Return some of the output times [s], with the same steps to save."""
        rows = np.isin(self.times, times)
        return replace(self, times=self.times[rows], left=self.left[rows], fraction=self.fraction[rows])

    def before_step(self, done: int) -> OutputTimes | None:
        """Return the output times up to step `done` - 1, None if there are none.

        Steppers that save at the beginning of steps have saved all of these after `done` steps.
        """
        if done <= 0:
            return None
        end_time = (done - 1) / self.steps_per_second
        return self._first(int(np.searchsorted(self.times, end_time * (1.0 + 1e-12), side="right")))

    def before_time(self, time: float) -> OutputTimes | None:
        """Return the output times before `time` [s], None if there are none."""
        return self._first(int(np.searchsorted(self.times, time * (1.0 - 1e-12))))

    def _first(self, count: int) -> OutputTimes | None:
        """Return the first `count` output times, None if there are none."""
        return OutputTimes.of(self.times[:count], self.steps_per_second) if count else None

    def at_times(self, x: np.ndarray, v: np.ndarray | None, a: np.ndarray | None) -> np.ndarray:
        """Interpolate values from the saved steps to the output times, by quintic Hermite polynomials.

        `x`, `v`, `a` are values and their first and second time derivatives at the saved steps (steps, ...).
        """
        result = x[self.left]
        between = np.flatnonzero(self.fraction)
        if between.size == 0:
            return result
        if v is None or a is None:
            raise ValueError("dense output needs rates")
        i = self.left[between]
        s = self.fraction[between].reshape(-1, *[1] * (x.ndim - 1))
        h = 1.0 / self.steps_per_second
        weights = [
            1 - 10 * s**3 + 15 * s**4 - 6 * s**5,
            h * (s - 6 * s**3 + 8 * s**4 - 3 * s**5),
            h * h * (s**2 - 3 * s**3 + 3 * s**4 - s**5) / 2,
            10 * s**3 - 15 * s**4 + 6 * s**5,
            h * (-4 * s**3 + 7 * s**4 - 3 * s**5),
            h * h * (s**3 - 2 * s**4 + s**5) / 2,
        ]
        values = (x[i], v[i], a[i], x[i + 1], v[i + 1], a[i + 1])
        result[between] = sum(weight * value for weight, value in zip(weights, values, strict=True))
        return result

    def rates_at_times(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Interpolate velocities `v` from the saved steps to the output times, by cubic Hermite polynomials with slopes `a`."""
        result = v[self.left]
        between = np.flatnonzero(self.fraction)
        if between.size == 0:
            return result
        i = self.left[between]
        after = np.minimum(i + 1, len(v) - 1)
        s = self.fraction[between].reshape(-1, *[1] * (v.ndim - 1))
        result[between] = (
            (1 + 2 * s) * (1 - s) ** 2 * v[i]
            + s * (1 - s) ** 2 / self.steps_per_second * a[i]
            + s**2 * (3 - 2 * s) * v[after]
            - s**2 * (1 - s) / self.steps_per_second * a[after]
        )
        return result


def judged_instants(times: np.ndarray, steps_per_second: float) -> np.ndarray | None:
    """Return instants in the gaps of output times [s], at which two runs are compared too; None without such gaps.

    At a few instants two runs may agree by luck.  The instants are round multiples of the step, so that all runs step on them and
    nothing is interpolated, unless the first run has fewer steps than these are.
    """
    end_time = float(times[-1])
    gap = end_time / JUDGED_INSTANTS
    dense = times.size >= JUDGED_INSTANTS and times[0] <= gap and (times[1:] - times[:-1]).max() <= gap
    if dense or not end_time:
        return None
    unit = 100.0 / 10.0 ** math.floor(math.log10(steps_per_second))
    if end_time < JUDGED_INSTANTS * unit:
        unit = min(1.0 / steps_per_second, gap)
    own = np.unique(np.rint(np.arange(1, JUDGED_INSTANTS) * gap / unit)) * unit
    asked = np.concatenate([[0.0], times])
    right = np.searchsorted(asked, own)
    own = own[(right > 0) & (right < asked.size)]
    right = np.searchsorted(asked, own)
    own = own[np.minimum(own - asked[right - 1], asked[right] - own) > 0.5 * gap]
    return own if own.size else None


def union(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the rising numbers of two arrays, each once, ten times as fast as ``numpy.union1d`` joins a few hundred."""
    return distinct(np.sort(np.concatenate([first, second])))


def distinct(numbers: np.ndarray) -> np.ndarray:
    """Return each of some numbers that do not fall once."""
    return numbers[np.concatenate([[True], numbers[1:] > numbers[:-1]])] if numbers.size else numbers


def with_judged(times: np.ndarray, judged: np.ndarray | None) -> np.ndarray:
    """Return output times with further instants at which runs are compared [s], rising."""
    return times if judged is None else np.union1d(times, judged)
