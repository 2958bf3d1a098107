"""A scene as plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError
from cablepod.parameters._key_paths import motion_path
from cablepod.parameters._time_functions import TimeFunction


@dataclass(frozen=True)
class PointLoad:
    """A force on one place of the cable: `fraction` of the unstretched length, `force` (dims,) [N], factor of time.

    `key` is the key path of its table.
    """

    key: str
    fraction: float
    force: np.ndarray
    factor: TimeFunction | None


@dataclass(frozen=True)
class Parameters:
    """A scene as plain numbers, SI units; None stands for a term that the scene lacks."""

    stiffness: float  #: axial stiffness K [N]
    mass: float  #: mass per unstretched length [kg/m]
    weight: np.ndarray  #: weight per unstretched length (dims,) [N/m]
    lower: np.ndarray  #: lower end at rest (dims,) [m]
    upper: np.ndarray  #: upper end at rest (dims,) [m]
    free_end: str | None  #: the end that moves freely
    motions: Mapping[tuple[str, str], TimeFunction]  #: (end, axis) -> displacement [m]
    load: np.ndarray | None  #: uniform load beside the weight (dims,) [N/m]
    load_factor: TimeFunction | None
    point_loads: tuple[PointLoad, ...]
    length_key: str  #: which of schema.LENGTH_KEYS is given
    length_value: float
    duration: float | None
    interval: float | None
    links: int | None
    link_lengths: np.ndarray | None  #: relative, (links,)
    initial: Mapping[str, Any]  #: what the [initial] table has
    mass_damping: float | None  #: [1/s]
    link_viscosity: float | None  #: [s]

    @cached_property
    def dims(self) -> int:
        """Two for a planar scene, three for a spatial one."""
        return self.lower.size

    def load_at(self, time: float) -> np.ndarray:
        """Weight and uniform load together at `time` [s], (dims,) [N/m]."""
        if self.load is None:
            return self.weight
        factor = 1.0 if self.load_factor is None else float(self.load_factor(time))
        return self.weight + factor * self.load

    def times(self) -> np.ndarray:
        """Instants of the snapshots [s]: 0, interval, ... up to the duration."""
        if self.duration is None or self.interval is None:
            raise SceneError("time: missing; allowed: a table with duration and interval [s], or the argument times")
        return self.interval * np.arange(count_instants(self.duration, self.interval))

    def end_positions(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Positions of both ends as the scene prescribes them, or their first or second rate: (time, end, dims) [m]."""
        time = np.asarray(time, dtype=float)
        result = np.zeros((time.size, 2, self.dims))
        if derivative == 0:
            result[:, 0], result[:, 1] = self.lower, self.upper
        for (end, axis), function in self.motions.items():
            result[:, ENDS.index(end), COORDINATES.index(axis)] += function(time, derivative)
        return result

    def end_coordinates_at_steps(self, start: int, steps: int, rate: float, derivative: int = 0) -> np.ndarray:
        """Coordinates of the ends that move [m], or their rates, at steps `start` ... `start + steps`: (moving, steps + 1)."""
        rows = [
            function.at_steps(
                start, steps, rate, derivative, (self.lower if end == "lower" else self.upper)[COORDINATES.index(axis)]
            )
            for (end, axis), function in self.motions.items()
        ]
        # of one motion, the common case, no copy is made
        return rows[0][None] if len(rows) == 1 else np.array(rows).reshape(len(rows), steps + 1)

    def time_functions(self) -> dict[str, TimeFunction]:
        """All motions and load factors under the keys of their tables."""
        functions: dict[str, TimeFunction | None] = {motion_path(*key): motion for key, motion in self.motions.items()}
        functions["load"] = self.load_factor
        functions |= {load.key: load.factor for load in self.point_loads}
        return {key: function for key, function in functions.items() if function is not None}

    @cached_property
    def shortest_time_scale(self) -> float:
        """Shortest time over which a motion or load changes [s]; infinite where none does."""
        return min((function.shortest_time_scale for function in self.time_functions().values()), default=np.inf)

    def sampling_times(self) -> np.ndarray:
        """Instants from 0 to the duration [s] that show how far motions and loads go; 0 alone where none changes."""
        until = self.duration or 0.0
        functions = self.time_functions().values()
        # those of a period too, lest all instants of the whole run see the same phase
        return np.unique(np.concatenate([[0.0, until], *(function.sampling_times(until) for function in functions)]))

    def check_reach(self, time: float) -> None:
        """Refuse a record that does not cover the run from 0 to `time` [s]."""
        for key, function in self.time_functions().items():
            if function.begin > 0.0 or time > function.end * (1.0 + 1e-12):
                raise SceneError(
                    f"{key}.path: the record is too short, from {function.begin:g} s to {function.end:g} s; "
                    f"allowed: one that covers the run, from 0 s to {time:g} s"
                )


def count_instants(duration: float, interval: float) -> int:
    """Count the instants 0, interval, ... up to the duration."""
    # a duration that is a multiple of the interval but for rounding ends with a snapshot
    return int(np.floor(duration / interval * (1.0 + 1e-12))) + 1
