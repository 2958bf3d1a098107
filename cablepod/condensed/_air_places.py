"""Points at which the wind acts on the condensed model: Gauss points along the parts of a cable, and bodies."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.condensed._coefficients import Coefficients
from cablepod.scene._wind_field import linear_between

#: Distance of a particle from a border of parts that counts as none, over the length.
AT_BORDER = 1e-9
#: Points of the rule by which shapes are projected, over those of a part.
FINE = 3


class AirPlaces(NamedTuple):
    """Places at which the wind acts: those of one part are Gauss points, and shapes are smooth between its borders."""

    parts: tuple[tuple[float, float, int], ...]  #: borders as fractions of the length, and number of points
    bodies: tuple[float, ...]  #: places of bodies, fractions of the length

    @classmethod
    def of(cls, model: Coefficients, count: int, extra: int) -> AirPlaces:
        """Return the places along a model, `count` points for a uniform cable; parts have `extra` points for the borders."""
        if model.is_uniform:
            return cls(((0.0, 1.0, count),), ())
        p, attached = model.chain.p, model.chain.attached_fractions
        borders = sorted({0.0, 1.0, *attached, *(segment.end for segment in p.segments)})
        parts = tuple(
            (begin, end, math.ceil((count - extra) * (end - begin)) + extra)
            for begin, end in itertools.pairwise(borders)
            if end - begin > AT_BORDER
        )
        bodies = zip(p.attachments, attached, strict=True)
        return cls(parts, tuple(fraction for attachment, fraction in bodies if attachment.drag_area))

    @property
    def sigma(self) -> np.ndarray:
        """Relative arc lengths of the points and bodies (points,)."""
        parts = [begin + (end - begin) * gauss_rule(count)[0] for begin, end, count in self.parts]
        return np.concatenate([*parts, np.array(self.bodies)])

    def weights(self, length: float) -> np.ndarray:
        """Return the weights of the points, 0 of bodies, for a length [m] (points,) [m]."""
        parts = [length * (end - begin) * gauss_rule(count)[1] for begin, end, count in self.parts]
        return np.concatenate([*parts, np.zeros(len(self.bodies))])

    def shapes(self, model: Coefficients, values: np.ndarray) -> list[np.ndarray]:
        """Return shapes (r, particle) at the places, their slopes, and the shapes that loads act on (r, points) each.

        Integrals of the first with polynomials of a degree below the number of points of a part are kept.  Those of the last are
        the sums over the particles: loads are lumped there as in the chain, which on n links changes them by (pi / n)^2 / 12.
        """
        from scipy.interpolate import CubicSpline

        place, total = model.chain.arc_length / model.chain.total_length, model.chain.total_length
        moved, slopes, loads = [], [], []
        for begin, end, count in self.parts:
            nodes, weights = gauss_rule(FINE * count)
            inside = place[(place > begin + AT_BORDER) & (place < end - AT_BORDER)]
            own = np.concatenate([[begin], inside, [end]])
            of_own, relative = linear_between(place, values, own), (own - begin) / (end - begin)
            spline = CubicSpline(relative, of_own, axis=1)  # of three particles a parabola, of two a line
            lumped = 0.5 * (np.diff(relative, prepend=0.0) + np.diff(relative, append=1.0))
            moved.append(spline(nodes) @ projection(count, nodes, weights).T)
            slopes.append(spline(gauss_rule(count)[0], 1) / ((end - begin) * total))
            loads.append(of_own @ projection(count, relative, lumped).T)
        of_bodies = linear_between(place, values, np.array(self.bodies))  # which have no direction
        parts = [*moved, of_bodies], [*slopes, 0.0 * of_bodies], [*loads, of_bodies]
        return [np.concatenate(part, axis=1) for part in parts]


def projection(count: int, at: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the matrix from values between 0 and 1 to those at Gauss points of the same sums with polynomials (count, places).

    `weights` are those of the values in these sums; polynomials have a degree below the number of points.
    """
    inner, inner_weights = gauss_rule(count)
    legvander = np.polynomial.legendre.legvander
    lagrange = np.linalg.inv(legvander(2.0 * inner - 1.0, count - 1).T) @ legvander(2.0 * at - 1.0, count - 1).T
    return lagrange * weights / inner_weights[:, None]


@lru_cache(16)
def projection_matrix(places: AirPlaces, of_air: bytes) -> np.ndarray:
    """Return the matrix from values at points of the air to those at the places.

    Integrals of the velocity times polynomials of a degree below the number of Gauss points of a part are kept.  Single values,
    as bodies have them, would alias gusts that are shorter than the distance of these points.  `of_air` are the bytes of the
    relative arc lengths of the points of the air, between which values are linear.
    """
    given = np.frombuffer(of_air)
    unit, rows = np.eye(given.size)[:, :, None], []
    for begin, end, count in places.parts:
        inner, inner_weights = gauss_rule(count)
        borders = np.unique(np.concatenate([[0.0, 1.0], np.clip((given - begin) / (end - begin), 0.0, 1.0)]))
        width = np.diff(borders)  # the rule is exact on each interval between two points
        sigma = (borders[:-1, None] + width[:, None] * inner).ravel()
        parts = (width[:, None] * inner_weights).ravel()
        hats = linear_between(given, unit, begin + (end - begin) * sigma)[:, :, 0]
        rows.append(projection(count, sigma, parts) @ hats.T)
    rows.append(linear_between(given, unit, np.array(places.bodies))[:, :, 0].T)
    return np.concatenate(rows)
