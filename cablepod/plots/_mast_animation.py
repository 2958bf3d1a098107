"""Animate a mast and its guys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer, number
from cablepod.plots import _style
from cablepod.plots._animation import MOST_FRAMES, Animation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOVING = "what mast.simulate gives with outputs displacement, guy_position and guy_tension"
#: Direction of the view: azimuth and elevation [rad].
AZIMUTH, ELEVATION = np.deg2rad(25.0), np.deg2rad(15.0)
#: Largest drawn displacement over the height of the mast, unless `scale` is given.
DRAWN = 0.05
#: Points of the drawn mast.
POINTS = 41


def animate_mast(
    run: xr.Dataset, *, scale: float | None = None, frames: int | None = None, ax: Axes | None = None
) -> Animation:
    """Animate a mast and its guys: displacements enlarged, guys coloured by their tension.

    Parameters
    ----------
    run
        Result of :func:`cablepod.mast.simulate` with the outputs "displacement", "guy_position" and "guy_tension".
    scale
        Factor of the displacements of the mast and of the deflections of the guys from their mean; by default the largest
        displacement is drawn as a twentieth of the height.
    frames
        Maximum number of frames, evenly spread over the instants; 600 by default.
    ax
        Axes to draw on; their figure is redrawn for each frame.

    Returns
    -------
    Animation
        Shown as a GIF by a notebook; ``animate_mast(...).save("mast.gif")`` or ``"mast.mp4"`` writes it, with its option
        ``progress``, as frames take long.

    Raises
    ------
    SceneError
        For another Dataset, and numbers that are not allowed.

    Notes
    -----
    A parallel projection from above and from the side, 25 degrees off z.  Between the levels of the guys the mast is drawn as a
    smooth line through its displacements.  A guy is drawn until it breaks.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from scipy.interpolate import PchipInterpolator

    moved = _style.take("run", run, "displacement", ("time", "level", "coordinate"), MOVING)
    guys = _style.take("run", run, "guy_position", ("time", "guy", "point", "coordinate"), MOVING)
    tension = _style.take("run", run, "guy_tension", ("time", "guy"), MOVING)
    if moved.shape[-1] != 3 or guys.shape[-1] != 3:
        raise scene_error("run", guys.shape, MOVING)
    heights = _style.take("run", run, "level", ("level",), MOVING)
    broken = np.isnan(guys.values).all(axis=(2, 3))  # a guy that broke is nowhere
    for array in (heights, moved, guys, tension):
        finite = np.isfinite(array.values)
        if not (finite | broken[..., None, None] if array is guys else finite).all() or broken.all():
            raise SceneError(f"run: given {array.name} that is not finite; allowed: finite numbers, {MOVING}")
    most = MOST_FRAMES if frames is None else integer(least=1)("frames", frames)
    picked = _style.spread(moved.sizes["time"], most)
    level = heights.values.astype(float)
    displacement, position = (array.values[picked].astype(float) for array in (moved, guys))
    force = tension.values[picked].astype(float)
    if scale is None:
        scale = DRAWN * float(level[-1]) / max(float(np.abs(displacement).max()), 1e-12)
    else:
        number(above=0.0)("scale", scale)
    height = np.linspace(0.0, level[-1], POINTS)
    nodes = np.concatenate([np.zeros((len(picked), 1, 3)), displacement], axis=1)
    shape = scale * PchipInterpolator(np.concatenate([[0.0], level]), nodes, axis=1)(height)
    shape[..., 1] += height
    sigma = np.linspace(0.0, 1.0, position.shape[2])[:, None]
    chord = position[:, :, :1] + sigma * (position[:, :, -1:] - position[:, :, :1])
    straight = position[:, :, -1:].copy()
    straight[..., (0, 2)] = 0.0
    ends = straight + scale * (position[:, :, -1:] - straight)
    deflection = position - chord
    held = ~broken[picked, :, None, None]
    sag = np.sum(deflection, axis=0, where=held) / np.maximum(held.sum(axis=0), 1)
    drawn = position[:, :, :1] + sigma * (ends - position[:, :, :1]) + sag + scale * (deflection - sag)
    ax = _style.axes(ax, private=True)
    across, up = _projected(shape)
    guy_across, guy_up = _projected(drawn)
    limits = Normalize(float(force.min()), float(force.max()))
    colours = colormaps["viridis"](limits(force))
    ax.plot(across[0], up[0], color="0.7", linewidth=0.8, zorder=0)
    ground = [_projected(position[0, g, 0]) for g in range(position.shape[1])]
    ax.plot([x for x, _ in ground], [y for _, y in ground], linestyle="none", marker="s", markersize=3, color="0.4")
    (mast,) = ax.plot(across[0], up[0], color="black", linewidth=2.0)
    lines = [ax.plot(guy_across[0, g], guy_up[0, g], linewidth=1.5)[0] for g in range(position.shape[1])]
    for name, parts in (("x", (across, guy_across)), ("y", (up, guy_up))):
        low, high = min(float(np.nanmin(part)) for part in parts), max(float(np.nanmax(part)) for part in parts)
        getattr(ax, f"set_{name}lim")(low - 0.05 * (high - low), high + 0.1 * (high - low))
    ax.set(xlabel="[m]", ylabel=f"[m], motion enlarged {scale:.3g} times", aspect="equal")
    _style.colour_bar(ax, ScalarMappable(limits, "viridis"), "tension [N]", force, shrink=0.8)

    def show(i: int) -> None:
        mast.set_data(across[i], up[i])
        for g, line in enumerate(lines):
            line.set_data(guy_across[i, g], guy_up[i, g])
            line.set_color(tuple(colours[i, g]))

    return Animation(ax, moved["time"].values[picked], show)


def _projected(position: np.ndarray) -> tuple[Any, Any]:
    """Return horizontal and vertical coordinates of the view of positions (..., 3) [m]."""
    x, y, z = position[..., 0], position[..., 1], position[..., 2]
    depth = x * np.sin(AZIMUTH) + z * np.cos(AZIMUTH)
    return x * np.cos(AZIMUTH) - z * np.sin(AZIMUTH), y * np.cos(ELEVATION) - depth * np.sin(ELEVATION)
