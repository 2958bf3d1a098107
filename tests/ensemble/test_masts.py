"""Ensembles of masts by the command and from Python: map, table and summary as for cables."""

from __future__ import annotations

import copy
import csv
import json
import re

import numpy as np
import pytest
from mast_scenes import SMALL, small
from scene_files import toml_of
from scenes import SOFT_TOML

import cablepod as cp
from cablepod import cli

#: Six masts.
MAST = copy.deepcopy(SMALL)
MAST["cables"]["guy"]["breaking_strength"] = 4.0e4
MAST["mast"]["load"][0].update(kind="harmonic", angular_frequency=5.0)
del MAST["mast"]["load"][0]["duration"]
MAST["ensemble"] = {"ranges": {"mast.load.1.force.x": [500.0, 1000.0, 2], "guy.1.top_tension": [4000.0, 6000.0, 3]}}
EXPONENT = 4.0


@pytest.fixture
def study(tmp_path):
    """A scene file of six masts."""
    path = tmp_path / "mast.toml"
    path.write_text(toml_of(MAST))
    return path


def table(folder):
    with (folder / "map.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_command_writes_map_table_and_summary(study, tmp_path, capsys, described):
    out = tmp_path / "out"
    command = ["ensemble", str(study), "--out", str(out), "--batch", "4"]
    assert cli.main(command) == 0
    said = capsys.readouterr().out
    scenes = cp.ensemble.design(cp.read_scene(study))
    direct = cp.mast.simulate(scenes)
    fatigue = cp.fatigue.equivalent(direct.guy_tension, exponent=EXPONENT, frequency=1.0)
    rows = table(out)
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "note"}
    of_fatigue = f"fatigue range (exponent {EXPONENT:g} at 1 Hz) [N]"
    moved = np.maximum(abs(direct.displacement_minimum), abs(direct.displacement_maximum)).max(["level", "coordinate"])
    bent = np.maximum(abs(direct.bending_moment_minimum), abs(direct.bending_moment_maximum)).max(
        ["node", "coordinate"]
    )
    wanted = {
        "guy_1_top_tension [N]": scenes.guy_1_top_tension,
        "largest tension [N]": direct.guy_tension_maximum.max("guy"),
        "smallest tension [N]": direct.guy_tension_minimum.min("guy"),
        f"largest {of_fatigue}": fatigue.max("guy"),
        "largest utilisation [1]": direct.guy_tension_maximum.max("guy") / 4e4,
        "largest displacement along x or z [m]": moved,
        "largest bending moment along x or z [N m]": bent,
    }
    for g in (1, 2, 3):
        wanted[f"guy {g} largest tension [N]"] = direct.guy_tension_maximum.sel(guy=g)
        wanted[f"guy {g} {of_fatigue}"] = fatigue.sel(guy=g)
        wanted[f"guy {g} utilisation [1]"] = direct.guy_tension_maximum.sel(guy=g) / 4e4
    for name, values in wanted.items():
        np.testing.assert_allclose(columns[name], values, rtol=1e-9, err_msg=name)  # ten digits are printed
    assert {row["note"] for row in rows} == {""}
    assert f"map       {out / 'map.png'}, {out / 'map.csv'}" in said
    assert (out / "map.png").read_bytes()[:4] == b"\x89PNG"
    for text, values, unit, size in (
        ("largest tension", direct.guy_tension_maximum, "kN", 1e3),
        ("largest fatigue range", fatigue, r"kN \(exponent 4 at 1 Hz\)", 1e3),
        ("largest utilisation", direct.guy_tension_maximum / 400.0, "%", 1.0),
    ):
        found = re.search(rf"^{text}  (\S+) {unit}, in member (\d+), guy (\d) \(guy_1_top_tension", said, re.MULTILINE)
        member, guy = int(found[2]), int(found[3])
        assert size * float(found[1]) == pytest.approx(float(values.max()), rel=1e-4)
        assert float(values.sel(member=member, guy=guy)) == float(values.max())
    # the same command goes on: nothing is computed again; info tells the same peaks
    written = (out / "batch_0000.nc").stat().st_mtime_ns
    assert cli.main(command) == 0
    assert (out / "batch_0000.nc").stat().st_mtime_ns == written
    assert "largest fatigue range  " in described(out)
    assert cli.main(["check", str(study)]) == 0
    assert re.search(r"ensemble +6 members, grid", capsys.readouterr().out)


