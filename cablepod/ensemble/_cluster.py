"""Workers of a dask scheduler: those that are there at any time, awaited where there are none, refused with other packages."""

from __future__ import annotations

import contextlib
import pickle
import platform
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from importlib import metadata
from typing import Any

from cablepod.errors import RunStopped, SceneError, WorkersWarning, scene_error, shown, warn

#: Maximum time until a scheduler answers [s].  Its workers have no limit.
CONNECT_TIMEOUT = 10.0
#: Interval at which the scheduler is asked for its workers, and time without any after which the run says so [s].
ASK_EVERY, TELL_AFTER = 0.5, 2.0
#: How often a batch is submitted again whose workers were lost, each time after as many losses as dask allows (4 by default).
MAX_LOSSES = 3
#: Packages whose versions decide on the bits of the results, and must be those of this process.
PACKAGES = ("cablepod", "numba", "numpy", "scipy", "xarray")
#: Size of a task above which dask would advise to load its data otherwise [bytes].
LARGE_TASK = 1 << 20


class Again:
    """Answer in place of a result: the batch is submitted once more."""


def package_versions() -> dict[str, str]:
    """Return the versions of the packages of this process that results depend on."""
    found = {}
    for name in PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):  # a checkout that is not installed
            found[name] = metadata.version(name)
    return found


def _guard() -> Callable[[bytes, dict[str, str]], tuple[Any, ...]]:
    """Return the function that workers call; being local it is sent as code, so that they need no package for it."""

    def cablepod_batch(job: bytes, wanted: dict[str, str]) -> tuple[Any, ...]:
        """Compare the packages of this worker with the `wanted` versions, then run the job."""
        import pickle
        import traceback
        from importlib import import_module, metadata

        from distributed import get_worker

        found = {}
        for name in wanted:
            try:
                import_module(name)
                found[name] = metadata.version(name)
            except Exception as error:
                found[name] = f"none ({type(error).__name__}: {error})"
        differ = {name: (found[name], wanted[name]) for name in wanted if found[name] != wanted[name]}
        if differ:
            return "refused", get_worker().address, differ
        try:
            function = pickle.loads(job)
            return "done", function()
        except Exception as error:
            error.add_note(traceback.format_exc())
            try:
                pickle.loads(pickle.dumps(error))
            except Exception:
                return "raised", RuntimeError(f"{type(error).__name__}: {error}")
            return "raised", error

    return cablepod_batch


