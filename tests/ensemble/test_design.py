"""How the members of an ensemble are drawn, and mistakes in a design."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from histories import run_script
from scenes import ENSEMBLE_RANGES, ENSEMBLE_STEP

import cablepod as cp
from cablepod import lineage


def test_a_latin_hypercube_has_one_member_in_each_part_of_each_range(scenes_of):
    scenes = scenes_of(20, seed=4)
    assert scenes.sizes["member"] == 20
    np.testing.assert_array_equal(scenes["member"], np.arange(20))
    for name, (low, high) in (("cable_top_tension", (200.0, 300.0)), ("ends_upper_x", (7.0, 8.5))):
        part = np.floor((scenes[name] - low) / (high - low) * 20).astype(int)
        np.testing.assert_array_equal(np.sort(part), np.arange(20))
    np.testing.assert_array_equal(scenes["ends_upper"].sel(coordinate="x"), scenes["ends_upper_x"])
    assert (scenes["ends_upper"].sel(coordinate="y") == 6.0).all()
    assert scenes["cable_top_tension"].attrs["units"] == "N"
    assert scenes["ends_upper_x"].attrs["units"] == "m"
    assert scenes["cable_area"].dims == ()


def test_a_design_depends_on_its_seed_and_says_so(scenes_of):
    first, again, other = scenes_of(seed=1), scenes_of(seed=1), scenes_of(seed=2)
    xr.testing.assert_identical(first, again)
    assert not np.array_equal(first["cable_top_tension"], other["cable_top_tension"])
    assert first.attrs["id"] != other.attrs["id"]
    stage = json.loads(first.attrs["history_json"])[-1]
    assert stage["function"] == "ensemble.design"
    assert stage["parameters"] == {"members": 10, "sampling": "latin_hypercube", "seed": 1, "ranges": ENSEMBLE_RANGES}


def test_sobol_points_are_those_of_scipy_and_need_no_power_of_two(scenes_of):
    from scipy.stats import qmc

    scenes = scenes_of(11, sampling="sobol", seed=3)
    unit = qmc.Sobol(2, seed=np.random.default_rng(3)).random(16)[:11]
    np.testing.assert_allclose(
        (scenes["cable_top_tension"] - 200.0) / 100.0, unit[:, 0], rtol=0, atol=1e-14
    )  # rounding
    np.testing.assert_allclose((scenes["ends_upper_x"] - 7.0) / 1.5, unit[:, 1], rtol=0, atol=1e-14)


def test_a_grid_has_every_combination(scenes_of):
    scenes = scenes_of(9, sampling="grid")
    pairs = set(zip(scenes["cable_top_tension"].values.tolist(), scenes["ends_upper_x"].values.tolist(), strict=True))
    assert pairs == {(tension, x) for tension in (200.0, 250.0, 300.0) for x in (7.0, 7.75, 8.5)}
    listed = scenes_of(6, sampling="grid", ranges={"cable.top_tension": [200, 210, 290], "gravity": [9.0, 9.8]})
    assert listed["cable_top_tension"].values.tolist() == [200, 200, 210, 210, 290, 290]
    assert listed["gravity"].values.tolist() == [9.0, 9.8] * 3
    lists = {"cable.top_tension": [200, 210, 290], "gravity": [9.0, 9.4, 9.8]}
    assert scenes_of(9, sampling="grid", ranges=lists).sizes["member"] == 9
    with pytest.raises(cp.SceneError, match=r"^members: given 8; allowed: 9, the product of the lengths"):
        scenes_of(8, sampling="grid", ranges=lists)


COUNTS = {"cable.top_tension": [200, 300, 5], "ends.upper.x": [7.0, 8.5, 4]}


def test_ranges_with_a_count_make_a_grid_of_all_combinations(scenes_of):
    scenes = scenes_of(None, ranges=COUNTS)
    tension, x = scenes["cable_top_tension"].values, scenes["ends_upper_x"].values
    np.testing.assert_array_equal(tension.reshape(5, 4), np.repeat([[200.0], [225.0], [250.0], [275.0], [300.0]], 4, 1))
    np.testing.assert_array_equal(x.reshape(5, 4), [[7.0, 7.5, 8.0, 8.5]] * 5)
    np.testing.assert_array_equal(scenes["ends_upper"].sel(coordinate="x"), x)
    xr.testing.assert_identical(scenes, scenes_of(20, ranges=dict(reversed(COUNTS.items()))))
    nested = {"cable": {"top_tension": (200, 300, 5)}, "ends.upper.x": np.array([7.0, 8.5, 4.0])}
    xr.testing.assert_identical(scenes, scenes_of(None, ranges=nested))
    links = scenes_of(None, ranges={"chain.links": [4, 8, 3], "gravity": [9, 10, 2]})
    assert links["chain_links"].values.tolist() == [4, 4, 6, 6, 8, 8]
    assert links["gravity"].values.tolist() == [9.0, 10.0] * 3
    assert links["chain_links"].dtype.kind == "i"


def test_a_table_with_counts_makes_the_same_grid(soft, scenes_of):
    soft["ensemble"] = {"ranges": COUNTS}
    scene = cp.make_scene(soft)
    table = json.loads(scene.attrs["ensemble_json"])
    assert (table["members"], table["sampling"]) == (20, "grid")
    scenes = cp.ensemble.design(scene)
    xr.testing.assert_equal(scenes, scenes_of(None, ranges=COUNTS))
    with pytest.raises(cp.SceneError, match=r"^members: given 7; allowed: 20, the product of the lengths"):
        cp.ensemble.design(scene, members=7)
    soft["ensemble"] = {"members": 20, "ranges": COUNTS}
    xr.testing.assert_equal(scenes, cp.ensemble.design(cp.make_scene(soft)))
    soft["ensemble"] = {"ranges": {"chain.links": [4, 8, 5]}}
    assert cp.ensemble.design(cp.make_scene(soft))["chain_links"].values.tolist() == [4, 5, 6, 7, 8]
    soft["ensemble"] = {"ranges": {"chain.links": [4, 8, 4]}}
    with pytest.raises(cp.SceneError, match=r"^ensemble\.ranges\.chain\.links: "):
        cp.make_scene(soft)


@pytest.mark.parametrize("count", [2, 3, 70])  # lists of two values, of three, and those that a history shortens
def test_the_lineage_of_a_grid_with_counts_makes_it_again(soft, count):
    ranges = {"cable.top_tension": [200.0, 300.1, count], "gravity": [9.0, 9.9, 2]}
    for scenes in (
        cp.ensemble.design(cp.make_scene(soft), ranges),
        cp.ensemble.design(cp.make_scene(soft | {"ensemble": {"ranges": ranges}})),
    ):
        xr.testing.assert_identical(run_script(lineage.script(scenes)), scenes)


def test_a_grid_with_counts_runs_resumes_and_makes_a_map(soft, tmp_path):
    ranges = {"cable.top_tension": [200, 300, 3], "motion.upper.x.amplitude": [-0.05, -0.02, 4]}
    soft["ensemble"] = {"ranges": ranges}
    scenes = cp.ensemble.design(cp.make_scene(soft))
    options = {"step": ENSEMBLE_STEP, "outputs": ("tension_extremes",), "batch": 5}
    whole = cp.ensemble.run(scenes, tmp_path / "it", **options).compute()
    (tmp_path / "it" / "batch_0001.nc").unlink()
    given = cp.ensemble.design(cp.make_scene(soft), ranges)  # the same by another way
    again = cp.ensemble.run(given, tmp_path / "it", **options)
    xr.testing.assert_identical(again.compute(), whole)
    assert again.sizes["member"] == 12
    ax = cp.plots.parameter_map(
        again.assign(least=again["tension_minimum"].min("link")),
        "least",
        x="cable.top_tension",
        y="motion.upper.x.amplitude",
    )
    (mesh,) = [item for item in ax.collections if item.__class__.__name__ == "QuadMesh"]
    least = whole["tension_minimum"].min("link").values.reshape(3, 4)  # the keys are in the order of the alphabet
    np.testing.assert_array_equal(mesh.get_array(), least.T)
    assert np.unique(least).size == 12


def test_a_list_is_taken_as_it_is(scenes_of):
    scenes = scenes_of(
        3, sampling="list", ranges={"cable.top_tension": [300.0, 200.0, 250.0], "chain.links": [4, 6, 5]}
    )
    assert scenes["cable_top_tension"].values.tolist() == [300.0, 200.0, 250.0]
    assert scenes["chain_links"].values.tolist() == [4, 6, 5]
    assert scenes["chain_links"].dtype.kind == "i"


def test_a_table_of_the_scene_file_is_the_default(soft):
    soft["point_load"] = [{"arc_length": 0.5, "force": [0.0, -10.0]}]
    soft["load"] = {"uniform": [1.0, 0.0]}
    ranges = {"ends.upper.x": [7, 8.5], "point_load.1.force.y": [-20, -10], "load.uniform.y": [0, 1]}
    soft["ensemble"] = {"members": 8, "seed": 5, "sampling": "sobol", "ranges": ranges}
    scene = cp.make_scene(soft)
    scenes = cp.ensemble.design(scene)
    xr.testing.assert_equal(scenes, cp.ensemble.design(scene, ranges, members=8, seed=5, sampling="sobol"))
    assert "ensemble_json" not in scenes.attrs
    assert cp.ensemble.design(scene, members=3).sizes["member"] == 3
    force = scenes["point_load_1_force"]
    assert force.dims == ("member", "coordinate")
    assert (force.sel(coordinate="x") == 0.0).all()
    assert ((force.sel(coordinate="y") >= -20) & (force.sel(coordinate="y") <= -10)).all()
    # the members are the scenes that the same values make
    soft["ends"]["upper"][0] = float(scenes["ends_upper_x"][2])
    soft["point_load"][0]["force"][1] = float(force[2, 1])
    soft["load"]["uniform"][1] = float(scenes["load_uniform_y"][2])
    alone = cp.chain.simulate(cp.make_scene(soft), step=ENSEMBLE_STEP)
    np.testing.assert_array_equal(cp.chain.simulate(scenes, step=ENSEMBLE_STEP).position[2], alone.position)


MISTAKES = [
    ({}, {"members": 0}, r"^members: given 0; allowed: a whole number of at least 1$"),
    ({}, {"members": True}, r"^members: given True; allowed: a whole number"),
    ({}, {"members": None}, r"^members: missing; allowed: a whole number"),
    ({}, {"seed": -1}, r"^seed: given -1; allowed: a whole number of at least 0$"),
    ({}, {"sampling": "random"}, r"^sampling: given 'random'; allowed: one of \"latin_hypercube\""),
    ({}, {"sampling": "grid"}, r"^members: given 10; allowed: 9 \(or 16\), because a grid has equally many points"),
    ({"gravity": [9, 9.4, 9.8]}, {"sampling": "grid"}, r"^members: given 10; allowed: 12 \(or 27\).*times 3 of its lists$"),
    ({"gravity": [9, 9, 9.8]}, {"sampling": "grid"}, r"^ranges\.gravity: given \[9, 9, 9\.8\]; allowed: different values"),
    ({"gravity": [9, 9.8]}, {"sampling": "list"}, r"^ranges\.cable\.top_tension: given .*; allowed: 10 values for sampling"),
    ({"gravity": [2**60, 2**60 + 1]}, {}, r"^ranges\.gravity\[1\]: given 1152921504606846977; .* of at most 2\*\*53 = 9007"),
    ({"gravity": "all"}, {}, r"^ranges\.gravity: given 'all'; allowed: a list"),
    ({"cable.top_tensio": [1, 2]}, {}, r"^ranges\.cable\.top_tensio: unknown key path; allowed: the path of a number"),
    ({"cable_aera": [1, 2]}, {}, r"^ranges\.cable_aera: unknown key path; .*; try: cable\.area$"),
    ({"ends.upper.z": [1, 2]}, {}, r"^ranges\.ends\.upper\.z: unknown key path"),
    ({"motion.upper.y.amplitude": [1, 2]}, {}, r"^ranges\.motion\.upper\.y\.amplitude: unknown key path"),
    (COUNTS, {"members": 9}, r"^members: given 9; allowed: 20, the product of the counts 5 x 4, or none given$"),
    (COUNTS, {"members": "many"}, r"^members: given 'many'; allowed: a whole number"),
    (COUNTS | {"gravity": [9, "10", 3]}, {}, r"^ranges\.gravity\[1\]: given '10'; allowed: a finite number"),
    (COUNTS | {"gravity": [9, 10, 10**7]}, {"members": None}, r"^members: given 200000000; allowed: .* at most 10000000"),
    (COUNTS | {"cable.area": [-1, 2, 4]}, {"members": None}, r"^ranges\.cable\.area: given .*, at -1 no scene: "),
    (COUNTS | {"chain.links": [4, 8, 4]}, {"members": None}, r"^ranges\.chain\.links: given .*; allowed: .*whole numbers"),
    (COUNTS, {"sampling": "sobol"}, r'^ranges\.cable\.top_tension: given .*; allowed: \[low, high\] for sampling "sobol"; \['),
    (COUNTS, {"sampling": "grid"}, r"^ranges\.cable\.top_tension: given .*; allowed: rising values; \[low, high, count\]"),
]  # fmt: skip


# more of ranges alone, by a call and in a scene, are in tests/scene/test_mistakes.py
@pytest.mark.parametrize(("ranges", "options", "match"), MISTAKES, ids=[item[2][:30] for item in MISTAKES])
def test_mistakes_in_a_design_are_named(soft, ranges, options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.ensemble.design(cp.make_scene(soft), ENSEMBLE_RANGES | ranges, **{"members": 10, **options})


def test_a_design_without_ranges_is_refused(soft):
    scene = cp.make_scene(soft)
    for ranges in ({}, [], 5):
        with pytest.raises(cp.SceneError, match=r"^ranges: given .*; allowed: a mapping from key paths"):
            cp.ensemble.design(scene, ranges, members=3)
    with pytest.raises(cp.SceneError, match=r"no table \[ensemble\]; allowed: one of them"):
        cp.ensemble.design(scene, members=3)
    with pytest.raises(cp.SceneError, match="allowed: a result of make_scene or read_scene"):
        cp.ensemble.design(cp.ensemble.design(scene, ENSEMBLE_RANGES, members=3), ENSEMBLE_RANGES, members=3)


def test_ranges_of_a_scene_file_may_be_of_components_grids_and_lists(soft):
    soft["ensemble"] = {"members": 3, "sampling": "list", "ranges": {"ends.upper.x": [8.0, 7.0, 7.5]}}
    assert cp.ensemble.design(cp.make_scene(soft))["ends_upper_x"].values.tolist() == [8.0, 7.0, 7.5]
    soft["ensemble"] = {"members": 5, "sampling": "grid", "ranges": ENSEMBLE_RANGES}
    with pytest.raises(cp.SceneError, match=r"^ensemble\.members: given 5; allowed: 4 \(or 9\)"):
        cp.make_scene(soft)
    soft["ensemble"] = {"members": 4, "ranges": {"ends.upper.x": [8.0, 1e10]}}
    with pytest.raises(
        cp.SceneError, match=r"^ensemble\.ranges\.ends\.upper\.x: given .*, at 1e\+10 no scene: ends\.upper: "
    ):
        cp.make_scene(soft)
