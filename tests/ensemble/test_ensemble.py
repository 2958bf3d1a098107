"""Ensembles: how members are drawn, that running them in any way gives the same bits, and how the folder opens."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import xarray as xr
from compliance import check_compliance
from scenes import SOFT, SOFT_TOML, full_modes

import cablepod as cp
from cablepod import archive_ensemble, cli
from cablepod.archive_ensemble import describe_ensemble

RANGES = {"cable.top_tension": [200.0, 300.0], "ends.upper.x": [7.0, 8.5]}
STEP = 4e-3


@pytest.fixture
def scenes_of(soft):
    """Make the scenes of so many members."""
    return lambda members=10, **options: cp.ensemble.design(
        cp.make_scene(soft), options.pop("ranges", RANGES), members=members, **options
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with an ensemble of ten members in three files; not to be changed."""
    folder = tmp_path_factory.mktemp("finished") / "it"
    scenes = cp.ensemble.design(cp.make_scene(SOFT), RANGES, members=10)
    cp.ensemble.run(scenes, folder, batch=4, step=STEP)
    return folder


# --- design -------------------------------------------------------------------------------------------------------------


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
    assert stage["parameters"] == {"members": 10, "sampling": "latin_hypercube", "seed": 1, "ranges": RANGES}


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
    alone = cp.chain.simulate(cp.make_scene(soft), step=STEP)
    np.testing.assert_array_equal(cp.chain.simulate(scenes, step=STEP).position[2], alone.position)


MISTAKES = [
    ({}, {"members": 0}, r"^members: given 0; allowed: a whole number of at least 1$"),
    ({}, {"members": True}, r"^members: given True; allowed: a whole number"),
    ({}, {"members": None}, r"^members: missing; allowed: a whole number"),
    ({}, {"seed": -1}, r"^seed: given -1; allowed: a whole number of at least 0$"),
    ({}, {"sampling": "random"}, r"^sampling: given 'random'; allowed: one of \"latin_hypercube\""),
    ({}, {"sampling": "grid"}, r"^members: given 10; allowed: 9 \(or 16\), because a grid has equally many points"),
    (
        {"gravity": [9, 9.4, 9.8]},
        {"sampling": "grid"},
        r"^members: given 10; allowed: 12 \(or 27\).*times 3 of its lists$",
    ),
    (
        {"gravity": [9, 9, 9.8]},
        {"sampling": "grid"},
        r"^ranges\.gravity: given \[9, 9, 9\.8\]; allowed: different values",
    ),
    (
        {"gravity": [9, 9.8]},
        {"sampling": "list"},
        r"^ranges\.cable\.top_tension: given .*; allowed: 10 values for sampling",
    ),
    ({"gravity": [9.8, 9]}, {}, r"^ranges\.gravity: given \[9\.8, 9\]; allowed: \[low, high\] with low < high$"),
    ({"gravity": "all"}, {}, r"^ranges\.gravity: given 'all'; allowed: a list"),
    ({"cable.top_tensio": [1, 2]}, {}, r"^ranges\.cable\.top_tensio: unknown key path; allowed: the path of a number"),
    ({"cable_area": [1, 2]}, {}, r"^ranges\.cable_area: unknown key path"),
    ({"ends.upper.z": [1, 2]}, {}, r"^ranges\.ends\.upper\.z: unknown key path"),
    ({"ends.upper": [1, 2]}, {}, r"^ranges\.ends\.upper: unknown key path"),
    ({5: [1, 2]}, {}, r"^ranges\.5: unknown key path"),
    ({"motion.upper.y.amplitude": [1, 2]}, {}, r"^ranges\.motion\.upper\.y\.amplitude: unknown key path"),
    (
        {"cable.area": [-1, 2]},
        {},
        r"^ranges\.cable\.area: given \[-1\.0, 2\.0\], at -1 no scene: cable\.area: given -1\.0;",
    ),
    ({"cable.top_tension": [1, 300]}, {}, r"at 1 no scene: cable\.top_tension: given 1\.0; allowed: at least"),
    ({"chain.links": [5, 9]}, {}, r"^ranges\.chain\.links: given \[5, 9\]; allowed: a list of whole numbers"),
]


