"""Write the map of an ensemble: largest values of all members as a table, and tensions as a picture over two parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._figure import write_figure
from cablepod.archive._folder import new_results
from cablepod.archive._manifest import MAPS, read_manifest, time_errors
from cablepod.archive._table import write_table
from cablepod.batch._stack import is_varied
from cablepod.errors import SceneError
from cablepod.fatigue._cycles import EXPONENT, FREQUENCY
from cablepod.integrate._peak_error import MAX_PEAK_ERROR, along_members, peak_errors, slack_members
from cablepod.reduced._validity import MAX_ESTIMATED_ERROR

TABLE, PICTURE = MAPS
#: Variable that a map needs, output that gives it, and variable of the picture.
OF_CABLE = ("tension_maximum", "tension_extremes", "tension_maximum")
OF_MAST = ("displacement_maximum", "extremes", "guy_tension_maximum")
#: Variables of the results that are read.
READ = (
    "tension_maximum", "tension_minimum", "time_error_estimate", "tension_time_error_estimate", "smallest_chordwise_force",
    "error_estimate", "failure", "guy_tension_maximum", "guy_tension_minimum", "fatigue_range", "utilisation",
    "displacement_minimum", "displacement_maximum", "bending_moment_minimum", "bending_moment_maximum", "smallest_tension",
)  # fmt: skip
#: Heading of equivalent ranges.
FATIGUE = f"fatigue range (exponent {EXPONENT:g} at {FREQUENCY:g} Hz) [N]"
#: Heading, variable and extreme over all guys; then heading and variable of each guy.
OVER_GUYS: tuple[tuple[str, str, Any], ...] = (
    ("largest tension [N]", "guy_tension_maximum", np.fmax.reduce),
    ("smallest tension [N]", "guy_tension_minimum", np.fmin.reduce),
    (f"largest {FATIGUE}", "fatigue_range", np.fmax.reduce),
    ("largest utilisation [1]", "utilisation", np.fmax.reduce),
)
OF_EACH_GUY = (
    ("largest tension [N]", "guy_tension_maximum"),
    (FATIGUE, "fatigue_range"),
    ("utilisation [1]", "utilisation"),
)
#: Heading and variable of the mast, the larger one of both signs and coordinates.
OF_THE_MAST = (
    ("largest displacement along x or z [m]", "displacement"),
    ("largest bending moment along x or z [N m]", "bending_moment"),
)


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
    with new_results(folder, MAPS) as new:
        return _write(new, folder, results, manifest, hertz=hertz)


def _write(new: Path, folder: Path, results: xr.Dataset, manifest: Mapping[str, Any], *, hertz: bool) -> str:
    """Write the files into a folder `new`, from which they come into `folder`."""
    needed, output, drawn = OF_MAST if manifest["model"] == "mast" else OF_CABLE
    if needed not in results:
        return f'map       none, as "{output}" is not among the outputs'
    parameters = list(manifest["varied"])
    parameters = [name for name in parameters if name in results.coords and is_varied(results[name].variable)]
    results = results[[*(name for name in READ if name in results), *parameters]].load()
    _write_table(new / TABLE, results, parameters)
    numbers = [name for name in parameters if _is_number(results[name])]
    if len(numbers) != 2:
        others = len(parameters) - len(numbers)
        words = f" beside {others} of words or lists" if others else ""
        return f"map       {folder / TABLE}; a picture needs two varied parameters, here {len(numbers)}{words}"
    if drawn not in results:
        return f"map       {folder / TABLE}; no picture of tensions: the mast has no guys"
    try:
        _draw(new / PICTURE, results, drawn, *numbers, hertz=hertz)
    except SceneError as error:  # members that share both parameters
        return f"map       {folder / TABLE}; no picture: {error}"
    return f"map       {folder / PICTURE}, {folder / TABLE}"


def _is_number(parameter: xr.DataArray) -> bool:
    """Tell whether a varied parameter is a number, not a text or a list."""
    return parameter.dims == ("member",) and parameter.dtype.kind in "if"


def _write_table(path: Path, results: xr.Dataset, parameters: list[str]) -> None:
    """Write a row for each member: parameters, largest and smallest tension, estimated errors, and what is doubtful."""
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
        columns |= _columns_of_masts(results)
    for name in ("error_estimate", "time_error_estimate", "tension_time_error_estimate"):
        if name in results:
            columns[f"{name} [1]"] = results[name].values
    of_peak = peak_errors(results)
    if np.isfinite(of_peak).any():
        columns["time error of the largest tension [1]"] = of_peak
    columns = {"member": results["member"].values.tolist(), **columns, "note": _notes(results)}
    write_table(path, [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)])


def _columns_of_masts(results: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the columns by heading: extremes over all guys, of the mast, and of each guy."""
    found = {}
    for heading, name, extreme in OVER_GUYS:
        if name in results:
            found[heading] = extreme(results[name].transpose("member", "guy").values, axis=1)
    for heading, name in OF_THE_MAST:
        if f"{name}_maximum" in results:
            least, most = (results[f"{name}_{what}"] for what in ("minimum", "maximum"))
            sizes = np.maximum(abs(least.values), abs(most.values))  # (member, place, coordinate)
            found[heading] = sizes.reshape(sizes.shape[0], -1).max(axis=1)
    for g in range(results.sizes.get("guy", 0)):
        for heading, name in OF_EACH_GUY:
            if name in results:
                found[f"guy {int(results['guy'][g])} {heading}"] = results[name].isel(guy=g).values
    return found


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
