"""The shared head of the studies: tables of a page, time inside functions, calls between sub-packages."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import _study
import pytest
from benchmarks import calls

PIPELINES = Path(_study.__file__).parent
SCRIPTS = sorted(
    path.relative_to(PIPELINES).as_posix()
    for path in PIPELINES.rglob("*.py")
    if "notebooks" not in path.parts and 'if __name__ == "__main__":\n    main' in path.read_text(encoding="utf-8")
)


def test_tables_are_replaced_by_name(tmp_path, capsys):
    page = tmp_path / "README.md"
    page.write_text("# A study\n\n<!-- begin: a -->\nold\n<!-- end: a -->\n\nConclusion.\n", encoding="utf-8")
    table = _study.markdown_table(["x", "y"], [["1", r"\d ≤ 2"]])
    _study.update_tables(page, {"a": table})
    assert page.read_text(encoding="utf-8") == (
        "# A study\n\n<!-- begin: a -->\n| x | y |\n| --- | --- |\n| 1 | \\d ≤ 2 |\n<!-- end: a -->\n\nConclusion.\n"
    )
    assert capsys.readouterr().out == ""
    _study.update_tables(page, {"a": "new", "b": "other"})
    text = "# A study\n\n<!-- begin: a -->\nnew\n<!-- end: a -->\n\nConclusion.\n"
    assert page.read_text(encoding="utf-8") == text
    assert "no place for table b" in capsys.readouterr().out
    _study.update_tables(tmp_path / "none.md", {"b": "other"})
    assert not (tmp_path / "none.md").exists()


def test_time_inside_adds_up_and_puts_the_functions_back():
    ticks = iter((1.0, 4.0, 10.0, 12.0))
    plain = _study.percent
    with _study.time_inside("_study.percent", clock=lambda: next(ticks)) as watch:
        assert _study.percent(0.5) == "50 %"
        assert _study.percent(float("nan")) == "-"
    assert watch.seconds == 5.0
    assert _study.percent is plain


def test_jobs_take_turns():
    order = []
    results = _study.in_turns([lambda: order.append("a") or (1.0, 2.0), lambda: order.append("b") or (3.0, 5.0)], 3)
    assert order == ["a", "b"] * 3
    assert [_study.medians(rows) for rows in results] == [(1.0, 2.0), (3.0, 5.0)]


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("kernels/reduced.py", "galerkin"),
        ("kernels/chain.py", "chain"),
        ("links.py", "discretisation"),
        ("compare.py", "compare"),
        ("condensed/_runs.py", "condensed"),
        ("paper/report.py", "paper"),
    ],
)
def test_files_of_both_layouts_have_a_sub_package(path, name):
    assert calls.sub_package(path) == name


def test_calls_across_count_what_leaves_a_folder():
    counter = calls.counted(lambda: calls.scene("example2"))
    assert 0 < counter.across.total() < counter.calls
    assert all(a != b for a, b in counter.across)
    assert counter.depth > 1
    assert len(counter.files) > 1


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
def test_scripts_start_from_any_folder(script, tmp_path):
    command = [sys.executable, str(PIPELINES / script), "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"pipelines/{script}" in done.stdout
