"""Global attributes of a file: summary, history, program, content hash."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.archive._checksums import CHECKSUMS, BlockSums, as_text
from cablepod.archive._program import program
from cablepod.archive._read import content_types, fixed_width_texts
from cablepod.archive._seal import SCHEMA
from cablepod.errors import ArchiveError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    #: Contents of variables by name.
    Contents = dict[str, provenance.VariableContent]

#: Attributes of all files.
ROOT = {
    "keywords": "cable, catenary, chain, proper orthogonal decomposition, Karhunen-Loeve, reduced order model",
    "comment": "Time is elapsed time in seconds since the start of the run and belongs to no date. Positions are "
    "Cartesian with y pointing up; arc length is unstretched and counts from the lower end.",
    "references": "Escalante, Faure, Rougier, Rosales, Filipich: A reduced order model of taut cable dynamics using "
    "Karhunen-Loeve decomposition",
    "license": "Freely distributed: cablepod (MIT license) sets no terms on what it computes",
}
#: Id of a stage -> program and time of its first file in this process, so that all its files tell one time.
_STAMPS: dict[str, dict[str, str]] = {}
#: Default summary, with the function of the last stage.
SUMMARY = (
    "What the stage {} of cablepod gave, a package for reduced-order models of the dynamics of cables. "
    "The history says from which inputs and with which parameters."
)


def with_file_attributes(dataset: xr.Dataset) -> xr.Dataset:
    """Return a copy of `dataset` without inherited encodings, with the attributes of a file."""
    stamped = fixed_width_texts(dataset.drop_encoding())
    for name, content in content_types(stamped):
        stamped.variables[name].attrs.setdefault("coverage_content_type", content)
    contents, sums = _read_once(dataset)
    stamped.attrs = root_attributes(dataset, contents)
    stamped.attrs[CHECKSUMS] = as_text(stamped, sums)
    return stamped


def _read_once(dataset: xr.Dataset) -> tuple[Contents, dict[str, BlockSums]]:
    """Return what a history keeps of each variable, and the checksums of its blocks, in one pass over the values."""
    contents, sums = {}, {}
    for name, variable in dataset.variables.items():
        content, blocks = provenance.VariableContent(variable), BlockSums(variable)
        for values in _slabs(variable):
            content.update(values)
            blocks.update(values)
        contents[str(name)], sums[str(name)] = content, blocks
    return contents, sums


def _slabs(variable: xr.Variable) -> Iterator[np.ndarray]:
    """Yield the values in order, for a lazy variable chunk by chunk along its first dimension."""
    if not variable.chunks or variable.dtype.kind in "UO":  # a scalar has no chunks
        yield variable.values
        return
    stops = np.cumsum(variable.chunks[0])
    for stop, size in zip(stops, variable.chunks[0], strict=True):
        yield variable.isel({variable.dims[0]: slice(stop - size, stop)}).values


def with_own_id(dataset: xr.Dataset, contents: Contents | None = None) -> xr.Dataset:
    """Return a dataset that differs from what its last stage made, in values or attributes, with a stage and id of its own.

    Others are returned unchanged.  `contents` are the contents of the variables, computed if None.
    """
    if "id" not in dataset.attrs or not checked_stages(dataset):
        return dataset
    found = provenance.input_of(dataset, contents=contents)
    if found.id == str(dataset.attrs["id"]):
        return dataset
    return dataset.assign_attrs(id=found.id, history_json=found.history)


def root_attributes(dataset: xr.Dataset, contents: Contents) -> dict[str, Any]:
    """Return the global attributes of a file for `dataset`, with its history.

    Stages that were read from a file keep their date and program, others have those of their first file in this process.  A
    dataset whose values or attributes were changed since it was read gets a stage and id of its own.  `contents` are those of all
    variables.
    """
    dataset = with_own_id(dataset, contents)
    content = provenance.content_of(dataset, contents)
    attrs: dict[str, Any] = {**ROOT, **dataset.attrs}
    attrs["id"] = str(attrs.get("id") or content["hash"])
    stages = checked_stages(dataset) or [
        {"id": attrs["id"], "function": "archive.write", "parameters": {}, "inputs": []}
    ]
    new = [stage for stage in stages if "written" not in stage]
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    for stage in new:
        stage.update(_STAMPS.setdefault(stage["id"], {**program(), "written": now}))
    last = stage_of(stages, attrs["id"])
    if dataset.variables:
        last["content"] = content
    if "wall_time_s" in attrs:
        last["wall_time_s"] = float(attrs.pop("wall_time_s"))
    # default texts of earlier stages may be inherited from an input: replace them
    for name, text in (("title", "Result of {}"), ("summary", SUMMARY)):
        if attrs.get(name) in {None, *(text.format(stage["function"]) for stage in stages)}:
            attrs[name] = text.format(last["function"])
    if new or not {"source", "date_created"} <= set(attrs):
        attrs.update(source=f"cablepod {program()['version']}", date_created=now)
    for name in ("time_coverage_duration", "time_coverage_resolution"):
        attrs.pop(name, None)  # possibly inherited from an input with other times
    attrs.update(_time_coverage(dataset))
    attrs.update(Conventions="CF-1.11, ACDD-1.3", history=_history(str(attrs.get("history", "")), stages))
    attrs.update(history_json=json.dumps(stages, sort_keys=True), cablepod_schema=SCHEMA)
    return attrs


def checked_stages(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the stages of the history, after a check of their form."""
    try:
        return provenance.stages_of(dataset)
    except ValueError as error:
        raise ArchiveError(
            f"attribute 'history_json' is not a list of stages, each with id and function: {error}; leave it out"
        ) from error


