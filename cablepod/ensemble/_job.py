"""One batch of an ensemble: its members simulated, put into a form that does not depend on how they came out, and written."""

from __future__ import annotations

import functools
import inspect
import json
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive, cable, chain, condensed, galerkin, rigid
from cablepod.archive import _ensemble as archive_ensemble
from cablepod.archive._ensemble import FAILURE, batch_id, file_of
from cablepod.archive._read import ArchiveError
from cablepod.archive._write import check_target
from cablepod.batch import _members as members
from cablepod.conventions import ATTRIBUTE_UNITS
from cablepod.integrate._stepping import RunStopped
from cablepod.parameters._schema import refuse

MODELS: Mapping[str, Callable[..., xr.Dataset]] = {
    "chain": chain.simulate,
    "cable": cable.simulate,
    "rigid": rigid.simulate,
    "galerkin": galerkin.simulate,
    "condensed": condensed.simulate,
}
REDUCED = ("galerkin", "condensed")
Note = tuple[type[Warning], str]


def options_of(model: str) -> dict[str, Any]:
    """Return the options of a model's ``simulate`` that an ensemble may have, with their defaults."""
    own = inspect.signature(MODELS[model]).parameters.values()
    return {item.name: item.default for item in own if item.kind is item.KEYWORD_ONLY and item.name != "progress"}


# --- warnings -----------------------------------------------------------------------------------------------------------


class _Listener:
    """Notes the warnings of each thread; the interpreter has one place for all of them."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.open = 0
        self.log: list[tuple[int, Note]] = []
        self.held = ExitStack()

    def begin(self) -> None:
        with self.lock:
            if not self.open:
                self.held.enter_context(warnings.catch_warnings())
                warnings.simplefilter("always")
                warnings.showwarning = self._note
            self.open += 1

    def _note(self, message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        self.log.append((threading.get_ident(), (category, str(message))))

    def end(self) -> list[Note]:
        """Return the notes of this thread; the last one to go takes those of threads that nobody waits for too."""
        with self.lock:
            self.open -= 1
            own = [note for thread, note in self.log if thread == threading.get_ident() or not self.open]
            self.log = [item for item in self.log if item[0] != threading.get_ident() and self.open]
            if not self.open:
                self.held.close()
            return own


_LISTENER = _Listener()


@contextmanager
def listening() -> Iterator[list[Note]]:
    """Keep the warnings that come up to be told later; the list is filled on leaving."""
    notes: list[Note] = []
    _LISTENER.begin()
    try:
        yield notes
    finally:
        notes += _LISTENER.end()


def tell(notes: list[Note], count: int) -> None:
    """Warn once of each category: how often it came up, and what was said first; of failures from their number."""
    for category in dict.fromkeys(category for category, _ in notes):
        texts = [text for own, text in notes if own is category]
        if category is members.MemberFailedWarning:
            continue
        often = f" (and {len(texts) - 1} more such warnings in {count} members)" if len(texts) > 1 else ""
        warnings.warn(texts[0] + often, category, stacklevel=4)


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
            if isinstance(error.__cause__, members.AllFailedError):
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
    scenes = archive.read(folder / archive_ensemble.SCENES)
    modes = archive.read(folder / archive_ensemble.MODES) if manifest["modes"] else None
    return manifest, scenes, modes


def _own_manifest(folder: Path, ensemble: str) -> dict[str, Any]:
    found = archive_ensemble.read_manifest(folder)
    if found["id"] != ensemble:
        raise ArchiveError(
            f"{folder}: holds the ensemble {found['id']} and not {ensemble}, so it was changed during the run; give another path"
        )
    return found


def sees(folder: Path, ensemble: str) -> str:
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


def work(
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
        archive_ensemble.check_batch(folder, manifest | {"done": {}}, number)
        return archive_ensemble.entry_of(path), []
    size = manifest["batch"]
    begin = time.perf_counter()
    with ExitStack() as held:
        notes = held.enter_context(listening())
        held.enter_context(members.threads(threads))
        held.enter_context(members.until(stop) if stop is not None else nullcontext())
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
            archive_ensemble.check_batch(folder, manifest | {"done": {}}, number)
    return archive_ensemble.noted(batch, path), notes


def check_model(model: Any, modes: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """Check the names of a model and of its options; returns the options, defaults filled in, as a file holds them.

    Raises
    ------
    SceneError
        Naming what was given and what is allowed.
    """
    if not isinstance(model, str) or model not in MODELS:
        raise refuse("model", model, "one of " + ", ".join(f'"{name}"' for name in MODELS))
    if model in REDUCED and not isinstance(modes, xr.Dataset):
        raise refuse("modes", modes, f'the Dataset of modes that model "{model}" runs on, as pod.decompose gives it')
    if model not in REDUCED and modes is not None:
        raise refuse("modes", "a value", f'none for model "{model}"; they are for {" and ".join(REDUCED)}')
    known = options_of(model)
    for name in options:
        if name not in known:
            raise refuse(f"option {name}", options[name], f'an option of model "{model}": {", ".join(known)}')
    return {name: _plain(name, options.get(name, default)) for name, default in known.items()}


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, xr.DataArray | np.ndarray):
        value = np.asarray(value).tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return [_plain(name, item) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise refuse(name, value, "a number, a text or a list of them")
