"""Manifest of an ensemble, checks of its files, and its description."""

from __future__ import annotations

import hashlib
import json
import math
import os
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._checked import changed
from cablepod.archive._read import READ_ERRORS, damaged, newer, opened_file, restored
from cablepod.archive._seal import SCHEMA, seal_of
from cablepod.conventions import printed
from cablepod.errors import ArchiveError, printable

MANIFEST, SCENES, MODES = "manifest.json", "scenes.nc", "modes.nc"
#: Files of the command in the folder: largest values of all members as a table and as a picture.
MAPS = ("map.csv", "map.png")
#: Folders in that of an ensemble: of another one that is to replace it, until all its members are done, and while it does.
REPLACEMENT, COMPLETE = ".cablepod-replacement", ".cablepod-complete"
KIND = "cablepod ensemble"
#: Attributes specific to one batch; other text attributes, if equal in all batches, become attributes of the ensemble.
BATCH_ATTRIBUTES = ("id", "history", "history_json", "title", "date_created", "source", "summary")
#: Key of an entry -> variables of members and places of which the largest value is kept, and units by which it is printed.
PEAKS: dict[str, tuple[tuple[str, ...], str]] = {
    "largest_tension": (("tension_maximum", "guy_tension_maximum"), "N"),
    "largest_fatigue_range": (("fatigue_range",), "N"),
    "largest_utilisation": (("utilisation",), "%"),
}
FAILURE = {"units": "1", "long_name": "why the member failed; empty where it did not"}


def manifest_text(manifest: Mapping[str, Any]) -> str:
    """Return a manifest as the text of its file, with the CRC-32 of the rest."""
    content = {name: value for name, value in manifest.items() if name != "crc32"}
    crc = zlib.crc32(json.dumps(content, sort_keys=True).encode())
    return json.dumps({**content, "crc32": f"{crc:08x}"}, sort_keys=True)


def read_manifest(folder: Path, *, verify: bool = True) -> dict[str, Any]:
    """Read the manifest of an ensemble; with `verify`, it must be as written.

    Raises
    ------
    ArchiveError
        If it is missing, damaged, changed since it was written or of a newer version.
    """
    path = folder / MANIFEST
    if not path.is_file():
        if (folder / COMPLETE).exists():
            raise ArchiveError(f"{folder}: is being replaced; run its ensemble again, which completes that")
        problem = f"has no {MANIFEST}, so it is no ensemble" if folder.is_dir() else "is no folder"
        raise ArchiveError(f"{folder}: {problem}; give the folder of an ensemble.run")
    try:
        manifest = json.loads(text := path.read_text(encoding="utf-8"))
        if manifest["kind"] != KIND or not isinstance(manifest["schema"], int):
            raise ValueError("it is another kind of file")
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read: {error.strerror}; check its permissions") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ArchiveError(f"{path}: is damaged ({error}); take it from a backup, or run the ensemble again") from error
    if verify and text != manifest_text(manifest):
        raise changed(path, ["its text"])
    manifest.pop("crc32", None)
    if manifest["schema"] > SCHEMA:
        raise newer(path, manifest["schema"])
    return manifest


def batch_id(ensemble: str, number: int) -> str:
    """Return the id of a batch."""
    return hashlib.sha256(f"{ensemble} {number}".encode()).hexdigest()[:20]


def sizes_of(manifest: Mapping[str, Any]) -> list[int]:
    """Return the number of members in each batch."""
    count, size = manifest["members"], manifest["batch"]
    return [min(size, count - first) for first in range(0, count, size)]


def file_of(number: int) -> str:
    """Return the file name of a batch."""
    return f"batch_{number:04d}.nc"


def missing_file(path: Path) -> ArchiveError:
    """Return the error for the file of a batch that is not there."""
    return ArchiveError(f"{path}: is missing; run the ensemble again, which computes what is missing")


def check_batch(folder: Path, manifest: Mapping[str, Any], number: int, *, verify: bool = True) -> None:
    """Check that the file of a batch exists, is complete and belongs to this ensemble (reads its seal or attributes only).

    Without `verify`, it may have been edited.

    Raises
    ------
    ArchiveError
        If the file is missing, damaged, of a newer version or of another ensemble.
    """
    path = folder / file_of(number)
    if not path.exists():
        raise missing_file(path)
    try:
        seal = seal_of(path)
    except READ_ERRORS as error:
        raise damaged(path, error) from error
    if seal is not None and seal.schema <= SCHEMA:
        identifier: Any = seal.id
    else:
        with opened_file(path, verify=False) as opened:  # which refuses a newer version
            identifier = opened.attrs.get("id")
    if identifier != batch_id(manifest["id"], number):
        raise ArchiveError(
            f"{path}: is not batch {number} of the ensemble {manifest['id']}; take it from a backup, or remove it"
        )
    if verify and seal is None:
        raise ArchiveError(
            f"{path}: is damaged or edited, it lacks its last line; take it from a backup, remove it, or take it as it is with "
            "verify=False (command: --no-verify)"
        )