@pytest.mark.parametrize(("ranges", "options", "match"), MISTAKES, ids=[item[2][:30] for item in MISTAKES])
def test_mistakes_in_a_design_are_named(soft, ranges, options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.ensemble.design(cp.make_scene(soft), RANGES | ranges, **{"members": 10, **options})


def test_a_design_without_ranges_is_refused(soft):
    scene = cp.make_scene(soft)
    for ranges in ({}, [], 5):
        with pytest.raises(cp.SceneError, match=r"^ranges: given .*; allowed: a mapping from key paths"):
            cp.ensemble.design(scene, ranges, members=3)
    with pytest.raises(cp.SceneError, match=r"no table \[ensemble\]; allowed: one of them"):
        cp.ensemble.design(scene, members=3)
    with pytest.raises(cp.SceneError, match="allowed: what make_scene or read_scene gives"):
        cp.ensemble.design(cp.ensemble.design(scene, RANGES, members=3), RANGES, members=3)


def test_ranges_of_a_scene_file_may_be_of_components_grids_and_lists(soft):
    soft["ensemble"] = {"members": 3, "sampling": "list", "ranges": {"ends.upper.x": [8.0, 7.0, 7.5]}}
    assert cp.ensemble.design(cp.make_scene(soft))["ends_upper_x"].values.tolist() == [8.0, 7.0, 7.5]
    soft["ensemble"] = {"members": 5, "sampling": "grid", "ranges": RANGES}
    with pytest.raises(cp.SceneError, match=r"^ensemble\.members: given 5; allowed: 4 \(or 9\)"):
        cp.make_scene(soft)
    soft["ensemble"] = {"members": 4, "ranges": {"ends.upper.x": [8.0, 1e10]}}
    with pytest.raises(
        cp.SceneError, match=r"^ensemble\.ranges\.ends\.upper\.x: given .*, at 1e\+10 no scene: ends\.upper: "
    ):
        cp.make_scene(soft)


# --- running ------------------------------------------------------------------------------------------------------------


def test_an_ensemble_is_what_one_call_gives(finished, scenes_of):
    scenes = scenes_of()
    whole = cp.archive.open_ensemble(finished)
    direct = cp.chain.simulate(scenes, step=STEP)
    for name in ("position", "arc_length", "unstretched_length", "energy_excess", "time", "cable_top_tension"):
        np.testing.assert_array_equal(whole[name], direct[name], err_msg=name)
        assert whole[name].attrs == direct[name].attrs, name
    assert (whole["step"] == STEP).all()
    assert whole["step"].attrs["units"] == "s"
    assert set(direct.coords) <= set(whole.coords)
    assert whole.attrs["law"] == "linear"
    assert sorted(path.name for path in finished.iterdir() if path.name[0] != ".") == [
        *(f"batch_000{i}.nc" for i in range(3)), "manifest.json", "scenes.nc",
    ]  # fmt: skip


@pytest.mark.parametrize("workers", [1, 3])
def test_any_number_of_workers_gives_the_same_bits(finished, scenes_of, tmp_path, workers):
    again = cp.ensemble.run(scenes_of(), tmp_path / "it", batch=4, step=STEP, workers=workers)
    whole = cp.archive.open_ensemble(finished)
    assert again.attrs["id"] == whole.attrs["id"]
    xr.testing.assert_equal(again.compute(), whole.compute())
    for number in range(3):
        one, other = (cp.archive.read(folder / f"batch_000{number}.nc") for folder in (finished, tmp_path / "it"))
        assert one.attrs["id"] == other.attrs["id"]
        hashes = [json.loads(item.attrs["history_json"])[-1]["sha256"] for item in (one, other)]
        assert hashes[0] == hashes[1]


def test_reduced_models_run_too(soft, tmp_path, scenes_of):
    modes = full_modes()
    scenes = scenes_of(5, ranges={"cable.top_tension": [200.0, 300.0], "motion.upper.x.amplitude": [-0.05, 0.01]})
    options = {"rank": 2, "step": 2e-3, "outputs": ("position",)}
    run = cp.ensemble.run(scenes, tmp_path / "it", model="condensed", modes=modes, batch=5, **options)
    np.testing.assert_array_equal(run.position, cp.condensed.simulate(scenes, modes, **options).position)
    assert (tmp_path / "it" / "modes.nc").exists()
    assert modes.attrs["id"] in json.loads(run.attrs["history_json"])[-1]["inputs"]
    other = modes.assign(mode_shape=2.0 * modes["mode_shape"])
    with pytest.raises(cp.ArchiveError, match="holds another ensemble: the modes was"):
        cp.ensemble.run(scenes, tmp_path / "it", model="condensed", modes=other, batch=5, **options)


def test_failing_members_are_marked_and_stop_nobody_else(scenes_of, tmp_path):
    scenes = scenes_of(9)
    tension = scenes["cable_top_tension"].values.copy()
    tension[[0, 1, 2, 4]] = 1.0  # no cable of this weight hangs with 1 N; one batch fails as a whole
    bad = scenes.assign(cable_top_tension=("member", tension, scenes["cable_top_tension"].attrs))
    with pytest.warns(
        cp.MemberFailedWarning, match=r"4 of 9 members failed .* member 0: cable\.top_tension: given 1\.0"
    ):
        run = cp.ensemble.run(bad, tmp_path / "it", batch=3, step=STEP)
    good = [3, 5, 6, 7, 8]
    np.testing.assert_array_equal(np.flatnonzero(run["failure"] == ""), good)
    assert np.isnan(run["position"][[0, 1, 2, 4]]).all()
    assert np.isnan(run["step"][[0, 1, 2, 4]]).all()
    np.testing.assert_array_equal(run["position"][good], cp.chain.simulate(scenes, step=STEP).position[good])
    assert "failed    4" in describe_ensemble(tmp_path / "it")
    assert "cable.top_tension: given 1.0" in describe_ensemble(tmp_path / "it")
    stage = [item["function"] for item in json.loads(run.attrs["history_json"])]
    assert stage == ["make_scene", "ensemble.design", "changed by hand", "ensemble.run"]


def test_all_members_may_fail(scenes_of, tmp_path):
    scenes = scenes_of(3)
    bad = scenes.assign(cable_top_tension=("member", np.ones(3), scenes["cable_top_tension"].attrs))
    with pytest.warns(cp.MemberFailedWarning, match="3 of 3 members failed"):
        run = cp.ensemble.run(bad, tmp_path / "it", step=STEP)
    assert (run["failure"] != "").all()
    assert "position" not in run


def test_a_condensed_model_whose_first_member_fails(scenes_of, tmp_path):
    modes = full_modes()
    scenes = scenes_of(4, ranges={"cable.top_tension": [200.0, 300.0]})
    tension = scenes["cable_top_tension"].values.copy()
    tension[0] = 1.0
    bad = scenes.assign(cable_top_tension=("member", tension, scenes["cable_top_tension"].attrs))
    options = {"rank": 2, "step": 2e-3, "outputs": ("position",)}
    with pytest.warns(cp.MemberFailedWarning, match="1 of 4 members failed"):
        run = cp.ensemble.run(bad, tmp_path / "it", model="condensed", modes=modes, **options)
    rest = cp.condensed.simulate(bad.isel(member=slice(1, None)), modes, **options)
    np.testing.assert_array_equal(run.position[1:], rest.position)
    assert np.isnan(run.position[0]).all()


def test_batches_are_handed_over_in_order_and_not_kept(scenes_of, finished):
    whole, seen = cp.archive.open_ensemble(finished).compute(), []
    parts = list(cp.ensemble.batches(scenes_of(), batch=4, step=STEP, progress=seen.append))
    assert [part.sizes["member"] for part in parts] == [4, 4, 2]
    np.testing.assert_array_equal(np.concatenate([part["position"] for part in parts]), whole["position"])
    assert [part["member"].values[0] for part in parts] == [0, 4, 8]
    assert seen[-1] == 1.0
    assert len({part.attrs["id"] for part in parts}) == 3
    # who stops taking them stops the work
    generator = cp.ensemble.batches(scenes_of(), batch=1, step=STEP)
    next(generator)
    generator.close()


def test_progress_counts_all_members(scenes_of, tmp_path):
    seen = []
    cp.ensemble.run(scenes_of(), tmp_path / "it", batch=3, step=STEP, progress=seen.append)
    assert seen == sorted(seen)
    assert (seen[0], seen[-1]) == (0.0, 1.0)
    assert len(seen) > 4
    (tmp_path / "it" / "batch_0001.nc").unlink()
    seen.clear()
    cp.ensemble.run(scenes_of(), tmp_path / "it", batch=3, step=STEP, progress=seen.append)
    assert seen[0] == pytest.approx(0.7)
    assert seen[-1] == 1.0


def test_other_warnings_come_once(soft, scenes_of, tmp_path, monkeypatch):
    import warnings

    from cablepod import ensemble_work

    def noisy(scenes, *, step=None, progress=None):
        for member in scenes["member"].values.tolist() if "member" in scenes.dims else []:
            warnings.warn(f"member {member} is odd", RuntimeWarning, stacklevel=1)
        return cp.chain.simulate(scenes, step=step)

    monkeypatch.setattr(ensemble_work, "MODELS", {**ensemble_work.MODELS, "chain": noisy})
    with pytest.warns(RuntimeWarning, match=r"member \d is odd \(and 9 more such warnings in 10 members\)") as caught:
        list(cp.ensemble.batches(scenes_of(), batch=4, step=STEP))
    assert len(caught) == 1


OPTIONS = [
    ({"stepp": 1}, r"^option stepp: given 1; allowed: an option of model \"chain\": links, times, law"),
    ({"step": "x"}, r"^step: given 'x'; allowed: a finite number above 0"),
    ({"step": 1.0}, r"^step: given 1 s; allowed: below the stability limit"),
    ({"outputs": ("force",)}, r"^outputs: given 'force'; allowed: some of position"),
    ({"scheme": "euler"}, r"^scheme: given 'euler'"),
    ({"times": [1.0, 0.0]}, r"^times: given .*; allowed: finite, rising instants"),
    ({"times": max}, r"^times: given .*; allowed: a number, a text or a list of them"),
    ({"model": "beam"}, r"^model: given 'beam'; allowed: one of \"chain\", \"cable\""),
    ({"model": "galerkin"}, r"^modes: given None; allowed: the Dataset of modes"),
    ({"modes": xr.Dataset()}, r"^modes: given 'a value'; allowed: none for model \"chain\""),
    ({"batch": 0}, r"^batch: given 0; allowed: a whole number of at least 1"),
    ({"workers": 0}, r"^workers: given 0; allowed: a whole number of at least 1"),
    ({"scheduler": "threads"}, r"^scheduler: given 'threads'; allowed: None \(threads\), \"processes\", the address"),
]


@pytest.mark.parametrize(("options", "match"), OPTIONS, ids=[str(next(iter(item[0].items())))[:20] for item in OPTIONS])
def test_options_are_checked_before_anything_runs(scenes_of, tmp_path, options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.ensemble.run(scenes_of(), tmp_path / "it", **options)
    assert not list(tmp_path.glob("it/batch*"))


def test_scenes_that_give_no_single_array_are_refused(scenes_of, soft, tmp_path):
    links = scenes_of(3, sampling="list", ranges={"chain.links": [4, 6, 5]})
    with pytest.raises(
        cp.SceneError, match=r"^chain\.links: given 'different values'; allowed: one value .* the option links$"
    ):
        cp.ensemble.run(links, tmp_path / "it", step=STEP)
    assert cp.ensemble.run(links, tmp_path / "it", step=STEP, links=4).sizes["particle"] == 5
    for wrong in (cp.make_scene(soft), None, links.isel(member=slice(0, 0))):
        with pytest.raises(cp.SceneError, match=r"^scenes: given no "):
            cp.ensemble.run(wrong, tmp_path / "other")


# --- opening ------------------------------------------------------------------------------------------------------------


def test_it_opens_lazily_with_parameters_to_choose_by(finished):
    whole = cp.archive.open_ensemble(finished)
    assert whole["position"].dims == ("member", "time", "particle", "coordinate")
    assert whole["position"].chunks[0] == (4, 4, 2)
    assert {"cable_top_tension", "ends_upper_x", "member", "arc_length", "time"} <= set(whole.coords)
    assert whole["arc_length"].dims == ("member", "particle")
    taut = whole.where(whole["cable_top_tension"] > 250.0, drop=True)
    assert taut.sizes["member"] == int((whole["cable_top_tension"] > 250.0).sum()) > 0
    by_tension = whole.swap_dims(member="cable_top_tension").sortby("cable_top_tension")
    wanted = float(whole["cable_top_tension"][7])
    np.testing.assert_array_equal(by_tension["position"].sel(cable_top_tension=wanted), whole["position"][7])
    np.testing.assert_array_equal(whole["position"].sel(member=9, time=2.0), whole["position"].values[9, 4])


def test_its_provenance_has_each_stage_once(finished):
    whole = cp.archive.open_ensemble(finished)
    manifest = json.loads((finished / "manifest.json").read_text())
    stages = json.loads(whole.attrs["history_json"])
    assert [stage["function"] for stage in stages] == ["make_scene", "ensemble.design", "ensemble.run"]
    assert whole.attrs["id"] == stages[-1]["id"] == manifest["id"]
    assert len(whole.attrs["history"].split("\n")) == 3
    assert stages[-1]["parameters"]["options"]["step"] == STEP
    # and a batch by itself
    batch = cp.archive.read(finished / "batch_0001.nc")
    own = json.loads(batch.attrs["history_json"])[-1]
    assert own["parameters"]["number"] == 1
    assert own["parameters"]["ensemble"] == manifest["id"]
    assert own["wall_time_s"] > 0
    assert batch.attrs["history"].split("\n")[:2] == whole.attrs["history"].split("\n")[:2]


def test_what_was_opened_can_be_written_again(finished, tmp_path):
    whole = cp.archive.open_ensemble(finished)
    back = cp.archive.read(cp.archive.write(whole, tmp_path / "one.nc"))
    xr.testing.assert_equal(back, whole.compute())
    assert back.attrs["id"] == whole.attrs["id"]


def test_long_batches_are_cut_along_time(finished, monkeypatch):
    monkeypatch.setattr(archive_ensemble, "CHUNK", 4 * 9 * 2 * 8 * 2)
    whole = cp.archive.open_ensemble(finished)
    assert whole["position"].chunks[1] == (2, 2, 2, 2, 1)
    monkeypatch.undo()
    np.testing.assert_array_equal(whole["position"], cp.archive.open_ensemble(finished)["position"])


def test_coordinates_that_all_batches_share_stay_shared(scenes_of, tmp_path):
    scenes = scenes_of(4, ranges={"motion.upper.x.amplitude": [-0.05, 0.01]})
    run = cp.ensemble.run(scenes, tmp_path / "it", batch=2, step=STEP)
    assert run["arc_length"].dims == ("particle",)
    # one member alone shares everything with itself
    single = cp.ensemble.run(scenes_of(3), tmp_path / "other", batch=1, step=STEP)
    assert single["arc_length"].dims == ("member", "particle")
    np.testing.assert_array_equal(single["arc_length"], cp.chain.simulate(scenes_of(3), step=STEP)["arc_length"])


def test_faults_of_files_are_named(finished, tmp_path):
    netCDF4 = pytest.importorskip("netCDF4")
    folder = tmp_path / "it"
    shutil.copytree(finished, folder)
    (folder / "batch_0000.nc").unlink()
    content = (folder / "batch_0001.nc").read_bytes()
    (folder / "batch_0001.nc").write_bytes(content[: len(content) // 2])
    with netCDF4.Dataset(folder / "batch_0002.nc", "a") as file:
        file.setncattr("cablepod_schema", np.int64(99))
    with pytest.raises(cp.ArchiveError) as caught:
        cp.archive.open_ensemble(folder)
    text = str(caught.value)
    assert "batch_0000.nc: is missing; run the ensemble again" in text
    assert "batch_0001.nc: is truncated or damaged" in text
    assert "batch_0002.nc: has schema version 99" in text


def test_faults_of_manifests_are_named(finished, tmp_path):
    with pytest.raises(cp.ArchiveError, match=r"has no manifest\.json, so it is no ensemble"):
        cp.archive.open_ensemble(tmp_path)
    with pytest.raises(cp.ArchiveError, match="is no folder"):
        cp.archive.open_ensemble(tmp_path / "nowhere")
    folder = tmp_path / "it"
    shutil.copytree(finished, folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"schema": 99}))
    with pytest.raises(cp.ArchiveError, match=r"manifest\.json: has schema version 99"):
        cp.archive.open_ensemble(folder)
    (folder / "manifest.json").write_text(json.dumps(manifest)[:-40])
    with pytest.raises(cp.ArchiveError, match=r"manifest\.json: is damaged"):
        cp.archive.open_ensemble(folder)
    # a batch of another ensemble
    (folder / "manifest.json").write_text(json.dumps(manifest))
    shutil.copy(folder / "batch_0001.nc", folder / "batch_0000.nc")
    with pytest.raises(cp.ArchiveError, match=r"batch_0000\.nc: is not batch 0 of the ensemble"):
        cp.archive.open_ensemble(folder)


def test_an_unfinished_ensemble_opens_only_on_demand(finished, tmp_path):
    folder = tmp_path / "it"
    shutil.copytree(finished, folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "batch_0001.nc").unlink()
    del manifest["done"]["1"], manifest["done"]["2"]  # the third was written, but the run was killed before it noted it
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(
        cp.ArchiveError, match=r"4 of 10 members are not done yet; run the ensemble again.*incomplete=True"
    ):
        cp.archive.open_ensemble(folder)
    part, whole = cp.archive.open_ensemble(folder, incomplete=True), cp.archive.open_ensemble(finished)
    assert part["member"].values.tolist() == [0, 1, 2, 3, 8, 9]
    xr.testing.assert_equal(part.compute(), whole.isel(member=[0, 1, 2, 3, 8, 9]).compute())
    assert "done      6; the same command or call goes on" in describe_ensemble(folder)


# --- the command --------------------------------------------------------------------------------------------------------

TABLE = """
[ensemble]
members = 5
seed = 2
[ensemble.ranges]
"cable.top_tension" = [200.0, 300.0]
"ends.upper.x" = [7.0, 8.5]
"""


def test_the_command_runs_resumes_and_tells(tmp_path, capsys):
    scene = tmp_path / "study.toml"
    scene.write_text(SOFT_TOML + TABLE)
    out = tmp_path / "deep" / "out"
    command = ["ensemble", str(scene), "--out", str(out), "--option", "step=4e-3", "--option", "outputs=['tension']"]
    assert cli.main(command) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "done      5\n" in said.out
    run = cp.archive.open_ensemble(out)
    direct = cp.chain.simulate(cp.ensemble.design(cp.read_scene(scene)), step=4e-3, outputs=("tension",))
    np.testing.assert_array_equal(run["tension"], direct["tension"])
    written = (out / "batch_0000.nc").stat().st_mtime_ns
    assert cli.main(command) == 0
    assert (out / "batch_0000.nc").stat().st_mtime_ns == written
    capsys.readouterr()
    assert cli.main(["info", str(out)]) == 0
    told = capsys.readouterr().out
    for text in (
        "members   5 in 1 files of 64",
        "failed    0",
        "ends_upper_x from 7.",
        "step=0.004",
        "ensemble.design(",
    ):
        assert text in told
    assert cli.main([*command, "--option", "step=2e-3"]) == 2
    assert "the option step was 0.004 and is 0.002" in capsys.readouterr().err
    assert cli.main([*command, "--option", "step=2e-3", "--overwrite"]) == 0
    assert (cp.archive.open_ensemble(out)["step"] == 2e-3).all()


def test_the_command_refuses_in_one_line(tmp_path, capsys):
    scene = tmp_path / "study.toml"
    scene.write_text(SOFT_TOML)
    for extra, text in (
        ([], "ensemble: missing in"),
        (["--option", "step"], "--option: given 'step'; allowed: NAME=VALUE"),
    ):
        assert cli.main(["ensemble", str(scene), "--out", str(tmp_path / "out"), *extra]) == 2
        said = capsys.readouterr()
        assert text in said.err
        assert said.err.count("\n") == 1
        scene.write_text(SOFT_TOML + TABLE)


def test_ten_thousand_members_open_by_the_manifest_and_heads_alone(finished, tmp_path, monkeypatch):
    # the clock is in pipelines/benchmarks; here: that no batch but one of each kind is opened by xarray
    opened = []
    real = archive_ensemble.opened_file
    monkeypatch.setattr(archive_ensemble, "opened_file", lambda path: opened.append(path.name) or real(path))
    cp.archive.open_ensemble(finished)
    assert opened == ["scenes.nc", "batch_0000.nc"]


def test_its_lineage_makes_it_again(finished, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for path, number in ((finished, None), (finished / "batch_0001.nc", 1)):
        assert cli.main(["info", str(path), "--lineage"]) == 0
        exec(capsys.readouterr().out, made := {})
        first = cp.archive.open_ensemble(finished)
        again = cp.archive.read("runs_again.nc")
        np.testing.assert_array_equal(again["position"], first["position"][slice(4, 8) if number else slice(None)])
        assert made["runs"].attrs["id"] == (first if number is None else cp.archive.read(path)).attrs["id"]
        (tmp_path / "runs_again.nc").unlink()


def test_the_real_checker_finds_only_what_is_allowed(finished, scenes_of, tmp_path):
    scenes = scenes_of(3)
    bad = scenes.assign(cable_top_tension=("member", np.ones(3), scenes["cable_top_tension"].attrs))
    with pytest.warns(cp.MemberFailedWarning):
        cp.ensemble.run(bad, tmp_path / "failed", step=STEP)
    cp.archive.write(cp.archive.open_ensemble(finished), tmp_path / "whole.nc")
    files = {
        "batch": finished / "batch_0000.nc",
        "whole": tmp_path / "whole.nc",
        "scenes": finished / "scenes.nc",
        "failed": tmp_path / "failed" / "batch_0000.nc",
    }
    check_compliance(files, tmp_path, have_time=("batch", "whole"))
