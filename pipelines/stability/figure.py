"""Draw the matrix of the stability report."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from cablepod import plots
from cablepod.plots._maps import stability_height


def matrix(result: xr.Dataset) -> Figure:
    """Draw cases down, schemes across, and the limits of explicit steps below."""
    probed = result.sizes["limit_case"]
    parts = [stability_height(result)] + ([0.19 * probed + 0.6] if probed else [])
    figure = plt.figure(figsize=(12.5, sum(parts) + 0.45 + 0.6 * (not probed)), layout="constrained")
    axes = figure.subplots(len(parts), 1, height_ratios=parts, squeeze=False)[:, 0]
    plots.stability(result, ax=axes[0])
    if probed:
        _limits(axes[1], result)
    return figure


def _limits(ax: Axes, result: xr.Dataset) -> None:
    """Draw the found limit of velocity Verlet over the predicted one."""
    found: Any = (result["limit_found"] / result["limit_predicted"]).values
    y = np.arange(found.size)
    ax.axvline(1.0, color="#888888", linewidth=1)
    ax.plot(np.where(np.isfinite(found), found, np.nan), y, "o", color="#0072b2", markersize=5)
    for i in y:
        ax.text(float(found[i]) + 0.015, i, f"{found[i]:.3f}", va="center", fontsize=7.5)
    ax.set_yticks(y, [str(name) for name in result["limit_case"].values], fontsize=8)
    ax.set(ylim=(found.size - 0.5, -0.5), xlim=(0.0, 1.2))
    ax.set_xlabel("step at which velocity Verlet breaks down, over the limit predicted for taut links", fontsize=8.5)
    ax.tick_params(axis="x", labelsize=8)
    ax.grid(axis="x", color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)


def small(figure: Figure, path: Path) -> None:
    """Write a figure of few colours as a small file."""
    picture = BytesIO()
    figure.savefig(picture, dpi=75)
    Image.open(picture).convert("RGB").quantize(32).save(path, optimize=True)
