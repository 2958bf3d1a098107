"""Draw the fronts of error against run time and write their tables."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from _study import markdown_table, percent, short
from matplotlib import pyplot as plt

import cablepod as cp

#: Errors at which times are compared.
LEVELS = (1e-2, 1e-3, 1e-4)
TITLES = {
    "example2": "Example 2",
    "example3": "Example 3",
    "example4": "Example 4",
    "guy": "unseen: guy in wind",
    "flat": "unseen: long and flat",
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
    axes, shown = list(grid.flat), {}
    for ax, name in zip(axes, names, strict=False):
        cp.plots.error_against_run_time(result, scene=name, ax=ax)
        shown |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
        ax.get_legend().remove()
        several = "," in str(result["trained_on"].sel(scene=name).values)
        ax.set_title(f"{TITLES[name]}; modes from " + ("Examples 2 to 4" if several else "itself"), fontsize=10)
        ax.tick_params(labelbottom=True)
        if ax not in grid[:, 0]:
            ax.set_ylabel("")
    axes[0].set_ylim(3e-7, 1.0)  # of all, which share it
    for ax in axes[len(names) :]:
        ax.axis("off")
    if len(axes) > len(names):
        axes[-1].legend(list(shown.values()), list(shown), fontsize=8, labelspacing=0.35, loc="upper center")
        said = (
            "× at 1 %, 0.1 %, 0.01 %: time of the front\n"
            "of full models over that of reduced ones.\n"
            "Small and pale: looked at once, not near a front."
        )
        axes[-1].text(0.5, 0.02, said, ha="center", va="bottom", fontsize=9, transform=axes[-1].transAxes)
    else:
        axes[-1].legend(list(shown.values()), list(shown), fontsize=7, loc="lower left")
    return figure


def markdown(rows: list[dict[str, Any]]) -> str:
    """Write the table of the best full and the best reduced models."""
    head = (
        "scene", "error", "best full model", "kernel, call", "best reduced model", "kernel, call", "offline",
        "kernels: full over reduced", "calls",
    )  # fmt: skip
    lines = []
    for row in rows:
        cells = [TITLES[row["scene"]], "≤ " + percent(row["level"])]
        for family in ("full", "reduced"):
            of = row["best"][family]
            cells += ["none", ""] if of is None else _setting_and_times(of)
        of = row["best"]["reduced"]
        cells.append("" if of is None else f"{float(of['offline_time']):.2g} s")
        cells += ["" if np.isnan(row[key]) else f"{row[key]:.3g}" for key in ("ratio", "call_ratio")]
        lines.append(cells)
    return markdown_table(head, lines)


def markdown_of_first_page(rows: list[dict[str, Any]]) -> str:
    """Write the kernel times and ratios at the largest error level, for the README of the repository."""
    head = ("scene", "full model, kernel", "reduced model, kernel", "kernels, full / reduced", "calls, full / reduced")
    lines = [
        [
            TITLES[row["scene"]],
            *(f"{short(1e3 * float(row['best'][family]['kernel_time']))} ms" for family in ("full", "reduced")),
            *(f"{row[key]:.3g}" for key in ("ratio", "call_ratio")),
        ]
        for row in rows
        if row["level"] == max(LEVELS) and not np.isnan(row["ratio"])
    ]
    return markdown_table(head, lines)


def _setting_and_times(of: xr.Dataset) -> list[str]:
    name = f"{of['name'].values!s}, {float(of['step']):.3g} s"
    return [name, f"{short(1e3 * float(of['kernel_time']))}, {short(1e3 * float(of['call_time']))} ms"]
