"""Lineage of a dataset: list of its stages, and the Python script that reproduces it."""

from __future__ import annotations

import importlib
import inspect
import keyword
import math
from collections.abc import Iterator, Mapping
from typing import Any

import xarray as xr

from cablepod import provenance
from cablepod._models import MODELS
from cablepod.archive._attributes import checked_stages
from cablepod.archive._describe import stage_line
from cablepod.errors import printable

#: Function -> variable name in the script; by default a part of the function's name.
NAMES = {
    "make_scene": "scene",
    provenance.CHANGED: "changed",
    provenance.MADE: "given",
    "pod.decompose": "modes",
    "ensemble.design": "scenes",
    "ensemble.run": "runs",
    "wind.field": "wind",
}
#: Sub-packages and modules whose functions a script may call; "" is the package itself.
REPEATED = (
    "",
    "catenary",
    "compare",
    "ensemble",
    "extremes",
    "fatigue",
    "paper",
    "periodic",
    "pod",
    "study",
    "wind",
    *(model.sub_package for model in MODELS.values()),
)

#: Options that may be given by position too.
POSITIONAL = ("ranges", "temperatures")


def ancestors(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """List the stages that led to a dataset, its own last, in order of execution.

    Returns
    -------
    list of dict
        With ``id``, ``function``, ``parameters``, ``inputs`` and, of files, date and program.
    """
    stages = {stage["id"]: stage for stage in checked_stages(dataset)}
    ordered: dict[str, dict[str, Any]] = {}
    pending = [(str(dataset.attrs.get("id")), False)]
    while pending:
        identifier, ready = pending.pop()
        if identifier not in stages or identifier in ordered:
            continue
        if ready:
            ordered[identifier] = stages[identifier]
        else:
            pending.append((identifier, True))
            pending.extend((parent, False) for parent in reversed(stages[identifier]["inputs"]))
    return list(ordered.values())


def script(dataset: xr.Dataset) -> str:
    """Return a Python script that reproduces a dataset from its scenes.

    It compares the values of each stage with the recorded ones, see :func:`cablepod.archive._repeated.check`, and stops at a
    stage that cannot be reproduced.
    """
    stages = ancestors(dataset)
    if not stages:
        return "# no history: nothing says where this comes from\n"
    names = _names(stages)
    lines = [_comment(dataset.attrs.get("title", stages[-1]["function"])), "#"]
    lines += [_comment(stage_line(stage)) for stage in stages]
    lines += ["", "import cablepod as cp", "import cablepod.lineage", ""]
    for stage in stages:
        lines += _statements(stage, names)
    last = names[stages[-1]["id"]]
    lines += [f'cp.archive.write({last}, "{last}_again.nc")']
    return "\n".join(lines) + "\n"


def _names(stages: list[dict[str, Any]]) -> dict[str, str]:
    """Return the variable names of the results in the script, id -> name."""
    names: dict[str, str] = {}
    for stage in stages:
        function = stage["function"]
        base = NAMES.get(function, function.split(".")[0 if function.endswith(".simulate") else -1])
        if not base.isascii() or not base.isidentifier() or keyword.iskeyword(base) or base in ("cp", "cablepod"):
            base = "result"
        count = sum(name.rstrip("_0123456789") == base for name in names.values())
        names[stage["id"]] = base if not count else f"{base}_{count + 1}"
    return names


def _comment(text: Any) -> str:
    """Return a text as one line of comment."""
    return "# " + printable(" ".join(str(text).split()))


def _statements(stage: Mapping[str, Any], names: Mapping[str, str]) -> list[str]:
    """Return the statements that reproduce the result of one stage, or one that says why they cannot."""
    try:
        return _reproduction(stage, names)
    except (ValueError, TypeError, LookupError, AttributeError):
        text = f"{stage['function']}, {stage['id']}: cannot be made again, its record has other parameters than the function"
        return [f"raise SystemExit({text!r})", ""]


def _reproduction(stage: Mapping[str, Any], names: Mapping[str, str]) -> list[str]:
    """Return the statements that reproduce the result of one stage; they hold known functions and literal values only."""
    name, function, parameters = names[stage["id"]], stage["function"], stage["parameters"]
    why = _obstacle(stage, names)
    if why:
        text = f"{function}, {stage['id']}: cannot be made again, {why}"
        return [f"raise SystemExit({text!r})", ""]
    inputs = [names[parent] for parent in stage["inputs"]]
    if function == "pod.decompose" and len(inputs) > 1:  # several trajectories are one argument
        inputs = [f"[{', '.join(inputs)}]"]
    if function.endswith(".simulate"):
        inputs = [f"wind={name}" if name.rstrip("_0123456789") == NAMES["wind.field"] else name for name in inputs]
    if function == "ensemble.run":
        return [*_ensemble(name, inputs, parameters), _check(stage, name), ""]
    if function == "make_scene":
        call = f"cp.make_scene({_text(parameters['scene'])})"
    elif function == provenance.CHANGED and "labels" in parameters:
        return _selection(stage, name, inputs[0])
    elif function == provenance.CHANGED:
        values, lacks = _text(parameters.get("values", {})), _text(parameters.get("lacks", []))
        call = f"cablepod.lineage.changed({inputs[0]}, values={values}, lacks={lacks})"
    else:
        chosen = set(stage.get("chosen", ()))
        options = [
            f"{key}={_text(value)}"
            for key, value in parameters.items()
            if key in _options(function) and key not in chosen
        ]
        arguments = inspect.signature(_callable(function)).parameters.values()
        # functions of the paper read their scenes
        inputs = [] if all(argument.kind is argument.KEYWORD_ONLY for argument in arguments) else inputs
        call = f"cp.{function}({', '.join([*inputs, *options])})"
    lines = [f"{name} = {call}"]
    if function != provenance.CHANGED:  # the id of a changed dataset appears only in later stages
        lines.append(_check(stage, name))
    return [*lines, ""]


def _obstacle(stage: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """Return why a stage cannot be made again; empty if it can."""
    function, parameters = stage["function"], stage["parameters"]
    missing = [parent for parent in stage["inputs"] if parent not in names]
    if missing:
        return "the history lacks " + ", ".join(missing)
    if function == provenance.MADE:
        return f"it was made outside the package: {_extent(parameters)}"
    if function == provenance.CHANGED:
        is_cut = not parameters["differs"] and "attributes" not in parameters
        if "values" in parameters or "labels" in parameters or is_cut:
            return ""
        return _change(parameters)
    digested = list(_digests(parameters))
    if digested:
        return f"only a digest is kept of {', '.join(digested)}"
    if function.startswith("study.") and _callable(function) is None:
        return "it is a table of a study, with measured run times; try: run the study again"
    return "" if callable(_callable(function)) else "that is no function of the package to call by itself"


def _change(parameters: Mapping[str, Any]) -> str:
    """Return what was changed outside the package."""
    what = [*parameters["differs"], *(["attributes"] if "attributes" in parameters else [])]
    return f"values were changed outside the package: {', '.join(map(str, what))}; {_extent(parameters)}"


def _selection(stage: Mapping[str, Any], name: str, parent: str) -> list[str]:
    """Return the statements that select a part of a result, and stop where more was changed."""
    parameters = stage["parameters"]
    labels, lacks = _text(parameters["labels"]), _text(parameters.get("lacks", []))
    text = f"{stage['function']}, {stage['id']}: cannot be made again, {_change(parameters)}"
    return [
        "try:",
        f"    {name} = cablepod.lineage.selected({parent}, {labels}, lacks={lacks}, values={_values(stage)})",
        "except cp.SceneError as error:",
        f"    raise SystemExit({text!r}) from error",
        "",
    ]


def _extent(parameters: Mapping[str, Any]) -> str:
    """Return sizes, and first and last instant, as text."""
    sizes = ", ".join(f"{name} {size}" for name, size in parameters.get("sizes", {}).items()) or "scalars"
    if "first_instant" not in parameters:
        return sizes
    return f"{sizes}, from {parameters['first_instant']:g} s to {parameters['last_instant']:g} s"


def _check(stage: Mapping[str, Any], name: str) -> str:
    """Return the statement that compares a result with the record of its stage."""
    of_files = stage["function"] == "ensemble.run" and "number" not in stage["parameters"]
    if of_files or "content" not in stage:
        return f"cablepod.lineage.check({name}, {_quoted(stage['id'])}, values={{}})"
    return f"cablepod.lineage.check({name}, {_quoted(stage['id'])}, values={_values(stage)})"


def _values(stage: Mapping[str, Any]) -> str:
    """Return the record of the variables of a stage as Python text."""
    values = ",\n".join(f"    {key!r}: {entry!r}" for key, entry in stage["content"]["variables"].items())
    return f"{{\n{values}\n}}"


def _quoted(text: str) -> str:
    """Return a text as Python text, in double quotes where it has none."""
    return f'"{text}"' if text.isalnum() and text.isascii() else repr(text)


def _ensemble(name: str, inputs: list[str], parameters: Mapping[str, Any]) -> Iterator[str]:
    """Yield statements that run an ensemble again, and read one batch if the dataset is a batch."""
    folder = f"{name}_again"
    options = {"model": parameters["model"], "batch": parameters["batch"], **parameters["options"]}
    arguments = [inputs[0], repr(folder), *(f"modes={modes}" for modes in inputs[1:])]
    arguments += [f"{key}={_text(value)}" for key, value in options.items() if value is not None]
    if not {"model", "batch", *parameters["options"]} <= _options("ensemble.run") | _options(
        f"{parameters['model']}.simulate"
    ):
        raise ValueError
    yield f"{name} = cp.ensemble.run({', '.join(arguments)})"
    if "number" in parameters:
        yield f'{name} = cp.archive.read("{folder}/batch_{int(parameters["number"]):04d}.nc")'


def _callable(function: str) -> Any:
    """Return a public function by its name in a history, None if there is none."""
    module, _, name = function.rpartition(".")
    package = module.split(".")[0]
    if package not in REPEATED or not all(part.isidentifier() and part[:1] != "_" for part in function.split(".")):
        return None
    try:
        found = getattr(importlib.import_module(f"cablepod.{module}" if module else "cablepod"), name, None)
    except ImportError:
        return None
    return found if inspect.isfunction(found) and found.__module__.startswith("cablepod.") else None


def _options(function: str) -> set[str]:
    """Return the names of the keyword arguments of a function."""
    found = _callable(function)
    if found is None:
        raise ValueError(function)
    arguments = inspect.signature(found).parameters
    return {name for name, arg in arguments.items() if arg.kind is arg.KEYWORD_ONLY or name in POSITIONAL}


def _digests(value: Any, key: str = "") -> Iterator[str]:
    """Yield the key paths of arrays stored as a digest only."""
    if isinstance(value, Mapping):
        if "sha256" in value and "shape" in value:
            yield key
        for name, entry in value.items():
            yield from _digests(entry, f"{key}.{name}" if key else str(name))


def _text(value: Any) -> str:
    """Return a value as Python text; equidistant numbers as a call that reproduces them bit for bit."""
    if isinstance(value, Mapping):
        if set(value) == {"equidistant", "first", "last", "count"}:
            arguments = ", ".join(repr(value[key]) for key in ("equidistant", "first", "last", "count"))
            return f"cp.provenance.equidistant({arguments})"
        return "{" + ", ".join(f"{key!r}: {_text(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_text, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return f'float("{value}")'
    return repr(value)
