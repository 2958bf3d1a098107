"""Scenes of the tests of masts."""

from __future__ import annotations

import copy
from typing import Any

import cablepod as cp

SMALL: dict[str, Any] = {
    "title": "a small mast",
    "mast": {
        "height": 30.0, "bending_stiffness": 4.0e6, "mass": 20.0, "elements": 8, "modes": 3,
        "load": [{"level": 30.0, "force": [1000.0, 0.0, 400.0], "kind": "ramp", "amplitude": 1.0, "duration": 0.3}],
    },
    "cables": {"guy": {"youngs_modulus": 1.6e11, "area": 3.8e-5, "density": 8000.0, "diameter": 0.008}},
    "guy": [{"cable": "guy", "level": 28.0, "radius": 20.0, "count": 3, "direction": [1.0, 0.0, 0.0], "top_tension": 5000.0}],
    "damping": {"mass_proportional": 0.1},
    "time": {"duration": 4.0, "interval": 0.04},
    "chain": {"links": 20},
}  # fmt: skip
WIND: dict[str, Any] = {
    "speed": 20.0, "direction": [1.0, 0.0, 0.0], "turbulence": {"spectrum": "kaimal", "seed": 3}
}  # fmt: skip
INSULATOR = {"distance_from_lower": 6.0, "mass": 15.0, "drag_area": 0.05}
#: Segments and attachments of the guys.
THINGS: dict[str, Any] = {
    "segment": [{"to": 0.3, "youngs_modulus": 5e10, "density": 5000.0, "diameter": 0.02}, {}],
    "attachment": [
        INSULATOR, {"distance_from_upper": 10.0, "damper": 100.0, "spring": 300.0, "direction": "normal"}
    ],
}  # fmt: skip


def small_tables(change: Any) -> dict[str, Any]:
    """The nested tables of the small mast, changed in place by a function of them."""
    mapping = copy.deepcopy(SMALL)
    change(mapping)
    return mapping


def small(change: Any = lambda mapping: None) -> Any:
    """The small mast, changed in place by a function of its nested tables."""
    return cp.make_scene(small_tables(change))


def windy(mapping: dict[str, Any]) -> None:
    """Put gusts in the place of the load."""
    mapping["wind"] = WIND
    mapping["mast"]["drag_area"] = 0.3
    del mapping["mast"]["load"]


def two_sections_in_wind(mapping: dict[str, Any]) -> None:
    """Give the mast two sections and a load, in steady wind along neither axis."""
    mapping["wind"] = {**WIND, "direction": [0.6, 0.0, 0.8], "profile": "power", "exponent": 0.2, "ground": -1.0}
    del mapping["wind"]["turbulence"]
    mapping["mast"]["drag_area"] = 0.3
    mapping["mast"]["section"] = [{"from": 0.0, "to": 12.0, "mass": 35.0, "bending_stiffness": 6e6, "drag_area": 0.4}]
    mapping["mast"]["load"] = [{"level": 30.0, "force": [300.0, 0.0, -150.0]}]
