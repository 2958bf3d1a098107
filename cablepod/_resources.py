"""Check memory, count processor cores of the machine, find the shipped data; defer Ctrl-C while locks are held.

Python raises KeyboardInterrupt between any two bytecodes of the main thread, also between the acquisition of a lock and the
``with`` block that releases it.  The locks of xarray, dask and :mod:`concurrent.futures` are written in Python and are affected:
the lock stays acquired, and the next thread that needs it waits for ever.
"""

from __future__ import annotations

import concurrent.futures
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cablepod.errors import SceneError

if TYPE_CHECKING:
    import xarray as xr

#: Interval at which a wait checks for SIGINT [s].
LOOK_EVERY = 0.1
#: Arrays of a run at its peak over those of its positions: saved states, what they are put in order for, and the output; 4 to 6
#: for positions, 7 to 12 with velocities, tensions and the runs that an estimate compares.
ARRAYS_OF_RUN = 8


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
    if not fits(needed):
        raise SceneError(f"{key}: given {given}; allowed: half of this machine's memory, {0.5 * memory() / 1e9:.3g} GB")


def fits(needed: float) -> bool:
    """Tell whether arrays of `needed` bytes take at most half of the memory."""
    return needed <= 0.5 * memory()


@cache
def memory() -> float:
    """Return the memory of this machine [bytes] (kept: to ask the system takes as long as a hundred steps of a chain)."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # unknown on this system
        return 16e9


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def data_folder() -> Path:
    """Return the folder of the shipped data: in the installed package, or beside it in a checkout."""
    here = Path(__file__).resolve().parent
    return here / "data" if (here / "data").is_dir() else here.parent / "data"


# --- Ctrl-C ---------------------------------------------------------------------------------------------------------------


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
