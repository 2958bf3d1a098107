"""Arrays with labels that are given as options have the units of the package, or are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from periodic_scenes import guy
from scenes import SOFT
from wind_scenes import GUY, WIND

import cablepod as cp


def of(values: Any, units: str) -> xr.DataArray:
    """Values with units."""
    return xr.DataArray(np.array(values), dims="place", attrs={"units": units})


#: Option and units -> call.
CALLS: dict[tuple[str, str], Callable[[], Any]] = {
    ("times", "ms"): lambda: cp.chain.simulate(cp.make_scene(SOFT), times=of([0.0, 1.0], "ms")),
    ("times", "min"): lambda: cp.rigid.simulate(cp.make_scene(SOFT), times=of([0.0, 1.0], "min")),
    ("frequency", "Hz"): lambda: cp.periodic.frequency_response(
        guy(damping=0.05), cp.condensed.vibration_modes(guy(damping=0.05), rank=1), frequency=of([1.0, 2.0], "Hz")
    ),
    ("frequency", "1/s"): lambda: cp.periodic.stability_map(
        guy(damping=0.05), cp.condensed.vibration_modes(guy(damping=0.05), rank=1), frequency=of([1.0, 2.0], "1/s"),
        amplitude=[1e-3],
    ),
    ("directions", "degree"): lambda: cp.study.design(
        cp.make_scene({**GUY, "wind": WIND}), directions=of([0.0, 90.0], "degree"), speeds=[20.0], storms=1
    ),
    ("speeds", "km/h"): lambda: cp.study.design(
        cp.make_scene({**GUY, "wind": WIND}), directions=[0.0], speeds=of([72.0], "km/h"), storms=1
    ),
    ("points", "mm"): lambda: cp.wind.field(
        cp.make_scene({**GUY, "wind": WIND}), points=xr.DataArray(np.ones((1, 3)), dims=("p", "c"), attrs={"units": "mm"})
    ),
    ("arc_length", "mm"): lambda: cp.modes(
        [np.sin(np.pi * np.linspace(0.0, 1.0, 9))], arc_length=of(np.linspace(0.0, 1.0, 9), "mm")
    ),
}  # fmt: skip


@pytest.mark.parametrize(("option", "units"), CALLS)
def test_other_units_are_refused(option: str, units: str) -> None:
    with pytest.raises(cp.SceneError, match=rf"^{option}: given units '{units}'; allowed: "):
        CALLS[option, units]()


def test_units_of_the_package_and_none_are_taken() -> None:
    scene = cp.make_scene(SOFT)
    known = cp.chain.simulate(scene, step=1e-3, times=[0.0, 0.5]).position
    for times in (of([0.0, 0.5], "s"), xr.DataArray([0.0, 0.5], dims="time")):
        assert known.equals(cp.chain.simulate(scene, step=1e-3, times=times).position)
