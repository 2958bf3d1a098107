"""Stages, ids and hashes of a file, and how a file is described."""

import json
import platform
import re

import numpy as np
import pytest
import xarray as xr
from histories import run_script
from results import make_scene, make_trajectory

import cablepod as cp
from cablepod import lineage, provenance
from cablepod.archive import ArchiveError, describe, read, write


def hash_of(dataset):
    """Return the recorded hashes of the variables of a dataset that was read."""
    return hashes_in(provenance.stages_of(dataset)[-1])


def hashes_in(stage):
    """Return the hashes of the variables in the record of a stage."""
    return {name: entry[0] for name, entry in stage["content"]["variables"].items()}


def test_each_stage_adds_one_line_and_keeps_the_earlier_ones(tmp_path, stop_clock):
    stop_clock("2030-01-01T00:00:00Z")
    scene = read(write(make_scene(), tmp_path / "scene.nc"))
    assert scene.attrs["history"].startswith("2030-01-01T00:00:00Z cablepod ")
    assert scene.attrs["history"].count("\n") == 0
    stop_clock("2030-01-02T00:00:00Z")
    # as a science module does: the new dataset has only history_json from its input
    trajectory = make_trajectory(scene=scene).assign_attrs(wall_time_s=12.5)
    back = read(write(trajectory, tmp_path / "trajectory.nc"))
    lines = back.attrs["history"].split("\n")
    assert lines[0] == scene.attrs["history"]
    assert re.fullmatch(r"2030-01-02T00:00:00Z cablepod \S+: chain\.simulate\(.*\) id=\w{20} inputs=\w{20}", lines[1])
    assert len(lines) == 2
    old, new = json.loads(back.attrs["history_json"])
    assert old == json.loads(scene.attrs["history_json"])[0]
    assert {"program", "version", "written", "platform", "content"} <= set(new)
    assert new["wall_time_s"] == 12.5
    assert None not in [new.get("commit", "")]
    assert "wall_time_s" not in back.attrs
    assert back.attrs["date_created"] == "2030-01-02T00:00:00Z"
    # a history that came along, with a line of somebody else's, is appended to and never replaced
    carried = make_trajectory(scene=scene).assign_attrs(history="2029-12-31T00:00:00Z cut by hand\n" + lines[0])
    assert read(write(carried, tmp_path / "carried.nc")).attrs["history"].split("\n") == [
        "2029-12-31T00:00:00Z cut by hand",
        *lines,
    ]


def test_a_cut_in_time_tells_its_own_length_and_content(tmp_path):
    whole = read(write(make_trajectory(), tmp_path / "whole.nc"))
    assert whole.attrs["time_coverage_duration"] == "PT5.9S"
    assert whole.attrs["time_coverage_resolution"] == "PT0.1S"
    some = read(write(whole.isel(time=[0, 1, 5]), tmp_path / "some.nc"))
    assert some.attrs["time_coverage_duration"] == "PT0.5S"
    assert "time_coverage_resolution" not in some.attrs
    alone = read(write(some.drop_attrs(deep=False), tmp_path / "alone.nc"))
    assert hash_of(some) == hash_of(alone) != hash_of(whole)
    none = read(write(whole.isel(time=0), tmp_path / "none.nc"))
    assert "time_coverage_duration" not in none.attrs


def test_texts_made_for_an_input_are_not_taken_over_but_a_given_title_is(tmp_path):
    del (scene := make_scene()).attrs["title"]
    scene = read(write(scene, tmp_path / "scene.nc"))
    assert scene.attrs["title"] == "Result of make_scene"
    shorter = provenance.record(scene.copy(), function="scene.cut", parameters={}, inputs=[scene])
    back = read(write(shorter, tmp_path / "cut.nc"))
    assert back.attrs["title"] == "Result of scene.cut"
    assert "scene.cut" in back.attrs["summary"]
    assert read(write(make_scene(), tmp_path / "titled.nc")).attrs["title"].startswith("Example 2")


def test_id_and_content_hash_depend_on_neither_clock_nor_machine(tmp_path, monkeypatch, stop_clock):
    plain = xr.Dataset({"mean": ("particle", np.arange(3.0), {"units": "m"})})
    first = read(write(plain, tmp_path / "first.nc"))
    stop_clock("2040-01-01T00:00:00Z")
    monkeypatch.setattr(platform, "platform", lambda: "elsewhere")
    cp.clear_caches()
    try:
        second = read(write(plain, tmp_path / "second.nc"))
    finally:
        cp.clear_caches()
    assert first.attrs["history_json"] != second.attrs["history_json"]
    assert first.attrs["id"] == second.attrs["id"]
    assert hash_of(first) == hash_of(second)
    swapped = plain.assign(mean=("particle", np.arange(3.0).astype(">f8"), {"units": "m"}))
    assert hash_of(read(write(swapped, tmp_path / "swapped.nc"))) == hash_of(first)
    other = plain.assign(mean=("particle", [0.0, 1.0, np.nextafter(2.0, 3.0)]))
    assert read(write(other, tmp_path / "other.nc")).attrs["id"] != first.attrs["id"]


