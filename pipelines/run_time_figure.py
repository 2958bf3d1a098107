"""Figure and table of :mod:`error_against_run_time`."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

#: Errors at which times are compared.
LEVELS = (1e-2, 1e-3, 1e-4)
TITLES = {
    "example2": "Example 2",
    "example3": "Example 3",
    "example4": "Example 4",
    "guy": "unseen: guy in wind",
    "flat": "unseen: long and flat",
}
#: Marker, colour and darkness tell the models apart, so that a grey print does too.
STYLES = {
    ("chain", "velocity_verlet"): ("s", "#003a5c", "chain, explicit"),
    ("chain", "trapezoidal"): ("o", "#0072B2", "chain, implicit"),
    ("cable", "velocity_verlet"): ("D", "#2a7f8f", "cable, explicit"),
    ("cable", "trapezoidal"): ("d", "#56B4E9", "cable, implicit"),
    ("Galerkin", "velocity_verlet"): ("v", "#CC79A7", "Galerkin"),
    ("condensed", "velocity_verlet"): ("^", "#D55E00", "condensed, explicit"),
    ("condensed", "trapezoidal"): ("<", "#E69F00", "condensed, implicit"),
    ("catenary", ""): ("x", "black", "catenaries, splines between"),
}
LINES = {
    "full": ("-", "#003a5c", "front, full"),
    "reduced": ("--", "#a33c00", "front, reduced"),
    "quasi-static": (":", "black", ""),
}


def draw(result: xr.Dataset) -> plt.Figure:
    """Draw error against kernel time, a panel for each scene."""
    names = [str(name) for name in result["scene"].values]
    columns = min(len(names), 3)
    lines = -(-(len(names) + (len(names) > 3)) // columns)
    figure, grid = plt.subplots(
        lines,
        columns,
        figsize=(4.6 * columns, 3.9 * lines),
        sharex=True,
        sharey=True,
        layout="constrained",
        squeeze=False,
    )
    axes = list(grid.flat)
    for ax, name in zip(axes, names, strict=False):
        _panel(ax, result.sel(scene=name))
        several = "," in str(result["trained_on"].sel(scene=name).values)
        ax.set_title(f"{TITLES[name]}; modes from " + ("Examples 2 to 4" if several else "itself"), fontsize=10)
        ax.tick_params(labelbottom=True)
        ax.set_xlabel("kernel time for the run [ms]")
    for row in grid:
        row[0].set_ylabel("largest error over the run [1]")
    handles, labels = axes[0].get_legend_handles_labels()
    for ax in axes[len(names) :]:
        ax.axis("off")
    if len(axes) > len(names):
        axes[-1].legend(handles, labels, fontsize=10, loc="upper center")
        said = (
            "× at 1 %, 0.1 %, 0.01 %: time of the front\n"
            "of full models over that of reduced ones.\n"
            "Small and pale: looked at once, not near a front."
        )
        axes[-1].text(0.5, 0.02, said, ha="center", va="bottom", fontsize=9, transform=axes[-1].transAxes)
    else:
        axes[-1].legend(handles, labels, fontsize=7, loc="lower left")
    return figure


def _panel(ax: plt.Axes, of: xr.Dataset) -> None:
    seconds, error = 1e3 * of["kernel_time"].values, of["error_max"].values
    for (model, scheme), (marker, colour, text) in STYLES.items():
        rows = (of["model"].values == model) & (of["scheme"].values == scheme) & (error < 1.0)
        again = rows & (of["measured_again"].values == 1)
        ax.loglog(seconds[rows & ~again], error[rows & ~again], marker, color=colour, ms=2, alpha=0.25, mew=0.5)
        ax.loglog(seconds[again], error[again], marker, color=colour, ms=4.5, alpha=0.9, mew=1, label=text)
    for family, (style, colour, text) in LINES.items():
        rows = np.flatnonzero((of["on_front"].values == 1) & (of["family"].values == family) & (error < 1.0))
        rows = rows[np.argsort(seconds[rows])]
        # a front is a staircase: between two settings the error is that of the faster one
        ax.loglog(
            seconds[rows],
            error[rows],
            style,
            color=colour,
            lw=1.5,
            drawstyle="steps-post",
            label=text or None,
            zorder=1,
        )
    for level in LEVELS:
        ax.axhline(level, color="0.6", lw=0.6, zorder=0)
        ratio = float(of["time_ratio"].sel(level=level))
        if np.isfinite(ratio):
            text = f"× {ratio:.0f}" if ratio >= 10.0 else f"× {ratio:.1f}"
            ax.annotate(text, (0.98, level), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=9)
    ax.set_ylim(3e-7, 1.0)
    ax.grid(alpha=0.2)


def percent(value: float) -> str:
    """Write a fraction as percent."""
    return f"{100 * value:.2g} %"


def markdown(rows: list[dict[str, Any]]) -> str:
    """Write the table of best full and best reduced models."""
    lines = [
        "| scene | error | best full model | kernel, call | best reduced model | kernel, call | offline "
        "| kernels: full over reduced | calls |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        cells = [TITLES[row["scene"]], "≤ " + percent(row["level"])]
        for family in ("full", "reduced"):
            of = row["best"][family]
            cells += ["none", ""] if of is None else [
                f"{of['name'].values!s}, {float(of['step']):.3g} s",
                f"{_milliseconds(of['kernel_time'])}, {_milliseconds(of['call_time'])} ms",
            ]  # fmt: skip
        of = row["best"]["reduced"]
        cells.append("" if of is None else f"{float(of['offline_time']):.2g} s")
        cells += ["" if np.isnan(row[key]) else f"{row[key]:.3g}" for key in ("ratio", "call_ratio")]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _milliseconds(value: Any) -> str:
    number = 1e3 * float(value)
    return f"{number:.0f}" if number >= 10.0 else f"{number:.2g}"
