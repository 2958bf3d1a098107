"""Fixtures and rules of all tests."""

from __future__ import annotations

import copy
import math
import platform
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scene_files import EVERYTHING, RECORD
from scenes import SCENES, SOFT
from suite import (
    no_process_left_behind,
    pytest_addoption,
    pytest_collection,
    pytest_collection_finish,
    pytest_collection_modifyitems,
    pytest_configure,
    pytest_report_header,
    pytest_runtest_setup,
    pytest_xdist_make_scheduler,
)

from cablepod.archive import _checked
from cablepod.scene import _limits as scene_limits

#: The rules; pytest finds them here by their names.
__all__ = [
    "no_process_left_behind", "pytest_addoption", "pytest_collection", "pytest_collection_finish",
    "pytest_collection_modifyitems", "pytest_configure", "pytest_report_header", "pytest_runtest_setup",
    "pytest_xdist_make_scheduler",
]  # fmt: skip


@pytest.fixture
def soft() -> dict[str, Any]:
    """A mapping of a soft, small scene, to be changed at will."""
    return copy.deepcopy(SOFT)


@pytest.fixture
def scenes() -> Path:
    """The folder of the shipped scenes."""
    return SCENES


@pytest.fixture
def scene_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a scene of every table and its record, and the current one: so that file and values find the record."""
    (tmp_path / "scene.toml").write_text(EVERYTHING)
    (tmp_path / "record.csv").write_text(RECORD)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Let SIGINT raise KeyboardInterrupt, also in child processes, where the tests run in the background and ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def any_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let scenes pass whose loads no cable bears: such runs are sure to leave the finite numbers."""
    monkeypatch.setattr(scene_limits, "MAX_STRAIN", math.inf)


@pytest.fixture
def large_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let files be read as those are that are too large for all their bytes to be compared first."""
    monkeypatch.setattr(_checked, "WHOLE", 0)


@pytest.fixture
def without_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not search for what changed in a damaged file, which takes two seconds in a process of its own."""

    def hangs(command: Any, **options: Any) -> None:
        raise subprocess.TimeoutExpired(command, 0.0)

    platform.platform()  # which runs a process the first time
    monkeypatch.setattr(subprocess, "run", hangs)
