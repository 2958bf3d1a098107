"""Inputs of a stage: whether they are what their own stage made, and what the history says where they are not."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cablepod.conventions import plain_indexes
from cablepod.provenance._abridged import Abridged
from cablepod.provenance._content import (
    DIGITS,
    UNKNOWN,
    VariableContent,
    content_of,
    content_of_variable,
    digest,
    is_in_memory,
    is_scene,
    own_hash,
    total_hash,
)
from cablepod.provenance._stages import COMPACT, SORTED, merged_stages, recorded_content
from cablepod.provenance._values import MAX_HISTORY_ITEMS, to_json

if TYPE_CHECKING:
    import xarray as xr

#: Function of a stage that stands for a change of values or attributes, and of one for a Dataset without a history.
CHANGED, MADE = "changed outside the package", "made outside the package"
#: Beginnings of the names of the layers of a dask array whose values are those of a file, or of an array in memory.
AS_READ = ("original-open_dataset-", "open_dataset-", "xarray-", "rechunk-")
#: Said of the hash of an input with chunked variables.
NOT_COMPUTED = "as it was written, chunks are not computed"


class Input(NamedTuple):
    """What a history says of an input."""

    id: str
    history: str
    hash: str  #: of its content, with :data:`NOT_COMPUTED` where that is so
    key: Any  #: what the id of a result follows from


class _Found(NamedTuple):
    """Content of a Dataset as far as it is known without computing chunks."""

    total: str
    hashes: dict[str, str]
    attributes: str
    chunked: list[str]  #: names of variables whose hash is the recorded one


def identified(function: str, options: Mapping[str, Any], keys: Sequence[Any]) -> str:
    """Return the id of a stage."""
    return hashlib.sha256(COMPACT.encode([function, options, keys]).encode()).hexdigest()[:20]


def input_of(
    dataset: xr.Dataset, *, scene_digest: str | None = None, contents: Mapping[str, VariableContent] | None = None
) -> Input:
    """Return what a history says of an input; if it is not what its stage made, with a stage of its own.

    Parameters
    ----------
    dataset
        The input.  Its values are hashed in each call, but not those of chunked variables, which are taken for those that were
        written.
    scene_digest
        Result of :func:`digest` for a scene, where the caller knows it.
    contents
        Contents of all variables, where the caller has computed them.
    """
    history = dataset.attrs.get("history_json", "[]")
    if "id" not in dataset.attrs:
        return _made(dataset, contents)
    identifier = str(dataset.attrs["id"])
    recorded = recorded_content(history, identifier)
    total = (scene_digest or digest(dataset)) if is_scene(dataset) else None
    if total is not None and recorded is not None and total == recorded["hash"]:
        return Input(identifier, history, total, identifier)
    found = _found(dataset, recorded, contents, total)
    if recorded is None:  # a history without it
        if found.chunked:
            return Input(identifier, history, f"not recorded, {NOT_COMPUTED}", identifier)
        return Input(identifier, history, found.total, [identifier, found.total])
    if found.total != recorded["hash"]:
        if not _is_computed(dataset, recorded, found):
            return _changed(dataset, recorded, found, contents)
        return Input(identifier, history, found.total, [identifier, found.total])
    said = f"{found.total} {NOT_COMPUTED}" if found.chunked else found.total
    return Input(identifier, history, said, identifier)


def _found(
    dataset: xr.Dataset,
    recorded: Mapping[str, Any] | None,
    contents: Mapping[str, VariableContent] | None,
    total: str | None = None,
) -> _Found:
    """Return the content of a Dataset; chunked variables have the recorded hash, with another shape one that follows from it."""
    hashes, chunked, indexes = {}, [], plain_indexes(dataset)
    for key, variable in dataset.variables.items():
        name = str(key)
        content = (
            contents[name] if contents is not None else content_of_variable(variable, indexes.get(key), sums=False)
        )
        if content is not None:
            hashes[name] = content.hash
            continue
        chunked.append(name)
        entry = None if recorded is None else recorded["variables"].get(name)
        if entry is None:  # nothing but the name of the dask array, which follows from how it was made
            hashes[name] = _short([name, str(variable.data.name)])
        else:
            same = list(variable.shape) == entry[1]
            hashes[name] = entry[0] if same else _short([entry, [*map(str, variable.dims)], [*variable.shape]])
            # computed from what was read, and not as it was read or divided
            if entry[0] != UNKNOWN and not all(str(layer).startswith(AS_READ) for layer in variable.data.dask.layers):
                hashes[name] = _short([hashes[name], str(variable.data.name)])
    attributes = own_hash(dataset)
    return _Found(total or total_hash(dataset, hashes, attributes), hashes, attributes, chunked)


def _differing(dataset: xr.Dataset, recorded: Mapping[str, Any], found: _Found) -> list[str]:
    """Return the names of variables that are not the recorded ones; of those without a hash on record the shape tells."""
    differ, before, variables = [], recorded["variables"], _by_text(dataset)
    for name, value in found.hashes.items():
        known, shape, *_ = before.get(name, (None, None))
        same = list(variables[name].shape) == shape if known == UNKNOWN else value == known
        if not same:
            differ.append(name)
    return sorted(differ)


def _is_computed(dataset: xr.Dataset, recorded: Mapping[str, Any], found: _Found) -> bool:
    """Tell whether a Dataset differs from the record in variables alone that have no hash there, as those of many files."""
    same = found.attributes == recorded["attributes"] and found.hashes.keys() == recorded["variables"].keys()
    return same and not _differing(dataset, recorded, found)


def _short(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:DIGITS]


# --- stages from outside --------------------------------------------------------------------------------------------------


def _made(dataset: xr.Dataset, contents: Mapping[str, VariableContent] | None) -> Input:
    """Return a Dataset without a history as an input, with a stage for it."""
    found = _found(dataset, None, contents)
    parameters = {"variables": sorted(found.hashes), **_extent(dataset), **_not_computed(found)}
    return _with_stage(dataset, MADE, parameters, [], "[]", found, contents)


def _changed(
    dataset: xr.Dataset, recorded: Mapping[str, Any], found: _Found, contents: Mapping[str, VariableContent] | None
) -> Input:
    """Return a changed Dataset as an input, with a stage for the change."""
    attrs = dataset.attrs
    changed = _differing(dataset, recorded, found)
    lacks = sorted(recorded["variables"].keys() - found.hashes.keys())
    parameters = {"differs": changed, **({"lacks": lacks} if lacks else {}), **_extent(dataset)}
    parameters |= _not_computed(found)
    if is_scene(dataset):
        variables = _by_text(dataset)
        if all(variables[name].size <= MAX_HISTORY_ITEMS for name in changed):  # from which the scene can be made again
            parameters["values"] = {name: _with_dims(variables[name]) for name in changed}
    elif found.attributes != recorded["attributes"]:
        parameters["attributes"] = "differ"
    elif not found.chunked and (labels := _labels(dataset, changed, recorded)):
        parameters["labels"] = labels
    return _with_stage(
        dataset, CHANGED, parameters, [str(attrs["id"])], attrs.get("history_json", "[]"), found, contents
    )


def _with_stage(
    dataset: xr.Dataset,
    function: str,
    parameters: dict[str, Any],
    parents: list[str],
    history: str,
    found: _Found,
    contents: Mapping[str, VariableContent] | None,
) -> Input:
    """Return an input whose history ends with a stage for it."""
    identifier = identified(function, {"content": found.total}, parents)
    content = content_of(dataset, contents)
    for name in found.chunked:
        content["variables"][name][0] = found.hashes[name]
    content["hash"] = found.total
    stages = merged_stages([history])
    stage = {"id": identifier, "function": function, "parameters": parameters, "inputs": parents, "content": content}
    stages[identifier] = SORTED.encode(stage)
    text = Abridged(f"[{', '.join(stages.values())}]")
    said = f"{found.total} {NOT_COMPUTED}" if found.chunked else found.total
    return Input(identifier, text, said, identifier)


def _extent(dataset: xr.Dataset) -> dict[str, Any]:
    """Return sizes, and first and last instant [s] of a Dataset."""
    extent: dict[str, Any] = {"sizes": {str(name): int(size) for name, size in dataset.sizes.items()}}
    time = dataset.variables.get("time")
    if time is not None and time.size and time.dtype.kind in "fiu" and (is_in_memory(time) or time.chunks is None):
        ends = [float(value) for value in np.asarray(time.values).reshape(-1)[[0, -1]]]
        extent |= {
            name: value
            for name, value in zip(("first_instant", "last_instant"), ends, strict=True)
            if math.isfinite(value)
        }
    return extent


def _not_computed(found: _Found) -> dict[str, Any]:
    return {"not_computed": sorted(found.chunked)} if found.chunked else {}


def _labels(dataset: xr.Dataset, names: Any, recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return the labels of dimensions that are others than recorded, by which a part may have been selected."""
    variables = _by_text(dataset)
    labels = {
        name: to_json(np.asarray(variables[name].values))
        for name in names
        if variables[name].dims in ((name,), ()) and len(recorded["variables"].get(name, ("", ()))[1]) == 1
    }
    return {name: values for name, values in labels.items() if not (isinstance(values, dict) and "sha256" in values)}


def _by_text(dataset: xr.Dataset) -> dict[str, xr.Variable]:
    """Return the variables by their names in a history, which are texts; those of a Dataset need not be."""
    return {str(name): variable for name, variable in dataset.variables.items()}


def _with_dims(variable: xr.Variable) -> Any:
    """Return [dimensions, values, attributes] of a variable as JSON types; only the value of a scalar."""
    value = to_json(np.asarray(variable.values)) if variable.dims else to_json(variable.values[()])
    return [list(variable.dims), value, to_json(dict(variable.attrs))] if variable.dims else value
