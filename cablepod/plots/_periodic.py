"""Draw periodic responses: branches over frequency, backbones, maps of stability, multipliers."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from cablepod.conventions import INTERRUPTED
from cablepod.errors import SceneError
from cablepod.parameters._checks import text, truth
from cablepod.plots import _style
from cablepod.plots._orbits import ORBIT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Kind of a bifurcation -> marker, colour.
BIFURCATIONS = {
    "fold": ("o", "#000000"),
    "pitchfork": ("s", "#0072B2"),
    "period_doubling": ("^", "#D55E00"),
    "torus": ("D", "#CC79A7"),
}
#: Growth rate over the angular frequency of the forcing that counts as none, 1e-9 over a period (without damping it is rounding).
ROUNDING = 1e-9 / (2.0 * np.pi)
RESPONSE = "what periodic.frequency_response gives"
BACKBONE = "what periodic.backbone gives"
MAP = "what periodic.stability_map gives"


def frequency_response(
    response: xr.Dataset,
    *,
    backbone: xr.Dataset | None = None,
    variable: str = "deflection_maximum",
    hertz: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw branches over the frequency of the forcing: stable parts solid, unstable ones dashed, bifurcations as markers.

    Parameters
    ----------
    response
        Result of :func:`cablepod.periodic.frequency_response`.
    backbone
        Result of :func:`cablepod.periodic.backbone`, drawn as a grey line.
    variable
        Name of a variable over ``point``; markers of bifurcations are drawn with "deflection_maximum" only.  Of "tension_maximum"
        the largest over all links is drawn, of "tension_minimum" the smallest.
    hertz
        Draw frequencies in Hz.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    text("variable", variable)
    truth("hertz", hertz)
    if variable in _style.OVER_PLACES and isinstance(response, xr.Dataset):
        dim, reduce = _style.OVER_PLACES[variable]
        extreme = _style.take("response", response, variable, ("point", dim), RESPONSE)
        response = response.assign({variable: extreme.reduce(reduce, dim).assign_attrs(extreme.attrs)})
    columns = {
        name: _style.take("response", response, name, ("point",), RESPONSE)
        for name in ("angular_frequency", "branch", "stable", "periods", variable)
        if name != "periods" or name in response
    }
    ax = _style.axes(ax)
    if backbone is not None:
        free, size = (
            _style.take("backbone", backbone, name, ("point",), BACKBONE) for name in ("angular_frequency", "amplitude")
        )
        ax.plot(_scale(hertz) * free.values, size.values, color="0.7", linewidth=3.0, label="free vibration", zorder=1)
    omega, values = _scale(hertz) * columns["angular_frequency"].values, columns[variable].values
    stable, branch = columns["stable"].values.astype(bool), columns["branch"].values
    for k, number in enumerate(np.unique(branch)):
        which = np.flatnonzero(branch == number)
        drawn: dict[str, Any] = {"color": _style.COLOURS[(0, 3, 1, 5, 6, 4, 2)[k % 7]], "linewidth": 1.3 + k // 7}
        for begin, end, solid in _runs(stable[which]):
            part = which[begin : min(end + 1, which.size)]  # up to the first point of the next part
            ax.plot(omega[part], values[part], "-" if solid else "--", **drawn, zorder=2)
        periods = columns["periods"].values[which[0]] if "periods" in columns else 1
        suffix = f", {periods:.0f} periods" if periods > 1 else ""
        ax.plot([], [], "-", **drawn, label=f"branch {number}{suffix}")
    if variable == "deflection_maximum" and "bifurcation_kind" in response:
        _bifurcations(ax, response, _scale(hertz))
    ax.plot([], [], "--", color="0.4", label="unstable")
    ax.set_xlabel(_of_forcing(hertz))
    _style.label_axis(ax.yaxis, _label(columns[variable]), values)
    return _style.finish(ax)


def _scale(hertz: bool) -> float:
    """Return the factor from rad/s to the unit of the axis."""
    return 0.5 / np.pi if hertz else 1.0


def _of_forcing(hertz: bool) -> str:
    """Return the label of the axis of frequencies."""
    return "frequency of the forcing [Hz]" if hertz else "angular frequency of the forcing [rad/s]"


def _bifurcations(ax: Axes, response: xr.Dataset, scale: float) -> None:
    """Draw bifurcations as markers, their frequencies times `scale`."""
    kinds = _style.texts("response", response, "bifurcation_kind", ("bifurcation",), RESPONSE)
    for kind, (marker, colour) in BIFURCATIONS.items():
        which = kinds == kind
        if which.any():
            place = [
                _style.take("response", response, f"bifurcation_{axis}", ("bifurcation",), RESPONSE).values[which]
                for axis in ("angular_frequency", "deflection_maximum")
            ]
            place[0] = scale * place[0]
            ax.plot(
                *place, marker, color=colour, markerfacecolor="white", markersize=6, label=kind.replace("_", " "), zorder=3,
            )  # fmt: skip


def _runs(stable: np.ndarray) -> list[tuple[int, int, bool]]:
    """Split truth values into runs of equal ones: first, last plus one, value."""
    changes = [0, *(np.flatnonzero(np.diff(stable.astype(int))) + 1), stable.size]
    return [(int(a), int(b), bool(stable[a])) for a, b in pairwise(changes) if b > a]


def _label(array: xr.DataArray) -> str:
    """Return long name and units of a variable, as far as they do not follow from the figure."""
    text = _style.label_of(array).replace("normal to the chord, ", "")
    return text.replace(" of the link over", " anywhere over")


def backbone(*backbones: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw frequencies of free vibrations over their amplitude.

    Parameters
    ----------
    backbones
        Results of :func:`cablepod.periodic.backbone`.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones.

    Raises
    ------
    SceneError
        For another Dataset, and for none.
    """
    if not backbones:
        raise SceneError(f"backbones: given none; allowed: {BACKBONE}")
    lines = [
        [
            _style.take("backbones", one, name, ("point",), BACKBONE).values
            for name in ("angular_frequency", "amplitude")
        ]
        for one in backbones
    ]
    ax = _style.axes(ax)
    for k, (omega, size) in enumerate(lines):
        attrs = backbones[k].attrs
        label = str(attrs.get("title", f"backbone {k + 1}"))
        if {"mode", "motion"} <= attrs.keys():
            label += f", mode {attrs['mode']}, {attrs['motion']}"
        ax.plot(omega, size, label=label, **_style.style(k, k, omega.size))
    ax.set(xlabel="angular frequency of the free vibration [rad/s]", ylabel="largest deflection from its mean [m]")
    return _style.finish(ax)