class DaskPool:
    """Workers of a dask client, as they come and leave."""

    here = False  #: workers are other processes, which cannot be stopped and report no progress
    threads = 1  #: number of threads for the members of a batch

    def __init__(self, client: Any, name: Any) -> None:
        self.client = client
        self.name = shown(name) if isinstance(name, str) else f"the scheduler {client.scheduler.address}"
        self.executor = client.get_executor(pure=False)
        self.guard = _guard()
        self.versions = package_versions()
        self.present: dict[str, int] = dict(client.nthreads())
        self.refused: dict[str, str] = {}
        self.unsaid: list[str] = []  #: refused workers that no warning has named
        self.accepted = False  #: whether a worker has completed a batch
        self.losses: dict[int, int] = {}
        self.allowed: dict[Future[Any], frozenset[str]] = {}  #: workers of the jobs that only some may run
        self.idle_since: float | None = None
        self.said = False
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._follow, name="cablepod-workers", daemon=True)
        self.thread.start()

    def _follow(self) -> None:
        """Ask the scheduler for its workers, again and again; in a thread, as it may take its time to answer."""
        while not self.ended.wait(ASK_EVERY):
            with contextlib.suppress(Exception):  # it does not answer: the client closes itself in the end
                self.present = dict(self.client.nthreads())

    def close(self) -> None:
        """Stop asking."""
        self.ended.set()
        self.thread.join(ASK_EVERY)

    def _usable(self) -> dict[str, int]:
        """Return workers that are there and not refused, with their numbers of threads."""
        return {address: count for address, count in self.present.items() if address not in self.refused}

    @property
    def slots(self) -> int:
        """Number of jobs that run at a time on the workers that are there now."""
        return sum(self._usable().values())

    def submit(self, job: Callable[[], Any]) -> Future[Any]:
        """Submit a job, to any worker or, where some are refused, to the others."""
        import dask

        content = pickle.dumps(job)
        others = self.refused.keys() & self.present.keys()
        only: dict[str, Any] = {"workers": list(self._usable())} if others else {}
        large = {"distributed.admin.large-graph-warning-threshold": "1 TB"} if len(content) > LARGE_TASK else {}
        with dask.config.set(large):
            future: Future[Any] = self.executor.submit(self.guard, content, self.versions, **only)
        if only:
            self.allowed[future] = frozenset(only["workers"])
        return future

    def stranded(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Return those jobs that only workers may run that have left."""
        self.allowed = {future: self.allowed[future] for future in futures if future in self.allowed}
        present = self.present.keys()
        return [future for future, workers in self.allowed.items() if not workers & present and not future.done()]

    def outcome(self, number: int, future: Future[Any]) -> Any:
        """Return the result of the job of a batch, or :class:`Again`.

        Raises
        ------
        RunStopped
            If the scheduler is lost, or the workers of this batch again and again.
        SceneError
            If a worker cannot read the job.
        Exception
            What the job raised.
        """
        from distributed import CancelledError as DaskCancelledError
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker

        try:
            kind, *answer = future.result()
        except KilledWorker as error:
            self.losses[number] = self.losses.get(number, 0) + 1
            if self.losses[number] <= MAX_LOSSES:
                return Again
            raise RunStopped(
                f"batch {number} was given up: {self.losses[number]} times all workers were lost that ran it "
                f"({shown(str(error))}), perhaps for want of memory; completed batches are kept; run the same call again, with a "
                "smaller batch in another folder, or with larger workers"
            ) from error
        except (CommClosedError, DaskCancelledError, CancelledError) as error:
            raise RunStopped(
                f"the scheduler of this ensemble is lost ({type(error).__name__}: {shown(str(error))}), completed batches are "
                "kept; run the same call again to continue"
            ) from error
        except Exception as error:  # what the job raises comes as an answer: it did not reach the job
            here = ", ".join(f"{name} {version}" for name, version in self.versions.items())
            raise SceneError(
                f"scheduler: given a worker that cannot read its task ({type(error).__name__}: {shown(str(error))}); "
                f"allowed: workers with the Python and packages of this process, {platform.python_version()}, {here}"
            ) from error
        if kind == "raised":
            raise answer[0]
        if kind == "refused":
            self._refuse(*answer)
            return Again
        self.accepted = True
        return answer[0]

    def _refuse(self, address: str, differ: Mapping[str, tuple[str, str]]) -> None:
        """Use a worker no more."""
        if address not in self.refused:
            differences = ", ".join(f"{name} {there} (here {here})" for name, (there, here) in differ.items())
            self.refused[address] = f"{address} has {differences}"
            self.unsaid.append(address)

    def look(self, left: int) -> None:
        """Warn of refused workers, and of a wait for others, with `left` batches to be computed.

        Raises
        ------
        SceneError
            If all workers are refused and none has completed a batch.
        RunStopped
            If the scheduler is lost.
        """
        if self.client.status in ("closed", "closing"):
            raise RunStopped(
                "the scheduler of this ensemble is lost, completed batches are kept; run the same call again to continue"
            )
        present = self.present
        self.refused = {address: text for address, text in self.refused.items() if address in present}
        self.unsaid = [address for address in self.unsaid if address in self.refused]
        refused = "; ".join(self.refused.values())
        usable = bool(self._usable())
        if self.refused and not usable and not self.accepted:
            here = ", ".join(f"{name} {version}" for name, version in self.versions.items())
            raise SceneError(
                f"scheduler: given workers with other packages: {refused}; allowed: those of this process, {here}"
            )
        if self.unsaid and self.accepted:  # before, perhaps all are refused
            texts = "; ".join(self.refused[address] for address in self.unsaid)
            self.unsaid = []
            self.warn(f"workers with other packages are not used: {texts}; install the same there")
        if usable:
            self.idle_since, self.said = None, False
            return
        now = time.monotonic()
        self.idle_since = now if self.idle_since is None else self.idle_since
        if not self.said and now - self.idle_since >= TELL_AFTER:
            self.said = True
            count = "1 batch is" if left == 1 else f"{left} batches are"
            none = f"it has only refused ones ({refused})" if refused else "it has none at present"
            self.warn(
                f"waiting for a worker of {self.name}: {none}, {count} left; start one, or leave it waiting, "
                "without a limit: the run goes on as soon as one joins, Ctrl-C ends it"
            )

    @staticmethod
    def warn(text: str) -> None:
        """Warn at the user's line."""
        warn(text, WorkersWarning)


@contextlib.contextmanager
def client_pool(client: Any, name: Any) -> Iterator[DaskPool]:
    """Provide the workers of a client; `name` is the scheduler in messages.

    Raises
    ------
    SceneError
        If its scheduler does not answer.
    """
    if getattr(client, "asynchronous", False):
        raise scene_error("scheduler", name, "a distributed.Client without asynchronous=True")
    try:
        pool = DaskPool(client, name)
    except (OSError, TimeoutError, RuntimeError, AttributeError) as error:  # of a closed client
        raise scene_error(
            "scheduler", name, f"a scheduler that answers ({type(error).__name__}: {shown(str(error))})"
        ) from error
    try:
        yield pool
    finally:
        pool.close()


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to the dask scheduler at an address.

    Raises
    ------
    SceneError
        If none answers there within :data:`CONNECT_TIMEOUT`.
    """
    from distributed import Client

    try:
        # a default client would run computations of other code, and would remain after a failure
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        text = f"an address at which a dask scheduler answers within {CONNECT_TIMEOUT:g} s ({shown(str(error))})"
        raise scene_error("scheduler", address, text) from error
    with client:
        yield client
