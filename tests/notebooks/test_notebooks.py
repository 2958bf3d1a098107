"""Notebooks: each page runs from top to bottom at small size, and reads as an article."""

from __future__ import annotations

import re
import sys
import types

import matplotlib as mpl
import pytest
from scenes import ROOT

mpl.use("Agg")

from matplotlib import pyplot as plt

FOLDER = ROOT / "pipelines" / "notebooks"
PAGES = ("first_look", "modes", "nine_guys", "parametric_study", "reduced_models", "the_paper", "whirling", "wind")
MARK = re.compile(r"^# %%(.*)$", re.MULTILINE)


def cells(text):
    """Split a notebook in the percent format into (kind, line on which it begins, source); the header is left out."""
    marks = list(MARK.finditer(text))
    ends = [mark.start() for mark in marks[1:]] + [len(text)]
    for mark, end in zip(marks, ends, strict=True):
        kind = "markdown" if "[markdown]" in mark[1] else "code"
        yield kind, text[: mark.end()].count("\n") + 1, text[mark.end() : end]


def run(text, name, monkeypatch):
    """Run the code cells of a notebook in the module ``__main__``, as a kernel does; the error says which cell failed."""
    module = types.ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", module)
    space = vars(module)
    for kind, line, source in cells(text):
        if kind == "code":
            # empty lines in front, so that a traceback names the line of the file
            code = compile("\n" * (line - 1) + source, name, "exec")
            try:
                exec(code, space)
            except Exception as error:
                error.add_note(f"in the cell of {name} that begins on line {line}")
                raise
            for number in plt.get_fignums():  # drawn as a notebook would, so that what cannot be drawn fails
                plt.figure(number).canvas.draw()
            plt.close("all")
    return space


@pytest.fixture(autouse=True)
def _small(monkeypatch, tmp_path):
    monkeypatch.setenv("CABLEPOD_SMALL", "1")
    monkeypatch.chdir(tmp_path)
    yield
    plt.close("all")


@pytest.mark.slow  # three to six seconds each, once what they use is compiled: they come last, when it is
@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_runs(name, monkeypatch):
    path = FOLDER / f"{name}.py"
    assert run(path.read_text(encoding="utf-8"), path.name, monkeypatch)["SMALL"]


HEADER = """# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

"""


@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_has_the_header_that_jupytext_reads(name):
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    assert text[: MARK.search(text).start()] == HEADER


def test_these_are_all():
    assert sorted(path.stem for path in FOLDER.glob("*.py")) == list(PAGES)


@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_reads_as_an_article(name):
    parts = list(cells((FOLDER / f"{name}.py").read_text(encoding="utf-8")))
    assert parts[0][0] == "markdown"
    assert parts[0][2].strip().startswith("# # ")
    for kind, line, source in parts:
        rows = [row for row in source.splitlines() if row.strip()]
        if kind == "markdown":
            assert all(row.startswith("#") for row in rows), f"{name}, line {line}"
            assert source.count("$") % 2 == 0, f"{name}, line {line}: a formula does not end"
        else:
            assert len(rows) <= 16, f"{name}, line {line}: {len(rows)} lines of code"


def test_a_failing_cell_fails_and_is_named(monkeypatch):
    text = "# %% [markdown]\n# words\n\n# %%\nSMALL = 1\n\n# %%\nraise ValueError('no')\n"
    with pytest.raises(ValueError, match="no") as info:
        run(text, "page.py", monkeypatch)
    assert info.value.__notes__ == ["in the cell of page.py that begins on line 7"]


def test_cells_share_names_and_figures_that_cannot_be_drawn_fail(monkeypatch):
    assert run("# %%\na = 1\n# %%\nb = a + 1\n", "page.py", monkeypatch)["b"] == 2
    text = "# %%\nfrom matplotlib import pyplot as plt\nplt.gca().set_title('$\\\\frac$')\n"
    with pytest.raises(ValueError, match="frac"):
        run(text, "page.py", monkeypatch)


def test_the_list_of_notebooks_is_complete_and_has_no_number():
    page = (FOLDER.parent / "README.md").read_text(encoding="utf-8").partition("## Notebooks")[2]
    listed = re.findall(r"^\| \[`(\w+)`\]", page, re.MULTILINE)
    assert sorted(listed) == sorted(path.stem for path in FOLDER.glob("*.py")) == sorted(PAGES)
    # a number in words, which nobody updates: seven were eight
    texts = [(ROOT / "README.md").read_text(encoding="utf-8"), page]
    number = re.compile(r"\b(?:six|seven|eight|nine|ten)\s+(?:articles|notebooks)\b", re.IGNORECASE)
    assert [match[0] for text in texts for match in number.finditer(text)] == []
