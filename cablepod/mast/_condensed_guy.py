"""Condensed model of a guy as seen from the mast: potential energy, forces and their tangent, in one coordinate system.

The equations are those of :mod:`cablepod.condensed` to leading order with the stretch at rest, for a lower end that stands still
and a vertical load.  The momentum coordinates p = q + m n.u of the deflections q make the mass matrix of mast and guys constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.errors import SceneError
from cablepod.mast._guys import StaticGuy

#: Intervals of the quadrature along a guy, and points of each.
INTERVALS, GAUSS_POINTS = 40, 6
#: Maximum number of Newton iterations for the deflection at rest, and the relative last correction.
MAX_ITERATIONS, RTOL = 60, 1e-13


class Shapes(NamedTuple):
    """Shapes of the deflection on sigma in [0, 1], orthonormal in the L2 product, with orthogonal slopes."""

    basis: Any  #: function of sigma (points,) and derivative 0 or 1 -> values (r, points)
    slopes: np.ndarray  #: squared norms of the slopes (r,)
    means: np.ndarray  #: integrals (r,)
    moments: np.ndarray  #: integrals times sigma (r,)
    tilt: np.ndarray  #: integrals of products of slopes times sigma - 1/2 (r, r)


def sines(rank: int) -> Shapes:
    """Return the first sines, the shapes of a taut string."""
    numbers = np.arange(1, rank + 1)

    def basis(sigma: np.ndarray, derivative: int) -> np.ndarray:
        angle = np.pi * np.outer(numbers, sigma)
        if derivative == 0:
            return np.sqrt(2.0) * np.sin(angle)
        return np.sqrt(2.0) * np.pi * numbers[:, None] * np.cos(angle)

    return _integrated(basis)


def shapes_of(modes: xr.Dataset | None, rank: int) -> tuple[Shapes, Shapes]:
    """Return the shapes in and out of the plane: those of modes of layout "normal", or sines.

    Raises
    ------
    SceneError
        For a rank that the modes do not have, and modes that depend on one another.
    """
    if modes is None:
        both = sines(rank)
        return both, both
    sigma = modes.arc_length.values / modes.arc_length.values[-1]
    sets = []
    for suffix in ("", "_out_of_plane"):
        name = f"mode_shape{suffix}"
        values = modes[name].values if name in modes else modes["mode_shape"].values
        if rank > len(values):
            raise SceneError(f"rank: given {rank}; allowed: at most {len(values)}, the number of modes")
        sets.append(_of_values(sigma, values[:rank]))
    return sets[0], sets[1]


def _of_values(sigma: np.ndarray, values: np.ndarray) -> Shapes:
    """Return orthonormal shapes with orthogonal slopes that span the given ones (r, particles)."""
    from scipy.interpolate import CubicSpline
    from scipy.linalg import eigh

    spline = CubicSpline(sigma, values, axis=1)
    place, weights = _rule()
    shape, slope = spline(place), spline(place, 1)
    gram = (shape * weights) @ shape.T
    if np.linalg.cond(gram) > 1e12:
        raise SceneError("modes: given modes that depend on one another; allowed: modes of pod.decompose")
    turn = eigh((slope * weights) @ slope.T, gram)[1].T
    return _integrated(lambda at, derivative: turn @ spline(at, derivative))


def _rule() -> tuple[np.ndarray, np.ndarray]:
    """Return places and weights of the quadrature along a guy."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    left = np.arange(INTERVALS)[:, None]
    return ((left + 0.5 * (1.0 + nodes)) / INTERVALS).ravel(), np.tile(0.5 * weights / INTERVALS, INTERVALS)


def _integrated(basis: Any) -> Shapes:
    sigma, weights = _rule()
    shape, slope = basis(sigma, 0), basis(sigma, 1)
    tilt = (slope * (weights * (sigma - 0.5))) @ slope.T
    return Shapes(basis, (slope * slope) @ weights, shape @ weights, shape @ (weights * sigma), tilt)


