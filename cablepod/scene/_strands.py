"""Strands of the shipped table, or of a table of one's own, which give the keys of a cable."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from cablepod._resources import data_folder
from cablepod.errors import SceneError, did_you_mean, named, scene_error, shown
from cablepod.parameters._keys import CABLE, STIFFNESS_KEYS, WEIGHT_KEYS
from cablepod.scene._files import LARGEST_SCENE, read_text

#: Column of a table of strands -> key of a cable.
COLUMNS = {
    "diameter_m": "diameter",
    "area_m2": "area",
    "mass_kg_per_m": "mass_per_length",
    "axial_stiffness_N": "axial_stiffness",
    "youngs_modulus_Pa": "youngs_modulus",
    "breaking_strength_N": "breaking_strength",
    "thermal_expansion_per_K": "thermal_expansion",
}
#: Other columns of a table: the name of the strand, which each row must have, and a text for the reader.
NAME, SOURCE = "name", "source"


@lru_cache(1)
def strands() -> dict[str, dict[str, float]]:
    """Return the keys of a cable that each strand of the shipped table gives, by its name."""
    rows = read_strands("cable.strand", data_folder() / "strands.csv")
    return {
        name: {
            "youngs_modulus": row["youngs_modulus"],
            "area": row["area"],
            "density": row["mass_per_length"] / row["area"],
            "diameter": row["diameter"],
            "breaking_strength": row["breaking_strength"],
        }
        for name, row in rows.items()
    }


def with_strand(cable: Any, folder: Path, prefix: str = "cable") -> Any:
    """Return a table ``[cable]`` with the keys that its strand gives; keys that are given stay.

    Parameters
    ----------
    cable
        Table of the scene; anything without a strand is returned as it is.
    folder
        Folder of the path of a table of strands.
    prefix
        Key path of the table, for messages.

    Raises
    ------
    SceneError
        For a strand that the table lacks, which the message lists, and for a table of one's own that is broken, by file, row and
        column.
    """
    if not isinstance(cable, Mapping) or not {"strand", "strand_table"} & set(cable):
        return cable
    key, own = f"{prefix}.strand", {}
    known = strands()
    if "strand_table" in cable:
        path = (folder / CABLE["strand_table"].check(f"{key}_table", cable["strand_table"])).absolute()
        known, own = read_strands(f"{key}_table", path), {"strand_table": str(path)}
    allowed = "one of " + ", ".join(f'"{strand}"' for strand in known)
    if "strand" not in cable:
        raise SceneError(f"{key}: missing beside {key}_table; allowed: {allowed}")
    name = cable["strand"]
    if not isinstance(name, str) or name not in known:
        raise scene_error(key, name, f"{allowed}{did_you_mean(name, known)}")
    of_strand = dict(known[name])
    for ways in (STIFFNESS_KEYS, WEIGHT_KEYS):
        if any(way in cable for way in ways):
            of_strand = {of: value for of, value in of_strand.items() if of not in ways}
    return {**of_strand, **cable, **own}


def read_strands(key: str, path: Path) -> dict[str, dict[str, float]]:
    """Read a table of strands from a CSV file: the keys of a cable that each gives, by its name.

    Raises
    ------
    SceneError
        The message begins with `key`, and names file, row and column.
    """
    allowed = f"a CSV file with the columns {NAME} and of {', '.join(COLUMNS)}, {SOURCE}"
    content = read_text(path, f"table of strands, {allowed}", LARGEST_SCENE, key=key)
    file = f"{key}: {named(str(path))}"
    lines = [line for line in content.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    try:
        header, *rows = [[cell.strip() for cell in row] for row in csv.reader(lines, strict=True)] or [[]]
    except csv.Error as error:
        raise SceneError(f"{file}: is broken: {error}; allowed: {allowed}") from None
    for column in header:
        if column not in (NAME, SOURCE, *COLUMNS) or header.count(column) > 1:
            times = "twice" if header.count(column) > 1 else "unknown"
            similar = did_you_mean(column, (NAME, *COLUMNS))
            raise SceneError(f"{file}: has the column {shown(column)}, {times}; allowed: {allowed}{similar}")
    if NAME not in header or not rows:
        raise SceneError(f"{file}: has {'no rows' if NAME in header else f'no column {NAME}'}; allowed: {allowed}")
    found: dict[str, dict[str, float]] = {}
    for number, row in enumerate(rows, start=1):
        where = f"{file}, row {number}"
        if len(row) != len(header):
            raise SceneError(f"{where}: given {len(row)} cells; allowed: {len(header)}, as the header has")
        cells = dict(zip(header, row, strict=True))
        if not cells[NAME] or cells[NAME] in found:
            raise scene_error(f"{where}, column {NAME}", cells[NAME], "a name, another one in each row")
        found[cells[NAME]] = dict(_numbers(where, cells))
    return found


def _numbers(where: str, cells: Mapping[str, str]) -> Iterator[tuple[str, float]]:
    """Yield the keys of a cable that a row of a table gives; an empty cell gives none."""
    for column, key in COLUMNS.items():
        if text := cells.get(column):
            name = f"{where}, column {column}"
            try:
                value = float(text)
            except ValueError:
                raise scene_error(name, text, "a number, or an empty cell") from None
            yield key, CABLE[key].check(name, value)
