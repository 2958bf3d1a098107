"""Write the map of an ensemble: largest values of all members as a table, and tensions as a picture over two parameters."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._atomic import atomic_file
from cablepod.archive._figure import write_figure
from cablepod.archive._manifest import read_manifest, time_errors
from cablepod.batch._stack import is_varied
from cablepod.cli import _mast_map
from cablepod.errors import SceneError
from cablepod.integrate._peak_error import MAX_PEAK_ERROR, along_members, peak_errors, slack_members
from cablepod.reduced._validity import MAX_ESTIMATED_ERROR

TABLE, PICTURE = "map.csv", "map.png"
#: Variable that a map needs, output that gives it, and variable of the picture.
OF_CABLE = ("tension_maximum", "tension_extremes", "tension_maximum")
OF_MAST = ("displacement_maximum", "extremes", "guy_tension_maximum")
#: Variables of the results that are read.
READ = (
    "tension_maximum", "tension_minimum", "time_error_estimate", "tension_time_error_estimate", "smallest_chordwise_force",
    "error_estimate", "failure", *_mast_map.READ,
)  # fmt: skip


def write(folder: Path, results: xr.Dataset, *, hertz: bool = False) -> str:
    """Write ``map.csv`` and, over two varied parameters, ``map.png`` into the folder of an ensemble; return a line that says so.

    Parameters
    ----------
    folder
        Folder of the ensemble.
    results
        What :func:`cablepod.ensemble.run` gives.
    hertz
        Draw angular frequencies in Hz.
    """
    manifest = read_manifest(folder)
    for name in (TABLE, PICTURE):  # of another ensemble
        (folder / name).unlink(missing_ok=True)
    needed, output, drawn = OF_MAST if manifest["model"] == "mast" else OF_CABLE
    if needed not in results:
        return f'map       none, as "{output}" is not among the outputs'
    parameters = list(manifest["varied"])
    parameters = [name for name in parameters if name in results.coords and is_varied(results[name].variable)]
    results = results[[*(name for name in READ if name in results), *parameters]].load()
    _write_table(folder / TABLE, results, parameters)
    numbers = [name for name in parameters if _is_number(results[name])]
    if len(numbers) != 2:
        others = len(parameters) - len(numbers)
        words = f" beside {others} of words or lists" if others else ""
        return f"map       {folder / TABLE}; a picture needs two varied parameters, here {len(numbers)}{words}"
    if drawn not in results:
        return f"map       {folder / TABLE}; no picture of tensions: the mast has no guys"
    try:
        _draw(folder / PICTURE, results, drawn, *numbers, hertz=hertz)
    except SceneError as error:  # members that share both parameters
        return f"map       {folder / TABLE}; no picture: {error}"
    return f"map       {folder / PICTURE}, {folder / TABLE}"


def _is_number(parameter: xr.DataArray) -> bool:
    """Tell whether a varied parameter is a number, not a text or a list."""
    return parameter.dims == ("member",) and parameter.dtype.kind in "if"


def _write_table(path: Path, results: xr.Dataset, parameters: list[str]) -> None:
    """Write a row for each member: parameters, largest and smallest tension, time errors, and what is doubtful."""
    columns: dict[str, Any] = {}
    for name in parameters:
        if not _is_number(results[name]):
            columns[name] = [str(value) for value in results[name].values.tolist()]
            continue
        units = results[name].attrs.get("units", "1")
        columns[f"{name} [{units}]"] = results[name].values
        if units == "rad s-1":
            columns[f"{name.replace('angular_', '')} [Hz]"] = results[name].values / (2.0 * np.pi)
    if "tension_maximum" in results:
        columns["largest tension [N]"] = results["tension_maximum"].max("link").values
        columns["smallest tension [N]"] = results["tension_minimum"].min("link").values
    else:
        columns |= _mast_map.columns(results)
    for name in ("time_error_estimate", "tension_time_error_estimate"):
        if name in results:
            columns[f"{name} [1]"] = results[name].values
    of_peak = peak_errors(results)
    if np.isfinite(of_peak).any():
        columns["time error of the largest tension [1]"] = of_peak
    with atomic_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["member", *columns, "note"])
        rows = zip(results["member"].values.tolist(), *columns.values(), _notes(results), strict=True)
        for number, *values, note in rows:
            writer.writerow([number, *(value if isinstance(value, str) else f"{value:.10g}" for value in values), note])


def _notes(results: xr.Dataset) -> list[str]:
    """Return what is doubtful of each member: failed with its reason, not converged, slack; empty for the others."""
    doubtful = time_errors(results, float(results.attrs.get("accepted_time_error", np.inf))) or {}
    slack, wrong = slack_members(results), along_members(results, "error_estimate") > MAX_ESTIMATED_ERROR
    of_peak, notes = peak_errors(results), []
    for i, (number, reason) in enumerate(zip(results["member"].values, results["failure"].values, strict=True)):
        parts = [f"failed: {reason}"] if reason else []
        if str(number) in doubtful:
            parts.append(
                "not converged" if not of_peak[i] <= MAX_PEAK_ERROR else "not converged, but the largest tension is"
            )
        parts += ["slack at times"] if slack[i] else []
        parts += ["model error above half the motion"] if wrong[i] else []
        notes.append("; ".join(parts))
    return notes


def _draw(path: Path, results: xr.Dataset, drawn: str, x: str, y: str, *, hertz: bool) -> None:
    """Draw the largest tension over two parameters, a frequency across."""
    from cablepod import plots  # slow to import

    if "frequency" in y:
        x, y = y, x
    figure: Any = plots.parameter_map(results, drawn, x=x, y=y, hertz=hertz).figure
    write_figure(figure, path)
