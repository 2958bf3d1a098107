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
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import xarray as xr

#: Attributes that say what a result is; they lead wherever it is printed (xarray shows the first six).
ATTRS_FIRST = (
    "title", "stage", "incomplete", "scheme", "formulation", "step", "error_estimate", "time_error_estimate",
    "space_error_estimate", "model", "number_of_steps",
)  # fmt: skip
#: Longer arrays are not kept in a history.
MAX_HISTORY_ITEMS = 64
#: But uneven instants, without which nothing could be made again, up to so many.
MAX_HISTORY_FLOATS = 4096
#: Ways to make equidistant numbers, see :func:`equidistant`.
EQUIDISTANT = ("multiples", "quotients", "linspace")


def to_json(value: Any) -> Any:
    """Turn `value` into what JSON can hold; of long arrays first, last and count if equidistant, or a digest of their bytes."""
    if isinstance(value, dict):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        if len(value) > MAX_HISTORY_ITEMS and isinstance(value[0], float):
            return to_json(np.array(value))
        return [to_json(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.size > MAX_HISTORY_ITEMS:
            for way, made in _equidistant(value):
                if np.array_equal(made, value):
                    return {"equidistant": way, "first": float(value[0]), "last": float(value[-1]), "count": value.size}
            if value.ndim == 1 and value.dtype.kind == "f" and value.size <= MAX_HISTORY_FLOATS:
                return value.tolist()  # uneven instants
            digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
            return {"shape": list(value.shape), "dtype": str(value.dtype), "sha256": digest}
        return value.tolist()
    return value


def _equidistant(value: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield ways to make equidistant numbers, which differ in their last bits, from first, last and count of `value`."""
    if value.ndim == 1 and value.dtype.kind == "f" and np.isfinite(value).all():
        for way in EQUIDISTANT:
            yield way, equidistant(way, float(value[0]), float(value[-1]), value.size)


def equidistant(way: str, first: float, last: float, count: int) -> np.ndarray:
    """Make equidistant numbers: as multiples of an interval, as quotients by a rate, or as numpy.linspace does."""
    span = last - first
    if way == "multiples":
        return first + float(f"{span / (count - 1):.12g}") * np.arange(count)
    if way == "quotients" and span:
        return first + np.arange(count) / float(f"{(count - 1) / span:.12g}")
    return np.linspace(first, last, count)


def public_name(function: Callable[..., Any]) -> str:
    """Name a public function by its package, as in ``"chain.simulate"``: files of a package are private."""
    package = [part for part in function.__module__.split(".")[1:] if not part.startswith("_")]
    return ".".join([*package, function.__name__])


def defaulted_options(**options: Any) -> list[str]:
    """Names of the options that were left to the function, which are None."""
    return [name for name, value in options.items() if value is None]


def record(
    result: xr.Dataset,
    *,
    function: str,
    parameters: Mapping[str, Any],
    inputs: Sequence[xr.Dataset] = (),
    chosen: Sequence[str] = (),
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
    chosen
        Names of parameters that the function chose itself, see :func:`unset`: who makes the result again leaves them out.  They
        stand outside the ``id``.
    """
    resolved = {key: to_json(value) for key, value in parameters.items()}
    inputs = [with_manual_change(item) for item in inputs]
    parents = [str(item.attrs.get("id", "unknown")) for item in inputs]
    key = json.dumps([function, resolved, parents], sort_keys=True, separators=(",", ":"))
    identifier = hashlib.sha256(key.encode()).hexdigest()[:20]
    stages: dict[str, dict[str, Any]] = {}
    for item in inputs:
        for stage in stages_of(item):
            stages.setdefault(stage["id"], stage)
    stages[identifier] = {"id": identifier, "function": function, "parameters": resolved, "inputs": parents}
    if chosen:
        stages[identifier]["chosen"] = sorted(chosen)
    attrs = {name: value for name, value in result.attrs.items() if name not in ("id", "history_json")}
    history = json.dumps(list(stages.values()), sort_keys=True)
    result.attrs = {**in_order(attrs), "id": identifier, "history_json": history}
    return result


def in_order(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Put attributes in the order in which a result has them."""
    first = [name for name in ATTRS_FIRST if name in attrs]
    return {name: attrs[name] for name in (*first, *(name for name in attrs if name not in first))}


def stamp_values(scene: xr.Dataset) -> xr.Dataset:
    """Note the values of a scene in its attribute ``values_sha256``, in place, so that a later change of them shows."""
    scene.attrs["values_sha256"] = digest(scene)
    return scene


def digest(dataset: xr.Dataset) -> str:
    """Return a hash over names, dimensions and values of all variables."""
    parts = []
    for name, variable in sorted(dataset.variables.items(), key=lambda item: str(item[0])):
        value = variable.values
        parts.append(f"{name}{variable.dims}{value.shape}".encode())
        parts.append(str(value.tolist()).encode() if value.dtype.kind in "UO" else value.tobytes())
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def with_manual_change(item: xr.Dataset) -> xr.Dataset:
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
    values = {
        str(name): _with_dims(variable)
        for name, variable in item.variables.items()
        if variable.size <= MAX_HISTORY_ITEMS
    }
    parameters = {"values_sha256": found, "values": values}
    return record(changed, function="changed by hand", parameters=parameters, inputs=[original])


def _with_dims(variable: xr.Variable) -> Any:
    value = to_json(np.asarray(variable.values)) if variable.dims else to_json(variable.values[()])
    return [list(variable.dims), value, dict(variable.attrs)] if variable.dims else value


def stages_of(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the stages in the ``history_json`` of `dataset`, oldest first; empty where there is none."""
    return json.loads(dataset.attrs.get("history_json", "[]"))
