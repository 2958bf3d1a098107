"""A mast in what scenes of one cable have: studies, ensembles on disk, lineage, plots."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from mast_scenes import SMALL, small, small_tables, windy
from printed import printed
from scene_files import toml_of

import cablepod as cp
from cablepod import cli, lineage
from cablepod.errors import ArchiveError


def test_a_study_has_the_numbers_of_its_parts(tmp_path):
    scene = small()
    study = cp.study.run(scene, tmp_path / "out")
    assert list(study.children) == ["scene", "rest", "frequencies", "motion", "guys"]
    motion, guys = study["motion"].to_dataset(), study["guys"].to_dataset()
    run = cp.mast.simulate(scene)
    for name in ("guy_tension_std", "guy_tension_maximum", "guy_tension_minimum"):
        np.testing.assert_array_equal(guys[name], run[name])
    np.testing.assert_array_equal(guys["fatigue_range"], cp.fatigue.equivalent(run.guy_tension))
    np.testing.assert_array_equal(guys["guy_tension_rest"], cp.mast.rest(scene).guy_tension)
    assert motion.attrs["error_estimate"] > 0.0
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert files == {
        *(f"{name}.nc" for name in study.children), "tensions.png", "moments.png", "modes.png"
    }  # fmt: skip
    assert cp.archive.read(tmp_path / "out" / "guys.nc").fatigue_range.equals(guys.fatigue_range)
    with pytest.raises(ArchiveError, match=r"^out: "):
        cp.study.run(scene, tmp_path / "out")


def test_a_run_that_stops_keeps_its_partial_result(tmp_path):
    def huge(mapping):
        mapping["mast"]["load"][0]["force"] = [1e9, 0.0, 0.0]

    with pytest.raises(cp.RunStopped) as stopped:
        cp.study.run(small(huge), tmp_path)
    kept = cp.archive.read(tmp_path / "motion_incomplete.nc")
    assert "stopped at" in kept.attrs["incomplete"]
    np.testing.assert_array_equal(kept.displacement, stopped.value.partial.displacement)
    assert {path.stem for path in tmp_path.iterdir()} == {"scene", "rest", "frequencies", "motion_incomplete"}


def test_a_turned_mast_has_the_same_numbers(tmp_path, capsys):
    def answers(angle):
        along = [float(np.cos(angle)), 0.0, float(np.sin(angle))]

        def turn(mapping):
            windy(mapping)
            mapping["wind"] = {**mapping["wind"], "direction": along}
            mapping["guy"] = [{**guy, "direction": [-x for x in along]} for guy in mapping["guy"]]

        path = tmp_path / "mast.toml"
        path.write_text(toml_of(small_tables(turn)))
        assert cli.main(["run", str(path), "--out", str(tmp_path / f"{angle:g}"), "--json"]) == 0
        return json.loads(capsys.readouterr().out)["answers"]

    one, other = answers(0.0), answers(np.pi / 4.0)
    for name in one:
        if name.startswith("largest_"):
            assert other[name] == pytest.approx(one[name], rel=1e-6), name


def test_rows_of_guys_say_how_much_of_their_strength_is_used_and_when_they_break(tmp_path):
    def change(mapping):
        mapping["cables"]["strong"] = {**mapping["cables"]["guy"], "breaking_strength": 5e4}
        guy = mapping["guy"][0]
        mapping["guy"] = [{**guy, "level": 20.0}, {**guy, "cable": "strong", "breaks": 2.0, "breaks_number": 2}]

    tables = small_tables(change)
    rows = printed(tmp_path, tables, "run").split("  used\n")[1].split("\n")[:6]
    guys = json.loads(printed(tmp_path, tables, "run", "--json"))["guys"]
    assert [guy["utilisation"] is None for guy in guys] == [True] * 3 + [False] * 3
    assert [guy.get("breaks") for guy in guys] == [None] * 4 + [2.0, None]
    for row, guy in zip(rows, guys, strict=True):
        used = "-"
        if guy["utilisation"] is not None:
            assert guy["utilisation"] == pytest.approx(guy["peak"] / 5e4)
            used = f"{100.0 * guy['utilisation']:.1f} %"
        assert row.endswith(f" {used}  breaks at 2 s" if "breaks" in guy else f" {used}")


def test_a_mast_without_guys_is_studied(tmp_path, capsys):
    def alone(mapping):
        del mapping["guy"], mapping["cables"], mapping["chain"]
        mapping["mast"]["base"] = "clamped"

    tables = small_tables(alone)
    path, out = tmp_path / "mast.toml", tmp_path / "out"
    path.write_text(toml_of(tables))
    assert cli.main(["run", str(path), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["guys"] == []
    assert {file.name for file in out.iterdir()} == {
        "scene.nc", "rest.nc", "frequencies.nc", "motion.nc", "moments.png", "modes.png"
    }  # fmt: skip
    ranges = {"mast.mass": [15.0, 20.0, 2], "mast.drag_area": [0.2, 0.3, 2]}
    path.write_text(toml_of({**tables, "ensemble": {"ranges": ranges}}))
    assert cli.main(["ensemble", str(path), "--out", str(tmp_path / "masts")]) == 0
    assert "no picture of tensions: the mast has no guys" in capsys.readouterr().out


def test_an_ensemble_on_disk_goes_on_where_it_was(tmp_path):
    members = cp.ensemble.design(small(), {"guy.1.top_tension": [4500.0, 5500.0]}, members=3, sampling="grid")
    kept = cp.ensemble.run(members, tmp_path / "masts", model="mast", step=0.02)
    again = cp.ensemble.run(members, tmp_path / "masts", model="mast", step=0.02)
    opened = cp.archive.open_ensemble(tmp_path / "masts")
    both = cp.mast.simulate(members, step=0.02)
    for result in (kept, again, opened):
        np.testing.assert_array_equal(result.guy_tension_maximum, both.guy_tension_maximum)
        np.testing.assert_array_equal(result.guy_1_top_tension, [4500.0, 5000.0, 5500.0])


@pytest.mark.parametrize("given", [False, True])
def test_a_script_makes_a_run_again_bit_by_bit(given):
    scene = small(windy)
    options = {"wind": cp.wind.field(scene, seed=5)} if given else {}
    run = cp.mast.simulate(scene, rank=4, outputs=("guy_tension", "extremes"), **options)
    body, last = lineage.script(run).rsplit("cp.archive.write(", 1)
    made: dict = {}
    exec(compile(body, "lineage", "exec"), made)
    repeated = made[last.split(",")[0]]
    assert repeated.attrs["id"] == run.attrs["id"]
    np.testing.assert_array_equal(repeated.guy_tension, run.guy_tension)


def test_spectra_of_tensions_are_drawn():
    run = cp.mast.simulate(small())
    ax = cp.plots.spectra(run.guy_tension.isel(guy=0), run.displacement.isel(level=-1, coordinate=0), segments=2)
    assert len(ax.lines) >= 2


def test_buckling_after_a_break_is_told(tmp_path):
    def breaking(mapping, levels):
        mapping["guy"] = [{**mapping["guy"][0], "count": 4, "level": level} for level in levels]
        mapping["guy"][0].update(breaks=1.0, breaks_number=2)

    for levels, falls in (((28.0, 15.0), False), ((28.0,), True)):
        tables = small_tables(lambda mapping, levels=levels: breaking(mapping, levels))
        rest = cp.mast.rest(cp.make_scene(tables))
        factor = float(rest.buckling_factor_after_break)
        assert np.isnan(factor) == falls
        (line,) = [line for line in printed(tmp_path, tables).splitlines() if "without guys that break" in line]
        assert line.endswith("none: the mast falls" if falls else f" {factor:.4g}")
        assert not 0.95 * float(rest.buckling_factor) < factor
    assert "buckling_factor_after_break" not in cp.mast.rest(small())
    assert "without guys" not in printed(tmp_path, SMALL)


def without_time(mapping):
    del mapping["time"]


def stale_ratios(mapping):
    """A guy that breaks, with damping by ratios, which chains lack."""
    mapping["damping"] = {"ratio": 0.01}
    mapping["guy"][0].update(breaks=2.0, breaks_number=1)


@pytest.mark.parametrize(
    ("change", "key"), [(without_time, r"^time"), (stale_ratios, r"^damping\.ratio: given 0\.01; ")]
)
def test_a_refused_mast_leaves_no_file(tmp_path, change, key):
    with pytest.raises(cp.SceneError, match=key):
        cp.study.run(small(change), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_ratios_with_a_guy_that_breaks_are_noted_and_refused_with_a_remedy_of_the_scene(tmp_path):
    tables = small_tables(lambda mapping: (windy(mapping), stale_ratios(mapping)))
    scene, note = (
        cp.make_scene(tables),
        "damping.ratio: refused by run and design, whose guys are chains with guy.1.breaks",
    )
    assert note in printed(tmp_path, tables)
    remedy = r"^damping\.ratio: given 0\.01; allowed: none with guys \"chain\"; try: damping\.mass_proportional"
    with pytest.raises(cp.SceneError, match=remedy):
        cp.study.run(scene)
    with pytest.raises(cp.SceneError, match=remedy):  # not RunStopped, after the storms
        cp.study.design(scene, directions=[0.0], speeds=[10.0], storms=1)
    assert "damping" not in printed(tmp_path, small_tables(windy))


def printed_numbers(line):
    """Numbers of a printed line in SI units, by the word after them or before."""
    factors = {"N": 1.0, "kN": 1e3, "MN": 1e6}
    return [float(number) * factors[unit] for number, unit in re.findall(r"([\d.]+) ([kM]?N)\b", line)]


def test_shear_and_reactions_are_printed(tmp_path):
    lines = printed(tmp_path, small_tables(windy), "run").splitlines()
    (shear,), (forces,) = ([line for line in lines if word in line] for word in (" shear ", "force on the foundation"))
    names = ("shear_force", "foot_force", "anchor_force", "axial_compression")
    run = cp.mast.simulate(small(windy), outputs=names)
    sizes = np.sqrt((run.shear_force**2).sum("coordinate")).max(["time", "end"])
    (largest,) = printed_numbers(shear)
    assert largest == pytest.approx(float(sizes.max()), rel=1e-3)  # four digits
    bottom = float(run.element_bottom[int(sizes.values.argmax())])
    assert f" between {bottom:g} and " in shear
    horizontal = np.hypot(run.foot_force.sel(coordinate="x"), run.foot_force.sel(coordinate="z")).max()
    anchors = np.sqrt((run.anchor_force**2).sum("coordinate")).max("time")
    expected = [run.axial_compression[:, 0].max(), horizontal, anchors.max()]
    np.testing.assert_allclose(printed_numbers(forces), expected, rtol=1e-3)
    assert f"on the anchor of guy {int(anchors.values.argmax()) + 1} " in forces
    found = json.loads(printed(tmp_path, small_tables(windy), "run", "--json"))["answers"]
    assert found["largest_foot_force_downwards"] == pytest.approx(float(expected[0]), rel=1e-12)
    assert not any(line.startswith("note:") for line in lines)


def test_statistics_around_a_break_are_noted_with_the_call_for_those_after_it(tmp_path):
    def change(mapping):
        windy(mapping)
        del mapping["mast"]["drag_area"]
        mapping["guy"].append({**mapping["guy"][0], "level": 15.0, "breaks": 2.0, "breaks_number": 2})

    scene = small(change)
    lines = printed(tmp_path, small_tables(change), "run").splitlines()
    (note,) = [line for line in lines if line.startswith("note:")]
    assert "before and after the break at 2 s" in note
    after = eval(note.rsplit("the part after it: ", 1)[1], {"cp": cp, "scene": scene})
    assert float(after.guy_tension_maximum.isel(guy=4)) == 0.0  # it is broken from the start of the window on
    motion = cp.archive.read(tmp_path / "out" / "motion.nc")
    assert float(motion.guy_tension_maximum.isel(guy=4)) > 1000.0
    step = after.attrs["step"]
    times = step * np.arange(after.attrs["number_of_steps"] + 1)
    every = cp.mast.simulate(scene, guys=after.attrs["guys"], times=times, step=step, outputs=("guy_tension",))
    late = every.guy_tension.isel(time=slice(round(2.0 / step), None))
    np.testing.assert_allclose(after.guy_tension_mean, late.mean("time"), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("towards", ["x", "z"])
def test_bending_moments_are_drawn_in_the_direction_in_which_the_mast_bends_most(towards):
    def change(mapping):
        force = [1000.0, 0.0, 100.0] if towards == "x" else [100.0, 0.0, 1000.0]
        mapping["mast"]["load"] = [{"level": 15.0, "force": force}]

    rest, run = cp.mast.rest(small(change)), cp.mast.simulate(small(change), outputs=("bending_moment", "extremes"))
    for result in (rest, run):
        assert f"along {towards} " in cp.plots.bending_moments(result).get_xlabel().replace("\n", " ")
    assert "along z " in cp.plots.bending_moments(run, component="z").get_xlabel().replace("\n", " ")
