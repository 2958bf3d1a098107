"""Atomic replacement of files."""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def atomic_file(path: Path, *, check: Callable[[], None] | None = None) -> Iterator[Path]:
    """Provide a temporary path that replaces `path` on exit, or is removed on an error.

    The file is flushed to the disk first.  `check` is called just before the renaming, because another process may have created
    the file meanwhile.
    """
    part = path.parent / f".cablepod-{uuid.uuid4().hex}.part"
    try:
        yield part
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        if check is not None:
            check()
        os.replace(part, path)
    finally:  # also after Ctrl-C
        _discard(part)
    _sync_folder(path.parent)


def _discard(part: Path) -> None:
    """Truncate and remove `part` if it exists."""
    with contextlib.suppress(FileNotFoundError):
        os.truncate(part, 0)  # frees the space even if a failed library keeps the file open
        part.unlink()


def _sync_folder(folder: Path) -> None:
    """Flush the folder entry of a new file to the disk, where the system allows it."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
