"""Tension extremes over a part of a run."""

from __future__ import annotations

import math

import numpy as np

from cablepod.errors import scene_error

#: Relative rounding error of an instant that lies on a step.
ROUNDING = 1e-12


def steps_within(window: tuple[float, float], steps_per_second: float) -> tuple[int, int]:
    """Return the numbers of the first and the last step within a window [s].

    Raises
    ------
    SceneError
        If less than two steps lie within it.
    """
    first = math.ceil(window[0] * steps_per_second * (1.0 - ROUNDING))
    last = math.floor(window[1] * steps_per_second * (1.0 + ROUNDING))
    if last <= first:
        step = 1.0 / steps_per_second
        raise scene_error("window", window, f"one that is longer than two steps of the run, each of {step:.6g} s")
    return first, last


def within(times: np.ndarray, window: tuple[float, float] | None) -> np.ndarray:
    """Tell which instants [s] lie within a window, whose ends count whatever their rounding."""
    first, last = (0.0, math.inf) if window is None else window
    return (times >= first * (1.0 - ROUNDING)) & (times <= last * (1.0 + ROUNDING))


def window_attributes(window: tuple[float, float] | None) -> dict[str, float]:
    """Return the attributes of a result about its window [s], none without."""
    return {} if window is None else {"window_start": window[0], "window_end": window[1]}


class ExtremesWindow:
    """Lets kernels, which update extremes at each step, do so within a window only: blocks of steps end at its borders.

    Parameters
    ----------
    window
        Start and end [s].
    steps_per_second
        Inverse of the step [1/s].
    low, high
        Arrays that the kernels update; changed.
    with_end
        Whether a block updates the extremes by the state after its last step too.
    """

    def __init__(
        self,
        window: tuple[float, float],
        steps_per_second: float,
        low: np.ndarray,
        high: np.ndarray,
        *,
        with_end: bool = False,
    ) -> None:
        self.first, last = steps_within(window, steps_per_second)
        self.close = last if with_end else last + 1
        self.low, self.high = low, high
        self._kept: tuple[np.ndarray, np.ndarray] | None = None

    def limit(self, done: int, steps: int) -> int:
        """Return how many of `steps` steps after the first `done` ones a block may take."""
        return min([steps, *(border - done for border in (self.first, self.close) if border > done)])

    def reach(self, done: int) -> None:
        """Forget the extremes before the window after `done` steps, or keep those within it."""
        if done == self.close:
            self._kept = self.low.copy(), self.high.copy()
        elif done == self.first:
            self.low[:], self.high[:] = np.inf, -np.inf

    @property
    def is_closed(self) -> bool:
        """Whether the window has ended."""
        return self._kept is not None

    def finish(self, extremes: tuple[np.ndarray, np.ndarray] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the extremes within the window; `extremes` are those at the end of the run, by default the arrays."""
        if self._kept is None:
            return (self.low, self.high) if extremes is None else extremes
        self.low[:], self.high[:] = self._kept
        return self._kept
