"""The command of stringing tables."""

from __future__ import annotations

import pytest

import cablepod as cp
from cablepod import cli

GUY = """
title = "A guy by temperature"
[cable]
axial_stiffness = 2.0e7
mass_per_length = 1.0
top_tension = 15000.0
thermal_expansion = 1.15e-5
diameter = 0.016
breaking_strength = 1.8e5
[ends]
lower = [0.0, 0.0]
upper = [20.0, 50.0]
"""
CASES = """
[bare]
[storm.wind]
speed = 30.0
direction = [1.0, 0.0]
"""


@pytest.fixture
def guy(here):
    (here / "guy.toml").write_text(GUY)
    (here / "cases.toml").write_text(CASES)
    return here


def test_a_table_is_printed_in_kilonewtons_metres_and_hertz(guy, capsys):
    assert cli.main(["stringing", "guy.toml", "--temperatures", "-20", "20", "3"]) == 0
    first, head, *rows = capsys.readouterr().out.splitlines()
    assert first == "A guy by temperature: stringing, at rest in still air"
    assert head.split() == [
        "degC", "upper", "kN", "lower", "kN", "horizontal", "kN", "sag", "m", "length", "m", "used", "%", "first",
        "frequencies", "Hz",
    ]  # fmt: skip
    table = cp.catenary.stringing(cp.read_scene("guy.toml"), [-20.0, 0.0, 20.0])
    for k, row in enumerate(rows):
        numbers = [float(text) for text in row.split()]
        expected = [
            [-20.0, 0.0, 20.0][k], *(1e-3 * float(table[name][k]) for name in ("tension_upper", "tension_lower")),
            1e-3 * float(table["horizontal_force"][k]), float(table["sag"][k]), float(table["unstretched_length"][k]),
            100.0 * float(table["utilisation"][k]), *table["frequency"][k].values,
        ]  # fmt: skip
        assert numbers == pytest.approx(expected, rel=4e-3)  # digits of the table
    assert len(rows) == 3
    assert [path.name for path in guy.iterdir() if path.is_dir()] == []


def test_cases_files_and_figures(guy, capsys):
    arguments = ["stringing", "guy.toml", "--temperatures", "-20", "20", "2", "--cases", "cases.toml", "--out", "out"]
    assert cli.main(arguments) == 0
    said = capsys.readouterr().out
    assert [line.split()[0] for line in said.splitlines()[2:6]] == ["bare", "bare", "storm", "storm"]
    assert "across load kN" in said  # wind: the load is not vertical
    assert "horizontal" not in said
    assert said.endswith("out: stringing.nc, tension.png, sag.png\n")
    table = cp.archive.read(guy / "out" / "stringing.nc")
    assert table["case"].values.tolist() == ["bare", "storm"]
    assert {path.name for path in (guy / "out").iterdir()} == {"stringing.nc", "tension.png", "sag.png"}
    assert cli.main(arguments) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert cli.main([*arguments, "--overwrite"]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--temperatures", "20", "-20", "3"], "--temperatures: given 20 -20 3; allowed: LOW below HIGH"),
        (["--temperatures", "-20", "20", "2.5"], "--temperatures: given -20 20 2.5; allowed: LOW below HIGH"),
        (["--temperatures", "-20", "20", "1"], "allowed: LOW below HIGH, and a whole COUNT of at least 2"),
        (["--temperatures", "-400", "20", "3"], "--temperatures: given -400.0; allowed: a finite number of at least"),
        ([], "'--temperatures'"),
        (["--temperatures", "-20", "20", "2", "--cases", "none.toml"], "--cases: none.toml: cannot be read"),
        (["--temperatures", "-20", "20", "2", "--cases", "broken.toml"], "--cases: broken.toml: not a TOML file"),
        (["--temperatures", "-20", "20", "2", "--cases", "empty.toml"], "--cases: empty.toml: has no tables; allowed"),
    ],
)
def test_mistakes_are_one_line(guy, refusal, arguments, message):
    (guy / "broken.toml").write_text("[a")
    (guy / "empty.toml").write_text("")
    assert message in refusal("stringing", "guy.toml", *arguments)
