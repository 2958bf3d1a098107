"""The folder of an ensemble during a run: lock, manifest, inputs and checks of its files."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import time
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive, provenance
from cablepod._models import model_of
from cablepod._resources import check_sigint
from cablepod.archive._atomic import atomic_file
from cablepod.archive._attributes import root_attributes
from cablepod.archive._folder import check_folder, lock, path_of
from cablepod.archive._manifest import (
    COMPLETE,
    KIND,
    MANIFEST,
    MAPS,
    MODES,
    REPLACEMENT,
    SCENES,
    check_batch,
    faults_text,
    file_of,
    manifest_text,
    read_entry,
    read_manifest,
    sizes_of,
)
from cablepod.archive._read import version
from cablepod.archive._seal import SCHEMA
from cablepod.batch._stack import is_varied
from cablepod.ensemble._job import LOCK
from cablepod.ensemble._models import accepted_time_error
from cablepod.errors import ArchiveError, SceneError, shown

#: Minimum time between two writes of the manifest [s]; after a crash, later batches are found by their files.
SAVE_INTERVAL = 1.0
#: Maximum number of texts or lists of a key that the manifest names.
MAX_CHOICES = 64
#: Key of a plan -> name in messages.
PLAN_NAMES = {
    "model": "the model",
    "modes": "the modes",
    "members": "the number of members",
    "batch": "the size of batches",
}


class Store:
    """Manifest of an ensemble and its batch files."""

    def __init__(self, folder: Path, manifest: dict[str, Any], token: str) -> None:
        self.folder = folder
        self.manifest = manifest
        self.token = token  #: word in the lock file, by which workers know the folder of this run
        self.last_save = -np.inf

    @property
    def sizes(self) -> list[int]:
        """Number of members in each batch."""
        return sizes_of(self.manifest)

    def missing(self) -> list[int]:
        """Return the numbers of the batches that are not complete."""
        return [number for number in range(len(self.sizes)) if str(number) not in self.manifest["done"]]

    def add(self, number: int, entry: Mapping[str, Any]) -> None:
        """Add the entry of a complete batch to the manifest."""
        self.manifest["done"][str(number)] = dict(entry)
        if time.monotonic() - self.last_save > SAVE_INTERVAL:
            self.save()

    def save(self) -> None:
        """Write the manifest.

        Raises
        ------
        ArchiveError
            If the file cannot be written.
        """
        with atomic_file(self.folder / MANIFEST) as part:
            part.write_text(manifest_text(self.manifest), encoding="utf-8")
        self.last_save = time.monotonic()

    def check(self, *, overwrite: bool) -> None:
        """Update the manifest from the batch files: add complete ones, drop missing ones.

        Raises
        ------
        ArchiveError
            For damaged files and those of another ensemble, named; with `overwrite` they are removed instead.
        """
        faults = []
        done = self.manifest["done"]
        for number in range(len(self.sizes)):
            check_sigint()
            path = self.folder / file_of(number)
            if not path.exists():
                done.pop(str(number), None)
                continue
            try:
                check_batch(self.folder, self.manifest, number)
                if str(number) not in done:
                    done[str(number)] = read_entry(path)
            except ArchiveError as error:
                done.pop(str(number), None)
                if overwrite:
                    path.unlink()
                else:
                    faults.append(str(error))
        if faults:
            raise ArchiveError(f"{faults_text(faults)}; give overwrite=True to compute them again")


@contextlib.contextmanager
def open_store(
    path: str | os.PathLike[str], plan: Mapping[str, Any], inputs: Mapping[str, xr.Dataset], *, overwrite: bool
) -> Iterator[Store]:
    """Open the folder of an ensemble for writing, with its lock; create it if missing.

    Another ensemble there remains as it is until all members of this one are done, which are in a folder of their own until then.
    A new ensemble that is refused in this context before a batch of it is done leaves nothing.

    Parameters
    ----------
    path
        The folder.
    plan
        Result of :func:`plan_of`.
    inputs
        Scenes and modes, file name -> Dataset.
    overwrite
        Replace another ensemble and damaged files.

    Yields
    ------
    Store
        Store with all complete batches in its manifest.

    Raises
    ------
    ArchiveError
        If the folder is not writable, in use, or holds another ensemble or damaged files.
    """
    folder = path_of(path).resolve()  # workers may have another working directory
    made = not folder.exists()
    check_folder(folder, (), overwrite=overwrite, key="path")
    with _locked(folder) as token:
        _complete_replacement(folder)  # during which a run was killed
        if not _holds_another(folder, plan, overwrite=overwrite):
            with _cleared_if_refused(folder, made=made):
                yield _opened(folder, token, plan, inputs, overwrite=overwrite)
            return
        new = folder / REPLACEMENT
        if not _has_manifest_of(new, plan):
            _remove(new)
        new.mkdir(exist_ok=True)
        with _locked(new) as token, _cleared_if_refused(new, made=True):
            yield _opened(new, token, plan, inputs, overwrite=overwrite)
        new.rename(folder / COMPLETE)
        _complete_replacement(folder)


@contextlib.contextmanager
def _cleared_if_refused(folder: Path, *, made: bool) -> Iterator[None]:
    """Remove the files of a new ensemble, and its folder if it was `made` for it, on a refusal before a batch is done."""
    is_new = not (folder / MANIFEST).exists()
    try:
        yield
    except SceneError:
        if is_new and not list(folder.glob("batch_*.nc")):
            for path in [folder] if made else [folder / MANIFEST, *_files_of_ensemble(folder)]:
                _remove(path)
        raise


def _opened(
    folder: Path, token: str, plan: Mapping[str, Any], inputs: Mapping[str, xr.Dataset], *, overwrite: bool
) -> Store:
    """Return the store of a folder that is locked and holds no other ensemble."""
    for part in folder.glob(".cablepod-*.part"):  # left by killed runs
        _remove(part)
    manifest = read_manifest(folder) if _has_manifest_of(folder, plan) else None
    _write_inputs(folder, inputs, overwrite=overwrite or manifest is None)
    store = Store(folder, manifest or _new_manifest(folder, plan, inputs), token)
    store.check(overwrite=overwrite)
    store.save()
    return store


def _complete_replacement(folder: Path) -> None:
    """Put the files of a complete ensemble in place of those of another one, or go on with that."""
    new = folder / COMPLETE
    if (new / MANIFEST).exists():  # moved last
        (folder / MANIFEST).unlink(missing_ok=True)  # first: without it, remaining files belong to no ensemble
        manifest = read_manifest(new)
        kept = {SCENES, *([MODES] if manifest["modes"] else []), *map(file_of, range(len(sizes_of(manifest))))}
        for path in [*_files_of_ensemble(folder), *(folder / name for name in MAPS)]:
            if path.name not in kept:
                path.unlink(missing_ok=True)
        for path in _files_of_ensemble(new):
            path.replace(folder / path.name)
        (new / MANIFEST).replace(folder / MANIFEST)
    _remove(new)


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def plan_of(
    scenes: xr.Dataset, model: str, modes: xr.Dataset | None, options: Mapping[str, Any], batch: int
) -> dict[str, Any]:
    """Return the arguments that determine the results of an ensemble, with id, hashes of the inputs, varied ranges and title.

    The id is a hash of the arguments and of the ids of scenes and modes.
    """
    taken = [provenance.input_of(dataset) for dataset in (scenes, modes) if dataset is not None]
    given = {"model": model, "members": scenes.sizes["member"], "batch": batch, "options": dict(options)}
    head = provenance.record(xr.Dataset(), function="ensemble.run", parameters=given, inputs=taken)
    varied = {
        str(name): _varied(variable)
        for name, variable in scenes.variables.items()
        if name != "member" and is_varied(variable)
    }
    return {
        **given,
        "modes": None if modes is None else f"{taken[1].id} {taken[1].hash}",
        "scenes": f"{taken[0].id} {taken[0].hash}",
        "id": head.attrs["id"],
        "input_hashes": [given.hash for given in taken],
        "varied": varied,
        "title": f"{scenes.attrs.get('title', 'scenes')}: {model}",
    }


def _varied(variable: xr.Variable) -> Any:
    """Return least and largest value and units of a varied number, or the different texts and lists of another key."""
    if variable.dims == ("member",) and variable.dtype.kind in "if":
        return [float(np.nanmin(variable.values)), float(np.nanmax(variable.values)), variable.attrs.get("units")]
    values = variable.values.tolist()
    return {"choices": [value for k, value in enumerate(values) if value not in values[:k]][:MAX_CHOICES]}


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[str]:
    """Hold the lock of a folder, which the operating system releases when the process ends; yield a new word in its file."""
    token = uuid.uuid4().hex
    with (folder / LOCK).open("a") as file:
        lock(file.fileno(), folder)
        file.truncate(0)
        file.write(token)
        file.flush()
        os.fsync(file.fileno())  # other machines read it
        yield token


def _files_of_ensemble(folder: Path) -> list[Path]:
    """Return the files of batches, scenes and modes."""
    return [*folder.glob("batch_*.nc"), *(folder / name for name in (SCENES, MODES) if (folder / name).exists())]


def _has_manifest_of(folder: Path, plan: Mapping[str, Any]) -> bool:
    """Tell whether a folder has the manifest of this ensemble."""
    with contextlib.suppress(ArchiveError):
        return bool(read_manifest(folder)["id"] == plan["id"])
    return False


def _holds_another(folder: Path, plan: Mapping[str, Any], *, overwrite: bool) -> bool:
    """Tell whether a folder holds another ensemble, which is to be replaced; refuse it without `overwrite`."""
    if (folder / MANIFEST).exists() and not overwrite:
        manifest = read_manifest(folder)
        if manifest["id"] != plan["id"]:
            raise ArchiveError(
                f"{folder}: holds another ensemble: {'; '.join(_differences(manifest, plan))}; allowed: the same again, another "
                "folder, or overwrite=True to replace it"
            )
    if _has_manifest_of(folder, plan) or _has_files_of(folder, plan):
        return False
    files = _files_of_ensemble(folder)
    if files and not overwrite:
        names = ", ".join(sorted(path.name for path in files)[:3])
        raise ArchiveError(
            f"{folder}: holds {names} but no {MANIFEST}; give another folder, or overwrite=True to replace them"
        )
    return bool(files) or (folder / MANIFEST).exists()


def _has_files_of(folder: Path, plan: Mapping[str, Any]) -> bool:
    """Tell whether the folder holds these scenes and only batches of this ensemble, as without its manifest."""
    with contextlib.suppress(ArchiveError):
        own = [number for number in range(len(sizes_of(plan))) if (folder / file_of(number)).exists()]
        for number in own:
            check_batch(folder, plan, number)
        if len(own) < len(list(folder.glob("batch_*.nc"))):
            return False
        return bool(archive.read(folder / SCENES).attrs["id"] == plan["scenes"].split()[0])
    return False


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return texts for the differences between two plans."""
    differences = []
    for key, name in PLAN_NAMES.items():
        if old.get(key) != new[key]:
            differences.append(f"{name} was {shown(old.get(key))} and is {shown(new[key])}")
    if old.get("model") == new["model"]:
        before = old.get("options", {})
        for name in dict.fromkeys([*before, *new["options"]]):
            if before.get(name) != new["options"].get(name):
                differences.append(
                    f"the option {name} was {shown(before.get(name))} and is {shown(new['options'].get(name))}"
                )
    if old.get("scenes") != new["scenes"]:
        varied = [
            name
            for name in {**old.get("varied", {}), **new["varied"]}
            if old["varied"].get(name) != new["varied"].get(name)
        ]
        differences.append("the scenes differ" + (f", in {', '.join(varied)}" if varied else ""))
    return differences or ["its id differs"]


