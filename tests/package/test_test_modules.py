"""Tests stand alone: none imports another one (what several need is in modules of its own), none needs a terminal."""

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
        "import test_chain", "from test_chain import positions", "from tests.chain import test_motion",
        "from tests.chain.test_motion import positions", "from . import test_motion", "from conftest import SOFT",
        "def f():\n    from test_chain import positions",
    ],
)  # fmt: skip
def test_an_import_of_a_test_is_found(tmp_path, text):
    (tmp_path / "test_it.py").write_text(text)
    (tmp_path / "test_other.py").write_text("import numpy as np\nfrom scenes import SOFT\n")
    assert len(imports_of_tests(tmp_path)) == 1


def senders_without_ctrl_c(text: str) -> list[str]:
    """Functions that name SIGINT without the fixture `ctrl_c`, which may also be taken by one for the whole module."""
    if "SIGINT" not in text:
        return []
    functions = [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    taking = [
        function
        for function in functions
        if "ctrl_c" in {argument.arg for argument in function.args.args}
        or any("usefixtures('ctrl_c')" in ast.unparse(decorator) for decorator in function.decorator_list)
    ]
    if any("autouse=True" in ast.unparse(decorator) for function in taking for decorator in function.decorator_list):
        return []
    return [function.name for function in functions if function not in taking and "SIGINT" in ast.unparse(function)]


def test_what_sends_ctrl_c_does_so_in_the_background_too():
    paths = [path for path in TESTS.rglob("test_*.py") if path != Path(__file__).resolve()]
    assert {str(path): found for path in paths if (found := senders_without_ctrl_c(path.read_text()))} == {}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("def test_it():\n    os.kill(pid, signal.SIGINT)", ["test_it"]),
        ("@parametrize('sign', [signal.SIGINT])\ndef test_it(sign):\n    os.kill(pid, sign)", ["test_it"]),
        ("@mark.usefixtures('ctrl_c')\ndef test_it():\n    os.kill(pid, signal.SIGINT)", []),
        ("def test_it(ctrl_c):\n    os.kill(pid, signal.SIGINT)", []),
        ("@fixture(autouse=True)\ndef f(ctrl_c):\n    yield\n\ndef test_it():\n    raise_signal(SIGINT)", []),
        ("@fixture\ndef f(ctrl_c):\n    yield\n\ndef test_it():\n    raise_signal(SIGINT)", ["test_it"]),
    ],
)
def test_a_sender_without_ctrl_c_is_found(text, found):
    assert senders_without_ctrl_c(text) == found
