"""Many scenes: designed, run in parallel, kept so that an interrupted run goes on where it stopped.

:func:`design` makes the scenes, :func:`run` simulates them into a folder, :func:`cablepod.archive.open_ensemble` opens it as one
dataset.  :func:`batches` hands results over one batch after another and keeps nothing.
"""

from __future__ import annotations

import functools
import os
import threading
import warnings
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.archive._manifest import MODES, SCENES
from cablepod.archive._open_ensemble import open_ensemble
from cablepod.batch._members import stop_when, thread_limit
from cablepod.batch._sigint import defer_sigint
from cablepod.ensemble import _store as ensemble_store
from cablepod.ensemble._collect_warnings import Note, collect_warnings, emit_warnings
from cablepod.ensemble._job import check_access, compute, run_batch, unscheduled
from cablepod.ensemble._models import MODELS, REDUCED, check_model
from cablepod.ensemble._workers import JobQueue, Progress, WorkerPool, worker_pool
from cablepod.errors import ArchiveError, MemberFailedWarning, RunStopped, SceneError, scene_error, shown
from cablepod.integrate._request import check_times
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters

#: Members on which options are tried before anything runs.
N_PROBED = 5


def run(
    scenes: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    model: str = "chain",
    modes: xr.Dataset | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    batch: int = 64,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> xr.Dataset:
    """Simulate many scenes into a folder; a second call does what is missing.

    Parameters
    ----------
    scenes
        With ``member``, as :func:`design` gives them.
    path
        The folder, made if missing: ``manifest.json``, ``scenes.nc``, ``modes.nc``, and ``batch_0000.nc`` and so on, each of
        which appears whole or not at all.
    model
        "chain", "cable", "rigid", or with `modes` "galerkin" or "condensed".
    modes
        Of the reduced models.
    scheduler
        None: threads of this process.  "processes": processes of this machine; a script then needs ``if __name__ ==
        "__main__":``.  The address of a dask scheduler, or a ``distributed.Client``: its workers, which must see the folder under
        the same path.  The results are the same bit by bit.
    workers
        Number of threads or processes; all cores by default.
    batch
        Members in a file, computed by one call.
    overwrite
        Replace another ensemble in the folder, and damaged files; what is whole and of this ensemble is kept.
    progress
        Called now and then with the part that is done, from 0 to 1.
    options
        Those of the model's ``simulate``.

    Returns
    -------
    xarray.Dataset
        All results, lazily, as :func:`cablepod.archive.open_ensemble` gives them.  Members that failed hold nan; ``failure`` says
        why.

    Raises
    ------
    SceneError
        For scenes, a model, modes, options or a scheduler that cannot be; nothing has run then.
    ArchiveError
        For a folder that holds another ensemble (it says what differs), damaged files (it names them), or is in use or not to be
        written; a full disk.
    RunStopped
        Where the workers are gone.

    Warns
    -----
    MemberFailedWarning
        Where members failed.  Other warnings of the members are gathered too, one of each kind.
    """
    plan, inputs = _planned(scenes, model, modes, options, batch)
    with defer_sigint(), ensemble_store.opened(path, plan, inputs, overwrite=overwrite) as store:
        waiting = store.waiting()
        notes: list[Note] = []
        counted = Progress(progress, store.sizes, set(range(len(store.sizes))) - set(waiting))
        if waiting:
            with worker_pool(scheduler, workers, len(waiting)) as own:
                _check_workers(own, store.folder, plan["id"])
                try:
                    with closing(_done(own, store.folder, plan["id"], waiting, counted)) as results:
                        for number, (entry, told) in results:
                            store.note(number, entry)
                            notes += told
                            counted.note(number, 1.0)
                finally:
                    with suppress(ArchiveError):  # the files tell what is done
                        store.save()
        store.save()
        emit_warnings(notes, scenes.sizes["member"])
    result = open_ensemble(path)
    _warn_of_failures(result)
    return result


def batches(
    scenes: xr.Dataset,
    *,
    model: str = "chain",
    modes: xr.Dataset | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    batch: int = 64,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Iterator[xr.Dataset]:
    """Simulate many scenes and hand over their results, a batch at a time and in order, without keeping them.

    Parameters
    ----------
    scenes, model, modes, scheduler, workers, batch, progress, options
        As of :func:`run`.

    Returns
    -------
    iterator of xarray.Dataset
        Each has the results of the next members, in memory, as :func:`run` would write them.  No more batches are under way or
        waiting to be taken than there are workers, and one.

    Raises
    ------
    SceneError
        As :func:`run` does.
    RunStopped
        Where the workers are gone.
    """
    plan, inputs = _planned(scenes, model, modes, options, batch)
    return _batches(plan, inputs, scheduler, workers, progress)


def _batches(
    plan: dict[str, Any],
    inputs: dict[str, xr.Dataset],
    scheduler: Any,
    workers: int | None,
    progress: Callable[[float], None] | None,
) -> Iterator[xr.Dataset]:
    scenes, modes, size = inputs[SCENES], inputs.get(MODES), plan["batch"]
    sizes = [min(size, plan["members"] - first) for first in range(0, plan["members"], size)]
    counted = Progress(progress, sizes, ())
    stop = threading.Event()
    with worker_pool(scheduler, workers, len(sizes)) as own:

        def submit(number: int) -> Future[Any]:
            some = scenes.isel(member=slice(number * size, (number + 1) * size))
            job = functools.partial(_computed, some, plan["model"], modes, plan["options"], own.threads)
            if own.here:
                job = functools.partial(job, stop=stop.is_set, progress=counted.of(number))
            return own.executor.submit(job)

        under = JobQueue(own, submit, range(len(sizes)), ahead=1)
        notes: list[Note] = []
        try:
            for number, (result, told) in enumerate(under.in_order()):
                notes += told
                counted.note(number, 1.0)
                record = {name: plan[name] for name in ("model", "options", "batch")} | {"number": number}
                yield provenance.record(
                    result, function="ensemble.batches", parameters=record, inputs=list(inputs.values())
                )
        finally:
            stop.set()
    emit_warnings(notes, plan["members"])


def _computed(
    scenes: xr.Dataset,
    model: str,
    modes: xr.Dataset | None,
    options: dict[str, Any],
    threads: int,
    *,
    stop: Callable[[], bool] = bool,
    progress: Callable[[float], None] | None = None,
) -> tuple[xr.Dataset, list[Note]]:
    """Compute a batch in a worker."""
    with collect_warnings() as notes, thread_limit(threads), stop_when(stop):
        result = compute(scenes, model, modes, options, progress)
    return result, notes


# --- before anything runs -----------------------------------------------------------------------------------------------


def _planned(
    scenes: Any, model: Any, modes: Any, options: dict[str, Any], batch: Any
) -> tuple[dict[str, Any], dict[str, xr.Dataset]]:
    """Check everything, and return what decides the results, and the inputs under the names of their files."""
    if not isinstance(scenes, xr.Dataset) or "member" not in scenes.dims or "ends_lower" not in scenes:
        raise SceneError("scenes: given no Dataset of scenes with member; allowed: what ensemble.design gives")
    if not scenes.sizes["member"]:
        raise SceneError("scenes: given no members; allowed: one at least")
    resolved = check_model(model, modes, options)
    size = integer(least=1, most=10**6)("batch", batch)
    _check_shapes(scenes, model, resolved)
    made = scenes
    if "member" not in made.coords:
        made = made.assign_coords(member=np.arange(made.sizes["member"]))
    made = made.assign_attrs(provenance.with_manual_change(made).attrs, stage="scenes")
    made.attrs.pop("values_sha256", None)
    _try_options(made, model, modes, resolved, {*options, "modes", "layout", "times", "time"})
    inputs = {SCENES: made} | ({} if modes is None else {MODES: modes})
    return ensemble_store.plan_of(made, model, modes, resolved, size), inputs


def _check_shapes(scenes: xr.Dataset, model: str, options: dict[str, Any]) -> None:
    """Refuse scenes whose results do not lie in one array."""
    deciding = {"time_duration": "times", "time_interval": "times"}
    if model not in REDUCED:
        deciding["chain_links"] = "points" if model == "cable" else "links"
    for name, option in deciding.items():
        varies = name in scenes and "member" in scenes[name].dims and np.unique(scenes[name].values).size > 1
        if varies and options[option] is None:
            allowed = f"one value for all members, whose results lie in one array, or the option {option}"
            raise scene_error(name.replace("_", ".", 1), "different values", allowed)


def _try_options(
    scenes: xr.Dataset, model: str, modes: xr.Dataset | None, options: dict[str, Any], names: set[str]
) -> None:
    """Refuse options that no member can run with; some are tried, over a run of no duration."""
    given = () if modes is None else (modes,)
    if options.get("times") is not None:
        check_times(options["times"])
    errors = []
    for i in dict.fromkeys(np.linspace(0, scenes.sizes["member"] - 1, N_PROBED).astype(int).tolist()):
        one = scenes.isel(member=i, drop=True)
        try:
            if options.get("times") is None:
                parameters(one).times()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                MODELS[model](one, *given, **{**options, "times": [0.0]})
            return
        except (ValueError, RunStopped, ArithmeticError) as error:
            errors.append(error)
            key = str(error).split(":")[0].replace(",", " ").split()
            if not names & set(key):
                return  # this scene cannot be run, which is nothing against the options
    raise errors[0]


def _check_workers(own: WorkerPool, folder: Path, ensemble: str) -> None:
    """Refuse workers that do not see the folder."""
    if own.here:
        return
    for worker, answer in own.everywhere(check_access, folder, ensemble).items():
        if isinstance(answer, BaseException):
            raise scene_error(
                "scheduler", worker, f"workers that can import cablepod (this one says {shown(str(answer))})"
            )
        if answer:
            raise ArchiveError(
                f"{folder}: the worker {worker} cannot write there ({answer}); give a folder that all workers share"
            )


# --- while it runs ------------------------------------------------------------------------------------------------------


def _done(
    own: WorkerPool, folder: Path, ensemble: str, waiting: list[int], counted: Progress
) -> Generator[tuple[int, tuple[dict[str, Any], list[Note]]], None, None]:
    """Yield what each batch gave, as they come."""
    from threadpoolctl import threadpool_limits

    stop = threading.Event()

    def submit(number: int) -> Future[Any]:
        job = functools.partial(run_batch, folder, ensemble, number, threads=own.threads)
        if own.here:
            job = functools.partial(job, alone=False, stop=stop.is_set, progress=counted.of(number))
        return own.executor.submit(job)

    with threadpool_limits(1), unscheduled() if own.here else nullcontext():
        try:
            yield from JobQueue(own, submit, waiting, ahead=own.workers).results()
        finally:  # threads end with the member at hand
            stop.set()
            if own.here:
                own.executor.shutdown(cancel_futures=True)


def _warn_of_failures(result: xr.Dataset) -> None:
    failed = np.flatnonzero(result["failure"].values != "")
    if failed.size:
        warnings.warn(
            f"{failed.size} of {result.sizes['member']} members failed and hold nan, the first of them member "
            f"{int(result['member'][failed[0]])}: {result['failure'].values[failed[0]]}; see failure for each",
            MemberFailedWarning,
            stacklevel=3,
        )
