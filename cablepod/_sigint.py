"""Defer SIGINT (Ctrl-C) while locks of libraries are held, to avoid deadlocks.

Python raises KeyboardInterrupt between any two bytecodes of the main thread, also between the acquisition of a lock and the
``with`` block that releases it.  The locks of xarray, dask and :mod:`concurrent.futures` are written in Python and are affected:
the lock stays acquired, and the next thread that needs it waits for ever.
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

#: Interval at which a wait checks for SIGINT [s].
LOOK_EVERY = 0.1


class _State:
    """State of the main thread's block; other threads receive no signals and do not set it."""

    previous: Callable[[int, Any], Any] | None = None  #: handler outside of the block; None outside of a block
    received = forwarded = 0  #: numbers of SIGINTs received and forwarded in this block


def _on_sigint(number: int, frame: Any) -> None:
    """Count SIGINT; forward the second one immediately."""
    _State.received += 1
    if _State.received > 1 and _State.previous is not None:
        _State.forwarded = _State.received
        _State.previous(number, frame)


@contextmanager
def defer_sigint() -> Iterator[None]:
    """Defer SIGINT to the end of the block or to :func:`check_sigint`; a second one is forwarded immediately.

    No effect in other threads than the main one, in nested blocks, and if SIGINT is ignored.
    """
    previous = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(previous) or previous is _on_sigint:
        yield
        return
    _State.previous, _State.received, _State.forwarded = previous, 0, 0
    signal.signal(signal.SIGINT, _on_sigint)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
        try:
            check_sigint()
        finally:
            _State.previous = None


@contextmanager
def block_sigint() -> Iterator[None]:
    """Block SIGINT in this thread; threads and processes that are started in the block never receive it.

    A terminal sends Ctrl-C to all processes of a command: workers would print a traceback each, also while they start.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def check_sigint() -> None:
    """Forward a deferred SIGINT; to be called while no lock is held.

    Raises
    ------
    KeyboardInterrupt
        By Python's handler of SIGINT.
    """
    if (
        threading.current_thread() is threading.main_thread()
        and _State.previous is not None
        and _State.forwarded < _State.received
    ):
        _State.forwarded = _State.received
        _State.previous(signal.SIGINT, None)


@contextmanager
def defer_sigint_during_dask(dataset: xr.Dataset) -> Iterator[None]:
    """Forward SIGINT only between two dask tasks while a chunked dataset is computed.

    No task runs any more when the block ends, so that none writes to an abandoned target.  No effect with the scheduler of a
    cluster, which has no callbacks for tasks.
    """
    is_lazy = any(variable.chunks is not None for variable in dataset.variables.values())
    if not is_lazy or threading.current_thread() is not threading.main_thread():
        yield
        return
    from dask import config, threaded  # slow to import, needed for chunked datasets only
    from dask.base import get_scheduler
    from dask.callbacks import Callback

    get = get_scheduler()
    if get is not None and not get.__module__.startswith("dask."):
        yield
        return
    with ExitStack() as stack:
        stack.enter_context(defer_sigint())
        if get in (None, threaded.get) and config.get("pool", None) is None:
            executor = getattr(threaded, "ContextAwareThreadPoolExecutor", ThreadPoolExecutor)  # recent versions
            pool = executor(config.get("num_workers", None) or threaded.CPU_COUNT)
            stack.callback(pool.shutdown, cancel_futures=True)
            stack.enter_context(config.set(pool=pool))
        stack.enter_context(Callback(posttask=lambda *_: check_sigint()))
        yield


def wait_for_any(futures: Iterable[Future[Any]]) -> set[Future[Any]]:
    """Wait until at least one future is done; return all that are.

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