def test_a_history_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(ArchiveError, match="'history_json' is not a list of stages"):
        write(make_scene().assign_attrs(history_json="{"), tmp_path / "it.nc")
    assert list(tmp_path.iterdir()) == []


def test_describe_tells_what_a_file_is_and_how_it_came_about(tmp_path):
    scene = read(write(make_scene(), tmp_path / "scene.nc"))
    trajectory = make_trajectory(scene=scene).assign_attrs(title="Slow", wall_time_s=2.0)
    path = write(trajectory, tmp_path / "it.nc")
    text = describe(path)
    assert re.search(r"^file .*it\.nc \(.* MB, schema 3\)$", text, re.MULTILINE)
    assert re.search(r"^title +Slow$", text, re.MULTILINE)
    assert re.search(r"^stage +chain\.simulate$", text, re.MULTILINE)
    assert re.search(rf"^id +{trajectory.attrs['id']}$", text, re.MULTILINE)
    assert re.search(r"^sizes .*time 60, particle 9, coordinate 2", text, re.MULTILINE)
    assert "  position (time, particle, coordinate) [m]  position\n" in text
    first, second = text.split("history\n")[1].split("\n")
    assert first.startswith(f"  {scene.attrs['id']} make_scene(free=null, gravity=9.81); cablepod ")
    assert "links=8" in second
    assert f" from {scene.attrs['id']}; " in second
    assert second.endswith(", 2 s")
    assert describe(read(path)) == text.split("\n", 1)[1]


def test_long_parameters_are_cut_where_people_read_them_but_not_in_the_record(tmp_path):
    parameters = {"times": list(range(1000)), "title": "two\nlines"}
    scene = provenance.record(make_scene(), function="chain.simulate", parameters=parameters)
    back = read(write(scene, tmp_path / "it.nc"))
    assert provenance.stages_of(back)[-1]["parameters"] == provenance.to_json(parameters)
    assert back.attrs["history"].count("\n") == 0
    assert 200 < len(back.attrs["history"]) < 300
    assert max(map(len, describe(back).split("\n"))) < 300


def test_describe_shows_the_values_of_a_scene_before_it_is_written():
    text = describe(make_scene())
    assert "  gravity = 9.81 [m s-2]  acceleration of gravity\n" in text
    assert "  motion_upper_x_kind = 'one_minus_cosine'  kind of" in text
    assert describe(xr.Dataset()).endswith("history")


def test_values_changed_after_reading_make_a_stage_and_an_id_of_their_own(tmp_path):
    whole = read(write(make_trajectory(), tmp_path / "whole.nc"))
    same = read(write(whole.assign_attrs(title="Renamed"), tmp_path / "same.nc"))
    assert (same.attrs["id"], same.attrs["history_json"]) == (whole.attrs["id"], whole.attrs["history_json"])
    lazy = read(tmp_path / "whole.nc", chunks={})
    for number, other in enumerate((whole, lazy)):
        values = other["tension"].copy(data=other["tension"].values)
        values[0, 0] += 1e-9
        edited = read(write(other.assign(tension=values), tmp_path / f"edited{number}.nc"))
        old, new = (json.loads(dataset.attrs["history_json"]) for dataset in (whole, edited))
        assert new[:-1] == old
        assert (new[-1]["function"], new[-1]["inputs"]) == ("changed outside the package", [whole.attrs["id"]])
        assert new[-1]["id"] == edited.attrs["id"] != whole.attrs["id"]
        bare = read(write(edited.drop_attrs(deep=False), tmp_path / f"bare{number}.nc"))
        assert hashes_in(new[-1]) == hash_of(bare) != hash_of(whole)
        assert edited.attrs["history"].split("\n")[:-1] == whole.attrs["history"].split("\n")
        again = read(write(edited, tmp_path / f"again{number}.nc"))
        assert again.attrs["history_json"] == edited.attrs["history_json"]
    lazy.close()


