"""Parameters of a scene Dataset, and of each of its members."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import Any, overload

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError
from cablepod.parameters._checks import choice
from cablepod.parameters._given import cross_section, upper_end
from cablepod.parameters._key_paths import dotted, motion_path, point_load_path, table_at, variable_name, whole_table_at
from cablepod.parameters._keys import (
    CABLE,
    ICE,
    INITIAL,
    LENGTH_KEYS,
    POINT_LOAD,
    TABLES,
    TURBULENCE,
    WIND,
    check_damping,
    exactly_one,
    time_function_keys,
)
from cablepod.parameters._nonuniform import VARIABLES as NONUNIFORM
from cablepod.parameters._nonuniform import with_segments_and_attachments
from cablepod.parameters._parameters import Parameters, PointLoad
from cablepod.parameters._particles import check_own, number_of_links, with_means
from cablepod.parameters._scene_values import check_values, refuse_gap
from cablepod.parameters._temperature import TEMPERATURES, expanded, expansion_of, temperatures_of
from cablepod.parameters._time_functions import SINES, TimeFunction
from cablepod.provenance import digest

#: Variables of a record: times [s] and values, duration of the smooth start [s].
RECORD = ("time", "value", "ramp")
#: Beginnings of the variables that stacked parameters hold, and variables of terms that these do not cover.
STACKED_TABLES = ("gravity", *TEMPERATURES, "cable_", "ends_", "load_", "motion_", "damping_")
#: Variables that each member has.
NEEDED = ("gravity", "ends_lower")
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
            elif not _is_gap(value := variable.values[()]):
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
        return _from_values(
            self.fixed
            | {name: values[index] for name, values in self.varied.items()}
            | {name: values[index] for name, values in self.gapped.items() if not _is_gap(values[index])}
        )

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
            or any(name.startswith(("wind_", "ice_", *NONUNIFORM)) for name in names)
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
        return _from_values(values, number=np.asarray)


def _has_gap(values: np.ndarray) -> bool:
    """Tell whether a row of the values of a variable (members, ...) is a gap."""
    if values.dtype.kind != "f":
        return any(map(_is_gap, values))
    missing = np.isnan(values).reshape(len(values), -1)  # ten thousand members in no time
    return bool(missing.shape[1] and missing.all(axis=1).any())


def _is_gap(value: Any) -> bool:
    """Tell whether a value is nan, with which xarray.concat fills the variables that a scene lacks."""
    if isinstance(value, float | str):  # the common case, ten times as fast as the test of arrays
        return value != value
    array = np.asarray(value)
    return array.size > 0 and array.dtype.kind in "fO" and bool(np.all(array != array))


def _from_values(values: Mapping[str, Any], number: Callable[[Any], Any] = float, above: str = "") -> Parameters:
    """Make parameters from the values of scene variables by name, converted by `number`.

    `above` is the beginning of the paths of segments and attachments, for messages.
    """
    uniform = _uniform_from_values(values, number)
    if any(name.startswith(NONUNIFORM) for name in values):
        if uniform.own_keys:
            raise SceneError(f"{uniform.own_keys[0]}: given; allowed: none beside [[segment]] and [[attachment]]")
        return with_segments_and_attachments(uniform, values, _uniform_from_values, above)
    return uniform


def _uniform_from_values(values: Mapping[str, Any], number: Callable[[Any], Any] = float) -> Parameters:
    """Make the parameters of a cable without segments and attachments, as :func:`_from_values`."""
    for name in NEEDED:
        if name not in values:
            raise SceneError(f"{dotted(name)}: missing; allowed: a number, as make_scene gives it")
    cable = table_at(values, "cable", CABLE)
    time, chain, damping = (table_at(values, name, TABLES[name]) for name in ("time", "chain", "damping"))
    check_own(cable, chain, table_at(values, "initial", INITIAL))
    length_key = exactly_one("cable", cable, LENGTH_KEYS)
    gravity, free_end = number(values["gravity"]), str(values["ends_free"]) if "ends_free" in values else None
    section = cross_section(with_means(cable, chain, free_end), gravity, number=number)
    weight = np.zeros(values["ends_lower"].shape)
    dims = weight.shape[-1]
    weight[..., 1] = -section.weight
    motions = {key: _time_function(values, motion_path(*key)) for key in product(ENDS, COORDINATES[:dims])}
    result = Parameters(
        stiffness=section.stiffness,
        area=section.area,
        mass=section.mass,
        weight=weight,
        lower=values["ends_lower"],
        upper=upper_end(table_at(values, "ends", TABLES["ends"])),
        free_end=free_end,
        motions={key: motion for key, motion in motions.items() if motion is not None},
        load=values["load_uniform"] if np.any(values.get("load_uniform", 0.0)) else None,
        load_factor=_time_function(values, "load", keeps_start=True),
        point_loads=tuple(load for load in _point_loads(values) if np.any(load.force)),
        stiffness_key=section.stiffness_key,
        weight_key=section.weight_key,
        length_key=length_key,
        length_value=number(cable[length_key]),
        duration=float(time["duration"]) if "duration" in time else None,
        interval=float(time["interval"]) if "interval" in time else None,
        links=int(chain["links"]) if "links" in chain else number_of_links(chain),
        link_lengths=chain.get("link_lengths"),
        initial=table_at(values, "initial", INITIAL),
        mass_damping=_nonzero(damping, "mass_proportional", number),
        link_viscosity=_nonzero(damping, "link_viscosity", number),
        tension_damping=_nonzero(damping, "tension_proportional", number),
        damping_ratios=_damping_ratios(damping),
        has_list_of_ratios="ratios" in damping,
        breaking_strength=number(cable["breaking_strength"]) if "breaking_strength" in cable else None,
        diameter=number(cable["diameter"]) if "diameter" in cable else None,
        drag_coefficient=number(cable.get("drag_coefficient", 1.2)),
        wind=whole_table_at(values, "wind", WIND) or None,
        turbulence=whole_table_at(values, "wind.turbulence", TURBULENCE, also=("decay",), unless="record") or None,
        masses=chain.get("masses"),
        link_stiffness=chain.get("stiffness"),
        temperatures=temperatures_of(values, number),
    )
    result = expanded(result, expansion_of(values, cable, "cable", number))
    ice = whole_table_at(values, "ice", ICE)
    return _with_ice(result, number(ice["thickness"]), number(ice["density"]), gravity) if ice else result


def _with_ice(p: Parameters, thickness: Any, density: Any, gravity: Any) -> Parameters:
    """Return the cable with ice, which adds mass, weight and diameter, and neither stiffness nor length."""
    if not np.any(thickness):
        return p
    mass = ice_mass(density, thickness, p.diameter)
    weight = p.weight.copy()
    weight[..., 1] -= mass * gravity
    return replace(p, mass=p.mass + mass, weight=weight, diameter=p.diameter + 2.0 * thickness, bare=p.bare or p)


def ice_mass(density: Any, thickness: Any, diameter: Any) -> Any:
    """Return the mass per length of a round coat of ice on a diameter [kg/m]."""
    return density * np.pi * thickness * (diameter + thickness)


def _check_present(path: str, table: Mapping[str, Any], needed: tuple[str, ...]) -> None:
    """Refuse the table of a scene whose variables somebody dropped."""
    for name in needed:
        if name not in table:
            raise SceneError(f"{path}.{name}: missing; allowed: a number, as make_scene gives it")


def _nonzero(table: Mapping[str, Any], name: str, number: Callable[[Any], Any]) -> Any:
    return number(table[name]) if name in table and np.any(table[name]) else None


def _damping_ratios(damping: Mapping[str, Any]) -> tuple[float, ...] | None:
    """Return the damping ratios of the vibrations about rest; None for none."""
    check_damping(damping)
    given = np.atleast_1d(damping["ratios"] if "ratios" in damping else damping.get("ratio", 0.0))
    return tuple(map(float, given)) if given.any() else None


def _time_function(values: Mapping[str, Any], path: str, *, keeps_start: bool = False) -> TimeFunction | None:
    """Make the time function of the table at a key path; None without `kind`."""
    if (variable := variable_name(f"{path}.kind")) not in values:
        return None
    kind = str(choice(*time_function_keys("1"))(f"{path}.kind", str(values[variable])))
    keys = time_function_keys("1")[kind]
    table = table_at(values, path, RECORD if kind == "file" else keys)
    needed = tuple(name for name, key in keys.items() if key.required or key.default is not None)
    _check_present(path, table, RECORD[:2] if kind == "file" else needed)
    if kind == "file":  # of members with records of other lengths, nan after the last instant
        last = int(np.isfinite(table["time"]).sum())
        table |= {column: table[column][:last] for column in RECORD[:2]}
    return TimeFunction(kind, table, keeps_start)


def _point_loads(values: Mapping[str, Any]) -> list[PointLoad]:
    """Make all point loads, also those without force."""
    loads: list[PointLoad] = []
    while "force" in (table := table_at(values, path := point_load_path(len(loads) + 1), POINT_LOAD)):
        _check_present(path, table, ("arc_length",))
        factor = _time_function(values, path, keeps_start=True)
        loads.append(PointLoad(path, float(table["arc_length"]), table["force"], factor))
    refuse_gap(values, "point_load", POINT_LOAD, len(loads))
    return loads
