"""What all public functions do first: checks of options, the model of a scene, members one by one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod.errors import RunStopped, SceneError, one_of, scene_error
from cablepod.parameters._from_scene import Members
from cablepod.periodic._forcing import periodic_forcing
from cablepod.periodic._model import PeriodicModel


def given_names(key: str, given: Any, allowed: tuple[str, ...]) -> tuple[str, ...]:
    """Return names, one or several, as a tuple.

    Raises
    ------
    SceneError
        If one is none of the allowed ones.
    """
    if not isinstance(given, str | list | tuple):
        raise scene_error(key, given, f"some of {', '.join(allowed)}")
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if not isinstance(name, str) or name not in allowed:
            raise scene_error(key, name, one_of(allowed, name))
    return names


def flag(key: str, value: Any) -> bool:
    """Check a truth value."""
    if not isinstance(value, bool | np.bool_):
        raise scene_error(key, value, "True or False")
    return bool(value)


def model_of(
    scene: xr.Dataset, modes: xr.Dataset, *, rank: int | None, order: str, out_of_plane: bool
) -> tuple[PeriodicModel, float]:
    """Return the model of a scene of one member, and the angular frequency of its forcing [rad/s]."""
    flag("out_of_plane", out_of_plane)
    forcing = periodic_forcing(Members(scene)[0])
    return PeriodicModel.of(forcing, modes, rank=rank, order=order, out_of_plane=out_of_plane), forcing.omega


def one_member(scene: xr.Dataset, function: str) -> None:
    """Refuse a scene with ``member``."""
    Members(scene)  # refuses what is no scene
    if "member" in scene.dims:
        raise SceneError(
            f"scene: given {scene.sizes['member']} members; allowed: one, scene.isel(member=0), as {function} follows branches"
        )


def each_member(scene: xr.Dataset, one: Callable[[xr.Dataset], xr.Dataset]) -> xr.Dataset:
    """Compute a scene, or each of its members one by one; members that fail hold nan and their reason in ``failure``."""
    members = Members(scene)
    if "member" not in scene.dims:
        return one(scene)
    results: list[xr.Dataset | None] = []
    reasons: list[str] = []
    for i in range(len(members)):
        try:
            results.append(one(scene.isel(member=i)))
            reasons.append("")
        except (SceneError, RunStopped) as error:
            results.append(None)
            reasons.append(str(error))
    first = next((result for result in results if result is not None), None)
    if first is None:
        raise SceneError(
            f"scene: given no member with a result ({reasons[0]}); allowed: members with periodic responses"
        )
    empty = first.copy(
        data={
            name: np.full_like(v.values, np.nan) if v.dtype.kind == "f" else v.values
            for name, v in first.data_vars.items()
        }
    )
    joined = xr.concat([empty if result is None else result for result in results], "member", join="override")
    varied = {
        str(name): variable
        for name, variable in scene.coords.items()
        if variable.dims == ("member",) and name != "member"
    }
    joined = joined.assign_coords(
        member=scene["member"] if "member" in scene.coords else np.arange(len(members)), **varied
    )
    joined["failure"] = ("member", np.array(reasons))
    joined["failure"].attrs.update(units="1", long_name="reason why the member has no result")
    joined["member"].attrs.update(units="1", long_name="number of the member of an ensemble")
    return joined