def stability_map(result: xr.Dataset, *, variable: str = "growth", hertz: bool = False, ax: Axes | None = None) -> Axes:
    """Draw a map of stability over frequency and amplitude of the forcing.

    Parameters
    ----------
    result
        Result of :func:`cablepod.periodic.stability_map`.
    variable
        "growth", the larger rate of both sets where it is positive, "growth_in_plane", "growth_out_of_plane" or "response".
    hertz
        Draw frequencies in Hz.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones, with a colour bar: white where all disturbances decay, brighter where they grow faster; edges of stable
        regions as lines of dots, crosses where there is no response, grey where Ctrl-C left points out.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    text("variable", variable)
    truth("hertz", hertz)
    dims = ("amplitude", "angular_frequency")
    first = _style.take("result", result, "growth_in_plane" if variable == "growth" else variable, dims, MAP)
    values, label = first.values, _label(first)
    if variable == "growth":
        if "growth_out_of_plane" in result:
            values = np.fmax(values, _style.take("result", result, "growth_out_of_plane", dims, MAP).values)
        label = label.replace(" in the plane", "")
    amplitude, frequency = (_style.take("result", result, name, (name,), MAP) for name in dims)
    ax = _style.axes(ax)
    omega, size = _scale(hertz) * frequency.values, amplitude.values
    unstable = values > ROUNDING * frequency.values
    drawn_values = values if variable == "response" else np.where(unstable, values, np.nan)
    drawn = _style.colour_cells(ax, omega, size, np.ma.masked_invalid(drawn_values))
    _style.colour_bar(ax, drawn, label, values)
    if "edge_set" in result and variable != "response":
        for name, colour in (("in_plane", _style.COLOURS[1]), ("out_of_plane", _style.COLOURS[0])):
            which = _style.texts("result", result, "edge_set", ("edge",), MAP) == name
            if which.any() and variable in ("growth", f"growth_{name}"):
                edge = [
                    _style.take("result", result, f"edge_{axis}", ("edge",), MAP).values[which] for axis in dims[::-1]
                ]
                edge[0] = _scale(hertz) * edge[0]
                ax.plot(*edge, ".", color=colour, markersize=2, label=f"edge, {name.replace('_', ' ')}")
    left_out = np.zeros(values.shape, dtype=bool)
    if "failure" in result:
        left_out = _style.texts("result", result, "failure", dims, MAP) == INTERRUPTED
    missing = np.argwhere(np.isnan(values) & ~left_out)
    if missing.size:
        ax.plot(
            omega[missing[:, 1]], size[missing[:, 0]], "x", color=_style.COLOURS[6], markersize=3, label="no response"
        )
    ax.set(xlabel=_of_forcing(hertz), ylabel=_label(amplitude))
    handles, labels = ax.get_legend_handles_labels()
    from matplotlib.patches import Patch

    if left_out.any():
        grey: dict[str, Any] = {"cmap": "gray", "vmin": 0.0, "vmax": 1.0, "shading": "nearest", "rasterized": True}
        ax.pcolormesh(omega, size, np.where(left_out, 0.8, np.nan), **grey)
        handles.append(Patch(facecolor="0.8"))
        labels.append("not computed")
    if variable != "response":
        handles.insert(0, Patch(facecolor="white", edgecolor="0.5"))
        labels.insert(0, "stable")
    if labels:  # below, where it hides no edge
        place: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14)}
        ax.legend(handles, labels, **place, ncols=4, fontsize="small", markerscale=3, frameon=False)
    return ax


def multipliers(result: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw Floquet multipliers in the complex plane, with the unit circle.

    Parameters
    ----------
    result
        Result of :func:`cablepod.periodic.orbit`, or of :func:`cablepod.periodic.frequency_response`, of which all points are
        drawn.
    ax
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`, or new ones.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    real, imag = (
        _style.take("result", result, f"multiplier_{part}", ("multiplier",), ORBIT, more=1).values.ravel()
        for part in ("real", "imag")
    )
    ax = _style.axes(ax, size=_style.EQUAL_SIZE)
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(np.cos(angle), np.sin(angle), color="0.6", linewidth=1.0)
    outside = np.hypot(real, imag) > 1.0 + 1e-7
    size = 5 if real.size <= 64 else 2
    ax.plot(
        real[~outside], imag[~outside], "o", color=_style.COLOURS[3], markersize=size, label="inside or on the circle"
    )
    if outside.any():
        ax.plot(real[outside], imag[outside], "s", color=_style.COLOURS[1], markersize=size, label="outside: unstable")
    ax.set(xlabel="real part [1]", ylabel="imaginary part [1]")
    ax.set_aspect("equal", adjustable="datalim")
    return _style.finish(ax)