def faults_text(faults: Sequence[str]) -> str:
    """Return what is wrong with some files as one text, of at most five of them."""
    more = f" (and {len(faults) - 5} more files)" if len(faults) > 5 else ""
    return "; ".join(faults[:5]) + more


def read_entry(path: Path, *, verify: bool = True) -> dict[str, Any]:
    """Read a batch file and return its entry in the manifest.

    Raises
    ------
    ArchiveError
        If the file cannot be read.
    """
    with opened_file(path, verify=verify) as opened:
        try:
            return entry_of(restored(opened))
        except READ_ERRORS as error:
            raise damaged(path, error) from error


def entry_of(batch: xr.Dataset) -> dict[str, Any]:
    """Return the entry of a batch in the manifest: layout, common attributes, what to know of its members."""
    layout: dict[str, Any] = {"variables": {}, "shared": {}}
    for name, variable in batch.variables.items():
        if "member" not in variable.dims:
            digest = hashlib.sha256(json.dumps(variable.values.tolist()).encode()).hexdigest()[:16]
            layout["shared"][str(name)] = digest
        elif variable.dtype.kind in "fiu":
            layout["variables"][str(name)] = [list(variable.dims), [*variable.shape[1:]], variable.dtype.str]
    numbers, reasons = batch["member"].values.tolist(), batch["failure"].values.tolist()
    texts = {
        str(name): value
        for name, value in batch.attrs.items()
        if isinstance(value, str) and name not in BATCH_ATTRIBUTES
    }
    if "scheme" in batch:  # the schemes of the members differ
        texts["scheme"] = batch["scheme"].values.tolist()
    return {
        "layout": layout,
        "texts": texts,
        "failed": {str(number): reason for number, reason in zip(numbers, reasons, strict=True) if reason},
        "not_converged": time_errors(batch, batch.attrs.get("accepted_time_error", math.inf)),
        **{key: _largest(batch, names) for key, (names, _) in PEAKS.items() if set(names) & set(batch.variables)},
    }


def time_errors(results: xr.Dataset, accepted: float) -> dict[str, list[float]] | None:
    """Return the estimated time errors of members above an accepted one, of motion and tension; None without estimates.

    The key is the number of the member, the error of the tension is nan without an estimate.
    """
    if "time_error_estimate" not in results:
        return {} if (results["failure"].values != "").all() else None
    of_motion = results["time_error_estimate"].values
    of_tension = np.full(of_motion.shape, np.nan)
    if "tension_time_error_estimate" in results:
        of_tension = results["tension_time_error_estimate"].values
    numbers = results["member"].values
    return {
        str(numbers[i]): [float(of_motion[i]), float(of_tension[i])]
        for i in np.flatnonzero((of_motion > accepted) | (of_tension > accepted))
    }


def _largest(batch: xr.Dataset, names: Iterable[str]) -> dict[str, Any] | None:
    """Return number, value, parameters, and guy of a mast of the member with the largest value of a variable; None without."""
    name = next(name for name in names if name in batch)
    values = batch[name].values
    if not np.isfinite(values).any():
        return None
    row, place = map(int, np.unravel_index(int(np.nanargmax(values)), values.shape))
    at = {
        str(name): float(column[row]) if column.dtype.kind in "if" else str(column[row].values)
        for name, column in batch.coords.items()
        if name != "member"
        and column.dims == ("member",)
        and column.values[row] == column.values[row]  # nan: no such key
    }
    more: dict[str, Any] = {"guy": int(batch["guy"][place])} if batch[name].dims[1:] == ("guy",) else {}
    if "exponent" in batch[name].attrs:
        more["fatigue"] = [float(batch[name].attrs[key]) for key in ("exponent", "frequency")]
    return {"member": int(batch["member"][row]), "value": float(values[row, place]), **more, "at": at}


def merged_time_errors(entries: Iterable[Mapping[str, Any]]) -> dict[str, list[float]] | None:
    """Return the time errors of all batches that are not accepted, see :func:`time_errors`; None if a batch has no estimates."""
    merged: dict[str, list[float]] = {}
    for entry in entries:
        if entry["not_converged"] is None:
            return None
        merged |= entry["not_converged"]
    return merged


def errors_text(errors: Sequence[float]) -> str:
    """Return the time errors of a member as text."""
    of_motion, of_tension = errors
    text = f"an error of {of_motion:.3g} of the motion"
    return text if math.isnan(of_tension) else f"{text} and of {of_tension:.3g} of the range of its tensions"


def worst_first(errors: Mapping[str, Sequence[float]]) -> list[str]:
    """Return the numbers of members by the larger one of both time errors, the worst first."""
    return sorted(errors, key=lambda member: -np.nanmax(errors[member]))


