"""Members of the soft scene that differ in one kind of number each, and comparison of their results."""

from __future__ import annotations

import json

import numpy as np
from scenes import HARMONIC, spatial

import cablepod as cp

BOTH = {"lower": {"y": HARMONIC}, "upper": {"x": {**HARMONIC, "angular_frequency": 2.1}}}
ONE = {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 1.3}}}
#: The second is so steep that in space another axis defines the normals.
UPPER = np.array([[7.0, 0.0], [0.3, 8.0], [6.0, -2.0], [5.0, 4.0]])
#: Motions and varied variables of each batch.
CASES = {
    "tension": (ONE, {"cable_top_tension": [200.0, 300.0, 230.0, 900.0]}),
    "amplitude": (ONE, {"motion_upper_x_amplitude": [0.0, -0.05, 0.02, 0.01]}),
    "frequency": (ONE, {"motion_upper_x_angular_frequency": [0.0, 0.5, 3.0, 5.0]}),
    "phase": (BOTH, {"motion_lower_y_phase": [0.0, 0.4, -2.0, 7.0]}),
    "both ends": (BOTH, {"motion_lower_y_amplitude": [0.1, 0.0, 0.03, -0.1], "motion_upper_x_amplitude": [0.0, 0.1, 0.0, 0.03]}),
    "chord": (BOTH, {"ends_upper": UPPER}),
    "material": (BOTH, {"cable_density": [1000.0, 500.0, 1500.0, 800.0], "cable_area": [1e-3, 2e-3, 5e-4, 9e-4]}),
    "damping": (BOTH, {"damping_mass_proportional": [0.8, 0.0, 2.0, 0.1]}),
    "load": (BOTH, {"load_uniform": [[3.0, -2.0], [0.0, 0.0], [-1.0, 1.0], [0.0, 4.0]]}),
    "ramp": (
        {"lower": {"y": {**HARMONIC, "ramp": 0.9}}, **ONE},
        {"motion_lower_y_ramp": [0.9, 0.0, 1.234, 30.0], "motion_lower_y_phase": [0.0, 0.4, -2.0, 7.0]},
    ),
    "still": ({}, {"cable_top_tension": [200.0, 300.0, 230.0, 900.0]}),
}  # fmt: skip


def scenes_of(soft, motion, varied, dims=2):
    """Make members of the soft scene with given motions; for dims = 3 also with out-of-plane motion."""
    mapping = {**soft, "motion": motion, "damping": {"mass_proportional": 0.8}, "load": {"uniform": [3.0, -2.0]}}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["ends"]["upper"][2] = 1.0
        mapping["motion"].setdefault("upper", {})["z"] = {**HARMONIC, "amplitude": 0.02}
    return varied_in(cp.make_scene(mapping), varied)


def varied_in(scene, varied):
    """Return members of a scene with these values of its variables; vectors of a spatial scene get a third coordinate."""
    new = {}
    for name, values in varied.items():
        rows = np.asarray(values)
        if rows.ndim == 2 and scene.sizes["coordinate"] == 3:
            rows = np.column_stack([rows, np.linspace(0.5, 1.5, len(rows))])
        new[name] = (("member", "coordinate")[: rows.ndim], rows, scene[name].attrs)
    return scene.assign(new)


def single_runs(scenes, modes, **options):
    """Run all members as single scenes, by a duration that varies: it decides on constants that lanes share."""
    duration = scenes.time_duration
    same = np.full(scenes.sizes["member"], float(duration))
    run = cp.condensed.simulate(scenes.assign(time_duration=("member", same, duration.attrs)), modes, **options)
    return run.drop_vars("time_duration")


def assert_close(run, truth):
    """Compare all variables and attributes; of the history the call, without the scenes and results, which rounding changes."""
    assert set(run.variables) == set(truth.variables)
    assert set(run.coords) == set(truth.coords)
    assert described(run.attrs) == described(truth.attrs)
    for name, values in truth.variables.items():
        assert run[name].dims == values.dims
        assert run[name].attrs == values.attrs
        if values.dtype.kind != "f":
            np.testing.assert_array_equal(run[name], values)
            continue
        # rounding of 1e-16 in a length changes the static tension by 1e-12, which the motion amplifies
        size = np.nanmax(np.abs(values.values)) if values.size else 0.0
        # a difference of forces that nearly cancel
        rtol = 1e-7 if name.endswith("error_estimate") else 1e-10
        np.testing.assert_allclose(run[name], values, rtol=rtol, atol=1e-11 * size, err_msg=str(name))


def described(attrs):
    """Return attributes with the call of the history's last stage in place of history and identity."""
    last = json.loads(attrs["history_json"])[-1]
    return {**attrs, "id": last["function"], "history_json": last["parameters"]}
