"""Executors of the batches of an ensemble: threads, local processes, or a dask cluster.

The number of submitted batches follows the number of workers that are there at any time.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

from cablepod._resources import LOOK_EVERY, block_sigint, check_sigint, cores, defer_sigint
from cablepod.ensemble._cluster import CONNECT_TIMEOUT, Again, DaskPool, client_pool, connected
from cablepod.errors import scene_error, shown
from cablepod.parameters._checks import integer

ALLOWED = (
    'None (threads), "processes", the address of a dask scheduler such as "tcp://host:8786", or a distributed.Client'
)


@dataclass
class ThreadPool:
    """Threads of this process, as workers of batches."""

    executor: Executor
    slots: int  #: number of batches at a time
    threads: int = 1  #: number of threads for the members of a batch
    here: bool = True  #: workers can be stopped and report progress

    def submit(self, job: Callable[[], Any]) -> Future[Any]:
        """Submit a job."""
        return self.executor.submit(job)

    def outcome(self, number: int, future: Future[Any]) -> Any:
        """Return the result of the job of a batch."""
        del number
        return future.result()

    def stranded(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Return the jobs that no worker can run: none."""
        del futures
        return []

    def look(self, left: int) -> None:
        """Threads neither come nor leave."""


WorkerPool = ThreadPool | DaskPool


def check_workers(scheduler: Any, workers: Any) -> None:
    """Refuse an unknown scheduler, and a number of workers that cannot be or is not ours to choose.

    Raises
    ------
    SceneError
        Names ``scheduler`` or ``workers``.
    """
    is_client = hasattr(scheduler, "get_executor") and hasattr(scheduler, "scheduler_info")
    if not (is_here(scheduler) or is_client or (isinstance(scheduler, str) and "://" in scheduler)):
        raise scene_error("scheduler", scheduler, ALLOWED)
    if workers is not None:
        integer(least=1, most=4096)("workers", workers)
        if not is_here(scheduler):
            raise scene_error("workers", workers, "none with a scheduler of your own, which has its own workers")


def is_here(scheduler: Any) -> bool:
    """Tell whether a scheduler means workers that this process starts on this machine."""
    return scheduler is None or (isinstance(scheduler, str) and scheduler == "processes")


@contextlib.contextmanager
def worker_pool(scheduler: Any, workers: int | None, batches: int) -> Iterator[WorkerPool]:
    """Provide workers for a number of batches, and release them on exit; :func:`check_workers` has checked the arguments.

    Raises
    ------
    SceneError
        For a scheduler that does not answer.
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
    count = workers or cores()
    if scheduler is None:
        return contexts.enter_context(_threads(count, batches))
    if not isinstance(scheduler, str):
        return contexts.enter_context(client_pool(scheduler, scheduler))
    if scheduler == "processes":
        return contexts.enter_context(_processes(min(count, max(batches, 1))))
    return contexts.enter_context(client_pool(contexts.enter_context(connected(scheduler)), scheduler))


@contextlib.contextmanager
def _threads(count: int, batches: int) -> Iterator[ThreadPool]:
    """Provide a thread pool; threads beyond the number of batches serve the members of a batch."""
    parallel_batches = max(1, min(count, batches))
    executor = ThreadPoolExecutor(parallel_batches, thread_name_prefix="cablepod")
    try:
        yield ThreadPool(executor, parallel_batches, max(1, count // parallel_batches))
    finally:
        executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _processes(count: int) -> Iterator[DaskPool]:
    """Provide processes of this machine.

    Raises
    ------
    SceneError
        If they do not start, as where a script is read again by each of them.
    """
    from multiprocessing import resource_tracker

    from distributed import Client, LocalCluster

    resource_tracker.ensure_running()  # its start, otherwise with the first process, unblocks SIGINT
    with contextlib.ExitStack() as contexts:
        with block_sigint():  # workers end with this process, or are told to
            # one thread each, also for BLAS: dask starts the workers with OMP_NUM_THREADS=1
            try:
                cluster = LocalCluster(
                    n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
                )
            except RuntimeError as error:
                allowed = (
                    f'processes that start ({shown(str(error))}); a script needs if __name__ == "__main__": for them'
                )
                raise scene_error("scheduler", "processes", allowed) from None
            client = Client(contexts.enter_context(cluster), timeout=CONNECT_TIMEOUT, set_as_default=False)
        yield contexts.enter_context(client_pool(contexts.enter_context(client), "processes"))


class JobQueue:
    """Submit jobs so that at most ``limit(slots)`` of them are open at a time, for the workers that are there at this time.

    Parameters
    ----------
    pool
        The workers.
    submit
        Submits the job of a number.
    numbers
        Numbers of the jobs.
    limit
        Number of open jobs by that of jobs that run at a time.
    settle
        Makes the result of a number from the answer of its job, or :class:`Again` to submit it once more.
    """

    def __init__(
        self,
        pool: WorkerPool,
        submit: Callable[[int], Future[Any]],
        numbers: Iterable[int],
        *,
        limit: Callable[[int], int],
        settle: Callable[[int, Any], Any] = lambda _, answer: answer,
    ) -> None:
        self.pool = pool
        self.submit = submit
        self.rest = deque(numbers)
        self.limit = limit
        self.settle = settle
        self.open: dict[Future[Any], int] = {}

    def _fill(self, waiting: int) -> None:
        """Submit jobs up to the limit; `waiting` results that are not yet taken count too."""
        for future in self.pool.stranded(self.open):
            self.rest.appendleft(self.open.pop(future))
            future.cancel()
        while self.rest and (slots := self.pool.slots) and len(self.open) + waiting < self.limit(slots):
            number = self.rest.popleft()
            self.open[self.submit(number)] = number

    def _completed(self, waiting: int = 0) -> list[tuple[int, Any]]:
        """Wait until at least one job is done, also for workers; return numbers and results, none for those to be repeated."""
        with defer_sigint():
            while True:
                check_sigint()
                self.pool.look(len(self.rest) + len(self.open))
                self._fill(waiting)
                if not self.open:
                    time.sleep(LOOK_EVERY)
                    continue
                done, _ = wait(self.open, LOOK_EVERY, FIRST_COMPLETED)
                if done:
                    break
            answers = [(self.open.pop(future), future) for future in done]
            found = []
            for number, future in answers:
                result = self.pool.outcome(number, future)
                result = result if result is Again else self.settle(number, result)
                if result is Again:
                    self.rest.appendleft(number)
                else:
                    found.append((number, result))
            return found

    def results(self) -> Iterator[tuple[int, Any]]:
        """Yield (number, result) in order of completion.

        Raises
        ------
        RunStopped
            If the scheduler is lost, or the workers of a batch again and again.
        """
        try:
            while self.open or self.rest:
                yield from self._completed()
        finally:
            self.cancel()

    def in_order(self) -> Iterator[Any]:
        """Yield results in order of their number; waiting results count towards the limit."""
        ready: dict[int, Any] = {}
        order = deque(sorted(self.rest))
        try:
            while order:
                while order[0] not in ready:
                    ready |= self._completed(len(ready))
                yield ready.pop(order.popleft())
                with defer_sigint():
                    self._fill(len(ready))
        finally:
            self.cancel()

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