def describe_ensemble(path: str | os.PathLike[str], *, brief: bool = False, verify: bool = True) -> str:
    """Describe an ensemble and its progress.

    Parameters
    ----------
    path
        The folder of the ensemble.
    brief
        Leave largest tension and history out.
    verify
        Whether its manifest must be as written.

    Returns
    -------
    str
        Members, done, failed with their reasons, not converged with their errors, largest tension, ranges, model, options, size
        and history.

    Raises
    ------
    ArchiveError
        If the folder holds no ensemble.
    """
    return "\n".join(map(printable, _description(Path(path), brief, verify=verify)))


def _description(folder: Path, brief: bool, *, verify: bool) -> Iterator[str]:
    """Yield the lines of the description."""
    manifest = read_manifest(folder, verify=verify)
    sizes = sizes_of(manifest)
    files = {number: folder / file_of(number) for number in range(len(sizes))}
    existing = [number for number, file in files.items() if file.exists()]
    done = sum(sizes[number] for number in existing)
    failed = {key: reason for entry in manifest["done"].values() for key, reason in entry["failed"].items()}
    yield f"ensemble  {folder} ({sum(files[number].stat().st_size for number in existing) / 1e6:.3g} MB)"
    yield f"title     {manifest['attributes'].get('title', 'none')}"
    yield f"id        {manifest['id']}"
    yield f"model     {manifest['model']}" + (f", modes {manifest['modes']}" if manifest["modes"] else "")
    options = ", ".join(
        f"{name}={json.dumps(value)}" for name, value in manifest["options"].items() if value is not None
    )
    yield f"options   {options[:300] or 'defaults'}"
    yield f"members   {manifest['members']}, at most {manifest['batch']} in a file"
    yield f"done      {done}" + ("" if done == manifest["members"] else "; the same command or call goes on")
    if (folder / REPLACEMENT).exists():
        yield "replaced  not yet: the run of another ensemble, with overwrite=True or --overwrite, is not complete"
    missing = [number for number in manifest["done"] if int(number) not in existing]
    if missing:
        yield f"missing   {', '.join(file_of(int(number)) for number in missing[:10])}"
    yield f"failed    {len(failed)}"
    for reason, count in Counter(failed.values()).most_common(5):
        members = [key for key, value in failed.items() if value == reason]
        yield f"  {count} (member {', '.join(members[:3])}{', ...' if count > 3 else ''}): {reason}"
    if len(set(failed.values())) > 5:
        yield f"  and {len(set(failed.values())) - 5} more reasons"
    yield from _convergence(manifest)
    if not brief:
        yield from peak_of(manifest)
    yield "varied"
    for name, values in manifest["varied"].items():
        if isinstance(values, dict):
            yield f"  {name}: {', '.join(map(str, values['choices']))}"
            continue
        low, high, units = values
        yield f"  {name} from {low:g} to {high:g}" + (f" {units}" if units and units != "1" else "")
    if not brief:
        yield "history"
        yield from (f"  {line}" for line in str(manifest["attributes"].get("history", "")).split("\n"))


def _convergence(manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines on members that have not converged in time, the worst first."""
    if not manifest["done"]:
        return
    errors = merged_time_errors(manifest["done"].values())
    if errors is None:
        why = (
            "; masts estimate it with the option tolerance" if manifest["model"] == "mast" else ", as with a given step"
        )
        yield f"not converged  not known: no time error is estimated{why}"
        return
    accepted = manifest["attributes"].get("accepted_time_error")
    yield f"not converged  {len(errors)}" + (f", with an estimated time error above {accepted:g}" if errors else "")
    for member in worst_first(errors)[:5]:
        yield f"  member {member}: {errors_text(errors[member])}"
    if len(errors) > 5:
        yield f"  and {len(errors) - 5} more, see time_error_estimate and tension_time_error_estimate"


def peak_of(manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of the largest tension, fatigue range and utilisation, with parameters and time errors of the member."""
    for key, (_, units_of_peak) in PEAKS.items():
        peaks = [entry[key] for entry in manifest["done"].values() if entry.get(key)]
        if not peaks:
            continue
        peak = max(peaks, key=lambda peak: peak["value"])
        errors = (merged_time_errors(manifest["done"].values()) or {}).get(str(peak["member"]))
        doubt = f", not converged: {errors_text(errors)}" if errors else ""
        units = {name: None if isinstance(values, dict) else values[2] for name, values in manifest["varied"].items()}
        at = ", ".join(
            f"{name} {_with_units(value, units[name])}" for name, value in peak["at"].items() if name in units
        )
        where = f" ({at})" if at else ""
        guy = f", guy {peak['guy']}" if "guy" in peak else ""
        value = printed(peak["value"], units_of_peak)
        if "fatigue" in peak:
            value += " (exponent {:g} at {:g} Hz)".format(*peak["fatigue"])
        yield f"{key.replace('_', ' ')}  {value}, in member {peak['member']}{guy}{where}{doubt}"


def _with_units(value: float | str, units: str | None) -> str:
    """Return a value with its units, an angular frequency also in Hz; a text as it is."""
    if isinstance(value, str):
        return value
    hertz = f" ({value / (2.0 * math.pi):.4g} Hz)" if units == "rad s-1" else ""
    return f"{value:.5g} {units or ''}".rstrip() + hertz
