"""Parameters of a scene Dataset, and of each of its members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, overload

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError
from cablepod.parameters._keys import CABLE, INITIAL, LENGTH_KEYS, WEIGHT_KEYS, exactly_one, time_function_keys
from cablepod.parameters._parameters import Parameters, PointLoad
from cablepod.parameters._time_functions import TimeFunction


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
        return _from_values(
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


def _from_values(value: Mapping[str, Any]) -> Parameters:
    cable = {key: value[f"cable_{key}"] for key in CABLE if f"cable_{key}" in value}
    length_key = exactly_one("cable", cable, LENGTH_KEYS)
    weight_key = exactly_one("cable", cable, WEIGHT_KEYS)

    def number(name: str) -> float | None:
        return float(value[name]) if name in value else None

    def function(prefix: str) -> TimeFunction | None:
        if f"{prefix}_kind" not in value:
            return None
        kind = str(value[f"{prefix}_kind"])
        names = ("time", "value") if kind == "file" else tuple(time_function_keys("1")[kind])
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
        free_end=str(value["ends_free"]) if "ends_free" in value else None,
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
        initial={key: value[f"initial_{key}"] for key in INITIAL if f"initial_{key}" in value},
        mass_damping=number("damping_mass_proportional") or None,
        link_viscosity=number("damping_link_viscosity") or None,
    )
