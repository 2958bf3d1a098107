"""Mistakes in scenes of every kind, each on every key that it can befall: a refusal that names the key.

Wrong types, signs and numbers, missing and misspelt keys, wrong tables; other units are in test_notes.py.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import cablepod as cp

#: A scene with most keys; nothing is unusual about it.
SCENE: dict[str, Any] = {
    "title": "a guy",
    "gravity": 9.81,
    "cable": {
        "youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 7850.0, "top_tension": 15000.0, "breaking_strength": 1.2e5
    },
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.2, "angular_frequency": 1.0, "phase": 0.0}}},
    "load": {"uniform": [15.0, 0.0]},
    "point_load": [{"arc_length": 0.5, "force": [0.0, -100.0]}],
    "damping": {"mass_proportional": 0.05},
    "time": {"duration": 10.0, "interval": 1.0},
    "chain": {"links": 8},
    "ensemble": {"members": 4, "seed": 1, "sampling": "sobol", "ranges": {"cable.top_tension": [14000.0, 16000.0]}},
}  # fmt: skip
NUMBERS = (
    "gravity", "cable.youngs_modulus", "cable.area", "cable.density", "cable.top_tension", "cable.breaking_strength",
    "motion.upper.x.amplitude", "motion.upper.x.angular_frequency", "motion.upper.x.phase", "point_load.1.arc_length",
    "damping.mass_proportional", "time.duration", "time.interval", "chain.links", "ensemble.members", "ensemble.seed",
)  # fmt: skip
VECTORS = ("ends.lower", "ends.upper", "load.uniform", "point_load.1.force")
TEXTS = ("title", "motion.upper.x.kind", "ensemble.sampling")
TABLES = ("cable", "ends", "motion", "motion.upper", "motion.upper.x", "load", "time", "chain", "damping", "ensemble")
REQUIRED = (
    "cable.youngs_modulus", "cable.area", "cable.density", "cable.top_tension", "ends.lower", "ends.upper",
    "motion.upper.x.kind", "motion.upper.x.amplitude", "motion.upper.x.angular_frequency", "load.uniform",
    "point_load.1.arc_length", "point_load.1.force", "time.duration", "time.interval", "chain.links", "ensemble.members",
    "ensemble.ranges",
)  # fmt: skip
SIGNED = ("motion.upper.x.amplitude", "motion.upper.x.phase")


def changed(path: str, value: Any, *, remove: str = "") -> dict[str, Any]:
    """The scene with a value at a key path of nested tables, and a key removed."""
    scene = copy.deepcopy(SCENE)
    for target, action in ((remove, "remove"), (path, "set")):
        if not target:
            continue
        *tables, name = target.split(".")
        table: Any = scene
        for part in tables:
            table = table[int(part) - 1] if isinstance(table, list) else table.setdefault(part, {})
        if action == "remove":
            del table[name]
        else:
            table[name] = value
    return scene


def value_at(path: str) -> Any:
    table: Any = SCENE
    for part in path.split("."):
        table = table[int(part) - 1] if isinstance(table, list) else table[part]
    return table


def given(path: str, value: Any) -> str:
    """The beginning of the refusal of a value by its own key; long ones are cut."""
    return f"{path}: given {repr(value)[:9]}"


def misspelt(name: str) -> list[str]:
    """Leave out the third letter; swap the second and the third."""
    return sorted({name[:2] + name[3:], name[0] + name[2] + name[1] + name[3:]} - {name})


def wrong_values():
    """Yield kind, scene and what the message must name: wrong types, numbers and signs."""
    for path in NUMBERS:
        for value in ("12", None, [1.0, 2.0], {}, True, 1j, np.array([1.0, 2.0])):
            yield f"type {path} {type(value).__name__}", changed(path, value), given(path, value)
        for value in (float("nan"), float("inf"), 1e300, 10**400):
            yield f"number {path} {str(value)[:5]}", changed(path, value), given(path, value)
        if path not in SIGNED:
            value = -abs(value_at(path)) - 1
            yield f"sign {path}", changed(path, value), given(path, value)
    for path in VECTORS:
        for value in (1.0, "1, 2", [1.0], [1.0, 2.0, 3.0], [1.0, "2"], [1.0, None], [float("nan"), 1.0], {"x": 1.0}):
            yield f"vector {path} {value}", changed(path, value), path.split(".")[0]
    for path in TEXTS:
        for value in (1.0, None, "", ["harmonic"]):
            yield f"text {path} {value}", changed(path, value), path
    for path in TABLES:
        for value in (1.0, "table", [1.0], None):
            yield f"table {path} {value}", changed(path, value), path


def wrong_keys():
    """Yield the same of missing and misspelt keys, and of keys in another table."""
    for path in REQUIRED:
        table, _, name = path.rpartition(".")
        said = table if name in ("density", "top_tension") else path
        yield f"missing {path}", changed("", None, remove=path), said
        for wrong in misspelt(name):
            yield (
                f"misspelt {table}.{wrong}",
                changed(f"{table}.{wrong}", value_at(path), remove=path),
                f"{table}.{wrong}",
            )
    for table in ("cable", "ends", "motion", "load", "point_load", "damping", "time", "chain", "ensemble"):
        for wrong in misspelt(table):
            yield f"misspelt {wrong}", changed(wrong, SCENE[table], remove=table), wrong
    for path in ("cable.area", "ends.upper", "time.duration", "chain.links", "damping.mass_proportional"):
        name = path.rpartition(".")[2]
        yield f"nesting {name}", changed(name, value_at(path), remove=path), name
        elsewhere = "time" if path.startswith("cable") else "cable"
        yield f"nesting {elsewhere}.{name}", changed(f"{elsewhere}.{name}", value_at(path)), f"{elsewhere}.{name}"


def wrong_together():
    """Yield the same of keys that contradict each other."""
    yield "two lengths", changed("cable.unstretched_length", 61.0), "unstretched_length"
    yield "two weights", changed("cable.specific_weight", 77000.0), "specific_weight"
    yield "a point twice", changed("ends.upper", [0.0, 0.0]), "ends.upper"
    yield "interval above duration", changed("time.interval", 20.0), "time.interval"
    yield "the name of a variable", changed("cable_area", 1e-4), "cable.area"
    yield "range of no number", changed("ensemble.ranges", {"cable.title": [1.0, 2.0]}), "ensemble.ranges.cable.title"
    yield "reversed range", changed("ensemble.ranges", {"cable.area": [2e-4, 1e-4]}), "ensemble.ranges.cable.area"
    yield "a bound that is none", changed("ensemble.ranges", {"cable.area": [-1.0, 1e-4]}), "cable.area"
    yield "an axis too many", changed("motion.upper.z", SCENE["motion"]["upper"]["x"]), "motion.upper.z"


MISTAKES = [*wrong_values(), *wrong_keys(), *wrong_together()]


def test_there_are_enough():
    assert len({kind for kind, _, _ in MISTAKES}) == len(MISTAKES) >= 200
    assert str(cp.summary(cp.make_scene(SCENE)).note.values) == ""


@pytest.mark.parametrize(("kind", "scene", "named"), MISTAKES, ids=[kind for kind, _, _ in MISTAKES])
def test_a_mistake_is_refused_by_name(kind, scene, named):
    before = repr(scene)
    with pytest.raises(cp.SceneError) as caught:
        cp.make_scene(scene)
    said = str(caught.value)
    assert said.startswith(named) if ": given" in named else named in said
    assert "; allowed: " in said
    assert "\n" not in said
    assert repr(scene) == before
    if kind.startswith("misspelt"):
        assert "; try: " in said
