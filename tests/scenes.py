"""Scenes that several tests share: small and soft, so that a run takes milliseconds."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import cablepod as cp

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
DATA = ROOT / "data"
SCENES = DATA / "scenes"

SOFT: dict[str, Any] = {
    "title": "soft",
    "cable": {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "top_tension": 200.0},
    "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2.0}}},
    "time": {"duration": 4.0, "interval": 0.5},
    "chain": {"links": 8},
}
#: The same scene as a file, as it is given to the command.
SOFT_TOML = """
title = "a small guy"
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
[time]
duration = 4.0
interval = 0.5
[chain]
links = 8
"""
#: Tables added to a scene, one physical term each, for tests that run a model with every term.
TERMS: dict[str, dict[str, Any]] = {
    "plain": {},
    "uniform load": {"load": {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 3.0}},
    "point load": {"point_load": [{"arc_length": 0.4, "force": [0.0, -20.0]}]},
    "mass damping": {"damping": {"mass_proportional": 0.8}},
    "both ends": {
        "motion": {
            "lower": {"y": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 1.7, "phase": 0.4}},
            "upper": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0}},
        }
    },
}
#: A cable given by its length, for links that do not stretch.
RIGID_CABLE = {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "unstretched_length": 11.0}
#: Parameters that ensembles of the soft scene vary, and their step [s].
ENSEMBLE_RANGES = {"cable.top_tension": [200.0, 300.0], "ends.upper.x": [7.0, 8.5]}
ENSEMBLE_STEP = 4e-3
#: Schemes of the condensed model by its orders; its orders; pairs of both.
SCHEMES_OF = {
    "leading": ("velocity_verlet", "trapezoidal", "numerov"),
    "exact": ("velocity_verlet", "trapezoidal"),
    "inertial": ("velocity_verlet", "trapezoidal"),
}
ORDERS = tuple(SCHEMES_OF)
PAIRS = [(order, scheme) for order, schemes in SCHEMES_OF.items() for scheme in schemes]
#: Relative lengths of links that differ, for reduced models.
LENGTHS = [1.0, 1.5, 1.0, 0.7, 1.2]
HARMONIC = {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 1.7, "phase": 0.4}
#: Tables with every term that the reduced models know.
EVERYTHING = {
    "cable": {"youngs_modulus": 1e8, "area": 1.0e-3, "density": 1000.0, "top_tension": 300.0},
    "damping": {"mass_proportional": 0.8},
    "load": {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 0.3, "angular_frequency": 3.0},
    "point_load": [
        {"arc_length": 0.4, "force": [5.0, -20.0]},
        {"arc_length": 0.7, "force": [8.0, 0.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.0},
    ],
    "motion": {"lower": {"y": HARMONIC}, "upper": {"x": {**HARMONIC, "angular_frequency": 2.1}}},
}


def scene_with(mapping: dict[str, Any], **tables: Any) -> xr.Dataset:
    """Make the scene of a mapping, some of its tables replaced."""
    return cp.make_scene({**mapping, **tables})


def pulled(soft, **tables):
    """Return the soft scene with ends at rest, let go from the shape of a longer cable: a vibration that small steps resolve."""
    changes = {"motion": {}, "initial": {"unstretched_length": 10.4}, "time": {"duration": 1.0, "interval": 0.25}}
    return scene_with(soft, **changes | {"cable": {**soft["cable"], "youngs_modulus": 4e5}} | tables)


def rigid_scene(soft, **changes):
    """Return a soft scene whose cable is given by its length, for rigid links."""
    return cp.make_scene({**soft, "cable": RIGID_CABLE, **copy.deepcopy(changes)})


def pendulum(length, point, **changes):
    """Scene of a chain held at the origin, with `point` as its free end."""
    cable = {"youngs_modulus": 1e9, "area": 1e-3, "density": 1000.0, "unstretched_length": length}
    return cp.make_scene(
        {"cable": cable, "ends": {"lower": [0.0, 0.0], "upper": point, "free": "upper"}, "chain": {"links": 2}}
        | changes
    )


def along(points: np.ndarray, length: float, modulus: float = 1e6, **tables: Any) -> xr.Dataset:
    """Make a weightless cable of 1 kg/m and an area of 1e-3 m2, whose particles start from these points."""
    return cp.make_scene(
        {
            "gravity": 0.0,
            "cable": {"youngs_modulus": modulus, "area": 1e-3, "density": 1000.0, "unstretched_length": length},
            "ends": {"lower": points[0].tolist(), "upper": points[-1].tolist()},
            "initial": {"points": points.tolist()},
            "chain": {"links": len(points) - 1},
        }
        | tables
    )


class UniformChain(NamedTuple):
    """Numbers of the chain of a uniform cable."""

    length: np.ndarray  #: unstretched lengths of the links (n,) [m]
    stiffness: np.ndarray  #: of the links, EA over the length (n,) [N/m]
    mass: np.ndarray  #: of the particles, half of that of the links beside each (n + 1,) [kg]


def uniform_chain(scene: xr.Dataset, result: xr.Dataset) -> UniformChain:
    """Return the chain of a uniform cable by hand, from numbers of its scene and the arc lengths of a result."""
    area, length = float(scene.cable_area), np.diff(result.arc_length.values)
    given = "cable_density" in scene
    density = float(scene.cable_density if given else scene.cable_specific_weight / scene.gravity)
    share = 0.5 * (np.append(length, 0.0) + np.append(0.0, length))
    return UniformChain(length, float(scene.cable_youngs_modulus) * area / length, density * area * share)


def energies(scene: xr.Dataset, run: xr.Dataset, law: str = "linear") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return kinetic energy, strain energy and that of the weight of a run of a uniform chain (time,) [J]."""
    length, stiffness, mass = uniform_chain(scene, run)
    xi = np.linalg.norm(np.diff(run.position, axis=1), axis=2) / length
    density = (xi**2 - 1.0) ** 2 / 8.0 if law == "green" else 0.5 * np.maximum(xi - 1.0, 0.0) ** 2
    kinetic = 0.5 * (mass[:, None] * run.velocity.values**2).sum(axis=(1, 2))
    height = (run.position.values[..., 1] * mass).sum(axis=1)
    return kinetic, (stiffness * length**2 * density).sum(axis=1), 9.81 * height


