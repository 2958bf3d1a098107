"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def atomic_file(path: Path, *, check: Callable[[], None] | None = None) -> Iterator[Path]:
    """Give a path beside `path` to write to; on leaving it is flushed to the disk and renamed, or on any error removed.

    `check` is called just before the renaming, for a long write leaves time for somebody else's file.
    """
    part = path.parent / f".cablepod-{uuid.uuid4().hex}.part"
    try:
        yield part
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        if check is not None:
            check()
        os.replace(part, path)
    finally:  # also when interrupted
        _discard(part)
    _sync_folder(path.parent)


def _discard(part: Path) -> None:
    """Remove `part` if it is still there, and its contents first: a library that failed may hold it and its space."""
    with contextlib.suppress(FileNotFoundError):
        os.truncate(part, 0)
        part.unlink()


def _sync_folder(folder: Path) -> None:
    # The file is whole and in place; without this its name may not outlive a power cut, and not every system offers it.
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
