"""Points at which the wind acts on the condensed model: Gauss points along the parts of a cable, and bodies."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.condensed._coefficients import Coefficients
from cablepod.condensed._kernels_layout import POINTS_IN_VECTOR
from cablepod.wind._air import linear_between

#: Distance of a particle from a border of parts that counts as none, over the length.
AT_BORDER = 1e-9
#: Minimum number of particles of a part whose shapes are interpolated by splines; linearly below.
FOR_SPLINE = 4


@lru_cache(16)
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes from -1 to 1 and weights of Gauss's rule."""
    return np.polynomial.legendre.leggauss(count)


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
        parts = [begin + (end - begin) * (0.5 * (1.0 + gauss(count)[0])) for begin, end, count in self.parts]
        return np.concatenate([*parts, np.array(self.bodies)])

    def weights(self, length: float) -> np.ndarray:
        """Return the weights of the points, 0 of bodies, for a length [m] (points,) [m]."""
        parts = [(0.5 * length * (end - begin)) * gauss(count)[1] for begin, end, count in self.parts]
        return np.concatenate([*parts, np.zeros(len(self.bodies))])

    def interpolated(self, model: Coefficients, values: np.ndarray, derivatives: tuple[int, ...]) -> list[np.ndarray]:
        """Interpolate values (r, particle), or first derivatives of them by arc length, at the places (points, r)."""
        from scipy.interpolate import CubicSpline

        place, total = model.chain.arc_length, model.chain.total_length
        if model.is_uniform:
            spline = CubicSpline(place, values, axis=1)
            return [spline(self.sigma * total, order).T for order in derivatives]
        results: list[list[np.ndarray]] = [[] for _ in derivatives]
        first = 0
        for begin, end, count in self.parts:
            at = self.sigma[first : first + count] * total
            inside = (place >= (begin - AT_BORDER) * total) & (place <= (end + AT_BORDER) * total)
            own = place[inside]
            ends_there = own.size >= FOR_SPLINE and np.ptp(own) > (end - begin - 4.0 * AT_BORDER) * total
            if ends_there:
                spline = CubicSpline(own, values[:, inside], axis=1)
            for result, order in zip(results, derivatives, strict=True):
                result.append(spline(at, order) if ends_there else _linear(place, values, at, order))
            first += count
        for result, order in zip(results, derivatives, strict=True):
            result.append(_linear(place, values, np.array(self.bodies) * total, order))
        return [np.concatenate(result, axis=1).T for result in results]


def _linear(place: np.ndarray, values: np.ndarray, at: np.ndarray, order: int) -> np.ndarray:
    """Interpolate values (r, particle) linearly, or return their slopes (r, points)."""
    left = np.clip(np.searchsorted(place, at, side="right") - 1, 0, place.size - 2)
    slope = (values[:, left + 1] - values[:, left]) / (place[left + 1] - place[left])
    return slope if order else values[:, left] + slope * (at - place[left])


@lru_cache(16)
def projection_matrix(places: AirPlaces, of_air: bytes) -> np.ndarray:
    """Return the matrix from values at points of the air to those at the places, filled up.

    Integrals of the velocity times polynomials of a degree below the number of Gauss points of a part are kept.  Single values,
    as bodies have them, would alias gusts that are shorter than the distance of these points.  `of_air` are the bytes of the
    relative arc lengths of the points of the air, between which values are linear.
    """
    given = np.frombuffer(of_air)
    unit, rows = np.eye(given.size)[:, :, None], []
    for begin, end, count in places.parts:
        inner, inner_weights = gauss(count)
        nodes, weights = 0.5 * (1.0 + inner), 0.5 * inner_weights
        borders = np.unique(np.concatenate([[0.0, 1.0], np.clip((given - begin) / (end - begin), 0.0, 1.0)]))
        width = np.diff(borders)  # the rule is exact on each interval between two points
        sigma = (borders[:-1, None] + 0.5 * width[:, None] * (1.0 + inner)).ravel()
        parts = (0.5 * width[:, None] * inner_weights).ravel()
        lagrange = np.ones((count, sigma.size))
        for g, node in enumerate(nodes):
            for other in np.delete(nodes, g):
                lagrange[g] *= (sigma - other) / (node - other)
        hats = linear_between(given, unit, begin + (end - begin) * sigma)[:, :, 0]
        rows.append((lagrange * parts) @ hats.T / weights[:, None])
    rows.append(linear_between(given, unit, np.array(places.bodies))[:, :, 0].T)
    return filled_up(np.concatenate(rows))


def filled_up(values: np.ndarray) -> np.ndarray:
    """Return values at points (points, ...) with zeros at the points that the kernels take beyond them."""
    missing = -len(values) % POINTS_IN_VECTOR
    return np.concatenate([values, np.zeros((missing, *values.shape[1:]))])
