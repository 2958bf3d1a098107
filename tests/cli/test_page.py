"""The option --report: one page of what a command computed, with the notes that it gave."""

from __future__ import annotations

import re
from html import unescape

import pytest
from scene_files import toml_of
from scenes import SOFT_TOML
from wind_scenes import GUY, KAIMAL

from cablepod import cli

ENSEMBLE = """
[ensemble]
members = 4
sampling = "grid"
[ensemble.ranges]
"cable.top_tension" = [150.0, 200.0]
"motion.upper.x.amplitude" = [-0.05, -0.02]
"""
#: A small guy in gusts.
GUSTY = {
    **GUY,
    **{"damping": {"mass_proportional": 0.1}, "wind": KAIMAL, "chain": {"links": 10}},
    "time": {"duration": 4.0, "interval": 0.1},
}


def notes_of(captured):
    return [line.removeprefix("cablepod: note: ") for line in captured.err.splitlines() if "note: " in line]


def test_run_writes_a_page_with_all_that_it_says(scene_file, tmp_path, capsys):
    folder, page = tmp_path / "out", tmp_path / "deep" / "er" / "it.html"
    # ranks that the scene has not are left out with a note
    arguments = ["run", str(scene_file), "--out", str(folder), "--ranks", "1,20", "--report", str(page)]
    status = cli.main(arguments)
    captured = capsys.readouterr()
    if status:  # a scene with few modes refuses them: the page is then not written
        pytest.fail(captured.err)
    content = unescape(page.read_text(encoding="utf-8"))
    assert f"report    {page}" in captured.out
    answers = captured.out.split("\n\n")[1].splitlines()
    assert len(answers) > 3
    assert all(line in content for line in answers)
    warned = [note for note in notes_of(captured) if "left out" in note]
    assert warned
    assert all(note in content for note in warned)
    assert not list(folder.glob("*.html"))


def test_ensemble_writes_a_page_with_a_map(tmp_path, capsys):
    scene, page = tmp_path / "it.toml", tmp_path / "it.html"
    scene.write_text(SOFT_TOML + ENSEMBLE)
    arguments = ["ensemble", str(scene), "--out", str(tmp_path / "out"), "--report", str(page)]
    assert cli.main([*arguments, "--option", "outputs=['tension_extremes']", "--option", "step=1e-3"]) == 0
    captured = capsys.readouterr()
    content = unescape(page.read_text(encoding="utf-8"))
    assert f"report    {page}" in captured.out
    assert "tension maximum of all links" in content
    assert "cable.top_tension" in content
    assert all(note in content for note in notes_of(captured) if note.startswith("member"))


def test_design_writes_a_page_with_its_tables(tmp_path, capsys):
    scene, page = tmp_path / "it.toml", tmp_path / "it.html"
    scene.write_text(toml_of(GUSTY))
    arguments = ["design", str(scene), "--out", str(tmp_path / "out"), "--report", str(page)]
    assert cli.main([*arguments, "--directions", "1", "--speeds", "15,18", "--storms", "3"]) == 0
    captured = capsys.readouterr()
    content = unescape(page.read_text(encoding="utf-8"))
    assert captured.out.rstrip().endswith(f"report    {page}")
    headings = re.findall("<h3>(.*?)</h3>", content)
    assert {"Ends of the guy", "Directions and speeds"} <= set(headings)
    assert "<th" in content
    assert "peak low [kN]" in content
    assert 'alt="design: largest tension of all ends, mean over the storms, over direction and speed' in content
    rows = {key: value for key, value in re.findall(r"<tr><t[hd][^>]*>([^<]*)</t[hd]><t[hd][^>]*>([^<]*)<", content)}
    seed = GUSTY["wind"]["turbulence"]["seed"]
    expected = ("(15, 18)", "(0)", f"({seed}, {seed + 1}, {seed + 2})")  # not the ones of the scene
    assert tuple(rows[f"wind.{key}"] for key in ("speed", "direction", "turbulence.seed")) == expected


def test_stringing_writes_a_page_with_its_figures(tmp_path, capsys):
    scene, page = tmp_path / "it.toml", tmp_path / "it.html"
    scene.write_text(toml_of({**GUSTY, "cable": {**GUY["cable"], "thermal_expansion": 1.2e-5}}))
    arguments = ["stringing", str(scene), "--temperatures", "-20", "40", "4", "--report", str(page)]
    assert cli.main(arguments) == 0
    printed, content = capsys.readouterr().out, unescape(page.read_text(encoding="utf-8"))
    assert printed.rstrip().endswith(f"report    {page}")
    assert all(line in content for line in printed.splitlines()[:-1])
    assert 'alt="stringing: sag over temperature"' in content
    assert [item.name for item in tmp_path.iterdir() if item.is_dir()] == []  # no folder without --out


@pytest.mark.parametrize("page", ["it.txt", "it", ""])
def test_another_ending_is_refused_before_anything_runs(scene_file, tmp_path, refusal, page):
    said = refusal("run", scene_file, "--out", tmp_path / "out", "--report", page)
    assert said.startswith("cablepod: --report: given ")
    assert not (tmp_path / "out").exists()
