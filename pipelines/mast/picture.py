"""Draw a mast and its guys at the largest tension of a storm, and the tensions about it.

    python pipelines/mast/picture.py [--out FOLDER]

Writes mast.png, by default to pipelines/figures.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib as mpl
import numpy as np
from _study import command_line

mpl.use("Agg")

from matplotlib import pyplot as plt

import cablepod as cp
from cablepod.examples import scene

OUT = Path(__file__).resolve().parents[1] / "figures"
#: Part of the run that is drawn about the peak [s], before and after.
ABOUT = 60.0


def picture() -> plt.Figure:
    """Draw the mast at the peak, and the windward guys of each level over time."""
    run = cp.mast.simulate(scene("mast120"), outputs=("displacement", "guy_position", "guy_tension"))
    tension = run.guy_tension
    at, guy = np.unravel_index(int(tension.values.argmax()), tension.shape)
    instant = float(run.time[at])
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained", width_ratios=(1, 1.5))
    cp.plots.animate_mast(run.isel(time=[at]), ax=left)
    left.set_title("mast and guys at the largest tension")
    _, first = np.unique(run.table.values, return_index=True)  # the first guy of each table faces the wind
    near = run.sel(time=slice(instant - ABOUT, instant + ABOUT)).isel(guy=first)
    cp.plots.guy_tensions(near, ax=right)
    levels = [f"guy at {level:.0f} m" for level in near.guy_level.values]
    right.legend(right.get_lines(), levels, fontsize="small", loc="upper right")
    right.plot(instant, 1e-3 * float(tension[at, guy]), "o", color="black", ms=5)
    right.annotate(f"{1e-3 * float(tension[at, guy]):.1f} kN", (instant, 1e-3 * float(tension[at, guy])), (8, 0),
                   textcoords="offset points", va="center")  # fmt: skip
    right.set_title("tension of the windward guys at the mast")
    figure.suptitle(str(run.attrs["title"]).partition(":")[0])
    return figure


if __name__ == "__main__":
    folder = command_line(__doc__, out=OUT).parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    picture().savefig(folder / "mast.png", dpi=90)
