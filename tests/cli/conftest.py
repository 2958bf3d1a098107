"""Fixtures of the tests of the command."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from scenes import SOFT_TOML

from cablepod import cli


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """The file of a soft, small scene."""
    path = tmp_path / "small.toml"
    path.write_text(SOFT_TOML)
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return a function that gives the command wrong arguments, and returns the one line that it says."""

    def said(*arguments: object) -> str:
        assert cli.main([str(argument) for argument in arguments]) == 2, arguments
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("cablepod: ")
        assert err.count("\n") == 1
        return err

    return said
