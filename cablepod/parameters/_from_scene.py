"""Parameters of a scene Dataset, and of each of its members."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple, overload

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError
from cablepod.parameters._checks import choice
from cablepod.parameters._given import both_ends, check_start, cross_section
from cablepod.parameters._ice import iced
from cablepod.parameters._key_paths import motion_path
from cablepod.parameters._keys import (
    DRAG_COEFFICIENT,
    FUNCTION_KEYS,
    INITIAL,
    LENGTH_KEYS,
    POINT_LOAD,
    check_damping,
    exactly_one,
    join,
    time_function_keys,
)
from cablepod.parameters._nonuniform import NONUNIFORM, with_segments_and_attachments
from cablepod.parameters._parameters import Parameters, PointLoad
from cablepod.parameters._particles import check_links, check_own, number_of_links, with_means
from cablepod.parameters._scene_values import check_values, listed, of_keys, tables_of
from cablepod.parameters._temperature import TEMPERATURES, expanded, expansion_of, temperatures_of
from cablepod.parameters._time_functions import SINES, TimeFunction, check_instants
from cablepod.parameters._wind import turbulence_of, wind_of
from cablepod.provenance import digest

#: Variables of a record: times [s] and values, duration of the smooth start [s].
RECORD = ("time", "value", "ramp")
#: Beginnings of the variables that stacked parameters hold, and variables of terms that these do not cover.
STACKED_TABLES = ("gravity", *TEMPERATURES, "cable_", "ends_", "load_", "motion_", "damping_")
UNSTACKED_TERMS = ("ends_free", "load_kind", "point_load_1_force")


def parameters(scene: xr.Dataset) -> Parameters:
    """Return the parameters of a scene with one member.

    Raises
    ------
    SceneError
        If `scene` has the dimension ``member``.
    """
    members = Members(scene)
    if "member" in scene.dims:
        raise SceneError("scene: given several members; allowed: one, scene.isel(member=0)")
    return members[0]


@dataclass(frozen=True)
class SceneContent:
    """A scene that is compared by its values."""

    digest: str | None  #: of :func:`cablepod.provenance.digest`; None for members, which are not kept
    scene: xr.Dataset = field(compare=False)

    @classmethod
    def of(cls, scene: xr.Dataset) -> SceneContent:
        """Take the content of a scene."""
        return cls(None if "member" in scene.dims else digest(scene), scene)

    def parameters(self) -> Parameters:
        """Return the parameters of the scene, or of its first member: for the same values the same object.

        What follows from the parameters, such as the statics, is then computed once and not in each call.
        """
        return Members(self.scene)[0] if self.digest is None else _kept_parameters(self)


@lru_cache(64)
def _kept_parameters(content: SceneContent) -> Parameters:
    members = Members(content.scene)
    # the caller may change the arrays of his scene
    members.fixed = {
        name: value.copy() if isinstance(value, np.ndarray) else value for name, value in members.fixed.items()
    }
    return members[0]


class Members(Sequence[Parameters]):
    """Sequence of the parameters of each member of a scene, each made on access; a scene of one member has length 1."""

    def __init__(self, scene: xr.Dataset) -> None:
        self.fixed: dict[str, Any] = {}  #: variable -> value of all members
        self.varied: dict[str, Any] = {}  #: variable -> values, a row for each member
        if "mast_height" in scene.variables:
            raise SceneError("mast: given a scene with a mast; allowed: one with [cable], [ends]; try: mast.simulate")
        self.gapped: dict[str, Any] = {}  #: the same, nan for members that lack the variable
        for name, variable in scene.variables.items():
            if "member" in variable.dims:
                values = variable.transpose("member", ...).values
                (self.gapped if _has_gap(values) else self.varied)[str(name)] = values
            elif not is_gap(value := variable.values[()]):
                self.fixed[str(name)] = value
        self._count = scene.sizes.get("member", 1)
        check_values(self.fixed, self.varied | self.gapped)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Parameters: ...
    @overload
    def __getitem__(self, index: slice) -> list[Parameters]: ...
    def __getitem__(self, index: int | slice) -> Parameters | list[Parameters]:
        """Make the parameters of one member, or of a slice."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(self._count))]
        if not -self._count <= index < self._count:
            raise IndexError(index)  # ends iteration
        return cable_of(
            tables_of(
                self.fixed
                | {name: values[index] for name, values in self.varied.items()}
                | {name: values[index] for name, values in self.gapped.items() if not is_gap(values[index])}
            )
        )

    def name(self, index: int) -> str:
        """Return the label of a member, which in the batch of an ensemble is not its place; its place without labels."""
        return str(self.varied["member"][index] if "member" in self.varied else index)

    @property
    def can_be_stacked(self) -> bool:
        """Whether the members differ in numbers only, and have no term that :meth:`stacked` does not cover."""
        p, names = self[0], set(self.fixed) | set(self.varied)
        return not (
            self.gapped
            or any(values.dtype.kind not in "fiu" for name, values in self.varied.items() if name != "member")
            or any(name.startswith("initial_") for name in names)
            or names & set(UNSTACKED_TERMS)
            or p.link_viscosity is not None
            or "damping_link_viscosity" in self.varied
            or p.tension_damping is not None
            or "damping_tension_proportional" in self.varied
            or names & {"damping_ratio", "damping_ratios"}
            or any(name.startswith(("wind_", "ice_", *(f"{table}_" for table in NONUNIFORM))) for name in names)
            or names & {"chain_masses", "chain_stiffness"}
            or any(motion.kind not in SINES for motion in p.motions.values())
        )

    def stacked(self, first: int, last: int) -> Parameters:
        """Make the parameters of the members `first` ... `last - 1` as arrays, see :class:`Parameters`."""
        values = {}
        for name, value in (self.fixed | self.varied).items():
            if not name.startswith(STACKED_TABLES):
                continue
            if not isinstance(value, str):
                rows = value[first:last] if name in self.varied else np.full((last - first, *np.shape(value)), value)
                value = rows[:, None].astype(float) if name.startswith("motion_") else rows.astype(float)
            values[name] = value
        return cable_of(tables_of(values), np.asarray)


