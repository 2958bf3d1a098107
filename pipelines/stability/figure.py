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
from matplotlib.patches import Patch, Rectangle
from PIL import Image

from cablepod.errors import SceneError

Look = tuple[str, str, str, str]
#: Class or state -> letter, fill, hatch, colour of the text (distinct in grey, no red against green).
CLASSES: dict[str, Look] = {
    "accurate": ("A", "#cfe6f5", "", "black"),
    "inaccurate": ("I", "#f0c64f", "", "black"),
    "refused": ("R", "#ffffff", "////", "black"),
    "stopped": ("S", "#b5521b", "", "white"),
    "broken": ("BROKEN", "#000000", "", "white"),
    "another model": ("", "#ffffff", "", "#666666"),
}
STATES: dict[str, Look] = {
    "met": ("A", "#cfe6f5", "", "black"),
    "missed with a warning": ("W", "#f0c64f", "", "black"),
    "missed": ("MISSED", "#000000", "", "white"),
    "truth too coarse": ("?", "#f0c64f", "", "black"),
    "no single truth": ("-", "#ffffff", "", "#666666"),
    "not tried": ("", "#ffffff", "", "#666666"),
}
SHORT = {
    "velocity_verlet": "velocity\nVerlet",
    "generalized_alpha": "generalized\nalpha",
    "energy_momentum": "energy-\nmomentum",
    "rattle": "rigid links,\nRATTLE",
    "index1": "rigid links,\nindex 1",
}
INITIAL = {"velocity_verlet": "V", "trapezoidal": "T", "generalized_alpha": "G", "energy_momentum": "E", "rattle": "R"}
OF_CASES = ("outcome", "error", "energy_drift", "kept", "group", "chaotic")
OF_TOLERANCES = ("tolerance_state", "tolerance_error", "tolerance_scheme")
#: Height of a row, and of headings and legend [inch].
ROW, FRAME = 0.235, 1.45


def matrix(result: xr.Dataset) -> Figure:
    """Draw cases down, schemes across, and the limits of explicit steps below."""
    probed = result.sizes["limit_case"]
    parts = [stability_height(result)] + ([0.19 * probed + 0.6] if probed else [])
    figure = plt.figure(figsize=(12.5, sum(parts) + 0.45 + 0.6 * (not probed)), layout="constrained")
    axes = figure.subplots(len(parts), 1, height_ratios=parts, squeeze=False)[:, 0]
    stability(result, axes[0])
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


# --- matrix of the cases ----------------------------------------------------------------------------------------------


def stability(result: xr.Dataset, ax: Axes) -> Axes:
    """Draw cases down, schemes across, classes as colours and letters; the legend explains letters and numbers.

    The Dataset has over (case, scheme) the class ``outcome``, ``error``, ``energy_drift`` and ``kept`` [1], over (case,
    wanted_error) the outcome of a tolerance, and names of classes and states as attributes.

    Raises
    ------
    SceneError
        For another Dataset.
    """
    for name in (*OF_CASES, *OF_TOLERANCES):
        if not isinstance(result, xr.Dataset) or name not in result:
            raise SceneError(
                f"result: given a {type(result).__name__} without {name}; allowed: what pipelines/stability/run.py writes"
            )
    headings, rows = _row_heights(result)
    bottom = float(rows[-1]) + 1.0
    _frame(ax, result, headings, rows, bottom)
    classes, states = result.attrs["classes"].split(", "), result.attrs["states"].split(", ")
    schemes = result.sizes["scheme"]
    for i, y in enumerate(rows):
        for j in range(schemes):
            look = CLASSES[classes[int(result["outcome"].values[i, j])]]
            _cell(ax, j, y, look, _scheme_text(result, i, j, look[0]))
        for j in range(result.sizes["wanted_error"]):
            look = STATES[states[int(result["tolerance_state"].values[i, j])]]
            _cell(ax, schemes + 0.25 + j, y, look, _tolerance_text(result, i, j, look[0]))
    return ax


def stability_height(result: xr.Dataset) -> float:
    """Return the height of a figure of the stability matrix [inch]."""
    return (float(_row_heights(result)[1][-1]) + 1.0) * ROW + FRAME


