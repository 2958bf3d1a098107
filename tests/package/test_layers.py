"""The direction of imports between sub-packages, the rules of kernels, cycles, and the size of files.

Every check takes the folder of a package and returns its violations, one a line; each one is seen to fail on a small package.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import pytest

import cablepod

PACKAGE = Path(cablepod.__file__).parent

#: Sub-packages and modules by level.  Each may import from lower levels, and within itself.
LAYERS = (
    ("conventions", "errors", "_caches", "_jit"),
    ("provenance",),
    ("parameters", "_resources"),
    ("_inputs",),
    ("catenary", "batch"),
    ("_models",),
    ("scene", "discretisation", "archive"),
    ("integrate", "pod", "reduced", "examples", "wind"),
    ("chain", "compare", "extremes", "fatigue", "plots"),
    ("cable", "rigid", "condensed"),
    ("galerkin", "mast", "periodic"),
    ("ensemble", "paper"),
    ("study",),
    ("cli",),
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
#: The facade and the command: they stand above all levels.
TOP = ("__init__", "__main__")
#: Public modules of names for scripts, and the sub-package that each takes them from.  The package itself does not import them.
ALIASES = {"lineage": "archive"}
#: Public names that belong to a sub-package by their subject and stand in one of a higher level, which has what they need; they
#: are loaded when they are asked for.
FORWARDED = (("catenary", "cable._stringing"),)
#: Science works on Datasets: only these know the files of results.
USERS_OF_ARCHIVE = ("archive", "ensemble", "study", "paper", "cli", "lineage", *TOP)
#: What a kernel imports, beside other kernels.
IMPORTS_OF_KERNELS = ("__future__", "math", "operator", "typing", "numpy", "numba", "llvmlite")
#: What others may take of the archive: a page is written as a whole, as files of results are.
WRITING_OF_FILES = {("plots", "cablepod.archive._atomic")}
MAX_TOP_MODULES = 12
MAX_CODE_LINES = 400
MAX_LINES = 450


class Import(NamedTuple):
    """One imported module: importer and target by dotted name, place in the file, and whether it runs at import time."""

    importer: str
    target: str
    place: str
    at_import: bool


# --- reading ------------------------------------------------------------------------------------------------------------


def modules_of(package: Path) -> dict[str, Path]:
    """Files of a package by dotted name; a sub-package is the name of its ``__init__``."""
    names = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


def statements(node: ast.AST, at_import: bool = True) -> Iterator[tuple[ast.AST, bool]]:
    """Go through a tree; tell of each node whether it runs when the module is imported."""
    inside = at_import and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
    for child in ast.iter_child_nodes(node):
        typing = isinstance(node, ast.If) and child in node.body and "TYPE_CHECKING" in ast.unparse(node.test)
        yield child, inside and not typing
        yield from statements(child, inside and not typing)


def imports_of(package: Path) -> tuple[Import, ...]:
    """Imports of every module of a package, from it and from elsewhere, lazy ones too."""
    return _imports(
        tuple((name, str(path.relative_to(package)), path.read_text()) for name, path in modules_of(package).items())
    )


@lru_cache  # all checks read the same package
def _imports(files: tuple[tuple[str, str, str], ...]) -> tuple[Import, ...]:
    """Imports of modules, each given by its dotted name, its file and its text."""
    return tuple(_each_import(files))


def name_of(function: ast.expr) -> str:
    """Return the name of a function that is called, without its module."""
    return getattr(function, "attr", getattr(function, "id", ""))


def _each_import(files: tuple[tuple[str, str, str], ...]) -> Iterator[Import]:
    modules = {name for name, _, _ in files}
    for importer, path, text in files:
        for node, at_import in statements(ast.parse(text)):
            if isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                parent = "." * node.level + (node.module or "")
                full = [f"{parent}.{alias.name}" for alias in node.names]
                targets = [name if name in modules else parent for name in full]
            elif isinstance(node, ast.Call) and name_of(node.func) in ("import_module", "__import__"):
                targets = [item.value for item in node.args[:1] if isinstance(item, ast.Constant)]
            else:
                continue
            place = f"{path}:{node.lineno}"
            yield from (Import(importer, target, place, at_import) for target in dict.fromkeys(targets))


def unit_of(package: Path, module: str) -> str:
    """Return the sub-package, or the module directly in the package, that a module belongs to."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[0] == package.name else "__init__"


