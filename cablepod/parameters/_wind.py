"""Rules of the tables [wind] and [wind.turbulence]: keys that go together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import plain
from cablepod.parameters._keys import TURBULENCE, WIND, WIND_RECORD, describe
from cablepod.parameters._scene_values import of_keys, whole

#: Path of the table of the gusts.
GUSTS = "wind.turbulence"
#: Roughness length of the ground that is too large [m].
LARGEST_ROUGHNESS = 10.0


def wind_of(tables: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the values of the table [wind]; None for still air.

    Raises
    ------
    SceneError
        For missing keys, a direction that is not horizontal, and keys that do not belong to the profile.
    """
    wind = whole("wind", tables.get("wind", {}), WIND)
    if not wind:
        return None
    direction, profile = wind["direction"], str(wind["profile"])
    if direction[1] != 0.0 or not any(direction):
        allowed = "a horizontal direction, with 0 for y and not 0 for all others"
        raise scene_error("wind.direction", plain(direction), allowed)
    if profile == "power" and "exponent" not in wind:
        raise SceneError('wind.exponent: missing; allowed: the exponent of profile "power", such as 0.16')
    if profile != "power" and "exponent" in wind:
        raise scene_error("wind.exponent", wind["exponent"], f'none with profile "{profile}"; try: profile "power"')
    if profile == "logarithmic" and wind["reference_height"] <= wind["roughness_length"]:
        raise scene_error("wind.reference_height", wind["reference_height"], "a height above wind.roughness_length")
    if wind["roughness_length"] >= LARGEST_ROUGHNESS:
        allowed = f"a length below {LARGEST_ROUGHNESS:g} m, such as 0.03"
        raise scene_error("wind.roughness_length", wind["roughness_length"], allowed)
    return wind


def turbulence_of(tables: Mapping[str, Any], wind: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the values of the table [wind.turbulence] of a `wind`; None for steady wind.

    Raises
    ------
    SceneError
        For gusts in still air, missing keys, and for keys that do not belong to the spectrum or to the record.
    """
    table = of_keys(tables.get("wind", {}).get("turbulence", {}), TURBULENCE)
    if not table:
        return None
    if wind is None:
        raise SceneError(f"wind.speed: missing; allowed: {describe(WIND['speed'])}")
    check_record(table)
    if "record" in table and "record_sha256" not in table:
        raise SceneError(f"{GUSTS}.record_sha256: missing; allowed: that of the record, as make_scene gives it")
    if "record" in table:
        return table
    table = whole(GUSTS, table, TURBULENCE)
    if np.shape(table["decay"]) != (2,):
        raise scene_error(f"{GUSTS}.decay", plain(table["decay"]), "two numbers, vertical and across the wind")
    spectrum = str(table["spectrum"])
    for name in ("intensity", "length_scale"):
        key = f"{GUSTS}.{name}"
        if spectrum == "von_karman" and name not in table:
            raise SceneError(f'{key}: missing; allowed: a number above 0, which spectrum "von_karman" needs')
        if spectrum != "von_karman" and name in table:
            allowed = f'none with spectrum "{spectrum}", whose size follows from wind.roughness_length'
            raise scene_error(key, table[name], allowed)
    return table


def check_record(table: Mapping[str, Any]) -> None:
    """Refuse keys of [wind.turbulence] beside a record, and the hash of one without it.

    Raises
    ------
    SceneError
        The message names the key.
    """
    if "record" not in table and "record_sha256" in table:
        raise scene_error(f"{GUSTS}.record_sha256", table["record_sha256"], "none without wind.turbulence.record")
    for name in table if "record" in table else ():
        if name not in WIND_RECORD:
            allowed = "none with wind.turbulence.record, which holds mean wind and gusts"
            raise scene_error(f"{GUSTS}.{name}", plain(table[name]), allowed)
