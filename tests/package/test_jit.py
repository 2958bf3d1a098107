"""Compiled kernels: an edit of a kernel in another file is seen, and what did not change comes from the cache."""

from __future__ import annotations

import ast
import gc
import importlib
import pkgutil
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from children import environment, run_python
from numba.core.errors import TypingError
from suite import slow

import cablepod
from cablepod import _jit

CALLER = """
from cablepod._jit import compiled
from cablepod.inner._kernels_inner import inner


@compiled
def outer(x):
    return 2.0 * inner(x)
"""
INNER = """
from cablepod._jit import compiled


@compiled{options}
def inner(x):
    return x + {added}
"""
CALL = """
from cablepod.outer._kernels_outer import outer
print(outer(1.0), sum(outer.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("options", ["", slow('(inline="always")')])
def test_an_edit_in_another_file_is_seen(tmp_path, options):
    package = tmp_path / "cablepod"
    for name in ("inner", "outer"):
        (package / name).mkdir(parents=True)
        (package / name / "__init__.py").touch()
    (package / "__init__.py").touch()
    shutil.copy(Path(_jit.__file__), package / "_jit.py")
    (package / "outer" / "_kernels_outer.py").write_text(CALLER)

    def call(added):
        (package / "inner" / "_kernels_inner.py").write_text(INNER.format(options=options, added=added))
        done = run_python("-c", CALL, timeout=120, cwd=tmp_path, env={**environment(), "PYTHONPATH": ""})
        assert done.returncode == 0, done.stderr
        return tuple(map(float, done.stdout.split()))

    assert call(1.0) == (4.0, 0.0)
    assert call(10.0) == (22.0, 0.0)  # without the stamp of imported kernels the caller keeps the stale callee: 4.0
    (package / "inner" / "_kernels_other.py").write_text("no = 1\n")
    assert call(10.0) == (22.0, 1.0)  # from the cache: a file that is not imported does not count


def test_stamps_cover_every_import():
    """The stamp finds imports by their text; here they are found in the syntax tree."""
    root = Path(_jit.__file__).parent
    for path in sorted(root.glob("*/_kernels*.py")):
        tree = ast.parse(path.read_text())
        origins = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        modules = [node.module for node in origins]
        modules += [f"{node.module}.{name.name}" for node in origins for name in node.names]
        modules += [name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names]
        imported = {
            name.split(".", 1)[1] for name in modules if re.fullmatch(r"cablepod\.\w+\._(kernels|formulas)\w*", name)
        }
        found = {f"{file.parent.name}.{file.stem}" for file in _jit._with_imported(path)}
        assert imported <= found, path


@pytest.mark.parametrize("pattern", ["*.nbi", slow("*.nbc"), slow("*.nb?")])
@pytest.mark.parametrize("damage", ["truncated", slow("empty"), slow("other bytes")])
def test_a_damaged_cache_is_made_again(pattern, damage, tmp_path):
    package = tmp_path / "cablepod"
    (package / "inner").mkdir(parents=True)
    for folder in (package, package / "inner"):
        (folder / "__init__.py").touch()
    shutil.copy(Path(_jit.__file__), package / "_jit.py")
    (package / "inner" / "_kernels_inner.py").write_text(INNER.format(options="", added=1.0))

    def call():
        program = CALL.replace("outer", "inner")
        done = run_python("-c", program, timeout=120, cwd=tmp_path, env={**environment(), "PYTHONPATH": ""})
        assert done.returncode == 0, done.stderr
        return tuple(map(float, done.stdout.split()))

    assert call() == (2.0, 0.0)
    files = list(package.rglob(pattern))
    assert files
    for path in files:
        content = path.read_bytes()
        path.write_bytes({"truncated": content[: len(content) // 2], "empty": b"", "other bytes": b"x" * 500}[damage])
    assert call() == (2.0, 0.0)  # compiled again
    assert call() == (2.0, 1.0)  # and kept


def test_options_of_users_stay(monkeypatch):
    import numba

    before = numba.config.CACHE_LOCATOR_CLASSES

    @_jit.compiled
    def kernel(x):
        return x

    assert before == numba.config.CACHE_LOCATOR_CLASSES
    assert kernel(2.0) == 2.0


INTEGERS = """
from cablepod._jit import compiled


@compiled(literal=False)
def inner(x, row, scale):
    if scale is None:
        return x + row
    return scale * (x + row)


@compiled
def outer(x, rows):
    return inner(x, 1, None) + inner(x, 2, None) + inner(x, row=3, scale=2.0) + inner(x, rows, None)
"""


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """Write a module of kernels and import it."""

    def kernels(text):
        name = f"_kernels_of_{tmp_path.name}"
        (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.setitem(sys.modules, name, None)  # what is imported in its place goes with the test
        del sys.modules[name]
        return importlib.import_module(name)

    return kernels


def test_a_kernel_is_compiled_once_for_all_integers_and_anew_for_none(kernels):
    module = kernels(INTEGERS)
    assert module.outer(0.5, 4) == 15.5  # 1.5 + 2.5 + 2 * 3.5 + 4.5
    assert len(module.inner.signatures) == 2


QUICK = """
from cablepod._jit import REORDERED, compiled


@compiled
def inner(x):
    total = 0.0
    for i in range(x.size):
        total += x[i]
    return total


@compiled(fastmath=REORDERED, counted=False)
def outer(x):
    return inner(x)
"""


def test_a_kernel_does_not_take_options_over_from_the_first_that_calls_it(kernels):
    """Numba hands fast-math, inlining and counting of references down to kernels that do not say them."""
    module, x = kernels(QUICK), np.random.default_rng(1).random(1000)
    module.outer(x)
    # in the order written: a reordered sum differs in its last digits
    assert module.inner(x) == sum(x.tolist()[1:], x[0])
    assert len(module.inner.signatures) == 1


@pytest.mark.parametrize("collecting", [True, False])
def test_the_search_for_garbage_goes_on_after_a_compilation(collecting):
    before, during = gc.isenabled(), []

    @_jit.compiled
    def kernel(x):
        return 2.0 * x

    (gc.enable if collecting else gc.disable)()
    try:
        assert kernel(2.0) == 4.0
        during.append(gc.isenabled())
        with pytest.raises(TypingError):
            kernel(None)
        during.append(gc.isenabled())
    finally:
        (gc.enable if before else gc.disable)()
    assert during == [collecting] * 2


def test_kernels_that_take_arrays_from_an_uncounted_one_count_no_references_either():
    # a counted caller would free the arrays that _of_member returns, which count for the arguments
    names = [item.name for item in pkgutil.walk_packages(cablepod.__path__, "cablepod.") if "._kernels" in item.name]
    modules = [importlib.import_module(name) for name in names]
    kernels = {kernel for module in modules for kernel in vars(module).values() if hasattr(kernel, "py_func")}
    callers = [kernel for kernel in kernels if "_of_member" in kernel.py_func.__code__.co_names]
    assert callers
    assert [kernel.py_func.__qualname__ for kernel in callers if kernel.targetoptions.get("_nrt") is not False] == []
