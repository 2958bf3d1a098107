"""What travels with the package: the paper's scenes, and its tables as printed."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import xarray as xr

from cablepod.scene import read_scene


def data_folder() -> Path:
    """Return the folder of shipped scenes and tables: inside an installed package, or beside it in a checkout."""
    here = Path(__file__).resolve().parent
    return here / "data" if (here / "data").is_dir() else here.parent / "data"


def scene_path(name: str) -> Path:
    """Return the scene file `name`, or the shipped one of that name or path, so that an installed package has them too."""
    path = Path(name)
    if path.exists():
        return path
    shipped = data_folder() / "scenes" / (path.name if path.suffix else f"{path.name}.toml")
    return shipped if shipped.exists() and str(path.parent) in (".", "data/scenes") else path


def scene(name: str) -> xr.Dataset:
    """Read the scene file `name`, or the shipped one of that name."""
    return read_scene(scene_path(name))


def table(name: str) -> dict[str, np.ndarray]:
    """Read a table of the paper, digits as printed: column -> numbers, nan where the print has none, or texts."""
    with (data_folder() / f"{name}.csv").open(newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    columns = {key: np.array([row[key] or "nan" for row in rows]) for key in rows[0]}
    for key, column in columns.items():
        try:
            columns[key] = column.astype(float)
        except ValueError:  # texts stay texts
            continue
    return columns
