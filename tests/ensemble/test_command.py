"""The command that runs and resumes an ensemble."""

from __future__ import annotations

import csv

import numpy as np
from children import without_progress
from scenes import SOFT_TOML

import cablepod as cp
from cablepod import cli

TABLE = """
[ensemble]
members = 5
seed = 2
[ensemble.ranges]
"cable.top_tension" = [200.0, 300.0]
"ends.upper.x" = [7.0, 8.5]
"""


def test_the_command_runs_resumes_and_tells(tmp_path, capsys, described):
    scene = tmp_path / "study.toml"
    scene.write_text(SOFT_TOML.replace("links = 8", "links = 12") + TABLE)  # enough that nothing is to be said of them
    out = tmp_path / "deep" / "out"
    command = ["ensemble", str(scene), "--out", str(out), "--option", "step=4e-3", "--option", "outputs=['tension']"]
    assert cli.main(command) == 0
    said = capsys.readouterr()
    assert without_progress(said.err) == ""
    assert "done      5\n" in said.out
    run = cp.archive.open_ensemble(out)
    direct = cp.chain.simulate(cp.ensemble.design(cp.read_scene(scene)), step=4e-3, outputs=("tension",))
    np.testing.assert_array_equal(run["tension"], direct["tension"])
    written = (out / "batch_0000.nc").stat().st_mtime_ns
    assert cli.main(command) == 0
    assert (out / "batch_0000.nc").stat().st_mtime_ns == written
    told = described(out)
    for text in (
        "members   5, at most 64 in a file",
        "failed    0",
        "ends_upper_x from 7.",
        "step=0.004",
        "ensemble.design(",
    ):
        assert text in told
    assert cli.main([*command, "--option", "step=2e-3"]) == 2
    refused = capsys.readouterr().err
    assert "the option step was 0.004 and is 0.002" in refused
    assert "or --overwrite to replace it" in refused
    assert cli.main([*command, "--option", "step=2e-3", "--overwrite"]) == 0
    assert (cp.archive.open_ensemble(out)["step"] == 2e-3).all()
    (out / "batch_0000.nc").write_bytes(b"damaged")
    capsys.readouterr()
    assert cli.main([*command, "--option", "step=2e-3"]) == 2
    assert "give --overwrite to compute them again" in capsys.readouterr().err


def test_the_command_ends_with_a_map_and_the_largest_tension(tmp_path, capsys):
    scene, out = tmp_path / "study.toml", tmp_path / "out"
    ranges = '[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0, 3]\n"ends.upper.x" = [7.0, 8.5, 4]\n'
    scene.write_text(f"{SOFT_TOML}\n[ensemble]\n{ranges}")
    command = ["ensemble", str(scene), "--out", str(out), "--option", "step=4e-3", "--batch", "5"]
    assert cli.main([*command, "--option", "outputs=['tension_extremes']"]) == 0
    lines = capsys.readouterr().out.splitlines()
    lines = [line for line in lines if not line.startswith("  ")]
    assert lines[1] == f"map       {out / 'map.png'}, {out / 'map.csv'}"  # after the title
    run = cp.archive.open_ensemble(out).compute()
    peaks = run["tension_maximum"].max("link").values
    k = int(peaks.argmax())
    at = f"(cable_top_tension {run.cable_top_tension.values[k]:.5g} N, ends_upper_x {run.ends_upper_x.values[k]:.5g} m)"
    assert lines[2] == f"largest tension  {peaks[k]:.5g} N, in member {k} {at}"
    assert not any(line.startswith("history") for line in lines)
    assert (out / "map.png").read_bytes()[:4] == b"\x89PNG"
    with (out / "map.csv").open() as file:
        head, *rows = csv.reader(file)
    assert head[:4] == ["member", "cable_top_tension [N]", "ends_upper_x [m]", "largest tension [N]"]
    np.testing.assert_allclose([float(row[3]) for row in rows], peaks, rtol=1e-9)
    np.testing.assert_allclose([float(row[2]) for row in rows], run["ends_upper_x"], rtol=1e-9)
    assert cli.main([*command, "--option", "outputs=['position']", "--overwrite"]) == 0
    assert not list(out.glob("map.*"))  # of the ensemble before


#: Arguments of :func:`cablepod.ensemble.run` that are no options of a model.
OF_RUN = ("scenes", "path", "model", "modes", "scheduler", "workers", "batch", "overwrite", "progress", "options")


def test_the_command_refuses_in_one_line(tmp_path, capsys):
    scene = tmp_path / "study.toml"
    scene.write_text(SOFT_TOML)
    for extra, text in (
        ([], "ensemble: missing in"),
        (["--option", "step"], "--option: given 'step'; allowed: NAME=VALUE"),
        (["--option", "=3"], "--option: given '=3'; allowed: NAME=VALUE"),
        *((["--option", f"{name}=2"], f"option {name}: given 2; allowed: an option of model") for name in OF_RUN),
    ):
        assert cli.main(["ensemble", str(scene), "--out", str(tmp_path / "out"), *extra]) == 2
        said = capsys.readouterr()
        assert text in said.err
        assert said.err.count("\n") == 1
        scene.write_text(SOFT_TOML + TABLE)
