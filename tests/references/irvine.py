"""Frequencies of a shallow horizontal cable by Irvine and Caughey (1974)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

import cablepod as cp


def horizontal(lam2, slope, dims=3):
    """Return a horizontal cable of Irvine's lambda^2 and of weight over horizontal force `slope`, and its sqrt(H/mu)/span."""
    load, span = 10.0, 100.0
    force = load * span / slope
    stiffness = lam2 * force * (1.0 + slope**2 / 8.0) / slope**2
    scene = cp.make_scene(
        {
            "cable": {"youngs_modulus": stiffness, "area": 1.0, "specific_weight": load, "horizontal_force": force},
            "ends": {"lower": [0.0] * dims, "upper": [span] + [0.0] * (dims - 1)},
        }
    )
    return scene, np.sqrt(force * 9.81 / load) / span, force / stiffness


def symmetric_roots(lam2, count):
    """Roots of tan(z/2) = z/2 - 4/lam2 (z/2)^3, without its poles."""

    def f(z):
        return np.sin(z / 2.0) + (4.0 / lam2 * (z / 2.0) ** 3 - z / 2.0) * np.cos(z / 2.0)

    z = np.linspace(1e-2, (2 * count + 3) * np.pi, 4001)
    change = np.flatnonzero(f(z[:-1]) * f(z[1:]) < 0.0)
    return np.array([brentq(f, z[i], z[i + 1], xtol=1e-12) for i in change])[:count]