def link_length_errors(run):
    """Relative length errors of the links of a run."""
    reach = np.linalg.norm(np.diff(run.position.values, axis=1), axis=-1)
    return reach / np.diff(run.arc_length.values) - 1.0


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


def circling(mapping: dict[str, Any], angle: float) -> dict[str, Any]:
    """Return the scene in space with an upper end that circles about the lower one, at the origin, by `angle` in its duration."""
    result, (x, y) = spatial(mapping), mapping["ends"]["upper"]
    sine = {"kind": "harmonic", "amplitude": math.hypot(x, y), "angular_frequency": angle / mapping["time"]["duration"]}
    phase = math.atan2(y, x)
    return result | {
        "motion": {"upper": {"x": {**sine, "phase": phase + 0.5 * math.pi}, "y": {**sine, "phase": phase}}}
    }


def everything(soft, dims=2):
    mapping = {**soft, **copy.deepcopy(EVERYTHING)}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["ends"]["upper"][2] = 3.0
        mapping["load"]["uniform"][2] = 4.0
        mapping["point_load"][0]["force"][2] = -6.0
        mapping["motion"]["upper"]["z"] = {**HARMONIC, "amplitude": 0.05}
    return mapping


def full_modes(lengths=LENGTHS, dims=2, *, seed=3, samples=30):
    """Modes of layout "normal" that span all deflections of a chain with these links."""
    sigma = np.concatenate([[0.0], np.cumsum(lengths)]) / np.sum(lengths)
    rng = np.random.default_rng(seed)
    position = np.zeros((samples, sigma.size, dims))
    position[..., 0] = 7.0 * sigma
    position[:, 1:-1, 1:] = rng.normal(size=(samples, sigma.size - 2, dims - 1))
    snapshots = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={
            "time": np.arange(1.0 * samples),
            "arc_length": ("particle", 7.0 * sigma),
            "coordinate": list("xyz"[:dims]),
        },
    )
    # both sets span all deflections, so that they serve normals that refer to any axis
    return cp.pod.decompose(snapshots, layout="normal").drop_vars("normal_reference", errors="ignore")
