"""Styles, axes and legends of all figures; checked variables of their Datasets."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod._inputs import ANY, WITH_PLACES, drawn_kind, taken
from cablepod.conventions import printed_unit, unit_text
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import plain
from cablepod.pod._snapshots import relative_arc_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#000000", "#D55E00", "#56B4E9", "#0072B2", "#E69F00", "#009E73", "#CC79A7")
LINES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (8, 3)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
#: Size of a figure [inch]: the width of A4 between its margins.
SIZE = (7.5, 4.2)
#: The same for equal scales across and up.
EQUAL_SIZE = (5.5, 4.2)
#: Maximum and default number of instants in a figure.
MAX_INSTANTS, DEFAULT_INSTANTS = 6, 5
#: Number of markers along a line with many points.
MARKS = 12
#: Number of dots of a chain at one instant, above which particles are skipped.
MAX_DOTS = 40
#: Number of letters in a line of the label of an axis.
LABEL_WIDTH = 42
#: The same of the legend, so that long names leave room for the axes.
LEGEND_WIDTH = 28
#: Variables of each link, or guy of a mast -> dimension and extreme over it.
OVER_PLACES: dict[str, tuple[str, Any]] = {
    "tension_maximum": ("link", np.max), "tension_minimum": ("link", np.min),
    "guy_tension_maximum": ("guy", np.max), "guy_tension_minimum": ("guy", np.min),
    "fatigue_range": ("guy", np.max), "utilisation": ("guy", np.fmax.reduce),
}  # fmt: skip
PLACE = ("particle", "coordinate")
SIGMA = "unstretched arc length $S / L_0$ [1]"
TRAJECTORY = "a trajectory, from a simulate"
MODES = "modes, from pod.decompose"


def axes(ax: Axes | None, *, size: tuple[float, float] = SIZE, private: bool = False) -> Axes:
    """Return `ax`, refused if it is none, or new axes in a figure of `size` [inch], `private` as of :func:`private_axes`."""
    if ax is None and private:
        return private_axes()
    from matplotlib import axes, pyplot  # slow to import

    if ax is None:
        return pyplot.subplots(figsize=size, layout="constrained")[1]
    if not isinstance(ax, axes.Axes):
        raise scene_error("ax", type(ax).__name__, "axes of matplotlib, or none for new ones")
    return ax


def private_axes() -> Axes:
    """Make axes of a figure unknown to pyplot, which would show it in a notebook a second time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    return figure.subplots()


