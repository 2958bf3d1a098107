"""Simulate the scenes of an ensemble in parallel, into a folder or batch by batch in memory.

:func:`design` makes the scenes, :func:`run` simulates them into a folder, :func:`cablepod.archive.open_ensemble` opens it as one
dataset.  :func:`batches` yields the results batch by batch and writes nothing.
"""

from __future__ import annotations

import functools
import os
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future
from contextlib import closing, suppress
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import check_times, taken
from cablepod._models import Model, model_of
from cablepod._resources import cores, defer_sigint
from cablepod.archive._attributes import with_own_id
from cablepod.archive._manifest import MODES, SCENES, merged_time_errors, sizes_of, time_errors
from cablepod.archive._open_ensemble import open_ensemble
from cablepod.batch._members import number_of_instants
from cablepod.batch._stack import bytes_of_member, check_members_fit
from cablepod.ensemble import _resume as resume
from cablepod.ensemble._cluster import Again
from cablepod.ensemble._collect_warnings import Note, emit_of_all_members, emit_warnings
from cablepod.ensemble._job import Done, compute_collecting, inputs_of, run_batch, write_batch
from cablepod.ensemble._models import accepted_time_error, check_model, check_scene_of_model
from cablepod.ensemble._workers import JobQueue, Progress, WorkerPool, check_workers, is_here, worker_pool
from cablepod.errors import ArchiveError, MemberFailedWarning, RunStopped, SceneError, scene_error, warn
from cablepod.integrate._request import Request, check_progress
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._mast import mast_parameters
from cablepod.scene._mast import scene_kind

#: Number of members for trial runs of the options before the ensemble runs.
N_PROBED = 5