def inner_imports(package: Path) -> Iterator[tuple[Import, str, str]]:
    """Imports from the package itself, with the units of importer and target."""
    for item in imports_of(package):
        if item.target.split(".")[0] == package.name:
            yield item, unit_of(package, item.importer), unit_of(package, item.target)


# --- checks -------------------------------------------------------------------------------------------------------------


def upward_imports(package: Path) -> list[str]:
    """Imports from the same or a higher level, from the facade, and units without a level."""
    units = {unit_of(package, module) for module in modules_of(package)}
    found = [f"{unit}: has no level" for unit in sorted(units - {*LEVEL, *ALIASES, *TOP})]
    for item, importer, target in inner_imports(package):
        if importer in TOP or importer == target:
            continue
        allowed = LEVEL.get(target, len(LAYERS)) < LEVEL.get(importer, -1)
        if importer in ALIASES:
            allowed = target == ALIASES[importer]
        module = item.target.removeprefix(f"{package.name}.")
        if (importer, module) in FORWARDED and item.importer == f"{package.name}.{importer}" and not item.at_import:
            allowed = True
        if not allowed:
            found.append(f"{item.place}: {importer} imports {target}")
    return found


def uses_of_the_archive(package: Path) -> list[str]:
    """Imports of the archive by units that work on Datasets alone."""
    return [
        f"{item.place}: {importer} imports archive"
        for item, importer, target in inner_imports(package)
        if target in ("archive", "lineage")
        and importer not in USERS_OF_ARCHIVE
        and (importer, item.target) not in WRITING_OF_FILES
    ]


def imports_in_kernels(package: Path) -> list[str]:
    """Imports of kernels from other than numerical libraries, compiler options, kernels and formulas; formulas import none."""
    found = []
    for item in imports_of(package):
        importer, target = (name.rpartition(".")[2] for name in (item.importer, item.target))
        if not importer.startswith(("_kernels", "_formulas")):
            continue
        own = item.target.split(".")[0] == package.name
        compiled = item.target == f"{package.name}._jit" or target.startswith(("_kernels", "_formulas"))
        allowed = compiled and importer.startswith("_kernels")  # formulas are imported without the compiler
        if not (allowed if own else item.target.split(".")[0] in IMPORTS_OF_KERNELS):
            found.append(f"{item.place}: a kernel imports {item.target}")
    return found


def relative_imports(package: Path) -> list[str]:
    """Imports that do not name the package."""
    return [f"{item.place}: relative import of {item.target}" for item in imports_of(package) if item.target[:1] == "."]


def import_cycles(package: Path) -> list[str]:
    """Modules that need each other when they are imported."""
    modules = modules_of(package)
    needs: dict[str, set[str]] = {module: set() for module in modules}
    for item in imports_of(package):
        if not item.at_import or item.target not in modules:
            continue
        needs[item.importer].add(item.target)
        parent = item.target.rpartition(".")[0]
        while "." in parent:  # its sub-package runs first, if this is not within it
            if not f"{item.importer}.".startswith(f"{parent}."):
                needs[item.importer].add(parent)
            parent = parent.rpartition(".")[0]
    reached = {}
    for module in modules:
        seen, waiting = set(), [module]
        while waiting:
            new = needs[waiting.pop()] - seen
            seen |= new
            waiting += new
        reached[module] = seen
    cycles = {
        frozenset({module, *(other for other in reached[module] if module in reached[other])})
        for module in modules
        if module in reached[module]
    }
    return sorted("cycle: " + ", ".join(sorted(cycle)) for cycle in cycles)


def crowded_top(package: Path) -> list[str]:
    """More modules directly in the package than it may have, the facade and aliases included."""
    names = sorted(path.stem for path in package.glob("*.py"))
    more = len(names) > MAX_TOP_MODULES
    return [f"{len(names)} modules, at most {MAX_TOP_MODULES}: {', '.join(names)}"] if more else []


def code_lines(text: str) -> int:
    """Count lines of code: neither blank, nor comment, nor docstring."""
    documented: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            documented.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    silent = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in silent:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - documented)


