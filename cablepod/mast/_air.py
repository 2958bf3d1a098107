"""Air on a mast and its guys: points, mean wind and turbulence, samples for the kernels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from cablepod.errors import scene_error
from cablepod.parameters._mast import MastParameters
from cablepod.wind._air import INTERVAL, MIN_REFINED, REFINEMENT, instants_until, smooth_step
from cablepod.wind._profile import mean_speed
from cablepod.wind._turbulence import across_of, direction_of, gusts

#: Points of the air along each guy, and along the mast.
GUY_POINTS, MAST_POINTS = 9, 17
#: Number of fields that are kept.
KEPT_FIELDS = 4


@dataclass(frozen=True, eq=False)
class MastAir:
    """Velocity of the air at points of the mast and its guys at rest in still air."""

    p: MastParameters
    end_time: float  #: [s]

    @cached_property
    def positions(self) -> np.ndarray:
        """Points: those of the mast from below, then those of the chord of each guy from its anchor (points, 3) [m].

        Chords do not depend on tension or ice, so that masts which differ in these share their wind.
        """
        height = np.linspace(0.0, self.p.height, MAST_POINTS)
        mast = np.stack([0.0 * height, height, 0.0 * height], axis=1)
        sigma = np.linspace(0.0, 1.0, GUY_POINTS)[:, None]
        chords = [guy.p.lower + sigma * (guy.p.upper - guy.p.lower) for guy in self.p.guys]
        position = np.concatenate([mast, *chords])
        assert self.p.wind is not None
        ground, lowest = float(self.p.wind["ground"]), float(position[:, 1].min())
        if lowest < ground - 1e-9 * self.p.height:
            raise scene_error(
                "wind.ground", ground, f"at most the lowest anchor and the foot of the mast, {lowest:g} m"
            )
        return position

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean velocity at the points (points, 3) [m/s]."""
        assert self.p.wind is not None
        height = self.positions[:, 1] - float(self.p.wind["ground"])
        return mean_speed(self.p.wind, height)[:, None] * direction_of(self.p.wind)

    @cached_property
    def velocity(self) -> np.ndarray:
        """Velocity at the points (samples, points, 3) [m/s], sampled as the turbulence is; two samples of a steady one."""
        p = self.p
        assert p.wind is not None
        ramp = float(p.wind["ramp"])
        if p.turbulence is None and not ramp:
            return np.repeat(self.mean[None], 2, axis=0)
        count = instants_until(self.end_time)
        total = np.tile(self.mean, (count, 1, 1))
        if p.turbulence is not None and float(p.wind["speed"]):
            total += _turbulence(_Content(p.wind, p.turbulence, self.positions), count)
        if ramp:
            total *= smooth_step(np.arange(count) * INTERVAL / ramp)[:, None, None]
        return total

    @property
    def samples_per_second(self) -> float:
        """Samples of :func:`cablepod.wind._air.refined` velocities per second."""
        return (REFINEMENT if len(self.velocity) >= MIN_REFINED else 1) / INTERVAL

    @property
    def start(self) -> np.ndarray:
        """Steady velocity from which runs start, 0 with a ramp (points, 3) [m/s]."""
        assert self.p.wind is not None
        return 0.0 * self.mean if float(self.p.wind["ramp"]) else self.mean

    def of_guys(self, velocity: np.ndarray) -> np.ndarray:
        """Return the part of the guys of velocities (..., points, 3): (..., guys, points, 3)."""
        return velocity[..., MAST_POINTS:, :].reshape(*velocity.shape[:-2], len(self.p.guys), GUY_POINTS, 3)

    def at_nodes(self, height: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return velocities at heights of the mast in x and z (..., nodes, 2), linear between the points."""
        place = height / self.p.height * (MAST_POINTS - 1)
        left = np.minimum(place.astype(int), MAST_POINTS - 2)
        share = (place - left)[:, None]
        points = velocity[..., :MAST_POINTS, :][..., (0, 2)]
        return np.ascontiguousarray((1.0 - share) * points[..., left, :] + share * points[..., left + 1, :])


class _Content:
    """Wind and points, compared by their values."""

    def __init__(self, wind: Mapping[str, Any], turbulence: Mapping[str, Any], positions: np.ndarray) -> None:
        self.wind, self.turbulence, self.positions = wind, turbulence, positions
        tables = [
            (name, np.asarray(value).tolist()) for table in (wind, turbulence) for name, value in sorted(table.items())
        ]
        self.key = (repr(tables), positions.tobytes())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Content) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@lru_cache(KEPT_FIELDS)
def _turbulence(content: _Content, count: int) -> np.ndarray:
    """Return the turbulence at the points (samples, points, 3) [m/s]; kept, as masts of one place share it."""
    from scipy.fft import next_fast_len

    wind, positions = content.wind, content.positions
    whole, seed = next_fast_len(count + 1), int(content.turbulence["seed"])
    total = np.zeros((count, *positions.shape))
    across = across_of(wind)
    assert across is not None
    for vector, is_across in ((direction_of(wind), False), (across, True)):
        part = gusts(wind, content.turbulence, positions, whole, INTERVAL, seed, across=is_across)[:, :count].T
        for component, share in enumerate(vector):
            if share:
                total[..., component] += part * share
    return total


def mast_air(p: MastParameters, end_time: float) -> MastAir | None:
    """Return the air on a mast from 0 to `end_time` [s]; None in still air."""
    return None if p.wind is None else _kept(p, max(end_time, p.duration or 0.0))


@lru_cache(4)
def _kept(p: MastParameters, end_time: float) -> MastAir:
    return MastAir(p, end_time)


def to_gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places and weights of Gauss points, and the matrix from the points of a guy's air to them.

    Integrals of the velocity times polynomials of a degree below `count` are kept: single values would alias short gusts.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    places, weights = 0.5 * (1.0 + nodes), 0.5 * weights
    knots = np.linspace(0.0, 1.0, GUY_POINTS)
    width = np.diff(knots)
    sigma = (knots[:-1, None] + 0.5 * width[:, None] * (1.0 + nodes)).ravel()
    parts = (0.5 * width[:, None] * 2.0 * weights).ravel()
    lagrange = np.ones((count, sigma.size))
    for g, node in enumerate(places):
        for other in np.delete(places, g):
            lagrange[g] *= (sigma - other) / (node - other)
    hats = np.maximum(0.0, 1.0 - np.abs(sigma[:, None] - knots) * (GUY_POINTS - 1))
    return places, weights, (lagrange * parts) @ hats / weights[:, None]
