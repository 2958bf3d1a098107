"""``cablepod check``: the table, its notes, and what similar names the command proposes."""

from __future__ import annotations

import math
import re

import pytest
from children import without_progress
from scenes import SOFT_TOML

import cablepod as cp
from cablepod import cli
from cablepod import examples as shipped

#: Units of the table in units of the summary.
IN_SI = {
    "kN": 1e3, "MN": 1e6, "m": 1.0, "mm": 1e-3, "MPa": 1e6, "degrees": math.pi / 180.0, "%": 0.01, "N/m": 1.0, "kg/m": 1.0,
    "kg/m3": 1.0, "": 1.0,
}  # fmt: skip


#: Lines of a cable that is given by its weight and tension, and their names in a summary.
LINES = {
    "chord": "chord", "inclination of the chord": "inclination", "weight": "weight_per_length", "mass": "mass_per_length",
    "density": "density", "axial stiffness EA": "axial_stiffness", "unstretched length": "unstretched_length",
    "tension, upper end": "tension_upper", "tension, lower end": "tension_lower", "stress": "stress", "strain": "strain",
    "sag, normal to the chord": "sag", "sag over chord": "sag_over_chord", "sag, below the chord": "sag_below_chord",
    "Irvine's lambda squared": "irvine_parameter", "loads over weight": "load_over_weight",
    "motion over chord": "motion_over_chord",
}  # fmt: skip
FREQUENCIES = {"first frequencies in plane": "in_plane", "first frequencies out of plane": "out_of_plane"}


def said_of(capsys, *arguments):
    status = cli.main(list(arguments))
    said = capsys.readouterr()
    return status, said.out, without_progress(said.err)


def test_the_table_holds_the_numbers_of_the_summary(capsys):
    status, out, err = said_of(capsys, "check", "example2")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "Example 2: slow end motion"
    numbers = cp.summary(shipped.scene("example2"))
    values = {line[:34].strip(): line[34:].strip() for line in lines[1:]}
    assert set(values) == {*LINES, *FREQUENCIES, "first axial frequency", "damping", "space"}
    for text, name in LINES.items():
        value, _, unit = values[text].partition(" ")
        assert float(value) * IN_SI[unit] == pytest.approx(float(numbers[name]), rel=1e-4)  # five digits
    printed = {"inclination of the chord": "70.529 degrees", "axial stiffness EA": "20 MN", "stress": "120 MPa"}
    printed |= {"strain": "0.075 %", "sag over chord": "0.16992 %", "tension, upper end": "15 kN"}
    printed |= {"sag, normal to the chord": "103.99 mm"}
    assert {text: values[text] for text in printed} == printed
    for text, plane in FREQUENCIES.items():
        hertz, omega = values[text].split(" Hz ")
        assert [float(value) for value in hertz.split()] == pytest.approx(
            numbers[f"frequency_{plane}"].values, rel=1e-4
        )
        found = [float(value) for value in re.findall(r"[\d.]+", omega)]
        assert found == pytest.approx(numbers[f"angular_frequency_{plane}"].values, rel=1e-4)
    assert "note" not in out


@pytest.mark.parametrize(("inclination", "said"), [("0.733", "42 degrees"), ("42.0", None)])
def test_an_inclination_that_may_be_in_radians_is_told(tmp_path, capsys, inclination, said):
    path = tmp_path / "guy.toml"
    path.write_text(re.sub(r"upper = .*", f"chord = 10.0\ninclination = {inclination}", SOFT_TOML, count=1))
    status, out, _ = said_of(capsys, "check", str(path))
    found = next((line for line in out.splitlines() if "if that is in radians" in line), None)
    assert status == 0
    assert found is None if said is None else found.endswith(said)


