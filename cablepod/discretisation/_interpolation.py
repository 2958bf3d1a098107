"""Positions of a trajectory at other places of the cable."""

from __future__ import annotations

import numpy as np

from cablepod._inputs import ROUNDING

#: Maximum distance of a particle from a knot of the spline that counts as none, of S / L0 [1] (rounding).
SAME_PLACE = 1e-13


def are_same(sigma: np.ndarray, other: np.ndarray) -> bool:
    """Tell whether two sets of places S / L0 (particle,) are the same, but for rounding of files."""
    return sigma.shape == other.shape and bool(np.abs(sigma - other).max() <= ROUNDING)


def at_places(sigma: np.ndarray, known_sigma: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Interpolate positions (time, particle, dims) [m] from particles at `known_sigma` to `sigma` [1] by cubic splines."""
    if are_same(sigma, known_sigma):
        return position
    knots = np.minimum(np.searchsorted(known_sigma, sigma - SAME_PLACE), known_sigma.size - 1)
    if np.abs(known_sigma[knots] - sigma).max() <= SAME_PLACE:
        return position[:, knots]  # a spline passes through its knots, as with half the links
    from scipy.interpolate import CubicSpline  # costly to import

    if known_sigma.size < len(position):  # weights of the particles once, in place of a spline for each instant
        return CubicSpline(known_sigma, np.eye(known_sigma.size))(sigma) @ position
    return CubicSpline(known_sigma, position, axis=1)(sigma)
