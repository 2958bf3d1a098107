"""The main job as a function: what it returns, what it writes, and what it refuses."""

from __future__ import annotations

import json
import warnings
from functools import partial
from importlib.util import find_spec

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from scene_files import toml_of
from scenes import SOFT

import cablepod as cp
from cablepod import cli

MODELS = ["condensed_r1", "condensed_r2", "galerkin_r1", "galerkin_r2"]
STAGES = [
    "scene", "summary", "catenary", "chain_rest", "chain", "chain_half", "modes", "normal_modes", *MODELS, "comparison",
    "chains",
]  # fmt: skip


@pytest.fixture
def scene(soft):
    return cp.make_scene(soft)


@pytest.fixture
def unstable(soft, any_load):
    """A scene whose run of the chain diverges."""
    load = {"uniform": [1.0, 0.0], "kind": "polynomial", "coefficients": [0.0] * 29 + [1e3]}
    return cp.make_scene(soft | {"load": load})


@pytest.fixture(scope="module")
def result():
    """The stages of a study of the soft scene, not to be changed."""
    return cp.study.run(cp.make_scene(SOFT), ranks=(2, 1))


def chain_of(scene, chain):
    """The run of the chain again, by the parameters of its record."""
    given = json.loads(chain.attrs["history_json"])[-1]["parameters"]
    assert given["tolerance"] <= 1e-5  # that of a reference
    return cp.chain.simulate(
        scene, times=chain.time.values, tolerance=given["tolerance"], outputs=tuple(given["outputs"])
    )


def test_it_gives_what_the_functions_give(scene, result):
    assert isinstance(result, xr.DataTree)
    assert list(result) == STAGES
    datasets = {name: node.to_dataset().copy(deep=True) for name, node in result.children.items()}
    for name, variable in ((name, v) for part in datasets.values() for name, v in part.variables.items()):
        assert {"units", "long_name"} <= set(variable.attrs), name
    xr.testing.assert_identical(datasets["scene"], scene)
    xr.testing.assert_identical(datasets["catenary"], cp.catenary.rest(scene))
    xr.testing.assert_identical(datasets["chain_rest"], cp.chain.rest(scene))
    chain = chain_of(scene, datasets["chain"])
    assert datasets["chain"].attrs.pop("wall_time_s") > 0.0
    xr.testing.assert_identical(datasets["chain"], chain)
    modes = cp.pod.decompose(cp.pod.at_times(chain, times=np.linspace(0.0, 4.0, 9)), rank=7)
    xr.testing.assert_identical(datasets["modes"], modes)
    normal = cp.pod.decompose(cp.pod.at_times(chain, times=np.linspace(0.0, 4.0, 9)), rank=7, layout="normal")
    xr.testing.assert_identical(datasets["normal_modes"], normal)
    models = {"galerkin": (cp.galerkin.simulate, modes), "condensed": (cp.condensed.simulate, normal)}
    for model, (simulate, own) in models.items():
        for rank in (1, 2):
            reduced = simulate(scene, own, rank=rank, times=chain.time.values)
            assert datasets[f"{model}_r{rank}"].attrs.pop("wall_time_s") > 0.0
            xr.testing.assert_identical(datasets[f"{model}_r{rank}"], reduced)
            error = cp.compare.errors(reduced, chain)
            row = datasets["comparison"].sel(model=model, rank=rank)
            np.testing.assert_array_equal(row.error, error.error)
            assert (row.step, row.number_of_steps) == (reduced.attrs["step"], reduced.attrs["number_of_steps"])
            assert row.error_estimate == reduced.attrs["error_estimate"]
            assert row.loop_time > 0.0
            assert row.call_time > 0.0
    attributes = dict(result.attrs)
    assert attributes.pop("compile_time_s") >= 0.0  # known of this machine alone
    assert attributes == {"title": "soft", "left_out": [], "notes_left_out": 0}
    for name in ("tension_minimum", "tension_maximum"):
        text = datasets["chain"][name].attrs["long_name"]
        assert text.endswith("over all steps of the run, not at output times between them")


def test_cheaper_chains_stand_beside_the_models(scene, result):
    chains = result["chains"].to_dataset()
    assert set(chains.links.values) == {4, 8}
    reference = chain_of(scene, result["chain"])
    np.testing.assert_array_equal(reference.time, chains.time)
    coarse = chains.isel(trial=int(chains.links.values.argmin()))
    run = cp.chain.simulate(
        scene,
        links=int(coarse.links),
        times=chains.time.values,
        tolerance=float(coarse.tolerance),
        outputs=("position",),
    )
    np.testing.assert_allclose(coarse.error, cp.compare.errors(run, reference).error, rtol=1e-3)
    assert (float(coarse.step), int(coarse.number_of_steps)) == (run.attrs["step"], run.attrs["number_of_steps"])
    assert (chains.call_time > 0.0).all()


