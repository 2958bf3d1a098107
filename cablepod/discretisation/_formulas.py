"""Formulas of the material laws, for numbers and arrays, which kernels compile too (``_kernels_laws.py``); see ``_laws.py``."""

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