def _has_gap(values: np.ndarray) -> bool:
    """Tell whether a row of the values of a variable (members, ...) is a gap."""
    if values.dtype.kind != "f":
        return any(map(is_gap, values))
    missing = np.isnan(values).reshape(len(values), -1)  # ten thousand members in no time
    return bool(missing.shape[1] and missing.all(axis=1).any())


def is_gap(value: Any) -> bool:
    """Tell whether a value is nan, with which xarray.concat fills the variables that a scene lacks."""
    if isinstance(value, float | str):  # the common case, ten times as fast as the test of arrays
        return value != value
    array = np.asarray(value)
    return array.size > 0 and array.dtype.kind in "fO" and bool(np.all(array != array))


class Paths(NamedTuple):
    """Key paths of the tables of one cable, for messages."""

    cable: str = "cable"
    length: str = "cable"  #: of the table with the key of its length
    anchor: str = ""  #: of a guy: of the key of its lower end
    above: str = ""  #: beginning of the paths of its segments and attachments
    length_keys: tuple[str, ...] = LENGTH_KEYS


ONE_CABLE = Paths()


def cable_of(tables: Mapping[str, Any], number: Callable[[Any], Any] = float, paths: Paths = ONE_CABLE) -> Parameters:
    """Make parameters from the tables of a scene of one cable, whose values are converted by `number`.

    Raises
    ------
    SceneError
        For keys that are missing, or do not go together; the message names the key.
    """
    refuse_missing("", tables, ("gravity",))
    refuse_missing("ends", tables.get("ends", {}), ("lower",))
    gravity, ends = number(tables["gravity"]), tables["ends"]
    cable, time, chain, damping = (tables.get(name, {}) for name in ("cable", "time", "chain", "damping"))
    initial, free_end = of_keys(tables.get("initial", {}), INITIAL), str(ends["free"]) if "free" in ends else None
    lower, upper = both_ends(ends, paths.anchor)
    check_links(chain)
    check_own(cable, chain, initial)
    length_key = exactly_one(paths.length, cable, paths.length_keys)
    section = _section(cable, chain, gravity, lower, free_end, paths.cable, number)
    check_start(initial, lower, upper, free_end)
    wind = wind_of(tables)
    base = Parameters(
        **section,
        lower=lower,
        upper=upper,
        inclination=ends.get("inclination"),
        free_end=free_end,
        motions=_motions(tables.get("motion", {}), lower.shape[-1], free_end),
        load=_nonzero(tables.get("load", {}), "uniform", np.asarray),
        load_factor=time_function(tables.get("load", {}), "load", keeps_start=True),
        point_loads=tuple(load for load in _point_loads(tables) if np.any(load.force)),
        length_key=length_key,
        length_value=number(cable[length_key]),
        duration=float(time["duration"]) if "duration" in time else None,
        interval=float(time["interval"]) if "interval" in time else None,
        links=int(chain["links"]) if "links" in chain else number_of_links(chain),
        link_lengths=chain.get("link_lengths"),
        initial=initial,
        mass_damping=_nonzero(damping, "mass_proportional", number),
        link_viscosity=_nonzero(damping, "link_viscosity", number),
        tension_damping=_nonzero(damping, "tension_proportional", number),
        damping_ratios=damping_ratios(damping),
        has_list_of_ratios="ratios" in damping,
        wind=wind,
        turbulence=turbulence_of(tables, wind),
        masses=chain.get("masses"),
        link_stiffness=chain.get("stiffness"),
        temperatures=temperatures_of(tables, number),
    )
    if base.wind is not None and base.diameter is None:
        raise SceneError(f"{paths.cable}.diameter: missing; allowed: a diameter [m], on which the wind acts")
    uniform = iced(expanded(base, expansion_of(tables, cable, paths.cable, number)), tables, paths.cable, number)
    if not any(name in tables for name in NONUNIFORM):
        return uniform
    if uniform.own_keys:
        raise SceneError(f"{uniform.own_keys[0]}: given; allowed: none beside [[segment]] and [[attachment]]")

    def of_part(own: Mapping[str, Any], path: str) -> Parameters:
        part = replace(base, **_section(own, {}, gravity, lower, None, path, number))
        return iced(expanded(part, expansion_of(tables, own, path, number)), tables, path, number)

    return with_segments_and_attachments(uniform, tables, of_part, paths.above)


