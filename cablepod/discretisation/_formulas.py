"""Formulas for numbers and arrays, which kernels compile too (``_kernels_laws.py``).

Material laws, see ``_laws.py``, and their derivatives along a chord; closure to leading order; line between ends.
"""

from __future__ import annotations

from typing import Any


def linear_secant(inverse_stretch: Any, stiffness: Any) -> Any:
    """Return T / xi of law "linear" from 1 / xi, in the units of `stiffness`; negative in compression."""
    return stiffness * (1.0 - inverse_stretch)


def green_secant(squared_stretch: Any, stiffness: Any) -> Any:
    """Return T / xi of law "green" from the squared stretch, in the units of `stiffness`; negative in compression."""
    return 0.5 * stiffness * (squared_stretch - 1.0)


def green_tangent(squared_stretch: Any, stiffness: Any) -> Any:
    """Return dT/dxi of law "green" from the squared stretch, in the units of `stiffness`."""
    return stiffness * (1.5 * squared_stretch - 0.5)


def viscous_secant(elastic: Any, rate: Any, square: Any, damping: Any) -> Any:
    """Return T / xi with viscosity, from that without.

    `rate` is the inner product of a link's vector of the squared length `square` and its rate; `damping` is viscosity [s] times
    stiffness.
    """
    return elastic + damping * rate / square


def damping_by_tension(rate: Any, tension: Any, damping: Any) -> Any:
    """Return `damping` [s] times the rate of what a tension acts on, 0 without tension; it acts on the sum of both.

    The tension may be given by anything that has its sign, such as T / xi.
    """
    return damping * rate * (tension > 0.0)


def linear_tangent_along(squared_slope: Any, inverse_stretch: Any) -> Any:
    """Return the derivative of N / K by the chordwise stretch at constant slope, by law "linear", from w'^2 and 1 / xi."""
    return 1.0 - squared_slope * inverse_stretch * inverse_stretch * inverse_stretch


def green_tangent_along(squared_slope: Any, stretch: Any) -> Any:
    """Return the derivative of N / K by the chordwise stretch at constant slope, by law "green", from w'^2 and zeta'."""
    return 0.5 * (3.0 * stretch * stretch + squared_slope - 1.0)


def closure_tension(stiffness: Any, stretch: Any, load: Any, sag: Any) -> Any:
    """Return H [N] by the closure to leading order: the integral of zeta' = 1 + N / K - w'^2 / 2 over the length is the chord.

    `stretch` is the chord over the unstretched length, `load` the mean chordwise force of the loads, weighted by the compliance
    [N], `sag` K times half the mean of w'^2 [N].
    """
    return stiffness * (stretch - 1.0) - load + sag


def on_line(lower: Any, upper: Any, sigma: Any) -> Any:
    """Return what the straight line between the ends has at a relative arc length, from what both ends have."""
    return (1.0 - sigma) * lower + sigma * upper