def test_the_files_of_the_command_hold_the_same(result, tmp_path, capsys):
    (tmp_path / "soft.toml").write_text(toml_of(SOFT))
    assert cli.main(["run", str(tmp_path / "soft.toml"), "--out", str(tmp_path), "--ranks", "1,2"]) == 0
    said = capsys.readouterr().out
    for name, node in result.children.items():
        written = cp.archive.read(tmp_path / f"{name}.nc")
        assert written.attrs["id"] == node.attrs["id"]
        times = [clock for clock in ("call_time", "loop_time", "compile_time") if clock in written]
        assert written.drop_vars(times).equals(node.to_dataset().drop_vars(times)), name
        assert f"{name}.nc" in said


def test_files_appear_as_stages_are_done_and_figures_of_the_caller_stay_open(scene, tmp_path):
    told, backend, others, mine = [], plt.get_backend(), plt.get_fignums(), plt.figure()

    def progress(label, fraction):
        told.append((label, fraction))

    def report(name, dataset):
        assert (out / f"{name}.nc").exists()
        assert not any((out / f"{later}.nc").exists() for later in STAGES[STAGES.index(name) + 1 :])
        assert cp.archive.read(out / f"{name}.nc").attrs["id"] == dataset.attrs["id"]
        told.append(name)

    out = tmp_path / "deep" / "out"
    try:
        cp.study.run(scene, str(out), ranks=(1, 2), progress=progress, report=report)
        assert plt.get_fignums() == [*others, mine.number]
        assert plt.get_backend() == backend
    finally:
        plt.close(mine)
    assert [item for item in told if isinstance(item, str)] == STAGES
    figures = {"tension", "tension_map", "deflection", "error_over_time", "modes", "singular_values", "shapes"}
    assert {path.name for path in out.iterdir()} == {f"{name}.nc" for name in STAGES} | {
        f"{name}.png" for name in figures
    }
    for label, stage in (("chain", "chain"), *((name.replace("_r", ", r = "), name) for name in MODELS)):
        fractions = [item[1] for item in told if item[0] == label]
        assert (fractions[0], fractions[-1]) == (0.0, 1.0)
        assert told.index((label, 0.0)) > told.index(STAGES[STAGES.index(stage) - 1])
        assert fractions == sorted(set(fractions))
        assert told.index((label, 1.0)) < told.index(stage)


def test_a_stopped_run_keeps_its_partial_result(unstable, tmp_path):
    told = []
    with pytest.raises(cp.RunStopped) as stopped:
        cp.study.run(unstable, tmp_path, report=lambda name, dataset: told.append(name))
    assert told == ["scene", "summary", "catenary", "chain_rest", "chain_incomplete"]
    assert {path.stem for path in tmp_path.iterdir()} == set(told)
    kept = cp.archive.read(tmp_path / "chain_incomplete.nc")
    assert "stopped at" in kept.attrs["incomplete"]
    np.testing.assert_array_equal(kept.position, stopped.value.partial.position)


def test_scenes_are_refused_before_anything_runs(soft, tmp_path):
    del soft["time"]
    with pytest.raises(cp.SceneError, match="time: missing"):
        cp.study.run(cp.make_scene(soft), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0], "free": "lower"}, "motion": {}},
        {"damping": {"link_viscosity": 1e-4}},
    ],
)
@pytest.mark.filterwarnings("ignore:not converged in time")  # the end falls freely
def test_models_that_refuse_a_scene_are_left_out_with_the_key(soft, change):
    result = cp.study.run(cp.make_scene(soft | change), ranks=[1])
    assert [reason.split(":")[0] for reason in result.attrs["left_out"]] == ["condensed", "galerkin"]
    key = next(iter(change))
    assert all(f"{key}." in reason for reason in result.attrs["left_out"])
    assert {"chain", "modes"} < set(result)
    assert not {"comparison", "chains"} & set(result)


