"""Velocity of the air on a mast and its guys: at points that the scene alone fixes, of the scene, a record or a given field."""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import xarray as xr

from cablepod._inputs import ROUNDING
from cablepod.errors import SceneError
from cablepod.parameters._mast import MastParameters
from cablepod.parameters._parameters import gust_interval, has_record, ramp_of
from cablepod.parameters._time_functions import smooth_step
from cablepod.scene._mast_field import GUY_POINTS, MAST_POINTS, at_mast_points, mast_points
from cablepod.scene._wind_field import field_of_record, key_of_record
from cablepod.wind._air import (
    SAMPLES_TOGETHER,
    ByKey,
    density_of,
    instants_until,
    key_of_wind,
    mean_velocity,
    resampled,
    rising,
    turbulence_at,
    warn_of_other_mean,
)
from cablepod.wind._drag import drag_of, drag_rate
from cablepod.wind._turbulence import direction_of

#: Number of fields that are kept, as masts of one place share them.
KEPT_FIELDS = 6
_LOCK = threading.RLock()


@dataclass(frozen=True, eq=False)
class MastAir:
    """Velocity of the air at points of a mast and of the chords of its guys."""

    positions: np.ndarray  #: points of the mast from below, then of each guy from its anchor (points, 3) [m]
    velocity: np.ndarray  #: (samples, points, 3) [m/s]; two samples of a steady one
    samples_per_second: float
    mean: np.ndarray  #: mean velocity at the points (points, 3) [m/s]
    start: np.ndarray  #: steady velocity from which runs start, 0 with a ramp (points, 3) [m/s]
    density: float  #: of the air [kg/m3]
    has_profile: bool  #: whether the air at rest is that of [wind]
    ramp: float = 0.0  #: time in which the wind rises [s]

    @property
    def guys(self) -> int:
        """Number of guys."""
        return (len(self.positions) - MAST_POINTS) // GUY_POINTS

    @property
    def height(self) -> float:
        """Height of the mast [m]."""
        return float(self.positions[MAST_POINTS - 1, 1])

    @property
    def growth(self) -> np.ndarray:
        """Factor of the ramp at the samples (samples,)."""
        count = len(self.velocity)
        return smooth_step(np.arange(count) / self.samples_per_second / self.ramp) if self.ramp else np.ones(count)

    def of_guys(self, velocity: np.ndarray) -> np.ndarray:
        """Return the part of the guys of velocities (..., points, 3): (..., guys, points, 3)."""
        return velocity[..., MAST_POINTS:, :].reshape(*velocity.shape[:-2], self.guys, GUY_POINTS, 3)

    def drag_rate(self, p: MastParameters) -> float:
        """Return a bound of the rate at which drag takes away a motion of the guys along the wind [1/s]."""
        squared = np.zeros(len(self.positions))
        for first in range(0, len(self.velocity), SAMPLES_TOGETHER):
            own = self.velocity[first : first + SAMPLES_TOGETHER] ** 2
            squared = np.maximum(squared, (own[..., 0] + own[..., 1] + own[..., 2]).max(axis=0))
        speed = np.sqrt(squared[MAST_POINTS:].reshape(-1, GUY_POINTS).max(axis=1))
        rates = [drag_rate(drag_of(guy.p, self.density), guy.p.mass, u) for guy, u in zip(p.guys, speed, strict=True)]
        return float(max(rates, default=0.0))

    def of_mast(self, velocity: np.ndarray) -> np.ndarray:
        """Return the part of the mast of velocities (..., points, 3), in x and z (..., points, 2)."""
        return velocity[..., :MAST_POINTS, ::2]

    def weights_at(self, height: np.ndarray) -> np.ndarray:
        """Return the weights of the points of the mast at heights [m], linear between them (heights, points)."""
        place = np.asarray(height)[:, None] / self.height * (MAST_POINTS - 1)
        return np.maximum(0.0, 1.0 - np.abs(place - np.arange(MAST_POINTS)))


def mast_air(p: MastParameters, end_time: float, given: xr.Dataset | None = None) -> MastAir | None:
    """Return the air on a mast from 0 to `end_time` [s]; None in still air.

    Parameters
    ----------
    p
        Parameters of the scene.
    end_time
        End of the run [s].
    given
        Field, as of :func:`cablepod.wind.field`, in place of that of the scene, whose density, drag and ramp it has.

    Raises
    ------
    SceneError
        For guys without diameter, a field without points on mast and guys, and one that does not cover the run.
    """
    if given is None and p.wind is None:
        return None
    with _LOCK:  # members that share a field wait for it
        if given is not None:
            for guy in p.guys:
                if guy.p.diameter is None:
                    raise SceneError(
                        f"cables.{guy.name}.diameter: missing; allowed: a diameter [m], on which the wind acts"
                    )
            return _of_field(_content(p, end_time, given, "wind"))
        return _of_scene(_content(p, max(end_time, p.duration or 0.0)))


