"""Draw masts and their guys: tensions over time, bending moments and displacements over height, shapes of vibration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod.conventions import direction
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import choice, integer, plain
from cablepod.plots import _style
from cablepod.plots._style import COLOURS, LINES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TENSIONS = "what mast.simulate gives with output guy_tension"
HEIGHTS = "what mast.rest, or mast.simulate with output extremes gives"
SHAPES = "what mast.frequencies gives"
#: Directions in which a mast bends.
DIRECTIONS = ("x", "z")


def guy_tensions(run: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the tensions of the guys of a mast over time.

    Parameters
    ----------
    run
        Result of :func:`cablepod.mast.simulate` with the output "guy_tension".
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones, with a colour for each table of guys and a line for each guy.  The legend tells its level where the
        run has ``guy_level``, and where it has ``anchor (guy, coordinate)`` [m], as :func:`cablepod.mast.rest` gives it, the
        direction of the anchor from the mast: the angle from +x towards +z.  A line and a word mark where a guy breaks, at
        ``guy_breaks (guy)`` [s].

    Raises
    ------
    SceneError
        For another Dataset.
    """
    tensions = _style.take("run", run, "guy_tension", ("time", "guy"), TENSIONS)
    time, tension = tensions["time"].values, tensions.values
    ax = _style.axes(ax)
    tables = np.ones(tension.shape[1], dtype=int)
    if "table" in run:
        tables = _style.take("run", run, "table", ("guy",), TENSIONS).values
        if tables.dtype.kind not in "iu":
            raise SceneError(f"run: given table of type {tables.dtype}; allowed: whole numbers, {TENSIONS}")
    names = _names_of_guys(run)
    for g, table in enumerate(tables):
        number = int(np.sum(tables[:g] == table))
        colour, line = COLOURS[int(table - 1) % len(COLOURS)], LINES[number % len(LINES)]
        ax.plot(time, tension[:, g], color=colour, linestyle=line, linewidth=0.8, label=names[g])
    ax.set_xlabel("time [s]")
    _style.label_axis(ax.yaxis, "tension at the mast [N]", tension)
    _mark_breaks(ax, run, time)
    return _style.finish(ax, fontsize="small")


def _mark_breaks(ax: Axes, run: xr.Dataset, time: np.ndarray) -> None:
    """Mark the times at which guys break within the times of a run."""
    if "guy_breaks" not in run or not time.size:
        return
    breaks = _style.take("run", run, "guy_breaks", ("guy",), TENSIONS).values
    start, end = float(time.min()), float(time.max())
    times = np.unique(breaks[(breaks >= start) & (breaks <= end)])
    if times.size:
        ax.set_ymargin(0.12)  # room for the words
    for instant in times.tolist():
        guys = _numbers(run)[breaks == instant]
        what = f"guy {guys[0]} breaks" if guys.size == 1 else f"guys {', '.join(map(str, guys))} break"
        ax.axvline(instant, color="0.3", linewidth=0.8, linestyle=":")
        late = instant > 0.5 * (start + end)
        ax.annotate(
            what, (instant, 0.98), xycoords=("data", "axes fraction"), xytext=(-3 if late else 3, 0), textcoords="offset points",
            ha="right" if late else "left", va="top", fontsize="small", color="0.3",
        )  # fmt: skip


def _numbers(run: xr.Dataset) -> np.ndarray:
    """Return the numbers of the guys, which may be picked or reordered; from 1 on where the run has none."""
    if "guy" not in run.coords:
        return np.arange(1, run.sizes["guy"] + 1)
    return _style.take("run", run, "guy", ("guy",), TENSIONS).values


def _names_of_guys(run: xr.Dataset) -> list[str]:
    """Return number of each guy, with level and direction where the run has them."""
    names = [f"guy {number}" for number in _numbers(run)]
    if "guy_level" in run:
        levels = _style.take("run", run, "guy_level", ("guy",), TENSIONS).values
        names = [f"{name}, {level:g} m" for name, level in zip(names, levels, strict=True)]
    if "anchor" in run:
        anchors = _style.take("run", run, "anchor", ("guy", "coordinate"), TENSIONS).values
        names = [f"{name}, {direction(x, z)}" for name, (x, _, z) in zip(names, anchors, strict=True)]
    return names


