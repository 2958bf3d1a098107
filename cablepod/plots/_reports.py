"""Draw errors over time and against run time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod._models import MODELS, Marker
from cablepod.errors import SceneError, one_of, scene_error
from cablepod.plots import _style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Marker, colour and label of static solutions, which are no model of their own, and marker and colour of other models.
CATENARIES, OTHERS = ("x", "black", "catenaries, splines between"), ("P", "0.35")
#: Family -> line style, colour, label of its front.
FRONTS = {
    "full": ("-", "#003a5c", "front, full"),
    "reduced": ("--", "#a33c00", "front, reduced"),
    "quasi-static": (":", "black", "front, catenaries"),
}
#: Maximum number of instants that are drawn one by one, and number of intervals of others.
MAX_INSTANTS, INTERVALS = 250, 100
OF_SETTINGS = ("error_max", "model", "scheme", "family", "measured_again", "on_front")


#: Columns of a plain table of errors and run times, and how a refusal tells them.
COLUMNS = ("name", "run_time", "error")
PLAIN_TABLE = "rows of name, run_time [s] and error [1] as a list of mappings or triples, a DataFrame or a Dataset"


def error_over_time(comparisons: Mapping[str, xr.Dataset] | Sequence[xr.Dataset], *, ax: Axes | None = None) -> Axes:
    """Draw errors over time in per cent of the largest displacement of the truth.

    Parameters
    ----------
    comparisons
        Label of a curve -> result of ``compare.errors``; or a list of such results, labelled by their titles.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones; the errors on a logarithmic axis, without zeros.  Of more than 250 instants the largest error of each
        interval of about a hundredth of them is drawn, as the legend states.

    Raises
    ------
    SceneError
        For nothing to draw and for other Datasets.
    """
    allowed = "what compare.errors gives"
    if isinstance(comparisons, list | tuple):
        comparisons = _by_title(comparisons, allowed)
    if isinstance(comparisons, xr.Dataset) or not isinstance(comparisons, Mapping) or not comparisons:
        what = type(comparisons).__name__ if not isinstance(comparisons, Mapping) or comparisons else "nothing"
        raise scene_error("comparisons", what, f"a mapping, not empty, from labels to {allowed}, or a list of these")
    errors = {
        str(key): _style.take(str(key), result, "error", ("time",), allowed) for key, result in comparisons.items()
    }
    ax, title = _style.axes(ax), None
    for i, (name, error) in enumerate(errors.items()):
        times, values = error["time"].values, error.values
        if error.size > MAX_INSTANTS:
            first = np.arange(0, error.size, error.size // INTERVALS)
            values, times = np.maximum.reduceat(values, first), times[first]
            title = f"points: largest error\nwithin {times[1] - times[0]:.3g} s"
        _style.log(ax, times, 100.0 * values, name, _style.style(i, i, values.size))
    ax.set(xlabel="time [s]", ylabel="rms error / largest displacement [%]", yscale="log")
    return _style.finish(ax, title=title)


def error_against_run_time(
    result: Any, *, scene: str | None = None, time: str = "kernel_time", ax: Axes | None = None
) -> Axes:
    """Draw the largest error of every setting of every model over its run time, with Pareto fronts.

    A plain table of names, run times and errors of any programs is drawn with one front.

    Parameters
    ----------
    result
        A plain table: name, run_time [s] and error [1] of each setting, as a list of mappings or of triples, a DataFrame, or a
        Dataset of these variables over one dimension.  Or the Dataset written by ``pipelines/error_vs_runtime/run.py``: over
        (scene, setting) ``error_max`` [1], ``kernel_time`` and ``call_time`` [s], ``on_front`` and ``measured_again``; over
        setting ``model``, ``scheme`` and ``family``; over (scene, error_level) ``time_ratio`` and ``call_ratio``.
    scene
        Name of one of the scenes of that Dataset; optional if there is only one.
    time
        Of that Dataset: "kernel_time", the time of the integration, or "call_time", that of the whole call.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones, both axes logarithmic: a marker for each setting, small and pale if it was measured once.  Lines are
        the Pareto fronts of the families, as staircases.  At the right of each level of error: time of the best full model over
        that of the best reduced one.  Errors of 1 and more are left out.  Fronts are drawn for kernel times only.

    Raises
    ------
    SceneError
        For another Dataset or table, a missing scene, and another name of a time.

    Examples
    --------
    >>> from cablepod import plots
    >>> rows = [("chain, 40 links", 0.9, 1e-4), ("condensed, r = 2", 1e-3, 2e-4), ("condensed, r = 4", 3e-3, 1e-5)]
    >>> ax = plots.error_against_run_time(rows)
    """
    times = ("kernel_time", "call_time")
    if time not in times:
        raise scene_error("time", time, one_of(times, time))
    if not isinstance(result, xr.Dataset) or "run_time" in result.variables:
        if scene is not None:
            raise scene_error("scene", scene, "none with a plain table")
        return _draw_table(_style.axes(ax), *_columns(result))
    part = _of_scene(result, scene, (*OF_SETTINGS, time))
    milliseconds, error = 1e3 * part[time].values, part["error_max"].values
    ax = _style.axes(ax)
    again = part["measured_again"].values == 1
    for model, scheme in dict.fromkeys(zip(part["model"].values.tolist(), part["scheme"].values.tolist(), strict=True)):
        marker, colour, text = _marker(model, scheme)
        rows = (part["model"].values == model) & (part["scheme"].values == scheme) & (error < 1.0)
        if not rows.any():
            continue
        once, often = rows & ~again, rows & again
        ax.plot(milliseconds[once], error[once], marker, color=colour, ms=2, alpha=0.25, mew=0.5)
        ax.plot(milliseconds[often], error[often], marker, color=colour, ms=4.5, alpha=0.9, mew=1, label=text)
    if time == "kernel_time":
        _fronts(ax, part, milliseconds, error)
    ratio = "time_ratio" if time == "kernel_time" else "call_ratio"
    for level in part["error_level"].values if ratio in part else ():
        ax.axhline(level, color="0.6", lw=0.6, zorder=0)
        value = float(part[ratio].sel(error_level=level))
        if np.isfinite(value):
            text = f"× {value:.0f}" if value >= 10.0 else f"× {value:.1f}"
            ax.annotate(text, (0.98, level), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=9)
    name = "kernel time for the run [ms]" if time == "kernel_time" else "time of the call [ms]"
    ax.set(xscale="log", yscale="log", xlabel=name, ylabel="largest error over the run [1]")
    shown = error[(error > 0.0) & (error < 1.0)]
    ax.set_ylim(0.3 * shown.min() if shown.size else None, 1.0)
    return _style.finish(ax)


def _marker(model: str, scheme: str) -> Marker:
    """Return marker, colour and label of the settings of a model with a scheme."""
    if model == "catenary":
        return CATENARIES
    known = MODELS.get(model.lower())
    return (known.markers if known else {}).get(scheme, (*OTHERS, ", ".join(filter(None, (model, scheme)))))


def _of_scene(result: xr.Dataset, scene: str | None, needed: tuple[str, ...]) -> xr.Dataset:
    """Return the part of a result that belongs to a scene."""
    allowed = f"what pipelines/error_vs_runtime/run.py writes; or a plain table, {PLAIN_TABLE}"
    for name in needed:
        if not isinstance(result, xr.Dataset) or name not in result.variables:
            raise SceneError(f"result: given a {type(result).__name__} without {name}; allowed: {allowed}")
    if "scene" not in result.dims:
        return result
    names = [str(name) for name in result["scene"].values]
    if scene is None and len(names) == 1:
        return result.isel(scene=0)
    if scene not in names:
        raise scene_error("scene", scene, one_of(names, scene))
    return result.isel(scene=names.index(str(scene)))


def _fronts(ax: Axes, part: xr.Dataset, milliseconds: np.ndarray, error: np.ndarray) -> None:
    """Draw the Pareto front of each family."""
    for family, (line, colour, text) in FRONTS.items():
        rows = np.flatnonzero((part["on_front"].values == 1) & (part["family"].values == family) & (error < 1.0))
        rows = rows[np.argsort(milliseconds[rows])]
        # staircase: between two settings the error is that of the faster one
        label = text if rows.size else None
        x, y = milliseconds[rows], error[rows]
        ax.plot(x, y, line, color=colour, lw=1.5, drawstyle="steps-post", label=label, zorder=1)


def _by_title(given: Sequence[Any], allowed: str) -> dict[str, Any]:
    """Return results by what their titles say of the run, numbered where that is missing or the same."""
    names = []
    for number, result in enumerate(given):
        if not isinstance(result, xr.Dataset):
            raise scene_error(f"comparisons[{number}]", type(result).__name__, allowed)
        of_run = str(result.attrs.get("title", "")).removeprefix("error of ").partition(" against ")[0]
        names.append(of_run.rpartition(": ")[2])
    return {
        name if name and names.count(name) == 1 else f"{name or 'comparison'} ({number})": result
        for number, (name, result) in enumerate(zip(names, given, strict=True), start=1)
    }


def _columns(table: Any) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return names, run times [s] and errors [1] of a plain table."""
    if isinstance(table, list | tuple):
        columns = _columns_of_rows(table)
    else:  # a mapping of columns, a DataFrame, a Dataset
        given = type(table).__name__
        try:
            missing = [name for name in COLUMNS if name not in table]
            columns = [] if missing else [np.asarray(table[name]) for name in COLUMNS]
        except (TypeError, ValueError, KeyError, IndexError):
            missing = list(COLUMNS)
        if missing:
            raise SceneError(f"result: given a {given} without {' and '.join(missing)}; allowed: {PLAIN_TABLE}")
    shapes = {column.shape for column in columns}
    if len(shapes) != 1 or any(len(shape) != 1 or not shape[0] for shape in shapes):
        raise scene_error("result", f"columns of the shapes {sorted(shapes)}", PLAIN_TABLE)
    try:
        numbers = [np.array(column, dtype=float) for column in columns[1:]]
    except (TypeError, ValueError, OverflowError):
        raise scene_error("result", "run times or errors that are no numbers", PLAIN_TABLE) from None
    for key, column, zero in zip(COLUMNS[1:], numbers, ("above 0", "from 0 on"), strict=True):
        wrong = ~np.isfinite(column) | (column < 0.0) | ((column == 0.0) & (zero == "above 0"))
        if wrong.any():
            raise scene_error(f"result: {key}", float(column[wrong][0]), f"finite numbers {zero}")
    return [str(name) for name in columns[0]], numbers[0], numbers[1]


