"""The command as a user meets it: what it writes, what it says, and what it refuses."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from children import call, finish, python, without_progress
from children import environment as environment_of_children
from scenes import SOFT_TOML
from suite import slow

import cablepod as cp
from cablepod import cli
from cablepod import examples as shipped


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """The folder of a run with two ranks, not to be changed, and what the command said on stdout and stderr."""
    folder = tmp_path_factory.mktemp("job")
    (folder / "small.toml").write_text(SOFT_TOML)
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        arguments = ["run", str(folder / "small.toml"), "--out", str(folder / "deep" / "out"), "--ranks", "1,2"]
        assert cli.main(arguments) == 0
    return folder / "deep" / "out", out.getvalue(), err.getvalue()


def test_the_main_job(job, scene_file):
    out, said, told = job
    assert without_progress(told) == ""
    names = {path.name for path in out.iterdir()}
    data = {
        "scene", "summary", "catenary", "chain_rest", "chain", "chain_half", "modes", "normal_modes", "comparison", "chains",
    }  # fmt: skip
    data |= {f"{model}_r{r}" for model in ("condensed", "galerkin") for r in (1, 2)}
    figures = {"tension", "tension_map", "deflection", "error_over_time", "modes", "singular_values", "shapes"}
    assert names == {f"{name}.nc" for name in data} | {f"{name}.png" for name in figures}
    assert all(f"{name}.nc" in said for name in data)
    assert "over all time steps; output times between steps do not count" in said
    assert "in the wind" not in said
    comparison = cp.archive.read(out / "comparison.nc")
    for model in ("condensed", "galerkin"):
        worst = float(comparison.error_max.sel(model=model, rank=2))
        row = next(line for line in said.splitlines() if line.startswith(f"{model}, r = 2 "))
        assert f"{100 * worst:.3g} %" in row
    # what is archived is what the functions give
    scene = cp.read_scene(scene_file)
    chain = cp.archive.read(out / "chain.nc")
    given = json.loads(chain.attrs["history_json"])[-1]["parameters"]
    again = cp.chain.simulate(scene, times=chain.time.values, tolerance=given["tolerance"], outputs=given["outputs"])
    np.testing.assert_array_equal(chain.position, again.position)
    assert chain.attrs["id"] == again.attrs["id"]
    reduced = cp.galerkin.simulate(scene, cp.archive.read(out / "modes.nc"), rank=2, times=chain.time.values)
    assert cp.archive.read(out / "galerkin_r2.nc").attrs["id"] == reduced.attrs["id"]


def test_info_tells_what_a_file_is(scene_file, tmp_path, capsys):
    cp.archive.write(cp.chain.rest(cp.read_scene(scene_file)), tmp_path / "rest.nc")
    assert cli.main(["info", str(tmp_path / "rest.nc")]) == 0
    said = capsys.readouterr().out
    assert "a small guy: chain at rest" in said
    assert "make_scene" in said
    assert cli.main(["info", str(tmp_path)]) == 0
    assert capsys.readouterr().out == said


@pytest.mark.parametrize("options", [[], ["--lineage"]])
def test_info_takes_edited_files_on_demand(tmp_path, capsys, options):
    path = cp.archive.write(cp.catenary.rest(shipped.scene("example2")), tmp_path / "rest.nc")
    with netCDF4.Dataset(path, "r+") as file:
        file.title = "Mine"
    assert cli.main(["info", *options, str(path)]) == 2
    assert "attribute title; " in (said := capsys.readouterr().err)
    assert "--no-verify" in said
    assert cli.main(["info", "--no-verify", *options, str(path)]) == 0
    assert "Mine" in capsys.readouterr().out


def test_results_are_overwritten_when_asked_and_json_has_the_numbers_of_the_files(job, scene_file, tmp_path, capsys):
    out = shutil.copytree(job[0], tmp_path / "out")
    arguments = ["run", str(scene_file), "--out", str(out), "--ranks", "1"]
    before = (out / "chain.nc").read_bytes()
    assert cli.main(arguments) == 2
    assert "allowed: another folder, or --overwrite" in capsys.readouterr().err
    assert (out / "chain.nc").read_bytes() == before
    assert cli.main([*arguments, "--json", "--overwrite"]) == 0
    content = json.loads(capsys.readouterr().out)
    table = cp.archive.read(out / "comparison.nc")
    for row in (row for row in content["models"] if row["model"] != "chain"):
        own = table.sel(model=row["model"], rank=row["rank"])
        for name in ("error_max", "error_rms", "error_estimate", "call_time", "loop_time", "step"):
            assert row[name] == float(own[name])
    assert content["models"][-1]["links"] == 8
    assert content["left_out"] == []


def test_what_is_left_out_is_told(scene_file, tmp_path, capsys):
    """A model that refuses the scene on stdout, warnings as notes of one line on stderr."""
    load = "[[point_load]]\narc_length = 0.5\nforce = [0.0, -10.0]\n"
    scene_file.write_text(f"{SOFT_TOML}{load}[damping]\nlink_viscosity = 1e-4\n")
    assert cli.main(["run", str(scene_file), "--out", str(tmp_path / "out"), "--ranks", "1"]) == 0
    said = capsys.readouterr()
    assert "left out: galerkin: damping.link_viscosity: given 0.0001; allowed: none" in said.out
    assert "left out: condensed: damping.link_viscosity" in said.out
    assert (
        without_progress(said.err)
        == "cablepod: note: catenary.rest leaves out the point loads of the scene; use chain.rest to include them\n"
    )


def test_the_folder_has_a_default_and_notes_are_told_once(scene_file, here, capsys):
    """Of ranks above the number of modes, and the worst one of the scene."""
    scene_file.write_text(SOFT_TOML.replace("amplitude = -0.05", "amplitude = -0.6"))
    assert cli.main(["run", str(scene_file), "--ranks", "1,9"]) == 0
    said, out = capsys.readouterr(), Path("out", "small")
    assert (out / "comparison.nc").exists()
    assert f"{out}: " in said.out
    assert "cablepod: note: ranks: [9] left out, only 7 modes; use smaller ranks" in said.err
    assert said.err.count("cablepod: note: motion.upper.x: the scene has a displacement over the chord of 0.12") == 1
    assert not (out / "galerkin_r9.nc").exists()


def test_shipped_scenes_are_found_by_name(here, scenes):
    assert shipped.scene_path("example2").samefile(scenes / "example2.toml")
    assert shipped.scene_path("data/scenes/example2.toml").samefile(scenes / "example2.toml")
    (here / "example2").mkdir()  # what --out example2 leaves does not hide the scene
    assert shipped.scene_path("example2").samefile(scenes / "example2.toml")
    own = here / "example2.toml"
    own.write_text("")
    assert shipped.scene_path("example2.toml").samefile(own)
    assert shipped.scene("example2").attrs["title"].startswith("Example 2")
    for name in ("elsewhere/example2.toml", "exmaple2"):
        with pytest.raises(
            cp.SceneError, match=f"scene: given '{name}'; allowed: .* shipped scenes: .*example1, example2, "
        ):
            shipped.scene_path(name)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (("area = 1.0e-3", "area = -1.0"), "cable.area: given -1.0; allowed: a finite number above 0"),
        (("area = 1.0e-3", ""), "cable.area: missing"),
        (("links = 8", "links = 1000000000000"), "GB of output; allowed"),
        (("interval = 0.5", "interval = 0.0"), "time.interval: given 0.0"),
        (("top_tension = 200.0", "top_tension = 20.0"), "cable.top_tension: given 20.0; allowed: at least"),
        (("upper = [8.0, 6.0]", 'upper = [8.0, 6.0]\nfree = "upper"'), "no motion of the end that ends.free names"),
        (("[time]", "[tiem]"), "tiem: unknown key or table"),
        ((SOFT_TOML, ""), "the scene file is empty"),
    ],
)
def test_bad_scenes_end_with_one_line_and_nothing_written(scene_file, tmp_path, refusal, change, match):
    scene_file.write_text(SOFT_TOML.replace(*change))
    assert match in refusal("run", scene_file, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_refusal_is_the_status_of_the_process(scene_file, tmp_path):
    scene_file.write_text(SOFT_TOML.replace("area = 1.0e-3", "area = -1.0"))
    done = call("run", scene_file, "--out", tmp_path / "out")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1


def test_other_bad_input_ends_with_one_line(scene_file, tmp_path, refusal):
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "foreign.nc").write_bytes(b"CDF\x01 not really")
    for arguments in (
        ("run", tmp_path / "missing.toml", "--out", tmp_path / "out"),
        ("run", scene_file, "--out", tmp_path / "file"),
        ("run", scene_file, "--out", tmp_path / "file" / "below"),
        ("run", scene_file, "--out", "/proc/cablepod"),
        ("run", scene_file, "--out", tmp_path / "out", "--ranks", "two"),
        ("run", scene_file, "--out", tmp_path / "out", "--ranks", "0"),
        ("info", tmp_path / "foreign.nc"),
        ("info", tmp_path / "nothing.nc"),
    ):
        refusal(*arguments)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ([], "missing command; try: cablepod --help"),
        (["bogus"], "try: cablepod --help"),
        (["run"], "'SCENE.toml'; try: cablepod run --help"),
        (["paper"], "'--out'; try: cablepod paper --help"),
        (["run", "example2", "--out"], "'--out' requires an argument; try: cablepod run --help"),
        (["run", "example2", "--out", "x", "--bogus"], "--bogus"),
        (["ensemble", "example2", "--out", "x", "--workers", "two"], "'two' is not a valid integer"),
        (["examples", "example2", "whip"], "try: cablepod examples --help"),
        (["run", "example2", "--out", "x", "--ranks", "30,21"], "--ranks: given [21, 30]; allowed: one or more of at most 20"),
    ],
)  # fmt: skip
def test_wrong_arguments_end_with_one_line(arguments, match, here, refusal):
    assert match in refusal(*arguments)
    assert not list(here.iterdir())


def test_help_and_version_end_with_status_0(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"cablepod {cp.__version__}\n"
    assert cli.main(["-h"]) == 0
    assert "simulate one scene: rest, chain, modes" in capsys.readouterr().out


def test_ctrl_c_has_a_status_of_its_own(scene_file, tmp_path, capsys, monkeypatch):
    def press(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(cp.chain, "simulate", press)
    assert cli.main(["run", str(scene_file), "--out", str(tmp_path / "out")]) == 130
    said = capsys.readouterr().err
    assert said == "cablepod: interrupted; every file that was written is whole, --overwrite begins anew\n"


@pytest.mark.parametrize("layout", ["normal", "separate", "vibration"])
def test_modes_are_those_of_the_functions(scene_file, tmp_path, capsys, layout):
    out = tmp_path / "modes.nc"
    assert cli.main(["modes", str(scene_file), "--out", str(out), "--layout", layout, "--rank", "3"]) == 0
    assert capsys.readouterr().out.startswith(f"{out}: 3 modes, ")
    scene = cp.read_scene(scene_file)
    if layout == "vibration":
        modes = cp.condensed.vibration_modes(scene, rank=3)
    else:
        run = cp.chain.simulate(scene, tolerance=1e-6, outputs=("position",))
        modes = cp.pod.decompose(run, rank=3, layout=layout)
    np.testing.assert_array_equal(cp.archive.read(out).mode_shape, modes.mode_shape)
    assert cli.main(["modes", str(scene_file), "--out", str(out)]) == 2  # nothing is overwritten
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["modes", "--rank", "0"], "rank: given 0"),
        (["ensemble", "--model", "galerkin", "--option", "stepp=1"], "option stepp: given 1"),
        (["ensemble", "--model", "galerkin"], "--out: given "),
    ],
)
def test_mistakes_are_told_before_modes_are_made(arguments, match, scene_file, refusal, monkeypatch):
    monkeypatch.setattr(cp.chain, "simulate", None)  # it would not be callable
    scene_file.write_text(SOFT_TOML + '[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0, 2]\n')
    out = scene_file.parent / "modes.nc" if arguments[0] == "modes" else scene_file  # which is no folder
    assert match in refusal(arguments[0], scene_file, "--out", out, *arguments[1:])


def test_an_ensemble_makes_its_modes_and_goes_on_with_them(scene_file, tmp_path, capsys):
    ranges = '[ensemble]\nmembers = 5\nseed = 1\n[ensemble.ranges]\n"cable.top_tension" = [190.0, 210.0]\n'
    scene_file.write_text(SOFT_TOML + ranges)
    out = tmp_path / "map"
    arguments = ["ensemble", str(scene_file), "--out", str(out), "--model", "condensed", "--batch", "2"]
    arguments += ["--option", "step=0.01", "--option", "rank=4"]
    assert cli.main(arguments) == 0
    assert "modes: 7 of layout normal" in capsys.readouterr().out
    assert len(list(out.glob("batch_*.nc"))) == 3
    whole = cp.archive.open_ensemble(out).position.values
    (out / "batch_0001.nc").unlink()
    assert cli.main(arguments) == 0
    assert "modes: " not in capsys.readouterr().out
    np.testing.assert_array_equal(cp.archive.open_ensemble(out).position, whole)


@pytest.mark.parametrize("arguments", [["examples"], ["--help"], slow(["run", "--help"])])
def test_a_closed_pipe_ends_without_a_word(arguments):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-u", "-m", "cablepod", *arguments], stdout=writer, stderr=subprocess.PIPE, text=True
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("cablepod e", {"plain,ensemble", "plain,examples"}),
        ("cablepod run double", {"file,double", "plain,double_pendulum"}),
        ("cablepod ensemble double", {"file,double", "plain,double_pendulum"}),
        ("cablepod examples double", {"plain,double_pendulum"}),
        ("cablepod run --ov", {"plain,--overwrite"}),
        ("cablepod run example2 --out o", {"dir,o"}),
        ("cablepod ensemble s.toml --model con", {"plain,condensed"}),
        ("cablepod info out", {"file,out"}),
    ],
)
def test_the_shell_completes(words, offered, monkeypatch, capsys):
    variables = {"_CABLEPOD_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    said = capsys.readouterr()
    assert (ended.value.code, said.err) == (0, "")
    assert set(said.out.split()) == offered


def test_the_shell_is_told_how_to_complete():
    done = call(env={**environment_of_children(), "_CABLEPOD_COMPLETE": "bash_source"})
    assert done.returncode == 0
    assert "complete -o nosort -F _cablepod_completion cablepod" in done.stdout


def test_a_stopped_run_keeps_what_it_had(scene_file, any_load, tmp_path, capsys):
    load = f'[load]\nuniform = [1.0, 0.0]\nkind = "polynomial"\ncoefficients = {[0.0] * 29 + [1e3]}\n'
    scene_file.write_text(f"{SOFT_TOML}\n{load}")
    assert cli.main(["run", str(scene_file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert "left the finite numbers at" in said.err
    kept = cp.archive.read(tmp_path / "out" / "chain_incomplete.nc")
    assert "stopped at" in kept.attrs["incomplete"]
    assert np.isfinite(kept.position).all()
    assert not (tmp_path / "out" / "chain.nc").exists()


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_leaves_whole_files_only(scene_file, tmp_path, ctrl_c, sign):
    # long enough to be met while it works
    scene_file.write_text(SOFT_TOML.replace("duration = 4.0", "duration = 20000.0").replace("links = 8", "links = 60"))
    out = tmp_path / "out"
    process = python("-m", "cablepod", "run", scene_file, "--out", out)
    for _ in range(600):
        if (out / "chain_rest.nc").exists():
            break
        time.sleep(0.05)
    time.sleep(0.5)
    os.kill(process.pid, sign)
    _, err = finish(process, timeout=60)
    assert process.returncode != 0
    for path in out.glob("[!.]*"):
        assert cp.archive.read(path).attrs["id"]
    if sign == signal.SIGINT:
        assert err.strip().splitlines()[-1].startswith("cablepod: interrupted")
        assert "Traceback" not in err
        assert not list(out.glob(".*"))