def _section(
    cable: Mapping[str, Any], chain: Mapping[str, Any], gravity: Any, lower: Any, free_end: str | None, path: str,
    number: Callable[[Any], Any],
) -> dict[str, Any]:  # fmt: skip
    """Return the fields of parameters that the table ``[cable]`` gives, but its length; `path` is that of the table."""
    found = cross_section(with_means(cable, chain, free_end), gravity, own=chain, prefix=path, number=number)
    weight = np.zeros(lower.shape)
    weight[..., 1] = -found.weight
    return {
        "stiffness": found.stiffness,
        "area": found.area,
        "mass": found.mass,
        "weight": weight,
        "stiffness_key": found.stiffness_key,
        "weight_key": found.weight_key,
        "breaking_strength": number(cable["breaking_strength"]) if "breaking_strength" in cable else None,
        "diameter": number(cable["diameter"]) if "diameter" in cable else None,
        "drag_coefficient": number(cable.get("drag_coefficient", DRAG_COEFFICIENT)),
    }


def refuse_missing(path: str, table: Mapping[str, Any], needed: Iterable[str]) -> None:
    """Refuse the table of a scene whose variables somebody dropped."""
    for name in needed:
        if name not in table:
            raise SceneError(f"{join(path, name)}: missing; allowed: a number, as make_scene gives it")


def _nonzero(table: Mapping[str, Any], name: str, number: Callable[[Any], Any]) -> Any:
    return number(table[name]) if name in table and np.any(table[name]) else None


def damping_ratios(damping: Mapping[str, Any]) -> tuple[float, ...] | None:
    """Return the damping ratios of the vibrations about rest; None for none."""
    check_damping(damping)
    given = np.atleast_1d(damping["ratios"] if "ratios" in damping else damping.get("ratio", 0.0))
    return tuple(map(float, given)) if given.any() else None


def time_function(table: Mapping[str, Any], path: str, *, keeps_start: bool = False) -> TimeFunction | None:
    """Make the time function of the table at a key path; None for a table without its keys.

    Raises
    ------
    SceneError
        For keys without kind or of another one, missing keys, and a record that is none; the message names the key.
    """
    kinds = time_function_keys("1")
    given = [name for name in table if name in FUNCTION_KEYS or name in RECORD]
    if "kind" not in table:
        if given:
            raise SceneError(f"{path}.kind: missing; allowed: one of {', '.join(kinds)}, with {path}.{given[0]}")
        return None
    kind = str(choice(*kinds)(f"{path}.kind", str(table["kind"])))
    keys = kinds[kind]
    own = {*keys, *RECORD} if kind == "file" else keys
    if others := [name for name in given if name not in own]:
        raise SceneError(f"{path}.{others[0]}: unknown key of kind {kind}; allowed: {', '.join(keys)}")
    values = of_keys(table, RECORD if kind == "file" else keys)
    needed = [name for name, key in keys.items() if key.required or key.default is not None]
    refuse_missing(path, values, RECORD[:2] if kind == "file" else needed)
    if kind == "file":  # of members with records of other lengths, nan after the last instant
        last = int(np.isfinite(values["time"]).sum())
        values |= {column: values[column][:last] for column in RECORD[:2]}
        check_instants(f"{path}.time", "the record", values["time"])
    return TimeFunction(kind, values, keeps_start)


def _motions(table: Mapping[str, Any], dims: int, free: str | None) -> dict[tuple[str, str], TimeFunction]:
    """Make the motions of both ends along the axes of a scene."""
    motions = {
        (end, axis): time_function(table.get(end, {}).get(axis, {}), motion_path(end, axis))
        for end, axis in product(ENDS, COORDINATES)
    }
    result = {key: motion for key, motion in motions.items() if motion is not None}
    for end, axis in result:
        if end == free:
            allowed = f"no motion of the end that ends.free names ({free})"
            raise SceneError(f"motion.{end}: given one along {axis}; allowed: {allowed}")
        if axis not in COORDINATES[:dims]:
            axes = ", ".join(COORDINATES[:dims])
            raise SceneError(f"{motion_path(end, axis)}: unknown axis; allowed: {axes}")
    return result


def _point_loads(tables: Mapping[str, Any]) -> Iterator[PointLoad]:
    """Yield all point loads, also those without force."""
    for path, table in listed(tables, "point_load"):
        refuse_missing(path, table, POINT_LOAD)
        factor = time_function(table, path, keeps_start=True)
        yield PointLoad(path, float(table["arc_length"]), table["force"], factor)