def label_axis(axis: Any, label: str, values: np.ndarray) -> float:
    """Set the label of an axis, "text [units]", in lines that fit; return the factor from `values` to what is written.

    Forces and moments are written in the unit in which tables print them.
    """
    from matplotlib.ticker import FuncFormatter

    text, _, units = label.removesuffix("]").rpartition(" [")
    factor, unit = 1.0, unit_text(units) or units
    if units in ("N", "N m"):
        factor, unit = printed_unit(units, float(np.nanmax(np.abs(values), initial=0.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{factor * value:g}"))
    kept = f"\N{NO-BREAK SPACE}[{unit}]".replace(" ", "\N{NO-BREAK SPACE}")
    axis.set_label_text(textwrap.fill(f"{text}{kept}", LABEL_WIDTH).replace("\N{NO-BREAK SPACE}", " "))
    return factor


def colour_bar(ax: Axes, drawn: Any, label: str, values: np.ndarray, **look: Any) -> float:
    """Add a colour bar of what is drawn, labelled as by :func:`label_axis`, whose factor it returns."""
    return label_axis(ax.figure.colorbar(drawn, ax=ax, **look).ax.yaxis, label, values)


def label_of(array: xr.DataArray) -> str:
    """Return long name and units of a variable, "text [units]"."""
    name = array.attrs.get("long_name", str(array.name).replace("_", " "))
    return f"{name} [{array.attrs.get('units', '1')}]"


def equal_axes(ax: Axes, up: str = "y") -> None:
    """Label axes of shapes, and draw x and the coordinate `up` to the same scale."""
    ax.set(xlabel="x [m]", ylabel=f"{up} [m]")
    ax.set_aspect("equal", adjustable="datalim")


def finish(ax: Axes, **legend: Any) -> Axes:
    """Add grid and legend; return `ax`."""
    ax.grid(alpha=0.3)
    place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
    for text in ax.legend(**place, handlelength=3.0, alignment="left", **legend).get_texts():
        text.set_text("\n".join(textwrap.fill(line, LEGEND_WIDTH) for line in text.get_text().split("\n")))
    return ax


def style(colour: int, line: int, points: int) -> dict[str, Any]:
    """Return the style of a line with some markers, at different places on different lines."""
    step = max(1, points // MARKS)
    return {
        "color": COLOURS[colour % len(COLOURS)],
        "linestyle": LINES[line % len(LINES)],
        "marker": MARKERS[colour % len(MARKERS)],
        "markevery": (colour * step // 3 % step, step),
        "markersize": 4,
        "linewidth": 1.2,
    }


def dots(number: int, points: int) -> dict[str, Any]:
    """Return the style of a chain as dots, of which many are thinned."""
    every = max(1, points // MAX_DOTS)
    return {
        "color": COLOURS[number], "linestyle": "none", "marker": MARKERS[number], "markersize": 4, "markevery": every,
    }  # fmt: skip


def colour_cells(ax: Axes, across: np.ndarray, up: np.ndarray, values: np.ndarray) -> Any:
    """Draw values (up, across) by colour, in a map that is monotonic in grey and safe for colour-blind readers."""
    return ax.pcolormesh(across, up, values, cmap="cividis", shading="nearest", rasterized=True)


def hatch_cells(ax: Axes, mesh: Any, which: Any, colour: str) -> None:
    """Hatch cells of a mesh, given as a mask or as indices (row, column)."""
    from matplotlib.collections import PolyCollection

    corners = np.asarray(mesh.get_coordinates())
    cells = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=2)[which]
    # hatches take the edge colour
    ax.add_collection(PolyCollection(list(cells), facecolor="none", edgecolor=colour, linewidth=0.0, hatch="////"))


def log(ax: Axes, across: np.ndarray, values: np.ndarray, name: str, style: dict[str, Any]) -> None:
    """Draw the positive ones of `values`, for a logarithmic axis."""
    positive = values > 0.0
    label = name if positive.any() else f"{name} (all zero)"
    ax.plot(across, np.where(positive, values, np.nan), label=label, **style)


def sets(array: xr.DataArray, ndim: int) -> list[tuple[str, np.ndarray]]:
    """Split an array along a leading dimension; return names and parts of `ndim` dimensions."""
    if array.ndim == ndim:
        return [("", array.values)]
    return [(str(name), part) for name, part in zip(array[array.dims[0]].values, array.values, strict=True)]


def numbers(array: xr.DataArray) -> np.ndarray:
    """Return the mode numbers, counted from 1 by default."""
    return array["mode"].values if "mode" in array.coords else np.arange(1, array.sizes["mode"] + 1)


def take(key: str, dataset: Any, name: str, dims: tuple[str, ...], allowed: str, *, more: int = 0) -> xr.DataArray:
    """Return a checked variable with `dims` last and at most `more` others, nodes and levels of a mast by their heights.

    A dimension lost by the selection of a single time or mode is restored.
    """
    array = taken(key, dataset, drawn_kind(name, dims, allowed))[name]
    if array.dtype.kind not in ("biuf" if name == "stable" else "iuf") or array.dtype == np.float16:
        raise SceneError(
            f"{key}: given {name} of type {array.dtype}; allowed: real numbers of at least single precision, {allowed}"
        )
    if "member" in array.dims:
        raise scene_error(key, f"{array.sizes['member']} members", "one; pick it with .isel(member=0)")
    lost = [dim for dim in ("time", "mode") if dim in dims and dim in array.coords and dim not in array.dims]
    array = array.expand_dims(lost)
    if not set(dims) <= set(array.dims) or array.ndim > len(dims) + more or not array.size:
        raise SceneError(f"{key}: given {name} {dict(array.sizes)}; allowed: {dims}, {allowed}")
    for name in {"node_height", "level"}.intersection(array.coords):
        array = array.sortby(name) if array.coords[name].ndim else array
    if array.dtype.kind == "f":
        array = array.astype(float, copy=False)
    return array.transpose(..., *dims)


def texts(key: str, dataset: xr.Dataset, name: str, dims: tuple[str, ...], allowed: str) -> np.ndarray:
    """Return a variable of texts over dimensions."""
    array = taken(key, dataset, ANY)[name]
    if set(array.dims) != set(dims) or array.dtype.kind not in "UO":
        raise SceneError(f"{key}: given {name} {dict(array.sizes)} of type {array.dtype}; allowed: texts, {allowed}")
    return np.asarray(array.transpose(*dims).values)


def positions(runs: dict[str, xr.Dataset]) -> dict[str, xr.DataArray]:
    """Return the positions of runs, checked to have the coordinates of the first."""
    positions = {key: take(key, run, "position", ("time", *PLACE), TRAJECTORY) for key, run in runs.items()}
    first = next(iter(positions.values()))
    for key, position in positions.items():
        if position.sizes["coordinate"] != first.sizes["coordinate"]:
            raise scene_error(key, plain(position["coordinate"].values), "the coordinates of the chain")
    return positions


def sigma(key: str, dataset: xr.Dataset) -> np.ndarray:
    """Return S / L0 [1] of the particles."""
    return relative_arc_length(taken(key, dataset, WITH_PLACES))


def spread(count: int, most: int) -> np.ndarray:
    """Return at most so many of `count` places, evenly spread, with the first and the last one."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def instants(key: str, times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the indices of the `wanted` instants in `times` [s]."""
    nearest = np.abs(times[:, None] - wanted).argmin(axis=0)
    for i, t in zip(nearest, wanted, strict=True):
        # tolerance of rounding
        if not abs(times[i] - t) <= 1e-9 * max(1.0, abs(t)):
            raise scene_error("times", float(t), f"instants of the {key}, of which the nearest is {times[i]:g} s")
    return nearest


def curves(
    runs: dict[str, xr.Dataset],
    positions: dict[str, xr.DataArray],
    wanted: np.ndarray,
    *,
    deflection: bool,
    across: bool = False,
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return what is drawn of runs at instants [s], (instant, point): x and y or, across, z; or S / L0 and deflection."""
    found = {}
    for key, position in positions.items():
        pick, values = instants(key, position["time"].values, wanted), position.values
        if deflection:
            up = normal_deflection(key, values, across=across)[pick]
            found[key] = np.broadcast_to(sigma(key, runs[key]), up.shape), up
        else:
            found[key] = values[pick, :, 0], values[pick, :, 2 if across else 1]
    return found


def normal_deflection(key: str, position: np.ndarray, *, across: bool = False) -> np.ndarray:
    """Return deflections (time, particle) [m] normal to the chord, in the plane of chord and y or across it."""
    position = np.ascontiguousarray(position)  # the memory order decides on the last bits of sums
    chord = position[:, -1] - position[:, 0]
    length = np.linalg.norm(chord, axis=1)
    if not length.all():
        raise SceneError(f"{key}: given ends that coincide; allowed: a chord, or deflection=False")
    level = [0, *range(2, chord.shape[1])]
    flat = chord[:, level]
    norm = np.linalg.norm(flat, axis=1, keepdims=True)
    first = flat[0] / norm[0] if norm[0] > 0.0 else np.eye(len(level))[0]
    # the same side at all instants, also if the chord passes the vertical
    along = np.divide(flat, norm, out=np.tile(first, (len(flat), 1)), where=norm > 0.0)
    along *= np.where(along @ first < 0.0, -1.0, 1.0)[:, None]
    if across:
        normal = np.stack([-along[:, 1], np.zeros(len(along)), along[:, 0]], axis=1)
        return np.asarray(np.einsum("tpc,tc->tp", position - position[:, :1], normal))
    normal = np.empty_like(chord)
    normal[:, level] = -chord[:, 1:2] * along
    normal[:, 1] = np.sum(flat * along, axis=1)
    return np.einsum("tpc,tc->tp", position - position[:, :1], normal / length[:, None])


def name(run: xr.Dataset, otherwise: str) -> str:
    """Return the name of the model of a run, with its rank."""
    name = str(run.attrs.get("model", otherwise))
    return f"{name}, r = {run.attrs['rank']}" if "rank" in run.attrs else name
