"""One batch of an ensemble: simulate its members, assemble results of uniform layout, write the file."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod import archive
from cablepod._models import model_of
from cablepod.archive._manifest import (
    FAILURE,
    MODES,
    SCENES,
    batch_id,
    check_batch,
    entry_of,
    file_of,
    read_entry,
    read_manifest,
)
from cablepod.archive._write import check_target
from cablepod.batch._members import stop_when, thread_limit
from cablepod.batch._stack import blank, is_varied
from cablepod.conventions import attribute_labels
from cablepod.ensemble._collect_warnings import Note, collect_warnings
from cablepod.errors import AllFailedError, ArchiveError, RunStopped
from cablepod.mast._output import guy_fatigue

#: File that holds the lock of the folder and the word of its run.
LOCK = ".cablepod-lock"

# --- computing ----------------------------------------------------------------------------------------------------------


def compute(
    scenes: xr.Dataset,
    model: str,
    modes: xr.Dataset | None,
    options: Mapping[str, Any],
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate members and mark failures, also if all members fail.

    Numeric attributes of the run become variables along ``member``, and ``failure`` is always present, so that all batches of an
    ensemble hold the same variables.  Masts get the fatigue ranges of their guys.

    Parameters
    ----------
    scenes
        Scenes with ``member``.
    model
        Name of :data:`cablepod._models.MODELS`, or "module:function".
    modes
        Modes of a reduced model, else None.
    options
        Options of the model's ``simulate``.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    xarray.Dataset
        Results of all members, nan for failed ones; only ``failure (member)`` and the parameters if all failed.
    """
    chosen = model_of(model)
    result, reasons = _simulate_members(scenes, chosen.simulate, () if modes is None else (modes,), options, progress)
    varied = {name: variable for name, variable in scenes.variables.items() if is_varied(variable)}
    if result is None:
        failures = xr.Dataset({"failure": ("member", np.array(reasons, dtype=str), FAILURE)}, varied)
        return failures.assign_attrs(title=str(scenes.attrs.get("title", "scenes")))
    if chosen.of_mast and (ranges := guy_fatigue(result, options.get("window"))) is not None:
        result = result.assign(fatigue_range=ranges)
    skipped = len(reasons)
    later = result["failure"].values if "failure" in result else [""] * (scenes.sizes["member"] - skipped)
    failure = [*reasons, *later]
    failed = np.array([bool(reason) for reason in failure])
    variables = {name: _pad(variable, skipped) for name, variable in result.variables.items() if name not in varied}
    for name, value in result.attrs.items():
        if isinstance(value, int | float | np.number) and not isinstance(value, bool | np.bool_):
            numbers = np.where(failed, np.nan, float(value))
            variables[name] = xr.Variable("member", numbers, attribute_labels(str(name)))
    variables["failure"] = xr.Variable("member", np.array(failure, dtype=str), FAILURE)
    batch = xr.Dataset({**variables, **varied}).set_coords(
        [*varied, *(name for name in result.coords if name in variables)]
    )
    batch.attrs = {name: value for name, value in result.attrs.items() if name not in batch.variables}
    return batch


def compute_collecting(
    scenes: xr.Dataset,
    model: str,
    modes: xr.Dataset | None,
    options: Mapping[str, Any],
    threads: int,
    *,
    stop: Callable[[], bool] = bool,
    progress: Callable[[float], None] | None = None,
) -> tuple[xr.Dataset, list[Note]]:
    """Do :func:`compute` with so many threads; return its results and warnings.  `stop` is called before each member."""
    with collect_warnings() as notes, thread_limit(threads), stop_when(stop):
        result = compute(scenes, model, modes, options, progress)
    return result, notes


def _simulate_members(
    scenes: xr.Dataset,
    simulate: Callable[..., xr.Dataset],
    modes: tuple[xr.Dataset, ...],
    options: Mapping[str, Any],
    progress: Callable[[float], None] | None,
) -> tuple[xr.Dataset | None, list[str]]:
    """Simulate members; return the results (None if all fail) and the reasons of skipped leading members.

    Leading members are skipped if they alone make the whole call fail.
    """
    reasons: list[str] = []
    while len(reasons) < scenes.sizes["member"]:
        rest = scenes.isel(member=slice(len(reasons), None))
        try:
            return simulate(rest, *modes, **options, progress=progress), reasons
        except (RunStopped, ValueError, ArithmeticError) as error:
            if isinstance(error.__cause__, AllFailedError):
                return None, reasons + error.__cause__.reasons
            # reduced models compute shared coefficients from the first member: check if this member alone fails
            reasons.append(_failure_reason(rest.isel(member=slice(0, 1)), simulate, modes, options, error))
    return None, reasons


def _failure_reason(
    scene: xr.Dataset,
    simulate: Callable[..., xr.Dataset],
    modes: tuple[xr.Dataset, ...],
    options: Mapping[str, Any],
    error: Exception,
) -> str:
    """Return the reason of failure of a single member; raise `error` if it does not fail."""
    try:
        simulate(scene, *modes, **options)
    except (RunStopped, ValueError, ArithmeticError) as own_error:
        return str(own_error)
    raise error


def _pad(variable: xr.Variable, skipped: int) -> xr.Variable:
    """Return a variable with rows for the `skipped` leading members, which failed."""
    if not skipped or "member" not in variable.dims:
        return variable
    padding = np.full((skipped, *variable.shape[1:]), blank(variable.dtype), variable.dtype)
    return xr.Variable(variable.dims, np.concatenate([padding, variable.values]), variable.attrs)


