"""Limits of explicit steps: highest frequency of a chain, largest stable step of velocity Verlet."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def highest_axial_frequency(
    mass: np.ndarray, stiffness: np.ndarray, free: slice, springs: np.ndarray | None = None
) -> float:
    """Return the highest axial angular frequency of the straight chain [rad/s].

    A link is stiffest along itself, so that no shape has a higher frequency.  The frequencies are the square roots of the
    eigenvalues of a tridiagonal matrix.

    Parameters
    ----------
    mass
        Masses of all particles (n + 1,) [kg].
    stiffness
        Tangent stiffness of the links (n,) [N/m].
    free
        Particles that move freely; the others are held.
    springs
        Stiffness of springs between the particles and the ground (n + 1,) [N/m]; None without.
    """
    from scipy.linalg import eigvalsh_tridiagonal  # takes longer to import than a short run

    first, last = free.start, free.stop
    m = mass[first:last]
    k = np.concatenate([[0.0], stiffness, [0.0]])
    diagonal = (k[first:last] + k[first + 1 : last + 1] + (0.0 if springs is None else springs[first:last])) / m
    if diagonal.size == 1:
        return math.sqrt(diagonal[0])
    off = -k[first + 1 : last] / np.sqrt(m[:-1] * m[1:])
    top = diagonal.size - 1
    return math.sqrt(eigvalsh_tridiagonal(diagonal, off, select="i", select_range=(top, top))[0])


def verlet_step_limit(omega: Any, viscosity: float | None = None) -> Any:
    """Return the critical time step of velocity Verlet [s]: 2 over the highest frequency; less with viscous links.

    Damping by mass is integrated exactly and only increases the limit.
    """
    return 2.0 / omega if viscosity is None else _viscous_limit(omega, viscosity)


def _viscous_limit(omega: float, viscosity: float) -> float:
    """Return the largest stable step [s] with predicted velocity for one frequency, by the amplification matrix."""
    damping = viscosity * omega  # twice the damping ratio

    def spectral_radius(h: float) -> float:
        # state: position, velocity half a step before, velocity three half steps before; unit of time 1/omega
        a = np.array([-1.0, -1.5 * damping, 0.5 * damping])
        v = np.array([0.0, 1.0, 0.0]) + h * a
        return float(np.abs(np.linalg.eigvals(np.array([np.array([1.0, 0.0, 0.0]) + h * v, v, [0.0, 1.0, 0.0]]))).max())

    low, high = 0.0, 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if spectral_radius(middle) <= 1.0 + 1e-12 else (low, middle)
    return low / omega


def largest_frequencies_squared(
    kappa: np.ndarray,
    norms: np.ndarray,
    stiffness: float | np.ndarray,
    q: np.ndarray,
    rows: np.ndarray,
    chord_tension: float | np.ndarray,
) -> np.ndarray:
    """Return |H| max kappa + K / L0 sum (kappa q)^2 + sum |g_a| |G_a|, which bounds squared angular frequencies [1/s^2].

    All arrays may have a leading dimension of members.

    Parameters
    ----------
    kappa, norms
        Squared slope norms (r,) [1/(kg m)], spectral norms of the geometric stiffness (patterns,).
    stiffness, chord_tension
        K / L0 [N/m] and H [N], numbers or (members,).
    q, rows
        Coordinates (r,) and boundary data (columns,).
    """
    loads = (np.abs(rows[..., 1 : 1 + norms.shape[-1]]) * norms).sum(axis=-1)
    return np.abs(chord_tension) * kappa.max(axis=-1) + stiffness * ((kappa * q) ** 2).sum(axis=-1) + loads
