"""The folder of the results of one study."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from cablepod.errors import ArchiveError


def prepare_folder(out: Path, files: Sequence[str], *, overwrite: bool) -> None:
    """Make the folder of results, and refuse one that cannot be written or holds one of `files` already.

    Raises
    ------
    ArchiveError
        Saying which.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArchiveError(f"out: given {out}, which is or lies below a file; allowed: a folder") from None
    except OSError as error:
        raise ArchiveError(f"out: given {out}, which cannot be made: {error.strerror}; allowed: a folder") from None
    probe = out / f".cablepod-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ArchiveError(f"out: given {out}, which cannot be written: {error.strerror}; allowed: a folder") from None
    present = [name for name in files if (out / name).exists()]
    if present and not overwrite:
        raise ArchiveError(
            f"out: given {out}, which has {', '.join(present)} already; "
            "allowed: another folder, or overwrite=True to replace them"
        )
