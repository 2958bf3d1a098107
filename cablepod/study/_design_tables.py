"""Tables of a design: guys, heights, and cases of direction and speed; in SI units for files, in units for people to print."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._table import write_table
from cablepod.study._design_numbers import STATISTICS

#: Files of the tables.
TABLES = ("guys.csv", "heights.csv", "levels.csv", "foot.csv", "cases.csv")
#: Numbers of a row, by heading.
Row = dict[str, Any]


def guy_rows(result: xr.Dataset) -> list[Row]:
    """Return a row for each guy of a mast, or end of one guy, in its governing direction and speed [SI, degrees]."""
    line = "guy" if "guy" in result.dims else "end"
    base = "guy_tension" if line == "guy" else "tension"
    if f"{base}_peak" not in result:
        return []
    rows = []
    for place, label in enumerate(result[line].values.tolist()):
        own = result.isel({line: place})
        case = own.sel(direction=own["governing_direction"], speed=own["governing_speed"])
        row: Row = {line: label}
        if line == "guy":
            anchor = own["anchor"].values
            row |= {
                "level [m]": float(own["guy_level"]), "towards [deg]": degrees(math.atan2(anchor[2], anchor[0])),
                **{f"anchor {axis} [m]": float(value) for axis, value in zip("xyz", anchor, strict=True)},
            }  # fmt: skip
        row |= {"wind [deg]": degrees(float(case["direction"])), "speed [m/s]": float(case["speed"])}
        row |= _statistics(case, base, "peak", "N")
        if "utilisation" in case:
            row["utilisation [1]"] = float(case["utilisation"])
        for name, heading in (
            ("anchor_force_peak", "force on the anchor [N]"), ("anchor_force_horizontal_peak", "horizontal [N]"),
            ("anchor_uplift_peak", "uplift [N]"),
        ):  # fmt: skip
            if name in result:
                row[heading] = float(own[name].max())  # each in its own governing case
        if "slack_storms" in own:
            row["slack storms"] = int(own["slack_storms"].sum())
        if "guy_breaks" in own:
            time = float(own["guy_breaks"])
            row["breaks [s]"] = time if math.isfinite(time) else math.nan
        for name, heading in (("damage_per_year", "damage in a year [1]"), ("fatigue_life", "life [years]")):
            if name in own:
                row[heading] = float(own[name])
        rows.append(row)
    return rows


def height_rows(result: xr.Dataset) -> list[Row]:
    """Return a row for each element of the mast with envelopes over all directions and speeds [SI]; none of one guy.

    Moments are those of the end, and peaks with their intervals those of the case, in which they are largest.  The least axial
    force is that of all storms.
    """
    if "element" not in result.dims:
        return []
    least = result["axial_compression_minimum"].min(("direction", "speed", "storm")).values
    moments = {name: values for name, values in result.data_vars.items() if "node" in values.dims}
    rows = []
    for e in range(result.sizes["element"]):
        row: Row = {"from [m]": float(result["element_bottom"][e]), "to [m]": float(result["element_top"][e])}
        at_ends = xr.Dataset(moments).isel(node=[e, e + 1])
        end = int(at_ends["bending_moment_peak"].max(("direction", "speed")).fillna(-np.inf).values.argmax())
        own = result.drop_dims("node").isel(element=e)
        for of, base, heading, unit in (
            (at_ends.isel(node=end), "bending_moment", "bending moment", "N m"), (own, "shear_force", "shear", "N"),
            (own, "axial_compression", "axial force", "N"),
        ):  # fmt: skip
            row |= _statistics(_governing(of, of[f"{base}_peak"]), base, heading, unit)
        rows.append(row | {"least axial force [N]": float(least[e])})
    return rows


def level_rows(result: xr.Dataset) -> list[Row]:
    """Return a row for each level of guys and the top, with the largest displacement of all directions and speeds [SI]."""
    if "displacement_peak" not in result:
        return []
    rows = []
    for place, level in enumerate(result["level"].values.tolist()):
        case = _governing(result, result["displacement_peak"].isel(level=place)).isel(level=place)
        rows.append({"level [m]": level, **_wind(case), **_statistics(case, "displacement", "displacement", "m")})
    return rows


def foot_rows(result: xr.Dataset) -> list[Row]:
    """Return a row for each reaction of the foot, in its governing direction and speed [SI]."""
    rows = []
    for base, text in (("foot_force_vertical", "downwards"), ("foot_force_horizontal", "horizontal")):
        if f"{base}_peak" in result:
            case = _governing(result, result[f"{base}_peak"])
            rows.append({"force on the foundation": text, **_wind(case), **_statistics(case, base, "force", "N")})
    if "bending_moment_peak" in result:
        at_foot = result["bending_moment_peak"].isel(node=0)
        case = _governing(result, at_foot)
        largest = float(result["bending_moment_peak"].max())
        if float(case["bending_moment_peak"].isel(node=0)) > 1e-6 * largest:  # clamped
            numbers = _statistics(case.isel(node=0), "bending_moment", "force", "N")
            rows.append({"force on the foundation": "moment [N m]", **_wind(case), **numbers})
    return rows


def case_rows(result: xr.Dataset) -> list[Row]:
    """Return a row for each direction and speed: the guy of the largest peak, buckling, slack and failed storms [SI]."""
    line = "guy" if "guy" in result.dims else "end"
    base = "guy_tension" if line == "guy" else "tension"
    rows = []
    for d in range(result.sizes["direction"]):
        for s in range(result.sizes["speed"]):
            case = result.isel(direction=d, speed=s)
            row: Row = _wind(case)
            if f"{base}_peak" in case and np.isfinite(case[f"{base}_peak"].values).any():
                place = int(np.nanargmax(case[f"{base}_peak"].values))
                row |= {line: case[line].values.tolist()[place]}
                row |= _statistics(case.isel({line: place}), base, "peak", "N")
            for name, heading in (
                ("displacement_peak", "displacement [m]"), ("bending_moment_peak", "bending moment [N m]"),
                ("buckling_factor", "buckling factor"), ("buckling_factor_after_break", "buckling factor after break"),
            ):  # fmt: skip
                if name in case:
                    row[heading] = float(case[name].max())
            if "slack_storms" in case:
                row |= {"slack": slack_lines(case)}
            row["failed storms"] = int((case["failure"] != "").sum())
            rows.append(row)
    return rows


def slack_lines(case: xr.Dataset) -> str:
    """Return the lines that are slack in some storms of a case, with the numbers of these storms."""
    counts = np.atleast_1d(case["slack_storms"].values)
    names = case["guy"].values.tolist() if "guy" in case.dims else ["the guy"]
    return ", ".join(f"{name} ({count})" for name, count in zip(names, counts.tolist(), strict=True) if count)


def write_tables(folder: Path, result: xr.Dataset) -> None:
    """Write the tables that a result has, in SI units, into a folder without any of them."""
    rows = (guy_rows(result), height_rows(result), level_rows(result), foot_rows(result), case_rows(result))
    for name, of_table in zip(TABLES, rows, strict=True):
        if of_table:
            write_table(folder / name, of_table)


def degrees(angle: float) -> float:
    """Return an angle [rad] in degrees from 0 to 360."""
    return round(math.degrees(angle), 6) % 360.0


def _statistics(case: xr.Dataset, base: str, heading: str, unit: str) -> Row:
    """Return peak, its interval and the quantile with its interval, where the result has them."""
    row: Row = {}
    for ending, _ in STATISTICS.values():
        if f"{base}{ending}" in case:
            row[f"{heading}{ending.removeprefix('_peak').replace('_', ' ')} [{unit}]"] = float(case[f"{base}{ending}"])
    return row


def _wind(case: xr.Dataset) -> Row:
    return {"wind [deg]": degrees(float(case["direction"])), "speed [m/s]": float(case["speed"])}


def _governing(result: xr.Dataset, peaks: xr.DataArray) -> xr.Dataset:
    """Return the case of the largest of peaks (direction, speed)."""
    return result.isel(peaks.reset_coords(drop=True).fillna(-np.inf).argmax(("direction", "speed")))