@pytest.mark.parametrize(
    ("ranks", "match"),
    [
        ((), r"ranks: given \(\); allowed: whole numbers of at least 1"),
        ((0, 1), r"ranks: given \(0, 1\); allowed: whole"),
        ((1.5,), r"ranks: given \(1.5,\); allowed: whole"),
        (2, "ranks: given 2; allowed: whole"),
        ((9, 8), r"ranks: given \[8, 9\]; allowed: one or more of at most 7, the number of modes"),
    ],
)
def test_ranks_are_refused_before_anything_runs(scene, ranks, match, tmp_path):
    with pytest.raises(cp.SceneError, match=match):
        cp.study.run(scene, tmp_path / "out", ranks=ranks)
    assert not (tmp_path / "out").exists()


def test_larger_ranks_are_left_out_with_a_warning(scene):
    with pytest.warns(UserWarning, match=r"ranks: \[8, 30\] left out, only 7 modes; use smaller ranks") as caught:
        result = cp.study.run(scene, ranks=np.array([30, 1, 8]))
    assert caught[0].filename == __file__
    assert result["comparison"]["rank"].values.tolist() == [1]
    assert "galerkin_r8" not in result


def test_results_are_not_overwritten_without_being_asked(scene, tmp_path):
    for name in ("modes.nc", "condensed_r1.nc"):  # each is named once
        (tmp_path / name).write_text("an older one")
    with pytest.raises(cp.ArchiveError, match=r", which has modes.nc, condensed_r1.nc already; .* overwrite=True"):
        cp.study.run(scene, tmp_path, ranks=[1])
    assert {path.name for path in tmp_path.iterdir()} == {"modes.nc", "condensed_r1.nc"}


@pytest.mark.skipif(not find_spec("fcntl"), reason="this system has no locks of folders")
@pytest.mark.parametrize("old", [False, True])
def test_two_studies_are_not_in_one_folder_at_a_time(scene, tmp_path, old):
    begin = partial(cp.study.run, scene, tmp_path / "it", ranks=[1], models=["condensed"], overwrite=True)
    if old:
        begin()

    def another(name, _):
        if name == "summary":
            with pytest.raises(cp.ArchiveError, match="it: another run is at work in this folder; wait for it"):
                begin()

    begin(report=another)
    assert not list(tmp_path.glob("it/.*"))
    begin()


def test_nothing_of_another_scene_is_left_in_a_folder(soft, tmp_path):
    old = (
        "condensed_r3.nc", "tension.nc", "chain_incomplete.nc", "tension.png", "comparison.nc",
        "galerkin_r2.nc", "motion.nc", "motion_incomplete.nc", "moments.png",  # of another choice of models, and of a mast
    )  # fmt: skip
    for name in (*old, "of_a_user.nc"):
        (tmp_path / name).write_text("of another scene")
    cp.study.run(cp.make_scene(soft), tmp_path, ranks=(1,), models=("condensed",), overwrite=True)
    found = {path.name for path in tmp_path.iterdir()}
    assert not found & {*old} - {"tension.png", "comparison.nc"}
    assert (tmp_path / "of_a_user.nc").read_text() == "of another scene"
    assert all(cp.archive.read(tmp_path / name) for name in found if name.endswith(".nc") and name != "of_a_user.nc")


@pytest.mark.parametrize(
    ("stopped", "left"), [(KeyboardInterrupt, []), (MemoryError, []), (cp.RunStopped, ["chain_incomplete.nc"])]
)
def test_an_old_study_remains_where_a_new_one_is_not_completed(soft, unstable, tmp_path, stopped, left):
    old = {name: f"the old {name}" for name in ("scene.nc", "chain.nc", "modes.png", "galerkin_r1.nc")}
    for name, content in old.items():
        (tmp_path / name).write_text(content)

    def stop(name, _):
        if name == "modes":
            raise stopped

    scene = unstable if stopped is cp.RunStopped else cp.make_scene(soft)
    with pytest.raises(stopped):
        cp.study.run(scene, tmp_path, ranks=(1,), models=("condensed",), overwrite=True, report=stop)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*old, *left])
    assert {name: (tmp_path / name).read_text() for name in old} == old


def test_a_folder_that_cannot_be_is_refused(scene, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(cp.ArchiveError, match=r"out: given .*, which is or lies below a file; allowed: a folder"):
        cp.study.run(scene, tmp_path / "file" / "below")


def test_an_unusual_scene_warns_once_at_the_users_line(soft):
    soft["motion"]["upper"]["x"]["amplitude"] = -0.6
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cp.study.run(cp.make_scene(soft), ranks=(1, 2))
    found = [item for item in caught if issubclass(item.category, cp.UnusualSceneWarning)]
    assert [item.filename for item in found] == [__file__]
    assert str(found[0].message).startswith("motion.upper.x: the scene has a displacement over the chord of 0.12")
