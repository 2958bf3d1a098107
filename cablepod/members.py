"""Scenes with several members: one call for each, joined along ``member``."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar, cast

import xarray as xr

from cablepod import provenance

F = TypeVar("F", bound=Callable[..., xr.Dataset])


def over_members(function: F) -> F:
    """Let a function of a scene take scenes with a dimension ``member``; the varied parameters become coordinates along it."""

    @functools.wraps(function)
    def wrapper(scene: xr.Dataset, *args: Any, **options: Any) -> xr.Dataset:
        if not isinstance(scene, xr.Dataset) or "member" not in scene.dims:
            return function(scene, *args, **options)
        results = [function(scene.isel(member=i, drop=True), *args, **options) for i in range(scene.sizes["member"])]
        joined = xr.concat(results, dim="member", data_vars="all", coords="minimal", compat="override", join="exact")
        joined.attrs = dict(results[0].attrs)
        varied = {
            name: variable
            for name, variable in scene.variables.items()
            if variable.dims == ("member",) and name != "member"
        }
        joined = joined.assign_coords({name: variable.copy() for name, variable in varied.items()})
        if "member" in scene.coords:
            joined = joined.assign_coords(member=scene["member"])
        # the attributes of a joined scene may be those of its first member: the values of all make the identity
        values = {str(name): variable.values for name, variable in scene.variables.items() if "member" in variable.dims}
        name = f"{function.__module__.removeprefix('cablepod.')}.{function.__name__}"
        return provenance.record(joined, function=name, parameters={"members": values}, inputs=[results[0]])

    return cast(F, wrapper)
