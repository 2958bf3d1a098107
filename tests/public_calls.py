"""Every public function, and those that take Datasets with Datasets of every stage of a small scene."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import xarray as xr
from mast_scenes import SMALL, WIND
from scenes import SOFT

import cablepod as cp

#: The soft scene in space, swaying out of its plane.
SPATIAL: dict[str, Any] = SOFT | {
    "title": "soft, in space",
    "ends": {"lower": [0.0, 0.0, 0.0], "upper": [7.0, 6.0, 3.0]},
    "motion": {
        "upper": {
            "x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2.0},
            "z": {"kind": "harmonic", "amplitude": 0.04, "angular_frequency": 2.0, "phase": 1.0},
        }
    },
    "load": {"uniform": [1.0, -2.0, 3.0]},
}
#: A small mast in the wind.
MAST: dict[str, Any] = SMALL | {"wind": WIND, "time": {"duration": 0.4, "interval": 0.02}}
#: Key paths that the ensemble of these scenes varies.
RANGES = {"cable.top_tension": [150.0, 200.0], "ends.upper.x": [7.5, 8.0]}


@cache
def datasets(spatial: bool = False) -> dict[str, xr.Dataset]:
    """A Dataset of every stage of one small scene."""
    scene = cp.make_scene(SPATIAL if spatial else SOFT)
    members = cp.ensemble.design(scene, RANGES, members=2, seed=1)
    chain = cp.chain.simulate(scene, tolerance=1e-3, outputs=("position", "velocity", "tension"))
    modes, normal = cp.pod.decompose(chain, rank=3), cp.pod.decompose(chain, rank=3, layout="normal")
    condensed = cp.condensed.simulate(scene, normal, rank=2)
    wind = {"speed": 5.0, "direction": [1.0, 0.0, 0.0] if spatial else [1.0, 0.0], "ground": -99.0}
    soft = SPATIAL if spatial else SOFT
    warm = cp.make_scene({**soft, "cable": {**soft["cable"], "thermal_expansion": 1e-4}})
    windy = cp.make_scene({**soft, "cable": {**soft["cable"], "diameter": 0.01}, "wind": wind})
    return {
        "scene": scene,
        "windy": windy,
        "warm": warm,
        "stringing": cp.catenary.stringing(warm, [0.0, 20.0]),
        "gusts": cp.wind.field(windy, times=[0.0, 1.0]),
        "members": members,
        "rest": cp.chain.rest(scene),
        "catenary": cp.catenary.rest(scene),
        "catenaries": cp.catenary.rest(members),
        "chain": chain,
        "modes": modes,
        "vector modes": cp.pod.decompose(chain, rank=3, layout="vector"),
        "normal modes": normal,
        "condensed": condensed,
        "amplitudes": cp.pod.project(chain, modes),
        "comparison": cp.compare.errors(condensed, chain),
        "frequencies": cp.cable.frequencies(scene, count=2),
        "mast": cp.make_scene(MAST),
        "mast frequencies": cp.mast.frequencies(cp.make_scene(MAST), count=4),
        "mast run": cp.mast.simulate(cp.make_scene(MAST), step=0.02),
        "mast motion": cp.mast.simulate(
            cp.make_scene(MAST), step=0.02, outputs=("displacement", "guy_position", "guy_tension")
        ),
        "prepared": cp.condensed.prepare(scene, normal).dataset(),
        "orbit": cp.periodic.orbit(scene, normal, rank=1),
        "response": cp.periodic.frequency_response(scene, normal, rank=1, frequency=(1.9, 2.1), points=5),
        "free": cp.periodic.backbone(scene, normal, rank=1, amplitude=0.02),
        "map": cp.periodic.stability_map(scene, normal, rank=1, frequency=[2.0, 2.1], amplitude=[0.01, 0.02]),
    }


#: Calls: function -> stages of its Datasets, and other arguments that it needs.
CALLS: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "archive.describe": (("chain",), {}),
    "archive.write": (("chain",), {"path": "new.nc"}),
    "cable.frequencies": (("scene",), {}),
    "cable.rest": (("scene",), {}),
    "cable.simulate": (("scene",), {"step": 1e-2}),
    "cable.summary": (("scene",), {}),
    "mast.summary": (("mast",), {}),
    "catenary.rest": (("scene",), {}),
    "catenary.stringing": (("warm",), {"temperatures": [0.0, 20.0]}),
    "chain.rest": (("scene",), {}),
    "chain.simulate": (("scene",), {"step": 1e-3}),
    "compare.errors": (("condensed", "chain"), {}),
    "condensed.prepare": (("scene", "normal modes"), {}),
    "condensed.resume": (("chain",), {}),
    "condensed.simulate": (("scene", "normal modes"), {}),
    "condensed.vibration_modes": (("scene",), {"rank": 2}),
    "ensemble.design": (("scene",), {"ranges": {"cable.top_tension": [150.0, 200.0]}, "members": 2}),
    "ensemble.batches": (("members",), {}),
    "ensemble.run": (("members",), {"path": "folder"}),
    "galerkin.simulate": (("scene", "modes"), {}),
    "mast.frequencies": (("mast",), {"count": 4}),
    "mast.rest": (("mast",), {}),
    "mast.simulate": (("mast",), {"step": 0.02, "outputs": ("guy_tension", "displacement")}),
    "periodic.backbone": (("scene", "normal modes"), {"amplitude": 0.1}),
    "periodic.frequency_response": (("scene", "normal modes"), {"frequency": (1.0, 2.0), "points": 10}),
    "periodic.orbit": (("scene", "normal modes"), {"rank": 2}),  # the third mode has a long way to its orbit in space
    "periodic.stability_map": (("scene", "normal modes"), {"frequency": [1.0], "amplitude": [0.05]}),
    "plots.amplitudes": (("condensed",), {}),
    "plots.animate": (("chain", "condensed"), {}),
    "plots.animate_mast": (("mast motion",), {"frames": 2}),
    "plots.bending_moments": (("mast run",), {}),
    "plots.guy_tensions": (("mast run",), {}),
    "plots.mast_shapes": (("mast frequencies",), {}),
    "plots.backbone": (("free",), {}),
    "plots.end_tensions": (("chain",), {}),
    "plots.error_against_run_time": (("comparison",), {}),
    "plots.error_over_time": (("comparison",), {}),
    "plots.frequency_response": (("response",), {}),
    "plots.modes": (("modes",), {}),
    "plots.multipliers": (("response",), {}),
    "plots.animate_orbit": (("orbit",), {}),
    "plots.orbit": (("orbit",), {}),
    "plots.parameter_map": (("comparison",), {"variable": "error", "x": "a", "y": "b"}),
    "plots.phase_portraits": (("chain",), {}),
    "plots.report": (("chain",), {"path": "page.html"}),
    "plots.rest": (("catenary", "rest"), {}),
    "plots.shapes": (("chain", "condensed"), {}),
    "plots.singular_values": (("modes",), {}),
    "plots.snapshots": (("chain", "chain"), {}),
    "plots.stability_map": (("map",), {}),
    "plots.stringing": (("stringing",), {}),
    "plots.tension": (("chain",), {}),
    "plots.wind_field": (("gusts",), {}),
    "pod.at_times": (("chain",), {"times": [0.0, 1.0]}),
    "pod.decompose": (("chain",), {}),
    "pod.project": (("chain", "modes"), {}),
    "pod.reconstruct": (("amplitudes", "modes"), {}),
    "rigid.rest": (("scene",), {}),
    "rigid.simulate": (("scene",), {"step": 1e-3}),
    "study.run": (("scene",), {}),
    "study.design": (("mast",), {"directions": [0.0], "speeds": [20.0], "storms": 1}),
    "summary": (("scene",), {}),
    "study.summary": (("scene",), {}),
    "wind.field": (("windy",), {}),
}


def public_functions() -> dict[str, Callable[..., Any]]:
    """Functions of the facade and of its modules, by their dotted names."""
    found = {name: getattr(cp, name) for name in cp.__all__}
    for name, module in list(found.items()):
        if inspect.ismodule(module):
            found |= {f"{name}.{inner}": getattr(module, inner) for inner in module.__all__}
    return {name: item for name, item in found.items() if inspect.isfunction(item)}


def function_of(name: str) -> Any:
    """The public function of a dotted name."""
    found: Any = cp
    for part in name.split("."):
        found = getattr(found, part)
    return found
