"""Drag on a motion of the condensed model at given instants: what the error estimate and the end forces need of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._air_places import AirPlaces
from cablepod.wind._drag import body_drag, straight_drag


@dataclass(frozen=True)
class DragOfMotion:
    """Drag per unstretched length at the Gauss points of the air."""

    air: CondensedAir
    along: np.ndarray  #: along the chord (times, points) [N/m]
    normal: np.ndarray  #: along the normals (times, normals, points) [N/m]
    slope: np.ndarray  #: slopes of the deflections (times, normals, points)
    damping: float  #: mean size of the drag over that of the normal velocity [kg/(m s)]

    @classmethod
    def of(
        cls, air: CondensedAir, times: np.ndarray, q: np.ndarray, rates: np.ndarray, stretch: np.ndarray
    ) -> DragOfMotion:
        """Compute the drag on coordinates and rates (times, r) with the mean chordwise stretch (times,)."""
        shapes, slopes, _ = air.shapes
        sets = air.model.sets
        velocity = air.velocity_at(times)
        tangent = np.empty_like(velocity)
        tangent[:, 0] = stretch[:, None]
        for k, which in enumerate(sets, start=1):
            tangent[:, k] = q[:, which] @ slopes[which]
            velocity[:, k] -= rates[:, which] @ shapes[which]
        bodies, of_bodies = air.bodies, np.zeros(0)
        if bodies is not None:
            of_bodies = body_drag(bodies.drag, velocity[:, :, bodies.points], axis=1)
        force, size = straight_drag(air.air.drag * air.drag_ratios, tangent, velocity, axis=1)
        if bodies is not None:  # along the chord theirs is a load of the model
            force[:, :, bodies.points] = of_bodies
            force[:, 0, bodies.points] = 0.0
        damping = float(size.mean()) if air.model.is_uniform else float(size.mean(axis=0)[: air.wire_points].min())
        return cls(air, force[:, 0], force[:, 1:], tangent[:, 1:], damping)

    def on(self, shapes: np.ndarray, n_in_plane: int) -> np.ndarray:
        """Return the forces on shapes of loads at the points (R, points), the first `n_in_plane` in plane: (times, R)."""
        return _on_normals(self.normal, self.air.weights_of_forces * shapes, n_in_plane)

    def by_tension(self, slopes: np.ndarray, n_in_plane: int) -> np.ndarray:
        """Return the forces on shapes by the change of the chordwise force that the drag along the chord makes.

        That change is -(integral of the drag), less its mean, which the closure takes away.  `slopes` are those of the shapes
        (R, points); the result is (times, R).
        """
        _, weights = self.air.rule
        length = weights.sum()
        integral = _integration(self.air.places) * length
        tau = -(self.along @ integral.T)
        tau -= (tau @ weights / length)[:, None]
        return _on_normals(-tau[:, None] * self.slope, weights * slopes, n_in_plane)

    @property
    def moments(self) -> np.ndarray:
        """Moments of the drag about the lower end over the length, along the normals (times, normals) [N]."""
        sigma, weights = self.air.rule
        return self.normal @ (weights * sigma)


def _on_normals(forces: np.ndarray, weighted: np.ndarray, n_in_plane: int) -> np.ndarray:
    """Sum forces along the normals (times, normals, points) times weighted shapes (R, points), in plane and out of it."""
    parts = [weighted[:n_in_plane], weighted[n_in_plane:]][: forces.shape[1]]
    return np.concatenate([forces[:, k] @ part.T for k, part in enumerate(parts)], axis=1)


def _integration(places: AirPlaces) -> np.ndarray:
    """Return the matrix from values at points to the integrals from 0 to them of their polynomials by parts (points, points)."""
    sigma, first = places.sigma, 0
    matrix = np.zeros((sigma.size, sigma.size))
    for begin, end, count in places.parts:
        part = slice(first, first + count)
        inner, weights = gauss_rule(count)
        matrix[part, part] = (end - begin) * _integration_of_part(inner)
        matrix[sigma > end, part] = (end - begin) * weights
        first += count
    return matrix


def _integration_of_part(sigma: np.ndarray) -> np.ndarray:
    """Return the matrix from values at points between 0 and 1 to integrals of their polynomial from 0 to these."""
    legendre, centred, count = np.polynomial.legendre, 2.0 * sigma - 1.0, sigma.size
    integrals = 0.5 * legendre.legvander(centred, count) @ legendre.legint(np.eye(count), lbnd=-1.0)
    return integrals @ np.linalg.inv(legendre.legvander(centred, count - 1))
