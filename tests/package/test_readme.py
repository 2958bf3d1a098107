"""The pages: the scene of the scene page is one, and the Python of the README runs."""

from __future__ import annotations

import re
import tomllib

import pytest
from scenes import ROOT

import cablepod as cp

#: Text and path of a picture.
PICTURE = re.compile(r"!\[([^\]]*)\]\(([^)]*)\)")


def test_the_scene_of_the_page_is_one():
    text = (ROOT / "cablepod" / "scene" / "README.md").read_text()
    block = text.split("```toml")[1].split("```")[0]
    assert cp.make_scene(tomllib.loads(block)).attrs["title"] == "A guy in the wind"


def test_the_python_in_the_readme_runs(tmp_path, monkeypatch, capsys):
    code = (ROOT / "README.md").read_text().split("```python")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    exec(code, {})
    tension, error, estimate, largest = map(float, capsys.readouterr().out.split())
    assert tension == pytest.approx(3183.9, abs=0.1)
    assert error < 0.02
    assert 0.005 < estimate < 0.05  # of a model that errs by 1.2 %; the estimate is right within a factor of 5 at worst
    chain = cp.chain.simulate(cp.read_scene(ROOT / "data/scenes/example3.toml"), outputs=("tension_extremes",))
    assert largest == pytest.approx(float(chain.tension_maximum.max()), rel=0.01)  # order "leading" with two modes
    assert (tmp_path / "model.nc").exists()


@pytest.mark.parametrize("page", sorted((ROOT / "cablepod").glob("*/README.md")), ids=lambda page: page.parent.name)
def test_the_page_of_a_folder_names_its_files(page):
    text = page.read_text()
    assert "## Where is what" in text
    missing = [file.name for file in page.parent.glob("_*.py") if file.name not in text and file.stem != "__init__"]
    assert not missing


@pytest.mark.parametrize("page", ["README.md", "cablepod/README.md"])
def test_first_pages_are_short(page):
    assert len((ROOT / page).read_text().splitlines()) <= 200


def test_every_picture_says_what_is_seen():
    pages = [path for folder in ("cablepod", "pipelines", "data", "tests") for path in (ROOT / folder).rglob("*.md")]
    pictures = [found for page in (ROOT / "README.md", *pages) for found in PICTURE.findall(page.read_text())]
    assert len(pictures) > 15
    assert [path for text, path in pictures if len(text.split()) < 7] == []
