"""Guys of hosts, and their prepared models on sines."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from references.numbers import Numbers

import cablepod as cp

GUY: dict[str, Any] = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 8000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [50.0, 35.0]},
    "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": -0.05, "angular_frequency": 0.9}}},
    "damping": {"mass_proportional": 0.1},
    "time": {"duration": 8.0, "interval": 1.0},
}
SPATIAL: dict[str, Any] = {
    **GUY,
    "ends": {"lower": [0.0, 0.0, 0.0], "upper": [50.0, 35.0, 8.0]},
    "load": {"uniform": [0.0, 0.0, 4.0]},
    "motion": {
        "upper": {
            "x": {"kind": "harmonic", "amplitude": -0.05, "angular_frequency": 0.9},
            "z": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 0.8},
        }
    },
}
SCENES = {"planar": GUY, "spatial": SPATIAL}


def sines(rank: int, dims: int = 2, points: int = 41) -> xr.Dataset:
    """Modes of layout "normal" that are sines."""
    sigma = np.linspace(0.0, 1.0, points)
    shapes = np.sin(np.pi * np.outer(np.arange(1, rank + 1), sigma))
    return cp.modes(shapes if dims == 2 else np.stack([shapes, shapes]), arc_length=sigma)


def prepared(mapping: dict[str, Any], rank: int = 4, points: int = 41, **options: Any) -> Any:
    """A prepared model of a scene on sines."""
    modes = sines(rank, len(mapping["ends"]["upper"]), points)
    return cp.condensed.prepare(cp.make_scene(mapping), modes, **options)


def motion(mapping: dict[str, Any], times: Any) -> list[np.ndarray]:
    """Position, velocity and acceleration of the upper end, each (time, dims)."""
    return [np.ascontiguousarray(Numbers(cp.make_scene(mapping)).end_positions(times, k)[:, 1]) for k in range(3)]


def table(mapping: dict[str, Any], step: float) -> list[np.ndarray]:
    """The same at all steps of the scene's duration."""
    return motion(mapping, step * np.arange(round(mapping["time"]["duration"] / step) + 1))


def joined(run: xr.Dataset) -> np.ndarray:
    """Amplitudes of both normals side by side."""
    return np.concatenate([run[key].values for key in ("amplitude", "amplitude_out_of_plane") if key in run], axis=1)