@dataclass(frozen=True, eq=False)
class CondensedGuy:
    """One guy; coordinates q: first those in the vertical plane of the chord, then those out of it [kg^1/2 m]."""

    guy: StaticGuy  #: at rest, without drag
    shapes: tuple[Shapes, Shapes]
    strain: float  #: at rest, which the terms of second order keep

    @cached_property
    def n_in_plane(self) -> int:
        """Number of coordinates in the plane."""
        return len(self.shapes[0].slopes)

    @cached_property
    def scale(self) -> float:
        """Factor of mass-normalised shapes [kg^-1/2]."""
        return 1.0 / float(np.sqrt(self.guy.p.mass * self.guy.length))

    @cached_property
    def kappa(self) -> np.ndarray:
        """Squared slope norms of the shapes (2 r,) [1/(kg m)]."""
        return np.concatenate([part.slopes for part in self.shapes]) * self.scale**2 / self.guy.length

    @cached_property
    def moments(self) -> np.ndarray:
        """Integrals of mass times sigma times shape (2 r,) [kg^1/2]."""
        return np.concatenate([part.moments for part in self.shapes]) * self.guy.p.mass * self.guy.length * self.scale

    @cached_property
    def loads(self) -> np.ndarray:
        """Integrals of the shapes in the plane, 0 out of it (2 r,) [m kg^-1/2]."""
        means = self.shapes[0].means * self.guy.length * self.scale
        return np.concatenate([means, np.zeros(len(self.shapes[1].slopes))])

    @cached_property
    def tilt(self) -> np.ndarray:
        """Geometric stiffness of a load of one along the chord (2 r, 2 r) [1/kg]."""
        from scipy.linalg import block_diag

        return block_diag(*(part.tilt for part in self.shapes)) * self.scale**2

    @property
    def weight(self) -> float:
        """Weight per unstretched length, with ice [N/m]."""
        return -float(self.guy.p.weight[1])

    @property
    def rest_force(self) -> float:
        """Chordwise force that belongs to the strain at rest [N]."""
        return self.strain * self.guy.p.stiffness

    def frame(self, upper: Any) -> tuple[Any, Any]:
        """Return chord length, and axes: from mast to anchor, normal in the vertical plane, normal out of it (3, 3)."""
        reach = self.guy.p.lower - upper
        chord = np.sqrt((reach * reach).sum())
        along = reach / chord
        vertical = np.array([0.0, 1.0, 0.0])
        if abs(complex(along[0])) + abs(complex(along[2])) < 1e-12:  # along the mast: any vertical plane
            first = np.array([1.0, 0.0, 0.0]) - along[0] * along
            first = first / np.sqrt((first * first).sum())
        else:
            first = vertical - along[1] * along
            first = first / np.sqrt((first * first).sum())
        second = [first[(d + 1) % 3] * along[(d + 2) % 3] - first[(d + 2) % 3] * along[(d + 1) % 3] for d in range(3)]
        return chord, np.array([along, first, second])

    def forces(self, q: Any, upper: Any) -> tuple[Any, Any]:
        """Return forces on the coordinates (2 r,) and on the end at fixed coordinates (3,): negative slopes of the energy."""
        length, stiffness, weight = self.guy.length, self.guy.p.stiffness, self.weight
        chord, axes = self.frame(upper)
        along_load, normal_load = -weight * axes[0, 1], -weight * axes[1, 1]
        kappa, tilt = self.kappa, self.tilt
        softening = 1.0 - 2.0 * self.strain
        tension = stiffness * (chord / length - 1.0) + 0.5 * stiffness / length * softening * (kappa * q * q).sum()
        tilted = tilt @ q
        on_q = -(tension * softening + self.strain * self.rest_force) * kappa * q - along_load * tilted
        on_q = on_q + normal_load * self.loads
        turning = (0.5 * (q * tilted).sum() * normal_load + (self.loads * q).sum() * along_load) / chord
        on_end = tension * axes[0] + turning * axes[1]
        return on_q, on_end + np.array([0.0, -0.5 * weight * length, 0.0])

    def energy(self, q: np.ndarray, upper: np.ndarray) -> float:
        """Return the potential energy [J], of which :meth:`forces` are the negative slopes."""
        _, axes = self.frame(upper)
        tension, weight = self.tension(q, upper), self.weight
        elastic = 0.5 * self.guy.length / self.guy.p.stiffness * tension**2
        elastic += 0.5 * self.strain * self.rest_force * float((self.kappa * q * q).sum())
        hanging = -weight * (
            0.5 * float(axes[0, 1]) * float(q @ self.tilt @ q) - float(axes[1, 1]) * float(self.loads @ q)
        )
        return elastic + hanging + 0.5 * weight * self.guy.length * float(upper[1])

    def tension(self, q: np.ndarray, upper: np.ndarray) -> float:
        """Return the mean chordwise force [N]."""
        chord, _ = self.frame(upper)
        softening = 1.0 - 2.0 * self.strain
        sag = 0.5 * softening * float((self.kappa * q * q).sum())
        return float(self.guy.p.stiffness * (chord / self.guy.length - 1.0 + sag / self.guy.length))

    def tangent(self, q: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Return the second derivative of the energy by (q, upper): (2 r + 3, 2 r + 3), by complex steps."""
        r, step = q.size, 1e-30
        result = np.empty((r + 3, r + 3))
        state = np.concatenate([q, upper]).astype(complex)
        for j in range(r + 3):
            moved = state.copy()
            moved[j] += 1j * step
            on_q, on_end = self.forces(moved[:r], moved[r:])
            result[:, j] = -np.concatenate([on_q, on_end]).imag / step
        return result

    def stiffness(self, q: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Return the part of :meth:`tangent` that belongs to the coordinates (2 r, 2 r)."""
        softening, slope = 1.0 - 2.0 * self.strain, self.kappa * q
        along_load = -self.weight * self.frame(upper)[1][0, 1]
        straight = self.tension(q, upper) * softening + self.strain * self.rest_force
        sag = self.guy.p.stiffness / self.guy.length * softening**2
        return np.diag(straight * self.kappa) + along_load * self.tilt + sag * np.outer(slope, slope)

    def rest(self, upper: np.ndarray, force: np.ndarray | None = None) -> np.ndarray:
        """Return the coordinates in equilibrium (2 r,), with further forces on them.

        Raises
        ------
        SceneError
            Where no equilibrium is found.
        """
        _, axes = self.frame(upper)
        q = self.loads * (-self.weight * axes[1, 1]) / (max(self.rest_force, 1e-9) * self.kappa)
        if force is not None:
            q = q + force / (max(self.rest_force, 1e-9) * self.kappa)
        for _ in range(MAX_ITERATIONS):
            out = self.forces(q, upper)[0] + (0.0 if force is None else force)
            change = np.linalg.solve(self.stiffness(q, upper), out)
            q = q + change
            if not np.isfinite(q).all():
                break
            if np.abs(change).max() <= RTOL * np.abs(q).max():
                return q
        raise SceneError('guy: the condensed model of a guy has no rest; allowed: taut guys; try: guys="chain"')


def condensed_guy(guy: StaticGuy, shapes: tuple[Shapes, Shapes]) -> CondensedGuy:
    """Make the condensed model of a guy at rest."""
    chord = float(np.linalg.norm(guy.chord))
    _, lower, upper = guy.force()
    strain = 0.5 * (lower + upper) / guy.p.stiffness if chord > 0.0 else 0.0
    return CondensedGuy(guy, shapes, strain)
