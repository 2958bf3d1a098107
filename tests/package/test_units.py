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


#: Positions of a straight line at two instants, and its places.
LINE = np.array([[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]] * 2)
PLACES = [0.0, 1.5, 3.0]
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
    ("times", "us"): lambda: cp.wind.field(cp.make_scene({**GUY, "wind": WIND}), times=of([0.0, 1.0], "us")),
    ("times", "h"): lambda: cp.snapshots(LINE, arc_length=PLACES, times=of([0.0, 1.0], "h")),
    ("times", "year"): lambda: cp.snapshots(
        xr.DataArray(LINE, dims=("time", "particle", "coordinate"), coords={"time": of([0.0, 1.0], "year").rename(place="time")}),
        arc_length=PLACES,
    ),
    ("times", "days"): lambda: cp.pod.at_times(
        cp.snapshots(LINE, arc_length=PLACES, times=[0.0, 1.0]), times=of([0.0, 1.0], "days")
    ),
    ("amplitude", "mm"): lambda: cp.periodic.stability_map(
        guy(damping=0.05), cp.condensed.vibration_modes(guy(damping=0.05), rank=1), frequency=[1.0, 2.0],
        amplitude=of([1.0], "mm"),
    ),
    ("span", "mm"): lambda: cp.catenary.solve(of([2e4], "mm"), 50.0, 9.8, 2e7, top_tension=15e3),
    ("top_tension", "kN"): lambda: cp.catenary.solve(20.0, 50.0, 9.8, 2e7, top_tension=of([15.0], "kN")),
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


@pytest.mark.parametrize("kind", ["timedelta64[s]", "timedelta64[ns]", "datetime64[s]", bool, str])
def test_instants_that_are_no_numbers_are_refused(kind: Any) -> None:
    times, run = np.array([0, 1]).astype(kind), cp.snapshots(LINE, arc_length=PLACES, times=[0.0, 1.0])
    for call in (
        lambda: cp.snapshots(LINE, arc_length=PLACES, times=times),
        lambda: cp.pod.at_times(run, times=times),
        lambda: cp.wind.field(cp.make_scene({**GUY, "wind": WIND}), times=times),
        lambda: cp.catenary.solve(times, 50.0, 9.8, 2e7, top_tension=15e3),
    ):
        with pytest.raises(cp.SceneError, match=r"^(times|span): given "):
            call()


def test_numbers_of_catenaries_have_one_shape() -> None:
    with pytest.raises(cp.SceneError, match=r"^span, .*: given the shapes span \(2,\), rise \(3,\)"):
        cp.catenary.solve([20.0, 21.0], [50.0, 51.0, 52.0], 9.8, 2e7, top_tension=15e3)
