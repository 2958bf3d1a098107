"""Read files of scenes and the CSV files of records."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

import numpy as np

from cablepod._inputs import powers
from cablepod.errors import SceneError, named, shown
from cablepod.parameters._checks import LARGEST
from cablepod.parameters._time_functions import check_instants

#: Maximum size of a record [bytes].
LARGEST_FILE = 64 * 2**20
#: Column of a record: its name, and its units if they are stated.
COLUMN = re.compile(r"(.*?)\s*(?:[\[(](.*)[\])])?")
#: Maximum size of a scene file [bytes]: a hundred thousand numbers, which are parsed in two seconds.
LARGEST_SCENE = 4 * 2**20


def read_text(path: Path, what: str, largest: int = LARGEST_FILE, *, key: str = "") -> str:
    """Read a text file of at most `largest` bytes; `what` names its kind, `key` its key in the message of a SceneError."""
    try:
        return read_bytes(path, what, largest, key=key).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SceneError(f"{_name(path, key)}: binary or not UTF-8; allowed: a {what} in text form") from None


def _name(path: Path, key: str) -> str:
    return f"{key}: {named(str(path))}" if key else named(str(path))


def read_bytes(path: Path, what: str, largest: int, *, key: str = "") -> bytes:
    """Read a regular file of at most `largest` bytes; `what` names its kind, `key` its key in the message of a SceneError."""
    name = _name(path, key)
    try:
        if path.is_dir():
            raise SceneError(f"{name}: is a folder; allowed: a {what}")
        if path.exists() and not path.is_file():
            raise SceneError(f"{name}: is a pipe or a device; allowed: a {what}")
        with path.open("rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):  # replaced meanwhile
                raise SceneError(f"{name}: is a pipe or a device; allowed: a {what}")
            size = os.fstat(file.fileno()).st_size
            content = file.read(largest + 1) if size <= largest else b""
        if max(size, len(content)) > largest:
            raise SceneError(f"{name}: larger than {largest // 2**20} MiB; allowed: a {what}")
        return content
    except SceneError:
        raise
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise SceneError(f"{name}: cannot be read: {reason}; allowed: a {what}") from None


def read_record(key: str, path: Path) -> dict[str, list[float]]:
    """Read a record from a CSV file with a column `time` [s] and one value column."""
    content = read_text(path, "record, a CSV file with the columns time and one value", key=key)
    name = named(str(path))
    rows = [line.split(",") for line in content.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    allowed = "a CSV file with a header (time and one value column) and at least 4 rows of numbers"
    if not rows:
        raise SceneError(f"{key}: {name} is empty; allowed: {allowed}")
    columns = [COLUMN.fullmatch(cell.strip()) for cell in rows[0]]
    header, units = [column[1] for column in columns if column], [column[2] for column in columns if column]
    if len(header) != 2 or header.count("time") != 1:
        raise SceneError(
            f"{key}: {name} has the columns {shown(', '.join(map(str.strip, rows[0])))}; allowed: {allowed}"
        )
    place = header.index("time")
    for what, stated, own in (
        ("times", units[place], "s"), ("values", units[1 - place], "m" if "motion." in key else "1"),
    ):  # fmt: skip
        if stated and powers(stated) != powers(own):
            raise SceneError(f"{key}: {name} has {what} in {shown(stated)}; allowed: {own}, or a column without units")
    table = []
    for number, row in enumerate(rows[1:], start=1):
        try:
            values = [float(cell) for cell in row]
        except ValueError:
            values = []
        if len(values) != 2 or not all(abs(value) <= LARGEST for value in values):
            given = shown(",".join(row))
            raise SceneError(f"{key}: {name} has a gap: row {number} holds {given}; allowed: two finite numbers")
        table.append(values)
    column = np.array(table).reshape(-1, 2)
    time, value = column[:, place], column[:, 1 - place]
    check_instants(key, name, time)
    return {"time": time.tolist(), "value": value.tolist()}
