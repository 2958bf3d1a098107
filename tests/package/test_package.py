"""What holds for the package as a whole: science apart from files and clocks, the cost of its import, names, docstrings."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest
from public_calls import public_functions

import cablepod as cp

PACKAGE = Path(cp.__file__).parent
#: Sub-packages and modules that work on Datasets and arrays alone.
SCIENCE = (
    "conventions", "errors", "provenance", "parameters", "catenary", "batch", "discretisation", "integrate", "pod", "reduced",
    "wind", "chain", "compare", "fatigue", "cable", "rigid", "condensed", "galerkin",
)  # fmt: skip
#: Functions and modules for files, clocks, processes and the machine.
OUTSIDE = {
    "open", "os", "io", "pathlib", "shutil", "tempfile", "time", "datetime", "subprocess", "socket", "platform", "git",
}  # fmt: skip


def outside(text: str) -> set[str]:
    """Return the names of :data:`OUTSIDE` that a module imports or calls."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").partition(".")[0])
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            names.add(node.func.id if isinstance(node.func, ast.Name) else node.func.attr)
    return names & OUTSIDE


def test_science_knows_no_file_clock_or_git():
    for unit in SCIENCE:
        paths = sorted((PACKAGE / unit).rglob("*.py")) or [PACKAGE / f"{unit}.py"]
        assert {str(path): names for path in paths if (names := outside(path.read_text()))} == {}


@pytest.mark.parametrize(
    "text", ["import os.path", "from pathlib import Path", "def f():\n    import time", "open('x')", "path.open()"]
)
def test_a_file_or_clock_is_seen(text):
    assert len(outside(text)) == 1


def fresh(code):
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


#: Import of the package and of all that it loads at its first use.
LOAD_ALL = "import cablepod; [getattr(cablepod, name) for name in cablepod.__all__]"


def test_importing_is_light_and_changes_no_global_options():
    options = "(np.geterr(), np.get_printoptions(), dict(xr.core.options.OPTIONS))"
    code = f"import sys, numpy as np, xarray as xr; before, options = set(sys.modules), {options}; {LOAD_ALL}"
    code += f"; print(sorted(set(sys.modules) - before)); print(options == {options})"
    loaded, unchanged = fresh(code).splitlines()
    others = {name for name in ast.literal_eval(loaded) if name.partition(".")[0] != "cablepod"}
    assert not others & {"matplotlib", "netCDF4", "numba", "dask", "distributed", "scipy.linalg", "tqdm", "click"}
    # a count does not depend on the machine's load as a clock does; the clock is in pipelines/benchmarks
    assert len(others) < 10, others  # four of tomllib
    assert unchanged == "True"


#: Optional arguments that may be positional: the second Dataset of a figure, ranges of a design, folder of a study, modes of a
#: mast.
POSITIONAL = {
    ("design", "ranges"), ("animate", "reduced"), ("rest", "chain"), ("shapes", "reduced"), ("run", "out"),
    ("simulate", "modes"),
}  # fmt: skip


def test_public_names_say_what_they_return_and_have_keyword_only_options():
    for name, function in public_functions().items():
        text = inspect.getdoc(function)
        assert "Returns" in text or "return" in text.splitlines()[0] or function.__name__ == "at_times", name
        for option, parameter in inspect.signature(function).parameters.items():
            if parameter.default is not inspect.Parameter.empty and (function.__name__, option) not in POSITIONAL:
                assert parameter.kind is inspect.Parameter.KEYWORD_ONLY, f"{name}({option})"


def test_sub_packages_are_loaded_at_their_first_use():
    code = "import sys, cablepod; own = lambda: {name for name in sys.modules if name.startswith('cablepod.')}"
    alone, cleared, used, missing = fresh(
        f"{code}; print(own()); cablepod.clear_caches(); print(own()); "
        "cablepod.catenary; print('cablepod.catenary' in own(), 'cablepod.chain' in own()); "
        "print(hasattr(cablepod, 'kernels'), dir(cablepod) == sorted([*cablepod.__all__, '__version__']))"
    ).splitlines()
    assert (alone, ast.literal_eval(cleared)) == ("set()", {f"{cp.__name__}._caches"})
    assert (used, missing) == ("True False", "False True")


def test_versions_agree():
    from importlib.metadata import version

    assert cp.__version__ == version("cablepod")
