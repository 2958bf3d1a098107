"""Open the files of an ensemble as one Dataset, read when needed."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._manifest import FAILURE, SCENES, check_batch, entry_of, file_of, read_manifest, sizes_of
from cablepod.archive._read import LIBRARY_ERRORS, alone, damaged, opened_file, restored
from cablepod.errors import ArchiveError


@dataclass(frozen=True)
class _ChunkReader:
    """Reads one variable of one batch file, called for each chunk of a dask array."""

    files: tuple[str, ...]
    sizes: tuple[int, ...]
    name: str
    shape: tuple[int, ...]  #: without member
    dtype: np.dtype
    time: int | None  #: which dimension is cut
    cuts: tuple[int, ...]  #: lengths of the pieces along it

    def __call__(self, block_id: tuple[int, ...]) -> np.ndarray:
        import netCDF4
        from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

        path = Path(self.files[block_id[0]])
        count, shape, place = self.sizes[block_id[0]], list(self.shape), slice(None)
        if self.time is not None:
            first = sum(self.cuts[: block_id[self.time]])
            place = slice(first, first + self.cuts[block_id[self.time]])
            shape[self.time - 1] = self.cuts[block_id[self.time]]
        try:
            with alone(), NETCDF4_PYTHON_LOCK, netCDF4.Dataset(path) as file:
                file.set_auto_maskandscale(False)
                if self.name not in file.variables:  # all members failed, or none of them has it
                    return np.full((count, *shape), np.nan, self.dtype)
                variable = file.variables[self.name]
                along = "member" in variable.dimensions
                where = [slice(None)] * variable.ndim
                if self.time is not None:
                    where[self.time - (0 if along else 1)] = place
                values = np.asarray(variable[tuple(where)], self.dtype)
        except LIBRARY_ERRORS as error:
            if not path.exists():
                raise ArchiveError(
                    f"{path}: is missing; run the ensemble again, which computes what is missing"
                ) from error
            raise damaged(path, error) from error
        return np.ascontiguousarray(np.broadcast_to(values, (count, *shape)))


#: Bytes of the largest chunk; longer batches are cut along time.
CHUNK = 1 << 26


def open_ensemble(path: str | os.PathLike[str], *, incomplete: bool = False) -> xr.Dataset:
    """Open what :func:`cablepod.ensemble.run` wrote as one lazy dataset.

    Parameters
    ----------
    path
        The folder.
    incomplete
        Open an ensemble that is not finished too: the members that are there.

    Returns
    -------
    xarray.Dataset
        The results along ``member`` as dask arrays, a chunk or several for each file; nothing stays open.  Parameters that vary
        are coordinates along ``member``, in memory.  Members that failed hold nan, and ``failure (member)`` says why.  Attributes
        are those of the ensemble; its history has the stages of scenes and modes.

    Raises
    ------
    ArchiveError
        If there is no ensemble, it is unfinished, or files are missing, damaged or of another version; they are named.
    """
    folder = Path(path)
    manifest = read_manifest(folder)
    sizes = sizes_of(manifest)
    there = [number for number in range(len(sizes)) if incomplete is False or (folder / file_of(number)).exists()]
    if not incomplete:
        _check_complete(folder, manifest, sizes)
    _check_files(folder, manifest, there)
    if not there:
        raise ArchiveError(f"{folder}: no member of this ensemble is done yet; run the ensemble again, which goes on")
    entries = {
        number: manifest["done"].get(str(number)) or entry_of(folder / file_of(number)) for number in there
    }  # what was written just before the run was killed is not noted yet
    with opened_file(folder / SCENES) as opened:
        scenes = restored(opened.load())
    first = np.cumsum([0, *sizes])
    rows = np.concatenate([np.arange(first[number], first[number + 1]) for number in there])
    return _EnsembleAssembler(
        folder, manifest, entries, [sizes[number] for number in there], scenes.isel(member=rows)
    ).dataset()


def _check_complete(folder: Path, manifest: Mapping[str, Any], sizes: Sequence[int]) -> None:
    waiting = [
        number
        for number in range(len(sizes))
        if str(number) not in manifest["done"] and not (folder / file_of(number)).exists()
    ]
    if waiting:
        raise ArchiveError(
            f"{folder}: {sum(sizes[number] for number in waiting)} of {manifest['members']} members are not done yet; run the "
            "ensemble again, which goes on where it stopped, or open what is there with incomplete=True"
        )


def _check_files(folder: Path, manifest: Mapping[str, Any], numbers: Sequence[int]) -> None:
    faults = []
    for number in numbers:
        try:
            check_batch(folder, manifest, number)
        except ArchiveError as error:
            faults.append(str(error))
    if faults:
        more = f" (and {len(faults) - 5} more files)" if len(faults) > 5 else ""
        raise ArchiveError("; ".join(faults[:5]) + more)


@dataclass(frozen=True)
class _EnsembleAssembler:
    """What an ensemble is put together from."""

    folder: Path
    manifest: Mapping[str, Any]
    entries: Mapping[int, Mapping[str, Any]]  #: by number, in order
    sizes: Sequence[int]
    scenes: xr.Dataset

    def dataset(self) -> xr.Dataset:
        """Make the lazy dataset."""
        variables, attrs = {"failure": self._failures()}, dict(self.manifest["attributes"])
        coords: dict[str, xr.Variable] = {}
        for name, values in self.scenes.variables.items():
            if values.dims == ("member",):
                coords[str(name)] = values
        for template, entry in self._templates():
            for name, item in template.variables.items():
                of_member = "member" in item.dims
                if str(name) in {*variables, *coords} or (
                    of_member and (name in self.scenes or item.dtype.kind == "U")
                ):
                    continue
                made = self._variable(str(name), item, entry)
                (coords if name in template.coords else variables)[str(name)] = made
            attrs |= {name: value for name, value in template.attrs.items() if name.startswith("time_coverage")}
        texts = [entry["texts"] for entry in self.entries.values()]
        for name, value in max(texts, key=len).items():  # such as model, law and scheme; a batch of failures has none
            if all(other.get(name, value) == value for other in texts):
                attrs.setdefault(name, value)
        return xr.Dataset(variables, coords, attrs)

    def _templates(self) -> Iterator[tuple[xr.Dataset, Mapping[str, Any]]]:
        """Yield the heads of one file of each layout, those with most variables first, with their entries."""
        seen: dict[str, tuple[int, Mapping[str, Any]]] = {}
        for number, entry in self.entries.items():
            seen.setdefault(json.dumps(entry["layout"], sort_keys=True), (number, entry))
        for number, entry in sorted(seen.values(), key=lambda item: (-len(item[1]["layout"]["variables"]), item[0])):
            with opened_file(self.folder / file_of(number)) as opened:
                yield restored(opened), entry

    def _failures(self) -> xr.Variable:
        """Return the reasons of the members that failed."""
        numbers = self.scenes["member"].values
        reasons = {key: reason for entry in self.entries.values() for key, reason in entry["failed"].items()}
        texts = np.array([reasons.get(str(number), "") for number in numbers.tolist()], dtype=str)
        return xr.Variable("member", texts, FAILURE)

    def _variable(self, name: str, item: xr.Variable, entry: Mapping[str, Any]) -> xr.Variable:
        layouts = [(number, other["layout"]) for number, other in self.entries.items()]
        shared = {layout["shared"][name] for _, layout in layouts if name in layout["shared"]}
        along = [(number, layout["variables"][name]) for number, layout in layouts if name in layout["variables"]]
        if not along and len(shared) == 1:
            return item.load()
        if name in item.dims:
            raise ArchiveError(
                f"{self.folder}: the batches differ in the coordinate {name}; open their files one by one"
            )
        dims: list[str] = along[0][1][0] if along else ["member", *map(str, item.dims)]
        shape = tuple(along[0][1][1]) if along else item.shape
        odd = [number for number, other in along if tuple(other[1]) != shape]
        if odd:
            raise ArchiveError(
                f"{self.folder / file_of(odd[0])}: {name} ({', '.join(dims)}) has another shape in this batch than in batch "
                f"{along[0][0]}; open the files one by one"
            )
        dtype = item.dtype if len(along) == len(layouts) or item.dtype.kind == "f" else np.dtype(float)
        return xr.Variable(dims, self._lazy(name, dims, shape, dtype), item.attrs)

    def _lazy(self, name: str, dims: Sequence[str], shape: tuple[int, ...], dtype: np.dtype) -> Any:
        import dask.array

        time = list(dims).index("time") if "time" in dims else None
        length = shape[time - 1] if time is not None else 1
        row = max(self.sizes) * int(np.prod(shape)) * dtype.itemsize // max(length, 1)
        piece = max(1, min(length, CHUNK // max(row, 1)))
        cuts = tuple(min(piece, length - begin) for begin in range(0, length, piece)) if time is not None else ()
        chunks: list[Any] = [tuple(self.sizes), *((size,) for size in shape)]
        if time is not None:
            chunks[time] = cuts
        files = tuple(str(self.folder.resolve() / file_of(number)) for number in self.entries)
        reader = _ChunkReader(files, tuple(self.sizes), name, shape, dtype, time, cuts)
        stamp = hashlib.sha256(repr((files, self.sizes, self.manifest["id"])).encode()).hexdigest()[:16]
        return dask.array.map_blocks(
            reader, chunks=tuple(chunks), dtype=dtype, meta=np.empty((0,) * len(chunks), dtype), name=f"{name}-{stamp}"
        )
