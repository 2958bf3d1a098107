"""Scene files with every table and kind, their records, and what a refusal of one must be."""

from __future__ import annotations

import copy
import fractions
import functools
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import SOFT

import cablepod as cp

EVERYTHING = """
title = "every table and kind"
gravity = 9.7
[cable]
youngs_modulus = 2.0e7
area = 1.0e-3
density = 1000.0
top_tension = 200.0
[ends]
lower = [0.0, 0.0]
upper = [8.0, 6.0]
[motion.upper.x]
kind = "one_minus_cosine"
amplitude = -0.05
angular_frequency = 2.0
[motion.upper.y]
kind = "harmonic"
amplitude = 0.02
angular_frequency = 3.0
phase = 0.3
[motion.lower.x]
kind = "ramp"
amplitude = 0.1
duration = 2.0
[motion.lower.y]
kind = "polynomial"
coefficients = [0.0, 0.01, 0.002]
[load]
uniform = [1.0, -2.0]
kind = "file"
path = "record.csv"
[[point_load]]
arc_length = 0.25
force = [0.0, -5.0]
[[point_load]]
arc_length = 0.5
force = [3.0, 0.0]
kind = "harmonic"
amplitude = 1.0
angular_frequency = 2.5
[time]
duration = 4.0
interval = 0.5
[chain]
links = 3
link_lengths = [1.0, 2.0, 1.0]
[initial]
top_tension = 260.0
[damping]
mass_proportional = 0.1
link_viscosity = 1e-3
[ensemble]
members = 48
seed = 5
sampling = "sobol"
[ensemble.ranges]
"cable.top_tension" = [150.0, 300.0]
"motion.upper.x.angular_frequency" = [0.1, 1.0]
"""
RECORD = "# by hand\ntime,value\n" + "".join(f"{0.25 * i},{0.1 * i * i}\n" for i in range(17))


def everything() -> dict[str, Any]:
    return {
        "title": "every table and kind",
        "gravity": 9.7,
        "cable": {"youngs_modulus": 2e7, "area": 1e-3, "density": 1000, "top_tension": np.float64(200.0)},
        "ends": {"lower": (0, 0), "upper": np.array([8.0, 6.0])},
        "motion": {
            "upper": {
                "x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2},
                "y": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 3.0, "phase": 0.3},
            },
            "lower": {
                "x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0},
                "y": {"kind": "polynomial", "coefficients": np.array([0.0, 0.01, 0.002])},
            },
        },
        "load": {"uniform": [1.0, -2.0], "kind": "file", "path": "record.csv"},
        "point_load": (
            {"arc_length": fractions.Fraction(1, 4), "force": [0.0, -5.0]},
            {"arc_length": 0.5, "force": [3, 0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.5},
        ),
        "time": {"duration": 4.0, "interval": 0.5},
        "chain": {"links": np.int64(3), "link_lengths": [1.0, 2.0, 1.0]},
        "initial": {"top_tension": np.array(260.0)},
        "damping": {"mass_proportional": 0.1, "link_viscosity": 1e-3},
        "ensemble": {
            "members": 48,
            "seed": 5,
            "sampling": "sobol",
            "ranges": {"cable.top_tension": [150.0, 300.0], "motion.upper.x.angular_frequency": (0.1, 1)},
        },
    }


def put(mapping: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Set the value at a key path, as guy.1.level, making tables on the way; None deletes it."""
    *tables, last = path.split(".")
    table: Any = mapping
    for name in tables:
        table = table[int(name) - 1] if isinstance(table, list) else table.setdefault(name, {})
    if value is None:
        del table[last]
    else:
        table[last] = value
    return mapping


def toml_of(mapping: dict[str, Any]) -> str:
    """Return a scene as the text of a file, each table in one line."""

    def text(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f'"{key}" = {text(item)}' for key, item in value.items()) + "}"
        return f"[{', '.join(map(text, value))}]" if isinstance(value, list | tuple) else json.dumps(value)

    return "\n".join(f"{key} = {text(value)}" for key, value in mapping.items()) + "\n"


LOAD = {"arc_length": 0.5, "force": [0.0, 1.0]}
#: A guy of given length, and a mass on it: for scenes with segments and attachments.
GUY: dict[str, Any] = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "unstretched_length": 61.156, "diameter": 0.014},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "chain": {"links": 10},
    "time": {"duration": 1.0, "interval": 0.1},
}  # fmt: skip
MASS = {"arc_length": 0.5, "mass": 60.0}


@functools.cache
def _compile() -> None:
    """Compile what the checks of a scene call, which takes seconds once on a machine."""
    cp.make_scene(copy.deepcopy(SOFT))
    with pytest.raises(cp.SceneError):
        cp.make_scene({**copy.deepcopy(SOFT), "cable": {**SOFT["cable"], "top_tension": 1.0}})


def refused(mapping: Any, match: str) -> None:
    """Hold that a scene is refused, in one line, soon, and without a word besides."""
    _compile()
    begin = time.process_time()
    with pytest.raises(cp.SceneError, match=match) as caught:
        cp.make_scene(mapping)
    assert time.process_time() - begin < 2.0  # of the processor, whatever else it does; tells a loop or an allocation
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 600
    assert "allowed: " in text


ROWS = [(0.5 * i, 0.1 * i) for i in range(9)]


def csv(rows, header="time,value"):
    return "\n".join([header, *(",".join(str(item) for item in row) for row in rows)]) + "\n"


def write(path: Path, content: str | bytes | None) -> None:
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
