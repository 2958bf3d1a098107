"""Parameters of one scene: plain numbers in SI units; of stacked members: arrays."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, reduce
from typing import Any, Protocol

import numpy as np

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError
from cablepod.parameters._key_paths import motion_path
from cablepod.parameters._keys import DRAG_COEFFICIENT, GUST_INTERVAL
from cablepod.parameters._time_functions import TimeFunction


class InWind(Protocol):
    """What stands in the wind: a cable or a mast."""

    @property
    def wind(self) -> Mapping[str, Any] | None:
        """Values of the table [wind]; None for still air."""

    @property
    def turbulence(self) -> Mapping[str, Any] | None:
        """Values of the table [wind.turbulence]; None for steady wind."""


def has_record(p: InWind) -> bool:
    """Tell whether the wind of a scene is that of a file."""
    return p.turbulence is not None and "record" in p.turbulence


def ramp_of(p: InWind) -> float:
    """Return the time in which the wind of a scene rises from still air [s]; 0 where it is there from the start."""
    return 0.0 if p.wind is None else float(p.wind["ramp"])


def gust_interval(p: InWind) -> float:
    """Return the interval of the samples of the turbulence [s]."""
    return float((p.turbulence or {}).get("interval", GUST_INTERVAL))


@dataclass(frozen=True)
class PointLoad:
    """Force on one point of the cable."""

    key: str  #: key path of its table
    fraction: float  #: place as a fraction of the unstretched length [1]
    force: np.ndarray  #: (dims,) [N]
    factor: TimeFunction | None  #: factor of time [1]


@dataclass(frozen=True, eq=False)
class Segment:
    """Part of a cable with properties of its own."""

    start: float  #: lower end as a fraction of the unstretched length [1]
    end: float  #: upper end as a fraction of the unstretched length [1]
    stiffness: float  #: axial stiffness K [N]
    area: float | None  #: area of the unstrained cross-section [m2]; None where it is not given
    mass: float  #: mass per unstretched length, with its ice [kg/m]
    weight: np.ndarray  #: weight per unstretched length, with its ice (dims,) [N/m]
    diameter: float | None  #: with its ice [m]; None without
    drag_coefficient: float
    breaking_strength: float | None  #: [N]; None without

    @property
    def drag_width(self) -> float:
        """Drag coefficient times diameter [m]; 0 without a diameter."""
        return self.drag_coefficient * (self.diameter or 0.0)

    def is_like(self, other: Segment) -> bool:
        """Whether another segment has the same properties."""
        own, others = (
            [*segment.weight, *(getattr(segment, field.name) for field in fields(segment) if field.name not in PLACED)]
            for segment in (self, other)
        )
        return own == others


#: Fields of a segment that say where it is, and its vector.
PLACED = ("start", "end", "weight")
#: Borders of a cable of one segment, before and after a change of temperature, as fractions of the length.
WHOLE = ((0.0, 1.0), (0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Attachment:
    """Mass, drag, damper and spring at one point of the cable."""

    key: str  #: key path of its table
    place_key: str  #: the given one of PLACE_KEYS
    place: float  #: its value, a fraction [1] or a distance [m]
    mass: float  #: [kg]
    weight: np.ndarray  #: of the mass (dims,) [N]
    drag_area: float  #: drag coefficient times area [m2]
    damper: float  #: force per velocity along `direction` [N s/m]
    spring: float  #: force per displacement from rest along `direction` [N/m]
    direction: np.ndarray | None  #: unit vector (dims,); None without damper and spring
    expansion: float = 1.0  #: length of the cable over that at which a distance is given
    #: Borders of the segments as fractions, of the length at which a distance is given and of that now.
    borders: tuple[tuple[float, ...], tuple[float, ...]] = WHOLE

    def fraction(self, length: float) -> float:
        """Return the place as a fraction of the unstretched `length` [m], unchecked."""
        if self.place_key == "arc_length":
            return self.place
        offset, rate = self._of_part(given := self._given(length))
        return offset + rate * given

    def slope(self, length: float) -> float:
        """Return the change of the place [m] with the unstretched `length` [m] of the cable."""
        if self.place_key == "arc_length":
            return self.place
        offset, rate = self._of_part(self._given(length))
        return offset if self.place_key == "distance_from_lower" else offset + rate

    def _given(self, length: float) -> float:
        """Return the place given by a distance as a fraction of the length at which it is given."""
        below = self.place * self.expansion / length
        return below if self.place_key == "distance_from_lower" else 1.0 - below

    def _of_part(self, given: float) -> tuple[float, float]:
        """Return offset and rate of the fraction now by the `given` one, in the segment in which this is."""
        given_at, now_at = self.borders
        if given_at == now_at:
            return 0.0, 1.0
        part = min(max(bisect(given_at, given) - 1, 0), len(given_at) - 2)
        rate = (now_at[part + 1] - now_at[part]) / (given_at[part + 1] - given_at[part])
        return now_at[part] - rate * given_at[part], rate


@dataclass(frozen=True, eq=False)  # compared and hashed by identity, see SceneContent
class Parameters:
    """Parameters of a scene in SI units; None stands for a term that the scene lacks.

    Members that differ in numbers only can be stacked, see :meth:`cablepod.parameters._from_scene.Members.stacked`: numbers are
    arrays (members,) then, vectors (members, dims), parameters of time functions (members, 1).

    The numbers of a cable of several segments are means over its unstretched length: its mass and weight are those of the
    whole cable, its stiffness is that under one tension.  Its breaking strength is the least, and it has an area where all are
    equal.  A chain with masses and stiffnesses of its own has those of a uniform cable of the same mass and compliance beside
    them.
    """

    stiffness: Any  #: axial stiffness K [N]
    area: Any  #: area of the unstrained cross-section [m2]; None where it is not given
    mass: Any  #: mass per unstretched length [kg/m]
    weight: np.ndarray  #: weight per unstretched length (dims,) [N/m]
    lower: np.ndarray  #: lower end at rest (dims,) [m]
    upper: np.ndarray  #: upper end at rest (dims,) [m]
    inclination: Any  #: of the chord, where this is given in place of the upper end [degree]; None elsewhere
    free_end: str | None  #: "lower", "upper" or None
    motions: Mapping[tuple[str, str], TimeFunction]  #: (end, axis) -> displacement [m]
    load: np.ndarray | None  #: uniform load beside the weight (dims,) [N/m]
    load_factor: TimeFunction | None  #: factor of the uniform load [1]
    point_loads: tuple[PointLoad, ...]
    stiffness_key: str  #: the given one of STIFFNESS_KEYS
    weight_key: str  #: the given one of WEIGHT_KEYS
    length_key: str  #: the given one of LENGTH_KEYS
    length_value: Any  #: [N], or [m] for unstretched_length and sag
    duration: float | None  #: [s]
    interval: float | None  #: [s]
    links: int | None
    link_lengths: np.ndarray | None  #: relative, (links,)
    initial: Mapping[str, Any]  #: values of the table [initial]
    mass_damping: Any  #: [1/s]; None without
    link_viscosity: float | None  #: [s]
    tension_damping: float | None  #: damping force per tension and rate of slope [s]
    breaking_strength: Any  #: [N]; None without
    #: damping ratios of the first vibrations about rest, the last of all others; None without
    damping_ratios: tuple[float, ...] | None = None
    has_list_of_ratios: bool = False  #: whether these are a list in the scene, not one number
    diameter: Any = None  #: of the cable with its ice [m]; None without
    drag_coefficient: Any = DRAG_COEFFICIENT
    wind: Mapping[str, Any] | None = None  #: values of the table [wind]; None for still air
    turbulence: Mapping[str, Any] | None = None  #: values of the table [wind.turbulence]; None for steady wind
    segments: tuple[Segment, ...] = ()  #: from the lower end on, different from one to the next; empty if uniform
    #: in the order of their tables, see :func:`cablepod.parameters._nonuniform.attachment_fractions`
    attachments: tuple[Attachment, ...] = ()
    masses: np.ndarray | None = None  #: of the particles, without ice (links + 1,) [kg]; None for those of a cable
    #: of the links at the reference temperature (links,) [N/m]; None for that of a cable
    link_stiffness: np.ndarray | None = None
    #: the same cable as it was tensioned, without ice and at the reference temperature; None where it is the same
    bare: Parameters | None = None
    expansion: Any = 1.0  #: unstretched length over that of `bare`
    temperatures: tuple[Any, Any] | None = None  #: temperature and reference temperature [degC]; None without

    def take(self, part: np.ndarray) -> Parameters:
        """Return the parameters of some of stacked members, by their numbers."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        arrays = {name: value[part] for name, value in values.items() if isinstance(value, np.ndarray) and value.ndim}
        if self.temperatures is not None:
            arrays["temperatures"] = tuple(value[part] if np.ndim(value) else value for value in self.temperatures)
        motions = {key: motion.take(part) for key, motion in self.motions.items()}
        return replace(self, **arrays, motions=motions, bare=None if self.bare is None else self.bare.take(part))

    @cached_property
    def dims(self) -> int:
        """Number of coordinates: two for a planar scene, three for a spatial one."""
        return self.lower.shape[-1]

    @cached_property
    def own_keys(self) -> tuple[str, ...]:
        """Key paths of the masses and stiffnesses that the chain has of its own; empty for a cable."""
        given = {"chain.masses": self.masses, "chain.stiffness": self.link_stiffness}
        return tuple(key for key, values in given.items() if values is not None)

    @property
    def stiffness_path(self) -> str:
        """Key path that gives the axial stiffness, for messages."""
        return f"cable.{self.stiffness_key}" if self.link_stiffness is None else "chain.stiffness"

    @cached_property
    def ends(self) -> np.ndarray:
        """Both ends at rest (end, dims) [m]."""
        return np.stack([self.lower, self.upper], axis=-2)

    @cached_property
    def damping(self) -> Any:
        """Mass-proportional damping [1/s], 0 where there is none."""
        return 0.0 * self.stiffness if self.mass_damping is None else self.mass_damping

    def drag_widths(self, sigma: np.ndarray) -> np.ndarray:
        """Return drag coefficient times diameter at relative arc lengths (points,) [m], of a cable with a diameter."""
        if not self.segments:
            return np.full(sigma.size, self.drag_coefficient * self.diameter)
        of_segments = np.array([segment.drag_width for segment in self.segments])
        return of_segments[np.searchsorted([segment.end for segment in self.segments[:-1]], sigma)]

    def load_at(self, time: float) -> np.ndarray:
        """Return the sum of weight and uniform load at `time` [s], (dims,) [N/m]."""
        if self.load is None:
            return self.weight
        factor = 1.0 if self.load_factor is None else float(self.load_factor(time))
        return self.weight + factor * self.load

    def times(self) -> np.ndarray:
        """Return the times of the snapshots [s]: 0, interval, ... up to the duration; one array, which cannot be changed."""
        return self._times

    @cached_property
    def _times(self) -> np.ndarray:
        times = output_times(self.duration, self.interval)
        times.setflags(write=False)
        return times

    def end_positions(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return prescribed positions of both ends, or a derivative of them: (time, end, dims) [m]."""
        return positions_of_ends(self.ends, self.motions, time, derivative)

    @cached_property
    def initial_ends(self) -> np.ndarray:
        """Positions of both ends at time 0 (end, dims) [m]."""
        return self.end_positions(np.zeros(1))[..., 0, :, :]

    @cached_property
    def initial_end_rates(self) -> np.ndarray:
        """Velocities and accelerations of both ends at time 0 (derivative, end, dims) [m/s, m/s^2]."""
        return np.stack([self.end_positions(np.zeros(1), derivative)[..., 0, :, :] for derivative in (1, 2)])

    def end_coordinates_at_steps(self, start: int, steps: int, steps_per_second: float) -> np.ndarray:
        """Return moving end coordinates [m] from step `start` on: (moving, steps + 1)."""
        rows = [
            function.at_steps(start, steps, steps_per_second, 0, self.ends[ENDS.index(end), COORDINATES.index(axis)])
            for (end, axis), function in self.motions.items()
        ]
        # no copy of a single motion, the common case
        return rows[0][None] if len(rows) == 1 else np.array(rows).reshape(len(rows), steps + 1)

    def time_functions(self) -> dict[str, TimeFunction]:
        """Return all motions and load factors by the key paths of their tables."""
        functions: dict[str, TimeFunction | None] = {motion_path(*key): motion for key, motion in self.motions.items()}
        functions["load"] = self.load_factor
        functions |= {load.key: load.factor for load in self.point_loads}
        return {key: function for key, function in functions.items() if function is not None}

    def offsets(self) -> dict[str, Any]:
        """Return the values at t = 0 from which harmonic motions and records are counted [m], as attributes of a result.

        Stacked members give arrays (members,).
        """
        offsets = {
            f"motion_{end}_{axis}_offset": motion.offset
            for (end, axis), motion in self.motions.items()
            if motion.kind in ("harmonic", "file")
        }
        return {name: offset[:, 0] if np.ndim(offset) else float(offset) for name, offset in offsets.items()}

    @cached_property
    def shortest_time_scale(self) -> Any:
        """Shortest time scale of all motions and load factors [s]; infinity if there are none."""
        scales = (function.shortest_time_scale for function in self.time_functions().values())
        shortest: Any = reduce(np.minimum, scales, np.inf)
        return shortest[:, 0] if np.ndim(shortest) else float(shortest)

    def sampling_times(self) -> np.ndarray:
        """Return instants up to the duration [s] that resolve the ranges of all motions and load factors."""
        end_time = self.duration or 0.0
        functions = self.time_functions().values()
        return np.unique(np.concatenate([[0.0, end_time], *(item.sampling_times(end_time) for item in functions)]))


def positions_of_ends(
    ends: np.ndarray, motions: Mapping[tuple[str, str], TimeFunction], time: np.ndarray, derivative: int = 0
) -> np.ndarray:
    """Return positions of ends that move, or a derivative of them (..., time, end, dims) [m].

    `ends` are those at rest (..., end, dims) [m], `motions` as in :class:`Parameters`.
    """
    time = np.asarray(time, dtype=float)
    result = np.zeros((*ends.shape[:-2], time.size, *ends.shape[-2:]))
    if derivative == 0:
        result[:] = ends[..., None, :, :]
    for (end, axis), function in motions.items():
        result[..., ENDS.index(end), COORDINATES.index(axis)] += function(time, derivative)
    return result


def output_times(duration: float | None, interval: float | None) -> np.ndarray:
    """Return the times 0, interval, ... up to the duration [s]; refuse a scene without them."""
    if duration is None or interval is None:
        raise SceneError("time: missing; allowed: a table with duration and interval [s], or the argument times")
    return interval * np.arange(count_instants(duration, interval))


def count_instants(duration: float, interval: float) -> int:
    """Return the number of instants 0, interval, ... up to the duration."""
    # tolerance: the last instant counts if the duration is a multiple of the interval up to rounding
    return int(np.floor(duration / interval * (1.0 + 1e-12))) + 1
