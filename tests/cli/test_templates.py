"""What a new user of the command begins with: new, examples, and the examples in every help."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from children import without_progress

import cablepod as cp
from cablepod import cli
from cablepod import examples as shipped


def test_what_new_writes_runs(here, capsys):
    assert cli.main(["new", "guy.toml"]) == 0
    assert capsys.readouterr().out == "guy.toml: a scene to start from; next: cablepod run guy.toml --out out/guy\n"
    assert cli.main(["run", "guy.toml", "--out", "out/guy", "--ranks", "2"]) == 0
    said = capsys.readouterr()
    assert without_progress(said.err) == ""
    error = float(cp.archive.read(here / "out/guy/comparison.nc").error_max.sel(model="condensed", rank=2))
    assert 0 < error < 0.05  # two modes of a taut guy's slow motion: a first result should not puzzle


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_links_of_the_new_scene_resolve_gusts(seed):
    """Of motion, peak, standard deviation and fatigue range of the tensions at the ends; 20 links err by ten times as much."""
    tables = tomllib.loads((shipped.data_folder() / "new.toml").read_text())
    del tables["motion"]
    tables["wind"] = {"speed": 25.0, "direction": [1.0, 0.0], "turbulence": {"spectrum": "kaimal", "seed": seed}}
    tables["time"]["interval"] = 0.02
    outputs = ("position", "tension", "tension_extremes")
    own, fine = (
        cp.chain.simulate(cp.make_scene(tables), links=links, tolerance=1e-3, outputs=outputs)
        for links in (tables["chain"]["links"], 160)
    )
    assert float(cp.compare.errors(own, fine).error_max) < 0.015
    ends = [run.isel(link=[0, -1]) for run in (own, fine)]
    peak, spread = ([end.tension_maximum for end in ends], [end.tension.std("time") for end in ends])
    ranges = [cp.fatigue.equivalent(end.tension) for end in ends]
    for (found, true), most in ((peak, 1e-3), (spread, 4e-3), (ranges, 4e-3)):
        np.testing.assert_allclose(found, true, rtol=most)


def test_each_block_of_the_new_scene_can_be_uncommented():
    text = (shipped.data_folder() / "new.toml").read_text()
    blocks = [block for block in text.split("\n\n") if block.startswith("# [")]
    assert len(blocks) == 7
    plain = cp.make_scene(tomllib.loads(text))
    for block in blocks:
        bare = "\n".join(line.removeprefix("# ") for line in block.splitlines())
        scene = cp.make_scene(tomllib.loads(text.replace(block, bare)))
        assert {*scene.variables, *scene.attrs} > {*plain.variables, *plain.attrs}, block
        if "ensemble" in block:
            assert cp.ensemble.design(scene).sizes["member"] == 42  # as the comment says
    everything = text
    for block in blocks:
        everything = everything.replace(block, "\n".join(line.removeprefix("# ") for line in block.splitlines()))
    assert cp.chain.rest(cp.make_scene(tomllib.loads(everything))).sizes["link"] == 40


def test_examples_are_listed_with_their_titles(capsys):
    assert cli.main(["examples"]) == 0
    listed = dict(line.split(None, 1) for line in capsys.readouterr().out.split("\n\n")[0].splitlines())
    assert sorted(listed) == shipped.scenes()
    assert listed["example2"] == shipped.scene("example2").attrs["title"]


def test_an_example_is_copied(here, scenes, capsys):
    assert cli.main(["examples", "example2"]) == 0
    assert (here / "example2.toml").read_bytes() == (scenes / "example2.toml").read_bytes()
    assert cli.main(["examples", "whip", "--out", "mine.toml"]) == 0
    assert (here / "mine.toml").read_bytes() == (scenes / "whip.toml").read_bytes()
    assert "mine.toml: a copy of whip" in capsys.readouterr().out


def test_the_template_of_a_mast_runs(here, capsys):
    assert cli.main(["new", "--mast", "mast.toml"]) == 0
    text = (here / "mast.toml").read_text()
    (here / "mast.toml").write_text(text.replace("duration = 120.0", "duration = 2.0"))
    assert cli.main(["run", "mast.toml", "--out", "out"]) == 0
    said = capsys.readouterr().out
    assert "critical factor of buckling" in said
    assert "fatigue" in said
    rows = [line.split() for line in said.splitlines() if line[:3].strip().isdigit()]
    assert [row[0] for row in rows] == ["1", "2", "3", "4", "5", "6"]
    assert {"motion.nc", "guys.nc", "tensions.png"} <= {path.name for path in (here / "out").iterdir()}


def test_what_is_switched_off_in_the_template_of_a_mast_can_be_switched_on(tmp_path):
    text = (shipped.data_folder() / "new_mast.toml").read_text()
    text = "\n".join(
        line.removeprefix("# ") if "=" in line or line.startswith("# [") else line for line in text.splitlines()
    )
    (tmp_path / "mast.toml").write_text(text)
    assert cp.mast.rest(cp.read_scene(tmp_path / "mast.toml")).sizes["guy"] == 6


def test_shipped_scenes_need_no_file_beside_them(scenes):
    # a copy must be whole: none reads a record
    for name in shipped.scenes():
        assert 'kind = "file"' not in (scenes / f"{name}.toml").read_text(), name


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["new", "there.toml"], "NAME.toml: given 'there.toml'; allowed: the name of a file that is not there yet"),
        (["new", "guy"], "NAME.toml: given 'guy'; allowed: the name of a file that ends with .toml"),
        (["new", ".toml"], "ends with .toml"),
        (["new", "none/guy.toml"], "allowed: a file in a folder that is there; none is none"),
        (["new", "/proc/guy.toml"], "/proc/guy.toml: "),
        (["examples", "exmaple2"], "NAME: given 'exmaple2'; allowed: one of the shipped scenes: double_pendulum, "),
        (["examples", "example2", "--out", "there.toml"], "--out: given 'there.toml'; allowed: the name of a file that is"),
        (["examples", "--out", "x.toml"], "--out: given x.toml without a scene; allowed: cablepod examples NAME --out"),
    ],
)  # fmt: skip
def test_nothing_is_overwritten_or_guessed(here, refusal, arguments, said):
    (here / "there.toml").write_text("mine")
    assert said in refusal(*arguments)
    assert (here / "there.toml").read_text() == "mine"
    assert [path.name for path in here.iterdir()] == ["there.toml"]
