"""Limit BLAS to one thread for small matrices (on a busy machine two threads take up to forty times as long)."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

_LOCK = threading.Lock()
#: The limit followed by None for each nested or concurrent block.
_ACTIVE: list[Any] = []


@functools.cache
def _controller() -> Any:
    """Return the controller of all loaded BLAS libraries."""
    import_module("scipy.linalg")  # has its own BLAS, which must be loaded to be found
    return import_module("threadpoolctl").ThreadpoolController()  # slow: inspects every loaded library


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread; the last of concurrent blocks restores the previous number."""
    with _LOCK:
        if not _ACTIVE:
            limit = _controller().limit(limits=1, user_api="blas")
            limit.__enter__()
            _ACTIVE.append(limit)
        else:
            _ACTIVE.append(None)
    try:
        yield
    finally:
        with _LOCK:
            if len(_ACTIVE) == 1:
                _ACTIVE[0].__exit__(None, None, None)
                _ACTIVE.clear()
            else:
                _ACTIVE.remove(None)
