"""Time mean and root mean square of the tensions of a run, from its steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from cablepod.integrate._output_times import OutputTimes

#: Outputs that need means over time.
MEANS = ("tension_mean", "tension_rms")
#: Maximum number of intervals of the time integral, beside those of the output times; longer runs are integrated over several
#: steps each.
MAX_INTERVALS = 32768
#: Number of tensions that are computed at once, which fit into the cache of a processor.
CHUNK = 16384
#: Time mean and root mean square of the tensions (n,) [N]; None if they are not requested.
Means = tuple[np.ndarray, np.ndarray] | None


def wants_means(outputs: Iterable[str]) -> bool:
    """Whether time means of the tensions are among some outputs."""
    return not set(MEANS).isdisjoint(outputs)


def with_steps_of_means(
    instants: OutputTimes, outputs: tuple[str, ...], window: tuple[float, float] | None
) -> OutputTimes:
    """Return output times with the steps that means over a run, or over a window [s], need among the steps to save."""
    if not wants_means(outputs):
        return instants
    first, last = _ends(instants, window)
    begin, end = math.floor(first), min(math.ceil(last), int(instants.steps[-1]))
    every = max(math.ceil((end - begin) / MAX_INTERVALS), 1)
    return instants.with_steps(np.append(np.arange(begin, end, every), end))


def means(
    instants: OutputTimes, window: tuple[float, float] | None, tension: Callable[[slice], np.ndarray], links: int
) -> Means:
    """Return time mean and root mean square of the tensions (n,) [N].

    The tension is linear between the saved steps, and so is its square.

    Parameters
    ----------
    instants
        Steps of the run, with those of :func:`with_steps_of_means`.
    window
        Start and end of the part of the run [s]; None for all.
    tension
        Computes the tensions (steps, n) [N] at some of the saved steps.
    links
        Number of tensions n.
    """
    weight = weights(instants.steps, *_ends(instants, window))
    used = np.flatnonzero(weight)
    mean, square, rows = np.zeros(links), np.zeros(links), max(CHUNK // max(links, 1), 1)
    for begin in range(int(used[0]), int(used[-1]) + 1, rows):
        part = slice(begin, min(begin + rows, int(used[-1]) + 1))
        values = tension(part)
        mean += weight[part] @ values
        square += weight[part] @ (values * values)
    return mean, np.sqrt(square)


def weights(steps: np.ndarray, first: float, last: float) -> np.ndarray:
    """Return the weights (steps,) of values at rising `steps` in the mean of their linear interpolant from `first` to `last`.

    An interval of length h of which the part from a to b counts, both in units of h, adds h (b - a) (1 - (a + b) / 2) to the
    weight of its begin and h (b - a) (a + b) / 2 to that of its end.
    """
    if steps.size == 1 or last <= first:  # a run of no length
        return (steps == steps[-1]).astype(float)
    left, length = steps[:-1], np.diff(steps)
    a, b = (np.clip((border - left) / length, 0.0, 1.0) for border in (first, last))
    part, share = length * (b - a), 0.5 * (a + b)
    result = np.zeros(steps.size)
    result[:-1] += part * (1.0 - share)
    result[1:] += part * share
    return result / result.sum()


def _ends(instants: OutputTimes, window: tuple[float, float] | None) -> tuple[float, float]:
    """Return begin and end of the integral, in steps: those of the window, or of the run up to its last output time."""
    start, end = (0.0, float(instants.times[-1])) if window is None else window
    last = float(instants.steps[-1])
    return min(start * instants.steps_per_second, last), min(end * instants.steps_per_second, last)
