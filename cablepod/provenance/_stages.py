"""Stages of a history: form, order and time."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.provenance._abridged import Abridged

if TYPE_CHECKING:
    import xarray as xr

#: Maximum depth of the parameters of a stage, and length of its texts.
MAX_DEPTH, MAX_TEXT = 32, 4096
#: Texts of a stage, and of what its ``id`` follows from; ``json.dumps`` would make such an object in each call.
SORTED, COMPACT = json.JSONEncoder(sort_keys=True), json.JSONEncoder(sort_keys=True, separators=(",", ":"))
#: In place of the time of a stage that no file holds yet; sorted after all times.
NOT_WRITTEN = "~"
#: Number of histories whose stages are kept, those that were read last: to read one takes longer than to check all else.
KEPT_HISTORIES = 256


def is_history(text: str) -> bool:
    """Tell whether a text is a list of stages, as :func:`checked_stages` asks."""
    if type(text) not in (str, Abridged, np.str_):  # which may compare and hash in its own way
        return False
    try:
        _texts_of_stages(text)
    except ValueError:
        return False
    return True


def merged_stages(histories: Iterable[str]) -> dict[str, str]:
    """Return id and JSON text of each stage of some histories, once, in order.

    A stage has one time: where histories differ, it is the earliest, and a stage that was written precedes one that was not.
    """
    stages: dict[str, str] = {}
    times: dict[str, str] = {}
    for history in histories:
        for key, text, written, _ in _texts_of_stages(history):
            if key not in stages or written < times[key]:
                stages[key], times[key] = text, written
    return stages


@lru_cache(KEPT_HISTORIES)
def _texts_of_stages(history: str) -> tuple[tuple[str, str, str, Any], ...]:
    """Return id, JSON text, time and content of each stage of a history."""
    return tuple(
        (stage["id"], SORTED.encode(stage), str(stage.get("written", NOT_WRITTEN)), stage.get("content"))
        for stage in checked_stages(history)
    )


def recorded_content(history: str, identifier: str) -> dict[str, Any] | None:
    """Return the content that a history records of a stage; None without."""
    return next((content for key, _, _, content in _texts_of_stages(history) if key == identifier), None)


def stages_of(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the stages of the history of `dataset`, oldest first; empty without a history."""
    return checked_stages(dataset.attrs.get("history_json", "[]"))


def checked_stages(history: Any) -> list[dict[str, Any]]:
    """Return the stages of a history as text, after a check of their form.

    A stage has texts ``id`` and ``function``, a table ``parameters`` nested at most :data:`MAX_DEPTH` deep, and a list
    ``inputs`` of ids, of stages before it or of none.  ``chosen`` and ``input_hashes`` are lists of texts, ``content`` is what
    :func:`cablepod.provenance.content_of` gives, ``wall_time_s`` a finite number, all else is text.  What may be left out is
    filled in.

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


def _is_content(value: Any) -> bool:
    """Tell whether it is what :func:`cablepod.provenance.content_of` gives: hashes, and an entry of each variable."""
    if not isinstance(value, dict) or set(value) != {"hash", "attributes", "variables"}:
        return False
    entries = value["variables"]
    if not (isinstance(value["hash"], str) and isinstance(value["attributes"], str) and isinstance(entries, dict)):
        return False
    return all(_is_entry(entry) for entry in entries.values())


def _is_entry(value: Any) -> bool:
    """Tell whether it is the entry of a variable: hash, shape and, of real numbers, largest value and weighted sum."""
    if not isinstance(value, list) or len(value) not in (2, 4):
        return False
    text, shape, *numbers = value
    is_shape = isinstance(shape, list) and all(type(size) is int and 0 <= size < 1 << 62 for size in shape)
    return _is_text(text) and is_shape and all(type(number) is float and math.isfinite(number) for number in numbers)


#: Key of a stage -> its form; others are texts.
_FORMS: dict[str, Callable[[Any], bool]] = {
    "id": _is_name, "function": _is_name, "parameters": _is_table, "inputs": _is_list_of_names, "chosen": _is_list_of_names,
    "wall_time_s": _is_duration, "input_hashes": _is_list_of_names, "content": _is_content,
}  # fmt: skip


def _depth(value: Any) -> int:
    """Return how deep tables and lists are nested, counted to just above :data:`MAX_DEPTH`."""
    level, depth = [value], 0
    while level and depth <= MAX_DEPTH + 4:
        depth += 1
        nested = (entry for entry in level if isinstance(entry, dict | list))
        level = [entry for inner in nested for entry in (inner.values() if isinstance(inner, dict) else inner)]
    return depth
