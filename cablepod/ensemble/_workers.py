"""Who computes the batches of an ensemble: threads of this process, processes of this machine, or a dask cluster.

All three are executors in the sense of :mod:`concurrent.futures`; at any time a few more batches are under way than there are
workers.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from cablepod._resources import cores
from cablepod.batch._sigint import defer_sigint, wait_for_any
from cablepod.errors import RunStopped, scene_error, shown
from cablepod.parameters._checks import integer

#: Seconds in which a scheduler must answer and have a worker.
CONNECT_TIMEOUT = 10.0
ALLOWED = (
    'None (threads), "processes", the address of a dask scheduler such as "tcp://host:8786", or a distributed.Client'
)


@dataclass
class WorkerPool:
    """Workers that batches can be handed to."""

    executor: Executor
    workers: int
    here: bool  #: threads of this process, which can be asked to stop and tell how far they are
    everywhere: Callable[..., dict[str, Any]]  #: calls a function once in each worker process, by its name
    threads: int = 1  #: in which each batch runs its members
    lost: tuple[type[BaseException], ...] = ()  #: what is raised where workers or the scheduler are gone


@contextlib.contextmanager
def worker_pool(scheduler: Any, workers: int | None, batches: int) -> Iterator[WorkerPool]:
    """Get workers for so many batches, and let them go on leaving.

    Raises
    ------
    SceneError
        For a scheduler that is none, or does not answer in time, or has no worker.
    """
    with contextlib.ExitStack() as held:
        with defer_sigint():
            own = _crew(held, scheduler, workers, batches)
        try:
            yield own
        finally:
            with defer_sigint():
                held.close()


def _crew(held: contextlib.ExitStack, scheduler: Any, workers: int | None, batches: int) -> WorkerPool:
    """Get workers that leave when `held` is closed."""
    count = cores() if workers is None else integer(least=1, most=4096)("workers", workers)
    if scheduler is None:
        return held.enter_context(_threads(count, batches))
    if isinstance(scheduler, str) and scheduler == "processes":
        return held.enter_context(_processes(min(count, max(batches, 1))))
    if workers is not None:
        raise scene_error("workers", workers, "none with a scheduler of your own, which has its workers")
    if isinstance(scheduler, str) and "://" in scheduler:
        return _of(held.enter_context(_reached(scheduler)), scheduler)
    if hasattr(scheduler, "get_executor") and hasattr(scheduler, "scheduler_info"):
        return _of(scheduler, scheduler)
    raise scene_error("scheduler", scheduler, ALLOWED)


@contextlib.contextmanager
def _threads(count: int, batches: int) -> Iterator[WorkerPool]:
    side_by_side = max(1, min(count, batches))
    executor = ThreadPoolExecutor(side_by_side, thread_name_prefix="cablepod")
    try:
        yield WorkerPool(
            executor,
            side_by_side,
            True,
            lambda function, *given: {"this process": function(*given)},
            max(1, count // side_by_side),
        )
    finally:
        executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _processes(count: int) -> Iterator[WorkerPool]:
    from distributed import Client, LocalCluster

    # one thread each, for BLAS too: nannies start workers with OMP_NUM_THREADS=1 and the like
    with (
        LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        Client(cluster, timeout=CONNECT_TIMEOUT, set_as_default=False) as client,
    ):
        yield _of(client, "processes")


@contextlib.contextmanager
def _reached(address: str) -> Iterator[Any]:
    from distributed import Client

    try:
        # as a default it would take over what others compute, and if it fails would stay there
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        text = f"an address at which a dask scheduler answers within {CONNECT_TIMEOUT:g} s ({shown(str(error))})"
        raise scene_error("scheduler", address, text) from error
    with client:
        yield client


def _of(client: Any, name: Any) -> WorkerPool:
    """Make a crew of a client's workers."""
    from distributed import CancelledError as DaskCancelledError
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
    except (TimeoutError, OSError) as error:
        raise scene_error("scheduler", name, f"a scheduler that has a worker within {CONNECT_TIMEOUT:g} s") from error
    slots = sum(client.nthreads().values())

    def everywhere(function: Callable[..., Any], *given: Any) -> dict[str, Any]:
        return client.run(function, *given, on_error="return")

    lost = (KilledWorker, CommClosedError, DaskCancelledError, CancelledError)
    return WorkerPool(client.get_executor(pure=False), slots, False, everywhere, 1, lost)


class JobQueue:
    """Jobs that are under way, a bounded number of them at a time."""

    def __init__(
        self, own: WorkerPool, submit: Callable[[int], Future[Any]], numbers: Iterable[int], *, ahead: int
    ) -> None:
        self.own = own
        self.submit = submit
        self.rest = deque(numbers)
        self.limit = own.workers + ahead
        self.open: dict[Future[Any], int] = {}
        self._fill()

    def _fill(self, held: int = 0) -> None:
        with defer_sigint():
            while self.rest and len(self.open) + held < self.limit:
                number = self.rest.popleft()
                self.open[self.submit(number)] = number

    def results(self) -> Iterator[tuple[int, Any]]:
        """Yield (number, result) as they come.

        Raises
        ------
        RunStopped
            Where workers or the scheduler are gone.
        """
        try:
            while self.open:
                for future in wait_for_any(self.open):
                    yield self.open.pop(future), self.result(future)
                    self._fill()
        finally:
            self.cancel()

    def in_order(self) -> Iterator[Any]:
        """Yield results by number; as many as may be under way are kept, if an earlier one takes long."""
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
        """Return the result of a job that is done."""
        try:
            return future.result()
        except self.own.lost as error:
            raise RunStopped(
                f"the workers of this ensemble are gone ({type(error).__name__}: {shown(str(error))}); what is done is kept; "
                "run the same call again, which goes on where it stopped"
            ) from error

    def cancel(self) -> None:
        """Begin nothing more."""
        with defer_sigint():
            for future in self.open:
                future.cancel()
            self.open = {}


class Progress:
    """Tells how much of all members is done; safe to be called by several threads."""

    def __init__(self, told: Callable[[float], None] | None, sizes: list[int], done: Iterable[int]) -> None:
        self.told = told
        self.sizes = sizes
        self.parts: dict[int, float] = dict.fromkeys(done, 1.0)
        self.lock = threading.Lock()
        self.tell()

    def of(self, number: int) -> Callable[[float], None] | None:
        """Return what a batch calls with its own part."""
        return None if self.told is None else lambda part: self.note(number, part)

    def note(self, number: int, part: float) -> None:
        """Note the part of a batch that is done."""
        with self.lock:
            self.parts[number] = max(part, self.parts.get(number, 0.0))
            self.tell()

    def tell(self) -> None:
        """Tell the part of all."""
        if self.told is not None:
            self.told(sum(self.sizes[number] * part for number, part in self.parts.items()) / sum(self.sizes))
