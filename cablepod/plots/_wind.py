"""Draw gusts, spectra of responses, and cycles of tensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod._inputs import Kind, check_units, taken
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import choice, integer
from cablepod.plots import _style
from cablepod.plots._style import COLOURS, LINES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIELD = "what wind.field gives"
SERIES = "a DataArray over time, such as run.tension.isel(link=-1)"
CYCLES = Kind(
    "what fatigue.ranges gives of one series",
    tuple((f"cycle_{name}", ("cycle",)) for name in ("range", "count", "start", "end")),
)
#: Largest difference of an interval from the mean one, over it, of instants that count as even.
EVEN = 1e-6


def wind_field(wind: xr.Dataset, *, component: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw the velocity of the air over time and height.

    Parameters
    ----------
    wind
        Field of :func:`cablepod.wind.field`; its points lie at different heights.
    component
        "x", "y" or "z"; by default that of the strongest wind.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: time [s] across, height [m] up, velocity [m/s] by colour with a colour bar.  Points of a cable
        whose heights do not rise are drawn over the arc length.

    Raises
    ------
    SceneError
        For another Dataset, a single instant or point, and a missing component.
    """
    array = _by_component(wind, "wind", ("time", "point", "component"))
    names = [str(name) for name in array["component"].values]
    if min(array.shape[:2]) < 2:
        raise scene_error("wind", str(dict(array.sizes)), "two instants and two points at least")
    values = array.values
    if component is None:
        component = names[int(np.square(values).mean(axis=(0, 1)).argmax())]
    choice(*names)("component", component)
    up, label = _heights(wind)
    ax = _style.axes(ax)
    drawn = values[..., names.index(component)].T
    mesh = _style.colour_cells(ax, array["time"].values, up, drawn)
    _style.colour_bar(ax, mesh, f"velocity of the air along {component} [m/s]", drawn)
    ax.set(xlabel="time [s]", ylabel=label)
    return ax


def _heights(wind: xr.Dataset) -> tuple[np.ndarray, str]:
    """Return rising or falling places of the points, and their label."""
    position = _by_component(wind, "position", ("point", "component")) if "position" in wind.variables else None
    if position is not None and "y" in position["component"].values:
        height = position.sel(component="y").values
        change = np.diff(height)
        if (change > 0.0).all() or (change < 0.0).all():
            return height, "height y [m]"
    if "relative_arc_length" in wind.variables:
        return _style.take("wind", wind, "relative_arc_length", ("point",), FIELD).values, _style.SIGMA
    raise SceneError(
        "wind: given points whose heights do not rise; allowed: points one above the other, or along a cable"
    )


def _by_component(wind: xr.Dataset, name: str, dims: tuple[str, ...]) -> xr.DataArray:
    """Return a variable of a field over components."""
    array = _style.take("wind", wind, name, dims, FIELD)
    if array["component"].dims != ("component",):
        raise SceneError(f"wind: given component over {array['component'].dims}; allowed: {FIELD}")
    return array


def spectra(response: xr.DataArray, forcing: xr.DataArray, *, segments: int = 8, ax: Axes | None = None) -> Axes:
    """Draw the spectrum of a response and that of its forcing, such as a tension and the wind.

    Parameters
    ----------
    response, forcing
        Series along ``time`` [s] with equal intervals.
    segments
        Number of segments over which the spectra are averaged; more give smoother curves that begin at a higher frequency.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: frequency n [Hz] across, n S(n) over the variance [1] up, both logarithmic, so that series of
        different units share an axis.

    Raises
    ------
    SceneError
        For anything but series, uneven instants, constant series, and more segments than the series have samples for.

    Notes
    -----
    One-sided spectra S by Welch's method: Hann windows that overlap by half, without the mean of each.

    P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans. Audio Electroacoust. 15, 70
    (1967).
    """
    from scipy.signal import welch  # slow to import

    integer(least=1)("segments", segments)
    curves = []
    for key, given in (("response", response), ("forcing", forcing)):
        time, values = _series(key, given)
        interval = float(time[-1] - time[0]) / (time.size - 1)
        if np.abs(np.diff(time) / interval - 1.0).max() > EVEN:
            raise SceneError(
                f"{key}: given instants at unequal intervals; allowed: equal ones, such as series.interp(time=...)"
            )
        length = 2 * time.size // (segments + 1)
        if length < 8:
            raise scene_error(
                "segments", segments, f"at most {time.size // 4 - 1}, as the {key} has {time.size} samples"
            )
        if np.ptp(values) == 0.0:
            raise SceneError(f"{key}: given a constant series; allowed: one that varies")
        frequency, density = welch(values, 1.0 / interval, nperseg=length)
        curves.append((frequency[1:], frequency[1:] * density[1:] / values.var(), _named(given, key)))
    ax = _style.axes(ax)
    for k, (frequency, density, name) in enumerate(curves):
        ax.plot(frequency, density, color=COLOURS[(3, 1)[k]], linestyle=LINES[k], linewidth=1.2, label=name)
    most = max(float(density.max()) for _, density, _ in curves)
    ax.set(
        xlabel="frequency n [Hz]",
        ylabel="n S(n) over variance [1]",
        xscale="log",
        yscale="log",
        ylim=(1e-6 * most, 2.0 * most),
    )
    ax.grid(alpha=0.3)
    ax.legend(loc="lower left", fontsize="small")  # the long names would leave no room beside the axes
    return ax


