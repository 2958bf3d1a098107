"""The folder of an ensemble while it is being worked on: what it should hold, what it holds, and who may write."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive, provenance
from cablepod.archive._atomic import atomic_file
from cablepod.archive._attributes import root_attributes
from cablepod.archive._manifest import (
    KIND,
    MANIFEST,
    MODES,
    SCENES,
    check_batch,
    entry_of,
    file_of,
    read_manifest,
    sizes_of,
)
from cablepod.archive._read import SCHEMA, version
from cablepod.archive._write import check_target, reason
from cablepod.batch._sigint import check_sigint
from cablepod.errors import ArchiveError, shown

LOCK = ".cablepod-lock"
#: The manifest is written at most once in so many seconds; what a killed run did not note is found by its files.
SAVE_EVERY = 1.0
NAMES = {"model": "the model", "modes": "the modes", "members": "the number of members", "batch": "the size of batches"}


class Store:
    """The manifest of an ensemble and the files that it speaks of."""

    def __init__(self, folder: Path, manifest: dict[str, Any]) -> None:
        self.folder = folder
        self.manifest = manifest
        self.saved = -np.inf

    @property
    def sizes(self) -> list[int]:
        """Number of members in each batch."""
        return sizes_of(self.manifest)

    def waiting(self) -> list[int]:
        """Return the numbers of the batches that are not done."""
        return [number for number in range(len(self.sizes)) if str(number) not in self.manifest["done"]]

    def note(self, number: int, entry: Mapping[str, Any]) -> None:
        """Note a batch that is done."""
        self.manifest["done"][str(number)] = dict(entry)
        if time.monotonic() - self.saved > SAVE_EVERY:
            self.save()

    def save(self) -> None:
        """Write the manifest.

        Raises
        ------
        ArchiveError
            Where that cannot be done, as on a full disk.
        """
        path = self.folder / MANIFEST
        try:
            with atomic_file(path) as part:
                part.write_text(json.dumps(self.manifest, sort_keys=True), encoding="utf-8")
        except OSError as error:
            raise ArchiveError(f"{path}: not written: {reason(error, self.folder)}") from error
        self.saved = time.monotonic()

    def check(self, *, overwrite: bool) -> None:
        """Compare the files with what is noted: files unnoted are noted, those gone are forgotten.

        Raises
        ------
        ArchiveError
            Naming files that are damaged or of something else, unless `overwrite`, by which they are removed.
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
                    done[str(number)] = entry_of(path)
            except ArchiveError as error:
                done.pop(str(number), None)
                if overwrite:
                    path.unlink()
                else:
                    faults.append(str(error))
        if faults:
            more = f" (and {len(faults) - 5} more files)" if len(faults) > 5 else ""
            raise ArchiveError("; ".join(faults[:5]) + f"{more}; give overwrite=True to compute them again")


@contextlib.contextmanager
def opened(
    path: str | os.PathLike[str], plan: Mapping[str, Any], inputs: Mapping[str, xr.Dataset], *, overwrite: bool
) -> Iterator[Store]:
    """Open the folder of an ensemble for work, alone, and make it where it is not there.

    Parameters
    ----------
    path
        The folder.
    plan
        What :func:`plan_of` gives.
    inputs
        Scenes and modes under the names of their files.
    overwrite
        Replace what belongs to something else or is damaged.

    Yields
    ------
    Store
        With what is done noted.

    Raises
    ------
    ArchiveError
        For a folder that cannot be written or is in use, one that holds something else, damaged files.
    """
    folder = _folder(path)
    with _locked(folder):
        for part in folder.glob(".cablepod-*.part"):  # of runs that were killed
            part.unlink(missing_ok=True)
        manifest = _found(folder, plan, overwrite=overwrite)
        _keep_inputs(folder, inputs, overwrite=overwrite or manifest is None)
        store = Store(folder, manifest or _begun(folder, plan, inputs))
        store.check(overwrite=overwrite)
        store.save()
        yield store


def plan_of(
    scenes: xr.Dataset, model: str, modes: xr.Dataset | None, options: Mapping[str, Any], batch: int
) -> dict[str, Any]:
    """Return what decides the results of an ensemble, and its id: a hash over all of it."""
    decisive = {
        "model": model,
        "modes": None if modes is None else f"{modes.attrs.get('id', 'unknown')} {provenance.digest(modes)}",
        "members": scenes.sizes["member"],
        "batch": batch,
        "options": dict(options),
        "scenes": f"{scenes.attrs.get('id', 'unknown')} {provenance.digest(scenes)}",
    }
    head = provenance.record(
        xr.Dataset(),
        function="ensemble.run",
        parameters=decisive,
        inputs=[scenes] if modes is None else [scenes, modes],
    )
    varied = {
        str(name): [float(item.values.min()), float(item.values.max()), item.attrs.get("units")]
        for name, item in scenes.variables.items()
        if item.dims == ("member",) and name != "member" and item.dtype.kind in "if"
    }
    return {
        **decisive,
        "id": head.attrs["id"],
        "varied": varied,
        "title": f"{scenes.attrs.get('title', 'scenes')}: {model}",
    }


