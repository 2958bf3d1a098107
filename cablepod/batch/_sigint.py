"""Ctrl-C, held back where it would leave a lock taken that others wait for.

Python raises KeyboardInterrupt between any two steps of the main thread, also between the taking of a lock and the ``with`` that
lets go of it: the locks of xarray, dask and :mod:`concurrent.futures` are written in Python and have such a place.  Whoever needs
that lock next, a thread that hands over its result or the next file that is written, waits for ever.
"""

from __future__ import annotations

import concurrent.futures
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

import xarray as xr

#: Seconds after which a wait looks whether Ctrl-C was pressed.
LOOK_EVERY = 0.1


class _State:
    """What the main thread's block holds back; no other thread is ever interrupted, or sets this."""

    before: Callable[[int, Any], Any] | None = None  #: who is told of Ctrl-C otherwise; None where nothing is held back
    pressed = told = 0  #: how often in this block, and of how many of them somebody was told


def _on_sigint(number: int, frame: Any) -> None:
    """Note Ctrl-C; whoever presses it a second time does not want to wait."""
    _State.pressed += 1
    if _State.pressed > 1 and _State.before is not None:
        _State.told = _State.pressed
        _State.before(number, frame)


@contextmanager
def defer_sigint() -> Iterator[None]:
    """Hold Ctrl-C back until the block is left, or :func:`check` is called in it; pressed twice it comes at once.

    In other threads than the main one, within another such block, and where Ctrl-C does nothing, this does nothing.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before) or before is _on_sigint:
        yield
        return
    _State.before, _State.pressed, _State.told = before, 0, 0
    signal.signal(signal.SIGINT, _on_sigint)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        try:
            check_sigint()
        finally:
            _State.before = None


def check_sigint() -> None:
    """Let Ctrl-C through that was held back, here where no lock is taken.

    Raises
    ------
    KeyboardInterrupt
        As whoever is told of Ctrl-C otherwise does.
    """
    if (
        threading.current_thread() is threading.main_thread()
        and _State.before is not None
        and _State.told < _State.pressed
    ):
        _State.told = _State.pressed
        _State.before(signal.SIGINT, None)


@contextmanager
def defer_sigint_during_dask(dataset: xr.Dataset) -> Iterator[None]:
    """Let Ctrl-C through only between two tasks of what dask computes of a dataset that is held in chunks.

    On leaving, none of its tasks is under way any more, so that none writes to what is given up.  A cluster's scheduler, which
    does not tell of its tasks, is left as it is.
    """
    is_lazy = any(item.chunks is not None for item in dataset.variables.values())
    if not is_lazy or threading.current_thread() is not threading.main_thread():
        yield
        return
    from dask import config, threaded  # only who has chunks needs it
    from dask.base import get_scheduler
    from dask.callbacks import Callback

    get = get_scheduler()
    if get is not None and not get.__module__.startswith("dask."):
        yield
        return
    with ExitStack() as held_too:
        held_too.enter_context(defer_sigint())
        if get in (None, threaded.get) and config.get("pool", None) is None:
            make = getattr(threaded, "ContextAwareThreadPoolExecutor", ThreadPoolExecutor)  # of late versions
            pool = make(config.get("num_workers", None) or threaded.CPU_COUNT)
            held_too.callback(pool.shutdown, cancel_futures=True)
            held_too.enter_context(config.set(pool=pool))
        held_too.enter_context(Callback(posttask=lambda *_: check_sigint()))
        yield


def wait_for_any(futures: Iterable[Future[Any]]) -> set[Future[Any]]:
    """Wait until one at least is done, and return those that are.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, within :data:`LOOK_EVERY`.
    """
    waiting = list(futures)
    with defer_sigint():
        while True:
            check_sigint()
            done, _ = concurrent.futures.wait(waiting, LOOK_EVERY, FIRST_COMPLETED)
            if done or not waiting:
                return done
