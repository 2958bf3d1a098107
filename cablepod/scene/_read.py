"""Read a scene from a TOML file; its keys are checked by ``_check.py`` and ``parameters/_check_tables.py``."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path

import xarray as xr

from cablepod.errors import SceneError, named
from cablepod.scene._files import LARGEST_SCENE, read_text
from cablepod.scene._make import _make

#: Key of 32 parts and more (a key of a scene has at most four; tomllib takes minutes for 20000).
DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){32}""")


def read_scene(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a scene from a TOML file.

    Parameters
    ----------
    path
        Scene file; paths of its records are relative to its folder.

    Returns
    -------
    xarray.Dataset
        The scene, as of :func:`cablepod.scene.make_scene`.

    Raises
    ------
    SceneError
        For a file that cannot be read or is no TOML file, and as :func:`cablepod.scene.make_scene`.

    Examples
    --------
    >>> import cablepod as cp
    >>> scene = cp.read_scene("data/scenes/example2.toml")
    >>> scene.attrs["title"], float(scene.cable_top_tension), scene.cable_top_tension.units
    ('Example 2: slow end motion', 15000.0, 'N')
    """
    path = Path(path)
    content = read_text(path, "scene file", LARGEST_SCENE)
    if not content.strip():
        raise SceneError(f"{named(str(path))}: the scene file is empty; allowed: TOML with at least [cable] and [ends]")
    try:
        if DEEP_KEY.search(content):
            raise RecursionError
        mapping = tomllib.loads(content)
    except RecursionError:
        raise SceneError(
            f"{named(str(path))}: not a scene: its tables or values are nested too deeply; allowed: keys of at most four parts"
        ) from None
    except ValueError as error:  # no TOML, or an integer with more digits than Python parses
        raise SceneError(
            f"{named(str(path))}: not a TOML file: {error}; allowed: TOML, as cablepod new writes"
        ) from None
    try:
        return _make(mapping, path.parent)
    except SceneError as error:
        raise SceneError(f"{named(str(path))}: {error}") from None