def stage_of(stages: list[dict[str, Any]], identifier: str) -> dict[str, Any]:
    """Return the stage with the id `identifier`, or the last stage if there is none."""
    return next((stage for stage in stages if stage["id"] == identifier), stages[-1])


def _history(history: str, stages: list[dict[str, Any]]) -> str:
    """Return `history` with one line for each stage, of the time of the stage; lines of others are kept."""
    own = {stage["id"]: _history_line(stage) for stage in stages}
    times = {stage["id"]: stage["written"] for stage in stages}
    lines: dict[str, str] = {}
    for line in history.split("\n") if history else []:
        key = next((word[3:] for word in line.split() if word.startswith("id=") and word[3:] in own), line)
        lines.setdefault(key, line if key == line or line.startswith(times[key]) else own[key])
    return "\n".join((lines | {key: line for key, line in own.items() if key not in lines}).values())


def _history_line(stage: Mapping[str, Any]) -> str:
    """Return the line of a stage: time, program, call, id, inputs."""
    inputs = f" inputs={','.join(stage['inputs'])}" if stage.get("inputs") else ""
    return f"{stage['written']} {stage['program']} {stage['version']}: {call_text(stage)} id={stage['id']}{inputs}"


def call_text(stage: Mapping[str, Any], width: int = 160) -> str:
    """Return a stage as the text of a call, with parameters truncated to `width` characters."""
    arguments = ", ".join(f"{name}={json.dumps(value)}" for name, value in stage.get("parameters", {}).items())
    return f"{stage['function']}({arguments if len(arguments) <= width else arguments[: width - 3] + '...'})"


def _time_coverage(dataset: xr.Dataset) -> dict[str, str]:
    """Return duration and, if it is constant, interval of ``time`` as ISO 8601 durations."""
    time = dataset.variables.get("time")
    if time is None or time.dims != ("time",) or time.size < 2 or time.dtype.kind not in "fi":
        return {}
    steps = np.diff(time.values)
    coverage = {"time_coverage_duration": time.values[-1] - time.values[0]}
    if np.allclose(steps, steps[0], rtol=1e-6, atol=0):
        coverage["time_coverage_resolution"] = steps.mean()
    return {name: f"PT{np.format_float_positional(x, 9, trim='-')}S" for name, x in coverage.items() if np.isfinite(x)}
