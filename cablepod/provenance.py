"""Provenance of datasets: record of function, parameters and inputs.

Science modules call :func:`record`, which uses no file, clock or git; :mod:`cablepod.archive` adds those on writing.  The ``id``
of a dataset is a hash of function, parameters and the ids of the inputs.  It is equal for equal inputs, so that a lineage can be
reconstructed from the files alone.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    import xarray as xr

#: First attributes of a result, in this order (xarray prints the first six).
ATTRS_FIRST = (
    "title", "stage", "incomplete", "scheme", "formulation", "step", "error_estimate", "time_error_estimate",
    "space_error_estimate", "model", "number_of_steps",
)  # fmt: skip
#: Maximum size of an array stored in a history; longer ones are stored as a digest.
MAX_HISTORY_ITEMS = 64
#: Maximum size of a non-uniform time array stored in a history (a run cannot be repeated without it).
MAX_HISTORY_FLOATS = 4096
#: Maximum depth of the parameters of a stage, and length of its texts.
MAX_DEPTH, MAX_TEXT = 32, 4096
#: Texts of a stage, and of what its ``id`` follows from; ``json.dumps`` would make such an object in each call.
SORTED, COMPACT = json.JSONEncoder(sort_keys=True), json.JSONEncoder(sort_keys=True, separators=(",", ":"))
#: Function of a stage that records a change of values outside the package.
CHANGED = "changed by hand"
#: In place of the time of a stage that no file holds yet; sorted after all times.
NOT_WRITTEN = "~"
#: Formulas for equidistant numbers, see :func:`equidistant`.
EQUIDISTANT = ("multiples", "quotients", "linspace")
#: Attributes of which the reprs of xarray show an abstract.
ABRIDGED = ("history", "history_json", "ensemble_json")
#: Modules that make text and HTML of a Dataset, and the maximum length of a text that they show as it is.
XARRAY_REPRS, MAX_SHOWN = ("xarray.core.formatting", "xarray.core.formatting_html"), 120


class Abridged(str):
    """Text of an attribute, of which the reprs of xarray show an abstract in place of a page.

    For all others it is the whole text: ``str``, ``repr``, ``json.loads``, files, copies, comparisons and hashes are those of a
    plain ``str``.  If a version of xarray calls ``str`` from another module, its reprs show the text.
    """

    __slots__ = ()

    def __str__(self) -> str:
        """Return the whole text, but to the reprs of xarray the abstract."""
        caller = sys._getframe(1).f_globals.get("__name__")
        return self.abstract if caller in XARRAY_REPRS else str.__str__(self)

    @property
    def abstract(self) -> str:
        """One line: number and last of the stages of a history, or the keys of a table; a short text as it is."""
        if len(self) <= MAX_SHOWN:
            return str.__str__(self)
        try:
            content = json.loads(self)
            if isinstance(content, dict):
                return f"<table of {', '.join(content)}>"
            count = f"{len(content)} stage{'s' * (len(content) > 1)}"
            return f"<{count} up to {content[-1]['function']}, see archive.describe>"
        except (ValueError, TypeError, KeyError, IndexError):  # not JSON, or not of this package
            return f"<{len(self.splitlines())} lines, see archive.describe>"


def to_json(value: Any) -> Any:
    """Convert a value to JSON types; long arrays become first, last and count if equidistant, else a digest."""
    if isinstance(value, dict):
        return {str(key): to_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        if len(value) > MAX_HISTORY_ITEMS and isinstance(value[0], float):
            return to_json(np.array(value))
        return [to_json(entry) for entry in value]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.size <= MAX_HISTORY_ITEMS:
            return value.tolist()
        if value.size > MAX_HISTORY_FLOATS or value.dtype.kind != "f":
            return _array_to_json(value)
        found = _kept_array_to_json(value.tobytes(), value.dtype, value.shape)
        return found.copy()  # the caller may change it
    return value


def _array_to_json(value: np.ndarray) -> Any:
    """Convert a long array to JSON types, see :func:`to_json`."""
    for way, candidate in _equidistant(value):
        if np.array_equal(candidate, value):
            return {"equidistant": way, "first": float(value[0]), "last": float(value[-1]), "count": value.size}
    if value.ndim == 1 and value.dtype.kind == "f" and value.size <= MAX_HISTORY_FLOATS:
        return value.tolist()  # non-uniform time array
    digest = hashlib.sha256(np.ascontiguousarray(value).data).hexdigest()[:16]
    return {"shape": list(value.shape), "dtype": str(value.dtype), "sha256": digest}


@lru_cache(64)
def _kept_array_to_json(content: bytes, dtype: np.dtype, shape: tuple[int, ...]) -> Any:
    """Do :func:`_array_to_json` once for the same content: many runs have the same instants."""
    return _array_to_json(np.frombuffer(content, dtype).reshape(shape))


def _equidistant(value: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield formula and equidistant numbers with first, last and count of `value` (formulas differ in the last bits)."""
    if value.ndim == 1 and value.dtype.kind == "f" and np.isfinite(value).all():
        for way in EQUIDISTANT:
            yield way, equidistant(way, float(value[0]), float(value[-1]), value.size)


