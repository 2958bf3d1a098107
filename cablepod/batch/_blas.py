"""One BLAS thread where matrices are small: on a busy machine two take up to forty times as long as one."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

_LOCK = threading.Lock()
_HELD: list[Any] = []


@functools.cache
def _controller() -> Any:
    import_module("scipy.linalg")  # brings a BLAS of its own, which must be there to be found
    return import_module("threadpoolctl").ThreadpoolController()  # looks at every loaded library, so once


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS at one thread; the number that was set comes back when the last of several that hold it lets go."""
    with _LOCK:
        if not _HELD:
            limit = _controller().limit(limits=1, user_api="blas")
            limit.__enter__()
            _HELD.append(limit)
        else:
            _HELD.append(None)
    try:
        yield
    finally:
        with _LOCK:
            if len(_HELD) == 1:
                _HELD[0].__exit__(None, None, None)
                _HELD.clear()
            else:
                _HELD.remove(None)
