"""Which function made a dataset, with which parameters, from which inputs.

Science modules call :func:`record` and know no file, clock or git; :mod:`cablepod.archive` adds those when it writes.
The ``id`` of a dataset is a hash over function, parameters and the ids of the inputs: cheap, without a clock, and equal
for equal inputs, so that a lineage can be rebuilt from the files alone.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr


def plain(value: Any) -> Any:
    """Turn `value` into what JSON can hold; long arrays become a digest of their bytes."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        if len(value) > 64 and isinstance(value[0], float):
            return plain(np.array(value))
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.size > 64:
            digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
            return {"shape": list(value.shape), "dtype": str(value.dtype), "sha256": digest}
        return value.tolist()
    return value


def record(
    result: xr.Dataset, *, function: str, parameters: Mapping[str, Any], inputs: Sequence[xr.Dataset] = ()
) -> xr.Dataset:
    """Append the stage that made `result` to its history and set its ``id``; in place, returned for chaining.

    Parameters
    ----------
    result
        The dataset that the stage gives; its ``history_json`` and ``id`` are set anew.
    function
        Public name of the stage, such as ``"chain.simulate"``.
    parameters
        All options of the call as resolved, defaults included, nothing that a clock or a machine decides.
    inputs
        The datasets that the stage took; their histories are merged in order, each stage once.
    """
    resolved = {key: plain(value) for key, value in parameters.items()}
    inputs = [as_it_is(item) for item in inputs]
    parents = [str(item.attrs.get("id", "unknown")) for item in inputs]
    key = json.dumps([function, resolved, parents], sort_keys=True, separators=(",", ":"))
    identifier = hashlib.sha256(key.encode()).hexdigest()[:20]
    stages: dict[str, dict[str, Any]] = {}
    for item in inputs:
        for stage in stages_of(item):
            stages.setdefault(stage["id"], stage)
    stages[identifier] = {"id": identifier, "function": function, "parameters": resolved, "inputs": parents}
    result.attrs["id"] = identifier
    result.attrs["history_json"] = json.dumps(list(stages.values()), sort_keys=True)
    return result


def seal(scene: xr.Dataset) -> xr.Dataset:
    """Note the values of a scene in its attribute ``values_sha256``, in place, so that a later change of them shows."""
    scene.attrs["values_sha256"] = digest(scene)
    return scene


def digest(dataset: xr.Dataset) -> str:
    """Return a hash over names, dimensions and values of all variables."""
    total = hashlib.sha256()
    for name in sorted(str(name) for name in dataset.variables):
        variable = dataset.variables[name]
        value = np.asarray(variable.values)
        total.update(f"{name}{variable.dims}{value.shape}".encode())
        total.update(str(value.tolist()).encode() if value.dtype.kind in "UO" else value.tobytes())
    return total.hexdigest()[:16]


def as_it_is(item: xr.Dataset) -> xr.Dataset:
    """Give a scene that was changed by hand, as with ``assign``, an id and a stage of its own; other datasets as they are."""
    if item.attrs.get("stage") != "scene" or "values_sha256" not in item.attrs:
        return item
    found = digest(item)
    if found == item.attrs["values_sha256"]:
        return item
    original = item[[]]
    original.attrs = {key: value for key, value in item.attrs.items() if key != "values_sha256"}
    changed = item[[]]
    changed.attrs = {}
    return record(changed, function="changed by hand", parameters={"values_sha256": found}, inputs=[original])


def stages_of(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the stages in the ``history_json`` of `dataset`, oldest first; empty where there is none."""
    return json.loads(dataset.attrs.get("history_json", "[]"))
