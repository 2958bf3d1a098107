"""Velocity of the air along a cable, for the models."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import check_bytes
from cablepod.catenary._rest import _rest_of_member
from cablepod.errors import SceneError, warn
from cablepod.parameters._keys import GUST_INTERVAL
from cablepod.parameters._parameters import InWind, Parameters, gust_interval, has_record, ramp_of
from cablepod.parameters._time_functions import smooth_step
from cablepod.scene._wind_field import (
    RECORD,
    check_above_ground,
    checked_field,
    field_of_record,
    key_of_record,
    linear_between,
)
from cablepod.wind._drag import drag_of
from cablepod.wind._profile import mean_speed
from cablepod.wind._turbulence import across_of, direction_of, gusts

#: Number of equidistant points along the cable, whatever the model.
POINTS = 41
#: Arrays of a field while it is made, over the velocities: these, their components, the harmonics of one.
ARRAYS_OF_FIELD = 3
#: Number of samples that are rearranged together, which the caches of a processor hold.
SAMPLES_TOGETHER = 128
#: Where the profile of the mean wind bends, further points halve an interval until straight lines miss this part of the speed at
#: the reference height, averaged over the first interval (0.002: 3e-5 of the deflection of a guy from the ground up; without them
#: 4e-4), at most as many times as this.
PROFILE_ATOL, MAX_HALVINGS = 0.002, 5
#: Samples of the models per sample of a field, and least number of samples of a field that is refined.
REFINEMENT, MIN_REFINED = 4, 7
#: Number of samples of a ramp.
RAMP_SAMPLES = 200
#: Parts of a ramp that steps resolve.
PARTS_OF_RAMP = 10.0
#: Most samples of a resampled field over those given.
MAX_RESAMPLING = 10.0
#: Largest difference of the mean wind of a record from that of [wind] without a warning, over the speed.
MAX_DIFFERENCE = 0.2


@dataclass(frozen=True, eq=False)
class CableAir:
    """Velocity of the air at points of a cable, linear between the points and between the samples, and held after the last."""

    velocity: np.ndarray  #: (samples, points, dims) [m/s]
    sigma: np.ndarray  #: relative arc length of the points (points,)
    samples_per_second: float  #: from t = 0 on [1/s]
    drag: float  #: half the density of the air times drag coefficient and diameter [kg/m2]
    mean: np.ndarray  #: mean velocity of the equilibrium from which runs start, 0 with a ramp (points, dims) [m/s]
    interval: float  #: of the gusts, which the steps of a run resolve [s]; a tenth of a ramp without gusts, infinite without both

    @property
    def steady(self) -> CableAir:
        """The mean wind of the start."""
        velocity = np.repeat(self.mean[None], 2, axis=0)
        return replace(self, velocity=velocity, samples_per_second=1.0, interval=math.inf)

    def at(self, sigma: np.ndarray) -> np.ndarray:
        """Return the velocity (samples, places, dims) [m/s] at relative arc lengths (places,)."""
        return linear_between(self.sigma, self.velocity, sigma)

    def averaged(self, sigma: np.ndarray) -> CableAir:
        """Return this air at relative arc lengths (places,), averaged with the linear shape function of each.

        Few places then carry the load of gusts that are shorter than their distance on the lowest shapes of the cable.
        """
        from scipy.interpolate import make_interp_spline

        given = np.unique([0.0, *np.clip(self.sigma, 0.0, 1.0), 1.0])
        widths = np.diff(sigma)
        tributary = 0.5 * (np.append(widths, 0.0) + np.append(0.0, widths))

        def average(
            velocity: np.ndarray,
        ) -> np.ndarray:  # the second derivative of the shape functions is a sum of deltas
            once = make_interp_spline(given, linear_between(self.sigma, velocity, given), k=1, axis=1).antiderivative()
            slopes = np.diff(once.antiderivative()(sigma), axis=1) / widths[:, None]
            ends = np.concatenate([once(sigma[:1]), slopes, once(sigma[-1:])], axis=1)
            return np.diff(ends, axis=1) / tributary[:, None]

        return replace(self, velocity=average(self.velocity), mean=average(self.mean[None])[0], sigma=sigma)

    @property
    def refinement(self) -> int:
        """Ratio of the samples of :func:`refined` to those of the velocity."""
        return REFINEMENT if len(self.velocity) >= MIN_REFINED else 1

    @property
    def largest_speed(self) -> float:
        """Largest speed of the air [m/s]."""
        return float(np.sqrt((self.velocity * self.velocity).sum(axis=-1)).max())


def air_of(p: Parameters, end_time: float, given: xr.Dataset | None = None) -> CableAir | None:
    """Return the air along the cable of a scene from 0 to `end_time` [s]; None for still air.

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
        For a cable without diameter, a field without points near the cable, and one that does not cover the run.
    """
    if given is None:
        return None if p.wind is None else _of_scene(p, max(end_time, p.duration or 0.0))
    if p.diameter is None:
        raise SceneError("cable.diameter: missing; allowed: a diameter [m], on which the wind acts")
    return _ramped(p, _of_field(p, end_time, given))


def refined(velocity: np.ndarray) -> np.ndarray:
    """Interpolate velocities (samples, ...) at a quarter of their interval, by polynomials through six samples.

    Straight lines between the samples would take away 1 - sinc(n interval)^2 of the gusts of frequency n: 6 % at 1.4 Hz.
    """
    count = len(velocity)
    if count < MIN_REFINED:
        return np.ascontiguousarray(velocity)
    samples = velocity.reshape(count, -1)
    padded = np.concatenate([samples[[0, 0]], samples, samples[[-1, -1]]])  # held beyond the first and the last
    weights = weights_of_samples(count)
    windows = np.lib.stride_tricks.sliding_window_view(padded, weights.shape[1], axis=0).swapaxes(1, 2)
    between = (weights @ windows).reshape(-1, samples.shape[1])
    return np.concatenate([between, samples[-1:]]).reshape(-1, *velocity.shape[1:])


def weights_of_samples(count: int) -> np.ndarray:
    """Return the weights of the samples two before ... three after at the parts of an interval (parts, 6), of `count` samples.

    They are those of a polynomial through the six; a few samples alone are joined by straight lines, between single parts.
    """
    nodes = np.arange(-2.0, 4.0)
    places = np.arange(REFINEMENT) / REFINEMENT if count >= MIN_REFINED else np.zeros(1)
    return np.array([[np.prod([(place - b) / (a - b) for b in nodes if b != a]) for a in nodes] for place in places])


def mean_air_of(p: Parameters) -> CableAir | None:
    """Return the mean wind along the cable of a scene, 0 with a ramp; None for still air.

    Raises
    ------
    SceneError
        For a cable below the ground.
    """
    if p.wind is None:
        return None
    return _of_scene(p if has_record(p) else replace(p, turbulence=None), 0.0).steady


@lru_cache(16)
def _of_scene(p: Parameters, end_time: float) -> CableAir:
    """Return the air of the tables [wind] and [wind.turbulence]."""
    assert p.wind is not None
    if has_record(p):
        return _ramped(p, _of_record(p, end_time))
    sigma, position = rest_points(p)
    ramp, mean = ramp_of(p), mean_velocity(p, position[:, 1])
    if p.turbulence is not None:
        interval = gust_interval(p)
        rate = 1.0 / interval
        content = ByKey((key_of_wind(p), position.tobytes()), (p, position))
        velocity = mean + _kept_turbulence(content, end_time)[: instants_until(p, end_time)]
    else:
        # the last two samples of a ramp are equal, as the wind is steady from there on
        count, rate, interval = (
            (RAMP_SAMPLES + 2, RAMP_SAMPLES / ramp, ramp / PARTS_OF_RAMP) if ramp else (2, 1.0, math.inf)
        )
        velocity = np.repeat(mean[None], count, axis=0)
    return _ramped(p, CableAir(velocity, sigma, rate, drag_of(p, density_of(p)), mean, interval))


def _ramped(p: Parameters, air: CableAir) -> CableAir:
    """Return the air with the ramp of the scene, if there is one."""
    ramp = ramp_of(p)
    if not ramp:
        return air
    velocity, parts = rising(air.velocity, air.samples_per_second, ramp)
    rate, interval = air.samples_per_second * parts, air.interval / parts
    return replace(air, velocity=velocity, samples_per_second=rate, mean=0.0 * air.mean, interval=interval)


def rising(velocity: np.ndarray, rate: float, ramp: float) -> tuple[np.ndarray, int]:
    """Return velocities (samples, points, dims) that rise in a ramp [s], and their number for each given one, `rate` a second.

    A ramp has ten samples, but none closer than those of the gusts of a scene; between given ones the air is :func:`refined`.
    """
    parts = max(1, math.ceil(min(PARTS_OF_RAMP / ramp, 1.0 / GUST_INTERVAL) / rate * (1.0 - 1e-6)))
    if parts > 1:
        given = refined(velocity)
        places = np.linspace(0.0, len(given) - 1.0, (len(velocity) - 1) * parts + 1)
        velocity = linear_between(np.arange(len(given)), given, places, axis=0)
    step = smooth_step(np.arange(len(velocity)) / (rate * parts) / ramp)
    return velocity * step[:, None, None], parts


def density_of(p: InWind) -> float:
    """Return the density of the air [kg/m3]; that of a field without a table [wind] is usual."""
    return 1.25 if p.wind is None else float(p.wind["air_density"])


def rest_points(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return relative arc lengths (points,) and positions (points, dims) [m] of points of the cable at rest in still air.

    Raises
    ------
    SceneError
        If the cable lies below the ground.
    """
    if p.wind is None:
        return np.linspace(0.0, 1.0, POINTS), _rest_of_member(p, POINTS)[0]
    parts = 2**MAX_HALVINGS
    position = _rest_of_member(p, (POINTS - 1) * parts + 1)[0]
    check_above_ground(p, position)
    if p.wind["profile"] == "uniform" or not float(p.wind["speed"]):
        chosen = np.arange(0, len(position), parts)
    else:
        height = position[:, 1] - float(p.wind["ground"])
        chosen = _halved(mean_speed(p.wind, height) / float(p.wind["speed"]), parts)
    return chosen / (len(position) - 1.0), position[chosen]


