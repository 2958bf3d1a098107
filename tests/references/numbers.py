"""Numbers of a scene of one uniform cable, read anew from its Dataset: motions of the ends, loads, mass and stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

import cablepod as cp


def time_function(scene: xr.Dataset, key: str) -> Callable[..., Any]:
    """Return the function of time of the table at `key`, and its derivatives: 1 without a kind."""
    names = [str(name).removeprefix(f"{key}_") for name in scene.variables if str(name).startswith(f"{key}_")]
    values = {name: scene[f"{key}_{name}"].values[()] for name in names}
    kind, omega, phase, size, width = (
        values.get(name, default)
        for name, default in (
            ("kind", ""),
            ("angular_frequency", 0.0),
            ("phase", 0.0),
            ("amplitude", 1.0),
            ("ramp", 0.0),
        )
    )
    step = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])

    def smooth(t: Any, duration: float, order: int) -> Any:
        inside = (t >= 0.0) & (t <= duration)
        return np.where(inside, step.deriv(order)(t / duration) / duration**order, float(order == 0) * (t > 0.0))

    def plain(t: Any, order: int) -> Any:
        turned = omega * t + 0.5 * np.pi * order
        if kind == "harmonic":
            return size * (omega**order * np.sin(turned + phase) - (order == 0) * np.sin(phase))
        if kind == "one_minus_cosine":
            return size * ((order == 0) - omega**order * np.cos(turned))
        if kind == "polynomial":
            return np.polynomial.Polynomial([0.0, *values["coefficients"]]).deriv(order)(t)
        return size * smooth(t, values["duration"], order) if kind == "ramp" else np.full_like(t, float(order == 0))

    def function(t: Any, order: int = 0) -> Any:
        t = np.asarray(t, dtype=float)
        if not width:
            return plain(t, order)
        return sum(math.comb(order, k) * smooth(t, width, k) * plain(t, order - k) for k in range(order + 1))

    return function


class Numbers:
    """Numbers of a scene; loads and positions in the coordinates of the scene."""

    def __init__(self, scene: xr.Dataset) -> None:
        self.dims = scene.sizes["coordinate"]
        self.lower, self.upper = scene.ends_lower.values, scene.ends_upper.values
        area, gravity = float(scene.cable_area), float(scene.get("gravity", 9.81))
        self.stiffness = float(scene.cable_youngs_modulus) * area
        density = scene.cable_density if "cable_density" in scene else scene.cable_specific_weight / gravity
        self.mass = float(density) * area
        self.weight = -gravity * self.mass * np.eye(self.dims)[1]
        self.damping = float(scene.get("damping_mass_proportional", 0.0))
        self.duration = float(scene.get("time_duration", 0.0))
        self.length = float(cp.chain.rest(scene, links=2).unstretched_length)
        self.motions = {
            (end, axis): time_function(scene, f"motion_{name}_{label}")
            for end, name in enumerate(("lower", "upper"))
            for axis, label in enumerate("xyz"[: self.dims])
            if f"motion_{name}_{label}_kind" in scene
        }
        self.uniform = scene.load_uniform.values if "load_uniform" in scene else np.zeros(self.dims)
        self.factor = time_function(scene, "load")
        count = sum(str(name).startswith("point_load_") and str(name).endswith("_force") for name in scene.variables)
        #: Place over the length, force [N] and factor of time of each.
        self.point_loads = [
            (float(scene[f"{key}_arc_length"]), scene[f"{key}_force"].values, time_function(scene, key))
            for key in (f"point_load_{n}" for n in range(1, count + 1))
        ]

    def end_positions(self, times: Any, order: int = 0) -> np.ndarray:
        """Return positions of both ends, or their derivatives by time (times, 2, dims)."""
        start = np.stack([self.lower, self.upper])
        found = np.tile(start if order == 0 else 0.0 * start, (len(times), 1, 1))
        for (end, axis), motion in self.motions.items():
            found[:, end, axis] += motion(np.asarray(times), order)
        return found

    def load_at(self, t: float) -> np.ndarray:
        """Return weight and load per unstretched length (dims,) [N/m]."""
        return self.weight + self.uniform * self.factor(t)
