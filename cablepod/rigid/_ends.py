"""Check that rigid links reach from end to end during the whole run."""

from __future__ import annotations

import numpy as np

from cablepod.discretisation._chain import LumpedChain, square
from cablepod.errors import SceneError
from cablepod.parameters._parameters import Parameters
from cablepod.rigid._start import STRAIGHT, _lengthened, check_chord

#: Minimum number of samples of the end distance, per shortest time scale of the motions and in the whole run.
POINTS_PER_CHANGE, MIN_POINTS = 32, 1000
#: Number of samples evaluated at once (bounds the memory).
_BLOCK = 65536


# --- ends -----------------------------------------------------------------------------------------------------------


def check_ends(chain: LumpedChain, end_time: float) -> None:
    """Refuse end motions that rigid links cannot follow: too far apart, or too close for one long link.

    Raises
    ------
    SceneError
        With distance and time.
    """
    p, total = chain.p, chain.total_length
    if p.free_end is not None:
        return
    check_chord(chain, np.diff(p.initial_ends, axis=0)[0])
    min_distance = 2.0 * float(chain.length.max()) - total  # of the ends, with one link longer than all others together
    far, near, when = 0.0, np.inf, {}
    first: float | None = None
    step = np.inf
    if p.motions and end_time > 0.0:
        step = min(p.shortest_time_scale / POINTS_PER_CHANGE, end_time / MIN_POINTS)
    count = int(np.ceil(end_time / step)) + 1 if np.isfinite(step) else 1
    for begin in range(0, count, _BLOCK):
        time = np.minimum(np.arange(begin - 1, min(begin + _BLOCK, count) + 1) * (step if count > 1 else 0.0), end_time)
        time = np.maximum(time, 0.0)
        for sign in (1.0, -1.0):
            peak_time, value = _peaks(p, time, sign)
            if sign > 0 and value > far:
                far, when["far"] = value, peak_time
            if sign < 0 and -value < near:
                near, when["near"] = -value, peak_time
        if first is None:
            beyond = np.flatnonzero(_distance(p, time) >= total * (1.0 - STRAIGHT))
            if beyond.size:
                first = _crossing(p, time[max(beyond[0] - 1, 0)], time[beyond[0]], total * (1.0 - STRAIGHT))
    if far >= total * (1.0 - STRAIGHT):
        since = when["far"] if first is None else min(first, when["far"])
        raise SceneError(
            f"motion: given ends {far:.9g} m apart at {when['far']:.6g} s, {_lengthened(far, total)} the length of the rigid "
            f"links, and too far apart from {since:.6g} s on; allowed: always less than {total:.9g} m "
            f"(cable.{p.length_key} makes it so long)"
        )
    if min_distance >= 0.0 and near <= min_distance + STRAIGHT * total:
        raise SceneError(
            f"motion: given ends {near:.9g} m apart at {when['near']:.6g} s; allowed: always more than {min_distance:.9g} m, by "
            "which the longest link is longer than all others together"
        )


def _distance(p: Parameters, time: np.ndarray) -> np.ndarray:
    """Return the distance of the ends (times,) [m]."""
    ends = p.end_positions(time)
    return np.sqrt(square(ends[:, 1] - ends[:, 0]))


def _crossing(p: Parameters, low: float, high: float, limit: float) -> float:
    """Return the time between `low` and `high` at which the distance of the ends reaches `limit` [s], by bisection."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _distance(p, np.array([middle]))[0] >= limit else (middle, high)
    return float(high)


def _peaks(p: Parameters, time: np.ndarray, sign: float) -> tuple[float, float]:
    """Return time and value of the maximum of `sign` times the distance, with all peaks of the samples refined."""
    value = sign * _distance(p, time)
    best = int(np.argmax(value))
    sampled = float(time[best]), float(value[best])
    peaks = np.flatnonzero((value[1:-1] >= value[:-2]) & (value[1:-1] >= value[2:])) + 1
    if peaks.size == 0:
        return sampled
    # discard peaks whose parabolic overshoot cannot exceed the current maximum
    spread = np.maximum(value[peaks] - value[peaks - 1], value[peaks] - value[peaks + 1])
    peaks = peaks[value[peaks] + spread >= value[best]]
    low, high = time[peaks - 1], time[peaks + 1]
    for _ in range(60):  # ternary search, to rounding
        a, b = low + (high - low) / 3.0, high - (high - low) / 3.0
        left = sign * _distance(p, a) > sign * _distance(p, b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    middle = 0.5 * (low + high)
    value = sign * _distance(p, middle)
    best = int(np.argmax(value))
    return (float(middle[best]), float(value[best])) if value[best] > sampled[1] else sampled
