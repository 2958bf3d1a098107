"""Scenes with several members: side by side as if alone, failures marked, coefficients of one model scaled to others."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import xarray as xr
from scenes import everything, full_modes

import cablepod as cp
from cablepod import errors
from cablepod.batch import _members as members
from cablepod.batch._stack import MemberResults
from cablepod.condensed._assembly import unit_of
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._rescale import rescaled_model, same_structure
from cablepod.errors import OutOfRangeWarning
from cablepod.parameters._from_scene import parameters


def joined(soft, **varied):
    """A scene whose parameters have the values given, one for each member."""
    scene = cp.make_scene(soft)
    return scene.assign({name: ("member", np.asarray(values), scene[name].attrs) for name, values in varied.items()})


# --- side by side -------------------------------------------------------------------------------------------------------


def test_any_number_of_threads_gives_the_same_bits(soft):
    scenes = joined(soft, cable_top_tension=np.linspace(200.0, 300.0, 7))
    runs = []
    for count in (1, 2, 5):
        with members.thread_limit(count):
            runs.append(cp.chain.simulate(scenes, step=1e-3))
    xr.testing.assert_identical(runs[0], runs[1])
    xr.testing.assert_identical(runs[0], runs[2])
    assert [run.attrs["id"] for run in runs[1:]] == [runs[0].attrs["id"]] * 2


def test_what_differs_between_members_is_not_an_attribute(soft):
    scenes = joined(soft, cable_top_tension=[200.0, 2000.0])
    run = cp.chain.simulate(scenes, tolerance=1e-3)
    alone = [cp.chain.simulate(scenes.isel(member=i, drop=True), tolerance=1e-3) for i in (0, 1)]
    assert alone[0].attrs["step"] != alone[1].attrs["step"]
    np.testing.assert_array_equal(run["step"], [item.attrs["step"] for item in alone])
    assert run["step"].attrs["units"] == "s"
    assert "step" not in run.attrs
    assert run.attrs["law"] == alone[0].attrs["law"]
    # a tauter cable of the same span is shorter
    for i in (0, 1):
        np.testing.assert_array_equal(run["arc_length"][i], alone[i]["arc_length"])
    assert not np.array_equal(run["arc_length"][0], run["arc_length"][1])
    assert "arc_length" in run.coords


def test_failing_members_stop_nobody_else(soft):
    tensions = np.array([200.0, 1.0, 240.0])  # no cable of this weight hangs with 1 N
    with pytest.warns(errors.MemberFailedWarning, match=r"1 of 3 members .* member 1: cable\.top_tension: given 1\.0"):
        run = cp.chain.simulate(joined(soft, cable_top_tension=tensions), step=1e-3)
    assert np.isnan(run.position[1]).all()
    assert "cable.top_tension: given 1.0; allowed: at least" in run.failure.values[1]
    assert list(run.failure.values[[0, 2]]) == ["", ""]
    alone = cp.chain.simulate(joined(soft, cable_top_tension=tensions[[0, 2]]), step=1e-3)
    np.testing.assert_array_equal(run.position[[0, 2]], alone.position)
    with pytest.raises(cp.SceneError, match=r"cable\.top_tension: given 1\.0"):
        cp.chain.simulate(joined(soft, cable_top_tension=[1.0, 2.0]), step=1e-3)


def test_members_of_different_shape_are_named(soft):
    with pytest.raises(cp.SceneError, match=r"member 1 .*particle.* 6.*; allowed: .*member 0 has .* 9"):
        cp.chain.simulate(joined(soft, chain_links=[8, 5]), step=1e-3)


def test_progress_counts_members(soft):
    seen = []
    cp.chain.simulate(joined(soft, cable_top_tension=np.linspace(200, 300, 9)), step=1e-3, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert len(seen) > 2


# --- condensed models -----------------------------------------------------------------------------------------------------


def other(soft, dims):
    """A scene of the same kind in which every number differs."""
    first = everything(soft, dims)
    second = copy.deepcopy(first)
    second["cable"] |= {"youngs_modulus": 7e7, "area": 1.3e-3, "density": 800.0, "top_tension": 450.0}
    second["ends"]["upper"] = [value + 0.7 for value in second["ends"]["upper"]]
    second["damping"]["mass_proportional"] = 0.3
    second["load"]["uniform"] = [1.5 * value for value in second["load"]["uniform"]]
    second["point_load"][0]["force"] = [2.0 * value for value in second["point_load"][0]["force"]]
    second["motion"]["lower"]["y"]["amplitude"] = 0.01
    return first, second


@pytest.mark.parametrize("order", ["leading", "inertial"])
@pytest.mark.parametrize("dims", [2, 3])
def test_coefficients_scaled_from_the_unit_cable_are_the_scenes_own(soft, dims, order):
    modes = full_modes(dims=dims)
    p, q = (parameters(cp.make_scene(item)) for item in other(soft, dims))
    assert same_structure(p, q)
    scaled = rescaled_model(unit_of(p, modes, rank=3, order=order, law="linear"), q)
    own = CondensedModel(scaled.chain, order, scaled.modes)  # its coefficients are computed from the modes
    names = (
        "mass", "shapes", "slopes", "load_patterns", "chordwise_force_patterns", "mean_chordwise_forces",
        "chordwise_forces_at_candidates", "geometric_stiffness", "geometric_stiffness_norms", "load_projection", "inertia",
    )  # fmt: skip
    # they differ by the rounding of some ten operations
    for name in names:
        np.testing.assert_allclose(
            getattr(scaled, name),
            getattr(own, name),
            rtol=1e-12,
            atol=1e-13 * np.abs(getattr(own, name)).max(initial=0.0),
            err_msg=name,
        )
    np.testing.assert_allclose(scaled.spectral_basis[1], own.spectral_basis[1], rtol=1e-12)
    np.testing.assert_allclose(
        scaled.spectral_basis[0][0],
        own.spectral_basis[0][0],
        rtol=1e-12,
        atol=1e-12 * np.abs(own.spectral_basis[0][0]).max(),
    )
    np.testing.assert_allclose(scaled.initial()[0], own.initial()[0], rtol=1e-11, atol=1e-12)


@pytest.mark.filterwarnings("ignore:.*the model expects an error:cablepod.OutOfRangeWarning")  # modes of another cable
@pytest.mark.parametrize("order", ["leading", "exact"])
def test_a_batch_is_its_single_runs(soft, order):
    scenes = joined(soft, cable_top_tension=[200.0, 300.0, 230.0], motion_upper_x_amplitude=[-0.05, 0.01, -0.02])
    modes, outputs = full_modes(), ("position", "tension", "tension_extremes", "error_estimate")
    batch = cp.condensed.simulate(scenes, modes, rank=2, order=order, step=2e-3, outputs=outputs)
    for i in range(3):
        alone = cp.condensed.simulate(scenes.isel(member=i), modes, rank=2, order=order, step=2e-3, outputs=outputs)
        assert set(alone.variables) <= set(batch.variables)
        # coefficients are scaled, which differs by rounding; the motion lets it grow by the number of periods
        for name in ("position", "tension", "tension_minimum", "tension_maximum", "amplitude"):
            np.testing.assert_allclose(batch[name][i], alone[name], rtol=1e-9, atol=1e-10, err_msg=name)
        assert batch["error_estimate"].values[i] == pytest.approx(alone.attrs["error_estimate"], rel=1e-6)


def test_members_of_different_kind_are_run_too(soft):
    still = cp.make_scene({name: table for name, table in soft.items() if name != "motion"})
    moving = cp.make_scene(soft)
    both = xr.concat([still, moving], "member", data_vars="all", combine_attrs="override")
    modes = full_modes()
    batch = cp.condensed.simulate(both, modes, rank=4, step=2e-3, outputs=("position",))
    for i, scene in enumerate((still, moving)):
        alone = cp.condensed.simulate(scene, modes, rank=4, step=2e-3, outputs=("position",))
        np.testing.assert_allclose(batch.position[i], alone.position, atol=1e-11)


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_some_links_only(soft, order):
    scene, modes = cp.make_scene(soft), full_modes()
    common = {"rank": 2, "order": order, "step": 2e-3, "outputs": ("tension", "tension_extremes")}
    every = cp.condensed.simulate(scene, modes, **common)
    some = cp.condensed.simulate(scene, modes, links=[1, every.sizes["link"]], **common)
    assert list(some["link_number"].values) == [1, every.sizes["link"]]
    np.testing.assert_array_equal(some["link_arc_length"], every["link_arc_length"][[0, -1]])
    for name in ("tension", "tension_minimum", "tension_maximum"):
        np.testing.assert_allclose(some[name], every[name][..., [0, -1]], rtol=1e-13)


@pytest.mark.parametrize("links", [[0], [99], [1, 1], [1.5], []])
def test_links_that_are_not_there_are_refused(soft, links):
    with pytest.raises(cp.SceneError, match=r"links: given .*; allowed: "):
        cp.condensed.simulate(cp.make_scene(soft), full_modes(), rank=2, step=2e-3, links=links)


def test_one_warning_for_all_members_out_of_range(soft):
    del soft["motion"]
    pulled = {"upper": {"y": {"kind": "ramp", "amplitude": -1.0, "duration": 1.0}}}
    scenes = joined({**soft, "motion": pulled}, motion_upper_y_amplitude=[0.0, -0.8, -1.0])
    with pytest.warns(
        OutOfRangeWarning, match=r"2 of 3 members, of these number \d the worst: .*chordwise force"
    ) as caught:
        cp.condensed.simulate(scenes, full_modes(), rank=2, order="leading", step=1e-3, outputs=())
    assert len([item for item in caught if item.category is OutOfRangeWarning]) == 1


def test_attributes_are_in_the_order_of_the_members_whichever_ends_first():
    results = MemberResults(3)
    for i, names in ((2, ("a", "c")), (0, ("a", "b", "c")), (1, ("d", "a"))):
        results.store(i, {}, dict.fromkeys(names, float(i)))
    assert results.attribute_names == ["a", "b", "c", "d"]
    assert list(results.attrs) != results.attribute_names  # as they came
