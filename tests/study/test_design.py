"""Storms of all directions and speeds on a mast or a guy: symmetry, resuming, reference values, mistakes."""

from __future__ import annotations

import copy
import csv
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr
from mast_scenes import SMALL, WIND, small
from scene_files import toml_of

import cablepod as cp
from cablepod import cli, lineage
from cablepod.cli._design import text
from cablepod.study import _design
from cablepod.study._design_numbers import CABLE, joined
from cablepod.study._design_tables import write_tables

PI = np.pi
#: An S-N curve: exponent, range at two million cycles [Pa].
CURVE = {"slope": 4.0, "reference_range": 1.5e8}
GUY = {
    "title": "one guy",
    "cable": {
        "youngs_modulus": 1.6e11, "area": 3.8e-5, "density": 8000.0, "diameter": 0.008, "top_tension": 5000.0,
        "breaking_strength": 4.0e4,
    },
    "ends": {"lower": [20.0, 0.0, 0.0], "upper": [0.0, 28.0, 0.0]}, "damping": {"mass_proportional": 0.1}, "wind": WIND,
    "time": {"duration": 4.0, "interval": 0.1}, "chain": {"links": 20},
}  # fmt: skip


def windy(mapping):
    mapping["wind"] = WIND
    mapping["mast"]["drag_area"] = 0.3
    del mapping["mast"]["load"]
    mapping["time"] = {"duration": 6.0, "interval": 0.05}
    mapping["cables"]["guy"]["breaking_strength"] = 4.0e4


def steady(mapping):
    windy(mapping)
    mapping["wind"] = {key: value for key, value in WIND.items() if key != "turbulence"}


