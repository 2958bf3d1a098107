"""Draw maps of a quantity over two parameters."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod._inputs import MAPPED, powers, taken
from cablepod.conventions import VARIABLES
from cablepod.errors import SceneError, scene_error
from cablepod.integrate._peak_error import MAX_PEAK_ERROR, along_members, peak_errors, slack_members
from cablepod.parameters._checks import truth
from cablepod.parameters._key_paths import key_of_variable, variable_name
from cablepod.plots import _style
from cablepod.reduced._validity import MAX_ESTIMATED_ERROR

if TYPE_CHECKING:
    from matplotlib.axes import Axes


#: Time error above which a run or a member has not converged, for results that do not say theirs (ensembles do).
LARGEST_TIME_ERROR = 1e-2


def parameter_map(
    result: xr.Dataset,
    variable: str,
    *,
    x: str,
    y: str,
    contours: bool = False,
    hertz: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw a quantity over two parameters.

    Parameters
    ----------
    result
        With `variable` over the dimensions `x` and `y`, or with all three along ``member`` as in results of ensembles.
    variable
        Name of a numeric variable.  Of "tension_maximum" the largest over all links is drawn, of "tension_minimum" the smallest;
        of "guy_tension_maximum", "fatigue_range" and "utilisation" the largest over all guys of a mast, of
        "guy_tension_minimum" the smallest.
    x, y
        Names of two numeric parameters, or their key paths.
    contours
        Draw labelled contour lines if the parameters form a full grid; they look smoother than few cells are.
    hertz
        Draw angular frequencies as frequencies in Hz.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones, with a colour bar: a map for a full grid of at least three by three, otherwise a dot for each member.
        Members of ensembles are marked: by crosses those without a result, by hatches (squares around dots) those whose estimated
        time error is above ``accepted_time_error`` (0.01 without this attribute) or whose reduced model expects an error above
        half the motion, by white dots those that go slack.  In a map of the largest tension members are not marked whose
        estimated time error of this tension is below a hundredth of it, though the motion has not converged.  The title tells
        the marks that occur, and how many members have no `x` or `y` and are left out.  Labels are long names and units of the
        variables; forces from 1 kN on are in kN.

    Raises
    ------
    SceneError
        For missing variables, for other dimensions, and for members that share a pair of x and y, as where a third parameter
        varies over a grid: their dots would hide each other.
    """
    x, y = (variable_name(name) if isinstance(name, str) else name for name in (x, y))
    result = taken("result", result, MAPPED)
    contours, hertz = truth("contours", contours), truth("hertz", hertz)
    across, up, values = _flat_columns(result, variable, x, y)
    lacking = ~(np.isfinite(across) & np.isfinite(up))
    if lacking.any() and not lacking.all() and result.sizes.get("member") == lacking.size:
        result = result.isel(member=~lacking)
        across, up, values = _flat_columns(result, variable, x, y)
    _check_pairs(result, across, up, x, y)
    in_hertz = [hertz and result[name].attrs.get("units") == "rad s-1" for name in (x, y)]
    across, up = (part / (2.0 * np.pi) if of else part for part, of in zip((across, up), in_hertz, strict=True))
    ax = _style.axes(ax)
    missing = ~np.isfinite(values)
    columns, rows = np.unique(across), np.unique(up)
    order = np.lexsort((across, up))
    full = [np.tile(columns, rows.size), np.repeat(rows, columns.size)]
    is_grid = across.size == columns.size * rows.size and min(columns.size, rows.size) > 2
    if is_grid and np.array_equal(across[order], full[0]) and np.array_equal(up[order], full[1]):
        table = np.ma.masked_invalid(values[order].reshape(rows.size, columns.size))
        drawn: Any = _style.colour_cells(ax, columns, rows, table)
    else:
        table = np.ma.masked_all(0)
        drawn = ax.scatter(across[~missing], up[~missing], c=values[~missing], cmap="cividis", edgecolors="0.4", s=36)
    factor = _style.colour_bar(ax, drawn, _label(result, variable), values)
    if contours and table.count() > 3 and table.max() > table.min():
        lines = ax.contour(columns, rows, table, levels=6, linewidths=0.8)
        middle = 0.5 * (float(table.max()) + float(table.min()))
        colours = ["white" if level < middle else "black" for level in lines.levels]  # on dark and on light areas
        lines.set_edgecolor(colours)
        as_on_bar = None if factor == 1.0 else lambda level: f"{factor * level:.4g}"
        ax.clabel(lines, fontsize=8, colors=colours, fmt=as_on_bar)
    for axis, name, drawn_values, of in ((ax.xaxis, x, across, in_hertz[0]), (ax.yaxis, y, up, in_hertz[1])):
        _style.label_axis(axis, _label(result, name, hertz=of), drawn_values)
    marks = [f"{lacking.sum()} members without {x} or {y} left out"] if across.size < lacking.size else []
    if missing.any():
        ax.plot(across[missing], up[missing], "x", color=_style.COLOURS[1], markersize=6)
        marks.append("crosses: no result")
    marks += _mark_doubtful(ax, result, variable, across, up, drawn)
    title = [textwrap.fill(str(result.attrs["title"]), 70)] if "title" in result.attrs else []
    ax.set_title("\n".join([*title, *(["; ".join(marks)] if marks else [])]), fontsize="medium")
    return ax