def equidistant(way: str, first: float, last: float, count: int) -> np.ndarray:
    """Return equidistant numbers: multiples of an interval, quotients by a frequency, or ``numpy.linspace``."""
    span = last - first
    if way == "multiples":
        return first + float(f"{span / (count - 1):.12g}") * np.arange(count)
    if way == "quotients" and span:
        return first + np.arange(count) / float(f"{(count - 1) / span:.12g}")
    return np.linspace(first, last, count)


def public_name(function: Callable[..., Any]) -> str:
    """Return the public name of a function, such as ``"chain.simulate"``, without private modules."""
    package = [part for part in function.__module__.split(".")[1:] if not part.startswith("_")]
    return ".".join([*package, function.__name__])


def defaulted_options(**options: Any) -> list[str]:
    """Return the names of options that are None, which the function chooses itself."""
    return [name for name, value in options.items() if value is None]


def record(
    result: xr.Dataset,
    *,
    function: str,
    parameters: Mapping[str, Any],
    inputs: Sequence[xr.Dataset] = (),
    chosen: Sequence[str] = (),
    scene_digest: str | None = None,
    identity: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Append a stage to the history of `result` and set its ``id``, in place; return `result`.

    Parameters
    ----------
    result
        Result of the stage; its ``history_json`` and ``id`` are replaced.
    function
        Public name of the stage, such as ``"chain.simulate"``.
    parameters
        All options of the call with defaults filled in, nothing that depends on clock or machine.
    inputs
        Input datasets; their histories are merged in order, each stage once.
    chosen
        Names of parameters that the function chose itself, see :func:`defaulted_options`.  A lineage script omits them; they are
        not part of the ``id``.
    scene_digest
        Result of :func:`digest` for the first input, where the caller knows it.
    identity
        What the ``id`` follows from in place of `parameters`, where these name files, whose content and not whose place counts.

    Returns
    -------
    xarray.Dataset
        `result`.
    """
    resolved = {key: to_json(value) for key, value in parameters.items()}
    inputs = [with_manual_change(dataset, None if i else scene_digest) for i, dataset in enumerate(inputs)]
    parents = [str(dataset.attrs.get("id", "unknown")) for dataset in inputs]
    identifying = resolved if identity is None else {key: to_json(value) for key, value in identity.items()}
    key = COMPACT.encode([function, identifying, parents])
    identifier = hashlib.sha256(key.encode()).hexdigest()[:20]
    stages = merged_stages(dataset.attrs.get("history_json", "[]") for dataset in inputs)
    stage = {"id": identifier, "function": function, "parameters": resolved, "inputs": parents}
    stages[identifier] = SORTED.encode(stage | ({"chosen": sorted(chosen)} if chosen else {}))
    attrs = {name: value for name, value in result.attrs.items() if name not in ("id", "history_json")}
    history = Abridged(f"[{', '.join(stages.values())}]")
    _keep_verdict(history, True)
    result.attrs = {**in_order(attrs), "id": identifier, "history_json": history}
    return result


#: Whether texts are histories, of those that were asked for or made last, and the maximum number of them.
VERDICTS: dict[str, bool] = {}
MAX_VERDICTS = 256


def is_history(text: str) -> bool:
    """Tell whether a text is a list of stages, as :func:`checked_stages` asks."""
    if type(text) not in (str, Abridged, np.str_):  # which may compare and hash in its own way
        return False
    verdict = VERDICTS.get(text)
    if verdict is None:
        try:
            checked_stages(text)
            verdict = True
        except ValueError:
            verdict = False
        _keep_verdict(text, verdict)
    return verdict


def _keep_verdict(text: str, verdict: bool) -> None:
    """Keep whether a text is a history: to read a long one takes longer than all other checks of a Dataset."""
    if len(VERDICTS) >= MAX_VERDICTS:
        VERDICTS.clear()
    VERDICTS[text] = verdict


def merged_stages(histories: Iterable[str]) -> dict[str, str]:
    """Return id and JSON text of each stage of some histories, once, in order.

    A stage has one time: where histories differ, it is the earliest, and a stage that was written precedes one that was not.
    """
    stages: dict[str, str] = {}
    times: dict[str, str] = {}
    for history in histories:
        for key, text, written in _texts_of_stages(history):
            if key not in stages or written < times[key]:
                stages[key], times[key] = text, written
    return stages


@lru_cache(256)
def _texts_of_stages(history: str) -> tuple[tuple[str, str, str], ...]:
    """Return id, JSON text and time of each stage of a history (kept, as many results share the history of their inputs)."""
    return tuple(
        (stage["id"], SORTED.encode(stage), str(stage.get("written", NOT_WRITTEN))) for stage in checked_stages(history)
    )


def abridged(attrs: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return attributes, as read from a file, with long texts as :class:`Abridged`."""
    return {
        name: Abridged(value) if name in ABRIDGED and isinstance(value, str) else value for name, value in attrs.items()
    }


def in_order(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes sorted, those of :data:`ATTRS_FIRST` first."""
    first = [name for name in ATTRS_FIRST if name in attrs]
    return {name: attrs[name] for name in (*first, *(name for name in attrs if name not in first))}


def stamp_values(scene: xr.Dataset) -> xr.Dataset:
    """Set the attribute ``values_sha256`` of a scene in place, to detect manual changes later; return the scene."""
    scene.attrs["values_sha256"] = digest(scene)
    return scene


def digest(dataset: xr.Dataset) -> str:
    """Return a hash of names, dimensions and values of all variables."""
    from xarray import IndexVariable

    parts = []
    for name, variable in sorted((str(name), variable) for name, variable in dataset._variables.items()):
        data: Any = variable._data  # Variable.data takes longer than the hash of a scene
        if isinstance(data, np.ndarray):
            content = _content(data)
        elif isinstance(variable, IndexVariable):
            content = _kept_content(_Labels(variable))
        else:
            content = _content(data := np.asarray(variable.data))
        parts += [_described(name, variable._dims, data.shape), content]
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


@lru_cache(1024)
def _described(name: str, dims: tuple[Any, ...], shape: tuple[int, ...]) -> bytes:
    """Return name, dimensions and shape of a variable as bytes (kept: to write tuples takes as long as to hash a scene)."""
    return f"{name}{dims}{shape}".encode()


def _content(values: np.ndarray) -> bytes:
    """Return the content of an array as bytes."""
    return str(values.tolist()).encode() if values.dtype.kind in "UO" else values.tobytes()


class _Labels:
    """Labels of a dimension, which cannot be changed and are compared as an object, for Datasets share them."""

    def __init__(self, variable: xr.IndexVariable) -> None:
        self.variable, self.index, self.dtype = variable, variable._data.array, variable.dtype

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Labels) and self.index is other.index and self.dtype == other.dtype

    def __hash__(self) -> int:
        return id(self.index)


@lru_cache(256)
def _kept_content(labels: _Labels) -> bytes:
    """Return the content of labels as bytes; their conversion by pandas takes longer than that of all numbers of a scene."""
    return _content(np.asarray(labels.variable.data))


def with_manual_change(dataset: xr.Dataset, known_digest: str | None = None) -> xr.Dataset:
    """Return id and history of a scene changed by hand (as with ``assign``) without its data; others unchanged.

    `known_digest` is that of the dataset, computed if None.
    """
    if dataset.attrs.get("stage") != "scene" or "values_sha256" not in dataset.attrs:
        return dataset
    new_digest = known_digest or digest(dataset)
    if new_digest == str(dataset.attrs["values_sha256"]):
        return dataset
    original = dataset[[]]
    original.attrs = {key: value for key, value in dataset.attrs.items() if key != "values_sha256"}
    changed = dataset[[]]
    changed.attrs = {}
    values = {
        str(name): _with_dims(variable)
        for name, variable in dataset.variables.items()
        if variable.size <= MAX_HISTORY_ITEMS
    }
    parameters = {"values_sha256": new_digest, "values": values}
    return record(changed, function=CHANGED, parameters=parameters, inputs=[original])


def _with_dims(variable: xr.Variable) -> Any:
    """Return [dimensions, values, attributes] of a variable as JSON types; only the value of a scalar."""
    value = to_json(np.asarray(variable.values)) if variable.dims else to_json(variable.values[()])
    return [list(variable.dims), value, dict(variable.attrs)] if variable.dims else value


def stages_of(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the stages of the history of `dataset`, oldest first; empty without a history."""
    return checked_stages(dataset.attrs.get("history_json", "[]"))


def checked_stages(history: Any) -> list[dict[str, Any]]:
    """Return the stages of a history as text, after a check of their form.

    A stage has texts ``id`` and ``function``, a table ``parameters`` nested at most :data:`MAX_DEPTH` deep, and a list
    ``inputs`` of ids, of stages before it or of none.  ``chosen`` is a list of texts, ``wall_time_s`` a finite number, all else
    is text.  What may be left out is filled in.

    Raises
    ------
    ValueError
        If it is anything else; the message says what.
    """
    try:
        stages = json.loads(history)
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError("it is not JSON") from error
    if not isinstance(stages, list):
        raise ValueError("it is no list")
    later = {stage.get("id") for stage in stages if isinstance(stage, dict) and isinstance(stage.get("id"), str)}
    for number, stage in enumerate(stages, start=1):
        if not isinstance(stage, dict):
            raise ValueError(f"stage {number} is no table")
        stage.setdefault("parameters", {})
        stage.setdefault("inputs", [])
        if "written" in stage:
            stage.setdefault("program", "unknown")
            stage.setdefault("version", "unknown")
        for key, value in stage.items():
            if not _FORMS.get(key, _is_text)(value):
                raise ValueError(f"stage {number} has another {key} than a stage can have")
        if not {"id", "function"} <= set(stage):
            raise ValueError(f"stage {number} has no id or no function")
        if stage["id"] not in later:
            raise ValueError(f"stage {number} has the id of another one")
        if later.intersection(stage["inputs"]):
            raise ValueError(f"stage {number} has an input that is made after it")
        later.discard(stage["id"])
    return stages


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= MAX_TEXT


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 200 and value.isprintable()


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) and _depth(value) <= MAX_DEPTH


def _is_list_of_names(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_name, value))


def _is_duration(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e300


#: Key of a stage -> its form; others are texts.
_FORMS: dict[str, Callable[[Any], bool]] = {
    "id": _is_name, "function": _is_name, "parameters": _is_table, "inputs": _is_list_of_names, "chosen": _is_list_of_names,
    "wall_time_s": _is_duration,
}  # fmt: skip


def _depth(value: Any) -> int:
    """Return how deep tables and lists are nested, counted to just above :data:`MAX_DEPTH`."""
    level, depth = [value], 0
    while level and depth <= MAX_DEPTH + 4:
        depth += 1
        nested = (entry for entry in level if isinstance(entry, dict | list))
        level = [entry for inner in nested for entry in (inner.values() if isinstance(inner, dict) else inner)]
    return depth
