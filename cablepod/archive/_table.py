"""Write tables as CSV files, atomically."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cablepod.archive._atomic import atomic_file


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows, numbers and texts by heading, as a CSV file with all their headings in the order in which they come.

    Numbers have ten digits; a heading that a row lacks is empty in it.
    """
    headings = list(dict.fromkeys(heading for row in rows for heading in row))
    with atomic_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, headings, restval="")
        writer.writeheader()
        for row in rows:
            writer.writerow({key: f"{value:.10g}" if isinstance(value, float) else value for key, value in row.items()})
