"""Planar elastic catenary of several parts with weights between them, to 30 digits, in the textbook's closed form.

The forces (H, V0) at the lower end solve, with V(S) = V0 + w S + P [S > a] along the parts,

    sum (H / w) [asinh(V / H)] + H sum(l / K) = span,   sum (1 / w) [sqrt(H^2 + V^2)] + sum [V^2] / (2 K w) = rise.

A given tension makes the length a third unknown.  The parts are fractions of the length, or end at distances from an end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath as mp

MP = mp.mp.clone()
MP.dps = 40

#: Function of the length that gives the parts: length l, stiffness K, weight w, weight P at its upper end.
Parts = Callable[[Any], Sequence[tuple[Any, Any, Any, Any]]]


def ends(parts: Sequence[tuple[Any, Any, Any, Any]], h: Any, v0: Any) -> tuple[Any, Any, Any]:
    """Return span and rise [m] and the vertical force at the upper end [N]."""
    x = y = MP.mpf(0)
    v = v0
    for length, stiffness, weight, attached in parts:
        top = v + weight * length
        x += h / weight * (MP.asinh(top / h) - MP.asinh(v / h)) + h * length / stiffness
        y += (MP.hypot(h, top) - MP.hypot(h, v)) / weight + (top**2 - v**2) / (2 * stiffness * weight)
        v = top + attached
    return x, y, v


def solve(
    parts: Parts, span: float, rise: float, given: str, value: float, start: Sequence[float]
) -> tuple[Any, Any, Any, Any]:
    """Return H, V at the lower end, V at the upper end [N] and the length [m]; `start` is (H, V0, length)."""

    def misfit(h: Any, v0: Any, length: Any) -> list[Any]:
        x, y, v1 = ends(parts(length), h, v0)
        quantity = {
            "unstretched_length": length,
            "top_tension": MP.hypot(h, v1),
            "bottom_tension": MP.hypot(h, v0),
            "horizontal_force": h,
        }[given]
        return [x - span, y - rise, quantity / value - 1]

    h, v0, length = MP.findroot(misfit, [MP.mpf(number) for number in start], tol=1e-50, maxsteps=60)
    return h, v0, ends(parts(length), h, v0)[2], length
