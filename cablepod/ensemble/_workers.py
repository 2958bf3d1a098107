"""Executors of the batches of an ensemble: threads, local processes, or a dask cluster.

All three are executors in the sense of :mod:`concurrent.futures`.  The number of submitted batches is the number of workers plus
a few.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from cablepod._resources import block_sigint, cores, defer_sigint, wait_for_any
from cablepod.errors import RunStopped, scene_error, shown
from cablepod.parameters._checks import integer

#: Maximum time until a scheduler answers and has a worker [s].
CONNECT_TIMEOUT = 10.0
ALLOWED = (
    'None (threads), "processes", the address of a dask scheduler such as "tcp://host:8786", or a distributed.Client'
)


@dataclass
class WorkerPool:
    """Executor with the number and properties of its workers."""

    executor: Executor
    workers: int
    here: bool  #: whether workers are threads of this process (only these can be stopped and report progress)
    everywhere: Callable[..., dict[str, Any]]  #: calls a function once in each worker process; worker name -> result
    threads: int = 1  #: number of threads for the members of a batch
    lost: tuple[type[BaseException], ...] = ()  #: exceptions raised after a loss of workers or scheduler


@contextlib.contextmanager
def worker_pool(scheduler: Any, workers: int | None, batches: int) -> Iterator[WorkerPool]:
    """Provide workers for a number of batches, and release them on exit.

    Raises
    ------
    SceneError
        For an unknown scheduler, or one that has no worker within CONNECT_TIMEOUT.
    """
    with contextlib.ExitStack() as contexts:
        with defer_sigint():
            pool = _create_pool(contexts, scheduler, workers, batches)
        try:
            yield pool
        finally:
            with defer_sigint():
                contexts.close()


def _create_pool(contexts: contextlib.ExitStack, scheduler: Any, workers: int | None, batches: int) -> WorkerPool:
    """Create workers that are released when `contexts` is closed."""
    count = cores() if workers is None else integer(least=1, most=4096)("workers", workers)
    if scheduler is None:
        return contexts.enter_context(_threads(count, batches))
    if isinstance(scheduler, str) and scheduler == "processes":
        return contexts.enter_context(_processes(min(count, max(batches, 1))))
    if workers is not None:
        raise scene_error("workers", workers, "none with a scheduler of your own, which has its own workers")
    if isinstance(scheduler, str) and "://" in scheduler:
        return _client_pool(contexts.enter_context(_connected(scheduler)), scheduler)
    if hasattr(scheduler, "get_executor") and hasattr(scheduler, "scheduler_info"):
        return _client_pool(scheduler, scheduler)
    raise scene_error("scheduler", scheduler, ALLOWED)


@contextlib.contextmanager
def _threads(count: int, batches: int) -> Iterator[WorkerPool]:
    """Provide a thread pool; threads beyond the number of batches serve the members of a batch."""
    parallel_batches = max(1, min(count, batches))
    executor = ThreadPoolExecutor(parallel_batches, thread_name_prefix="cablepod")
    try:
        yield WorkerPool(
            executor,
            parallel_batches,
            True,
            lambda function, *args: {"this process": function(*args)},
            max(1, count // parallel_batches),
        )
    finally:
        executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _processes(count: int) -> Iterator[WorkerPool]:
    """Provide processes of this machine."""
    from multiprocessing import resource_tracker

    from distributed import Client, LocalCluster

    resource_tracker.ensure_running()  # its start, otherwise with the first process, unblocks SIGINT
    with contextlib.ExitStack() as contexts:
        with block_sigint():  # workers end with this process, or are told to
            # one thread each, also for BLAS: dask starts the workers with OMP_NUM_THREADS=1
            cluster = LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
            )
            client = Client(contexts.enter_context(cluster), timeout=CONNECT_TIMEOUT, set_as_default=False)
        yield _client_pool(contexts.enter_context(client), "processes")


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Any]:
    """Connect to the dask scheduler at an address."""
    from distributed import Client

    try:
        # a default client would run computations of other code, and would remain after a failure
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        text = f"an address at which a dask scheduler answers within {CONNECT_TIMEOUT:g} s ({shown(str(error))})"
        raise scene_error("scheduler", address, text) from error
    with client:
        yield client


def _client_pool(client: Any, name: Any) -> WorkerPool:
    """Return the pool of a client's workers; `name` is the scheduler in messages."""
    from distributed import CancelledError as DaskCancelledError
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
    except (TimeoutError, OSError) as error:
        raise scene_error("scheduler", name, f"a scheduler that has a worker within {CONNECT_TIMEOUT:g} s") from error
    slots = sum(client.nthreads().values())

    def everywhere(function: Callable[..., Any], *args: Any) -> dict[str, Any]:
        """Call a function once in each worker process."""
        return client.run(function, *args, on_error="return")

    lost = (KilledWorker, CommClosedError, DaskCancelledError, CancelledError)
    return WorkerPool(client.get_executor(pure=False), slots, False, everywhere, 1, lost)