def _columns_of_rows(rows: Sequence[Any]) -> list[np.ndarray]:
    """Return the columns of a table that is given row by row."""
    triples = []
    for number, row in enumerate(rows):
        if isinstance(row, Mapping):
            missing = [name for name in COLUMNS if name not in row]
            if missing:
                raise SceneError(
                    f"result[{number}]: given a row without {' and '.join(missing)}; allowed: {PLAIN_TABLE}"
                )
            row = [row[name] for name in COLUMNS]
        if not isinstance(row, list | tuple) or len(row) != len(COLUMNS):
            raise scene_error(f"result[{number}]", row, PLAIN_TABLE)
        triples.append(row)
    return [np.array([row[i] for row in triples], dtype=object) for i in range(len(COLUMNS))]


def _draw_table(ax: Axes, names: list[str], run_time: np.ndarray, error: np.ndarray) -> Axes:
    """Draw the rows of a plain table, a marker for each name, and their Pareto front."""
    order = np.argsort(run_time, kind="stable")
    best = np.minimum.accumulate(error[order])
    front = order[(error[order] == best) & np.concatenate([[True], best[1:] < best[:-1]])]
    for i, name in enumerate(dict.fromkeys(names)):
        rows = np.flatnonzero(np.array(names) == name)
        style = _style.style(i, i, rows.size) | {"linestyle": "none", "markevery": 1, "markersize": 6}
        _style.log(ax, run_time[rows], error[rows], name, style)
    if front.size > 1:
        positive = front[error[front] > 0.0]
        ax.plot(
            run_time[positive],
            error[positive],
            "-",
            color="0.5",
            lw=1.0,
            drawstyle="steps-post",
            label="front",
            zorder=1,
        )
    ax.set(xscale="log", yscale="log", xlabel="run time [s]", ylabel="error [1]")
    return _style.finish(ax)
