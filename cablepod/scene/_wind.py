"""Check the tables [wind] and [wind.turbulence] that a scene gives, key by key, and read the record."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cablepod.errors import scene_error
from cablepod.parameters._check_tables import check_names, check_table, filled
from cablepod.parameters._keys import TURBULENCE, WIND
from cablepod.parameters._wind import check_record


def check_wind(table: Any, folder: Path) -> dict[str, Any]:
    """Check the table [wind] of a scene; return its values, defaults filled in; a record is relative to `folder`.

    Which keys go together is checked with the parameters of the scene, see :mod:`cablepod.parameters._wind`.

    Raises
    ------
    SceneError
        For unknown and missing keys, values that are not allowed, and a record that is no field of wind.
    """
    if not isinstance(table, Mapping):
        raise scene_error("wind", table, "a table with the keys " + ", ".join(WIND))
    checked = check_table("wind", {name: value for name, value in table.items() if name != "turbulence"}, WIND)
    if "turbulence" in table:
        checked["turbulence"] = _check_turbulence(table["turbulence"], folder)
    return checked


def _check_turbulence(table: Any, folder: Path) -> dict[str, Any]:
    """Check the table [wind.turbulence], and read its record, with which there are no defaults."""
    checked = check_names("wind.turbulence", table, TURBULENCE)
    check_record(checked)  # before it is read
    if "record" not in checked:
        return filled("wind.turbulence", checked, TURBULENCE)
    from cablepod.scene._wind_field import read_wind_record  # needed by records only

    return checked | read_wind_record(folder / checked["record"], checked.get("record_sha256"))
