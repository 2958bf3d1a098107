"""The command that runs and resumes an ensemble."""

from __future__ import annotations

import numpy as np
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
    refused = capsys.readouterr().err
    assert "the option step was 0.004 and is 0.002" in refused
    assert "or --overwrite to replace it" in refused
    assert cli.main([*command, "--option", "step=2e-3", "--overwrite"]) == 0
    assert (cp.archive.open_ensemble(out)["step"] == 2e-3).all()
    (out / "batch_0000.nc").write_bytes(b"damaged")
    capsys.readouterr()
    assert cli.main([*command, "--option", "step=2e-3"]) == 2
    assert "give --overwrite to compute them again" in capsys.readouterr().err


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