def run(
    scenes: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    model: str | Callable[..., xr.Dataset] = "chain",
    modes: xr.Dataset | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    batch: int = 64,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> xr.Dataset:
    """Simulate the scenes of an ensemble into a folder; a repeated call continues an interrupted run.

    Parameters
    ----------
    scenes
        Scenes with ``member``, as of :func:`cablepod.ensemble.design`.
    path
        The folder, created if missing, for ``manifest.json``, ``scenes.nc``, ``modes.nc`` and the files ``batch_0000.nc``, ...;
        all files are written atomically.
    model
        "chain", "cable", "rigid", or with `modes` "galerkin" or "condensed"; "mast" for scenes with a mast, and only these.
        Or a model of your own: a function, or its name as "module:function"; see the page of this sub-package.
    modes
        Modes of a reduced model; of the guys of a mast, which need none.
    scheduler
        None: threads of this process.  "processes": processes of this machine; a script then needs ``if __name__ ==
        "__main__":``.  The address of a dask scheduler, or a ``distributed.Client``: its workers, whenever they come and leave.
        They write to the folder where they see it under the same path; this process writes what others send back.  The results
        do not depend on the scheduler, bit by bit.
    workers
        Number of threads or processes; all cores by default.
    batch
        Number of members in a file; they are computed by one call.
    overwrite
        Replace another ensemble in the folder, which remains until all members of this one are done, and damaged files, which are
        removed at once.  Complete files of this ensemble are kept.
    progress
        Callback receiving the completed fraction, 0 to 1.
    options
        Options of the model's ``simulate``.  Default outputs are those of the model and "tension_extremes" (without with
        ``quadrature``, by which there are none); of masts those of :func:`cablepod.mast.simulate`.

    Returns
    -------
    xarray.Dataset
        All results, lazily, as of :func:`cablepod.archive.open_ensemble`.  Failed members hold nan; ``failure`` has the reason.
        Masts with the output "guy_tension" also have ``fatigue_range (member, guy)`` [N], the equivalent range of one cycle a
        second for the exponent 4, within the window of the run.

    Raises
    ------
    SceneError
        For invalid scenes, model, modes, options or scheduler, before anything runs.
    ArchiveError
        If the folder holds another ensemble or damaged files, is in use or not writable, or the disk is full.
    RunStopped
        If the scheduler is lost, or the workers of a batch again and again.

    Warns
    -----
    WorkersWarning
        While there is no worker of a scheduler, for which a run waits without a limit, and of workers with other packages.
    MemberFailedWarning
        If members failed.
    NotConvergedWarning
        If members have not converged in time, with the worst in motion and in tension.  Other warnings of the members are emitted
        once for each category.
    """
    check_workers(scheduler, workers)
    check_progress(progress)
    plan, inputs, of_member = _prepare(scenes, model, modes, options, batch)
    with defer_sigint(), resume.open_store(path, plan, inputs, overwrite=overwrite) as store:
        missing = store.missing()
        notes: list[Note] = []
        total = Progress(progress, store.sizes, set(range(len(store.sizes))) - set(missing))
        if missing:
            _check_memory(of_member, plan, len(missing), scheduler, workers)
            with worker_pool(scheduler, workers, len(missing)) as pool:
                try:
                    with closing(_run_batches(pool, store, missing, total)) as results:
                        for number, (entry, batch_notes) in results:
                            store.add(number, entry)
                            notes += batch_notes
                            total.update(number, 1.0)
                finally:
                    with suppress(ArchiveError):  # the next run finds completed batches by their files
                        store.save()
        store.save()
        errors = merged_time_errors(store.manifest["done"].values()) or {}
    result = open_ensemble(path)
    notes = emit_of_all_members(notes, lambda: result)
    emit_warnings(notes, scenes.sizes["member"], errors, accepted_time_error(model_of(plan["model"]), plan["options"]))
    _warn_of_failures(_failures_in(result), scenes.sizes["member"])
    return result


def batches(
    scenes: xr.Dataset,
    *,
    model: str | Callable[..., xr.Dataset] = "chain",
    modes: xr.Dataset | None = None,
    scheduler: Any = None,
    workers: int | None = None,
    batch: int = 64,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Iterator[xr.Dataset]:
    """Simulate the scenes of an ensemble and yield the results batch by batch, in memory.

    Parameters
    ----------
    scenes, model, modes, scheduler, workers, batch, progress, options
        As of :func:`run`.

    Returns
    -------
    iterator of xarray.Dataset
        Results of the next members, in order, with the variables of the files of :func:`run`.  The number of batches that are
        being computed or wait to be taken is at most the number of workers plus one.

    Raises
    ------
    SceneError
        As :func:`run`.
    RunStopped
        As :func:`run`.

    Warns
    -----
    WorkersWarning, MemberFailedWarning, NotConvergedWarning
        As :func:`run`, those of members behind the last batch.
    """
    check_workers(scheduler, workers)
    check_progress(progress)
    plan, inputs, of_member = _prepare(scenes, model, modes, options, batch)
    _check_memory(of_member, plan, len(sizes_of(plan)), scheduler, workers)
    return _batches(plan, inputs, scheduler, workers, progress)


def _batches(
    plan: dict[str, Any],
    inputs: dict[str, xr.Dataset],
    scheduler: Any,
    workers: int | None,
    progress: Callable[[float], None] | None,
) -> Iterator[xr.Dataset]:
    """Yield the results of a prepared ensemble, batch by batch."""
    scenes, modes, size = inputs[SCENES], inputs.get(MODES), plan["batch"]
    sizes, hashed = sizes_of(plan), [provenance.input_of(dataset) for dataset in inputs.values()]
    total = Progress(progress, sizes, ())
    stop = threading.Event()
    with worker_pool(scheduler, workers, len(sizes)) as pool:

        def submit(number: int) -> Future[Any]:
            """Submit a batch."""
            members = scenes.isel(member=slice(number * size, (number + 1) * size))
            job = functools.partial(compute_collecting, members, plan["model"], modes, plan["options"], pool.threads)
            if pool.here:
                job = functools.partial(job, stop=stop.is_set, progress=total.of_batch(number))
            return pool.submit(job)

        queue = JobQueue(pool, submit, range(len(sizes)), limit=lambda slots: slots + 1)
        notes: list[Note] = []
        errors: dict[str, list[float]] = {}
        failures: dict[int, str] = {}
        accepted = accepted_time_error(model_of(plan["model"]), plan["options"])
        try:
            for number, (result, batch_notes) in enumerate(queue.in_order()):
                notes += batch_notes
                errors |= time_errors(result, accepted) or {}
                failures |= _failures_in(result)
                total.update(number, 1.0)
                record = {name: plan[name] for name in ("model", "options", "batch")} | {"number": number}
                yield provenance.record(result, function="ensemble.batches", parameters=record, inputs=hashed)
        finally:
            stop.set()
    emit_warnings(notes, plan["members"], errors, accepted)
    _warn_of_failures(failures, plan["members"])


# --- before anything runs -----------------------------------------------------------------------------------------------


def _prepare(
    scenes: Any, model: Any, modes: Any, options: dict[str, Any], batch: Any
) -> tuple[dict[str, Any], dict[str, xr.Dataset], float]:
    """Check all arguments; return plan, inputs (file name -> Dataset), and the size of the result of a member [bytes]."""
    scenes = taken("scenes", scenes, scene_kind(scenes))
    if "member" not in scenes.dims:
        raise SceneError("scenes: given no Dataset of scenes with member; allowed: a result of ensemble.design")
    chosen, resolved = check_model(model, modes, options)
    check_scene_of_model(scenes, chosen)
    size = integer(least=1, most=10**6)("batch", batch)
    _check_shapes(scenes, chosen, resolved)
    if "member" not in scenes.coords:
        scenes = scenes.assign_coords(member=np.arange(scenes.sizes["member"]))
    names = scenes["member"].values
    if names.dtype.kind not in "iu" or np.unique(names).size < names.size:  # by which failures and errors are kept
        raise scene_error("scenes: member", names.tolist(), "different whole numbers, or none")
    scenes = with_own_id(scenes).assign_attrs(stage="scenes")
    modes = None if modes is None else with_own_id(modes)
    start = _try_options(scenes, chosen, modes, resolved, {*options, "model", "modes", "layout", "times", "time"})
    of_member = 0.0 if start is None else bytes_of_member(start, number_of_instants(scenes, resolved.get("times")))
    inputs = {SCENES: scenes} | ({} if modes is None else {MODES: modes})
    return resume.plan_of(scenes, chosen.key, modes, resolved, size), inputs, of_member


def _check_shapes(scenes: xr.Dataset, model: Model, options: dict[str, Any]) -> None:
    """Refuse scenes whose results differ in shape."""
    option_of = {"time_duration": "times", "time_interval": "times"}
    if model.layout is None:
        option_of["chain_links"] = "points" if model.name == "cable" else "links"
    for name, option in option_of.items():
        varies = name in scenes and "member" in scenes[name].dims and np.unique(scenes[name].values).size > 1
        if varies and options[option] is None:
            allowed = f"one value for all members, as all results have one shape, or the option {option}"
            raise scene_error(name.replace("_", ".", 1), "different values", allowed)


def _try_options(
    scenes: xr.Dataset, model: Model, modes: xr.Dataset | None, options: dict[str, Any], names: set[str]
) -> xr.Dataset | None:
    """Refuse options that are invalid for all of a few members, by trial runs of zero duration; return the result of one."""
    modes_argument = () if modes is None else (modes,)
    if options.get("times") is not None:
        check_times(options["times"])
    window, errors = options.get("window"), []
    trial = {name: value for name, value in options.items() if name != "window"} | {"times": [0.0]}
    for i in dict.fromkeys(np.linspace(0, scenes.sizes["member"] - 1, N_PROBED).astype(int).tolist()):
        scene = scenes.isel(member=i)
        try:
            if options.get("times") is None:
                (mast_parameters if model.of_mast else parameters)(scene).times()
            if window is not None and not (model.of_mast or model.own):
                outputs = tuple(options["outputs"])
                request = Request.of(times=options.get("times"), outputs=outputs, allowed=outputs, window=window)
                request.instants(parameters(scene))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return model.simulate(scene, *modes_argument, **trial)
        except (ValueError, RunStopped, ArithmeticError) as error:
            errors.append(error)
            key = str(error).split(":")[0].replace(",", " ").split()
            if not names & set(key):
                return None  # the error is about this scene, not about the options
    raise errors[0]


def _check_memory(of_member: float, plan: Mapping[str, Any], batches: int, scheduler: Any, workers: int | None) -> None:
    """Refuse `batches` of members of so many bytes if memory would not hold those that this machine computes at a time."""
    if is_here(scheduler):  # others have their own memory
        at_a_time, size = min(workers or cores(), batches), min(plan["batch"], plan["members"])
        check_members_fit(at_a_time * size * of_member, "batch", f"{at_a_time} x {size} members at a time")


# --- while it runs ------------------------------------------------------------------------------------------------------


def _run_batches(
    pool: WorkerPool, store: resume.Store, missing: list[int], total: Progress
) -> Generator[tuple[int, tuple[dict[str, Any], list[Note]]], None, None]:
    """Run the missing batches; yield number, manifest entry and warnings in order of completion."""
    from threadpoolctl import threadpool_limits

    stop = threading.Event()
    folder, ensemble = store.folder, store.manifest["id"]
    sends = False  # whether workers get what they need with each batch, as some do not see the folder

    def submit(number: int) -> Future[Any]:
        """Submit a batch."""
        job = functools.partial(run_batch, folder, ensemble, number, threads=pool.threads)
        if pool.here:
            job = functools.partial(job, alone=False, stop=stop.is_set, progress=total.of_batch(number))
        else:
            job = functools.partial(job, token=store.token)
            job = functools.partial(job, inputs=inputs_of(folder, ensemble, number)) if sends else job
        return pool.submit(job)

    def settle(number: int, done: Done) -> Any:
        """Write what a worker sent back; return manifest entry and warnings."""
        nonlocal sends
        if done.entry is not None:
            return done.entry, done.notes
        if done.batch is None:
            sends = True
            return Again
        return write_batch(folder, store.manifest, number, done.batch), done.notes

    with threadpool_limits(1):
        try:
            yield from JobQueue(pool, submit, missing, limit=lambda slots: 2 * slots, settle=settle).results()
        finally:  # threads stop after their current member
            stop.set()
            if pool.here:
                pool.executor.shutdown(cancel_futures=True)


def _failures_in(result: xr.Dataset) -> dict[int, str]:
    """Return number and reason of each member of a result that failed."""
    members = zip(result["member"].values.tolist(), result["failure"].values.tolist(), strict=True)
    return {number: reason for number, reason in members if reason}


def _warn_of_failures(failures: Mapping[int, str], count: int) -> None:
    """Warn of the number of failed members among `count`, with the first reason."""
    if failures:
        first = next(iter(failures))
        warn(
            f"{len(failures)} of {count} members failed and hold nan, the first is member {first}: {failures[first]}; see the "
            "variable failure for all",
            MemberFailedWarning,
        )
