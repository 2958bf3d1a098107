"""Checks of the wind that a scene gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._keys import TURBULENCE, WIND, check_table


def check_wind(table: Any, cable: Mapping[str, Any], dims: int) -> dict[str, Any]:
    """Check the table [wind] of a scene with `dims` coordinates; return its values, defaults filled in.

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
        checked["turbulence"] = _check_turbulence(table["turbulence"])
    return checked


def _check_turbulence(table: Any) -> dict[str, Any]:
    """Check the table [wind.turbulence]."""
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
