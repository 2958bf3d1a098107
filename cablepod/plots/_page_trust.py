"""How far to trust results: warnings that they show, estimates of their errors, and where they come from."""

from __future__ import annotations

import math
import platform
import warnings
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import ATTRIBUTES, digits, note_lines
from cablepod.integrate._coarse import LIKELY, remedy_of
from cablepod.plots import _page_tables
from cablepod.plots._maps import LARGEST_TIME_ERROR
from cablepod.plots._page_html import NOTHING, Table
from cablepod.reduced._validity import (
    MAX_ESTIMATED_ERROR,
    warn_condensed_members,
    warn_condensed_out_of_range,
    warn_galerkin_out_of_range,
)  # fmt: skip

#: Estimates of errors in the order of their worth -> heading.
ESTIMATES = {
    "error_estimate": "model [%]",
    "space_error_estimate": "links or elements [%]",
    "time_error_estimate": "time step [%]",
    "tension_time_error_estimate": "time step, tension [%]",
    "energy_excess": "energy excess [%]",
    "energy_defect": "energy defect [%]",
}
#: Checks of the attributes of a run, by its model.
CHECKS = {"condensed": warn_condensed_out_of_range, "Galerkin": warn_galerkin_out_of_range}
CHECKS_OF_MEMBERS = {"condensed": warn_condensed_members}
#: Forces that are zero where a cable is slack -> what it is.
FORCES = {"tension_minimum": "link", "guy_tension_minimum": "guy"}
#: Packages that results follow from.
PACKAGES = ("cablepod", "numpy", "scipy", "numba", "xarray", "matplotlib", "netCDF4")


# --- warnings -------------------------------------------------------------------------------------------------------------


def warnings_of(results: Mapping[str, xr.Dataset], attributes: Mapping[str, Any]) -> Iterator[str]:
    """Yield what is doubtful in results by name, and in the attributes of the study that they are of."""
    for reason in _list(attributes.get("left_out")):
        yield f"left out: {reason}"
    for name, dataset in results.items():
        attrs = dataset.attrs
        if isinstance(attrs.get("incomplete"), str | bool | int) and attrs["incomplete"]:
            how = attrs["incomplete"] if isinstance(attrs["incomplete"], str) else "interrupted"
            yield f"{name}: incomplete, {how}"
        if "note" in dataset and dataset["note"].dtype.kind in "UO":
            yield from (f"{name}: {note}" for note in note_lines(dataset))
        yield from (f"{name}: {text}" for text in _out_of_range(dataset))
        yield from (f"{name}: {text}" for text in _of_time(dataset))
        coarse = _largest(dataset, "space_error_estimate")
        if coarse is not None and coarse > LIKELY:
            yield (
                f"{name}: too few links or elements for the continuous cable: {ATTRIBUTES['space_error_estimate'][1]}: "
                + f"{100.0 * coarse:.2g} %, above {100.0 * LIKELY:.2g} %"
                + (f"; {remedy_of(dataset.sizes['particle'] - 1, coarse)}" if "particle" in dataset.sizes else "")
            )
        yield from (f"{name}: {text}" for text in _of_members(dataset))
        for variable, what in FORCES.items():
            if variable in dataset and dataset[variable].size and dataset[variable].dtype.kind in "iuf":
                yield from (f"{name}: {text}" for text in _slack(dataset, variable, what))
    count = attributes.get("notes_left_out", 0)
    if count:
        yield f"{count} more notes like those above, of other models and with other numbers"


def _out_of_range(dataset: xr.Dataset) -> list[str]:
    """Return the warnings of a reduced model outside its range of validity; of members those of the worst one."""
    attrs = dict(dataset.attrs)
    of_members = "member" in dataset.dims
    check = (CHECKS_OF_MEMBERS if of_members else CHECKS).get(str(attrs.get("model")))
    if check is None:
        return []
    if of_members:
        attrs = {name: [value] * dataset.sizes["member"] for name, value in attrs.items()}
        attrs |= {str(name): found.values.tolist() for name, found in dataset.items() if found.dims == ("member",)}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check(attrs)
        except (KeyError, TypeError):  # attributes that were taken away
            return ["its range of validity is not known, as attributes of the run are missing"]
    return [str(item.message) for item in caught]


def _of_time(dataset: xr.Dataset) -> Iterator[str]:
    """Yield a line for a run that has not converged in time."""
    accepted = float(dataset.attrs.get("accepted_time_error", LARGEST_TIME_ERROR))
    for name in ("time_error_estimate", "tension_time_error_estimate"):
        value = dataset.attrs.get(name)
        if isinstance(value, int | float | np.number) and value > accepted:
            yield f"not converged in time: {ATTRIBUTES[name][1]}: {100.0 * value:.2g} %, above {100.0 * accepted:.2g} %"


