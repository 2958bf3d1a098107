"""The shared head of the studies: tables of a page, time inside functions, calls between sub-packages."""

from __future__ import annotations

import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import _study
import pytest
from benchmarks import calls
from children import run_python

from cablepod.chain import _explicit
from cablepod.examples import scene
from cablepod.integrate import _march

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


def test_a_function_imported_by_name_is_seen_too():
    plain = _march.advance_in_blocks
    with _study.time_inside("cablepod.integrate._march.advance_in_blocks", clock=lambda: 1.0):
        assert _march.advance_in_blocks is not plain
        assert _explicit.advance_in_blocks is _march.advance_in_blocks
    assert _explicit.advance_in_blocks is plain


LATER = """
import sys
sys.path.insert(0, sys.argv[1])
import _study
assert "cablepod.chain._explicit" not in sys.modules
with _study.time_inside("cablepod.integrate._march.advance_in_blocks"):
    from cablepod.chain import _explicit
    seen = _explicit.advance_in_blocks
from cablepod.integrate import _march
print(seen is not _march.advance_in_blocks, _explicit.advance_in_blocks is _march.advance_in_blocks)
"""


def test_a_module_that_is_loaded_within_the_block_does_not_keep_the_replacement():
    done = run_python("-c", LATER, str(Path(_study.__file__).parent), timeout=60.0)
    assert (done.returncode, done.stdout) == (0, "True True\n"), done.stderr


def test_what_studies_watch_is_there():
    """Dotted names of functions of the package in the scripts, which :func:`_study.time_inside` replaces."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in PIPELINES.rglob("*.py"))
    names = set(re.findall(r'"(cablepod(?:\.\w+){2,})"', text))
    assert len(names) > 5
    for name in names:
        assert pkgutil.resolve_name(name), name


def test_jobs_take_turns():
    order = []
    results = _study.in_turns([lambda: order.append("a") or (1.0, 2.0), lambda: order.append("b") or (3.0, 5.0)], 3)
    assert order == ["a", "b"] * 3
    assert [_study.medians(rows) for rows in results] == [(1.0, 2.0), (3.0, 5.0)]


@pytest.mark.parametrize(
    ("path", "name"), [("compare.py", "compare"), ("condensed/_runs.py", "condensed"), ("paper/report.py", "paper")]
)
def test_files_have_a_sub_package(path, name):
    assert calls.sub_package(path) == name


def test_calls_across_count_what_leaves_a_folder():
    counter = calls.counted(lambda: scene("example2"))
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