# --- in a worker --------------------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=2)
def _inputs(folder: Path, ensemble: str) -> tuple[dict[str, Any], xr.Dataset, xr.Dataset | None]:
    """Read manifest, scenes and modes, once in each process."""
    manifest = _checked_manifest(folder, ensemble)
    scenes = archive.read(folder / SCENES)
    modes = archive.read(folder / MODES) if manifest["modes"] else None
    return manifest, scenes, modes


def _checked_manifest(folder: Path, ensemble: str) -> dict[str, Any]:
    """Read the manifest of a folder, and refuse that of another ensemble."""
    manifest = read_manifest(folder)
    if manifest["id"] != ensemble:
        raise ArchiveError(
            f"{folder}: was changed during the run, it holds ensemble {manifest['id']} instead of {ensemble}; give another path"
        )
    return manifest


def unseen(folder: Path, ensemble: str, token: str) -> str:
    """Return why this process cannot write to the folder of a run, or an empty text.

    `token` is the word in the lock file: another folder of the same path, on another machine, has none or another one.
    """
    try:
        if (folder / LOCK).read_text(encoding="ascii") != token:
            return f"{folder}: is another folder"
        _checked_manifest(folder, ensemble)
        check_target(folder / "any.nc", overwrite=False)
    except (ArchiveError, OSError, ValueError) as error:
        return str(error)
    return ""


class Inputs(NamedTuple):
    """What the members of one batch need: part of the manifest, their scenes, modes of reduced models."""

    manifest: Mapping[str, Any]
    scenes: xr.Dataset
    modes: xr.Dataset | None


class Done(NamedTuple):
    """Answer of a worker: entry of the manifest for a file that it wrote, otherwise its results; both None if it needs inputs."""

    entry: dict[str, Any] | None
    batch: xr.Dataset | None
    notes: list[Note]


def inputs_of(folder: Path, ensemble: str, number: int) -> Inputs:
    """Return what a batch needs, from the files of the folder."""
    manifest, scenes, modes = _inputs(folder, ensemble)
    size = manifest["batch"]
    used = {name: manifest[name] for name in ("id", "model", "batch", "options", "attributes", "inputs_history")}
    return Inputs(used, scenes.isel(member=slice(number * size, (number + 1) * size)), modes)


def run_batch(
    folder: Path,
    ensemble: str,
    number: int,
    *,
    token: str | None = None,
    inputs: Inputs | None = None,
    threads: int = 1,
    alone: bool = True,
    stop: Callable[[], bool] = bool,
    progress: Callable[[float], None] | None = None,
) -> Done:
    """Compute a batch, and write it unless its file exists or this process does not see the folder.

    Parameters
    ----------
    folder, ensemble
        Folder, and id of the ensemble expected there.
    number
        Number of the batch.
    token
        Word in the lock file; None in the process that holds the lock.
    inputs
        What a process needs that does not see the folder.
    threads
        Number of threads for the members.
    alone
        Whether this process runs one batch at a time, so that BLAS may be limited to one thread.
    stop
        Called before each member; True cancels the batch.
    progress
        Callback receiving the completed fraction of the batch, 0 to 1.

    Returns
    -------
    Done
        Entry or results, and the warnings of the run.
    """
    from threadpoolctl import threadpool_limits

    sees = token is None or not unseen(folder, ensemble, token)
    if sees and (folder / file_of(number)).exists():  # written by a worker that was considered dead
        return Done(write_batch(folder, {"id": ensemble}, number, None), None, [])
    if not sees and inputs is None:
        return Done(None, None, [])
    manifest, members, modes = inputs_of(folder, ensemble, number) if inputs is None else inputs
    start = time.perf_counter()
    with threadpool_limits(1) if alone else nullcontext():
        batch, notes = compute_collecting(
            members, manifest["model"], modes, manifest["options"], threads, stop=stop, progress=progress
        )
    batch.attrs |= _batch_attributes(manifest, ensemble, number) | {"wall_time_s": time.perf_counter() - start}
    if token is None:
        return Done(write_batch(folder, manifest, number, batch), None, notes)
    if sees and not unseen(folder, ensemble, token):  # still: the run may have ended meanwhile
        with suppress(ArchiveError):  # the client writes it, or has the same reason not to
            return Done(write_batch(folder, manifest, number, batch), None, notes)
    return Done(None, batch, notes)


def write_batch(folder: Path, manifest: Mapping[str, Any], number: int, batch: xr.Dataset | None) -> dict[str, Any]:
    """Write the results of a batch unless its file exists; return its entry of the manifest.

    Raises
    ------
    ArchiveError
        If it cannot be written, or the file is none of this ensemble.
    """
    path = folder / file_of(number)
    if batch is not None:
        try:
            archive.write(batch, path)
            return entry_of(batch)
        except ArchiveError:
            if not path.exists():
                raise
    check_batch(folder, manifest, number)
    return read_entry(path)


def _batch_attributes(manifest: Mapping[str, Any], ensemble: str, number: int) -> dict[str, Any]:
    """Return id, history, title and accepted time error of a batch, from those of its ensemble."""
    stages = json.loads(manifest["attributes"]["history_json"])
    stage = stages[-1]
    stage |= {
        "id": batch_id(ensemble, number),
        "parameters": {**stage["parameters"], "ensemble": ensemble, "number": number},
    }
    for name in ("written", "wall_time_s"):
        stage.pop(name, None)  # archive.write sets those of the batch
    return {
        "id": stage["id"],
        "history_json": json.dumps(stages, sort_keys=True),
        "history": manifest["inputs_history"],
        "title": f"{manifest['attributes']['title']}, batch {number}",
        **{name: value for name, value in manifest["attributes"].items() if name == "accepted_time_error"},
    }