def _number(value: float) -> str:
    """Write a number with one significant digit."""
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _row_heights(result: xr.Dataset) -> tuple[list[tuple[float, str]], np.ndarray]:
    """Return (height, text) of the group headings, and heights of the rows."""
    headings, rows, height, last = [], [], 0.0, ""
    for group in result["group"].values:
        if group != last:
            headings.append((height, str(group)))
            height, last = height + 0.8, group
        rows.append(height)
        height += 1.0
    return headings, np.array(rows)


def _cell(ax: Axes, x: float, y: float, look: Look, text: str) -> None:
    """Draw one cell, its top left corner at (x, y)."""
    _, fill, hatch, colour = look
    frame: dict[str, Any] = {"facecolor": fill, "edgecolor": "#999999", "hatch": hatch, "linewidth": 0.4}
    ax.add_patch(Rectangle((x + 0.02, y + 0.04), 0.96, 0.92, **frame))
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8} if hatch else None
    ax.text(x + 0.5, y + 0.52, text, ha="center", va="center", fontsize=7.5, color=colour, bbox=box)


def _scheme_text(result: xr.Dataset, i: int, j: int, letter: str) -> str:
    """Return letter, error and energy drift, or the completed part of a stopped run."""
    error, drift = (float(result[key].values[i, j]) for key in ("error", "energy_drift"))
    if letter == "S":
        return f"S  at {100 * float(result['kept'].values[i, j]):.0f} %"
    text = letter if np.isnan(error) else f"{letter}  {_number(error)}"
    return text if np.isnan(drift) else f"{text}  ΔE {_number(drift)}"


def _tolerance_text(result: xr.Dataset, i: int, j: int, letter: str) -> str:
    """Return letter, error and the initial of the chosen scheme."""
    error, scheme = float(result["tolerance_error"].values[i, j]), int(result["tolerance_scheme"].values[i, j])
    if np.isnan(error):
        return letter
    return f"{letter}  {_number(error)}  {INITIAL[str(result['scheme'].values[scheme])]}"


def _frame(ax: Axes, result: xr.Dataset, headings: list[tuple[float, str]], rows: np.ndarray, bottom: float) -> None:
    """Draw headings, names and legend of the matrix."""
    schemes, tolerances = list(result["scheme"].values), list(result["wanted_error"].values)
    width = len(schemes) + 0.25 + len(tolerances)
    ax.set(xlim=(0, width), ylim=(bottom, 0))
    for height, name in headings:
        ax.text(-0.05, height + 0.5, name, ha="right", va="center", fontsize=9, fontweight="bold")
        ax.plot([0, width], [height + 0.72] * 2, color="#cccccc", linewidth=0.6)
    marks = result["chaotic"].values
    names = [f"{name}{' *' if mark else ''}" for name, mark in zip(result["case"].values, marks, strict=True)]
    ax.set_yticks(rows + 0.5, names, fontsize=8)
    centres = [*(np.arange(len(schemes)) + 0.5), *(len(schemes) + 0.75 + np.arange(len(tolerances)))]
    texts = [SHORT.get(name, name) for name in schemes] + [f"tolerance\n{_number(value)}" for value in tolerances]
    ax.set_xticks(centres, texts, fontsize=8.5)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    patches = [
        Patch(facecolor=fill, hatch=hatch, edgecolor="#999999", label=f"{letter[0]}  {name}")
        for name, (letter, fill, hatch, _) in CLASSES.items()
        if letter
    ]
    notes = (
        "number: error over the motion (accurate: up to 1 %);  ΔE: energy drift over kinetic and strain energy;  S at: part "
        "computed and kept\n* chaotic: judged by statistics, as the long runs are;  right: error with that tolerance (A met, "
        "W missed with a warning,\n- no single truth) by velocity Verlet (V) or the trapezoidal rule (T), as it picks; of rigid "
        "links by RATTLE (R);\nrigid links in scenes of elastic ones: distance of the models"
    )
    ax.legend(handles=patches, ncols=5, loc="upper center", bbox_to_anchor=(0.42, 0.0), fontsize=8.5, frameon=False, title=notes,
              title_fontsize=8, alignment="left")  # fmt: skip
