"""Drag on a motion of the condensed model at given instants: what the error estimate and the end forces need of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.condensed._air import CondensedAir


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
        shapes, slopes = air.shapes
        sets = air.model.sets
        velocity = air.velocity_at(times)
        tangent = np.empty_like(velocity)
        tangent[:, 0] = stretch[:, None]
        for k, which in enumerate(sets, start=1):
            tangent[:, k] = q[:, which] @ slopes[:, which].T
            velocity[:, k] -= rates[:, which] @ shapes[:, which].T
        square = (tangent * tangent).sum(axis=1)
        velocity -= ((velocity * tangent).sum(axis=1) / square)[:, None] * tangent
        size = air.air.drag * np.sqrt(square * (velocity * velocity).sum(axis=1))
        force = size[:, None] * velocity
        return cls(air, force[:, 0], force[:, 1:], tangent[:, 1:], float(size.mean()))

    def on(self, shapes: np.ndarray, n_in_plane: int) -> np.ndarray:
        """Return the forces on shapes at the points (points, R), the first `n_in_plane` in plane: (times, R)."""
        weighted = self.air.rule[1][:, None] * shapes
        parts = [self.normal[:, 0] @ weighted[:, :n_in_plane]]
        parts += [self.normal[:, k] @ weighted[:, n_in_plane:] for k in range(1, self.normal.shape[1])]
        return np.concatenate(parts, axis=1)

    def by_tension(self, slopes: np.ndarray, n_in_plane: int) -> np.ndarray:
        """Return the forces on shapes by the change of the chordwise force that the drag along the chord makes.

        That change is -(integral of the drag), less its mean, which the closure takes away.  `slopes` are those of the shapes
        (points, R); the result is (times, R).
        """
        sigma, weights = self.air.rule
        length = weights.sum()
        integral = _integration(sigma) * length
        tau = -(self.along @ integral.T)
        tau -= (tau @ weights / length)[:, None]
        weighted = weights[:, None] * slopes
        parts = [-(tau * self.slope[:, 0]) @ weighted[:, :n_in_plane]]
        parts += [-(tau * self.slope[:, k]) @ weighted[:, n_in_plane:] for k in range(1, self.slope.shape[1])]
        return np.concatenate(parts, axis=1)

    @property
    def moments(self) -> np.ndarray:
        """Moments of the drag about the lower end over the length, along the normals (times, normals) [N]."""
        sigma, weights = self.air.rule
        return self.normal @ (weights * sigma)


def _integration(sigma: np.ndarray) -> np.ndarray:
    """Return the matrix from values at points to the integrals from 0 to them of their polynomial (points, points)."""
    powers = np.arange(sigma.size)
    centred = 2.0 * sigma - 1.0
    vandermonde = np.polynomial.legendre.legvander(centred, sigma.size - 1)
    integrals = np.empty_like(vandermonde)
    for k in powers:
        coefficients = np.polynomial.legendre.legint(np.eye(sigma.size)[k], lbnd=-1.0)
        integrals[:, k] = 0.5 * np.polynomial.legendre.legval(centred, coefficients)
    return integrals @ np.linalg.inv(vandermonde)
