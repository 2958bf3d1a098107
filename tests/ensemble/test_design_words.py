"""Ensembles in which words, lists of numbers, records and keys vary that their scene lacks."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import xarray as xr
from histories import run_script
from mast_scenes import small, windy
from scene_files import toml_of
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp
from cablepod import cli, lineage

SPECTRUM, DECAY = "wind.turbulence.spectrum", "wind.turbulence.decay"
SHORT = {**GUY, "time": {"duration": 1.0, "interval": 0.5}, "chain": {"links": 6}}
WINDY = {**SHORT, "wind": {**KAIMAL, "ground": -1.0}}
RANGES = {SPECTRUM: ["kaimal", "davenport"], DECAY: [[10.0, 16.0], [8.0, 12.0]], "wind.speed": [10.0, 20.0, 2]}
STEP = {"step": 1e-3, "outputs": ("position", "tension_extremes")}


def design(scene, ranges, **options):
    """Make the scenes of an ensemble."""
    return cp.ensemble.design(cp.make_scene(scene), ranges, **options)


def test_words_and_lists_make_a_grid_and_are_sampled_in_equal_parts():
    scenes = design(WINDY, {SPECTRUM: ["kaimal", "davenport"], "wind.speed": [10, 20, 2], DECAY: [[10, 16], [8, 12]]})
    assert scenes["wind_turbulence_spectrum"].values.tolist() == ["kaimal", "davenport"] * 4
    assert scenes["wind_turbulence_spectrum"].dims == ("member",)
    assert scenes["wind_turbulence_decay"].dims[0] == "member"
    pairs = {
        (speed, *decay)
        for speed, decay in zip(scenes["wind_speed"].values, scenes["wind_turbulence_decay"].values, strict=True)
    }
    assert pairs == {(10.0, 10.0, 16.0), (10.0, 8.0, 12.0), (20.0, 10.0, 16.0), (20.0, 8.0, 12.0)}
    for sampling in ("latin_hypercube", "sobol"):
        ranges = {SPECTRUM: ["kaimal", "davenport"], "wind.speed": [10, 20]}
        drawn = design(WINDY, ranges, members=8, sampling=sampling)["wind_turbulence_spectrum"].values.tolist()
        assert sorted(drawn) == ["davenport"] * 4 + ["kaimal"] * 4
        assert drawn != sorted(drawn)
    listed = design(WINDY, {SPECTRUM: ["kaimal", "davenport", "kaimal"]}, members=3, sampling="list")
    assert listed["wind_turbulence_spectrum"].values.tolist() == ["kaimal", "davenport", "kaimal"]
    alone = design(WINDY, {"wind.profile": np.array(["logarithmic", "uniform"])})
    assert alone["wind_profile"].values.tolist() == ["logarithmic", "uniform"]


def test_keys_of_one_word_are_lacking_in_members_with_another():
    words = {SPECTRUM: ["kaimal", "von_karman"], "wind.turbulence.intensity": [0.1, 0.2]}
    scenes = design(WINDY, {**words, "wind.turbulence.length_scale": [50.0, 90.0]}, members=6)
    is_other = (scenes["wind_turbulence_spectrum"] == "kaimal").values
    assert is_other.sum() == 3
    for name in ("wind_turbulence_intensity", "wind_turbulence_length_scale"):
        np.testing.assert_array_equal(np.isnan(scenes[name]), is_other)
    runs = cp.chain.simulate(scenes, **STEP)
    alone = cp.chain.simulate(scenes.isel(member=int(is_other.argmin()), drop=True), **STEP)
    np.testing.assert_array_equal(runs["position"].values[is_other.argmin()], alone["position"].values)


@pytest.mark.parametrize("function", [cp.summary, cp.catenary.rest, cp.chain.rest])
def test_numbers_of_members_have_their_words(function):
    result = function(design(WINDY, {"wind.profile": ["uniform", "logarithmic"]}))
    assert result["wind_profile"].values.tolist() == ["uniform", "logarithmic"]
    assert result["wind_profile"].attrs["units"] == "1"


def test_keys_that_the_scene_lacks_are_made_with_the_defaults_of_their_table():
    ice = design(SHORT, {"ice.thickness": [0.0, 0.01]}, members=3)
    assert ice["ice_thickness"].dims == ("member",)
    assert float(ice["ice_density"]) == 700.0
    damped = design(SHORT, {"damping.tension_proportional": [0.001, 0.01, 2]})
    assert damped["damping_tension_proportional"].values.tolist() == [0.001, 0.01]
    gusts = design({**SHORT, "wind": {**WIND, "ground": -1.0}}, {SPECTRUM: ["kaimal", "davenport"]})
    assert gusts["wind_turbulence_seed"].dtype.kind == "i"
    np.testing.assert_array_equal(gusts["wind_turbulence_decay"], [10.0, 16.0])
    wind = {"wind.speed": [10, 20, 2], "wind.direction": [[1, 0, 0], [0, 0, 1]]}
    made = design(SHORT, wind)
    assert made["wind_direction"].dims == ("member", "coordinate")
    assert str(made["wind_profile"].values) == "logarithmic"
    runs = cp.chain.simulate(made.isel(member=[0, 3]), **STEP)
    single = {**SHORT, "wind": {"speed": 20.0, "direction": [0.0, 0.0, 1.0]}}
    alone = cp.chain.simulate(cp.make_scene(single), **STEP)
    np.testing.assert_array_equal(runs["position"].values[1], alone["position"].values)


def test_a_table_of_the_scene_file_gives_the_same_scenes(tmp_path, capsys):
    ranges = {SPECTRUM: ["kaimal", "davenport"], "ice.thickness": [0.0, 0.01], DECAY: [[10.0, 16.0], [8.0, 12.0]]}
    table = {"members": 4, "seed": 3, "ranges": ranges}
    scene = cp.make_scene({**WINDY, "ensemble": table})
    xr.testing.assert_equal(cp.ensemble.design(scene), design(WINDY, ranges, members=4, seed=3))
    (tmp_path / "scene.toml").write_text(toml_of({**WINDY, "ensemble": table}))
    assert cli.main(["check", str(tmp_path / "scene.toml")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split() == [SPECTRUM, "kaimal,", "davenport"] for line in lines)
    assert any(line.split() == ["ice.thickness", "0", "to", "0.01", "m"] for line in lines)
    assert any("[10.0, 16.0], [8.0, 12.0]" in line for line in lines)


MISTAKES = [
    ({SPECTRUM: ["kaimal", "davnport"]}, r"spectrum\[1\]: given 'davnport'; allowed: one of .*; try: davenport$"),
    ({SPECTRUM: ["kaimal", "kaimal"]}, r"spectrum: given .*; allowed: at least two texts, all different$"),
    ({SPECTRUM: "kaimal"}, r"spectrum: given 'kaimal'; allowed: a list of texts$"),
    ({SPECTRUM: ["kaimal", 5]}, r"spectrum\[1\]: given 5; allowed: one of "),
    ({SPECTRUM: ["kaimal", "von_karman"]}, r"at 'von_karman' no scene: wind\.turbulence\.intensity: missing; allowed"),
    ({"wind.profile": ["power", "uniform"]}, r"at 'power' no scene: wind\.exponent: missing; allowed"),
    ({DECAY: [10.0, 16.0]}, r"decay\[0\]: given 10\.0; allowed: a list of at least 2 finite numbers$"),
    ({DECAY: [[10.0, 16.0], [1.0, 2.0, 3.0]]}, r"decay: given .*; allowed: lists of one length$"),
    ({DECAY: [[10.0, 16.0], [1.0, -2.0]]}, r"decay\[1\]\[1\]: given -2\.0; allowed: a finite number above 0"),
    ({"wind.direction": [[1.0, 0.0], [0.0, 1.0]]}, r"direction: given 2 numbers; allowed: 3 numbers, for x, y, z$"),
    (
        {"wind.direction": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]},
        r"at \[0\.0, 1\.0, 0\.0\] no scene: wind\.direction: given",
    ),
    ({"cable.bottom_tension": [1e4, 2e4]}, r"bottom_tension: given .*, at 10000 no scene: cable: given .*exactly one"),
    ({"ice.thicknes": [0.0, 0.1]}, r"ice\.thicknes: unknown key path; .*; try: ice\.thickness$"),
    ({"ice.density": [600.0, 900.0]}, r"given ice\.density, which make no scene: ice\.thickness: missing; allowed"),
    ({"ice.thickness": [-0.1, 0.1]}, r"thickness: given .*, at -0\.1 no scene: ice\.thickness: given -0\.1; allowed"),
    ({"motion.upper.x.amplitude": [0.1, 0.2]}, r"motion\.upper\.x\.amplitude: unknown key path"),
    ({"cable.strand": ["a", "b"]}, r"cable\.strand: unknown key path"),
    ({"title": ["a", "b"]}, r"title: unknown key path"),
]


@pytest.mark.parametrize(("ranges", "message"), MISTAKES)
def test_mistakes_name_key_given_and_allowed(ranges, message):
    with pytest.raises(cp.SceneError, match=message):
        design(WINDY, ranges, members=4)
    # a scene is made of its tables there, which says the same in its own place
    message = message.split("which make no scene")[-1].replace(
        "direction: given 2 numbers; allowed: 3 numbers, for x, y, z$",
        r"at \[1\.0, 0\.0\] no scene: wind\.direction: given",
    )
    with pytest.raises(cp.SceneError, match=message):
        cp.make_scene({**WINDY, "ensemble": {"members": 4, "ranges": ranges}})


def test_a_wind_without_direction_is_one_error():
    message = r"^ranges: given wind\.speed, which make no scene: wind\.direction: missing; allowed: direction into"
    with pytest.raises(cp.SceneError, match=message):
        design(SHORT, {"wind.speed": [10.0, 20.0]}, members=2)


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"ice.thickness": [0.0, 0.01]}, r"ranges: given a member with wind\.speed 12, ice\.thickness 0\.01, which .*mast\.dia"),
        ({"guy.1.top_tension": [5e3, -1.0]}, r"ranges\.guy\.1\.top_tension: given .*, at -1 no scene: guy\.1\.top_tension: g"),
        ({"wind.direction": [[1, 0, 0], [0, 1, 0]]}, r"ranges\.wind\.direction: given .*, at \[0\.0, 1\.0, 0\.0\] no scene: w"),
    ],
)  # fmt: skip
def test_listed_members_are_refused_by_the_range_that_makes_no_scene_of_them(ranges, message):
    with pytest.raises(cp.SceneError, match=f"^{message}"):
        cp.ensemble.design(small(windy), {"wind.speed": [10.0, 12.0]} | ranges, members=2, sampling="list")


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """Scenes with words and lists, the folder of their run, and the results."""
    folder = tmp_path_factory.mktemp("words") / "it"
    scenes = cp.ensemble.design(cp.make_scene({**WINDY, "ensemble": {"ranges": RANGES}}))
    return scenes, folder, cp.ensemble.run(scenes, folder, batch=3, **STEP).compute()


def test_results_have_the_words_of_their_members(words, described):
    scenes, folder, whole = words
    np.testing.assert_array_equal(whole["wind_turbulence_spectrum"], scenes["wind_turbulence_spectrum"])
    np.testing.assert_array_equal(whole["wind_turbulence_decay"], scenes["wind_turbulence_decay"])
    assert {"wind_turbulence_spectrum", "wind_turbulence_decay"} <= set(whole.coords)
    for member in (1, 6):
        alone = cp.chain.simulate(scenes.isel(member=member, drop=True), **STEP)
        np.testing.assert_array_equal(whole["position"].values[member], alone["position"].values)
    assert len({values.tobytes() for values in whole["position"].values}) == 8
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["varied"]["wind_turbulence_spectrum"] == {"choices": ["kaimal", "davenport"]}
    assert manifest["varied"]["wind_turbulence_decay"] == {"choices": [[10.0, 16.0], [8.0, 12.0]]}
    text = described(folder)
    assert "  wind_turbulence_spectrum: kaimal, davenport\n" in text
    assert "wind_speed 20 m s-1, wind_turbulence_spectrum " in text


def test_a_run_with_words_goes_on_and_refuses_others(words, tmp_path):
    scenes, folder, whole = words
    (folder / "batch_0001.nc").unlink()
    again = cp.ensemble.run(scenes, folder, batch=3, **STEP)
    xr.testing.assert_identical(again.compute(), whole)
    others = {**RANGES, DECAY: [[10.0, 16.0], [8.0, 13.0]]}
    with pytest.raises(cp.ArchiveError, match="the scenes differ, in wind_turbulence_decay"):
        cp.ensemble.run(design(WINDY, others), folder, batch=3, **STEP)
    xr.testing.assert_identical(run_script(lineage.script(scenes)), scenes)
    cp.archive.write(scenes, tmp_path / "scenes.nc")
    read = cp.archive.read(tmp_path / "scenes.nc")
    xr.testing.assert_equal(read, scenes)
    np.testing.assert_array_equal(cp.chain.simulate(read, **STEP)["position"], whole["position"])


def test_the_map_is_a_table_with_words(words, tmp_path, capsys):
    _, folder, whole = words
    (tmp_path / "scene.toml").write_text(toml_of({**WINDY, "ensemble": {"ranges": RANGES}}))
    command = ["ensemble", str(tmp_path / "scene.toml"), "--out", str(folder), "--batch", "3"]  # has nothing to compute
    assert cli.main([*command, "--option", "step=1e-3", "--option", f"outputs={[*STEP['outputs']]}"]) == 0
    said = capsys.readouterr().out
    assert "a picture needs two varied parameters, here 1 beside 2 of words or lists" in said
    with (folder / "map.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["wind_turbulence_spectrum"] for row in rows] == whole["wind_turbulence_spectrum"].values.tolist()
    assert {row["wind_turbulence_decay"] for row in rows} == {"[10.0, 16.0]", "[8.0, 12.0]"}
    with pytest.raises(cp.SceneError, match=r"^x: given 'wind_turbulence_spectrum'; allowed: a variable of numbers"):
        cp.plots.parameter_map(whole, "tension_maximum", x=SPECTRUM, y="wind.speed")


def test_members_that_differ_in_words_share_no_pair_of_a_map():
    numbers = {"wind.speed": [10, 20, 2], "cable.diameter": [0.01, 0.02, 2]}
    scenes = design(WINDY, {SPECTRUM: ["kaimal", "davenport"], **numbers})
    whole = cp.chain.simulate(scenes, **STEP)
    with pytest.raises(cp.SceneError, match=r"wind_turbulence_spectrum\.values == 'kaimal'"):
        cp.plots.parameter_map(whole, "tension_maximum", x="wind.speed", y="cable.diameter")


def test_a_map_leaves_out_members_that_lack_a_key():
    words = {"wind.profile": ["logarithmic", "power"], "wind.exponent": [0.1, 0.2], "wind.speed": [10, 20]}
    whole = cp.chain.simulate(design(WINDY, words, members=6), **STEP)
    ax = cp.plots.parameter_map(whole, "tension_maximum", x="wind.exponent", y="wind.speed")
    assert ax.get_title().endswith("3 members without wind_exponent or wind_speed left out")
    assert len(ax.collections[0].get_offsets()) == 3


def test_vectors_given_as_lists_have_their_components_as_coordinates():
    scenes = design(WINDY, {"wind.direction": [[1.0, 0.0, 0.0], [0.6, 0.0, 0.8]]})
    assert scenes["wind_direction_z"].dims == ("member",)
    assert scenes.coords["wind_direction_z"].values.tolist() == [0.0, 0.8]


def test_keys_that_a_mast_lacks_are_made_or_refused():
    mast = small(lambda mapping: mapping["mast"].update(diameter=0.1))
    iced = cp.ensemble.design(mast, {"ice.thickness": [0.0, 0.01]}, members=2)
    assert iced["ice_thickness"].dims == ("member",)
    with pytest.raises(cp.SceneError, match=r"^ranges\.damping\.tension_proportional: .*; allowed: none for guys"):
        cp.ensemble.design(mast, {"damping.tension_proportional": [0.0, 0.01]}, members=2)
    with pytest.raises(cp.SceneError, match=r"^ranges\.mast\.height: unknown key path"):
        design(WINDY, {"mast.height": [1.0, 2.0]}, members=2)


def _record(path, count, height):
    time = np.linspace(0.0, 1.0, count)
    path.write_text("time,x\n" + "\n".join(f"{t},{height * t * t * (3 - 2 * t)}" for t in time))


def test_records_of_motions_vary_with_the_folder_of_the_scene_file(tmp_path):
    for name, count, height in (("a.csv", 21, 0.01), ("b.csv", 41, 0.02)):
        _record(tmp_path / name, count, height)
    file = tmp_path / "scene.toml"
    motion = '[motion.upper.x]\nkind = "file"\npath = "a.csv"\n'
    text = toml_of(SHORT) + motion
    file.write_text(text + '[ensemble]\n[ensemble.ranges]\n"motion.upper.x.path" = ["a.csv", "b.csv"]\n')
    scenes = cp.ensemble.design(cp.read_scene(file))
    assert [name.rpartition("/")[2] for name in scenes["motion_upper_x_path"].values.tolist()] == ["a.csv", "b.csv"]
    runs = cp.chain.simulate(scenes, **STEP)
    for member, name in enumerate(("a.csv", "b.csv")):
        file.write_text(text.replace("a.csv", name))
        alone = cp.chain.simulate(cp.read_scene(file), **STEP)
        np.testing.assert_array_equal(runs["position"].values[member], alone["position"].values)
    file.write_text(text + '[ensemble]\n[ensemble.ranges]\n"motion.upper.x.path" = ["a.csv", "c.csv"]\n')
    with pytest.raises(cp.SceneError, match=r"ensemble\.ranges\.motion\.upper\.x\.path: given .*c\.csv"):
        cp.read_scene(file)


def test_records_of_wind_vary(tmp_path):
    for seed in (1, 2):
        turbulence = {"spectrum": "kaimal", "seed": seed}
        field = cp.wind.field(cp.make_scene({**WINDY, "wind": {**WINDY["wind"], "turbulence": turbulence}}))
        cp.archive.write(field, tmp_path / f"{seed}.nc")
    of_record = {**WINDY, "wind": {**WIND, "ground": -1.0, "turbulence": {"record": str(tmp_path / "1.nc")}}}
    paths = [str(tmp_path / "1.nc"), str(tmp_path / "2.nc")]
    scenes = design(of_record, {"wind.turbulence.record": paths})
    assert len(set(scenes["wind_turbulence_record_sha256"].values.tolist())) == 2
    runs = cp.chain.simulate(scenes, **STEP)
    of_record["wind"]["turbulence"]["record"] = paths[1]
    alone = cp.chain.simulate(cp.make_scene(of_record), **STEP)
    np.testing.assert_array_equal(runs["position"].values[1], alone["position"].values)
    assert np.abs(runs["position"][1] - runs["position"][0]).max() > 1e-3