def long_files(package: Path) -> list[str]:
    """Files longer than a reader takes in."""
    found = []
    for path in modules_of(package).values():
        text = path.read_text()
        total = len(text.splitlines())
        code = code_lines(text) if total > MAX_CODE_LINES else total  # to count takes seconds for all files
        if code > MAX_CODE_LINES or total > MAX_LINES:
            found.append(
                f"{path.relative_to(package)}: {code} lines of code, {total} in all; "
                f"at most {MAX_CODE_LINES} and {MAX_LINES}"
            )
    return found


CHECKS: tuple[Callable[[Path], list[str]], ...] = (
    upward_imports, uses_of_the_archive, imports_in_kernels, relative_imports, import_cycles, crowded_top, long_files,
)  # fmt: skip

# --- each check is seen to pass and to fail -------------------------------------------------------------------------------

#: A package that keeps all rules, with what is allowed at the edge.
GOOD = {
    "__init__.py": "from cablepod import archive, chain\n",
    "__main__.py": "from cablepod.cli import main\n",
    "_jit.py": "import numba\n",
    "conventions.py": "import numpy as np\n",
    "lineage.py": "from cablepod.archive._lineage import check\n",
    "parameters/__init__.py": "from cablepod.parameters._keys import KEYS\n",
    "parameters/_keys.py": "from cablepod import conventions\nKEYS = 1\n",
    "parameters/_kernels_sines.py": "import math\nfrom cablepod._jit import kernel\n",
    "archive/__init__.py": "from cablepod.archive._lineage import check\n",
    "archive/_lineage.py": "def check():\n    from cablepod.parameters import KEYS\n    return KEYS\n",
    "chain/__init__.py": "from cablepod.chain._simulate import simulate\n",
    "chain/_simulate.py": (
        "from cablepod.chain import _kernels\nfrom cablepod.parameters._keys import KEYS\ndef simulate(): ...\n"
    ),
    "chain/_kernels.py": (
        "import numpy as np\nfrom numba import njit\nfrom cablepod.parameters import _kernels_sines\n"
        "from cablepod.chain import _kernels_links\n"
    ),
    "chain/_kernels_links.py": "from typing import NamedTuple\n",
    "cli/__init__.py": "def main():\n    from cablepod import archive, chain\n",
}


@pytest.fixture
def package(tmp_path: Path) -> Callable[..., Path]:
    """Write the good package, some of its files replaced."""

    def write(files: dict[str, str]) -> Path:
        for name, text in {**GOOD, **files}.items():
            path = tmp_path / "cablepod" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path / "cablepod"

    return write


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_a_good_package_has_no_violation(package, check):
    assert check(package({})) == []


def test_a_forwarded_name_is_no_violation(package):
    text = "def __getattr__(name):\n    import_module('cablepod.cable._stringing')\n"
    assert upward_imports(package({"catenary/__init__.py": text})) == []


