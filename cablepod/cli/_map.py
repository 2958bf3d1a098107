"""Write the map of an ensemble: largest tensions of all members as a table, and as a picture over two parameters."""

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
from cablepod.errors import SceneError
from cablepod.integrate._peak_error import MAX_PEAK_ERROR, peak_errors
from cablepod.reduced._validity import MAX_ESTIMATED_ERROR

TABLE, PICTURE = "map.csv", "map.png"
#: Variables of the results that are read.
READ = (
    "tension_maximum", "tension_minimum", "time_error_estimate", "tension_time_error_estimate", "smallest_chordwise_force",
    "error_estimate", "failure",
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
    if "tension_maximum" not in results:
        return 'map       none, as "tension_extremes" is not among the outputs'
    parameters = list(read_manifest(folder)["varied"])
    parameters = [name for name in parameters if name in results.coords and is_varied(results[name].variable)]
    results = results[[*(name for name in READ if name in results), *parameters]].load()
    _write_table(folder / TABLE, results, parameters)
    numbers = [name for name in parameters if _is_number(results[name])]
    if len(numbers) != 2:
        others = len(parameters) - len(numbers)
        words = f" beside {others} of words or lists" if others else ""
        return f"map       {folder / TABLE}; a picture needs two varied parameters, here {len(numbers)}{words}"
    try:
        _draw(folder / PICTURE, results, *numbers, hertz=hertz)
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
    columns["largest tension [N]"] = results["tension_maximum"].max("link").values
    columns["smallest tension [N]"] = results["tension_minimum"].min("link").values
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
    slack = (results["tension_minimum"].min("link") <= 0.0).values
    if "smallest_chordwise_force" in results:
        slack |= results["smallest_chordwise_force"].values < 0.0
    estimate = results["error_estimate"] if "error_estimate" in results else results["member"] * np.nan
    wrong = (estimate > MAX_ESTIMATED_ERROR).values
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


def _draw(path: Path, results: xr.Dataset, x: str, y: str, *, hertz: bool) -> None:
    """Draw the largest tension over two parameters, a frequency across."""
    from cablepod import plots  # slow to import

    if "frequency" in y:
        x, y = y, x
    figure: Any = plots.parameter_map(results, "tension_maximum", x=x, y=y, hertz=hertz).figure
    write_figure(figure, path)