def mean_mast_air(p: MastParameters) -> MastAir | None:
    """Return the mean wind of a scene on a mast, 0 with a ramp; None in still air."""
    return mast_air(p if has_record(p) else replace(p, turbulence=None), 0.0)


def _content(p: MastParameters, end_time: float, given: xr.Dataset | None = None, key: str = "") -> ByKey:
    """Return what determines the air on a mast: parameters, end of the run, and of a given field what is taken of it."""
    taken, digest = None, hashlib.sha256(mast_points(p)[0].tobytes())
    if given is not None:  # checked before it is hashed
        time, velocity, mean = at_mast_points(p, end_time, given, key)
        taken = (*resampled(time, velocity), mean)
        for values in taken:
            digest.update(np.ascontiguousarray(values).tobytes())
    return ByKey((key_of_wind(p), float(end_time), digest.hexdigest()), (p, end_time, taken))


@lru_cache(KEPT_FIELDS)
def _of_scene(content: ByKey) -> MastAir:
    """Return the air of the tables [wind] and [wind.turbulence]."""
    p, end_time, _ = content.values
    assert p.wind is not None
    if has_record(p):
        return _of_record(p, end_time)
    position = mast_points(p)[0]
    mean = mean_velocity(p, position[:, 1])
    if p.turbulence is None and not ramp_of(p):
        velocity = np.repeat(mean[None], 2, axis=0)
    else:
        velocity = np.zeros((instants_until(p, end_time, mean.size), *mean.shape))
        if p.turbulence is not None and float(p.wind["speed"]):
            velocity = turbulence_at(p, position, end_time, _order_in_wind(p))[: len(velocity)]
        velocity += mean
    return _ramped(
        p, MastAir(position, velocity, 1.0 / gust_interval(p), mean, mean, float(p.wind["air_density"]), True)
    )


def _order_in_wind(p: MastParameters) -> np.ndarray:
    """Return the points of :func:`mast_points` in the order of their gusts: mast, then guys by level and angle to the wind.

    A mast of equal guys in a wind turned from one guy to the next one has the turned gusts.  The angle is that from upwind to the
    anchor, from +x to +z; guys of one level and angle are in their order.
    """
    assert p.wind is not None
    x, _, z = direction_of(p.wind)
    upwind = np.arctan2(-z, -x)
    keys = []
    for guy in p.guys:
        angle = (np.arctan2(guy.p.lower[2], guy.p.lower[0]) - upwind) / (2.0 * np.pi)
        keys.append((round(guy.level, 9), round(float(angle), 9) % 1.0))
    order = sorted(range(len(keys)), key=lambda g: (*keys[g], g))
    guys = MAST_POINTS + GUY_POINTS * np.array(order, dtype=int)[:, None] + np.arange(GUY_POINTS)
    return np.concatenate([np.arange(MAST_POINTS), guys.ravel()])


@lru_cache(2)
def _of_field(content: ByKey) -> MastAir:
    """Return the air of a given field, with the ramp of the scene."""
    p, _, (rate, velocity, mean) = content.values
    position = mast_points(p)[0]
    profile = mean_velocity(p, position[:, 1]) if p.wind is not None else None
    has_profile = profile is not None and bool(np.allclose(mean, profile, rtol=ROUNDING, atol=1e-9))
    return _ramped(p, MastAir(position, velocity, rate, mean, mean, density_of(p), has_profile))


def _of_record(p: MastParameters, end_time: float) -> MastAir:
    """Return the air of wind.turbulence.record."""
    air = _of_field(_content(p, end_time, field_of_record(p), key_of_record(p)))
    warn_of_other_mean(air.mean, mean_velocity(p, air.positions[:, 1]), "on mast and guys")
    return air


def _ramped(p: MastParameters, air: MastAir) -> MastAir:
    """Return the air with the ramp of the scene, if there is one."""
    ramp = ramp_of(p)
    if not ramp:
        return air
    velocity, parts = rising(air.velocity, air.samples_per_second, ramp)
    rate = air.samples_per_second * parts
    return replace(air, velocity=velocity, samples_per_second=rate, start=0.0 * air.mean, ramp=ramp)
