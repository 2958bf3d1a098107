"""The force across the load that gives a cable its sag, found by a bracket of its logarithm."""

from __future__ import annotations

import math
from collections.abc import Callable

#: Factor by which a bracket of the force grows, and how often at most: sags of 1e-30 to 1e30 m are within it.
GROWTH, MAX_GROWTHS = 4.0, 120
#: Absolute tolerance of the logarithm of the force: the rounding of numbers up to 100.
LOG_TOLERANCE = 1e-14


def force_by_sag(excess: Callable[[float], float], first: float) -> float:
    """Return the force [N] at which `excess`, a function of its logarithm that falls with it, is zero.

    Parameters
    ----------
    excess
        Logarithm of the sag of a force over the given one.
    first
        Logarithm of a first guess of the force.
    """
    from scipy.optimize import brentq  # costly to import

    low = high = first
    deepest = tautest = excess(first)
    for _ in range(MAX_GROWTHS):
        if deepest >= 0.0 >= tautest:
            break
        if deepest < 0.0:
            low -= math.log(GROWTH)
            deepest = excess(low)
        if tautest > 0.0:
            high += math.log(GROWTH)
            tautest = excess(high)
    if low == high:
        return math.exp(first)
    return math.exp(brentq(excess, low, high, xtol=LOG_TOLERANCE, rtol=8.9e-16))
