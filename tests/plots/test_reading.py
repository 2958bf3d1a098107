"""Plots read the variables of their Datasets through one check of names, types, dimensions and units."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import cablepod.plots

FOLDER = Path(cablepod.plots.__file__).parent
#: Files that check columns by names of their own: maps, whose variables the caller names, tables of pipelines, and pages, which
#: show of any result what it has.
OTHERS = ("_maps.py", "_reports.py", "_page_figures.py", "_page_trust.py")


def datasets_of(function: ast.FunctionDef) -> set[str]:
    """Names of the Datasets among the arguments of a function, and of loops over them."""
    arguments = [*function.args.args, *function.args.kwonlyargs, *filter(None, [function.args.vararg])]
    names = {a.arg for a in arguments if a.annotation is not None and "xr.Dataset" in ast.unparse(a.annotation)}
    for node in ast.walk(function):
        if isinstance(node, ast.For) and isinstance(node.iter, ast.Name) and node.iter.id in names:
            names.add(ast.unparse(node.target))
    return names


def unchecked(source: str) -> list[str]:
    """Reads of a variable by its name from a Dataset that a function is given, as text."""
    found = []
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef):
            continue
        names = datasets_of(function)
        for node in ast.walk(function):
            if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
                of = node.value.value if isinstance(node.value, ast.Subscript) else node.value
                key = node.slice
                is_name = isinstance(key, ast.JoinedStr) or (
                    isinstance(key, ast.Constant) and isinstance(key.value, str)
                )
                if is_name and isinstance(of, ast.Name) and of.id in names:
                    found.append(ast.unparse(node))
    return found


@pytest.mark.parametrize("file", sorted(path.name for path in FOLDER.glob("_*.py") if path.name not in OTHERS))
def test_no_variable_is_read_without_a_check(file):
    assert not unchecked((FOLDER / file).read_text(encoding="utf-8"))


def test_a_read_without_a_check_is_found():
    lines = (
        "def f(run: xr.Dataset, *runs: xr.Dataset):",
        "    run['x'].values; runs[0]['y']; run.attrs['z']",
        "    for one in runs: one[f'{w}']",
    )
    assert sorted(unchecked("\n".join(lines))) == ["one[f'{w}']", "run['x']", "runs[0]['y']"]
