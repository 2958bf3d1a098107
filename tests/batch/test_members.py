"""Scenes with several members: side by side as if alone, failures marked, coefficients of one model scaled to others."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scenes import full_modes

import cablepod as cp
from cablepod import _resources, errors
from cablepod.batch._members import over_members
from cablepod.errors import OutOfRangeWarning


def joined(soft, **varied):
    """A scene whose parameters have the values given, one for each member."""
    scene = cp.make_scene(soft)
    return scene.assign({name: ("member", np.asarray(values), scene[name].attrs) for name, values in varied.items()})


# --- side by side -------------------------------------------------------------------------------------------------------


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


def test_schemes_that_differ_are_told_by_member(soft, tmp_path):
    @over_members
    def simulate(scene):
        stiff = float(scene["cable_top_tension"]) > 220.0
        return cp.chain.simulate(scene, step=1e-3, scheme="trapezoidal" if stiff else "velocity_verlet")

    with pytest.warns(errors.MemberFailedWarning):
        run = simulate(joined(soft, cable_top_tension=[200.0, 240.0, 1.0]))
    assert run["scheme"].values.tolist() == ["velocity_verlet", "trapezoidal", ""]
    assert "scheme" not in run.attrs
    cp.archive.write(run, tmp_path / "run.nc")
    xr.testing.assert_equal(cp.archive.read(tmp_path / "run.nc")["scheme"], run["scheme"].astype(str))


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


def test_members_beyond_memory_are_refused_before_one_of_them_runs(soft, monkeypatch):
    instants = []

    @over_members
    def simulate(scene, *, times=None):
        instants.append(np.size(times))
        return cp.chain.simulate(scene, times=times, step=1e-3)

    scenes, times = joined(soft, cable_top_tension=np.linspace(200.0, 240.0, 12)), np.linspace(0.0, 0.1, 101)
    size = cp.chain.simulate(scenes.isel(member=0, drop=True), times=times, step=1e-3).nbytes
    monkeypatch.setattr(_resources, "memory", lambda: 2 * 10 * size)  # a run of one member needs 8
    with pytest.raises(
        cp.SceneError, match=r"^member and times: given 12 members, .*; allowed: half of this machine's"
    ):
        simulate(scenes, times=times)
    assert instants == [1]
    simulate(scenes.isel(member=slice(8)), times=times)  # these fit


def test_a_failing_member_may_be_one_whose_ends_start_fastest(soft):
    motion = {"upper": {"x": {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 5.0}}}
    scenes = joined({**soft, "motion": motion}, cable_top_tension=[1.0, 230.0, 240.0])
    with (
        pytest.warns(errors.MemberFailedWarning, match=r"1 of 3 members .* member 0: cable\.top_tension"),
        pytest.warns(errors.VelocityJumpWarning, match="member 1, whose ends start fastest of 3"),
    ):
        run = cp.chain.simulate(scenes, step=1e-3)
    np.testing.assert_array_equal(run.failure == "", [False, True, True])


def test_a_member_that_lacks_a_key_stops_nobody_else(soft):
    scenes = joined(soft, cable_top_tension=[230.0, np.nan, 240.0])
    with pytest.warns(errors.MemberFailedWarning, match=r"1 of 3 members .* member 1: cable: given none"):
        run = cp.chain.simulate(scenes, step=1e-3)
    np.testing.assert_array_equal(run.failure == "", [True, False, True])


def test_parameters_may_be_coordinates(soft):
    scenes = cp.make_scene({**soft, "damping": {"mass_proportional": 0.5}})
    scenes = scenes.assign(damping_mass_proportional=("member", [0.5, 2.0], scenes.damping_mass_proportional.attrs))
    as_coordinate = scenes.set_coords("damping_mass_proportional")
    for simulate in (cp.chain.simulate, cp.cable.simulate):  # a batch, and one member after the other
        run, other = (simulate(given, scheme="trapezoidal", step=0.05) for given in (scenes, as_coordinate))
        np.testing.assert_array_equal(run.position, other.position)
        assert not np.array_equal(run.position[0], run.position[1])


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
