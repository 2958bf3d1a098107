"""What a history says is enough to make a dataset again, with the same ids and the same data."""

from __future__ import annotations

import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from histories import run_script
from periodic_scenes import guy

import cablepod as cp
from cablepod import lineage, provenance
from cablepod.paper import table1


def again(dataset):
    """What the file that makes a dataset again gives."""
    return run_script(lineage.script(dataset))


def reduced(soft, **options):
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, **options)
    return scene, cp.pod.decompose(run, rank=2)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"step": 1e-3, "times": np.arange(101) / 30},
        {"tolerance": 1e-4, "times": np.sort(np.r_[np.arange(41) / 10, np.arange(1, 40) / 30 + 0.01])},
    ],
)
def test_a_reduced_model_is_made_again(soft, options):
    scene, modes = reduced(soft, **options)
    result = cp.galerkin.simulate(scene, modes, times=np.linspace(0, 2.0, 77), tolerance=1e-4, outputs=("tension",))
    xr.testing.assert_identical(again(result), result)
    functions = [stage["function"] for stage in lineage.ancestors(result)]
    assert functions == ["make_scene", "chain.simulate", "pod.decompose", "galerkin.simulate"]


def test_snapshots_picked_are_made_again(soft):
    run = cp.chain.simulate(cp.make_scene(soft), times=np.arange(41) / 10, step=1e-3)
    modes = cp.pod.decompose(cp.pod.at_times(run, times=np.arange(0.0, 4.1, 0.5)), rank=2)
    assert modes.attrs["id"] != cp.pod.decompose(run, rank=2).attrs["id"]
    xr.testing.assert_identical(again(modes), modes)
    one = cp.pod.at_times(run.isel(time=[3]), times=0.3)
    assert one.sizes["time"] == 1
    np.testing.assert_array_equal(cp.pod.at_times(run, times=[4.0, 0.1]).time, run.time[[40, 1]])
    with pytest.raises(cp.SceneError, match=r"times: given 0\.25; allowed: instants of the trajectory"):
        cp.pod.at_times(run, times=[0.1, 0.25])


#: Parts of results, from which a model or a decomposition goes on.
PARTS = {
    "modes": lambda scene, run: cp.condensed.simulate(
        scene, cp.pod.decompose(run, rank=4, layout="normal").isel(mode=[0, 2]), times=[0.0, 1.0]
    ),
    "instants": lambda scene, run: cp.pod.decompose(run.sel(time=slice(1.0, None)), rank=1),
    "member": lambda scene, run: cp.pod.decompose(
        cp.chain.simulate(cp.ensemble.design(scene, {"gravity": [9.0, 9.9]}, members=3), step=1e-3).isel(member=1),
        rank=1,
    ),
    "member of files": lambda scene, run: cp.extremes.peaks(
        cp.ensemble.run(cp.ensemble.design(scene, {"gravity": [9.0, 9.9]}, members=3), "runs", step=1e-3)
        .isel(member=1)[["tension_maximum"]]
        .load(),
        dim="link",
    ),
    "instants, less": lambda scene, run: cp.pod.decompose(run.isel(time=[3, 9, 11]).drop_vars("tension"), rank=1),
}


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # two modes of few
@pytest.mark.parametrize("part", PARTS)
def test_parts_are_selected_again(soft, part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, times=np.arange(41) / 10, step=1e-3)
    result = PARTS[part](scene, run)
    xr.testing.assert_identical(again(result), result)


def test_modes_of_several_runs_are_made_again(soft):
    runs = [cp.chain.simulate(cp.make_scene({**soft, "gravity": gravity}), step=1e-3) for gravity in (9.81, 9.0)]
    modes = cp.pod.decompose(runs, rank=2)
    xr.testing.assert_identical(again(modes), modes)


@pytest.mark.parametrize("make", [cp.chain.rest, cp.rigid.rest, cp.cable.rest, cp.catenary.rest])
def test_rest_is_made_again(soft, make):
    result = make(cp.make_scene(soft))
    xr.testing.assert_identical(again(result), result)


def test_condensed_and_comparison_are_made_again(soft):
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, step=1e-3)
    modes = cp.pod.decompose(run, layout="normal", rank=2)
    result = cp.condensed.simulate(scene, modes, step=1e-3)
    error = cp.compare.errors(result, run)
    xr.testing.assert_identical(again(error), error)
    # each stage once, whatever way leads to it
    assert len(lineage.ancestors(error)) == 5


def test_changes_by_hand_are_made_again(soft):
    scene = cp.make_scene(soft)
    heavier = scene.assign(gravity=scene.gravity + 0.1)
    several = heavier.assign(cable_top_tension=("member", [200.0, 230.0], scene.cable_top_tension.attrs))
    for changed in (heavier, several):
        result = cp.chain.simulate(changed, step=1e-3)
        xr.testing.assert_identical(again(result), result)
    without = cp.chain.simulate(scene.drop_vars([name for name in scene if str(name).startswith("motion")]), step=1e-3)
    xr.testing.assert_identical(again(without), without)