def _mark_doubtful(
    ax: Axes, result: xr.Dataset, variable: str, across: np.ndarray, up: np.ndarray, drawn: Any
) -> list[str]:
    """Mark members that have not converged in time, and those that go slack; return the texts of the marks."""
    count = result.sizes.get("member")
    if count != across.size:
        return []
    errors = [along_members(result, name) for name in ("time_error_estimate", "tension_time_error_estimate")]
    accepted = float(result.attrs.get("accepted_time_error", LARGEST_TIME_ERROR))
    wrong = along_members(result, "error_estimate") > MAX_ESTIMATED_ERROR
    late = (errors[0] > accepted) | (errors[1] > accepted)
    if variable == "tension_maximum":  # it may have converged where the motion, or another tension, has not
        of_peak = peak_errors(result)
        late &= np.isnan(of_peak) | (of_peak > MAX_PEAK_ERROR)
    doubtful = late | wrong
    text = "not converged in time" + (f", or model error above {100 * MAX_ESTIMATED_ERROR:g} %" if wrong.any() else "")
    slack = slack_members(result)
    marks = []
    if doubtful.any():
        if hasattr(drawn, "get_coordinates"):
            which = np.searchsorted(np.unique(up), up[doubtful]), np.searchsorted(np.unique(across), across[doubtful])
            _style.hatch_cells(ax, drawn, which, _style.COLOURS[1])
            marks.append(f"hatched: {text}")
        else:
            ax.plot(across[doubtful], up[doubtful], "s", color=_style.COLOURS[1], markerfacecolor="none", markersize=10)
            marks.append(f"squares: {text}")
    if slack.any():
        look: dict[str, Any] = {"markeredgecolor": "black", "markeredgewidth": 0.6, "markersize": 3.0}
        ax.plot(across[slack], up[slack], "o", color="white", **look)
        marks.append("white dots: slack at times")
    return marks


def _flat_columns(result: xr.Dataset, variable: str, x: str, y: str) -> tuple[np.ndarray, ...]:
    """Return two parameters and a quantity as flat arrays of equal length."""
    kinds = {str(name): column.dtype for name, column in result.variables.items()}
    numbers = [name for name, kind in kinds.items() if kind.kind in "iu" or (kind.kind == "f" and kind.itemsize >= 4)]
    for key, name in (("variable", variable), ("x", x), ("y", y)):
        if not isinstance(name, str) or name not in numbers:
            raise scene_error(key, name, "a variable of numbers: " + ", ".join(numbers))
        own = scene_key.units if (scene_key := key_of_variable(name)) else VARIABLES.get(name, (None,))[0]
        units = result[name].attrs.get("units")
        if own is not None and units is not None and powers(str(units)) != powers(own):
            raise SceneError(f"{key}: given {name} in {units}; allowed: {own}, the units of the package")
    array = result[variable]
    dim, extreme = _style.OVER_PLACES.get(variable, ("", None))
    if extreme is not None and array.dims == ("member", dim) and array.size:
        array = array.reduce(extreme, dim)
    if x != y and set(array.dims) == {x, y} and array.size:
        array = array.transpose(y, x)
        across, up = np.meshgrid(result[x].values, result[y].values)
        return across.ravel(), up.ravel(), array.values.ravel().astype(float)
    if not (array.dims == result[x].dims == result[y].dims == ("member",)) or not array.size:
        raise SceneError(
            f"variable: given {variable} {dict(array.sizes)}, {x} {dict(result[x].sizes)}, {y} {dict(result[y].sizes)}; "
            "allowed: one number for each pair of x and y, or all three along member"
        )
    return result[x].values, result[y].values, array.values.astype(float)


def _check_pairs(result: xr.Dataset, across: np.ndarray, up: np.ndarray, x: str, y: str) -> None:
    """Refuse members that share a pair of x and y."""
    pairs, counts = np.unique(np.stack([across, up]), axis=1, return_counts=True)
    most = int(counts.argmax())
    if counts[most] == 1:
        return
    here = np.flatnonzero((across == pairs[0, most]) & (up == pairs[1, most]))
    others = [
        str(name)
        for name, column in result.coords.items()
        if column.dims == ("member",) and name not in ("member", x, y) and len(set(column.values[here].tolist())) > 1
    ]
    cure = "pick some with .isel(member=...)"
    if others:
        value = result[others[0]].values[here[0]]
        shown_value = repr(str(value)) if result[others[0]].dtype.kind not in "if" else f"{value:.6g}"
        names, part = ", ".join(others), f"result.{others[0]}.values == {shown_value}"
        cure = f"one map for each value of {names}, as of result.isel(member={part})"
    raise scene_error(
        "result",
        f"{counts[most]} members at {x} = {pairs[0, most]:.6g}, {y} = {pairs[1, most]:.6g}",
        f"one a pair; {cure}",
    )


#: End of the long name of extremes, which has no place on an axis.
BETWEEN_STEPS = ", not at output times between them"


def _label(result: xr.Dataset, name: str, *, hertz: bool = False) -> str:
    """Return long name and units of a variable; what is drawn of all links has no link of its own."""
    attrs = result[name].attrs
    text, units = str(attrs.get("long_name", name.replace("_", " "))), str(attrs.get("units", "1"))
    text = text.replace(" of the link over all steps", " anywhere, over all steps").removesuffix(BETWEEN_STEPS)
    if name in _style.OVER_PLACES and "guy" in result[name].dims:
        text = text.replace("of the guy", "of all guys")
    return f"{text.replace('angular frequency', 'frequency')} [Hz]" if hertz else f"{text} [{units}]"
