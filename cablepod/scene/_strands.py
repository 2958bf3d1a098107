"""Strands of the shipped table, which give the keys of a cable."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from cablepod._resources import data_folder
from cablepod.errors import did_you_mean, scene_error
from cablepod.parameters._keys import WEIGHT_KEYS


@lru_cache(1)
def strands() -> dict[str, dict[str, float]]:
    """Return the keys of a cable that each strand of the shipped table gives, by its name."""
    with (data_folder() / "strands.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return {
        row["name"]: {
            "youngs_modulus": float(row["youngs_modulus_Pa"]),
            "area": float(row["area_m2"]),
            "density": float(row["mass_kg_per_m"]) / float(row["area_m2"]),
            "breaking_strength": float(row["breaking_strength_N"]),
        }
        for row in rows
    }


def with_strand(cable: Any, prefix: str = "cable") -> Any:
    """Return a table ``[cable]``, or another one named in errors, with the keys that its strand gives; keys that are given stay.

    Raises
    ------
    SceneError
        For a strand that the table lacks; the message lists all.
    """
    if not isinstance(cable, Mapping) or "strand" not in cable:
        return cable
    name = cable["strand"]
    if not isinstance(name, str) or name not in strands():
        listed = ", ".join(f'"{strand}"' for strand in strands())
        raise scene_error(f"{prefix}.strand", name, f"one of {listed}{did_you_mean(name, strands())}")
    of_strand = dict(strands()[name])
    if any(key in cable for key in WEIGHT_KEYS):
        del of_strand["density"]
    return {**of_strand, **cable}
