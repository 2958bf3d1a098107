"""Memory and processor cores of the machine."""

from __future__ import annotations

import os

from cablepod.errors import SceneError


def check_memory(instants: int, links: int, dims: int, *, key: str, variables: int = 1) -> None:
    """Refuse an output that would not fit in memory.

    Raises
    ------
    SceneError
        Naming what is needed and what the machine has.
    """
    needed = 8.0 * dims * variables * (float(instants) * (links + 1) + 20.0 * links)
    check_bytes(needed, key, f"{links} links and {instants} instants, {needed / 1e9:.3g} GB of output")


def check_bytes(needed: float, key: str, given: str) -> None:
    """Refuse what would not fit in half of this machine's memory.

    Raises
    ------
    SceneError
        Naming what is needed and what the machine has.
    """
    try:
        memory = float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        memory = 16e9
    if needed > 0.5 * memory:
        raise SceneError(f"{key}: given {given}; allowed: half of this machine's memory, {0.5 * memory / 1e9:.3g} GB")


def cores() -> int:
    """Count the processor cores that this process may use."""
    # where the system tells
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