@pytest.mark.parametrize(
    ("check", "files", "found"),
    [
        (upward_imports, {"parameters/_keys.py": "import cablepod.chain\n"}, ["_keys.py:1: parameters imports chain"]),
        (upward_imports, {"parameters/_keys.py": "from cablepod import chain\n"}, [":1: parameters imports chain"]),
        (upward_imports, {"parameters/_keys.py": "def f():\n    from cablepod.chain import x\n"}, [":2: parameters imp"]),
        (upward_imports, {"parameters/_keys.py": "import_module('cablepod.chain')\n"}, ["parameters imports chain"]),
        (upward_imports, {"compare.py": "from cablepod.chain import simulate\n"}, ["compare imports chain"]),  # same level
        (upward_imports, {"conventions.py": "from cablepod import errors\n", "errors.py": ""}, ["conventions imports errors"]),
        (upward_imports, {"compare.py": "from cablepod import __version__\n"}, ["compare imports __init__"]),
        (upward_imports, {"compare.py": "import cablepod as cp\n"}, ["compare imports __init__"]),
        (upward_imports, {"utils.py": ""}, ["utils: has no level"]),
        (upward_imports, {"cli/__init__.py": "from cablepod import lineage\n"}, ["cli imports lineage"]),
        (upward_imports, {"lineage.py": "from cablepod import chain\n"}, ["lineage imports chain"]),
        (uses_of_the_archive, {"plots/_maps.py": "def f():\n    from cablepod.archive import read\n"}, ["plots imports"]),
        (
            uses_of_the_archive,
            {
                "archive/_atomic.py": "",
                "plots/_page.py": "from cablepod.archive._atomic import atomic_file\n",
                "compare.py": "from cablepod.archive._atomic import atomic_file\n",
            },
            ["compare imports"],
        ),
        (imports_in_kernels, {"chain/_kernels.py": "import scipy.linalg\n"}, ["a kernel imports scipy.linalg"]),
        (
            upward_imports,  # forwarded names are loaded when they are asked for, by the sub-package itself
            {"catenary/__init__.py": "import_module('cablepod.cable._stringing')\n"},
            ["catenary imports cable"],
        ),
        (
            upward_imports,
            {"catenary/_rest.py": "def f():\n    import_module('cablepod.cable._stringing')\n"},
            ["catenary imports cable"],
        ),
        (
            upward_imports,
            {"catenary/__init__.py": "def f():\n    import_module('cablepod.cable._mesh')\n"},
            ["catenary imports cable"],
        ),
        (imports_in_kernels, {"chain/_kernels.py": "from cablepod.chain import _simulate\n"}, ["cablepod.chain._simulate"]),
        (imports_in_kernels, {"chain/_kernels.py": "from cablepod import conventions\n"}, ["cablepod.conventions"]),
        (imports_in_kernels, {"chain/_formulas.py": "from cablepod._jit import kernel\n"}, ["cablepod._jit"]),
        (relative_imports, {"chain/_simulate.py": "from . import _kernels\n"}, ["_simulate.py:1: relative import"]),
        (relative_imports, {"chain/_simulate.py": "def f():\n    from ..chain import x\n"}, ["_simulate.py:2: relative"]),
        (
            import_cycles,
            {"chain/_kernels_links.py": "from cablepod.chain import _kernels\n"},
            ["cycle: cablepod.chain._kernels, cablepod.chain._kernels_links"],
        ),
        (
            import_cycles,  # by way of the sub-package of what is imported
            {"parameters/_keys.py": "from cablepod.chain import _kernels_links\n"},
            ["cablepod.chain, cablepod.chain._kernels, cablepod.chain._simulate, cablepod.parameters"],
        ),
        (import_cycles, {"chain/_simulate.py": "from cablepod.chain import simulate\n"}, ["cablepod.chain, cablepod.chain."]),
        (import_cycles, {"conventions.py": "from cablepod import x\n"}, ["cycle: cablepod, cablepod.chain"]),
        (import_cycles, {"conventions.py": "if True:\n    import cablepod.conventions\n"}, ["cycle: cablepod.conventions"]),
        (crowded_top, {f"more{i}.py": "" for i in range(8)}, ["13 modules, at most 12: __init__, __main__, _jit"]),
        (long_files, {"conventions.py": "x = 1\n" * 401}, ["conventions.py: 401 lines of code, 401 in all; at most 400"]),
        (long_files, {"conventions.py": "# of no use\n" * 451}, ["conventions.py: 0 lines of code, 451 in all"]),
    ],
)  # fmt: skip
def test_a_violation_is_found(package, check, files, found):
    said = check(package(files))
    assert len(said) == len(found), said
    assert all(text in line for line, text in zip(said, found, strict=True)), said


@pytest.mark.parametrize(
    "text",
    [
        "if TYPE_CHECKING:\n    from cablepod.chain import _kernels\n",
        "def f():\n    from cablepod.chain import _kernels\n",
        "f = lambda: __import__('cablepod.chain._kernels')\n",
    ],
)
def test_imports_that_do_not_run_at_import_time_make_no_cycle(package, text):
    assert import_cycles(package({"chain/_kernels_links.py": text})) == []


def test_lines_of_code_are_counted():
    text = """
'''Of

two.'''

# a comment
x = [
    1,  # one

]


def f():
    '''Do.'''
    y = '''a
    b'''
    return y
"""
    assert code_lines(text) == 7  # three of x, one of def, two of y, one of return


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_package_keeps_the_rules(check):
    assert check(PACKAGE) == []
