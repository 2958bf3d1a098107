"""Checks of the wind that a scene gives."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._keys import TURBULENCE, WIND, WIND_RECORD, check_table


def check_wind(table: Any, cable: Mapping[str, Any], dims: int, folder: Path) -> dict[str, Any]:
    """Check the table [wind] of a scene with `dims` coordinates; return its values, defaults filled in.

    The path of a record is relative to `folder`.

    Raises
    ------
    SceneError
        For unknown and missing keys, values that are not allowed, a cable without diameter, a direction that is not horizontal.
    """
    if not isinstance(table, Mapping):
        raise scene_error("wind", table, "a table with the keys " + ", ".join(WIND))
    checked = check_table("wind", {name: value for name, value in table.items() if name != "turbulence"}, WIND)
    if "diameter" not in cable:
        raise SceneError("cable.diameter: missing; allowed: a diameter [m], on which the wind acts")
    direction = checked["direction"]
    if len(direction) != dims:
        raise scene_error(
            "wind.direction",
            direction,
            f"{dims} numbers, as many as ends.lower has; wind across a cable needs a spatial scene",
        )
    if direction[1] != 0.0 or not any(direction):
        raise scene_error("wind.direction", direction, "a horizontal direction, with 0 for y and not 0 for all others")
    if checked["profile"] == "power" and "exponent" not in checked:
        raise SceneError('wind.exponent: missing; allowed: the exponent of profile "power", such as 0.16')
    if checked["profile"] != "power" and "exponent" in checked:
        raise scene_error(
            "wind.exponent", checked["exponent"], f'none with profile "{checked["profile"]}"; try: profile "power"'
        )
    if checked["profile"] == "logarithmic" and checked["reference_height"] <= checked["roughness_length"]:
        raise scene_error("wind.reference_height", checked["reference_height"], "a height above wind.roughness_length")
    if checked["roughness_length"] >= 10.0:
        raise scene_error("wind.roughness_length", checked["roughness_length"], "a length below 10 m, such as 0.03")
    if "turbulence" in table:
        checked["turbulence"] = _check_turbulence(table["turbulence"], folder)
    return checked


def _check_turbulence(table: Any, folder: Path) -> dict[str, Any]:
    """Check the table [wind.turbulence], and read its record."""
    if isinstance(table, Mapping) and "record" in table:
        return _check_record(table, folder)
    if isinstance(table, Mapping) and "record_sha256" in table:
        raise scene_error(
            "wind.turbulence.record_sha256", table["record_sha256"], "none without wind.turbulence.record"
        )
    checked = {"decay": [10.0, 16.0], **check_table("wind.turbulence", table, TURBULENCE)}
    if len(checked["decay"]) != 2:
        raise scene_error("wind.turbulence.decay", checked["decay"], "two numbers, vertical and across the wind")
    needs = checked["spectrum"] == "von_karman"
    for name in ("intensity", "length_scale"):
        key = f"wind.turbulence.{name}"
        if needs and name not in checked:
            raise SceneError(f'{key}: missing; allowed: a number above 0, which spectrum "von_karman" needs')
        if not needs and name in checked:
            allowed = f'none with spectrum "{checked["spectrum"]}", whose size follows from wind.roughness_length'
            raise scene_error(key, checked[name], allowed)
    return checked


def _check_record(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check the table [wind.turbulence] with a record; return its path and content hash."""
    from cablepod.scene._wind_field import read_wind_record  # needed by records only

    for name in table:
        if name in TURBULENCE and name not in WIND_RECORD:
            allowed = "none with wind.turbulence.record, which holds mean wind and gusts"
            raise scene_error(f"wind.turbulence.{name}", table[name], allowed)
    checked = check_table("wind.turbulence", table, WIND_RECORD)
    return dict(read_wind_record(folder / checked["record"], checked.get("record_sha256")))