def _halved(speed: np.ndarray, parts: int) -> np.ndarray:
    """Return the points of a profile that straight lines need: every one of `parts`, and middles where it bends."""
    chosen, k = list(range(0, speed.size, parts)), 0
    while k < len(chosen) - 1:
        first, last = chosen[k : k + 2]
        line = np.linspace(speed[first], speed[last], last - first + 1)
        missed = abs(float((speed[first : last + 1] - line).mean())) * (last - first) / parts
        if last - first > 1 and missed > PROFILE_ATOL:
            chosen.insert(k + 1, (first + last) // 2)
        else:
            k += 1
    return np.array(chosen)


def mean_velocity(p: InWind, height: np.ndarray) -> np.ndarray:
    """Return the mean velocity of the air at heights y of a scene [m] (..., dims) [m/s]."""
    assert p.wind is not None
    return mean_speed(p.wind, height - float(p.wind["ground"]))[..., None] * direction_of(p.wind)


def instants_until(p: InWind, end_time: float, places: int = 1) -> int:
    """Return the number of instants of a field that covers a run until `end_time` [s], of `places` numbers each.

    Refused are more than the memory holds with their harmonics and the models' copy.
    """
    count = math.ceil(end_time / gust_interval(p) * (1.0 - 1e-12)) + 1
    needed = 8.0 * ARRAYS_OF_FIELD * places * count
    check_bytes(needed, "times", f"instants until {end_time:g} s, {needed / 1e9:.3g} GB of wind")
    return count


@dataclass(frozen=True)
class ByKey:
    """What a kept result follows from, equal where the keys are."""

    key: Any
    values: Any = field(compare=False)


def key_of_wind(p: InWind) -> str:
    """Return the tables of the wind as text, equal where their values are."""
    tables = (p.wind or {}, p.turbulence or {})
    return repr([sorted((key, np.asarray(value).tolist()) for key, value in table.items()) for table in tables])


@lru_cache(2)
def _kept_turbulence(content: ByKey, end_time: float) -> np.ndarray:
    """Return :func:`turbulence_at`; kept, as members of an ensemble that differ in other things than the wind share it."""
    p, position = content.values
    return turbulence_at(p, position, end_time)


def turbulence_at(p: InWind, position: np.ndarray, end_time: float, order: np.ndarray | None = None) -> np.ndarray:
    """Return the velocity of the turbulence (samples, points, dims) [m/s], sampled from 0 to `end_time` or later.

    Phases go to the points in their order, or in that of the numbers `order` (points,).  With wind.turbulence.exact_mean the mean
    of the samples from 0 to `end_time` is 0 at every point.
    """
    from scipy.fft import next_fast_len

    assert p.wind is not None
    assert p.turbulence is not None
    count = next_fast_len(instants_until(p, end_time, position.size) + 1)
    total, seed = np.zeros((count, *position.shape)), int(p.turbulence["seed"])
    if not float(p.wind["speed"]):
        return total
    order = np.arange(len(position)) if order is None else order
    components = ((False, direction_of(p.wind)), (True, across_of(p.wind)))
    across, axes = zip(*((is_across, axis) for is_across, axis in components if axis is not None), strict=True)
    parts = gusts(p.wind, p.turbulence, position[order], count, gust_interval(p), seed, across=across)
    back = np.argsort(order)
    for first in range(0, count, SAMPLES_TOGETHER):
        own = [part[:, first : first + SAMPLES_TOGETHER][back].T for part in parts]
        total[first : first + SAMPLES_TOGETHER] = np.stack(own, axis=-1) @ np.array(axes)
    if p.turbulence.get("exact_mean", False):
        total -= total[: instants_until(p, end_time)].mean(axis=0)
    return total


def _of_field(p: Parameters, end_time: float, given: xr.Dataset, key: str = "wind") -> CableAir:
    """Return the air of a given field, without a ramp."""
    time, sigma, velocity, mean = checked_field(p, end_time, given, key)
    rate, velocity = resampled(time, velocity)
    return CableAir(velocity, sigma, rate, drag_of(p, density_of(p)), mean, 1.0 / rate)


def _of_record(p: Parameters, end_time: float) -> CableAir:
    """Return the air of wind.turbulence.record, without a ramp."""
    sigma, position = rest_points(p)
    air = _of_field(p, end_time, field_of_record(p), key_of_record(p))
    warn_of_other_mean(air.steady.at(sigma)[0], mean_velocity(p, position[:, 1]), "along the cable")
    return air


def resampled(time: np.ndarray, velocity: np.ndarray) -> tuple[float, np.ndarray]:
    """Return velocities given at instants [s] as samples at equal intervals from 0 on, and the samples per second."""
    rate = float((time.size - 1) / (time[-1] - time[0]))
    if time[0] == 0.0 and np.abs(np.diff(time) * rate - 1.0).max() <= 1e-6:
        return rate, velocity
    rate = min(1.0 / float(np.diff(time).min()), MAX_RESAMPLING * rate)  # the shortest interval
    return rate, linear_between(time, velocity, np.arange(math.ceil(time[-1] * rate) + 1) / rate, axis=0)


def warn_of_other_mean(mean: np.ndarray, stated: np.ndarray, where: str) -> None:
    """Warn of a record whose mean wind (points, dims) [m/s] is far from the `stated` one of [wind]; `where` says of what."""
    difference, speed = (float(np.linalg.norm(v, axis=-1).mean()) for v in (mean - stated, stated))
    if difference > MAX_DIFFERENCE * speed:
        warn(
            f"wind.speed, wind.direction: the mean wind of {RECORD} differs by {difference:.3g} m/s from that of [wind], "
            f"{speed:.3g} m/s {where}; the record is used; change wind.speed and wind.direction to its mean"
        )


def check_no_wind(p: Parameters, where: str) -> None:
    """Refuse a scene with wind by its key; `where` names what has it."""
    if p.wind is not None:
        raise SceneError(f"wind: given {p.wind['speed']:g} m/s; allowed: none here; try: {where}")
