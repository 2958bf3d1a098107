"""Tests stand alone: no module of tests imports another one; what several need is in modules of its own."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from scenes import TESTS


def imports_of_tests(folder: Path) -> list[str]:
    """Imports of test modules or of conftest by modules below a folder, lazy ones too."""
    found = []
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = ["." * node.level + (node.module or ""), *(alias.name for alias in node.names)]
            else:
                continue
            parts = {part for name in names for part in name.split(".")}
            if any(part.startswith("test_") or part in ("conftest", "tests") for part in parts):
                found.append(f"{path.relative_to(folder)}:{node.lineno}: {ast.unparse(node)}")
    return found


def test_no_test_imports_another():
    assert imports_of_tests(TESTS) == []


@pytest.mark.parametrize(
    "text",
    [
        "import test_chain",
        "from test_chain import positions",
        "from tests.chain import test_motion",
        "from tests.chain.test_motion import positions",
        "from . import test_motion",
        "from conftest import SOFT",
        "def f():\n    from test_chain import positions",
    ],
)
def test_an_import_of_a_test_is_found(tmp_path, text):
    (tmp_path / "test_it.py").write_text(text)
    (tmp_path / "test_other.py").write_text("import numpy as np\nfrom scenes import SOFT\n")
    assert len(imports_of_tests(tmp_path)) == 1
