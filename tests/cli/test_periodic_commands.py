"""Commands of periodic responses: files, tables, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from children import run_python, without_progress
from periodic_scenes import GUY
from scene_files import toml_of

import cablepod as cp
from cablepod import cli

MOTION = {"kind": "harmonic", "amplitude": 0.003, "angular_frequency": 12.5}


def guy_with(ends_motion=None, **tables):
    """The guy of the periodic tests as a file, with tables of its own."""
    motion = {"upper": {"x": MOTION} | (ends_motion or {})}
    return toml_of({**GUY, "motion": motion, "damping": {"mass_proportional": 0.05}, "chain": {"links": 20}} | tables)


@pytest.fixture
def guy(tmp_path):
    path = tmp_path / "guy.toml"
    path.write_text(guy_with())
    return str(path)


def test_respond_writes_branches_and_prints_bifurcations(guy, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["respond", guy, "--out", str(out), "--frequency", "1.9", "2.1", "--hertz", "--rank", "2"]
    assert cli.main(arguments) == 0
    said = capsys.readouterr().out
    response = cp.archive.read(out / "frequency_response.nc")
    assert response.angular_frequency.values.min() == pytest.approx(2.0 * np.pi * 1.9)
    assert response.angular_frequency.values.max() == pytest.approx(2.0 * np.pi * 2.1)
    assert response.stable.dtype == bool
    for k in range(response.sizes["bifurcation"]):
        assert f"{float(response.bifurcation_angular_frequency[k]) / (2.0 * np.pi):.8g}" in said
    assert {path.name for path in out.iterdir()} == {
        "frequency_response.nc", "frequency_response.png", "modes.nc", "multipliers.png", "tension.png",
    }  # fmt: skip
    assert cli.main(arguments) == 2
    assert "overwrite" in capsys.readouterr().err
    assert cli.main([*arguments, "--overwrite"]) == 0


@pytest.mark.parametrize(("options", "said"), [([], "given in Hz? then --hertz"), (["--hertz"], "")])
def test_frequencies_that_hold_the_forcing_as_hertz_alone_are_noted(guy, tmp_path, capsys, options, said):
    arguments = ["respond", guy, "--out", str(tmp_path / "out"), "--frequency", "1.98", "2.0", "--rank", "1"]
    assert cli.main([*arguments, *options]) == 0
    found = without_progress(capsys.readouterr().err)
    assert said in found if said else not found


@pytest.mark.parametrize("amplitude", ["0.006", "6"])
def test_amplitudes_that_may_be_in_millimetres_are_noted(guy, tmp_path, capsys, amplitude):
    arguments = [
        "tongues",
        guy,
        "--out",
        str(tmp_path / "out"),
        "--frequency",
        "12.0",
        "13.0",
        "--rank",
        "1",
        "--points",
        "2",
    ]
    assert cli.main([*arguments, "--amplitude", amplitude]) == 0
    found = without_progress(capsys.readouterr().err)
    assert ("given in mm? then 0.006" in found) == (amplitude == "6")


def test_ramps_are_left_out_with_a_note(guy, tmp_path, capsys):
    def response(path, name):
        arguments = ["respond", str(path), "--out", str(tmp_path / name), "--frequency", "12.4", "12.6", "--rank", "1"]
        assert cli.main(arguments) == 0
        return cp.archive.read(tmp_path / name / "frequency_response.nc"), without_progress(capsys.readouterr().err)

    plain, said = response(guy, "plain")
    assert said == ""
    for number, tables in enumerate(({}, {"ensemble": {"ranges": {"motion.upper.x.ramp": [1, 2, 3]}}})):
        path = tmp_path / "ramped.toml"
        path.write_text(guy_with({"x": {**MOTION, "ramp": 3.0}}, **tables))
        without, said = response(path, f"ramped{number}")
        assert said == "cablepod: note: left out: motion.upper.x.ramp, as a periodic response has no start\n"
        assert without.attrs["id"] == plain.attrs["id"]


def test_nothing_is_written_for_forcing_that_is_refused(tmp_path, capsys):
    path = tmp_path / "two.toml"
    path.write_text(guy_with({"y": {"kind": "harmonic", "amplitude": 0.01, "angular_frequency": 3.0}}))
    for command, more in (("respond", []), ("tongues", ["--amplitude", "0.1"])):
        arguments = [command, str(path), "--out", str(tmp_path / "out"), "--frequency", "1", "2", *more]
        assert cli.main(arguments) == 2
        assert "motion.upper.y.angular_frequency: given 3.0" in capsys.readouterr().err
        assert not (tmp_path / "out").exists()


def test_missing_damping_is_told_before_the_run_and_not_again(tmp_path, capsys, monkeypatch):
    path = tmp_path / "undamped.toml"
    path.write_text(guy_with(damping={}))
    before, respond = [], cp.periodic.frequency_response

    def look_first(*given, **options):
        before.append(capsys.readouterr().err)
        return respond(*given, **options)

    monkeypatch.setattr(cp.periodic, "frequency_response", look_first)
    cli.main(["respond", str(path), "--out", str(tmp_path / "out"), "--frequency", "12.4", "12.6", "--rank", "1"])
    assert "damping is zero" in before[0]
    assert "damping is zero" not in capsys.readouterr().err


def test_tongues_writes_a_map_with_given_modes(guy, tmp_path, capsys):
    modes = tmp_path / "modes.nc"
    assert cli.main(["modes", guy, "--out", str(modes), "--layout", "vibration", "--rank", "2"]) == 0
    out = tmp_path / "out"
    arguments = ["tongues", guy, "--out", str(out), "--frequency", "12", "13", "--amplitude", "0.01", "--points", "8"]
    assert cli.main([*arguments, "--modes", str(modes)]) == 0
    found = cp.archive.read(out / "stability_map.nc")
    assert found.sizes["amplitude"] == found.sizes["angular_frequency"] == 8
    assert float(found.amplitude[-1]) == pytest.approx(0.01)
    said = capsys.readouterr().out
    assert "period doubling" in said
    assert f"{found.sizes['edge']} edges" in said


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["respond", "GUY", "--frequency", "8", "4"], "frequency: given"),
        (["respond", "GUY"], "'--frequency'"),
        (["tongues", "GUY", "--frequency", "4", "8", "--amplitude", "0"], "--amplitude: given 0.0"),
        (["tongues", "GUY", "--frequency", "8", "4", "--amplitude", "0.1"], "--frequency: given 8 4"),
        (["tongues", "GUY", "--frequency", "4", "8", "--amplitude", "0.1", "--points", "1"], "--points: given 1"),
        (["tongues", "GUY", "--frequency", "4", "8", "--amplitude", "0.1", "--points", "9999999"], "--points: given 9"),
    ],
)
def test_refusals_are_one_line(arguments, match, guy, tmp_path, refusal):
    given = [guy if text == "GUY" else text for text in arguments]
    assert match in refusal(*given, "--out", tmp_path / "out")


#: Arguments of the commands, the file of the result, and what its table says of the rest.
INTERRUPTED = {
    "respond": (["--frequency", "11", "14", "--rank", "2"], "frequency_response.nc", "interrupted"),
    "tongues": (
        ["--frequency", "12", "13", "--amplitude", "0.01", "--points", "40", "--rank", "2"],
        "stability_map.nc",
        "not computed",
    ),
}


@pytest.mark.parametrize("command", INTERRUPTED)
def test_ctrl_c_leaves_what_was_computed(command, guy, tmp_path, capsys, monkeypatch):
    def press(fraction):
        if fraction > 0.2:
            raise KeyboardInterrupt

    name = {"respond": "frequency_response", "tongues": "stability_map"}[command]
    compute = getattr(cp.periodic, name)
    monkeypatch.setattr(cp.periodic, name, lambda *given, **options: compute(*given, **{**options, "progress": press}))
    arguments, name, said = INTERRUPTED[command]
    out = tmp_path / "out"
    assert cli.main([command, guy, "--out", str(out), *arguments]) == 130
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert "was interrupted after" in told.err
    assert said in told.out
    kept = cp.archive.read(out / name)
    assert kept.attrs["incomplete"] == 1
    assert len(list(out.iterdir())) > 3  # figures too
    # beside an older one, which remains
    old = {path: path.read_bytes() for path in out.iterdir()}
    assert cli.main([command, guy, "--out", str(out), *arguments, "--overwrite"]) == 130
    beside = out / name.replace(".nc", "_incomplete.nc")
    assert set(out.iterdir()) == {*old, beside}
    assert all(path.read_bytes() == content for path, content in old.items())
    assert cp.archive.read(beside).attrs["incomplete"] == 1


#: The command, which sends itself the signal while it works.
PRESSES = """
import os, signal, sys
from cablepod import periodic
from cablepod.__main__ import main

def press(fraction):
    if fraction > 0.0:
        os.kill(os.getpid(), signal.{number})

def pressed(compute):
    return lambda *given, **options: compute(*given, **{{**options, "progress": press}})

periodic.frequency_response, periodic.stability_map = pressed(periodic.frequency_response), pressed(periodic.stability_map)
sys.argv = ["cablepod", *{arguments!r}]
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("command", INTERRUPTED)
@pytest.mark.usefixtures("ctrl_c")
def test_a_signal_leaves_what_was_computed(command, number, guy, tmp_path):
    arguments, name, said = INTERRUPTED[command]
    out = tmp_path / "out"
    more = ["--points", "150"] if command == "tongues" else []  # two seconds of work
    code = PRESSES.format(number=number, arguments=[command, guy, "--out", str(out), *arguments, *more])
    done = run_python("-c", code, timeout=120)
    assert done.returncode == {"SIGINT": 130, "SIGTERM": 143}[number]
    assert done.stderr.count("\n") == 1
    assert said in done.stdout
    assert cp.archive.read(out / name).attrs["incomplete"] == 1
