"""Results that functions keep between calls, and how to forget them.

CACHES.md lists them: what each keeps, by which key, and how many.
"""

from __future__ import annotations

import sys
from typing import Any


def clear_caches() -> int:
    """Forget what functions of the package have kept, and return how many results these were.

    Results do not change: the next call computes again what it needs.  Datasets and prepared models that a caller holds keep
    what is theirs.  Other processes, such as the workers of an ensemble, and compiled kernels on disk are not concerned.

    Returns
    -------
    int
        Number of results that were kept.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> rest = cp.catenary.rest(examples.scene("example2"))
    >>> cp.clear_caches() > 0
    True
    """
    caches = loaded_caches().values()
    count = sum(cache.cache_info().currsize for cache in caches)
    for cache in caches:
        cache.cache_clear()
    return count


def loaded_caches() -> dict[str, Any]:
    """Return the functions that keep results, by dotted name, of the modules of the package that have been imported."""
    modules = [(name, module) for name, module in sys.modules.items() if name.partition(".")[0] == __package__]
    return {
        f"{name}.{function}": value
        for name, module in modules
        for function, value in vars(module).items()
        if hasattr(value, "cache_clear") and value.__module__ == name
    }
