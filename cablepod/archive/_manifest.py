"""Manifest of an ensemble: what its files hold, and checks of them."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod.archive._read import LIBRARY_ERRORS, SCHEMA, alone, damaged, opened_file, restored, version
from cablepod.errors import ArchiveError

MANIFEST, SCENES, MODES = "manifest.json", "scenes.nc", "modes.nc"
KIND = "cablepod ensemble"
#: Attributes of a batch file that are its own; all others that are texts go to the whole ensemble where they agree.
OWN = ("id", "history", "history_json", "title", "date_created", "source", "summary")
FAILURE = {"units": "1", "long_name": "why the member failed; empty where it did not"}


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of an ensemble.

    Raises
    ------
    ArchiveError
        If there is none, or it is damaged or of a newer version.
    """
    path = folder / MANIFEST
    if not path.is_file():
        what = f"has no {MANIFEST}, so it is no ensemble" if folder.is_dir() else "is no folder"
        raise ArchiveError(f"{folder}: {what}; give the folder that ensemble.run wrote")
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        if manifest["kind"] != KIND or not isinstance(manifest["schema"], int):
            raise ValueError("it is another kind of file")
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read: {error.strerror}; check its permissions") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ArchiveError(f"{path}: is damaged ({error}); take it from a backup, or run the ensemble anew") from error
    if manifest["schema"] > SCHEMA:
        raise ArchiveError(
            f"{path}: has schema version {manifest['schema']}, this cablepod ({version()}) knows versions up to {SCHEMA}; "
            "install a newer cablepod"
        )
    return manifest


def batch_id(ensemble: str, number: int) -> str:
    """Return the id of the file of a batch."""
    return hashlib.sha256(f"{ensemble} {number}".encode()).hexdigest()[:20]


def sizes_of(manifest: Mapping[str, Any]) -> list[int]:
    """Return the number of members in each batch."""
    count, size = manifest["members"], manifest["batch"]
    return [min(size, count - first) for first in range(0, count, size)]


def file_of(number: int) -> str:
    """Return the name of the file of a batch."""
    return f"batch_{number:04d}.nc"


def check_batch(folder: Path, manifest: Mapping[str, Any], number: int) -> None:
    """Make sure that the file of a batch is there, whole and of this ensemble; only its head is read.

    Raises
    ------
    ArchiveError
        Naming the file and what is wrong with it.
    """
    import netCDF4  # opens in a quarter of the time that xarray takes
    from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

    path, known = folder / file_of(number), manifest["done"].get(str(number))
    if not path.exists():
        raise ArchiveError(f"{path}: is missing; run the ensemble again, which computes what is missing")
    try:
        with alone(), NETCDF4_PYTHON_LOCK, netCDF4.Dataset(path) as file:
            found = {name: file.getncattr(name) for name in ("cablepod_schema", "id") if name in file.ncattrs()}
    except LIBRARY_ERRORS as error:
        raise damaged(path, error) from error
    if found.get("cablepod_schema", SCHEMA + 1) > SCHEMA:
        with opened_file(path):  # says what it is
            pass
    if found.get("id") != batch_id(manifest["id"], number):
        raise ArchiveError(
            f"{path}: is not batch {number} of the ensemble {manifest['id']}; take it from a backup, or remove it"
        )
    if known is not None and path.stat().st_size != known["bytes"]:
        raise ArchiveError(
            f"{path}: is damaged, its size is not that noted in {MANIFEST}; take it from a backup, or remove it"
        )


def entry_of(path: Path) -> dict[str, Any]:
    """Read what the manifest notes of a batch file.

    Raises
    ------
    ArchiveError
        Where the file cannot be read.
    """
    with opened_file(path) as opened:
        try:
            return noted(restored(opened), path)
        except LIBRARY_ERRORS as error:
            raise damaged(path, error) from error


def noted(batch: xr.Dataset, path: Path) -> dict[str, Any]:
    """Return what the manifest notes of a batch: the size of its file, what it holds and which members failed."""
    layout: dict[str, Any] = {"variables": {}, "shared": {}}
    for name, item in batch.variables.items():
        if "member" not in item.dims:
            layout["shared"][str(name)] = hashlib.sha256(json.dumps(item.values.tolist()).encode()).hexdigest()[:16]
        elif item.dtype.kind in "fiu":
            layout["variables"][str(name)] = [list(item.dims), [*item.shape[1:]], item.dtype.str]
    numbers, reasons = batch["member"].values.tolist(), batch["failure"].values.tolist()
    return {
        "bytes": path.stat().st_size,
        "layout": layout,
        "texts": {
            str(name): value for name, value in batch.attrs.items() if isinstance(value, str) and name not in OWN
        },
        "failed": {str(number): reason for number, reason in zip(numbers, reasons, strict=True) if reason},
    }


def describe_ensemble(path: str | os.PathLike[str]) -> str:
    """Tell in some lines what an ensemble is and how far it is.

    Parameters
    ----------
    path
        Its folder.

    Returns
    -------
    str
        Members, done and failed with their reasons, ranges, model, options, size and history.

    Raises
    ------
    ArchiveError
        Where there is no ensemble.
    """
    return "\n".join(_description(Path(path)))


def _description(folder: Path) -> Iterator[str]:
    manifest = read_manifest(folder)
    sizes = sizes_of(manifest)
    files = {number: folder / file_of(number) for number in range(len(sizes))}
    there = [number for number, file in files.items() if file.exists()]
    done = sum(sizes[number] for number in there)
    failed = {key: reason for entry in manifest["done"].values() for key, reason in entry["failed"].items()}
    yield f"ensemble  {folder} ({sum(files[number].stat().st_size for number in there) / 1e6:.3g} MB)"
    yield f"title     {manifest['attributes'].get('title', 'none')}"
    yield f"id        {manifest['id']}"
    yield f"model     {manifest['model']}" + (f", modes {manifest['modes']}" if manifest["modes"] else "")
    given = ", ".join(f"{name}={json.dumps(value)}" for name, value in manifest["options"].items() if value is not None)
    yield f"options   {given[:300] or 'defaults'}"
    yield f"members   {manifest['members']} in {len(sizes)} files of {manifest['batch']}"
    yield f"done      {done}" + ("" if done == manifest["members"] else "; the same command or call goes on")
    missing = [number for number in manifest["done"] if int(number) not in there]
    if missing:
        yield f"missing   {', '.join(file_of(int(number)) for number in missing[:10])}"
    yield f"failed    {len(failed)}"
    for reason, count in Counter(failed.values()).most_common(5):
        members = [key for key, value in failed.items() if value == reason]
        yield f"  {count} (member {', '.join(members[:3])}{', ...' if count > 3 else ''}): {reason}"
    if len(set(failed.values())) > 5:
        yield f"  and {len(set(failed.values())) - 5} more reasons"
    yield "varied"
    for name, (low, high, units) in manifest["varied"].items():
        yield f"  {name} from {low:g} to {high:g}" + (f" {units}" if units and units != "1" else "")
    yield "history"
    yield from (f"  {line}" for line in str(manifest["attributes"].get("history", "")).split("\n"))
