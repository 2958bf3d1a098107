"""Ensembles of every model: what the files hold is what single runs give."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from scenes import full_modes
from suite import slow

import cablepod as cp
from cablepod import conventions

RANGES = {"cable.top_tension": [200.0, 300.0], "motion.upper.x.amplitude": [-0.05, -0.02]}
#: Rigid links do not move along a straight line between their ends: a slack cable whose length is given.
SLACK = {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "unstretched_length": 11.0}
#: Tables of the scene, ranges, options of the model.
CASES = {
    "chain": ({}, RANGES, {"step": 4e-3, "outputs": ("position", "tension_extremes")}),
    "cable": ({}, RANGES, {"elements": 3, "order": 3, "step": 1e-3, "times": [0.0, 0.5, 1.0], "points": 4}),
    "rigid": (
        {"cable": SLACK},
        {"cable.unstretched_length": [10.6, 11.5]},
        {"step": 4e-3, "times": [0.0, 0.5, 1.0], "outputs": ("position", "tension")},
    ),
    "galerkin": ({}, RANGES, {"rank": 3, "step": 4e-3, "times": [0.0, 0.5, 1.0], "outputs": ("position", "tension")}),
    "condensed": ({}, RANGES, {"rank": 2, "step": 4e-3, "order": "exact", "outputs": ("tension",)}),
}


def modes_for(model, scene):
    """Modes for a reduced model, as the further arguments of its function; none for the others."""
    if model == "galerkin":
        return (cp.pod.decompose(cp.chain.simulate(scene, step=4e-3)),)
    return (full_modes(),) if model == "condensed" else ()


@pytest.mark.parametrize("model", CASES)
def test_each_model_gives_its_single_runs(soft, tmp_path, model):
    tables, ranges, options = CASES[model]
    scene = cp.make_scene({**soft, **tables})
    scenes = cp.ensemble.design(scene, ranges, members=3, seed=1)
    modes = modes_for(model, scene)
    run = cp.ensemble.run(
        scenes, tmp_path / "it", model=model, batch=2, **dict(zip(("modes",), modes, strict=False)), **options
    ).compute()
    assert (run["failure"] == "").all()
    assert run.sizes["member"] == 3
    for i in range(3):
        alone = getattr(cp, model).simulate(scenes.isel(member=i, drop=True), *modes, **options)
        assert set(alone.data_vars) <= set(run.data_vars)
        for name, variable in alone.data_vars.items():
            own = run[name][i] if "member" in run[name].dims else run[name]
            assert own.dims == variable.dims
            if model == "condensed":  # coefficients are those of the first member, scaled, which differ by rounding
                np.testing.assert_allclose(own, variable, rtol=1e-9, err_msg=str(name))
            else:
                np.testing.assert_array_equal(own, variable, err_msg=str(name))
        assert run["step"].values[i] == alone.attrs["step"]
    # they are three scenes, not one
    moving = next(name for name in ("position", "tension") if name in run)
    assert not np.array_equal(run[moving][0], run[moving][1])
    stage = json.loads(run.attrs["history_json"])[-1]
    assert stage["parameters"]["model"] == model
    assert stage["inputs"][1:] == [item.attrs["id"] for item in modes]
    assert json.loads((tmp_path / "it" / "manifest.json").read_text())["model"] == model


@pytest.mark.parametrize(
    ("model", "options"),
    [
        ("chain", {"outputs": ("tension_extremes",), "window": (0.1, 1.0)}),
        ("chain", {"scheme": "generalized_alpha", "step": 4e-3}),
        slow("cable", {}),
        ("rigid", {}),
        ("galerkin", {}),
        slow("condensed", {}),
    ],
)
def test_attributes_that_become_variables_have_units_and_a_name(soft, model, options):
    if model != "rigid":  # whose ends may come together only
        soft["motion"]["upper"]["x"] = {"kind": "harmonic", "amplitude": -0.02, "angular_frequency": 2.0}
    scenes = cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200, 300, 2]})
    modes = modes_for(model, cp.make_scene(soft))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the sine starts with a jump
        alone = getattr(cp, model).simulate(scenes.isel(member=0, drop=True), *modes, **options)
        (result,) = cp.ensemble.batches(scenes, model=model, modes=modes[0] if modes else None, **options)
    numbers = [name for name, value in alone.attrs.items() if isinstance(value, int | float | np.number)]
    assert {"step", "number_of_steps"} <= set(numbers)
    assert ("motion_upper_x_offset" in numbers) == (model != "rigid")
    for name in numbers:
        assert result[name].dims == ("member",)
        assert (result[name].attrs["units"], result[name].attrs["long_name"]) == conventions.ATTRIBUTES[name], name
