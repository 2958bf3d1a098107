"""Similarity numbers of scenes, and the distance from training scenes."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import cablepod as cp
from cablepod import examples as shipped


def guy(**changes):
    """Make a guy along x whose upper end moves along it, without sag, so that all numbers are known by hand."""
    tables = {
        "gravity": 9.81,
        "cable": {"youngs_modulus": 1.0e11, "area": 1e-4, "density": 8000.0, "top_tension": 1e5},
        "ends": {"lower": [0.0, 0.0], "upper": [50.0, 0.0]},
        "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 2.0}}},
        "time": {"duration": 5.0, "interval": 0.5},
        "chain": {"links": 8},
    }
    return cp.make_scene({**tables, **changes})


def numbers(scene):
    """Features of a run of 5 s by name, and the unstretched length."""
    run = cp.chain.simulate(scene, step=2e-4, times=[0.0, 5.0])
    return dict(zip(run.feature.values, run.scene_feature.values, strict=True)), float(run.unstretched_length)


def test_features_of_a_taut_level_guy():
    values, length = numbers(guy())
    weight, tension, stiffness = 8000.0 * 1e-4 * 9.81, 1e5, 1e7
    # the weight of the sag changes the tension along the guy by 1e-8; the harmonic has its peak between two instants
    assert values["irvine_parameter"] == pytest.approx((weight * length / tension) ** 2 * stiffness / tension, rel=1e-6)
    assert values["pull_along"] == pytest.approx(0.0, abs=1e-12)
    assert values["end_motion"] == pytest.approx(0.02 * stiffness / (tension * length), rel=1e-4)
    assert values["end_acceleration"] == pytest.approx(0.0, abs=1e-12)  # it moves along the chord
    first = np.pi / length * np.sqrt(tension / 0.8)
    assert values["frequency"] == pytest.approx(2.0 / first, rel=1e-6)
    assert values["other_loads"] == 0.0


def test_load_along_an_inclined_guy():
    values, length = numbers(guy(ends={"lower": [0.0, 0.0], "upper": [30.0, 40.0]}, motion={}))
    weight = 8000.0 * 1e-4 * 9.81
    # the tension is given at the top: at the middle it is half of what the weight along the chord takes, 1.6e-3, less
    tension = 1e5 - 0.5 * weight * 0.8 * length
    assert values["pull_along"] == pytest.approx(0.8 * weight * length / tension, rel=1e-5)
    assert values["irvine_parameter"] == pytest.approx((0.6 * weight * length / tension) ** 2 * 1e7 / tension, rel=1e-5)


def test_features_of_motion_across_and_of_other_loads():
    up = {"upper": {"y": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 2.0}}}
    values, length = numbers(guy(motion=up, point_load=[{"arc_length": 0.3, "force": [30.0, -40.0]}]))
    assert values["end_acceleration"] == pytest.approx(0.8 * length * 0.02 * 4.0 / 1e5, rel=1e-4)
    # a transverse displacement of 0.02 m lengthens the chord by 0.02^2 / 2 / 50 m
    assert values["end_motion"] == pytest.approx(4e-6 * 1e7 / (1e5 * length), rel=1e-4)
    assert values["other_loads"] == pytest.approx(50.0 / 1e5, rel=1e-6)
    wind = {"uniform": [0.0, 3.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 3.0}
    values, length = numbers(guy(motion={}, load=wind))
    assert values["other_loads"] == pytest.approx(3.0 * length / 1e5, rel=1e-4)
    assert values["end_motion"] == values["end_acceleration"] == 0.0
    still, _ = numbers(guy(motion={}))
    assert still["frequency"] == 0.0


def chain_and_modes(*scenes, layout="normal"):
    runs = [cp.chain.simulate(scene, links=8, step=2e-4) for scene in scenes]
    joined = (
        runs[0]
        if len(runs) == 1
        else xr.concat(runs, dim="member", join="override", compat="override", coords="minimal")
    )
    return cp.pod.decompose(joined, layout=layout)


def test_several_training_scenes_span_a_range():
    slow, fast = guy(), guy(motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 4.0}}})
    modes = chain_and_modes(slow, fast)
    low, high = modes["training_range"].sel(feature="frequency").values
    assert high == pytest.approx(2.0 * low, rel=1e-12)
    between = guy(motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 3.0}}})
    options = {"rank": 2, "order": "leading", "step": 1e-3, "outputs": ()}
    run = cp.condensed.simulate(between, modes, **options)
    assert run.attrs["outside_training"] == 0.0
    assert run.attrs["outside_training_feature"] == "none"
    beyond = guy(motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 8.0}}})
    run = cp.condensed.simulate(beyond, modes, **options)
    assert run.attrs["outside_training_feature"] == "frequency"
    assert run.attrs["outside_training"] == pytest.approx(np.log1p(2.0 * high) - np.log1p(high), rel=1e-9)
    # values below the range count too
    calm = guy(motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.001, "angular_frequency": 3.0}}})
    run = cp.condensed.simulate(calm, modes, **options)
    assert run.attrs["outside_training_feature"] == "end_motion"
    least = modes["training_range"].sel(feature="end_motion", bound="least").item()
    # 0.001 m is a twentieth of the lower bound, 0.02 m
    assert run.attrs["outside_training"] == pytest.approx(np.log1p(least) - np.log1p(least / 20.0), rel=1e-6)


def test_a_training_scene_is_inside_also_after_netcdf(tmp_path):
    scene = shipped.scene("example3")
    times = np.arange(41) * 0.25
    chain = cp.chain.simulate(scene, links=10, times=times, step=1e-3)
    cp.archive.write(chain, tmp_path / "chain.nc")
    modes = cp.pod.decompose(cp.archive.read(tmp_path / "chain.nc"))
    cp.archive.write(modes, tmp_path / "modes.nc")
    modes = cp.archive.read(tmp_path / "modes.nc")
    run = cp.galerkin.simulate(scene, modes, rank=2, times=times, step=1e-3)
    assert (run.attrs["outside_training"], run.attrs["outside_training_feature"]) == (0.0, "none")
    other = cp.galerkin.simulate(shipped.scene("example4"), modes, rank=2, times=times, step=1e-3)
    assert other.attrs["outside_training"] > 0.1
    assert other.attrs["outside_training_feature"] in chain.feature
    assert cp.archive.read(cp.archive.write(other, tmp_path / "other.nc")).attrs["outside_training"] == pytest.approx(
        other.attrs["outside_training"], rel=1e-12
    )


def test_cables_have_scene_features():
    scene = guy()
    chain = cp.chain.simulate(scene, step=2e-4, times=[0.0, 1.0])
    cable = cp.cable.simulate(scene, elements=2, step=1e-4, times=[0.0, 1.0])
    # chain and cable have the same unstretched length
    np.testing.assert_allclose(cable["scene_feature"], chain["scene_feature"], rtol=1e-9)


def test_modes_without_training_range_give_no_distance():
    scene = guy()
    chain = cp.chain.simulate(scene, step=2e-4)
    modes = cp.pod.decompose(chain.drop_vars(["scene_feature", "feature"]), layout="normal")
    assert "training_range" not in modes
    run = cp.condensed.simulate(scene, modes, rank=2, step=1e-3, outputs=())
    assert "outside_training" not in run.attrs
    # joined runs, one of which has no features
    gap = chain.copy()
    gap["scene_feature"] = gap["scene_feature"] * np.nan
    joined = xr.concat([chain, gap], dim="member")
    assert "training_range" not in cp.pod.decompose(joined, layout="normal")


def test_galerkin_reports_the_retained_energy():
    scene = guy()
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=2e-4))
    for rank in (1, 3):
        run = cp.galerkin.simulate(scene, modes, rank=rank, step=2e-4)
        kept = modes["energy_share"].values[:, :rank].sum(axis=1).min()
        assert run.attrs["energy_share_kept"] == pytest.approx(kept, rel=1e-14)
        length = float(modes["unstretched_length"])
        axial = np.pi / length * np.sqrt(1e7 / 0.8)
        assert run.attrs["first_axial_frequency"] == pytest.approx(axial, rel=1e-9)
        assert run.attrs["forcing_over_axial_frequency"] == pytest.approx(2.0 / axial, rel=1e-9)
    still = cp.galerkin.simulate(guy(motion={}), modes, rank=1, step=2e-4)
    assert still.attrs["forcing_over_axial_frequency"] == 0.0


@pytest.mark.parametrize("across", [0.0, 0.03])
def test_the_retained_energy_is_the_least_of_the_ways_that_the_snapshots_move(across):
    # a guy in space: fast motion across its plane is held worse than that in it; without any nothing is lost
    motion = {"upper": {"y": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 8.0}}}
    if across:
        motion["upper"]["z"] = {"kind": "one_minus_cosine", "amplitude": across, "angular_frequency": 40.0}
    scene = guy(ends={"lower": [0.0, 0.0, 0.0], "upper": [30.0, 40.0, 0.0]}, motion=motion)
    chain = cp.chain.simulate(scene, step=2e-4)
    separate, normal = (cp.pod.decompose(chain, layout=layout) for layout in ("separate", "normal"))
    ways = ["x", "y", "z"] if across else ["x", "y"]
    kept = separate["energy_share"].sel(coordinate=ways).values[:, :2].sum(axis=1).min()
    run = cp.galerkin.simulate(scene, separate, rank=2, step=2e-4, outputs=())
    assert run.attrs["energy_share_kept"] == pytest.approx(kept, rel=1e-14)
    names = ["energy_share", "energy_share_out_of_plane"][: 1 + bool(across)]
    kept = min(float(normal[name].values[:2].sum()) for name in names)
    run = cp.condensed.simulate(scene, normal, rank=2, step=2e-4, outputs=())
    assert run.attrs["energy_share_kept"] == pytest.approx(kept, rel=1e-14)
    assert 0.9 < kept < 1.0 - 1e-9


def test_each_member_has_its_distance():
    near, far = guy(), guy(motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 16.0}}})
    both = xr.concat([near, far], dim="member")
    trained = cp.chain.simulate(both, links=8, step=2e-4)
    # an ensemble of chains is a training set, as joined runs are
    ranges = cp.pod.decompose(trained, layout="normal")["training_range"].sel(feature="frequency").values
    assert ranges[1] == pytest.approx(8.0 * ranges[0], rel=1e-12)
    modes = cp.pod.decompose(cp.chain.simulate(near, links=8, step=2e-4), layout="normal")
    run = cp.condensed.simulate(both, modes, rank=2, order="leading", step=1e-3, outputs=())
    distances = np.asarray(run["outside_training"])
    assert distances[0] == 0.0
    assert distances[1] == pytest.approx(np.log1p(ranges[1]) - np.log1p(ranges[0]), rel=1e-9)
    assert "outside_training_feature" not in run.attrs  # texts that differ between members are left out


def test_several_trajectories_and_streams_keep_all_features():
    slow, fast = guy(), guy(motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 4.0}}})
    runs = [cp.chain.simulate(scene, links=8, step=2e-4) for scene in (slow, fast)]
    together = cp.pod.decompose(runs, layout="normal")["training_range"]
    np.testing.assert_array_equal(together[0], np.minimum(runs[0]["scene_feature"], runs[1]["scene_feature"]))
    np.testing.assert_array_equal(together[1], np.maximum(runs[0]["scene_feature"], runs[1]["scene_feature"]))
    first, second = (cp.pod.Stream(layout="normal").update(run) for run in runs)
    np.testing.assert_array_equal(first.merge(second).modes()["training_range"], together)
    first.update(runs[0].drop_vars(["scene_feature", "feature"]))
    assert "training_range" not in first.modes()