def test_a_scene_with_a_variable_whose_name_is_no_text_is_made_again(soft):
    result = cp.chain.rest(cp.make_scene(soft).assign({1: 3.0}))
    xr.testing.assert_identical(again(result), result)


def test_another_result_is_noticed(soft):
    scene, modes = reduced(soft, step=1e-3)
    with pytest.raises(cp.SceneError, match=r"make_scene: given .* variables .*; allowed: the values of [0-9a-f]{20}"):
        lineage.check(scene, modes.attrs["id"], values=provenance.content_of(modes)["variables"])
    with pytest.raises(cp.SceneError, match=r"make_scene: given .* the id is [0-9a-f]{20}"):
        lineage.check(scene, modes.attrs["id"], values={})
    modes.attrs["history_json"] = modes.attrs["history_json"].replace('"step": 0.001', '"step": 0.002')
    with pytest.raises(cp.SceneError, match=r"chain\.simulate: given .* position differs by .* of the largest"):
        again(modes)


def test_what_cannot_be_made_again_says_so(soft):
    times = np.cumsum(np.random.default_rng(1).uniform(1e-4, 2e-4, 5000))
    result = cp.chain.simulate(cp.make_scene(soft), times=times, step=1e-3)
    with pytest.raises(SystemExit, match=r"chain\.simulate.* cannot be made again, only a digest is kept of times"):
        again(result)
    result.attrs["history_json"] = result.attrs["history_json"].replace("chain.simulate", "chain.unheard_of")
    with pytest.raises(SystemExit, match="cannot be made again"):
        again(result)
    assert "no history" in lineage.script(xr.Dataset())


@pytest.mark.parametrize(
    "times", [0.1 * np.arange(1241), np.arange(1241) / 10, np.linspace(0, 124, 1241), 3 + np.arange(99) / 7]
)
def test_equidistant_instants_are_kept_bit_for_bit(times):
    kept = provenance.to_json(times)
    made = provenance.equidistant(kept["equidistant"], kept["first"], kept["last"], kept["count"])
    np.testing.assert_array_equal(made, times)


@pytest.mark.slow
def test_the_command_writes_a_file_that_runs(soft, tmp_path):
    scene, modes = reduced(soft, step=1e-3)
    file = cp.archive.write(modes, tmp_path / "modes.nc")
    shown = subprocess.run(
        [sys.executable, "-m", "cablepod", "info", "--lineage", file], capture_output=True, text=True, check=True
    )
    (tmp_path / "again.py").write_text(shown.stdout)
    subprocess.run([sys.executable, "again.py"], cwd=tmp_path, check=True)
    made, kept = cp.archive.read(tmp_path / "modes_again.nc"), cp.archive.read(file)
    assert made.attrs["id"] == kept.attrs["id"]
    xr.testing.assert_equal(made, kept)
    assert scene.attrs["id"] in shown.stdout


def test_histories_of_the_paper_name_functions():
    """The name that a function of the paper records is its own, by which a script calls it."""
    folder = Path(cp.__file__).parent / "paper"
    names = [
        f"cablepod.paper.{name}"
        for path in sorted(folder.glob("*.py"))
        for name in re.findall(r'\bdescribed\(\s*"([\w.]+)"', path.read_text(encoding="utf-8"))
    ]
    assert len(names) > 10
    for name in names:
        module, _, function = name.rpartition(".")
        assert inspect.isfunction(getattr(importlib.import_module(module), function)), name


def test_a_table_of_the_paper_is_made_again():
    table = table1.table1()
    assert "cp.paper.table1.table1()" in lineage.script(table)
    assert provenance.digest(again(table)) == provenance.digest(table)


@pytest.mark.parametrize("kind", ["orbit", "map", "peaks"])
def test_responses_and_peaks_are_made_again(kind, soft):
    if kind == "peaks":
        members = cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200, 240]}, members=4)
        result = cp.extremes.peaks(
            cp.chain.simulate(members, step=1e-3, times=[0.0, 0.5], outputs=("tension_extremes",))
        )
    else:
        scene = guy(damping=0.05)
        modes = cp.condensed.vibration_modes(scene, rank=1)
        grid = {"frequency": [5.0, 6.0], "amplitude": [1e-3, 2e-3]}
        result = (
            cp.periodic.orbit(scene, modes, harmonics=2)
            if kind == "orbit"
            else cp.periodic.stability_map(scene, modes, **grid)
        )
    assert provenance.digest(again(result)) == provenance.digest(result)