def test_attributes_changed_after_reading_make_a_stage_and_an_id_of_their_own(tmp_path):
    whole = read(write(make_trajectory(), tmp_path / "whole.nc"))
    other = whole.copy()
    other["tension"].attrs["filter"] = "low-pass"
    ids = [whole.attrs["id"]]
    for number, edit in enumerate((whole.assign_attrs(step=1.0), whole.assign_attrs(step=2.0), other)):
        edited = read(write(edit, tmp_path / f"edited{number}.nc"))
        stages = json.loads(edited.attrs["history_json"])
        assert (stages[-1]["function"], stages[-1]["inputs"]) == ("changed outside the package", ids[:1])
        ids.append(edited.attrs["id"])
        again = read(write(edited, tmp_path / f"again{number}.nc"))
        assert again.attrs["history_json"] == edited.attrs["history_json"]
        assert "cannot be made again" in lineage.script(edited)
    assert len(set(ids)) == 4
    texts = whole.assign_attrs(comment="for the report", creator_name="me")
    texts["tension"].attrs["long_name"] = "Spannkraft"
    assert read(write(texts, tmp_path / "texts.nc")).attrs["id"] == whole.attrs["id"]


@pytest.mark.parametrize(
    "values", [3, 3.0, [3], np.array([1, 2]), [1, 2.5], "x", ["x"], ["x", "y"], np.float32(0.1), ""]
)
def test_attributes_of_a_file_are_those_that_were_written(values, tmp_path):
    dataset = make_trajectory().assign_attrs(mine=values)
    dataset["tension"].attrs["mine"] = values
    once = read(write(dataset, tmp_path / "once.nc"))
    assert read(write(once, tmp_path / "twice.nc")).attrs["id"] == once.attrs["id"]
    # an attribute that was set after the stage is one from outside, and the same before and after
    found = provenance.input_of(dataset)
    assert found.id == once.attrs["id"] != dataset.attrs["id"]
    assert found.hash == provenance.input_of(once).hash


def test_a_scene_changed_by_hand_has_the_id_that_its_results_name(tmp_path, soft):
    scene = cp.make_scene(soft)
    for before in (scene, read(write(scene, tmp_path / "scene.nc"))):
        heavier = before.assign(gravity=before["gravity"] + 0.1)
        back = read(write(heavier, tmp_path / "heavier.nc", overwrite=True))
        assert back.attrs["id"] != scene.attrs["id"]
        results = [cp.catenary.rest(item) for item in (heavier, back)]
        for result in results:
            assert json.loads(result.attrs["history_json"])[-1]["inputs"] == [back.attrs["id"]]
        assert results[0].attrs["id"] == results[1].attrs["id"]
        assert provenance.digest(run_script(lineage.script(back))) == provenance.digest(heavier)
    assert read(write(scene, tmp_path / "unchanged.nc")).attrs["id"] == scene.attrs["id"]
    rest = read(write(cp.catenary.rest(scene), tmp_path / "rest.nc"))
    edited = read(write(rest.assign(tension_lower=1.0), tmp_path / "edited.nc"))
    assert "changed outside the package" in lineage.script(edited)
    assert "cannot be made again" in lineage.script(edited)


def times_of(dataset):
    """Return the times of each stage, in the record and in the text."""
    times = {}
    for stage in provenance.stages_of(dataset):
        times.setdefault(stage["id"], set()).add(stage["written"])
    for line in dataset.attrs["history"].split("\n"):
        times.setdefault(re.search(r"id=(\w+)", line)[1], set()).add(line.split()[0])
    return times


def test_a_stage_has_one_time(tmp_path, stop_clock):
    scene = make_scene()
    identifier = scene.attrs["id"]
    stop_clock("2030-01-02T00:00:00Z")
    late = read(write(make_trajectory(scene=scene), tmp_path / "late.nc"))
    stop_clock("2030-01-01T00:00:00Z")
    early = read(write(scene, tmp_path / "early.nc"))
    first, second = (dataset.attrs["history"].split("\n")[0] for dataset in (early, late))
    assert first != second
    # of several inputs, written at different times or not at all, the earliest counts, in any order
    for inputs in ([late, early], [early, late], [scene, late, early]):
        both = provenance.record(make_scene(), function="compare.errors", parameters={}, inputs=inputs)
        both.attrs["history"] = "\n".join([second, first])
        found = times_of(read(write(both, tmp_path / "both.nc", overwrite=True)))
        assert found[identifier] == {"2030-01-01T00:00:00Z"}
        assert [len(times) for times in found.values()] == [1] * 3
    # files that one process writes later tell the same time of what they have in common

    stop_clock("2031-01-01T00:00:00Z", same_process=True)
    other = read(write(make_trajectory(times=7, scene=scene), tmp_path / "other.nc"))
    found = times_of(other)
    assert found[identifier] == {"2030-01-01T00:00:00Z"}
    assert other.attrs["date_created"] == "2031-01-01T00:00:00Z"
