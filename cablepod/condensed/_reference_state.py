"""Second-order terms of order "leading".

Strain, slope and chordwise inertia of a reference state between the longest and the shortest chord enter the coefficients as
constants, so that a step costs no more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Number of instants of the scene's duration at which the distance of the ends is sampled.
INSTANTS = 65
#: Maximum size of the second-order terms of the slopes (above, an expansion in the slopes has no meaning, and all are left out).
MAX_SLOPE_TERM = 0.1
#: Maximum number of iterations of Newton's method for the strain, and relative correction after which only rounding is left (it
#: converges quadratically).
MAX_ITERATIONS, STRAIN_RTOL = 60, 1e-8


class ReferenceState(NamedTuple):
    """Constants of second order: the squared slopes have the factor `uniform` + `sag` p, p the profile of the squared slopes."""

    uniform: np.ndarray  #: (members,)
    sag: np.ndarray  #: half the mean square of the slopes of the reference state (members,)


def reference_state(chord_strain: np.ndarray, rest_load: np.ndarray, mean_fourth: float | np.ndarray) -> ReferenceState:
    """Compute the constants of many members.

    Parameters
    ----------
    chord_strain
        Shortest and longest distance of the ends over the unstretched length, minus 1 (2, members).
    rest_load
        Mean square of the transverse force on the links at rest, in units of K (members,).
    mean_fourth
        Mean fourth power of the transverse force over its squared mean square, 9/5 for a parabola.

    Notes
    -----
    With x the strain of the chord, A half the mean square of the slopes and n = x + A the chordwise force over K, equilibria obey
    A n^2 = c.  To second order the chordwise force per unit slope is K S, S = x - x^2 + (1 + (P - 4) x) A + (3/2 P - 3) A^2,
    with P = `mean_fourth`.  A factor f of the squared slopes, in the closure and in the force, gives S = f (x + f A) instead.
    One equilibrium is then right to second order, with f = 1 / (1 + e), e = (x^2 + (4 - P) x A - (3/2 P - 3) A^2) / (n + A);
    without sag f is the inverse of the stretch, and exact.  Between the equilibria of the shortest and the longest chord it is
    their mean e that makes the larger error of the sag least: an error of e changes the square root of A by
    (n + A) sqrt(A) / (n + 2 A).
    """
    strains = np.concatenate([chord_strain, 0.5 * chord_strain.sum(axis=0, keepdims=True)])
    with np.errstate(all="ignore"):
        strain = _strain(strains, 0.5 * rest_load)
        n, x = strain[:2], strains[:2]
        sag = n - x
        curvature = 1.5 * mean_fourth - 3.0
        excess = (x * x + (4.0 - mean_fourth) * x * sag - curvature * sag * sag) / (n + sag)
        # a cable without sag has no error to weigh
        weight = np.sqrt(np.maximum(sag, 1e-30)) * (n + sag) / (n + 2.0 * sag)
        excess = (weight * excess).sum(axis=0) / weight.sum(axis=0)
        half_square = strain[2] - strains[2]
        small = (half_square * mean_fourth < MAX_SLOPE_TERM) & (excess > -MAX_SLOPE_TERM)
        half_square = np.where(small, half_square, 0.0)
        return ReferenceState(np.where(small, 1.0 / (1.0 + excess), 1.0) - half_square * mean_fourth, half_square)


def _strain(x: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the positive root n of n^3 - x n^2 = c by Newton's method, from above."""
    n = np.maximum(x, 0.0) + np.cbrt(c)
    for _ in range(MAX_ITERATIONS):
        change = (n * n * (n - x) - c) / (n * (3.0 * n - 2.0 * x))
        n = n - change
        if not (np.abs(change) > STRAIN_RTOL * n).any():
            break
    return n


def chordwise_inertia(
    slope_products: np.ndarray, length: np.ndarray, arc_length: np.ndarray, tributary_length: np.ndarray
) -> np.ndarray:
    """Return the inertia of the chordwise motion that belongs to deflections, over the mass per length (..., r, r) [m].

    A link of slope w' whose deflection has the slope phi' shortens by w' phi' along the chord; what is left over to the ends is
    taken from all links alike.

    Parameters
    ----------
    slope_products
        Slopes w' phi' of the deflections (..., r, n).
    length, arc_length, tributary_length
        Unstretched lengths of the links (n,), arc lengths and tributary lengths of the particles (n + 1,) [m].
    """
    moved = between_held_ends(slope_products * length, arc_length[1:] / arc_length[-1])
    return (moved * tributary_length[1:]) @ np.swapaxes(moved, -1, -2)


def between_held_ends(lengthening: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return the chordwise displacements of the upper particles of links that lengthen (..., n) between held ends.

    All links take back what is left over to the ends; `shares` are those of the links up to each particle (..., n), 1 at last.
    """
    sums = np.cumsum(lengthening, axis=-1)
    return sums - sums[..., -1:] * shares


def orthogonal_coordinates(stiffness: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve the eigenproblem of symmetric matrices (..., r, r): eigenvalues (..., r), mass-orthonormal vectors (..., r, r).

    Matrices that are not finite give nan.
    """
    finite = np.isfinite(stiffness).all(axis=(-2, -1)) & np.isfinite(mass).all(axis=(-2, -1))
    if not finite.all():
        mask, unit = finite[..., None, None], np.eye(mass.shape[-1])
        values, vectors = orthogonal_coordinates(np.where(mask, stiffness, unit), np.where(mask, mass, unit))
        return np.where(finite[..., None], values, np.nan), np.where(mask, vectors, np.nan)
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    values, vectors = np.linalg.eigh(inverse @ stiffness @ np.swapaxes(inverse, -1, -2))
    return values, np.swapaxes(inverse, -1, -2) @ vectors
