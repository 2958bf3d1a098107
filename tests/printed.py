"""What a command prints of a scene that is given by its nested tables."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

from scene_files import toml_of

from cablepod.cli import main


def printed(folder: Path, tables: dict[str, Any], command: str = "check", *options: str) -> str:
    """Return what a command prints of the scene of these tables; its file is kept in a folder, and results below `out`."""
    path = folder / "scene.toml"
    path.write_text(toml_of(tables))
    if command == "run":
        options += ("--out", str(folder / "out"), "--overwrite")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([command, str(path), *options]) == 0
    return out.getvalue()
