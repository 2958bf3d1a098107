"""Draw stringing tables: a quantity of a cable over temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING

import xarray as xr

from cablepod.errors import scene_error
from cablepod.plots import _style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TABLE = "what catenary.stringing gives"


def stringing(table: xr.Dataset, *, variable: str = "tension_upper", ax: Axes | None = None) -> Axes:
    """Draw a quantity of a cable over temperature, a line for each case.

    Parameters
    ----------
    table
        Result of :func:`cablepod.catenary.stringing`.
    variable
        Name of a variable over ``temperature``; of "angular_frequency" and "frequency" the first is drawn.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones.

    Raises
    ------
    SceneError
        For another Dataset, and a variable that it lacks.
    """
    if isinstance(table, xr.Dataset) and (not isinstance(variable, str) or variable not in table.data_vars):
        over = [str(name) for name, array in table.data_vars.items() if "temperature" in array.dims]
        if over:
            raise scene_error("variable", variable, f"one of {', '.join(over)}")
    if isinstance(table, xr.Dataset) and table.sizes.get("mode"):
        table = table.isel(mode=0, drop=True)
    values = _style.take("table", table, variable, ("temperature",), TABLE, more=1)
    temperature = _style.take("table", table, "temperature", ("temperature",), TABLE)
    ax = _style.axes(ax)
    for k, (name, part) in enumerate(_style.sets(values, 1)):
        label = name or str(table.attrs.get("air", "")) or None
        ax.plot(temperature.values, part, label=label, **_style.style(k, k, part.size))
    ax.set_xlabel("temperature [°C]")
    _style.label_axis(ax.yaxis, _style.label_of(values), values.values)
    if isinstance(title := table.attrs.get("title"), str):
        ax.set_title(title.removesuffix(": stringing"), fontsize="medium")
    return _style.finish(ax)