class JobQueue:
    """Submit jobs so that at most ``workers + ahead`` of them are open at a time."""

    def __init__(
        self, pool: WorkerPool, submit: Callable[[int], Future[Any]], numbers: Iterable[int], *, ahead: int
    ) -> None:
        self.pool = pool
        self.submit = submit
        self.rest = deque(numbers)
        self.limit = pool.workers + ahead
        self.open: dict[Future[Any], int] = {}
        self._fill()

    def _fill(self, waiting: int = 0) -> None:
        """Submit jobs up to the limit; `waiting` results that are not yet taken count too."""
        with defer_sigint():
            while self.rest and len(self.open) + waiting < self.limit:
                number = self.rest.popleft()
                self.open[self.submit(number)] = number

    def results(self) -> Iterator[tuple[int, Any]]:
        """Yield (number, result) in order of completion.

        Raises
        ------
        RunStopped
            If workers or the scheduler are lost.
        """
        try:
            while self.open:
                for future in wait_for_any(self.open):
                    yield self.open.pop(future), self.result(future)
                    self._fill()
        finally:
            self.cancel()

    def in_order(self) -> Iterator[Any]:
        """Yield results in order of their number; waiting results count towards the limit."""
        ready: dict[int, Any] = {}
        order = deque(sorted([*self.open.values(), *self.rest]))
        try:
            while order:
                while order[0] not in ready:
                    ready |= {self.open.pop(future): self.result(future) for future in wait_for_any(self.open)}
                    self._fill(len(ready))
                yield ready.pop(order.popleft())
                self._fill(len(ready))
        finally:
            self.cancel()

    def result(self, future: Future[Any]) -> Any:
        """Return the result of a completed job."""
        try:
            return future.result()
        except self.pool.lost as error:
            raise RunStopped(
                f"the workers of this ensemble are lost ({type(error).__name__}: {shown(str(error))}), completed batches are kept"
                "; run the same call again to continue"
            ) from error

    def cancel(self) -> None:
        """Cancel all open jobs."""
        with defer_sigint():
            for future in self.open:
                future.cancel()
            self.open = {}


class Progress:
    """Report the completed fraction of all members; safe for calls from several threads."""

    def __init__(self, callback: Callable[[float], None] | None, sizes: list[int], done: Iterable[int]) -> None:
        self.callback = callback
        self.sizes = sizes
        self.fractions: dict[int, float] = dict.fromkeys(done, 1.0)
        self.lock = threading.Lock()
        self.report()

    def of_batch(self, number: int) -> Callable[[float], None] | None:
        """Return the callback of a batch for its own fraction."""
        return None if self.callback is None else lambda fraction: self.update(number, fraction)

    def update(self, number: int, fraction: float) -> None:
        """Set the completed fraction of a batch and report."""
        with self.lock:
            self.fractions[number] = max(fraction, self.fractions.get(number, 0.0))
            self.report()

    def report(self) -> None:
        """Call the callback with the completed fraction of all members."""
        if self.callback is not None:
            done = sum(self.sizes[number] * fraction for number, fraction in self.fractions.items())
            self.callback(done / sum(self.sizes))