def _folder(path: str | os.PathLike[str]) -> Path:
    folder = Path(path).resolve()  # workers may have another current folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArchiveError(f"{path}: is or lies below a file; give a folder") from None
    except OSError as error:
        raise ArchiveError(f"{path}: the folder cannot be made: {error.strerror}; give another one") from None
    check_target(folder / "any.nc", overwrite=False)
    return folder


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; the system lets go of it however this process ends."""
    try:
        import fcntl
    except ImportError:  # not on this system: every file still appears whole, and with the same values from either run
        yield
        return
    with (folder / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ArchiveError(
                f"{folder}: another run is at work on this ensemble; wait for it, or give another folder"
            ) from None
        except OSError:  # a file system without locks
            pass
        yield


def _found(folder: Path, plan: Mapping[str, Any], *, overwrite: bool) -> dict[str, Any] | None:
    """Return the manifest of this ensemble if the folder has it; what is of another one is refused or removed."""
    own = [*folder.glob("batch_*.nc"), *(folder / name for name in (SCENES, MODES) if (folder / name).exists())]
    if (folder / MANIFEST).exists():
        try:
            manifest = read_manifest(folder)
        except ArchiveError:
            if not overwrite:
                raise
            manifest = {"id": None}
        if manifest["id"] == plan["id"]:
            return manifest
        if not overwrite:
            raise ArchiveError(
                f"{folder}: holds another ensemble: {'; '.join(_differences(manifest, plan))}; allowed: the same again, another "
                "folder, or overwrite=True to replace it"
            )
    elif own and not overwrite and not _begun_before(folder, plan):
        names = ", ".join(sorted(path.name for path in own)[:3])
        raise ArchiveError(
            f"{folder}: holds {names} but no {MANIFEST}; give another folder, or overwrite=True to replace them"
        )
    if overwrite:
        (folder / MANIFEST).unlink(missing_ok=True)  # first: what is left of the rest belongs to nothing
        for path in own:
            path.unlink()
    return None


def _begun_before(folder: Path, plan: Mapping[str, Any]) -> bool:
    """Tell whether a run of these scenes was killed before it had written its manifest."""
    if list(folder.glob("batch_*.nc")):
        return False
    with contextlib.suppress(ArchiveError):
        return archive.read(folder / SCENES).attrs["id"] == plan["scenes"].split()[0]
    return False


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Tell what differs between two plans."""
    told = []
    for key, name in NAMES.items():
        if old.get(key) != new[key]:
            told.append(f"{name} was {shown(old.get(key))} and is {shown(new[key])}")
    if old.get("model") == new["model"]:
        before = old.get("options", {})
        for name in dict.fromkeys([*before, *new["options"]]):
            if before.get(name) != new["options"].get(name):
                told.append(f"the option {name} was {shown(before.get(name))} and is {shown(new['options'].get(name))}")
    if old.get("scenes") != new["scenes"]:
        varied = [
            name
            for name in {**old.get("varied", {}), **new["varied"]}
            if old["varied"].get(name) != new["varied"].get(name)
        ]
        told.append("the scenes differ" + (f", in {', '.join(varied)}" if varied else ""))
    return told or ["its id differs"]


def _keep_inputs(folder: Path, inputs: Mapping[str, xr.Dataset], *, overwrite: bool) -> None:
    """Write scenes and modes unless they are there."""
    for name, dataset in inputs.items():
        path = folder / name
        if path.exists() and not overwrite:
            if archive.read(path).attrs["id"] != dataset.attrs.get("id", archive.read(path).attrs["id"]):
                raise ArchiveError(f"{path}: is not that of this ensemble; take it from a backup, or overwrite=True")
            continue
        archive.write(dataset, path, overwrite=True)


def _begun(folder: Path, plan: Mapping[str, Any], inputs: Mapping[str, xr.Dataset]) -> dict[str, Any]:
    """Return a new manifest."""
    read = [archive.read(folder / name) for name in inputs]
    stages: dict[str, dict[str, Any]] = {}
    for dataset in read:
        for stage in provenance.stages_of(dataset):
            stages.setdefault(stage["id"], stage)
    # options as they are, for the manifest has them at length
    parameters = {name: provenance.to_json(plan[name]) for name in ("model", "members", "batch", "options")}
    own = {
        "id": plan["id"],
        "function": "ensemble.run",
        "parameters": parameters,
        "inputs": [str(dataset.attrs["id"]) for dataset in read],
    }
    history = "\n".join(dict.fromkeys(line for dataset in read for line in str(dataset.attrs["history"]).split("\n")))
    head = {"title": plan["title"], "id": plan["id"], "history": history}
    head["history_json"] = json.dumps([*stages.values(), own], sort_keys=True)
    attributes = root_attributes(xr.Dataset(attrs=head))
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "version": version(),
        **{name: plan[name] for name in ("id", "model", "modes", "members", "batch", "options", "scenes", "varied")},
        "attributes": {
            name: value.item() if isinstance(value, np.generic) else value for name, value in attributes.items()
        },
        "inputs_history": history,
        "files": [file_of(number) for number in range(len(sizes_of(plan)))],
        "done": {},
    }
