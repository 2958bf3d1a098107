"""What holds for the package as a whole: imports, their direction and their cost, names, docstrings."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import cablepod as cp

PACKAGE = Path(cp.__file__).parent

# Each module may import from those before it.
ORDER = (
    "interrupts", "conventions", "provenance", "kernels", "motion", "schema", "ranges", "parameters", "columns", "records",
    "scene_limits", "scene", "stepping",
    "members", "ensemble_design", "catenary", "training", "links", "runs", "verlet", "implicit",
    "chain_start", "chain_runs", "chain_many", "chain", "elements",
    "cable_runs", "cable_choice", "cable",
    "rigid_start", "rigid_runs", "rigid", "chord", "pod_normal", "decompositions", "threads", "streaming", "snapshots",
    "pod_stream", "pod", "compare", "trust", "condensed_model", "condensed_make", "condensed_output", "condensed_estimate",
    "galerkin_model", "galerkin_runs", "galerkin_estimate", "galerkin", "condensed_runs", "condensed_many", "condensed_batch",
    "condensed", "oblique",
    "plots", "whole", "archive_files", "archive_folder", "archive_ensemble", "archive",
    "lineage", "ensemble_work", "ensemble_store", "ensemble_runs", "ensemble", "shipped", "study", "paper", "cli",
    "__init__", "__main__",
)  # fmt: skip

# these work with files of results
KEEPERS = ("ensemble_work", "ensemble_store", "ensemble")


def imported(path):
    """Modules of the package that a file imports, at any place in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} has a relative import"
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name.split(".")[1] for name in found if name.startswith("cablepod.")} & set(ORDER)


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("*.py")), ids=lambda p: p.stem)
def test_imports_point_one_way(path):
    assert path.stem in ORDER, f"{path.stem} has no place in the order"
    allowed = set(ORDER[: ORDER.index(path.stem)])
    if path.stem not in ("study", "__init__", "__main__"):
        allowed -= {"plots"} if path.stem in KEEPERS else {"plots", "archive"}
    assert imported(path) <= allowed


@pytest.mark.parametrize("path", sorted((PACKAGE / "cli").glob("*.py")), ids=lambda p: p.stem)
def test_the_command_imports_what_stands_before_it(path):
    assert imported(path) <= set(ORDER[: ORDER.index("cli") + 1]) - {"plots"}


@pytest.mark.parametrize("path", sorted((PACKAGE / "plots").glob("*.py")), ids=lambda p: p.stem)
def test_figures_import_what_stands_before_them(path):
    assert imported(path) <= set(ORDER[: ORDER.index("plots") + 1]) - {"archive"}


@pytest.mark.parametrize("path", sorted((PACKAGE / "kernels").glob("*.py")), ids=lambda p: p.stem)
def test_kernels_know_nothing_of_the_package(path):
    tree = ast.parse(path.read_text())
    modules = {n.module.split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    modules |= {a.name.split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert modules <= {"__future__", "math", "numpy", "numba", "typing"}


def test_science_knows_no_file_clock_or_git():
    for path in PACKAGE.glob("*.py"):
        if path.stem in (
            "whole",
            "archive",
            "archive_files",
            "archive_ensemble",
            "archive_folder",
            *KEEPERS,
            "shipped",
            "__main__",
            "scene",
            "records",
        ):  # a scene is read from a file
            continue
        names = {n.id for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Name)}
        assert not names & {"open", "time_ns", "datetime", "subprocess", "socket", "platform"}, path.name


def fresh(code):
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


def test_importing_is_light():
    heavy = ["matplotlib", "netCDF4", "numba", "dask", "distributed", "scipy.linalg", "tqdm", "click"]
    code = "import xarray, sys; before = set(sys.modules); import cablepod; new = set(sys.modules) - before"
    loaded = fresh(f"{code}; print([name for name in {heavy} if name in new])")
    assert loaded.strip() == "[]"


def test_importing_adds_little_time():
    # a count of modules does not depend on the machine's load as a clock does; the clock is in pipelines/benchmarks.  There
    # are 70, mostly ours, of some 0.7 ms each; a library that slips in brings hundreds
    code = "import xarray, sys; before = set(sys.modules); import cablepod; print(len(set(sys.modules) - before))"
    assert int(fresh(code)) < 80


def test_public_names_have_docstrings_and_keyword_only_options():
    functions = [
        cp.read_scene, cp.make_scene, cp.catenary.rest, cp.chain.rest, cp.chain.simulate, cp.cable.rest,
        cp.cable.simulate, cp.cable.frequencies, cp.rigid.rest, cp.rigid.simulate, cp.pod.decompose, cp.pod.project,
        cp.pod.reconstruct, cp.galerkin.simulate, cp.condensed.simulate, cp.compare.errors, cp.archive.write, cp.archive.read,
        cp.plots.snapshots, cp.plots.tension, cp.plots.phase_portraits, cp.plots.parameter_map, cp.plots.stability,
        cp.plots.error_against_run_time,
        cp.archive.open_ensemble, cp.ensemble.run, cp.ensemble.batches,
    ]  # fmt: skip
    for function in functions:
        text = inspect.getdoc(function)
        assert text, function
        assert "Parameters" in text, function
        assert "Returns" in text or "return" in text.splitlines()[0], function
        for name, parameter in inspect.signature(function).parameters.items():
            assert name in text, f"{function.__name__} says nothing of {name}"
            if parameter.default is not inspect.Parameter.empty:
                assert parameter.kind is inspect.Parameter.KEYWORD_ONLY, f"{function.__name__}({name})"


def test_importing_changes_no_global_options():
    state = "(np.geterr(), np.get_printoptions(), dict(xr.core.options.OPTIONS))"
    code = f"import numpy as np, xarray as xr; before = {state}; import cablepod; print(before == {state})"
    assert fresh(code).strip() == "True"


def test_versions_agree():
    from importlib.metadata import version

    assert cp.__version__ == version("cablepod")
