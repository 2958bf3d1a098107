"""Figures of the main job, in the order of their worth to an engineer."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.archive._figure import write_figure
from cablepod.errors import scene_error

#: Names of the figures of a cable, in the order in which they are written, and of a mast.
FIGURES = ("tension", "tension_map", "deflection", "error_over_time", "modes", "singular_values", "shapes")
MAST_FIGURES = ("tensions", "moments", "modes")
#: Fractions of the duration at which shapes are drawn (without a common period, so that a periodic motion shows its phases).
DRAWN_AT = (0.0, 0.12, 0.37, 0.58, 0.83)
#: Displacements over the chord below which they are magnified in the figure of the shapes.
SMALL = 0.01


def check_backend() -> None:
    """Refuse a name of a backend, in the environment, with which matplotlib cannot be imported."""
    try:
        import matplotlib  # noqa: F401
    except ValueError as error:
        allowed = (
            'a backend of matplotlib, such as "Agg", or none; try: another one and a new process, as matplotlib cannot be '
            "imported in this one any more"
        )
        raise scene_error("MPLBACKEND", os.environ.get("MPLBACKEND"), allowed) from error


def write_figures(
    folder: Path,
    reference: xr.Dataset,
    modes: xr.Dataset,
    best: xr.Dataset | None,
    errors: dict[str, xr.Dataset],
    *,
    ends: xr.Dataset | None = None,
    title: str = "",
) -> None:
    """Write the figures without pyplot, which would change the caller's open figures and backend.

    Parameters
    ----------
    folder
        Where to.
    reference, modes
        Run of the chain, and the modes of its snapshots.
    best
        Reduced run of the smallest error, drawn beside the chain; None without a reduced model.
    errors
        Comparison with the chain by the label of the model.
    ends
        Tension at both ends at instants that are closer than those of the chain, if there is one.
    title
        Title of every figure.
    """
    from cablepod import plots

    picked = np.rint(np.array(DRAWN_AT) * (reference.sizes["time"] - 1)).astype(int)
    times = [float(t) for t in reference["time"].values[np.unique(picked)]]
    drawings: dict[str, Callable[..., Any]] = {
        "tension": partial(plots.end_tensions, reference if ends is None else ends),
        "tension_map": partial(plots.tension, reference),
        "deflection": partial(plots.shapes, reference, best, times=times, deflection=True),
        "error_over_time": partial(plots.error_over_time, errors),
        "modes": partial(plots.modes, modes),
        "singular_values": partial(plots.singular_values, modes),
        "shapes": partial(plots.shapes, reference, best, times=times),
    }
    if best is not None and _is_small(reference):  # all shapes would lie on one line
        drawings["shapes"] = partial(plots.snapshots, reference, best, times=times)
    if not errors:
        del drawings["error_over_time"]
    if reference.sizes["link"] < 2:  # a map needs two
        del drawings["tension_map"]
    write_drawings(folder, drawings, title)


def write_drawings(folder: Path, drawings: Mapping[str, Callable[..., Any]], title: str) -> None:
    """Write a figure of each function of :mod:`cablepod.plots`, under its name."""
    from cablepod.plots._style import private_axes

    for name, draw in drawings.items():
        write_figure(draw(ax=private_axes()).figure, folder / f"{name}.png", title=title)


def _is_small(reference: xr.Dataset) -> bool:
    """Tell whether all displacements stay below SMALL times the chord."""
    position = reference["position"].values
    chord = float(np.linalg.norm(position[0, -1] - position[0, 0]))
    return float(np.linalg.norm(position - position[0], axis=-1).max()) < SMALL * chord
