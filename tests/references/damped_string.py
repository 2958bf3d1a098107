"""Vibrations of a taut string of two parts, or with a damper, a mass or a spring, by the roots of its characteristic equation.

Roots are beta l, with the angular frequency over the speed of the wave for beta; `place` is a / l.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy import cos, sin
from scipy.optimize import brentq

import cablepod as cp

#: A weightless taut string: distance of the ends [m], tension [N], mass per stretched length [kg/m], axial stiffness [N].
LENGTH, TENSION, MASS, STIFFNESS = 100.0, 2e4, 1.0, 2e9
UNSTRETCHED = LENGTH / (1.0 + TENSION / STIFFNESS)
SPEED = math.sqrt(TENSION / MASS)
AREA = 1e-2
DENSITY = MASS * LENGTH / UNSTRETCHED / AREA
TAUT: dict[str, Any] = {
    "gravity": 0.0,
    "cable": {"youngs_modulus": STIFFNESS / AREA, "area": AREA, "density": DENSITY, "unstretched_length": UNSTRETCHED},
    "ends": {"lower": [0.0, 0.0], "upper": [LENGTH, 0.0]},
}


def string(links: int = 100, *, spatial: bool = False, **tables: Any) -> Any:
    """Make the string with further tables."""
    ends = {end: [*place, 0.0] if spatial else place for end, place in TAUT["ends"].items()}
    return cp.make_scene({**TAUT, "ends": ends, "chain": {"links": links}, **tables})


def damper(place: float, eta: float, direction: Any = "normal") -> dict[str, Any]:
    """Return an attached damper of eta times sqrt(T m)."""
    return {"arc_length": place, "damper": eta * math.sqrt(TENSION * MASS), "direction": direction}


def roots_with_damper(place: float, eta: float, count: int) -> np.ndarray:
    """Return roots beta l of sin b l + i eta sin(b a) sin(b (l - a)) = 0, from those without damper by raising it in steps.

    `place` is a / l, `eta` the damper over the root of tension times mass per length.
    """
    roots = np.pi * np.arange(1, count + 1).astype(complex)
    for value in np.linspace(0.0, eta, 800)[1:]:
        for _ in range(8):
            one, two = roots * place, roots * (1.0 - place)
            misfit = np.sin(roots) + 1j * value * np.sin(one) * np.sin(two)
            change = place * np.cos(one) * np.sin(two) + (1.0 - place) * np.sin(one) * np.cos(two)
            roots = roots - misfit / (np.cos(roots) + 1j * value * change)
    return roots


def _roots(misfit: Callable, count: int) -> np.ndarray:
    """Return the first roots of a function."""
    grid = np.linspace(0.03, np.pi * (count + 1.5), 3000)
    change = np.flatnonzero(misfit(grid[:-1]) * misfit(grid[1:]) < 0.0)
    return np.array([brentq(misfit, grid[k], grid[k + 1], xtol=1e-14) for k in change[:count]])


def roots_with_mass(place: float, ratio: float, count: int) -> np.ndarray:
    """Return roots of sin b l = (M / m) b sin(b a) sin(b (l - a)); `ratio` is M over the mass of the string."""
    return _roots(lambda b: sin(b) - ratio * b * sin(b * place) * sin(b * (1.0 - place)), count)


def roots_with_spring(place: float, stiffness: float, count: int) -> np.ndarray:
    """Return roots of b l sin b l + (k l / T) sin(b a) sin(b (l - a)) = 0; `stiffness` is k l / T."""
    return _roots(lambda b: b * sin(b) + stiffness * sin(b * place) * sin(b * (1.0 - place)), count)


def roots_of_two_parts(place: float, ratio: float, count: int) -> np.ndarray:
    """Return roots of the first part: cos t1 sin t2 + sqrt(ratio) sin t1 cos t2 = 0, t1 = b a, t2 = sqrt(ratio) b (l - a).

    `ratio` is the mass per length of the second part over that of the first.
    """
    r = np.sqrt(ratio)
    return _roots(
        lambda b: cos(b * place) * sin(r * b * (1 - place)) + r * sin(b * place) * cos(r * b * (1 - place)), count
    )