def table_of(path):
    """The rows of a table on disk."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def table():
    """Three directions, a third of a turn apart, on three equal guys."""
    return cp.study.design(
        small(windy), directions=[0.4, 0.4 + 2 * PI / 3, 0.4 + 4 * PI / 3], speeds=[12.0, 20.0], storms=3, **CURVE,
        shares=[0.1, 0.01],
    )  # fmt: skip


def test_a_wind_turned_by_a_third_gives_the_turned_table(table):
    for name in (
        "guy_tension_peak",
        "utilisation",
        "anchor_force_peak",
        "anchor_uplift_peak",
        "damage",
        "slack_storms",
    ):
        values = table[name].transpose("direction", ..., "guy").values
        for third in (1, 2):  # guys stand at 0, 120, 240 degrees
            turned = np.roll(values[0], third, axis=-1)
            np.testing.assert_allclose(values[third], turned, rtol=1e-6, err_msg=name)
        assert np.ptp(values[0], axis=-1).max() > 1e-3 * abs(values[0]).max() or name == "slack_storms"
    for name in ("displacement_peak", "bending_moment_peak", "shear_force_peak", "axial_compression_peak"):
        values = table[name].transpose("direction", ...).values
        np.testing.assert_allclose(
            values, np.broadcast_to(values[0], values.shape), rtol=1e-6, atol=1e-9 * values.max()
        )
    np.testing.assert_allclose(table.governing_speed, 20.0)
    assert sorted(table.governing_direction.values.tolist()) == table.direction.values.tolist()


def test_each_storm_is_that_of_the_mast_alone(table):
    def alone(mapping):
        windy(mapping)
        angle = 0.4 + 2 * PI / 3
        mapping["wind"] = {
            **WIND, "speed": 12.0, "direction": [np.cos(angle), 0.0, np.sin(angle)],
            "turbulence": {**WIND["turbulence"], "seed": 4},
        }  # fmt: skip

    run = cp.mast.simulate(small(alone), outputs=("guy_tension", "extremes", "envelopes"))
    own = table.isel(direction=1, speed=0).sel(storm=4)
    for name in ("guy_tension_maximum", "bending_moment_largest", "anchor_force_maximum", "foot_force_maximum"):
        np.testing.assert_allclose(own[name], run[name], rtol=1e-6, atol=1e-9 * float(abs(run[name]).max()))
    stress = (run.guy_tension / 3.8e-5).assign_attrs(units="Pa")
    np.testing.assert_allclose(own.damage, cp.fatigue.damage(stress, **CURVE), rtol=1e-5)


def test_peaks_are_those_of_the_storms_and_shares_make_a_year(table):
    found = cp.extremes.peaks(table.guy_tension_maximum, dim="storm", level=0.9)
    for statistic, name in (
        ("mean", "peak"),
        ("mean_low", "peak_low"),
        ("mean_high", "peak_high"),
        ("quantile", "quantile"),
    ):
        np.testing.assert_allclose(table[f"guy_tension_{name}"], found[statistic], rtol=1e-12)
    np.testing.assert_allclose(table.guy_tension_peak, table.guy_tension_maximum.mean("storm"), rtol=0.05)
    np.testing.assert_allclose(table.utilisation, table.guy_tension_peak / 4.0e4, rtol=1e-12)
    assert float(table.share.sum()) == pytest.approx(0.11)
    weights = xr.DataArray([0.1 / 3, 0.01 / 3], dims="speed")
    year = (table.damage.mean("storm") * weights).sum(("direction", "speed")) * 365.25 * 86400.0 / 6.0
    np.testing.assert_allclose(table.damage_per_year, year, rtol=1e-12)
    np.testing.assert_allclose(table.fatigue_life * table.damage_per_year, 1.0, rtol=1e-12)
    for name, variable in table.variables.items():
        assert {"units", "long_name"} <= set(variable.attrs), name


def test_steady_wind_gives_the_forces_of_rest():
    scene = small(steady)
    table = cp.study.design(scene, directions=[0.0], speeds=[20.0], storms=1)
    rest = cp.mast.rest(scene)
    own = table.isel(direction=0, speed=0)
    np.testing.assert_allclose(own.guy_tension_peak, rest.guy_tension, rtol=1e-3)  # four modes of the guys
    size = np.sqrt((rest.bending_moment**2).sum("coordinate"))
    np.testing.assert_allclose(own.bending_moment_peak, size, atol=1e-6 * float(size.max()))
    assert float(own.foot_force_horizontal_peak) == pytest.approx(float(abs(rest.foot_force[0])), rel=1e-6)
    assert float(own.foot_force_vertical_peak) == pytest.approx(-float(rest.foot_force[1]), rel=1e-6)
    assert float(own.buckling_factor) == float(rest.buckling_factor)
    assert "guy_tension_peak_low" not in table  # one storm has no scatter


def broken(mapping):
    """Four guys, of which the second breaks after three seconds, and a lower level."""
    windy(mapping)
    mapping["guy"][0].update(count=4, breaks=3.0, breaks_number=2)
    mapping["guy"].append({**mapping["guy"][0], "level": 15.0, "count": 3})
    for key in ("breaks", "breaks_number"):
        del mapping["guy"][1][key]


def test_a_guy_that_breaks_is_named_and_not_slack(tmp_path):
    table = cp.study.design(small(broken), directions=[0.0], speeds=[15.0, 20.0], storms=3, out=tmp_path / "broken")
    assert table.guy_breaks.values.tolist() == [np.inf, 3.0, *[np.inf] * 5]
    assert float(table.guy_tension_minimum.sel(guy=2).max()) == 0.0
    np.testing.assert_array_equal(table.slack_storms.sel(guy=2), 0)  # its tension was above 3 kN until it broke
    assert float(table.guy_axial_force_minimum.sel(guy=2).min()) > 3e3
    without = small(lambda mapping: (broken(mapping), mapping["guy"].pop(0), mapping["guy"].extend(three(mapping))))
    for s, speed in enumerate((15.0, 20.0)):
        alone = cp.mast.rest(without.assign(wind_speed=without.wind_speed.copy(data=speed)))
        assert float(table.buckling_factor_after_break[0, s]) == pytest.approx(float(alone.buckling_factor), rel=1e-9)
    assert float(abs(table.buckling_factor_after_break / table.buckling_factor - 1.0).min()) > 0.1
    printed = text(table)
    assert "broken guys: guy 2 at 28 m towards 90 deg at 3 s" in printed
    assert "guy 2" not in printed.split("slack guys: ")[1].splitlines()[0]
    rows = table_of(tmp_path / "broken" / "guys.csv")
    assert [row["breaks [s]"] for row in rows] == ["nan", "3", *["nan"] * 5]
    page = cp.plots.report({"design": table}, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "broken: guy 2 at 3 s" in page
    assert "slack at times" not in page or "guy 2" not in page.split("slack at times")[1].split("<")[0]


def three(mapping):
    """The guys of the upper level that do not break, one by one."""
    own = {**mapping["guy"][0], "level": 28.0}
    for key in ("radius", "count", "direction"):
        del own[key]
    return [{**own, "anchor": anchor} for anchor in ([20.0, 0.0, 0.0], [-20.0, 0.0, 0.0], [0.0, 0.0, -20.0])]


def test_envelopes_have_the_intervals_of_peaks(table, tmp_path):
    for number, name in (
        ("bending_moment_largest", "bending_moment"), ("shear_force_largest", "shear_force"),
        ("axial_compression_maximum", "axial_compression"),
    ):  # fmt: skip
        found = cp.extremes.peaks(table[number], dim="storm", level=0.9)
        for statistic, ending in (("mean", "peak"), ("mean_low", "peak_low"), ("quantile_high", "quantile_high")):
            np.testing.assert_allclose(table[f"{name}_{ending}"], found[statistic], rtol=1e-12)
    write_tables(tmp_path, table)
    row = table_of(tmp_path / "heights.csv")[3]
    case = table.shear_force_peak[..., 3].argmax(("direction", "speed"))
    for heading, name in (("", "peak"), (" low", "peak_low"), (" quantile high", "quantile_high")):
        assert float(row[f"shear{heading} [N]"]) == pytest.approx(
            float(table[f"shear_force_{name}"][..., 3].isel(case)), rel=1e-9
        )
    moments = table.bending_moment_peak.max(("direction", "speed"))
    assert float(row["bending moment [N m]"]) == pytest.approx(float(moments[3:5].max()), rel=1e-9)
    assert (
        float(row["bending moment low [N m]"])
        < float(row["bending moment [N m]"])
        < float(row["bending moment high [N m]"])
    )


def test_a_window_leaves_out_the_start():
    scene = small(windy)
    options = {"directions": [0.0], "speeds": [20.0], "storms": 2, "shares": [1.0], **CURVE}
    part = cp.study.design(scene, **options, window=(2.0, 6.0))
    whole = cp.study.design(scene, **options)
    run = cp.mast.simulate(scene.assign(wind_speed=scene.wind_speed), window=(2.0, 6.0))
    np.testing.assert_allclose(part.guy_tension_maximum[0, 0, 0], run.guy_tension_maximum, rtol=1e-9)
    stress = (run.guy_tension.sel(time=slice(2.0, 6.0)) / 3.8e-5).assign_attrs(units="Pa")
    np.testing.assert_allclose(part.damage[0, 0, 0], cp.fatigue.damage(stress, **CURVE), rtol=1e-9)
    assert float(abs(part.damage_per_year / whole.damage_per_year - 1.0).max()) > 1e-3


def test_one_guy_has_its_ends(tmp_path):
    table = cp.study.design(
        cp.make_scene(GUY), directions=[0.0, PI / 2], speeds=[15.0, 25.0], storms=2, shares=[0.1, 0.01], **CURVE,
        out=tmp_path / "guy",
    )  # fmt: skip
    assert table.tension_peak.dims == ("direction", "speed", "end")
    assert float((table.tension_peak.sel(end="upper") - table.tension_peak.sel(end="lower")).min()) > 0.0
    rows = table_of(tmp_path / "guy" / "guys.csv")
    assert [row["end"] for row in rows] == ["lower", "upper"]
    assert float(rows[1]["peak [N]"]) == pytest.approx(float(table.tension_peak.sel(end="upper").max()), rel=1e-9)
    assert "tension at the ends [kN]" in text(table)
    planar = {**GUY, "ends": {"lower": [20.0, 0.0], "upper": [0.0, 28.0]}, "wind": {**WIND, "direction": [1.0, 0.0]}}
    both = cp.study.design(cp.make_scene(planar), directions=[0.0, PI], speeds=[20.0], storms=1)
    assert float(both.tension_peak[0].max()) != float(both.tension_peak[1].max())
    with pytest.raises(cp.SceneError, match=r"^directions: given 1\.57.*planar"):
        cp.study.design(cp.make_scene(planar), directions=[PI / 2], speeds=[20.0], storms=1)


def test_each_storm_stands_at_its_direction_speed_and_seed(monkeypatch):
    """Runs of single scenes, with nothing kept of other storms; storms of a mean wind come in two parts."""
    monkeypatch.setattr(_design, "STORMS_TOGETHER", 2)
    angles, speeds, scene = [0.0, 1.0], [10.0, 20.0], small(windy)
    table = cp.study.design(scene, directions=angles, speeds=speeds, storms=3)
    for d, s, k in ((0, 0, 0), (0, 1, 2), (1, 0, 1), (1, 1, 2)):
        cp.clear_caches()

        def one(mapping, d=d, s=s, k=k):
            windy(mapping)
            direction = [np.cos(angles[d]), 0.0, np.sin(angles[d])]
            turbulence = {**WIND["turbulence"], "seed": int(table.storm[k])}
            mapping["wind"] = {**WIND, "speed": speeds[s], "direction": direction, "turbulence": turbulence}

        run = cp.mast.simulate(small(one), outputs=("guy_tension", "extremes", "envelopes"))
        for name in ("guy_tension_maximum", "displacement_largest", "axial_compression_maximum"):
            np.testing.assert_allclose(table[name].values[d, s, k], run[name].values, rtol=1e-9)


def test_the_folder_has_the_table_of_memory_and_goes_on(tmp_path):
    scene, options = small(windy), {"directions": [0.0, 1.0], "speeds": [20.0], "storms": 2}
    table = cp.study.design(scene, **options)
    done: list[float] = []
    written = cp.study.design(scene, **options, out=tmp_path / "a", progress=done.append)
    xr.testing.assert_allclose(table, written, rtol=1e-12)
    assert done[-1] == 1.0
    assert table.attrs["id"] == written.attrs["id"]
    names = ["cases.csv", "design.nc", "foot.csv", "guys.csv", "heights.csv", "levels.csv", "storms"]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == names
    (tmp_path / "a" / "storms" / "batch_0000.nc").unlink()
    (tmp_path / "a" / "design.nc").unlink()
    again = cp.study.design(scene, **options, out=tmp_path / "a")
    xr.testing.assert_identical(again, written)
    xr.testing.assert_allclose(cp.archive.read(tmp_path / "a" / "design.nc"), written, rtol=1e-12)
    with pytest.raises(cp.ArchiveError, match="another"):
        cp.study.design(scene, **{**options, "speeds": [21.0]}, out=tmp_path / "a")


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"directions": []}, "directions"), ({"speeds": []}, "speeds"), ({"directions": 0.0}, "directions"),
        ({"directions": [0.0, np.nan]}, r"directions\[1\]"), ({"speeds": [np.inf]}, r"speeds\[0\]"),
        ({"speeds": [0.0]}, r"speeds\[0\]"), ({"speeds": [20.0, 20.0]}, "speeds"),
        ({"directions": [0.0, 2 * PI]}, "directions"), ({"directions": np.zeros((2, 2))}, r"directions\[0\]"),
        ({"storms": 0}, "storms"), ({"storms": -1}, "storms"), ({"storms": 2.0}, "storms"), ({"storms": True}, "storms"),
        ({"storms": np.nan}, "storms"), ({"level": 1.0}, "level"), ({"slope": 4.0}, "slope"), ({"shares": [0.1]}, "slope"),
        ({"shares": [0.5, 0.6], **CURVE}, "shares"), ({"shares": [1.1], **CURVE}, "shares"),
        ({"shares": [-0.1], **CURVE}, "shares"), ({"shares": [np.nan], **CURVE}, "shares"),
        ({"shares": ["a"], **CURVE}, "shares"), ({"shares": [0.1], "slope": 0.0, "reference_range": 1e8}, "slope"),
        ({"window": (3.0, 2.0)}, "window"), ({"window": (1.0, 7.0)}, "window"), ({"window": 3.0}, "window"), ({"out": ""}, "out"),
    ],
)  # fmt: skip
def test_mistakes_name_their_key(changes, key):
    options = {"directions": [0.0], "speeds": [20.0], "storms": 2, **changes}
    with pytest.raises((cp.SceneError, cp.ArchiveError), match=rf"^{key}: "):
        cp.study.design(small(windy), **options)


def test_scenes_without_wind_time_or_turbulence_are_refused():
    options = {"directions": [0.0], "speeds": [20.0], "storms": 2}
    with pytest.raises(cp.SceneError, match=r"^wind: missing"):
        cp.study.design(small(), **{**options, "speeds": []})  # as the command gives without --speeds
    with pytest.raises(cp.SceneError, match=r"^storms: given 2; allowed: 1 without wind.turbulence"):
        cp.study.design(small(steady), **options)
    with pytest.raises(cp.SceneError, match=r"^time: missing"):
        cp.study.design(small(lambda mapping: (windy(mapping), mapping.pop("time"))), **options)
    scenes = cp.ensemble.design(small(windy), {"wind.speed": [10.0, 20.0]}, members=2)
    with pytest.raises(cp.SceneError, match=r"^scene: given several members"):
        cp.study.design(scenes, **options)


def test_a_damage_by_stress_needs_areas():
    def stiff(mapping):
        windy(mapping)
        cable = mapping["cables"]["guy"]
        mapping["cables"]["guy"] = {
            "axial_stiffness": cable["youngs_modulus"] * cable["area"], "mass_per_length": cable["density"] * cable["area"],
            "diameter": cable["diameter"],
        }  # fmt: skip

    options = {"directions": [0.0], "speeds": [20.0], "storms": 1}
    with pytest.raises(cp.SceneError, match=r"^reference_range: .*; allowed: cables.guy.area \[m2\]"):
        cp.study.design(small(stiff), **options, shares=[0.1], **CURVE)
    table = cp.study.design(small(stiff), **options)
    np.testing.assert_allclose(
        table.guy_tension_peak, cp.study.design(small(windy), **options).guy_tension_peak, rtol=1e-9
    )


def test_a_lineage_script_makes_the_table_again(tmp_path, table):
    cp.archive.write(table, tmp_path / "table.nc")
    script = lineage.script(cp.archive.read(tmp_path / "table.nc"))
    assert "cannot be made again" not in script
    assert "cp.study.design(" in script


def test_failed_storms_are_nan_and_counted():
    def soft(mapping):  # the mast buckles or finds no rest in the strong wind alone
        windy(mapping)
        mapping["mast"]["drag_area"] = 30.0

    with pytest.warns(cp.MemberFailedWarning, match="^2 of 4 members failed") as caught:
        table = cp.study.design(small(soft), directions=[0.0], speeds=[1.0, 60.0], storms=2)
    assert sum(warning.category is cp.MemberFailedWarning for warning in caught) == 1  # not of their rest again
    assert (table.failure != "").sum("storm").values.tolist() == [[0, 2]]
    assert np.isfinite(table.guy_tension_peak[0, 0]).all()
    assert np.isnan(table.guy_tension_peak[0, 1]).all()
    np.testing.assert_allclose(table.governing_speed, 1.0)
    assert "failed" in text(table)


def test_anchors_are_known_where_the_first_storms_fail():
    def soft(mapping):
        windy(mapping)
        mapping["mast"]["drag_area"] = 30.0

    with pytest.warns(cp.MemberFailedWarning, match="^2 of 6 members failed"):
        table = cp.study.design(small(soft), directions=[0.0], speeds=[60.0, 1.0, 2.0], storms=2)
    np.testing.assert_array_equal(table.anchor, cp.mast.rest(small(windy)).anchor)
    assert "nan" not in text(table)


def test_parts_whose_storms_all_failed_are_joined_as_nan():
    ok = xr.Dataset({"tension_maximum": (("member", "end"), [[1.0, 2.0]]), "failure": ("member", ["slack"])})
    bad = xr.Dataset({"failure": ("member", ["no rest", "no rest"])})
    whole = joined([bad, ok], CABLE)
    np.testing.assert_array_equal(whole.tension_maximum, [[np.nan, np.nan], [np.nan, np.nan], [1.0, 2.0]])
    assert whole.failure.values.tolist() == ["no rest", "no rest", "slack"]
    with pytest.raises(cp.RunStopped, match=r"^all storms failed, the first: no rest"):
        joined([bad], CABLE)


def mast_file(path, duration=20.0):
    """Write the windy mast as the file of a command."""
    mapping = copy.deepcopy(SMALL)
    windy(mapping)
    mapping["time"]["duration"] = duration
    path.write_text(toml_of(mapping))
    return path


@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        ("0,360", "angles [deg], each once in a full turn: 360 is 0"), ("-90,270", "angles [deg], each once in a full turn"),
        ("90", "a number of directions, 1 to 72, or angles [deg] with commas between; try: 90, for this angle alone"),
        ("0,nan", "finite angles [deg] with commas between"), (",", "finite angles [deg] with commas between"),
    ],
)  # fmt: skip
def test_the_command_refuses_directions_in_degrees(tmp_path, capsys, given, allowed):
    path = mast_file(tmp_path / "mast.toml")
    assert cli.main(["design", str(path), "--out", str(tmp_path / "out"), "--directions", given]) == 2
    said = capsys.readouterr().err
    assert f"--directions: given '{given}'; allowed: {allowed}" in said
    assert "rad" not in said
    assert "storms" not in said  # none is announced


def test_the_command_refuses_directions_out_of_the_plane_in_degrees(tmp_path, capsys):
    cable = {"strand": "EHS 1/2 in", "diameter": 0.0127, "top_tension": 15000.0}
    guy = {"cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [20.0, 50.0]}}
    path = tmp_path / "guy.toml"
    wind, time_of = {"speed": 20.0, "direction": [1.0, 0.0]}, {"duration": 5.0, "interval": 0.5}
    path.write_text(toml_of({**guy, "wind": wind, "time": time_of}))
    for given in ("90,", "3"):
        assert cli.main(["design", str(path), "--out", str(tmp_path / "out"), "--directions", given]) == 2
        assert f"--directions: given '{given}'; allowed: 0 and 180 [deg] in a planar scene" in capsys.readouterr().err


def test_the_command_prints_tables_and_names_guys(tmp_path, capsys):
    path = mast_file(tmp_path / "mast.toml")
    out = tmp_path / "out"
    arguments = ["design", str(path), "--out", str(out), "--directions", "0,60", "--speeds", "15,28", "--storms", "3"]
    assert cli.main([*arguments, "--shares", "0.1,0.01", "--slope", "4", "--reference-range", "150"]) == 0
    said = capsys.readouterr()
    assert "cablepod: note: 2 directions x 2 speeds x 3 storms = 12 storms\n" in said.err
    printed = said.out
    for part in (
        "2 directions, 2 speeds, 3 storms of each",
        "quantile: what a storm does not exceed with a probability of 78 %",
        "tension of the guys [kN]",
        "120 deg",
        "(-10, 0, 17.32)",
        "envelopes of the mast",
        "damage/year",
        "buckling",
        "slack guys",
    ):
        assert part in printed
    result = cp.archive.read(out / "design.nc")
    first = next(line for line in printed.splitlines() if line.split()[:2] == ["1", "28"])
    assert f"{float(result.guy_tension_peak.max(('direction', 'speed'))[0]) / 1e3:.2f}" in first.split()
    rows = table_of(out / "guys.csv")
    assert float(rows[2]["towards [deg]"]) == pytest.approx(240.0)
    assert float(rows[0]["damage in a year [1]"]) == pytest.approx(float(result.damage_per_year[0]), rel=1e-9)
    assert len(table_of(out / "cases.csv")) == 4
    for wrong, key in (
        (["--directions", "x"], "--directions"),
        (["--speeds", "a,b"], "--speeds"),
        (["--storms", "0"], "storms"),
        (["--directions", ""], "--directions"),
        (["--directions", "90"], "--directions"),
        (["--speeds", ""], "--speeds"),
        (["--speeds", ","], "--speeds"),
    ):
        assert cli.main([*arguments, *wrong, "--overwrite"]) == 2
        assert capsys.readouterr().err.startswith(f"cablepod: {key}: given")


@pytest.mark.slow
def test_a_killed_command_goes_on_to_the_same_table(tmp_path):
    path = mast_file(tmp_path / "mast.toml", 300.0)

    def arguments(out):
        return [
            sys.executable, "-m", "cablepod", "design", str(path), "--out", str(out), "--directions", "6", "--storms", "6",
        ]  # fmt: skip

    whole = subprocess.run(arguments(tmp_path / "whole"), capture_output=True, text=True, check=True).stdout
    with subprocess.Popen(
        arguments(tmp_path / "killed"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as child:
        end = time.monotonic() + 300.0
        while not list((tmp_path / "killed").glob("storms/batch_*.nc")) and time.monotonic() < end:
            time.sleep(0.02)
        child.send_signal(signal.SIGKILL)
    done = len(list((tmp_path / "killed" / "storms").glob("batch_*.nc")))
    assert 0 < done < 9
    assert not (tmp_path / "killed" / "design.nc").exists()
    again = subprocess.run(arguments(tmp_path / "killed"), capture_output=True, text=True, check=True).stdout
    assert again.splitlines()[:-1] == whole.splitlines()[:-1]  # the last line names the folder
    for name in ("guys.csv", "heights.csv", "cases.csv", "foot.csv", "levels.csv"):
        assert (tmp_path / "killed" / name).read_text() == (tmp_path / "whole" / name).read_text()


@pytest.mark.parametrize(
    "attachment",
    [{"distance_from_lower": 1.5, "damper": 400.0, "direction": "normal"}, {"distance_from_upper": 8.0, "mass": 6.0}],
    ids=["damper", "insulator"],
)
def test_one_guy_with_an_attachment_has_the_tensions_of_its_chain(attachment):
    scene = cp.make_scene({**GUY, "attachment": [attachment], "damping": {"ratio": 0.01}})
    table = cp.study.design(scene, directions=[0.0], speeds=[WIND["speed"]], storms=1)
    run = cp.chain.simulate(scene, links=80, outputs=("tension_extremes",))
    ends = [float(run.tension_maximum[0]), float(run.tension_maximum[-1])]
    own = table.tension_peak.isel(direction=0, speed=0)
    np.testing.assert_allclose(own, ends, rtol=1e-3)  # eight modes; without the insulator 2e-2
