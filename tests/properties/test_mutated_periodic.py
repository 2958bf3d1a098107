"""Mutated scenes under periodic forcing: a result without nan or a clear error, in time.

Fifteen scenes in the suite, as many as CABLEPOD_FUZZ says otherwise, from another seed each time.
"""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
import xarray as xr
from hypothesis import event, given, settings
from hypothesis import strategies as st
from mutations import clear, finite, in_time, mutated, tried
from periodic_scenes import GUY, STRING
from random_scenes import COMMON, MANY

import cablepod as cp

HARMONIC = {"kind": "harmonic", "angular_frequency": 6.1}


def changed(base: dict[str, Any], **tables: dict[str, Any]) -> dict[str, Any]:
    """Copy a scene with more in its tables."""
    scene = copy.deepcopy(base)
    for key, values in tables.items():
        scene[key] = scene.get(key, {}) | values
    return scene


BASES = (
    GUY,
    changed(GUY, cable={"top_tension": 4050.0}, damping={"mass_proportional": 0.15}),
    changed(GUY, damping={"tension_proportional": 1e-3}),
    changed(
        GUY,
        motion={
            "upper": {"y": HARMONIC | {"kind": "one_minus_cosine", "amplitude": 0.01}},
            "lower": {"x": HARMONIC | {"amplitude": 0.002}},
        },
    ) | {"point_load": [{"arc_length": 0.4, "force": [200.0, 0.0], **HARMONIC, "amplitude": 0.5}]},
    changed(STRING, load={"uniform": [0.0, 0.6], **HARMONIC, "amplitude": 1.0}, damping={"mass_proportional": 0.05}),
    changed(
        GUY, ends={"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]},
        motion={"upper": {"x": HARMONIC | {"amplitude": 0.003}, "z": HARMONIC | {"amplitude": 0.002, "phase": 1.0}}},
    ),
)  # fmt: skip


def without_gaps(result: xr.Dataset) -> None:
    """Hold that no number is nan but those of points that say why they have none."""
    if "failure" in result and result["failure"].dims:
        failed = result["failure"] != ""
        finite(result.where(~failed, 0.0).drop_vars([n for n in result.data_vars if result[n].dtype.kind in "OUS"]))
    else:
        finite(result)


def asked(what: str, function: Any, *arguments: Any, **options: Any) -> None:
    """Call a function: a result without nan, or a clear error."""
    try:
        without_gaps(function(*arguments, **options))
    except (cp.SceneError, cp.RunStopped) as error:
        event(f"{what}: {type(error).__name__}")
        clear(error)


def studied(mapping: dict[str, Any], function: str, rank: int, order: str) -> None:
    """Ask one function for the periodic responses of a scene."""
    scene = tried("scene", cp.make_scene, mapping)
    if scene is None:
        return
    modes = tried("condensed.vibration_modes", cp.condensed.vibration_modes, scene, rank=rank, links=24)
    if modes is None:
        return
    first = float(modes["angular_frequency"][0])
    given = [float(scene[name]) for name in scene.data_vars if str(name).endswith("angular_frequency")]
    omega = abs(given[0]) if given and np.isfinite(given[0]) and given[0] else first
    if function == "orbit":
        asked(function, cp.periodic.orbit, scene, modes, order=order, outputs=("position", "tension_extremes"))
    elif function == "frequency_response":
        asked(
            function, cp.periodic.frequency_response, scene, modes, order=order, frequency=(0.8 * omega, 1.25 * omega)
        )
    elif function == "backbone":
        length = float(np.linalg.norm(scene["ends_upper"].values - scene["ends_lower"].values))
        asked(function, cp.periodic.backbone, scene, modes, amplitude=0.01 * length)
    else:
        amplitude = [1e-3, 1e-2, 0.1]
        asked(
            function, cp.periodic.stability_map, scene, modes, frequency=omega * np.linspace(0.8, 1.2, 5),
            amplitude=amplitude,
        )  # fmt: skip


FUNCTIONS = ("orbit", "orbit", "frequency_response", "frequency_response", "stability_map", "backbone")


@settings(max_examples=MANY or 15, **COMMON)
@given(mutated(BASES), st.sampled_from(FUNCTIONS), st.integers(1, 3), st.sampled_from(("leading", "leading", "exact")))
def test_a_mutated_scene_has_periodic_responses_or_a_clear_error(mapping, function, rank, order):
    with in_time(), warnings.catch_warnings():
        warnings.simplefilter("error")  # what numpy warns of is a nan on its way
        for known in (cp.NotConvergedWarning, cp.OutOfRangeWarning, cp.UnusualSceneWarning):
            warnings.simplefilter("ignore", known)
        studied(mapping, function, rank, order)
