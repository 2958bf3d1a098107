"""Open the files of an ensemble as one lazy Dataset."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.archive._checked import blocks_of, changed, check_bytes
from cablepod.archive._folder import path_of
from cablepod.archive._manifest import (
    FAILURE,
    SCENES,
    batch_id,
    check_batch,
    faults_text,
    file_of,
    missing_file,
    read_entry,
    read_manifest,
    sizes_of,
)
from cablepod.archive._read import READ_ERRORS, damaged, netcdf_lock, opened_file, read, restored
from cablepod.archive._seal import seal_of
from cablepod.batch._stack import is_varied
from cablepod.conventions import attribute_labels
from cablepod.errors import ArchiveError
from cablepod.parameters._checks import truth

#: Maximum bytes of a dask chunk; longer batches are split along time.
CHUNK = 1 << 26


@dataclass(frozen=True)
class _ChunkReader:
    """Reader of one variable, called by dask for each chunk."""

    ensemble: str  #: its id
    numbers: tuple[int, ...]  #: of the batches
    files: tuple[str, ...]
    sizes: tuple[int, ...]  #: members in each file
    name: str
    shape: tuple[int, ...]  #: without member
    dtype: np.dtype
    time: int | None  #: index of the dimension time, which is split
    lengths: tuple[int, ...]  #: lengths of the chunks along time
    verify: bool  #: whether the files must be as written

    def __call__(self, block_id: tuple[int, ...]) -> np.ndarray:
        import netCDF4
        from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

        path, number = Path(self.files[block_id[0]]), self.numbers[block_id[0]]
        count, shape, times = self.sizes[block_id[0]], list(self.shape), slice(None)
        if self.time is not None:
            first = sum(self.lengths[: block_id[self.time]])
            times = slice(first, first + self.lengths[block_id[self.time]])
            shape[self.time - 1] = self.lengths[block_id[self.time]]
        try:
            if (seal := seal_of(path)) is not None and seal.id != batch_id(self.ensemble, number):
                raise ArchiveError(
                    f"{path}: is not batch {number} of the ensemble {self.ensemble}, which was replaced; open it again"
                )
            by_blocks = self.verify and not check_bytes(path, whole=False)
            with netcdf_lock(), NETCDF4_PYTHON_LOCK, netCDF4.Dataset(path) as file:
                file.set_auto_maskandscale(False)
                blocks = blocks_of(path, file, self.name) if by_blocks else None
                if self.name not in file.variables:  # all members of the batch failed
                    return np.full((count, *shape), np.nan, self.dtype)
                variable = file.variables[self.name]
                has_members = "member" in variable.dimensions
                index: list[int | slice] = [slice(None)] * variable.ndim
                if self.time is not None:
                    index[self.time - (0 if has_members else 1)] = times
                read = variable.__getitem__
                found = read(tuple(index)) if blocks is None else blocks.checked(tuple(index), read)
                if found is None:
                    raise changed(path, [self.name])
                values = np.asarray(found, self.dtype)
        except ArchiveError:
            raise
        except READ_ERRORS as error:
            if not path.exists():
                raise missing_file(path) from error
            raise damaged(path, error) from error
        return np.ascontiguousarray(np.broadcast_to(values, (count, *shape)))


def open_ensemble(path: str | os.PathLike[str], *, incomplete: bool = False, verify: bool = True) -> xr.Dataset:
    """Open the folder of :func:`cablepod.ensemble.run` as one lazy dataset.

    Parameters
    ----------
    path
        The folder.
    incomplete
        Also open an unfinished ensemble, with the members that are complete.
    verify
        Whether the files must be as written; a file of results is compared when a value of it is first read, one above 64 MiB
        block by block.  False takes files that were edited as they are.

    Returns
    -------
    xarray.Dataset
        The results along ``member`` as dask arrays with one or more chunks for each file; no file stays open.  Varied parameters
        are coordinates along ``member``, in memory.  Failed members hold nan, and ``failure (member)`` has the reason.  The
        attributes are those of the ensemble; its history includes the stages of scenes and modes.

    Raises
    ------
    ArchiveError
        If there is no ensemble, it is unfinished, or files are missing, damaged, changed since they were written or of a newer
        version (named in the message).
    """
    folder = path_of(path)
    incomplete, verify = truth("incomplete", incomplete), truth("verify", verify)
    manifest = read_manifest(folder, verify=verify)
    sizes = sizes_of(manifest)
    numbers = [number for number in range(len(sizes)) if not incomplete or (folder / file_of(number)).exists()]
    if not incomplete:
        _check_complete(folder, manifest, sizes)
    _check_files(folder, manifest, numbers, verify=verify)
    if not numbers:
        raise ArchiveError(f"{folder}: no member of this ensemble is complete yet; run the ensemble again to continue")
    # the manifest may lack batches completed just before a crash: read their entries from the files
    entries = {
        number: manifest["done"].get(str(number)) or read_entry(folder / file_of(number), verify=verify)
        for number in numbers
    }
    scenes = read(folder / SCENES, verify=verify)
    first = np.cumsum([0, *sizes])
    rows = np.concatenate([np.arange(first[number], first[number + 1]) for number in numbers])
    chosen = [sizes[number] for number in numbers]
    return _EnsembleAssembler(folder, manifest, entries, chosen, scenes.isel(member=rows), verify).dataset()


def _check_complete(folder: Path, manifest: Mapping[str, Any], sizes: Sequence[int]) -> None:
    """Refuse an ensemble with missing batches."""
    missing = [
        number
        for number in range(len(sizes))
        if str(number) not in manifest["done"] and not (folder / file_of(number)).exists()
    ]
    if missing:
        raise ArchiveError(
            f"{folder}: {sum(sizes[number] for number in missing)} of {manifest['members']} members are not done yet; run the "
            "ensemble again to continue, or open the complete members with incomplete=True"
        )


def _check_files(folder: Path, manifest: Mapping[str, Any], numbers: Sequence[int], *, verify: bool) -> None:
    """Refuse missing and damaged batch files, naming up to five."""
    faults = []
    for number in numbers:
        try:
            check_batch(folder, manifest, number, verify=verify)
        except ArchiveError as error:
            faults.append(str(error))
    if faults:
        raise ArchiveError(faults_text(faults))


@dataclass(frozen=True)
class _EnsembleAssembler:
    """Assembler of the lazy dataset from scenes, manifest and batch files."""

    folder: Path
    manifest: Mapping[str, Any]
    entries: Mapping[int, Mapping[str, Any]]  #: number of the batch -> entry of the manifest, in order
    sizes: Sequence[int]
    scenes: xr.Dataset
    verify: bool  #: whether the files must be as written

    def dataset(self) -> xr.Dataset:
        """Return the lazy dataset."""
        variables, attrs = {"failure": self._failures()}, provenance.abridged(self.manifest["attributes"])
        coords: dict[str, xr.Variable] = {}
        for name, values in self.scenes.variables.items():
            if is_varied(values):
                coords[str(name)] = values
        for template in self._templates():
            for name, variable in template.variables.items():
                has_members = "member" in variable.dims
                if str(name) in {*variables, *coords} or (
                    has_members and (name in self.scenes or variable.dtype.kind == "U")
                ):
                    continue
                target = coords if name in template.coords else variables
                target[str(name)] = self._variable(str(name), variable)
            attrs |= {name: value for name, value in template.attrs.items() if name.startswith("time_coverage")}
        for name, texts in self._texts().items():  # such as model, law and scheme
            if texts.count(texts[0]) == len(texts) and isinstance(texts[0], str):
                attrs.setdefault(name, texts[0])
            elif name == "scheme":
                variables[name] = self._schemes()
        return self._recorded(xr.Dataset(variables, coords, attrs))

    def _recorded(self, dataset: xr.Dataset) -> xr.Dataset:
        """Return the dataset with its content in the last stage of its history, so that parts of it are told from the whole.

        Values in files have no hash in it.  Members that are not complete count in the shapes.
        """
        stages = provenance.stages_of(dataset)
        if not stages:
            return dataset
        content = provenance.content_of(dataset)
        for name, entry in content["variables"].items():
            if dataset.variables[name].dims[:1] == ("member",):
                entry[1] = [self.manifest["members"], *entry[1][1:]]
        stages[-1]["content"] = content
        return dataset.assign_attrs(history_json=provenance.Abridged(json.dumps(stages, sort_keys=True)))

    def _templates(self) -> Iterator[xr.Dataset]:
        """Yield one opened file of each layout, those with most variables first."""
        seen: dict[str, tuple[int, Mapping[str, Any]]] = {}
        for number, entry in self.entries.items():
            seen.setdefault(json.dumps(entry["layout"], sort_keys=True), (number, entry))
        for number, _ in sorted(seen.values(), key=lambda pair: (-len(pair[1]["layout"]["variables"]), pair[0])):
            with opened_file(self.folder / file_of(number), verify=self.verify) as opened:
                yield restored(opened)

    def _texts(self) -> dict[str, list[Any]]:
        """Return the texts of all batches by name, lists of those of the members in some; of batches with all failed none."""
        ran = [
            entry["texts"]
            for entry, size in zip(self.entries.values(), self.sizes, strict=True)
            if len(entry["failed"]) < size
        ]
        return {name: [batch.get(name) for batch in ran] for name in dict.fromkeys(itertools.chain(*ran))}

    def _schemes(self) -> xr.Variable:
        """Return the schemes of the members (member), empty for failed ones."""
        given = [entry["texts"].get("scheme", "") for entry in self.entries.values()]
        rows = [[own] * size if isinstance(own, str) else own for own, size in zip(given, self.sizes, strict=True)]
        schemes = np.where(self._failures().values == "", np.array(list(itertools.chain(*rows)), dtype=str), "")
        return xr.Variable("member", schemes, attribute_labels("scheme"))

    def _failures(self) -> xr.Variable:
        """Return the reasons of failed members (member), empty for others."""
        numbers = self.scenes["member"].values
        reasons = {key: reason for entry in self.entries.values() for key, reason in entry["failed"].items()}
        texts = np.array([reasons.get(str(number), "") for number in numbers.tolist()], dtype=str)
        return xr.Variable("member", texts, FAILURE)

    def _variable(self, name: str, template: xr.Variable) -> xr.Variable:
        """Return a variable of the ensemble, lazy unless it is shared by all members."""
        layouts = [(number, entry["layout"]) for number, entry in self.entries.items()]
        shared = {layout["shared"][name] for _, layout in layouts if name in layout["shared"]}
        member_layouts = [
            (number, layout["variables"][name]) for number, layout in layouts if name in layout["variables"]
        ]
        if not member_layouts and len(shared) == 1:
            return template.load()
        if name in template.dims:
            raise ArchiveError(
                f"{self.folder}: the batches differ in the coordinate {name}; open their files one by one"
            )
        dims: list[str] = member_layouts[0][1][0] if member_layouts else ["member", *map(str, template.dims)]
        shape = tuple(member_layouts[0][1][1]) if member_layouts else template.shape
        different = [number for number, layout in member_layouts if tuple(layout[1]) != shape]
        if different:
            raise ArchiveError(
                f"{self.folder / file_of(different[0])}: {name} ({', '.join(dims)}) has another shape in this batch than in "
                f"batch {member_layouts[0][0]}; open the files one by one"
            )
        is_complete = len(member_layouts) == len(layouts)
        dtype = template.dtype if is_complete or template.dtype.kind == "f" else np.dtype(float)
        return xr.Variable(dims, self._lazy(name, dims, shape, dtype), template.attrs)

    def _lazy(self, name: str, dims: Sequence[str], shape: tuple[int, ...], dtype: np.dtype) -> Any:
        """Return the dask array of a variable; `shape` is without member."""
        import dask.array

        time = list(dims).index("time") if "time" in dims else None
        length = shape[time - 1] if time is not None else 1
        row = max(self.sizes) * int(np.prod(shape)) * dtype.itemsize // max(length, 1)
        part = max(1, min(length, CHUNK // max(row, 1)))
        lengths = tuple(min(part, length - start) for start in range(0, length, part)) if time is not None else ()
        chunks: list[Any] = [tuple(self.sizes), *((size,) for size in shape)]
        if time is not None:
            chunks[time] = lengths
        files = tuple(str(self.folder.resolve() / file_of(number)) for number in self.entries)
        reader = _ChunkReader(
            self.manifest["id"],
            tuple(self.entries),
            files,
            tuple(self.sizes),
            name,
            shape,
            dtype,
            time,
            lengths,
            self.verify,
        )
        stamp = hashlib.sha256(repr((files, self.sizes, self.manifest["id"], self.verify)).encode()).hexdigest()[:16]
        return dask.array.map_blocks(
            reader, chunks=tuple(chunks), dtype=dtype, meta=np.empty((0,) * len(chunks), dtype), name=f"{name}-{stamp}"
        )
