"""Keep xarray from importing ``dask.array``, a third of a second, before a command makes such arrays."""

from __future__ import annotations

import sys
from typing import Any


def ask_loaded_only() -> None:
    """Let xarray look for arrays of dask only once ``dask.array`` is loaded: there are none before.

    xarray has no option for this.  Without the table of a later version nothing changes.
    """
    try:
        from xarray.namedarray import pycompat

        known, kind = pycompat._cached_duck_array_modules, pycompat.DuckArrayModule
    except (ImportError, AttributeError):
        return

    class WhenLoaded(kind):  # type: ignore[misc, valid-type]
        """What xarray knows of dask."""

        def __init__(self) -> None:
            pass

        def __getattr__(self, name: str) -> Any:
            """Return what xarray's own class has, which imports ``dask.array``; of the type nothing before it is loaded."""
            if name == "type" and "dask.array" not in sys.modules:
                return ()
            self.__dict__.update(vars(kind("dask")))
            return getattr(self, name)

    known.setdefault("dask", WhenLoaded())
