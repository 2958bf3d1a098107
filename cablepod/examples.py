"""Provide the shipped data: scenes, printed tables of the paper, reference solutions."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import xarray as xr

from cablepod._resources import data_folder
from cablepod.errors import did_you_mean, scene_error
from cablepod.scene._read import read_scene

__all__ = ["data_folder", "scene", "scene_path", "scenes", "table", "truth_path", "truths"]


def scenes() -> list[str]:
    """Return the names of the shipped scenes."""
    return sorted(path.stem for path in (data_folder() / "scenes").glob("*.toml"))


def scene_path(name: str) -> Path:
    """Return the path of a shipped scene, such as ``example2``, or of the file `name`.

    A missing path ``data/scenes/...`` stands for the shipped file, so that installed packages and checkouts behave alike.

    Raises
    ------
    SceneError
        If there is no such scene or file; the message lists the shipped scenes.
    """
    path = Path(name)
    if name in scenes():
        return data_folder() / "scenes" / f"{name}.toml"
    if (
        not path.exists()
        and str(path.parent) in (".", "data/scenes")
        and path.stem in scenes()
        and path.suffix == ".toml"
    ):
        return data_folder() / "scenes" / path.name
    if not path.exists():
        raise scene_error("scene", name, _allowed("a scene file, or ", name))
    return path


def _allowed(before: str, name: str) -> str:
    """Return the field "allowed" of the name of a shipped scene, with those that resemble it."""
    return f"{before}one of the shipped scenes: {', '.join(scenes())}{did_you_mean(Path(name).stem, scenes())}"


def scene(name: str) -> xr.Dataset:
    """Read the shipped scene `name`."""
    return read_scene(data_folder() / "scenes" / f"{name}.toml")


def table(name: str) -> dict[str, np.ndarray]:
    """Read the printed table `name` of the paper: column -> numbers (nan for empty cells) or texts."""
    with (data_folder() / f"{name}.csv").open(newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    columns = {key: np.array([row[key] or "nan" for row in rows]) for key in rows[0]}
    for key, column in columns.items():
        try:
            columns[key] = column.astype(float)
        except ValueError:  # a column of texts
            continue
    return columns


def truths() -> list[tuple[str, str]]:
    """Return (scene, law) of each shipped reference solution of the continuous cable."""
    parts = (path.stem.rpartition("_") for path in (data_folder() / "truth").glob("*.nc"))
    return sorted((name, law) for name, _, law in parts)


def truth_path(name: str, law: str = "green") -> Path:
    """Return the file of the reference solution of a shipped scene, for ``archive.read``.

    Parameters
    ----------
    name
        Name of a shipped scene.
    law
        "green" or "linear".

    Returns
    -------
    pathlib.Path
        NetCDF file of the converged continuous cable.

    Raises
    ------
    SceneError
        If there is none; the message lists all.
    """
    if (name, law) not in truths():
        raise scene_error("truth", f"{name}, {law}", "; ".join(", ".join(pair) for pair in truths()))
    return data_folder() / "truth" / f"{name}_{law}.nc"
