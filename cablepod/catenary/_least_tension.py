"""Search of the least tension of an elastic catenary over all lengths."""

from __future__ import annotations

import math

from cablepod.catenary._formulas import _sigma


def _mean_tension_at(eta: float, a: float, c: float, q: float, stiffness: float) -> float:
    """Compute the mean end tension for the sag parameter `eta`: T (1 + T/K) tanh(eta) = q l / 2."""
    mean = 0.0
    for _ in range(100):
        sigma, _ = _sigma(eta, mean / stiffness, 0.0)
        p = 0.5 * q * math.sqrt(c * c + a * a * sigma) / math.tanh(eta)
        new = 2.0 * p / (1.0 + math.sqrt(1.0 + 4.0 * p / stiffness))
        if abs(new - mean) <= 1e-15 * new:
            return new
        mean = new
    return mean


def least_tension(a: float, b: float, c: float, q: float, stiffness: float, sign: float) -> float:
    """Return the minimum tension [N] at the upper (`sign` 1) or lower (-1) end over all lengths.

    The end tension T + q b / (2 (1 + e)) increases with the mean T, because no cable has T (1 + e) < q c / 2 (so that
    (K + T)^2 > q b K / 2).  The minimum of the mean over eta follows by golden-section search.
    """
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    low, high = math.log(1e-4), math.log(300.0)
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    f_left = _mean_tension_at(math.exp(left), a, c, q, stiffness)
    f_right = _mean_tension_at(math.exp(right), a, c, q, stiffness)
    for _ in range(80):
        if f_left < f_right:
            high, right, f_right = right, left, f_left
            left = high - ratio * (high - low)
            f_left = _mean_tension_at(math.exp(left), a, c, q, stiffness)
        else:
            low, left, f_left = left, right, f_right
            right = low + ratio * (high - low)
            f_right = _mean_tension_at(math.exp(right), a, c, q, stiffness)
    mean = min(f_left, f_right)
    return mean + sign * 0.5 * q * b / (1.0 + mean / stiffness)
