"""Check memory, count processor cores of the machine, find the shipped data."""

from __future__ import annotations

import os
from pathlib import Path

from cablepod.errors import SceneError


def check_memory(instants: int, links: int, dims: int, *, key: str, variables: int = 1) -> None:
    """Refuse output that needs more than half of the memory.

    Raises
    ------
    SceneError
        The message names the needed and the available memory.
    """
    needed = 8.0 * dims * variables * (float(instants) * (links + 1) + 20.0 * links)
    check_bytes(needed, key, f"{links} links and {instants} instants, {needed / 1e9:.3g} GB of output")


def check_bytes(needed: float, key: str, given: str) -> None:
    """Refuse arrays of `needed` bytes if they exceed half of the memory.

    Raises
    ------
    SceneError
        The message names the needed and the available memory.
    """
    try:
        memory = float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # unknown on this system
        memory = 16e9
    if needed > 0.5 * memory:
        raise SceneError(f"{key}: given {given}; allowed: half of this machine's memory, {0.5 * memory / 1e9:.3g} GB")


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def data_folder() -> Path:
    """Return the folder of the shipped data: in the installed package, or beside it in a checkout."""
    here = Path(__file__).resolve().parent
    return here / "data" if (here / "data").is_dir() else here.parent / "data"
