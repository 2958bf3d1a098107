"""One batch of an ensemble: its members simulated, put into a form that does not depend on how they came out, and written."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive
from cablepod.archive._manifest import (
    FAILURE,
    MODES,
    SCENES,
    batch_id,
    check_batch,
    entry_of,
    file_of,
    noted,
    read_manifest,
)
from cablepod.archive._write import check_target
from cablepod.batch._members import stop_when, thread_limit
from cablepod.conventions import ATTRIBUTE_UNITS
from cablepod.ensemble._collect_warnings import Note, collect_warnings
from cablepod.ensemble._models import MODELS
from cablepod.errors import AllFailedError, ArchiveError, RunStopped

# --- computing ----------------------------------------------------------------------------------------------------------


def compute(
    scenes: xr.Dataset,
    model: str,
    modes: xr.Dataset | None,
    options: Mapping[str, Any],
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate members; failures are marked, also where all fail.

    What a run tells in numbers lies along ``member``, whether it differs or not, and ``failure`` is always there: all batches of
    an ensemble hold the same variables.

    Parameters
    ----------
    scenes
        With ``member``.
    model
        One of :data:`MODELS`.
    modes
        Of a reduced model.
    options
        Those of the model's ``simulate``.
    progress
        Called with the part that is done.
    """
    simulate = MODELS[model]
    given = () if modes is None else (modes,)
    count, lost = scenes.sizes["member"], 0
    reasons: list[str] = []
    result: xr.Dataset | None = None
    while result is None and lost < count:
        rest = scenes.isel(member=slice(lost, None))
        try:
            result = simulate(rest, *given, **options, progress=progress)
        except (RunStopped, ValueError, ArithmeticError) as error:
            if isinstance(error.__cause__, AllFailedError):
                reasons += error.__cause__.reasons
                break
            # models that share their coefficients make them from the first member; is it this one that fails?
            reasons.append(_reason_of_one(rest.isel(member=slice(0, 1)), simulate, given, options, error))
            lost += 1
    varied = {name: item for name, item in scenes.variables.items() if item.dims == ("member",)}
    if result is None:
        made = xr.Dataset({"failure": ("member", np.array(reasons, dtype=str), FAILURE)}, varied)
        return made.assign_attrs(title=str(scenes.attrs.get("title", "scenes")))
    failure = [*reasons, *(result["failure"].values if "failure" in result else [""] * (count - lost))]
    bad = np.array([bool(reason) for reason in failure])
    variables = {name: _longer(item, lost) for name, item in result.variables.items() if name not in varied}
    for name, value in result.attrs.items():
        if isinstance(value, int | float | np.number) and not isinstance(value, bool | np.bool_):
            attrs = {"units": ATTRIBUTE_UNITS.get(str(name), "1"), "long_name": str(name).replace("_", " ")}
            variables[name] = xr.Variable("member", np.where(bad, np.nan, float(value)), attrs)
    variables["failure"] = xr.Variable("member", np.array(failure, dtype=str), FAILURE)
    made = xr.Dataset({**variables, **varied}).set_coords(
        [*varied, *(name for name in result.coords if name in variables)]
    )
    made.attrs = {name: value for name, value in result.attrs.items() if name not in made.variables}
    return made


def _reason_of_one(
    one: xr.Dataset,
    simulate: Callable[..., xr.Dataset],
    given: tuple[Any, ...],
    options: Mapping[str, Any],
    error: Exception,
) -> str:
    """Return why a single member fails; where it does not, it is the batch as a whole that cannot be."""
    try:
        simulate(one, *given, **options)
    except (RunStopped, ValueError, ArithmeticError) as own:
        return str(own)
    raise error


def _longer(item: xr.Variable, lost: int) -> xr.Variable:
    """Return a variable with rows of nan for members before it."""
    if not lost or "member" not in item.dims or item.dtype.kind != "f":
        return item
    return xr.Variable(item.dims, np.concatenate([np.full((lost, *item.shape[1:]), np.nan), item.values]), item.attrs)


# --- in a worker --------------------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=2)
def _inputs(folder: Path, ensemble: str) -> tuple[dict[str, Any], xr.Dataset, xr.Dataset | None]:
    """Read what all batches share, once in each process."""
    manifest = _own_manifest(folder, ensemble)
    scenes = archive.read(folder / SCENES)
    modes = archive.read(folder / MODES) if manifest["modes"] else None
    return manifest, scenes, modes


def _own_manifest(folder: Path, ensemble: str) -> dict[str, Any]:
    found = read_manifest(folder)
    if found["id"] != ensemble:
        raise ArchiveError(
            f"{folder}: holds the ensemble {found['id']} and not {ensemble}, so it was changed during the run; give another path"
        )
    return found


def check_access(folder: Path, ensemble: str) -> str:
    """Tell what keeps this process from working on an ensemble; an empty text where nothing does."""
    try:
        _own_manifest(folder, ensemble)
        check_target(folder / "any.nc", overwrite=False)
    except ArchiveError as error:
        return str(error)
    return ""


def unscheduled() -> AbstractContextManager[Any]:
    """Keep xarray from asking the scheduler for a lock at every step of writing a file that nobody else writes."""
    import dask

    return dask.config.set(scheduler="synchronous")


def run_batch(
    folder: Path,
    ensemble: str,
    number: int,
    *,
    threads: int = 1,
    alone: bool = True,
    stop: Callable[[], bool] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[str, Any], list[Note]]:
    """Compute and write a batch, unless its file is there.

    Parameters
    ----------
    folder, ensemble
        Where, and the id of the ensemble that should be there.
    number
        Of the batch.
    threads
        In which members run side by side.
    alone
        Whether this process has nothing else to do, so that BLAS may be held to one thread.
    stop
        Asked before each member.
    progress
        Called with the part of the batch that is done.

    Returns
    -------
    tuple
        What the manifest notes of the file, and the warnings that came up.
    """
    from threadpoolctl import threadpool_limits

    path = folder / file_of(number)
    manifest, scenes, modes = _inputs(folder, ensemble)
    if path.exists():  # of a worker that was thought dead
        check_batch(folder, manifest | {"done": {}}, number)
        return entry_of(path), []
    size = manifest["batch"]
    begin = time.perf_counter()
    with ExitStack() as held:
        notes = held.enter_context(collect_warnings())
        held.enter_context(thread_limit(threads))
        held.enter_context(stop_when(stop) if stop is not None else nullcontext())
        if alone:
            held.enter_context(threadpool_limits(1))
            held.enter_context(unscheduled())
        mine = scenes.isel(member=slice(number * size, (number + 1) * size))
        batch = compute(mine, manifest["model"], modes, manifest["options"], progress)
        stages = json.loads(manifest["attributes"]["history_json"])
        own = stages[-1]
        own |= {
            "id": batch_id(ensemble, number),
            "parameters": {**own["parameters"], "ensemble": ensemble, "number": number},
        }
        for name in ("written", "sha256", "wall_time_s"):
            own.pop(name, None)  # its own are noted on writing
        batch.attrs |= {
            "id": own["id"],
            "history_json": json.dumps(stages, sort_keys=True),
            "history": manifest["inputs_history"],
            "title": f"{manifest['attributes']['title']}, batch {number}",
            "wall_time_s": time.perf_counter() - begin,
        }
        try:
            archive.write(batch, path)
        except ArchiveError:
            if not path.exists():
                raise
            check_batch(folder, manifest | {"done": {}}, number)
    return noted(batch, path), notes
