"""Scenes that all tests share: small and soft, so that a run takes milliseconds."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import pytest

from cablepod import scene_limits

SCENES = Path(__file__).resolve().parent.parent / "data" / "scenes"

SOFT: dict[str, Any] = {
    "title": "soft",
    "cable": {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "top_tension": 200.0},
    "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2.0}}},
    "time": {"duration": 4.0, "interval": 0.5},
    "chain": {"links": 8},
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Physics in seconds first, what takes long last."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is not None)


@pytest.fixture
def soft() -> dict[str, Any]:
    """A mapping of a soft, small scene, to be changed at will."""
    return copy.deepcopy(SOFT)


@pytest.fixture
def scenes() -> Path:
    """The folder of the shipped scenes."""
    return SCENES


@pytest.fixture
def any_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let scenes pass whose loads no cable bears: such runs are sure to leave the finite numbers."""
    monkeypatch.setattr(scene_limits, "MOST_STRAIN", math.inf)


def spatial(mapping: dict[str, Any]) -> dict[str, Any]:
    """Return the same scene with a third coordinate in which nothing happens."""
    result = copy.deepcopy(mapping)
    for end in ("lower", "upper"):
        result["ends"][end] = [*result["ends"][end], 0.0]
    if "load" in result:
        result["load"]["uniform"] = [*result["load"]["uniform"], 0.0]
    for load in result.get("point_load", []):
        load["force"] = [*load["force"], 0.0]
    if "points" in result.get("initial", {}):
        result["initial"]["points"] = [[*point, 0.0] for point in result["initial"]["points"]]
    return result