def _write_inputs(folder: Path, inputs: Mapping[str, xr.Dataset], *, overwrite: bool) -> None:
    """Write scenes and modes, unless their files exist."""
    for name, dataset in inputs.items():
        path = folder / name
        if path.exists() and not overwrite:
            there = archive.read(path).attrs["id"]
            if dataset.attrs.get("id", there) != there:
                raise ArchiveError(f"{path}: is of another ensemble; take it from a backup, or overwrite=True")
            continue
        archive.write(dataset, path, overwrite=True)


def _new_manifest(folder: Path, plan: Mapping[str, Any], inputs: Mapping[str, xr.Dataset]) -> dict[str, Any]:
    """Return the manifest of an ensemble without batches."""
    datasets = [archive.read(folder / name) for name in inputs]
    stages = provenance.merged_stages(dataset.attrs.get("history_json", "[]") for dataset in datasets)
    # long arrays among the options are shortened here; the manifest holds them in full
    parameters = {name: provenance.to_json(plan[name]) for name in ("model", "members", "batch", "options")}
    stage = {
        "id": plan["id"],
        "function": "ensemble.run",
        "parameters": parameters,
        "inputs": [str(dataset.attrs["id"]) for dataset in datasets],
        "input_hashes": plan["input_hashes"],
    }
    history = "\n".join(
        dict.fromkeys(line for dataset in datasets for line in str(dataset.attrs["history"]).split("\n"))
    )
    head: dict[str, Any] = {"title": plan["title"], "id": plan["id"], "history": history}
    head["accepted_time_error"] = accepted_time_error(model_of(plan["model"]), plan["options"])
    head["history_json"] = json.dumps([*map(json.loads, stages.values()), stage], sort_keys=True)
    attributes = root_attributes(xr.Dataset(attrs=head), {})
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "version": version(),
        **{name: plan[name] for name in ("id", "model", "modes", "members", "batch", "options", "scenes", "varied")},
        "attributes": {
            name: value.item() if isinstance(value, np.generic) else value for name, value in attributes.items()
        },
        "inputs_history": history,
        "done": {},
    }
