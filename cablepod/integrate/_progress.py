"""Fraction of a call of several runs, of which each reports its own from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable


class Rising:
    """Callback of the runs of one call; passes on fractions that never fall and end at 1.

    How many runs follow is known of a given step only.  Otherwise each run takes half of what is left: the first one ends at 1/2,
    the second one at 3/4.
    """

    def __init__(self, progress: Callable[[float], None], *, several: bool) -> None:
        self.progress, self.several = progress, several
        self._last = self._begin = 0.0

    def __call__(self, fraction: float) -> None:
        """Report the completed fraction of the present run; one that is not above the last begins a new run."""
        if self.several:
            if fraction <= self._last:
                self._begin = 0.5 * (1.0 + self._begin)
            self._last = fraction
            fraction = self._begin + 0.5 * (1.0 - self._begin) * fraction
        self.progress(fraction)

    def end(self) -> None:
        """Report that the call is done."""
        if self.several:
            self.progress(1.0)
