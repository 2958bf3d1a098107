"""The folder for the results of one study."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cablepod.errors import ArchiveError, shown


def path_of(path: Any, *, key: str = "path", allowed: str = "a path, as text or pathlib.Path") -> Path:
    """Return a path; refuse what is none."""
    if not isinstance(path, str | os.PathLike) or not str(path):
        raise ArchiveError(f"{key}: given {shown(path)}; allowed: {allowed}")
    return Path(path)


def prepare_folder(out: Path, files: Sequence[str], *, overwrite: bool, key: str = "out") -> None:
    """Create the folder for results; refuse one that is not writable or contains one of `files`, or remove these.

    A study need not write all of them: what it leaves out would be the result of another scene.  Messages name the argument
    `key`.

    Raises
    ------
    ArchiveError
        If the folder cannot be created or written, or contains one of `files` and `overwrite` is false.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArchiveError(f"{key}: given {out}, which is or lies below a file; allowed: a folder") from None
    except OSError as error:
        raise ArchiveError(
            f"{key}: given {out}, which cannot be created: {error.strerror}; allowed: a folder"
        ) from None
    probe = out / f".cablepod-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink(missing_ok=True)
    except OSError as error:
        raise ArchiveError(
            f"{key}: given {out}, which cannot be written: {error.strerror}; allowed: a folder"
        ) from None
    existing = [name for name in files if (out / name).exists()]
    if existing and not overwrite:
        raise ArchiveError(
            f"{key}: given {out}, which has {', '.join(existing)} already; "
            "allowed: another folder, or overwrite=True to replace them"
        )
    for name in existing:
        try:
            (out / name).unlink()
        except OSError as error:
            raise ArchiveError(
                f"{key}: given {out}, where {name} cannot be removed: {error.strerror}; allowed: a folder"
            ) from None
