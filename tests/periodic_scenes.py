"""Scenes of the periodic tests: a string without weight, and a guy."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import xarray as xr

import cablepod as cp

STRING: dict[str, Any] = {
    "title": "string",
    "gravity": 0.0,
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 20000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [60.0, 0.0]},
    "chain": {"links": 40},
}
GUY: dict[str, Any] = {
    "title": "guy",
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.003, "angular_frequency": 6.0}}},
    "damping": {"mass_proportional": 0.03},
    "chain": {"links": 40},
}
STIFFNESS = 1.6e11 * 1.25e-4
TENSION = 20000.0


def mathieu(epsilon: float, omega: float = 12.0, damping: float = 0.0, stiffer: float = 1.0) -> xr.Dataset:
    """A string whose end moves along it, so that its tension varies by the factor 1 + epsilon sin(omega t).

    Inertia along the string changes epsilon by some share of (omega / axial frequency)^2, 1e-3; a stiffer string has less.
    """
    mapping = copy.deepcopy(STRING)
    mapping["cable"]["youngs_modulus"] *= stiffer
    stiffness = stiffer * STIFFNESS
    length = 60.0 / (1.0 + TENSION / stiffness)
    motion = {"kind": "harmonic", "amplitude": epsilon * TENSION * length / stiffness, "angular_frequency": omega}
    mapping["motion"] = {"upper": {"x": motion}}
    mapping["damping"] = {"mass_proportional": damping}
    return cp.make_scene(mapping)


def loaded(force: float, omega: float, damping: float) -> xr.Dataset:
    """A string under a uniform load normal to it, force sin(omega t) [N/m]."""
    mapping = copy.deepcopy(STRING)
    mapping["load"] = {"uniform": [0.0, force], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": omega}
    mapping["damping"] = {"mass_proportional": damping}
    return cp.make_scene(mapping)


def guy(**motion: Any) -> xr.Dataset:
    """The guy, with other values of the motion of its upper end, or of the damping."""
    mapping = copy.deepcopy(GUY)
    if "damping" in motion:
        mapping["damping"]["mass_proportional"] = motion.pop("damping")
    mapping["motion"]["upper"]["x"] |= motion
    return cp.make_scene(mapping)


def tension_damped(beta: float, omega: float = 12.6, amplitude: float = 0.003, alpha: float = 0.03) -> xr.Dataset:
    """The guy with damping by the tension beside that by mass."""
    scene = guy(angular_frequency=omega, amplitude=amplitude, damping=alpha)
    return scene.assign(damping_tension_proportional=((), beta, {"units": "s"}))


def multipliers(result: xr.Dataset) -> np.ndarray:
    """Complex multipliers of a result."""
    return result.multiplier_real.values + 1j * result.multiplier_imag.values