def _of_members(dataset: xr.Dataset) -> Iterator[str]:
    """Yield lines for members that failed, have not converged, or are outside of the range of their model."""
    if "failure" in dataset and dataset["failure"].dtype.kind in "UO":
        reasons = [str(reason) for reason in dataset["failure"].values.ravel().tolist()]
        failed = [reason for reason in reasons if reason]
        if failed:
            yield f"{len(failed)} of {len(reasons)} members failed: {failed[0]}"
    accepted = float(dataset.attrs.get("accepted_time_error", LARGEST_TIME_ERROR))
    for name, most in (
        ("time_error_estimate", accepted), ("tension_time_error_estimate", accepted), ("error_estimate", MAX_ESTIMATED_ERROR),
    ):  # fmt: skip
        if name in dataset and dataset[name].dims == ("member",) and dataset[name].dtype.kind == "f":
            count = int((dataset[name].values > most).sum())
            if count:
                text = ATTRIBUTES[name][1]
                yield f"{count} of {dataset.sizes['member']} members: {text} above {100.0 * most:.2g} %"


def _slack(dataset: xr.Dataset, variable: str, what: str) -> Iterator[str]:
    """Yield a line for links or guys that are slack at times, and one for guys that break, which have no tension afterwards."""
    slack = dataset[variable] <= 0.0
    if "guy" in slack.dims and "guy_breaks" in dataset.coords:
        breaks = dataset["guy_breaks"]
        slack = slack & ~np.isfinite(breaks)
        if breaks.dims == ("guy",):
            broken = breaks[np.isfinite(breaks)]
            times = zip(broken["guy"].values.tolist(), broken.values.tolist(), strict=True)
            yield "broken: " + ", ".join(f"guy {guy} at {time:g} s" for guy, time in times)
    if not bool(slack.any()):
        return
    if what == "guy" and slack.dims == ("guy",):
        labels = dataset["guy"].values if "guy" in dataset.coords else np.arange(1, slack.size + 1)
        yield f"slack at times: guy {', '.join(map(str, labels[slack.values].tolist()))}"
    else:
        yield f"slack at times: {int(slack.sum())} of {slack.size} values of {variable} are zero or less"


def _list(given: Any) -> list[str]:
    return [given] if isinstance(given, str) else [str(item) for item in given] if given is not None else []


# --- estimates --------------------------------------------------------------------------------------------------------------


def estimates_of(results: Mapping[str, xr.Dataset]) -> Table | None:
    """Return the estimated errors of each run with its scheme and step; None without any."""
    used = [name for name in ESTIMATES if any(_largest(dataset, name) is not None for dataset in results.values())]
    rows = []
    for name, dataset in results.items():
        values = [_largest(dataset, estimate) for estimate in used]
        if any(value is not None for value in values):
            attrs = dataset.attrs
            step = attrs.get("step")
            shown = f"{step:.4g}" if isinstance(step, int | float | np.number) else NOTHING
            texts = [NOTHING if value is None else digits(100.0 * value, 3) for value in values]
            rows.append([name, str(attrs.get("model", NOTHING)), str(attrs.get("scheme", NOTHING)), shown, *texts])
    if not rows:
        return None
    return Table(["result", "model", "scheme", "step [s]", *(ESTIMATES[name] for name in used)], rows, fixed=4)


def meanings(table: Table) -> list[str]:
    """Return what the estimates of a table are."""
    shown = {name: heading for name, heading in ESTIMATES.items() if heading in table.head}
    return [f"{heading.removesuffix(' [%]')}: {ATTRIBUTES[name][1]}" for name, heading in shown.items()]


def _largest(dataset: xr.Dataset, name: str) -> float | None:
    """Return an estimate of a run, or the largest of its members; None without one."""
    value = dataset.attrs.get(name)
    if value is None and name in dataset and dataset[name].dims == ("member",) and dataset[name].dtype.kind == "f":
        values = dataset[name].values
        value = float(np.nanmax(values)) if np.isfinite(values).any() else None
    if not isinstance(value, int | float | np.number) or not math.isfinite(value):
        return None
    return float(value)


# --- provenance -------------------------------------------------------------------------------------------------------------


def versions() -> Table:
    """Return the versions of Python and of the packages that results follow from."""
    rows = [["Python", platform.python_version()]]
    return Table(["program", "version"], [*rows, *([name, metadata.version(name)] for name in PACKAGES)], fixed=2)


def stages_of(results: Mapping[str, xr.Dataset]) -> Table | None:
    """Return the stages of all histories, each once, oldest first, with the result that they end in; None without any."""
    ends = {str(dataset.attrs.get("id", "")): name for name, dataset in results.items()}
    stages: dict[str, dict[str, Any]] = {}
    for dataset in results.values():
        for stage in _page_tables.stages_of(dataset):
            stages.setdefault(stage["id"], stage)
    rows = []
    for identifier, stage in stages.items():
        program = " ".join(str(stage[key]) for key in ("program", "version") if key in stage)
        commit = f" ({str(stage['commit'])[:12]})" if "commit" in stage else ""
        inputs = ", ".join(str(item)[:8] for item in stage.get("inputs", []))
        written = str(stage.get("written", ""))
        rows.append([
            ends.get(identifier, NOTHING), stage["function"], identifier, inputs or NOTHING,
            f"{program}{commit} {written}".strip() or NOTHING,
        ])  # fmt: skip
    return Table(["result", "made by", "id", "from ids", "written by"], rows, fixed=5) if rows else None
