"""Vibrations of a taut string with a damper to the ground, by the roots of its characteristic equation."""

from __future__ import annotations

import numpy as np


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