def test_what_to_know_before_a_run_is_told(tmp_path, capsys):
    path = tmp_path / "guy.toml"
    sine = SOFT_TOML.replace("one_minus_cosine", "harmonic")
    ranges = '[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0, 3]\n"ends.upper.x" = [7.0, 8.5, 4]\n'
    path.write_text(sine + ranges)
    status, out, err = said_of(capsys, "check", str(path))
    lines = {line[:34].strip(): line[34:].strip() for line in out.splitlines()}
    assert status == 0
    assert lines["damping"].startswith("none: vibrations never decay")
    damper = '[[attachment]]\narc_length = 0.1\ndamper = 5.0\ndirection = "normal"\n'
    path.write_text(sine + damper)
    assert "none but dampers: vibrations across them never decay" in said_of(capsys, "check", str(path))[1]
    assert lines["space"].startswith("two coordinates: motion out of the plane cannot be seen")
    assert lines["ensemble"] == "12 members, grid"
    assert lines["cable.top_tension"] == "200 to 300 N, 3 values"
    assert lines["ends.upper.x"] == "7 to 8.5 m, 4 values"
    assert "motion.upper.x: starts from rest at 0.1 m/s" in err
    assert "motion.upper.x.ramp = " in err
    damped = sine.replace("angular_frequency = 2.0", "angular_frequency = 2.0\nramp = 10.0")
    damped = damped.replace("[time]", "[damping]\nmass_proportional = 0.1\n[time]").replace("0.0]", "0.0, 0.0]")
    spread = '[ensemble]\nmembers = 9\n[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0]\n'
    path.write_text(damped.replace("6.0]", "6.0, 0.0]") + spread)
    status, out, err = said_of(capsys, "check", str(path))
    lines = {line[:34].strip(): line[34:].strip() for line in out.splitlines()}
    assert (status, err) == (0, "")
    assert not {"damping", "space"} & set(lines)
    assert lines["motion.upper.x"] == "harmonic, starts by a ramp of 10 s"
    assert lines["ensemble"] == "9 members, latin hypercube"
    assert lines["cable.top_tension"] == "200 to 300 N"


def test_notes_are_no_errors(tmp_path, capsys):
    path = tmp_path / "guy.toml"
    path.write_text(SOFT_TOML.replace("density = 1000.0", "density = 1.0\nbreaking_strength = 5e4"))
    status, out, err = said_of(capsys, "check", str(path))
    assert (status, err) == (0, "")
    assert "  note: cable.density: a density of 1 kg/m3 (usual: 500 to 25000 kg/m3)" in out.splitlines()
    assert "  note: perhaps cable.density = 1000 (given in t/m3?)" in out.splitlines()
    assert re.search(r"^  utilisation at rest +0\.4 %$", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (("chek", "example2"), "check"),
        (("ensembel", "example2"), "ensemble"),
        (("check", "exmaple2"), "example2"),
        (("run", "slackcable", "--out", "x"), "slack_cable"),
        (("examples", "sagging2"), "sagging"),
        (("run", "example2", "--rank", "2"), "--ranks"),
    ],
)
@pytest.mark.usefixtures("here")
def test_similar_names_are_proposed(arguments, remedy, refusal):
    assert re.search(rf"(try: |did you mean '?|Did you mean '?){re.escape(remedy)}\b", refusal(*arguments))


def test_a_free_end_has_no_frequencies(capsys):
    status, out, _ = said_of(capsys, "check", "pendulum")
    assert status == 0
    assert re.search(r"^  first frequencies in plane +none$", out, re.MULTILINE)


def test_the_ratio_asked_for_stands_beside_those_of_dampers(tmp_path, capsys):
    path = tmp_path / "guy.toml"
    damper = '[[attachment]]\narc_length = 0.5\ndamper = 40.0\ndirection = "normal"\n'
    path.write_text(SOFT_TOML.replace("[time]", f"{damper}[damping]\nratio = 0.003\n[time]"))
    _, out, _ = said_of(capsys, "check", str(path))
    assert re.search(r"^  damping\.ratio +0\.3 % of all vibrations; dampers add to it$", out, re.MULTILINE)
    rows = re.findall(r"^  their damping ratios +(.*) % by dampers alone$", out, re.MULTILINE)
    assert len(rows) == 1
    assert max(map(float, rows[0].split())) > 0.0
