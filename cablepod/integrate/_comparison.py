"""How two runs of a scene are compared: distances of motions and of tensions, over their sizes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Orders that are assumed where forces have kinks, and otherwise.
FIRST_ORDER, SECOND_ORDER = 1.0, 2.0
#: Range of the tensions of a chain at rest over their rounding error: that of thousands of steps adds up to ten times as much.
ROUNDING_OF_STEPS = 30.0


def motion_scale(position: np.ndarray, initial: np.ndarray, chord: float) -> float:
    """Return the largest rms displacement from the initial shape, or the chord if nothing moves: the divisor of errors [m]."""
    largest = float(np.sqrt(np.mean(np.sum((position - initial) ** 2, axis=-1), axis=-1)).max(initial=0.0))
    return float(motion_or_chord(largest, chord))


def motion_or_chord(largest: Any, chord: Any) -> Any:
    """Return the largest displacement, or the chord if nothing moves [m]; numbers or members."""
    return np.where(largest > 1e-9 * chord, largest, chord)


def tension_distance(fine: np.ndarray, coarse: np.ndarray, rounding: float = 0.0) -> float:
    """Return the largest rms difference of tensions (rows, links) [N] over the largest range of a link in `fine`.

    Differences up to `rounding` [N] do not count.
    """
    span = float((fine.max(axis=0) - fine.min(axis=0)).max())
    largest = float(np.abs(fine).max())
    at_rest = span <= max(1e-9 * largest, ROUNDING_OF_STEPS * rounding)  # nothing changes but by rounding errors
    scale = max(largest, 1e-300) if at_rest else span
    return max(math.sqrt(float(((fine - coarse) ** 2).mean(axis=1).max())) - rounding, 0.0) / scale


@dataclass(frozen=True)
class ComparableRuns:
    """Runs of one scene with any step, and how two of them are compared."""

    #: Computes a run from its steps per second; may raise :class:`cablepod.errors.RunStopped`
    run: Callable[[float], Any]
    position: Callable[[Any], np.ndarray]  #: positions of a run (time, particle, dims) [m]
    scale: Callable[[Any], float]  #: length by which distances of runs are divided, see :func:`motion_scale` [m]
    steps_per_second: float  #: of the first run
    end_time: float = 0.0  #: [s]
    links: int = 0  #: links, or nodes but one: the factor of the cost of a step
    #: Whether the forces of a run have kinks, as where links slacken and snap taut.  Each kink adds an error that depends on its
    #: place in the step, so that at most first order is assumed.
    has_kinks: Callable[[Any], bool] = lambda run: False
    order: float = SECOND_ORDER  #: of the scheme
    first_order: float = math.inf  #: the order assumed of the first two runs, where their steps are too long to show it
    #: Tensions of a run (rows, link) [N], where they are to converge as the motion does
    tension: Callable[[Any], np.ndarray] | None = None
    tension_rounding: float = 0.0  #: rounding error of tensions [N], which does not count
    #: Steps per second from which a run resolves all frequencies, of implicit schemes; with fewer the estimate takes first order
    resolved: float = 0.0
    #: Makes the result of the run taken, without instants of the comparison
    finish: Callable[[Any], Any] = lambda run: run
    #: Takes a run and the estimated error of its tensions
    note_tension: Callable[[Any, float], None] = lambda run, error: None

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
