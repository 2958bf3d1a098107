"""Modes that a reduced model needs, from a run of the chain or without one."""

from __future__ import annotations

from collections.abc import Callable

import xarray as xr

from cablepod import chain, pod
from cablepod.condensed import vibration_modes
from cablepod.errors import one_of, scene_error
from cablepod.parameters._checks import integer

#: Layouts of modes that :func:`make_modes` makes.
LAYOUTS = ("normal", "separate", "vector", "vibration")
#: Number of modes by default.
RANK = 8
#: Tolerance of the chain whose snapshots are decomposed; modes below it would be noise.
TOLERANCE = 1e-6


def make_modes(
    scene: xr.Dataset, *, layout: str = "normal", rank: int = RANK, progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Make modes of a scene.

    Parameters
    ----------
    scene
        A scene with ``[time]``; with layout "vibration" it needs none.
    layout
        "normal" for the condensed model, "separate" or "vector" for the Galerkin model, all from snapshots of the chain, or
        "vibration": modes of vibration about rest, for the condensed model, without snapshots.
    rank
        Number of modes, fewer where the chain has fewer links or snapshots.
    progress
        Callback of the chain, receiving the completed fraction, 0 to 1.
    """
    if layout not in LAYOUTS:
        raise scene_error("layout", layout, one_of(LAYOUTS, layout))
    integer(least=1)("rank", rank)
    if layout == "vibration":
        return vibration_modes(scene, rank=rank)
    run = chain.simulate(scene, tolerance=TOLERANCE, outputs=("position",), progress=progress)
    most = min(run.sizes["particle"] - 2, run.sizes["time"] - 1)
    return pod.decompose(run, rank=min(rank, most), layout=layout)
