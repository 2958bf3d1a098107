"""Steps at which the largest and the smallest tension of a run occur."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cablepod.integrate._window import ExtremesWindow

#: Run time of a step for each link and of a call of a kernel [s], which decide on the length of blocks.
LINK_STEP, CALL = 3e-9, 4e-5
#: Minimum number of steps of a block.
MIN_BLOCK = 64
State = list[np.ndarray]
#: Times of the smallest and the largest tension [s]; None if they are not requested.
PeakTimes = tuple[float, float] | None


class PeakSearch:
    """Finds the steps of both extremes without a trace in the kernels, which update low and high of each link only.

    After each block of steps the extremes tell whether a new peak lies in it; the state before such a block is kept.  At the end
    the two blocks with the peaks are halved, down to one step, which costs about two blocks each.

    Parameters
    ----------
    low, high
        Arrays that the kernels update; changed.
    total
        Number of steps of the run.
    with_end
        Whether a block updates the extremes by the state after its last step too.
    chosen
        Indices of the links that count; None for all.
    """

    def __init__(
        self,
        low: np.ndarray,
        high: np.ndarray,
        total: int,
        *,
        with_end: bool = False,
        chosen: np.ndarray | None = None,
    ) -> None:
        self.extremes, self.with_end = (low, high), with_end
        self._chosen = slice(None) if chosen is None else chosen
        parts = max(math.sqrt(2.0 * total * (low.size + 10) * LINK_STEP / CALL), 1.0)
        self.block = max(math.ceil(total / parts), MIN_BLOCK)
        self._best = [-np.inf, -np.inf]
        self._found: list[tuple[int, int, State] | None] = [None, None]
        self.steps = [0, 0]  #: numbers of the steps of the smallest and the largest tension

    def _peaks(self) -> list[float]:
        """Return minus the smallest and the largest value of all links."""
        low, high = self.extremes
        return [-float(low[self._chosen].min()), float(high[self._chosen].max())]

    def forget(self) -> None:
        """Forget all peaks so far."""
        self._best, self._found = [-np.inf, -np.inf], [None, None]

    def note(self, begin: int, steps: int, before: State) -> None:
        """Keep the state before a block of steps from number `begin` on, if it holds a new peak."""
        for i, peak in enumerate(self._peaks()):
            if peak > self._best[i]:
                self._best[i], self._found[i] = peak, (begin, steps, before)

    def note_last(self, total: int, extremes: tuple[np.ndarray, np.ndarray]) -> None:
        """Take account of extremes that include the state after the last step, if they hold a new peak."""
        for i, peak in enumerate((-float(extremes[0].min()), float(extremes[1].max()))):
            if peak > self._best[i]:
                self._best[i], self._found[i], self.steps[i] = peak, None, total

    def locate(self, advance: Callable[[int, int], object], state: tuple[np.ndarray, ...]) -> None:
        """Find both steps by repetitions of parts; `state`, all arrays that `advance` changes, is put back."""
        arrays = (*state, *self.extremes)
        final = [array.copy() for array in arrays]
        for i, found in enumerate(self._found):
            if found is not None:
                self.steps[i] = self._halve(advance, state, i, *found)
        restore(arrays, final)

    def _halve(
        self,
        advance: Callable[[int, int], object],
        state: tuple[np.ndarray, ...],
        i: int,
        begin: int,
        steps: int,
        before: State,
    ) -> int:
        """Return the step of peak number `i` within a block."""

        def peak(start: int, count: int) -> float:
            self.extremes[0][:], self.extremes[1][:] = np.inf, -np.inf
            advance(start, count)
            return self._peaks()[i]

        while steps > 1:
            half = steps // 2
            restore(state, before)
            first, middle = peak(begin, half), [array.copy() for array in state]
            # an explicit scheme repeats the bits, and one half is enough
            if first >= self._best[i] or first >= peak(begin + half, steps - half):
                steps = half
            else:
                begin, steps, before = begin + half, steps - half, middle
        if not self.with_end:
            return begin
        restore(state, before)
        largest = peak(begin, 1)
        restore(state, before)
        return begin if peak(begin, 0) >= largest else begin + 1


class Watch:
    """What a run does with its extremes between blocks of steps: a window, a search of the peaks, both or none."""

    def __init__(self, window: ExtremesWindow | None = None, peaks: PeakSearch | None = None) -> None:
        self.window, self.peaks = window, peaks

    def limit(self, done: int, steps: int) -> int:
        """Return how many of `steps` steps after the first `done` ones a block may take."""
        if self.window is not None:
            steps = self.window.limit(done, steps)
        return steps if self.peaks is None else min(steps, self.peaks.block)

    def before(self, state: tuple[np.ndarray, ...]) -> State:
        """Return copies of a state where the search of the peaks needs them."""
        return [] if self.peaks is None else [array.copy() for array in state]

    def after(self, done: int, steps: int, before: State) -> None:
        """Take account of a block that ends after `done` steps."""
        if self.peaks is not None and (self.window is None or not self.window.is_closed):
            self.peaks.note(done - steps, steps, before)
        if self.window is not None:
            self.window.reach(done)
            if self.peaks is not None and done == self.window.first and not self.window.is_closed:
                self.peaks.forget()

    def finish(
        self, advance: Callable[[int, int], object], state: tuple[np.ndarray, ...], steps_per_second: float
    ) -> PeakTimes:
        """Find the peaks, leave the extremes of the window in the arrays, and return :meth:`peak_times`."""
        if self.window is not None:
            self.window.finish()
        if self.peaks is not None:
            self.peaks.locate(advance, state)
        return self.peak_times(steps_per_second)

    def peak_times(self, steps_per_second: float) -> PeakTimes:
        """Return the times of the smallest and the largest tension [s]; None if they are not requested."""
        if self.peaks is None:
            return None
        smallest, largest = self.peaks.steps
        return smallest / steps_per_second, largest / steps_per_second


def restore(state: tuple[np.ndarray, ...], before: State) -> None:
    """Set the arrays of a state back to copies made before."""
    for target, source in zip(state, before, strict=True):
        target[:] = source
