"""Commands of periodic responses: files, tables, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import cablepod as cp
from cablepod import cli

GUY = """
title = "a guy"
[cable]
youngs_modulus = 1.6e11
area = 1.25e-4
specific_weight = 78500.0
top_tension = 15000.0
[ends]
lower = [0.0, 0.0]
upper = [20.4, 57.7]
[motion.upper.x]
kind = "harmonic"
amplitude = 0.003
angular_frequency = 12.5
[damping]
mass_proportional = 0.05
[chain]
links = 20
"""


@pytest.fixture
def guy(tmp_path):
    path = tmp_path / "guy.toml"
    path.write_text(GUY)
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
        "frequency_response.nc", "frequency_response.png", "modes.nc", "multipliers.png",
    }  # fmt: skip
    assert cli.main(arguments) == 2
    assert "overwrite" in capsys.readouterr().err
    assert cli.main([*arguments, "--overwrite"]) == 0


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
    ],
)
def test_refusals_are_one_line(arguments, match, guy, tmp_path, capsys):
    given = [guy if text == "GUY" else text for text in arguments]
    assert cli.main([*given, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("cablepod: ")
    assert said.count("\n") == 1
    assert match in said
