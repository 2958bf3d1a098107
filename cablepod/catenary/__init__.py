"""The continuous elastic cable at rest: the exact elastic catenary.

.. include:: README.md
"""

from importlib import import_module
from typing import Any

from cablepod.catenary._rest import rest, solve

__all__ = ["rest", "solve", "stringing"]


def __getattr__(name: str) -> Any:
    """Load ``stringing`` from the cable, which has the vibrations and the rest in wind that a catenary lacks."""
    if name == "stringing":
        found = globals()[name] = import_module("cablepod.cable._stringing").stringing
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}; allowed: {', '.join(__all__)}")