def bending_moments(result: xr.Dataset, *, component: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw bending moments of a mast over its height: at rest, or the range of a run.

    Parameters
    ----------
    result
        Result of :func:`cablepod.mast.rest`, or of :func:`cablepod.mast.simulate` with the output "extremes".
    component
        Direction of the displacement, "x" or "z"; by default that of the largest moment.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: bending moment [kN m] across, height [m] up.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    height = _style.take("result", result, "node_height", ("node",), HEIGHTS).values
    if component is not None:
        choice(*DIRECTIONS)("component", component)
    names = [name for name in ("bending_moment_minimum", "bending_moment_maximum") if name in result]
    if not names and "bending_moment" in result and "time" not in result.variables["bending_moment"].dims:
        names = ["bending_moment"]
    if not names:
        raise SceneError(f"result: given a Dataset without bending moments; allowed: {HEIGHTS}")
    ax = _style.axes(ax)
    moments = [_style.take("result", result, name, ("node", "coordinate"), HEIGHTS) for name in names]
    for moment in moments:
        for wanted in DIRECTIONS if component is None else (component,):
            if wanted not in moment["coordinate"].values.tolist():
                raise scene_error("result", plain(moment["coordinate"].values), f"labels of coordinate, with {wanted}")
    if component is None:
        sizes = [max(float(abs(moment.sel(coordinate=way)).max()) for moment in moments) for way in DIRECTIONS]
        component = DIRECTIONS[int(np.argmax(sizes))]
    values = [moment.sel(coordinate=component).values for moment in moments]
    for name, numbers, line in zip(names, values, LINES, strict=False):
        ax.plot(numbers, height, color=COLOURS[0], linestyle=line, label=name.replace("bending_moment", "").strip("_"))
    if len(values) == 2:
        ax.fill_betweenx(height, values[0], values[1], color=COLOURS[0], alpha=0.15)
        ax.legend(fontsize="small")
    ax.axvline(0.0, color="0.7", linewidth=0.8, zorder=0)
    _style.label_axis(ax.xaxis, f"bending moment for displacements along {component} [N m]", np.array(values))
    ax.set_ylabel("height [m]")
    return ax


def mast_shapes(frequencies: xr.Dataset, *, count: int = 6, ax: Axes | None = None) -> Axes:
    """Draw the shapes of the modes in which the mast has the largest share of the kinetic energy.

    Parameters
    ----------
    frequencies
        Result of :func:`cablepod.mast.frequencies`.
    count
        Number of shapes, those of the largest share.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: shapes side by side, by rising frequency, each in its direction of largest displacement and drawn to
        the same width, height [m] up.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    shapes = _style.take("frequencies", frequencies, "mode_shape", ("mode", "node", "coordinate"), SHAPES).values
    integer(least=1)("count", count)
    share, omega = (
        _style.take("frequencies", frequencies, name, ("mode",), SHAPES).values
        for name in ("mast_share", "angular_frequency")
    )
    if shapes.shape[-1] != 3:
        raise scene_error("frequencies", shapes.shape, SHAPES)
    chosen = modes_of_mast(share, count)
    height = _style.take("frequencies", frequencies, "node_height", ("node",), SHAPES).values
    ax = _style.axes(ax)
    ticks: list[Any] = []
    for place, mode in enumerate(chosen):
        size = np.linalg.norm(shapes[mode], axis=1)
        turn = shapes[mode][int(size.argmax())] / max(float(size.max()), 1e-300)
        across = shapes[mode] @ turn
        ax.axvline(2.0 * place, color="0.8", linewidth=0.8, zorder=0)
        ax.plot(2.0 * place + 0.9 * across / max(float(np.abs(across).max()), 1e-300), height, color=COLOURS[0])
        ticks.append(f"{omega[mode] / (2.0 * np.pi):.4g}")
    ax.set_xticks(2.0 * np.arange(len(chosen)), ticks)
    ax.set(
        xlabel="frequency [Hz], not to scale: modes in which the mast moves most,\neach shape to the same width",
        ylabel="height [m]",
    )
    return ax


def modes_of_mast(share: np.ndarray, count: int) -> np.ndarray:
    """Return the places of the `count` modes with the largest shares of the mast, in the order of the modes."""
    return np.sort(np.argsort(-np.asarray(share), kind="stable")[:count])
