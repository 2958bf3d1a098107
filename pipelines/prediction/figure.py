"""Draw quantiles of the errors over the number of modes, by training set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

TITLES = {
    "example 2": "modes of Example 2", "designed": "modes of ten designed chains", "itself": "each scene's own modes",
    "static and vibration": "static and vibration modes", "sines": "sine modes",
}  # fmt: skip
WIDE, NARROW, LINE = "#c6dff0", "#7db4d8", "#0b3c5d"
LEAST = 1e-6


def quantiles(values: np.ndarray, levels: tuple[float, ...]) -> np.ndarray:
    """Return quantiles of errors, infinite ones included, by linear interpolation between finite ones."""
    known = np.sort(values[~np.isnan(values)])
    if known.size == 0:
        return np.full(len(levels), np.nan)
    place = np.array(levels) * (known.size - 1)
    low, high = known[np.floor(place).astype(int)], known[np.ceil(place).astype(int)]
    with np.errstate(invalid="ignore"):
        between = low + (place - np.floor(place)) * (high - low)
    return np.where(np.isfinite(high), np.where(low == high, low, between), high)


def draw_errors(result: xr.Dataset, path: Path) -> None:
    """Draw the errors of a report into a file."""
    regular = result.sel(scene=result["apart"].values == "")
    names = [str(name) for name in result["training_set"].values if name in TITLES]
    picture, axes = plt.subplots(1, len(names), figsize=(15, 4.3), sharex=True, sharey=True, layout="constrained")
    for ax, name in zip(axes, names, strict=True):
        _panel(ax, regular.sel(training_set=name), name)
    axes[0].set_ylabel("largest error over time, over the motion [1]")
    axes[0].set_ylim(LEAST, 1.0)
    entries: dict[str, Any] = {}
    for ax in axes:  # the first lacks some orders
        entries = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True)) | entries
    axes[-1].legend(entries.values(), entries.keys(), fontsize=8, loc="lower left")
    picture.supxlabel("number of modes r [1]", fontsize=10)
    picture.savefig(path, dpi=75)
    plt.close(picture)


def _panel(ax: Axes, part: xr.Dataset, name: str) -> None:
    rank = part["rank"].values
    levels = (0.05, 0.25, 0.5, 0.75, 0.95, 1.0)

    def spread(values: xr.DataArray) -> np.ndarray:
        return np.clip([quantiles(values.sel(rank=r).values, levels) for r in rank], LEAST, 10.0).T

    low, lower, middle, upper, high, top = spread(part["error"].sel(order="inertial"))
    ax.fill_between(rank, low, high, color=WIDE, lw=0, label="90 % of the scenes")
    ax.fill_between(rank, lower, upper, color=NARROW, lw=0, label="half of them")
    ax.semilogy(rank, middle, "o-", color=LINE, ms=4, label="median, inertial order")
    ax.semilogy(rank, top, "v", color=LINE, ms=4, mfc="white", label="largest")
    for order, style in (("leading", "--"), ("exact", "-.")):
        values = part["error"].sel(order=order)
        if not values.isnull().all():
            ax.semilogy(rank, spread(values)[2], style, color="black", lw=1, label=f"median, {order} order")
    ax.semilogy(rank, spread(part["projection_error"])[2], ":", color="black", lw=1.2, label="median, projection")
    ax.set_title(TITLES[name], fontsize=10)
    ax.set_xticks(rank)
    ax.grid(alpha=0.3)
