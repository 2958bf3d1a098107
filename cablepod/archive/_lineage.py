"""Where a dataset comes from, as a list and as a Python file that makes it again."""

from __future__ import annotations

import importlib
import inspect
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.errors import SceneError

#: What results are called in the file; others by the last part of the function's name.
NAMES = {
    "make_scene": "scene",
    "changed by hand": "changed",
    "pod.decompose": "modes",
    "ensemble.design": "scenes",
    "ensemble.run": "runs",
}


def ancestors(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """List the stages that led to a dataset, itself last, each after those that it took.

    Returns
    -------
    list of dict
        With ``id``, ``function``, ``parameters``, ``inputs`` and, in files, when and by what they were written.
    """
    stages = {stage["id"]: stage for stage in provenance.stages_of(dataset)}
    found: dict[str, dict[str, Any]] = {}
    pending = [(str(dataset.attrs.get("id")), False)]
    while pending:
        identifier, ready = pending.pop()
        if identifier not in stages or identifier in found:
            continue
        if ready:
            found[identifier] = stages[identifier]
        else:
            pending.append((identifier, True))
            pending.extend((parent, False) for parent in reversed(stages[identifier]["inputs"]))
    return list(found.values())


def script(dataset: xr.Dataset) -> str:
    """Write a Python file that makes a dataset again from its scenes, and says so where it cannot.

    It stops where an id is not the same again.
    """
    stages = ancestors(dataset)
    if not stages:
        return "# no history: nothing says where this comes from\n"
    names = _names(stages)
    lines = [f"# {dataset.attrs.get('title', stages[-1]['function'])}", "#"]
    lines += [f"# {line}" for line in _listed(stages)]
    lines += ["", "import cablepod as cp", "import cablepod.lineage", ""]
    for stage in stages:
        lines += _statements(stage, names)
    last = names[stages[-1]["id"]]
    lines += [f'cp.archive.write({last}, "{last}_again.nc")']
    return "\n".join(lines) + "\n"


def _names(stages: list[dict[str, Any]]) -> dict[str, str]:
    names: dict[str, str] = {}
    for stage in stages:
        function = stage["function"]
        base = NAMES.get(function, function.split(".")[0 if function.endswith(".simulate") else -1]).replace(" ", "_")
        count = sum(name.rstrip("_0123456789") == base for name in names.values())
        names[stage["id"]] = base if not count else f"{base}_{count + 1}"
    return names


def _listed(stages: list[dict[str, Any]]) -> Iterator[str]:
    for stage in stages:
        written = f"  {stage['written']}, {stage['program']} {stage['version']}" if "written" in stage else ""
        inputs = f" from {', '.join(stage['inputs'])}" if stage["inputs"] else ""
        yield f"{stage['id']} {stage['function']}{inputs}{written}"


def _statements(stage: Mapping[str, Any], names: Mapping[str, str]) -> list[str]:
    """Statements that make the result of one stage."""
    name, function, parameters = names[stage["id"]], stage["function"], stage["parameters"]
    missing = [parent for parent in stage["inputs"] if parent not in names]
    lost = list(_digests(parameters))
    if function == "changed by hand":
        lost = [] if "values" in parameters else ["values"]
    if missing or lost or (function != "changed by hand" and not _found(function)):
        why = "the history lacks " + ", ".join(missing) if missing else f"only a digest is kept of {', '.join(lost)}"
        if not (missing or lost):
            why = "that is no function of the package to call by itself"
        text = f"{function}, {stage['id']}: cannot be made again, {why}"
        return [f"raise SystemExit({text!r})", ""]
    taken = [names[parent] for parent in stage["inputs"]]
    if function == "pod.decompose" and len(taken) > 1:  # several trajectories are one argument
        taken = [f"[{', '.join(taken)}]"]
    if function == "oblique.train":  # scenes, as many trajectories, modes
        half = len(taken) // 2
        taken = [f"[{', '.join(taken[:half])}]", f"[{', '.join(taken[half:-1])}]", taken[-1]]
    if function == "ensemble.run":
        return [*_ensemble(name, taken, parameters), f'cablepod.lineage.check({name}, "{stage["id"]}")', ""]
    if function == "make_scene":
        call = f"cp.make_scene({_text(parameters['scene'])})"
    elif function == "changed by hand":
        call = f"cablepod.lineage.changed({taken[0]}, values={_text(parameters['values'])})"
    else:
        chosen = set(stage.get("chosen", ()))
        options = [
            f"{key}={_text(value)}"
            for key, value in parameters.items()
            if key in _options(function) and key not in chosen
        ]
        call = f"cp.{function}({', '.join([*taken, *options])})"
    lines = [f"{name} = {call}"]
    if function != "changed by hand":  # a change shows only in what is made of it
        lines.append(f'cablepod.lineage.check({name}, "{stage["id"]}")')
    return [*lines, ""]


def _ensemble(name: str, taken: list[str], parameters: Mapping[str, Any]) -> Iterator[str]:
    """Statements that run an ensemble again, and read the batch that is meant, if it is one."""
    folder = f"{name}_again"
    options = {"model": parameters["model"], "batch": parameters["batch"], **parameters["options"]}
    given = [taken[0], repr(folder), *(f"modes={modes}" for modes in taken[1:])]
    given += [f"{key}={_text(value)}" for key, value in options.items() if value is not None]
    yield f"{name} = cp.ensemble.run({', '.join(given)})"
    if "number" in parameters:
        yield f'{name} = cp.archive.read("{folder}/batch_{parameters["number"]:04d}.nc")'


def _callable(function: str) -> Any:
    module, _, name = function.rpartition(".")
    try:
        return getattr(importlib.import_module(f"cablepod.{module}" if module else "cablepod"), name, None)
    except ImportError:
        return None


def _found(function: str) -> bool:
    return callable(_callable(function))


def _options(function: str) -> set[str]:
    signature = inspect.signature(_callable(function))
    return {name for name, item in signature.parameters.items() if item.kind is item.KEYWORD_ONLY or name == "ranges"}


def _digests(value: Any, key: str = "") -> Iterator[str]:
    """Key paths of arrays of which only a digest is kept."""
    if isinstance(value, Mapping):
        if "sha256" in value and "shape" in value:
            yield key
        for name, item in value.items():
            yield from _digests(item, f"{key}.{name}" if key else str(name))


def _text(value: Any) -> str:
    """Write a value as Python; equidistant numbers as a call that gives them bit for bit."""
    if isinstance(value, Mapping):
        if set(value) == {"equidistant", "first", "last", "count"}:
            about = ", ".join(repr(value[key]) for key in ("equidistant", "first", "last", "count"))
            return f"cp.provenance.equidistant({about})"
        return "{" + ", ".join(f"{key!r}: {_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_text, value)) + "]"
    return repr(value)


def check(dataset: xr.Dataset, identifier: str) -> None:
    """Stop where a dataset that was made again is another.

    Raises
    ------
    SceneError
        Naming both ids; another version of the package may have made the first.
    """
    if dataset.attrs.get("id") != identifier:
        raise SceneError(
            f"id: given {dataset.attrs.get('id')}, of what was made again; allowed: {identifier}, "
            f"of what is in the file; history: {json.dumps(provenance.stages_of(dataset)[-1:])[:400]}"
        )


def changed(scene: xr.Dataset, *, values: Mapping[str, Any]) -> xr.Dataset:
    """Change a scene by hand as its history tells.

    Parameters
    ----------
    scene
        The scene before.
    values
        Of each variable its value, or dimensions, values and attributes.

    Raises
    ------
    SceneError
        Where a variable was too long to be kept in the history.
    """
    made: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, list):
            dims, numbers, attrs = value
            kind = scene[name].dtype if name in scene else None
            made[name] = (tuple(dims), np.asarray(numbers, dtype=kind), attrs)
        else:
            made[name] = scene[name].copy(data=value) if name in scene and not scene[name].dims else value
    return scene.drop_vars(
        [name for name in scene.variables if name not in made and scene[name].size <= provenance.MAX_HISTORY_ITEMS]
    ).assign(made)
