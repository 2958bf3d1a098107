"""Child processes that tests start: Python with the package under test, and the command."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from scenes import TESTS

import cablepod

#: Folder that holds the package under test: the checkout, or where it is installed.
INSTALLED = Path(cablepod.__file__).parents[1]


def environment() -> dict[str, str]:
    """Environment in which a child process finds the package and the shared modules of the tests."""
    path = [str(INSTALLED), str(TESTS), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))}


def python(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Start Python with these arguments; its outputs are read as text."""
    command = [sys.executable, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=environment(), **(pipes | options))


def finish(process: subprocess.Popen[str], *, timeout: float) -> tuple[str, str]:
    """Wait for a process at most for `timeout` seconds, then kill it; return its two outputs."""
    try:
        return process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise


def run_python(*arguments: object, timeout: float, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with these arguments until it ends, at most for `timeout` seconds."""
    command = [sys.executable, *map(str, arguments)]
    options = {"env": environment(), **options}
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False, **options)


def call(*arguments: object, timeout: float = 300.0, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command until it ends."""
    return run_python("-m", "cablepod", *arguments, timeout=timeout, **options)


def without_progress(text: str) -> str:
    """Leave out the lines that tell of progress and compilation, which depend on the load of the machine and on its caches."""
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if not re.search(r": \d+ % after \d+ s|: compiling, once", line))
