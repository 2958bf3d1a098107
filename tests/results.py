"""Made-up results of every kind that the archive keeps."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scenes import SOFT

import cablepod as cp
from cablepod import provenance
from cablepod.conventions import label

PARTICLES = 9
RNG_SEED = 7


def values(*shape):
    return np.random.default_rng(RNG_SEED).normal(size=shape)


def chain_coordinates(particles=PARTICLES):
    return {
        "coordinate": ["x", "y"],
        "arc_length": ("particle", np.linspace(0.0, 61.0, particles)),
        "link_arc_length": ("link", np.linspace(0.5, 60.5, particles - 1)),
    }


def make_scene():
    variables = {
        "gravity": 9.81,
        "cable_top_tension": 15000.0,
        "chain_links": 40,
        "motion_upper_x_kind": "one_minus_cosine",
        "motion_upper_x_amplitude": -0.07,
        "ends_free": "",
        "end_position": (("end", "coordinate"), [[0.0, 0.0], [20.4, 57.7]]),
    }
    scene = xr.Dataset(variables, {"end": ["lower", "upper"], "coordinate": ["x", "y"]})
    label(
        scene,
        gravity=("m s-2", "acceleration of gravity"),
        cable_top_tension=("N", "tension at the upper end at rest"),
        chain_links=("1", "number of links"),
        motion_upper_x_kind=("1", "kind of motion of the upper end along x"),
        motion_upper_x_amplitude=("m", "amplitude of the motion of the upper end along x"),
        ends_free=("1", "end that moves freely, if any"),
    )
    scene.attrs["title"] = "Example 2: slow end motion, Seguí's cable"
    return provenance.record(scene, function="make_scene", parameters={"gravity": 9.81, "free": None})


def make_trajectory(times=60, particles=PARTICLES, scene=None):
    trajectory = xr.Dataset(
        {
            "position": (("time", "particle", "coordinate"), values(times, particles, 2)),
            "tension": (("time", "link"), values(times, particles - 1)),
            "tension_maximum": ("link", values(particles - 1)),
        },
        {"time": 0.1 * np.arange(times), **chain_coordinates(particles)},
    )
    parameters = {"links": particles - 1, "scheme": "verlet", "step": 1e-4, "tolerance": None}
    inputs = [make_scene() if scene is None else scene]
    return provenance.record(label(trajectory), function="chain.simulate", parameters=parameters, inputs=inputs)


def make_modes(trajectory=None):
    rank = 4
    modes = xr.Dataset(
        {
            "mode_shape": (("coordinate", "mode", "particle"), values(2, rank, PARTICLES)),
            "singular_value": (("coordinate", "mode"), values(2, rank)),
            "proper_orthogonal_value": (("coordinate", "mode"), values(2, rank) ** 2),
            "energy_share": (("coordinate", "mode"), values(2, rank)),
            "mean": (("particle", "coordinate"), values(PARTICLES, 2)),
        },
        {"mode": np.arange(1, rank + 1), **chain_coordinates()},
    ).drop_vars("link_arc_length")
    inputs = [make_trajectory() if trajectory is None else trajectory]
    return provenance.record(label(modes), function="pod.decompose", parameters={"rank": rank}, inputs=inputs)


def make_comparison():
    errors = xr.Dataset(
        {"error": ("time", values(60)), "error_max": 0.02, "displacement_scale": 1.5}, {"time": 0.1 * np.arange(60)}
    )
    inputs = [make_trajectory(), make_modes()]
    return provenance.record(label(errors), function="compare.errors", parameters={}, inputs=inputs)


def make_ensemble():
    members = 3
    shape = (members, 20, PARTICLES, 2)
    ensemble = xr.Dataset(
        {
            "position": (("member", "time", "particle", "coordinate"), values(*shape)),
            "tension": (("member", "time", "link"), values(*shape[:2], PARTICLES - 1).astype("f4")),
            "motion_upper_x_kind": ("member", ["ramp", "harmonic", "ramp"]),
        },
        {
            "member": np.arange(members),
            "cable_top_tension": ("member", [4e3, 8e3, 1.2e4]),
            "time": 0.5 * np.arange(20),
            **chain_coordinates(),
        },
    )
    ensemble["position"][1, 3:] = np.nan  # a run that broke off
    extra = {"cable_top_tension": ("N", "tension at the upper end"), "motion_upper_x_kind": ("1", "kind of motion")}
    return provenance.record(label(ensemble, **extra), function="ensemble.run", parameters={"seed": 5})


def make_batch():
    """Real condensed models of several scenes, whose arc lengths differ."""
    scene = cp.make_scene(SOFT)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), layout="normal", rank=2)
    scenes = cp.ensemble.design(scene, {"cable.top_tension": [200.0, 300.0]}, members=3)
    return cp.condensed.simulate(scenes, modes, step=1e-3, outputs=("tension", "tension_extremes"), links=[1])


KINDS = {
    "batch": make_batch, "scene": make_scene, "trajectory": make_trajectory, "modes": make_modes, "comparison": make_comparison,
    "ensemble": make_ensemble,
}  # fmt: skip
