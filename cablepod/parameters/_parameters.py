"""A scene as plain numbers, and what follows from them at once: statics, instants, memory."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, ENDS
from cablepod.parameters import _schema as schema
from cablepod.parameters._schema import SceneError, refuse
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
    free: str | None  #: the end that moves freely
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

    @property
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

    def end_tables(self, start: int, steps: int, rate: float, derivative: int = 0) -> np.ndarray:
        """Coordinates of the ends that move [m], or their rates, at steps `start` ... `start + steps`: (moving, steps + 1)."""
        rows = [
            function.on_steps(
                start, steps, rate, derivative, (self.lower if end == "lower" else self.upper)[COORDINATES.index(axis)]
            )
            for (end, axis), function in self.motions.items()
        ]
        # of one motion, the common case, no copy is made
        return rows[0][None] if len(rows) == 1 else np.array(rows).reshape(len(rows), steps + 1)

    def time_functions(self) -> dict[str, TimeFunction]:
        """All motions and load factors under the keys of their tables."""
        functions: dict[str, TimeFunction | None] = {f"motion.{e}.{axis}": f for (e, axis), f in self.motions.items()}
        functions["load"] = self.load_factor
        functions |= {load.key: load.factor for load in self.point_loads}
        return {key: function for key, function in functions.items() if function is not None}

    @property
    def time_scale(self) -> float:
        """Shortest time over which a motion or load changes [s]; infinite where none does."""
        return min((function.time_scale for function in self.time_functions().values()), default=np.inf)

    def telling_times(self) -> np.ndarray:
        """Instants from 0 to the duration [s] that show how far motions and loads go; 0 alone where none changes."""
        until = self.duration or 0.0
        functions = self.time_functions().values()
        # those of a period too, lest all instants of the whole run see the same phase
        return np.unique(np.concatenate([[0.0, until], *(function.telling(until) for function in functions)]))

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


def solve_statics(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> np.ndarray:
    """Solve the elastic catenary of a scene for one given quantity.

    Parameters
    ----------
    p
        The scene's parameters; weight and uniform load at time 0 act.
    key, value
        One of ``schema.LENGTH_KEYS`` and its value [N or m].
    prefix
        The table named in an error.

    Returns
    -------
    numpy.ndarray
        (6,) as in ``kernels.catenary.COLUMNS``; nan for a weightless slack cable that starts from given points, which
        needs no rest.

    Raises
    ------
    SceneError
        Where no such cable exists; the message names the least possible tension.
    """
    from cablepod.catenary import _kernels as kernel  # only here: numba is imported to compute, not to read

    a, b, c, q, _, _ = load_plane(p)
    out = np.empty(6)
    kind = (kernel.UPPER_TENSION, kernel.LOWER_TENSION, kernel.HORIZONTAL_FORCE, kernel.LENGTH)[
        schema.LENGTH_KEYS.index(key)
    ]
    status = kernel.solve(a, b, c, q, p.stiffness, kind, value, out)
    if status == kernel.FOUND:
        return out
    name = f"{prefix}.{key}"
    if status == kernel.BELOW_LEAST_TENSION:
        least = kernel.least_tension(a, b, c, q, p.stiffness, 1.0 if kind == kernel.UPPER_TENSION else -1.0)
        raise refuse(
            name, value, f"at least {max(least, 0.0):.6g} N, the least that a cable between these ends can have"
        )
    if status == kernel.SLACK_WEIGHTLESS:
        if "points" in p.initial and prefix == "cable":
            out[0] = value
            return out
        raise refuse(name, value, f"at most the chord, {c:.12g} m, as a slack cable without load has no shape at rest")
    if status == kernel.VERTICAL_WITH_FORCE:
        raise refuse(name, value, "another way to give the length, as a cable along the load has no force across it")
    raise refuse(name, value, "a value for which the catenary can be computed in double precision")


def load_plane(p: Parameters) -> tuple[float, float, float, float, np.ndarray, np.ndarray]:
    """Span across the total load, rise against it, chord [m], load [N/m], unit vectors across and against it."""
    chord = p.end_positions(np.zeros(1))[0]
    chord = chord[1] - chord[0]
    load = p.load_at(0.0)
    q = _norm(load)
    against = -load / q if q > 0.0 else np.eye(p.dims)[1]
    if q > 0.0 and np.count_nonzero(load) == 1:
        against = np.sign(against)  # exactly an axis
    b = float(chord @ against)
    across = chord - b * against
    across = across - (across @ against) * against  # once more: the first difference may have cancelled
    a = _norm(across)
    c = _norm(chord)
    if a <= 1e-15 * c:
        return 0.0, float(np.copysign(c, b)), c, q, np.zeros(p.dims), against
    return a, b, c, q, across / a, against


def _norm(vector: np.ndarray) -> float:
    # hypot is right to the last digit or two and, unlike BLAS, gives planar and spatial scenes the same bits
    return float(np.hypot.reduce(vector))


def parameters(scene: xr.Dataset) -> Parameters:
    """Return the plain numbers of a scene.

    Raises
    ------
    SceneError
        Where `scene` is not a scene, or one with several members.
    """
    members = parameters_of_members(scene)
    if "member" in scene.dims:
        raise SceneError("scene: given several members; allowed: one, scene.isel(member=0)")
    return members[0]


class Members(Sequence[Parameters]):
    """The plain numbers of each member of a scene, made when asked for; of one where there is no dimension ``member``.

    Raises
    ------
    SceneError
        Where `scene` is not a scene.
    """

    def __init__(self, scene: xr.Dataset) -> None:
        needed = ("gravity", "cable_youngs_modulus", "cable_area", "ends_lower", "ends_upper")
        if not isinstance(scene, xr.Dataset) or not all(name in scene for name in needed):
            raise SceneError(f"scene: given no Dataset with {', '.join(needed)}; allowed: what make_scene gives")
        self.fixed: dict[str, Any] = {}  #: what all members have alike
        self.varied: dict[str, Any] = {}  #: a row for each member
        self.gapped: dict[str, Any] = {}  #: the same, with gaps
        for name, variable in scene.variables.items():
            if "member" in variable.dims:
                values = variable.transpose("member", ...).values
                (self.gapped if any(map(_is_gap, values)) else self.varied)[str(name)] = values
            elif not _is_gap(value := variable.values[()]):
                self.fixed[str(name)] = value
        self._count = scene.sizes.get("member", 1)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, at: int) -> Parameters: ...
    @overload
    def __getitem__(self, at: slice) -> list[Parameters]: ...
    def __getitem__(self, at: int | slice) -> Parameters | list[Parameters]:
        """Make the numbers of one member, or of some."""
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(self._count))]
        if not -self._count <= at < self._count:
            raise IndexError(at)  # which ends a loop over all
        return _parameters(
            self.fixed
            | {name: item[at] for name, item in self.varied.items()}
            | {name: item[at] for name, item in self.gapped.items() if not _is_gap(item[at])}
        )


def parameters_of_members(scene: xr.Dataset) -> list[Parameters]:
    """Return the plain numbers of each member of a scene, a list of one where there is no dimension ``member``.

    Raises
    ------
    SceneError
        Where `scene` is not a scene.
    """
    return list(Members(scene))


def _is_gap(value: Any) -> bool:
    """Tell whether a value is the nan by which xarray.concat fills what one scene has and another lacks."""
    if isinstance(value, float | str):  # most are, and the other way takes ten times as long
        return value != value
    array = np.asarray(value)
    return array.size > 0 and array.dtype.kind in "fO" and bool(np.all(array != array))


def _parameters(value: Mapping[str, Any]) -> Parameters:
    cable = {key: value[f"cable_{key}"] for key in schema.CABLE if f"cable_{key}" in value}
    length_key = schema.exactly_one("cable", cable, schema.LENGTH_KEYS)
    weight_key = schema.exactly_one("cable", cable, schema.WEIGHT_KEYS)

    def number(name: str) -> float | None:
        return float(value[name]) if name in value else None

    def function(prefix: str) -> TimeFunction | None:
        if f"{prefix}_kind" not in value:
            return None
        kind = str(value[f"{prefix}_kind"])
        names = ("time", "value") if kind == "file" else tuple(schema.time_function_keys("1")[kind])
        return TimeFunction(kind, {name: value[f"{prefix}_{name}"] for name in names})

    dims = len(value["ends_lower"])
    gravity, area = float(value["gravity"]), float(value["cable_area"])
    if weight_key == "density":
        mass = float(value["cable_density"]) * area
        weight = mass * gravity
    else:
        weight = float(value["cable_specific_weight"]) * area
        mass = weight / gravity
    motions = {(end, axis): function(f"motion_{end}_{axis}") for end in ENDS for axis in COORDINATES[:dims]}
    loads: list[PointLoad] = []
    while (prefix := f"point_load_{len(loads) + 1}") + "_force" in value:
        key, place = f"point_load.{len(loads) + 1}", float(value[prefix + "_arc_length"])
        loads.append(PointLoad(key, place, value[prefix + "_force"], function(prefix)))
    return Parameters(
        stiffness=float(value["cable_youngs_modulus"]) * area,
        mass=mass,
        weight=np.array([0.0, -weight, 0.0][:dims]),
        lower=value["ends_lower"],
        upper=value["ends_upper"],
        free=str(value["ends_free"]) if "ends_free" in value else None,
        motions={key: item for key, item in motions.items() if item is not None},
        load=value["load_uniform"] if np.any(value.get("load_uniform", 0.0)) else None,
        load_factor=function("load"),
        point_loads=tuple(load for load in loads if np.any(load.force)),
        length_key=length_key,
        length_value=float(value[f"cable_{length_key}"]),
        duration=number("time_duration"),
        interval=number("time_interval"),
        links=int(value["chain_links"]) if "chain_links" in value else None,
        link_lengths=value.get("chain_link_lengths"),
        initial={key: value[f"initial_{key}"] for key in schema.INITIAL if f"initial_{key}" in value},
        mass_damping=number("damping_mass_proportional") or None,
        link_viscosity=number("damping_link_viscosity") or None,
    )


def check_memory(instants: int, links: int, dims: int, *, key: str, variables: int = 1) -> None:
    """Refuse an output that would not fit in memory.

    Raises
    ------
    SceneError
        Naming what is needed and what the machine has.
    """
    needed = 8.0 * dims * variables * (float(instants) * (links + 1) + 20.0 * links)
    check_bytes(needed, key, f"{links} links and {instants} instants, {needed / 1e9:.3g} GB of output")


def check_bytes(needed: float, key: str, given: str) -> None:
    """Refuse what would not fit in half of this machine's memory.

    Raises
    ------
    SceneError
        Naming what is needed and what the machine has.
    """
    try:
        memory = float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        memory = 16e9
    if needed > 0.5 * memory:
        raise SceneError(f"{key}: given {given}; allowed: half of this machine's memory, {0.5 * memory / 1e9:.3g} GB")
