"""What a command prints of a scene that is given by its nested tables."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

from cablepod.cli import main


def as_toml(value: Any) -> str:
    """Write a value of a scene as TOML, tables within one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {as_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    return json.dumps(value)


def printed(folder: Path, tables: dict[str, Any], command: str = "check", *options: str) -> str:
    """Return what a command prints of the scene of these tables; its file is kept in a folder, and results below `out`."""
    path = folder / "scene.toml"
    path.write_text("".join(f"{name} = {as_toml(table)}\n" for name, table in tables.items()))
    if command == "run":
        options += ("--out", str(folder / "out"), "--overwrite")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([command, str(path), *options]) == 0
    return out.getvalue()
