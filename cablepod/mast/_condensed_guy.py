"""Condensed models of guys as seen from the mast: potential energy, forces and their tangent, for all guys at once.

The equations are those of :mod:`cablepod.condensed` to leading order with the stretch at rest, for a lower end that stands still
and a vertical load.  The momentum coordinates p = q + m n.u of the deflections q make the mass matrix of mast and guys constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.discretisation._formulas import closure_tension
from cablepod.errors import SceneError
from cablepod.mast._static_guys import GuyStatics, StaticGuy
from cablepod.pod._normal import check_axis, sets

#: Intervals of the quadrature along a guy, and points of each.
INTERVALS, GAUSS_POINTS = 40, 6
#: Maximum number of Newton iterations for the deflection at rest, and the relative last correction.
MAX_ITERATIONS, RTOL = 60, 1e-13
#: A chord whose first normal is in its vertical plane, as those of guys are, however steep; what messages say of its axis.
LEVEL = np.array([1.0, 0.0, 0.0])
OF_GUYS = "of guys, whose first normals are in their vertical planes; try: modes of a cable 12 degrees or more from the vertical"


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
    """Return the shapes in and out of the plane: the first of modes of layout "normal", or sines.

    A deflection with fewer modes that move, as those of a cable in one plane, has the modes of the other.

    Raises
    ------
    SceneError
        For modes that depend on one another, and of a cable so steep that its normals do not refer to the vertical.
    """
    if modes is None:
        both = sines(rank)
        return both, both
    check_axis(modes, LEVEL, OF_GUYS)
    sigma = modes.arc_length.values / modes.arc_length.values[-1]
    own = [values[:rank] for _, values in sets(modes)]
    most = max(own, key=len)
    shapes = [_of_values(sigma, values if len(values) == len(most) else most) for values in own]
    return shapes[0], shapes[-1]


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
    nodes, weights = gauss_rule(GAUSS_POINTS)
    return ((np.arange(INTERVALS)[:, None] + nodes) / INTERVALS).ravel(), np.tile(weights / INTERVALS, INTERVALS)


def _integrated(basis: Any) -> Shapes:
    sigma, weights = _rule()
    shape, slope = basis(sigma, 0), basis(sigma, 1)
    tilt = (slope * (weights * (sigma - 0.5))) @ slope.T
    return Shapes(basis, (slope * slope) @ weights, shape @ weights, shape @ (weights * sigma), tilt)


@dataclass(frozen=True, eq=False)
class GuySet:
    """Guys in arrays; coordinates q: first those in the vertical plane of the chord, then those out of it [kg^1/2 m].

    Coordinates and upper ends of several states have these as the first dimensions.
    """

    lower: np.ndarray  #: anchors (guys, 3) [m]
    upper: np.ndarray  #: upper ends at rest (guys, 3) [m]
    length: np.ndarray  #: unstretched (guys,) [m]
    stiffness: np.ndarray  #: axial, K (guys,) [N]
    mass: np.ndarray  #: per length, with ice (guys,) [kg/m]
    weight: np.ndarray  #: per unstretched length, with ice (guys,) [N/m]
    strain: np.ndarray  #: at rest, which the terms of second order keep (guys,)
    shapes: tuple[Shapes, Shapes]

    @property
    def count(self) -> int:
        """Number of guys."""
        return len(self.length)

    @cached_property
    def scale(self) -> np.ndarray:
        """Factors of mass-normalised shapes (guys,) [kg^-1/2]."""
        return 1.0 / np.sqrt(self.mass * self.length)

    @cached_property
    def kappa(self) -> np.ndarray:
        """Squared slope norms of the shapes (guys, 2 r) [1/(kg m)]."""
        return np.concatenate([part.slopes for part in self.shapes]) * (self.scale**2 / self.length)[:, None]

    @cached_property
    def moments(self) -> np.ndarray:
        """Integrals of mass times sigma times shape (guys, 2 r) [kg^1/2]."""
        return np.concatenate([part.moments for part in self.shapes]) / self.scale[:, None]

    @cached_property
    def loads(self) -> np.ndarray:
        """Integrals of the shapes in the plane, 0 out of it (guys, 2 r) [m kg^-1/2]."""
        means = np.concatenate([self.shapes[0].means, 0.0 * self.shapes[1].means])
        return means * (self.length * self.scale)[:, None]

    @cached_property
    def tilt(self) -> np.ndarray:
        """Geometric stiffness of a load of one along the chord, for shapes of unit mass (2 r, 2 r)."""
        from scipy.linalg import block_diag

        return block_diag(*(part.tilt for part in self.shapes))

    @property
    def rest_force(self) -> np.ndarray:
        """Chordwise forces that belong to the strain at rest (guys,) [N]."""
        return self.strain * self.stiffness

    def frame(self, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return chord lengths, and axes: from mast to anchor, normal in the vertical plane, normal out of it (guys, 3, 3)."""
        reach = self.lower - upper
        chord = np.sqrt((reach * reach).sum(axis=-1))
        along = reach / chord[..., None]
        x, y, z = np.moveaxis(along, -1, 0)
        flat = np.sqrt(x * x + z * z)
        beside = np.abs(flat) > 1e-12  # else along the mast: any vertical plane
        flat = np.where(beside, flat, 1.0)
        first = np.stack([-y * x / flat, flat, -y * z / flat], axis=-1)
        first[~beside] = [1.0, 0.0, 0.0]
        return chord, np.stack([along, first, np.cross(first, along)], axis=-2)

    def _tension(self, q: np.ndarray, chord: np.ndarray) -> np.ndarray:
        """Return the mean chordwise forces (guys,) [N]."""
        sag = 0.5 * (1.0 - 2.0 * self.strain) * (self.kappa * q * q).sum(axis=-1)
        return closure_tension(self.stiffness, chord / self.length, 0.0, self.stiffness * sag / self.length)

    def forces(self, q: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return forces on coordinates (guys, 2 r) and on the ends at fixed coordinates (guys, 3): slopes of minus the energy."""
        chord, axes = self.frame(upper)
        along_load, normal_load = -self.weight * axes[..., 0, 1], -self.weight * axes[..., 1, 1]
        tension, tilted = self._tension(q, chord), q @ self.tilt * (self.scale**2)[:, None]
        factor = tension * (1.0 - 2.0 * self.strain) + self.strain * self.rest_force
        on_q = (
            -factor[..., None] * self.kappa * q - along_load[..., None] * tilted + normal_load[..., None] * self.loads
        )
        turning = 0.5 * (q * tilted).sum(axis=-1) * normal_load + (self.loads * q).sum(axis=-1) * along_load
        on_end = tension[..., None] * axes[..., 0, :] + (turning / chord)[..., None] * axes[..., 1, :]
        on_end[..., 1] -= 0.5 * self.weight * self.length
        return on_q, on_end

    def energy(self, q: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Return the potential energies (guys,) [J], of which :meth:`forces` are the negative slopes."""
        chord, axes = self.frame(upper)
        elastic = 0.5 * self.length / self.stiffness * self._tension(q, chord) ** 2
        elastic += 0.5 * self.strain * self.rest_force * (self.kappa * q * q).sum(axis=-1)
        tilted = q @ self.tilt * (self.scale**2)[:, None]
        hanging = 0.5 * axes[..., 0, 1] * (q * tilted).sum(axis=-1) - axes[..., 1, 1] * (self.loads * q).sum(axis=-1)
        return elastic - self.weight * hanging + 0.5 * self.weight * self.length * upper[..., 1]

    def tangent(self, q: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Return the second derivatives of the energy by (q, upper): (guys, 2 r + 3, 2 r + 3), by complex steps."""
        r, step = q.shape[1], 1e-30
        count = r + 3
        state = np.repeat(np.concatenate([q, upper], axis=1).astype(complex)[None], count, axis=0)
        state[np.arange(count), :, np.arange(count)] += 1j * step
        slopes = np.concatenate(self.forces(state[..., :r], state[..., r:]), axis=-1).imag  # of all columns at once
        return np.ascontiguousarray(np.moveaxis(-slopes / step, 0, -1))

    def rest(self, upper: np.ndarray, forces: Any = None) -> np.ndarray:
        """Return the coordinates in equilibrium (guys, 2 r).

        Parameters
        ----------
        upper
            Upper ends (guys, 3) [m].
        forces
            Function of the coordinates that returns all forces on them, in place of :meth:`forces`.

        Raises
        ------
        SceneError
            Where no equilibrium is found.
        """
        (_, axes), r = self.frame(upper), self.kappa.shape[1]
        taut = np.maximum(self.rest_force, 1e-9)[:, None] * self.kappa
        q = self.loads * (-self.weight * axes[:, 1, 1])[:, None] / taut
        for _ in range(MAX_ITERATIONS):
            out = self.forces(q, upper)[0] if forces is None else forces(q)
            change = np.linalg.solve(self.tangent(q, upper)[:, :r, :r], out[:, :, None])[:, :, 0]
            q = q + change
            if not np.isfinite(q).all():
                break
            if (np.abs(change).max(axis=1) <= RTOL * np.abs(q).max(axis=1)).all():
                return q
        raise SceneError('guy: the condensed model of a guy has no rest; allowed: taut guys; try: guys="chain"')


def guy_set(guys: Sequence[StaticGuy], upper: Any, shapes: tuple[Shapes, Shapes]) -> GuySet:
    """Make the condensed models of guys at rest with their upper ends at `upper` (guys, 3) [m]."""
    upper = np.array(upper, dtype=float).reshape(-1, 3)
    ends = GuyStatics(guys, upper).tensions
    stiffness = np.array([guy.p.stiffness for guy in guys])
    return GuySet(
        np.array([guy.p.lower for guy in guys]).reshape(-1, 3),
        upper,
        np.array([guy.length for guy in guys]),
        stiffness,
        np.array([guy.p.mass for guy in guys], dtype=float),
        np.array([-float(guy.p.weight[1]) for guy in guys]),
        0.5 * ends.sum(axis=1) / stiffness,
        shapes,
    )