def tension_cycles(tension: xr.DataArray, cycles: xr.Dataset, *, count: int = 20, ax: Axes | None = None) -> Axes:
    """Draw a tension over time with its largest rainflow cycles.

    Parameters
    ----------
    tension
        Series along ``time`` [s], such as ``run.tension.isel(link=-1)``.
    cycles
        What :func:`cablepod.fatigue.ranges` gives of it.
    count
        Number of cycles drawn, the largest first.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones: the series in grey, and for each cycle a bar of the height of its range at the reversal with which it
        begins, whole cycles solid, half cycles dashed, coloured by range with a colour bar.

    Raises
    ------
    SceneError
        For anything but a series and its cycles.
    """
    time, values = _series("tension", tension)
    integer(least=1)("count", count)
    checked = taken("cycles", cycles, CYCLES)
    counts, size = checked["cycle_count"].values, checked["cycle_range"].values
    place = [np.searchsorted(time, checked[f"cycle_{name}"].values[counts > 0.0]) for name in ("start", "end")]
    if not all((part < time.size).all() for part in place) or not np.allclose(
        np.abs(values[place[1]] - values[place[0]]), size[counts > 0.0]
    ):
        raise SceneError(
            "cycles: given those of another series; allowed: cycles of the tension, fatigue.ranges(tension)"
        )
    counts, size = counts[counts > 0.0], size[counts > 0.0]
    order = np.argsort(size, kind="stable")[-count:]
    ax = _style.axes(ax)
    ax.plot(time, values, color="0.6", linewidth=0.8, label=_named(tension, "tension"))
    units = tension.attrs.get("units", "N")
    _bars(ax, time, values, [part[order] for part in place], counts[order] == 1.0, units)
    ax.set(xlabel="time [s]")
    _style.label_axis(ax.yaxis, f"{_long_name(tension, 'tension')} [{units}]", values)
    ax.grid(alpha=0.3)
    # below the axes, as the colour bar stands beside them
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, frameon=False)
    return ax


def _bars(
    ax: Axes, time: np.ndarray, values: np.ndarray, place: list[np.ndarray], whole: np.ndarray, units: str
) -> None:
    """Draw cycles as bars from the value at one reversal to that at the other, with their colour bar in the units given."""
    from matplotlib.collections import LineCollection

    begin, end = place
    size = np.abs(values[end] - values[begin])
    drawn: Any = None
    for which, line, name in ((whole, "-", "whole cycles"), (~whole, "--", "half cycles")):
        if which.any():
            bars = [[(time[a], values[a]), (time[a], values[b])] for a, b in zip(begin[which], end[which], strict=True)]
            drawn = LineCollection(bars, cmap="cividis_r", linestyles=line, linewidths=2.0, label=name)
            drawn.set_array(size[which])
            drawn.set_clim(0.0, float(size.max()))
            ax.add_collection(drawn)
    if drawn is not None:
        _style.colour_bar(ax, drawn, f"range of the cycle [{units}]", size)


def _series(key: str, given: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return instants [s] and values of a series along time."""
    if not isinstance(given, xr.DataArray):
        raise scene_error(key, type(given).__name__, SERIES)
    if given.dims != ("time",) or "time" not in given.coords or given.sizes["time"] < 3:
        raise SceneError(f"{key}: given {dict(given.sizes)}; allowed: {SERIES}, of at least three instants")
    check_units(f"{key}: time", given["time"], "s")
    time, values = given["time"].values, given.values
    if time.dtype.kind not in "iuf" or values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise SceneError(f"{key}: given values that are not finite numbers; allowed: {SERIES}")
    if not (np.diff(time) > 0.0).all() or not np.isfinite(time).all():
        raise SceneError(f"{key}: given instants that do not rise; allowed: rising instants [s]")
    return time.astype(float), values.astype(float)


def _long_name(series: xr.DataArray, otherwise: str) -> str:
    """Return the long name of a series."""
    return str(series.attrs.get("long_name", series.name or otherwise))


def _named(series: xr.DataArray, otherwise: str) -> str:
    """Return the long name of a series, with its place where one was picked."""
    places = [
        f"{name} {series[name].values}"
        for name in ("link", "point", "component")
        if name in series.coords and not series[name].dims
    ]
    return ", ".join([_long_name(series, otherwise), *places])