def test_results_in_python_have_fatigue_ranges_within_the_window(tmp_path):
    scenes = cp.ensemble.design(small(), {"guy.1.top_tension": [4500.0, 5500.0, 3]})
    runs = cp.ensemble.run(scenes, tmp_path / "it", model="mast", batch=2, step=0.02, window=(1.0, 3.0)).compute()
    direct = cp.mast.simulate(scenes, step=0.02, window=(1.0, 3.0))
    wanted = cp.fatigue.equivalent(direct.guy_tension.sel(time=slice(1.0, 3.0)), exponent=EXPONENT)
    assert runs.fatigue_range.dims == ("member", "guy")
    np.testing.assert_array_equal(runs.fatigue_range, wanted)
    assert (runs.fatigue_range.attrs["units"], runs.fatigue_range.attrs["exponent"]) == ("N", EXPONENT)
    ax = cp.plots.parameter_map(runs.assign_coords(number=("member", [1.0, 2.0, 3.0])), "fatigue_range",
                                x="guy_1_top_tension", y="number")  # fmt: skip
    drawn = ax.collections[0].get_array()
    np.testing.assert_array_equal(np.sort(drawn), np.sort(runs.fatigue_range.max("guy")))


def test_a_model_of_another_kind_of_scene_is_refused_by_key(study, tmp_path, capsys):
    cable = tmp_path / "cable.toml"
    cable.write_text(SOFT_TOML + '[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0, 2]\n')
    others = '"chain", "cable", "rigid", "condensed", "galerkin"'
    for path, model, text in (
        (study, "chain", 'model: given "chain" for a scene with [mast]; allowed: "mast"'),
        (study, "condensed", 'model: given "condensed" for a scene with [mast]; allowed: "mast"'),
        (cable, "mast", f'model: given "mast" for a scene of one cable, without [mast]; allowed: {others}'),
    ):
        assert cli.main(["ensemble", str(path), "--out", str(tmp_path / "out"), "--model", model]) == 2
        assert capsys.readouterr().err == f"cablepod: {text}\n"
        modes = {"modes": cp.condensed.vibration_modes(cp.read_scene(cable), rank=2)} if model == "condensed" else {}
        with pytest.raises(cp.SceneError, match=f"^{re.escape(text)}$"):
            cp.ensemble.run(cp.ensemble.design(cp.read_scene(path)), tmp_path / "out", model=model, **modes)
    assert not (tmp_path / "out").exists()


def test_modes_of_the_guys_serve_an_ensemble(tmp_path):
    single = {**SMALL["cables"]["guy"], "top_tension": 5000.0}
    guy = cp.make_scene({"cable": single, "ends": {"lower": [20.0, 0.0], "upper": [0.0, 28.0]}})
    modes = cp.condensed.vibration_modes(guy, rank=3, links=20)
    scenes = cp.ensemble.design(small(), {"guy.1.top_tension": [4500.0, 5500.0, 2]})
    runs = cp.ensemble.run(scenes, tmp_path / "it", model="mast", modes=modes, step=0.02).compute()
    np.testing.assert_array_equal(runs.guy_tension, cp.mast.simulate(scenes, modes, step=0.02).guy_tension)
    assert json.loads((tmp_path / "it" / "manifest.json").read_text())["modes"].split()[0] == modes.attrs["id"]


def test_failed_and_slack_masts_are_told_in_the_table(tmp_path):
    mast = copy.deepcopy(MAST)
    mast["mast"]["damping_ratio"] = 0.05
    ranges = {"mast.load.1.force.x": [1000.0, 5000.0, 1e9]}
    mast["ensemble"] = {"members": 3, "sampling": "list", "ranges": ranges}
    (tmp_path / "mast.toml").write_text(toml_of(mast))
    command = ["ensemble", str(tmp_path / "mast.toml"), "--out", str(tmp_path / "it"), "--option", "step=0.02"]
    cli.main(command)
    rows = table(tmp_path / "it")
    assert [row["note"].split(":")[0] for row in rows] == ["", "slack at times", "failed"]
    assert rows[2]["largest tension [N]"] == rows[2]["guy 1 utilisation [1]"] == "nan"


def test_a_mast_without_guys_has_a_table_too(tmp_path, capsys):
    mast = {name: copy.deepcopy(value) for name, value in MAST.items() if name not in ("cables", "guy")}
    mast["mast"]["base"] = "clamped"
    mast["mast"]["load"][0]["force"] = [100.0, 0.0, 40.0]
    mast["ensemble"] = {"ranges": {"mast.load.1.force.x": [100.0, 200.0, 2], "mast.mass": [20.0, 30.0, 2]}}
    (tmp_path / "mast.toml").write_text(toml_of(mast))
    option = ["--option", "outputs=['displacement', 'extremes']"]
    assert cli.main(["ensemble", str(tmp_path / "mast.toml"), "--out", str(tmp_path / "it"), *option]) == 0
    assert "map.csv; no picture of tensions: the mast has no guys\n" in capsys.readouterr().out
    moved = [float(row["largest displacement along x or z [m]"]) for row in table(tmp_path / "it")]
    largest = float(abs(cp.archive.open_ensemble(tmp_path / "it").displacement_maximum).max())
    assert max(moved) == pytest.approx(largest, rel=1e-9)  # ten digits are printed
