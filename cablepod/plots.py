"""Figures: Dataset and axes in, axes out.  Nothing is shown or saved, and no global option of matplotlib is changed.

Without `ax` a new figure is made.  Curves differ in line style or marker as well as in colour (Okabe and Ito's), also
to be read in grey.  The legend stands to the right of the axes: give figures of your own
``layout="constrained"``, which makes room for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod import schema
from cablepod.pod import relative_arc_length
from cablepod.schema import SceneError, refuse

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["amplitudes", "error_over_time", "modes", "rest", "shapes", "singular_values"]

COLOURS = ("#000000", "#D55E00", "#56B4E9", "#0072B2", "#E69F00", "#009E73", "#CC79A7")
LINES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (8, 3)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
MOST_INSTANTS = 6
DEFAULT_INSTANTS = 5
MARKS = 12  # markers along a line that has many points
MOST_DOTS = 40  # of a chain at one instant; of a longer one every second or third particle is drawn, ...

PLACE = ("particle", "coordinate")
SIGMA = "unstretched arc length $S / L_0$ [1]"
TRAJECTORY = "a trajectory, from a simulate"
MODES = "modes, from pod.decompose"


def shapes(
    chain: xr.Dataset,
    reduced: xr.Dataset | None = None,
    *,
    times: Sequence[float] | np.ndarray | None = None,
    deflection: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw the cable at a few instants: the chain as dots, the reduced cable as a line (figures 6 to 9 of the paper).

    Parameters
    ----------
    chain, reduced
        Trajectories with ``position (time, particle, coordinate)`` [m]; `reduced` may be left out, and may have other
        particles than the chain.
    times
        At most six instants [s], which both trajectories must have; by default five, evenly spread over the chain's.
    deflection
        Draw the deflection normal to the chord of the moment [m] against S / L0 instead of y against x: a motion that
        is small beside the span is visible only so.
    ax
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones; x and y are not to the same scale.

    Raises
    ------
    SceneError
        For Datasets without positions, instants that they do not have, and ends that coincide where a chord is needed.

    Notes
    -----
    The normal lies in the plane of the chord and y and points up at the first instant.  A spatial cable is drawn as
    seen along z, or by its deflection in that plane; the legend says so.
    """
    runs = {"chain": chain} if reduced is None else {"chain": chain, "reduced": reduced}
    positions = {key: _take(key, run, "position", ("time", *PLACE), TRAJECTORY) for key, run in runs.items()}
    if len({position.sizes["coordinate"] for position in positions.values()}) > 1:
        raise refuse("reduced", list(positions["reduced"]["coordinate"].values), "the coordinates of the chain")
    instants = positions["chain"]["time"].values
    if times is None:
        times = instants[np.linspace(0, instants.size - 1, min(DEFAULT_INSTANTS, instants.size)).round().astype(int)]
    wanted = np.atleast_1d(np.asarray(times, dtype=float))
    if not 1 <= wanted.size <= MOST_INSTANTS:
        raise refuse("times", f"{wanted.size} instants", f"one to {MOST_INSTANTS}")
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for key, position in positions.items():
        pick, values = _instants(key, position["time"].values, wanted), position.values
        if deflection:
            up = _deflection(key, values)[pick]
            curves[key] = np.broadcast_to(_sigma(key, runs[key]), up.shape), up
        else:
            curves[key] = values[pick, :, 0], values[pick, :, 1]
    ax = _axes(ax)
    handles: list[tuple[Any, ...]] = [() for _ in wanted]
    for key, (across, up) in curves.items():
        for i in range(wanted.size):
            if key == "chain":
                every = max(1, across.shape[1] // MOST_DOTS)
                style: dict[str, Any] = {
                    "linestyle": "none",
                    "marker": MARKERS[i],
                    "fillstyle": "none",
                    "markersize": 4,
                    "markevery": every,
                }
            else:
                style = {"linestyle": LINES[i], "linewidth": 1.2}
            handles[i] += tuple(ax.plot(across[i], up[i], color=COLOURS[i], **style))
    spatial = positions["chain"].sizes["coordinate"] > 2
    title = "dots: " + _name(chain, "chain")
    if reduced is not None:
        title += "\nlines: " + _name(reduced, "reduced cable")
    if spatial:
        title += "\nin the plane of chord and y" if deflection else "\nseen along z"
    if deflection:
        ax.set(xlabel=SIGMA, ylabel="deflection normal to the chord [m]")
    else:
        ax.set(xlabel="x [m]", ylabel="y [m]")
    return _finish(ax, title=title, handles=handles, labels=[f"t = {t:g} s" for t in wanted])


def rest(cable: xr.Dataset, chain: xr.Dataset | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the cable at rest: the continuous cable as a line, the chain as dots (figure 4 of the paper).

    Parameters
    ----------
    cable, chain
        What ``catenary.rest`` and ``chain.rest`` give: ``position (particle, coordinate)`` [m].
    ax
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones, x and y not to the same scale; a spatial cable is seen along z.

    Raises
    ------
    SceneError
        For Datasets that are no cable at rest.
    """
    line = _take("cable", cable, "position", PLACE, "a cable at rest, from a rest")
    dots = None if chain is None else _take("chain", chain, "position", PLACE, "a chain at rest, from chain.rest")
    ax = _axes(ax)
    ax.plot(*line.values[:, :2].T, color=COLOURS[3], label="continuous cable")
    if dots is not None:
        ax.plot(*dots.values[:, :2].T, color=COLOURS[0], linestyle="none", marker="o", markersize=3.5, label="chain")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    return _finish(ax, title="at rest, seen along z" if line.sizes["coordinate"] > 2 else "at rest")


def modes(modes: xr.Dataset, *, count: int = 3, ax: Axes | None = None) -> Axes:
    """Draw mode shapes against S / L0 (figure 5 of the paper).

    Parameters
    ----------
    modes
        What ``pod.decompose`` gives, of any layout.
    count
        How many modes, from the first; fewer where there are fewer.
    ax
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a colour and marker for each mode, a line style for each coordinate
        (solid x, dashed y, dotted z).

    Raises
    ------
    SceneError
        For a Dataset without modes.
    """
    shape = _take("modes", modes, "mode_shape", ("particle", "mode"), MODES, more=1)
    ax = _by_mode(ax, _sigma("modes", modes), shape, count)
    ax.set(xlabel=SIGMA, ylabel="mode shape, of unit norm [1]")
    return _finish(ax)


def singular_values(modes: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the singular values [m] over the number of the mode, on a logarithmic axis.

    Parameters
    ----------
    modes
        What ``pod.decompose`` gives, of any layout.
    ax
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a curve for each coordinate where modes are separate.  Values of zero are left out.

    Raises
    ------
    SceneError
        For a Dataset without singular values.
    """
    values = _take("modes", modes, "singular_value", ("mode",), MODES, more=1)
    ax = _axes(ax)
    for i, (name, part) in enumerate(_sets(values, 1)):
        _log(ax, _numbers(values), part, name or "all modes", _style(i, i, MARKS))  # every mode is marked
    ax.locator_params(axis="x", integer=True, min_n_ticks=1)
    ax.set(xlabel="number of the mode [1]", ylabel="singular value [m]", yscale="log")
    return _finish(ax)


def amplitudes(run: xr.Dataset, *, count: int = 3, ax: Axes | None = None) -> Axes:
    """Draw the amplitudes of the first modes [m] over time.

    Parameters
    ----------
    run
        What a reduced model or ``pod.project`` gives.
    count
        How many modes, from the first; fewer where there are fewer.
    ax
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: a colour and marker for each mode, a line style for each coordinate where modes are separate.

    Raises
    ------
    SceneError
        For a Dataset without amplitudes.
    """
    amplitude = _take("run", run, "amplitude", ("time", "mode"), "what a reduced model or pod.project gives", more=1)
    ax = _by_mode(ax, amplitude["time"].values, amplitude, count)
    ax.set(xlabel="time [s]", ylabel="amplitude [m]")
    return _finish(ax)


def error_over_time(comparisons: Mapping[str, xr.Dataset], *, ax: Axes | None = None) -> Axes:
    """Draw errors over time in per cent of the truth's largest displacement, on a logarithmic axis.

    Parameters
    ----------
    comparisons
        Label of a curve -> what ``compare.errors`` gives.
    ax
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones.  Errors of zero, which a logarithmic axis cannot show, are left out.

    Raises
    ------
    SceneError
        For anything but comparisons, or none.
    """
    if isinstance(comparisons, xr.Dataset) or not isinstance(comparisons, Mapping) or not comparisons:
        raise refuse(
            "comparisons", type(comparisons).__name__, "a mapping, not empty, from labels to what compare.errors gives"
        )
    allowed = "what compare.errors gives"
    errors = {str(key): _take(str(key), item, "error", ("time",), allowed) for key, item in comparisons.items()}
    ax = _axes(ax)
    for i, (name, error) in enumerate(errors.items()):
        _log(ax, error["time"].values, 100.0 * error.values, name, _style(i, i, error.size))
    ax.set(xlabel="time [s]", ylabel="rms error / largest displacement [%]", yscale="log")
    return _finish(ax)


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot as plt  # not at the top: importing cablepod must not import it

    return plt.subplots(figsize=(7.5, 4.2), layout="constrained")[1]


def _finish(ax: Axes, **legend: Any) -> Axes:
    ax.grid(alpha=0.3)
    place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
    ax.legend(**place, handlelength=3.0, alignment="left", **legend)
    return ax


def _style(colour: int, line: int, points: int) -> dict[str, Any]:
    """Style of a line with some markers, those of different lines at different places."""
    step = max(1, points // MARKS)
    return {
        "color": COLOURS[colour % len(COLOURS)],
        "linestyle": LINES[line % len(LINES)],
        "marker": MARKERS[colour % len(MARKERS)],
        "markevery": (colour * step // 3 % step, step),
        "markersize": 4,
        "linewidth": 1.2,
    }


def _log(ax: Axes, across: np.ndarray, values: np.ndarray, name: str, style: dict[str, Any]) -> None:
    """Draw what a logarithmic axis can show of `values`."""
    positive = values > 0.0
    label = name if positive.any() else f"{name} (all zero)"
    ax.plot(across, np.where(positive, values, np.nan), label=label, **style)


def _by_mode(ax: Axes | None, across: np.ndarray, array: xr.DataArray, count: int) -> Axes:
    """Draw the first `count` modes of each set of an array (..., points, mode)."""
    schema.integer(least=1)("count", count)
    ax = _axes(ax)
    for j, (name, part) in enumerate(_sets(array, 2)):
        for i, number in enumerate(_numbers(array)[:count]):
            label = f"{name}, mode {number}" if name else f"mode {number}"
            ax.plot(across, part[:, i], label=label, **_style(i, j, across.size))
    return ax


def _sets(array: xr.DataArray, ndim: int) -> list[tuple[str, np.ndarray]]:
    """Split into arrays of `ndim` dimensions with their names along the one in front of these, if there is one."""
    if array.ndim == ndim:
        return [("", array.values)]
    return [(str(name), part) for name, part in zip(array[array.dims[0]].values, array.values, strict=True)]


def _numbers(array: xr.DataArray) -> np.ndarray:
    return array["mode"].values if "mode" in array.coords else np.arange(1, array.sizes["mode"] + 1)


def _take(key: str, dataset: Any, name: str, dims: tuple[str, ...], allowed: str, *, more: int = 0) -> xr.DataArray:
    """Take a variable with `dims` last and at most `more` others; one lost by picking a single value comes back."""
    if not isinstance(dataset, xr.Dataset) or name not in dataset:
        raise SceneError(f"{key}: given a {type(dataset).__name__} without {name}; allowed: {allowed}")
    array = dataset[name]
    if "member" in array.dims:
        raise refuse(key, f"{array.sizes['member']} members", "one; pick it with .isel(member=0)")
    lost = [dim for dim in ("time", "mode") if dim in dims and dim in array.coords and dim not in array.dims]
    array = array.expand_dims(lost)
    if not set(dims) <= set(array.dims) or array.ndim > len(dims) + more or not array.size:
        raise SceneError(f"{key}: given {name} {dict(array.sizes)}; allowed: {dims}, {allowed}")
    return array.transpose(..., *dims)


def _sigma(key: str, dataset: xr.Dataset) -> np.ndarray:
    if "arc_length" not in dataset.variables:
        raise SceneError(f"{key}: given a Dataset without arc_length; allowed: one with arc_length (particle)")
    return relative_arc_length(dataset)


def _instants(key: str, own: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Find the indices of the `wanted` instants."""
    nearest = np.abs(own[:, None] - wanted).argmin(axis=0)
    for i, t in zip(nearest, wanted, strict=True):
        # instants are stated in decimals: what differs by less is rounding
        if not abs(own[i] - t) <= 1e-9 * max(1.0, abs(t)):
            raise refuse("times", float(t), f"instants of the {key}, of which the nearest is {own[i]:g} s")
    return nearest


def _deflection(key: str, position: np.ndarray) -> np.ndarray:
    """Deflections (time, particle) [m] normal to the chord, in the plane of chord and y."""
    chord = position[:, -1] - position[:, 0]
    length = np.linalg.norm(chord, axis=1)
    if not length.all():
        raise SceneError(f"{key}: given ends that coincide; allowed: a chord, or deflection=False")
    level = [0, *range(2, chord.shape[1])]
    flat = chord[:, level]
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    first = flat[0] / size[0] if size[0] > 0.0 else np.eye(len(level))[0]
    # the same side throughout, also where the chord passes the vertical
    along = np.divide(flat, size, out=np.tile(first, (len(flat), 1)), where=size > 0.0)
    along *= np.where(along @ first < 0.0, -1.0, 1.0)[:, None]
    normal = np.empty_like(chord)
    normal[:, level] = -chord[:, 1:2] * along
    normal[:, 1] = np.sum(flat * along, axis=1)
    return np.einsum("tpc,tc->tp", position - position[:, :1], normal / length[:, None])


def _name(run: xr.Dataset, otherwise: str) -> str:
    name = str(run.attrs.get("model", otherwise))
    return f"{name}, r = {run.attrs['rank']}" if "rank" in run.attrs else name
