"""Compare modes of rigid chain, elastic chain and cable on an extensible cable.

    python pipelines/rigid_basis/run.py [--out FOLDER] [--rank 4] [--links 40]

Writes rigid_basis.png. The guy of the paper with Example 3's end motion (0.5 rad/s, 62.5 s), its length over the chord from
taut to slack, its stiffness over three powers of ten.  In each cell the truth is the continuous extensible cable, law (21), of
16 spectral elements, by the trapezoidal rule.  Modes come from the cable itself and from two chains: rigid links (of the
stretched length of the cable at rest in all, so that they can reach) and elastic links by the linear law.  Upper row: error of
the truth projected on the modes; lower row: error of the reduced model, which includes that of the discretisation in links.  A
cell is empty where the run stopped; brackets: the step was not converged, or runs of the cable (8 elements, twice the step) or
of rigid links (twice the step) differ by more than a thousandth of the motion.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from _study import command_line
from matplotlib import pyplot as plt
from matplotlib.colors import LogNorm
from tqdm import tqdm

import cablepod as cp
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
RATIOS = (0.999, 0.9997, 1.0001, 1.001, 1.01, 1.03, 1.1)
STIFFNESSES = (2e5, 2e6, 2e7, 2e8)  # N
BASES = ("rigid chain", "elastic chain", "cable itself")
TOLERANCE = 1e-5
#: Steps of rigid links [s], the coarser first; given, as no choice of step ends in the tautest cells, close to a straight line.
RIGID_STEPS = (1e-3, 5e-4)
#: Elements and steps [s] of the cable, the coarser first, and the tolerance of their difference over the motion.
RESOLUTIONS, AGREE = ((8, 0.01), (16, 0.005)), 1e-3


def given(ratio: float, stiffness: float, links: int) -> xr.Dataset:
    """Return the scene of one cell."""
    base = scene("example3").drop_vars("cable_top_tension")
    chord = float(np.linalg.norm(base.ends_upper - base.ends_lower))
    result = base.assign(
        cable_unstretched_length=((), ratio * chord),
        cable_youngs_modulus=((), stiffness / float(base.cable_area)),
        time_duration=((), 62.5),
        time_interval=((), 0.5),
        chain_links=((), links),
    )
    for name, units in (("cable_unstretched_length", "m"), ("cable_youngs_modulus", "Pa"), ("chain_links", "1")):
        result[name].attrs["units"] = units
    return result


def settled(run: xr.Dataset) -> bool:
    """Return whether the step of a run converged."""
    return run.attrs["time_error_estimate"] <= TOLERANCE


def near(coarse: xr.Dataset, fine: xr.Dataset) -> bool:
    """Return whether two runs agree within the tolerance."""
    return float(cp.compare.errors(coarse, fine)["error_max"]) <= AGREE


def cell(ratio: float, stiffness: float, rank: int, links: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (projection or model, basis) as fractions, and whether they are converged."""
    cable_scene = given(ratio, stiffness, links)
    options = {"scheme": "velocity_verlet", "tolerance": TOLERANCE, "outputs": ("position",)}
    errors, sound = np.full((2, len(BASES)), np.nan), np.ones((2, len(BASES)), dtype=bool)
    try:
        coarse, cable = (
            cp.cable.simulate(cable_scene, elements=count, scheme="trapezoidal", step=step)
            for count, step in RESOLUTIONS
        )
    except cp.RunStopped:  # compressed, where law (21) is ill-posed
        return errors, sound
    agreed = near(coarse, cable)
    reach = float(cp.chain.rest(cable_scene, law="green").stretched_length)
    stretched = cable_scene.assign(cable_unstretched_length=((), reach))
    try:
        rough, rigid = (cp.rigid.simulate(stretched, formulation="index1", step=step) for step in RIGID_STEPS)
    except cp.RunStopped:  # almost straight between its ends
        rough = rigid = None
    runs = {
        "rigid chain": rigid,
        "elastic chain": cp.chain.simulate(cable_scene, **options),
        "cable itself": cable,
    }
    for i, name in enumerate(BASES):
        if runs[name] is None:
            continue
        modes = cp.pod.decompose(runs[name], rank=rank)
        back = cp.pod.reconstruct(cp.pod.project(cable, modes), modes)
        errors[0, i] = cp.compare.errors(back, cable)["error_max"]
        sound[:, i] = agreed and (near(rough, rigid) if i == 0 else i == 2 or settled(runs[name]))
        try:
            model = cp.galerkin.simulate(cable_scene, modes, rank=rank, tolerance=TOLERANCE)
        except cp.RunStopped:
            continue
        errors[1, i] = cp.compare.errors(model, cable)["error_max"]
        sound[1, i] &= settled(model)
    return errors, sound


def draw(errors: np.ndarray, sound: np.ndarray, rank: int) -> plt.Figure:
    """Draw the maps of errors (ratio, stiffness, projection or model, basis)."""
    figure, axes = plt.subplots(2, 3, figsize=(13, 6.4), sharex=True, sharey=True, layout="constrained")
    for row, what in enumerate((f"projected on {rank} modes", f"reduced model, {rank} modes")):
        for column, basis in enumerate(BASES):
            ax, percent = axes[row, column], 100.0 * errors[:, :, row, column].T
            image = ax.pcolormesh(percent, norm=LogNorm(1e-3, 1e2), cmap="cividis_r", edgecolors="white", linewidth=1)
            for (i, j), value in np.ndenumerate(percent):
                if np.isfinite(value):
                    text = f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
                    text = text if sound[j, i, row, column] else f"({text})"
                    shade = "white" if value > 0.7 else "black"
                    ax.text(j + 0.5, i + 0.5, text, ha="center", va="center", fontsize=9, color=shade)
            ax.set_title(f"{what}: {basis}", fontsize=10)
            ax.set_xticks(np.arange(len(RATIOS)) + 0.5, [f"{ratio:g}" for ratio in RATIOS], rotation=30)
            ax.set_yticks(np.arange(len(STIFFNESSES)) + 0.5, [f"{k:.0e}" for k in STIFFNESSES])
    for ax in axes[1]:
        ax.set_xlabel("unstretched length / chord [1]")
    for ax in axes[:, 0]:
        ax.set_ylabel("axial stiffness K [N]")
    figure.colorbar(image, ax=axes, label="largest error over time [% of the motion]")
    return figure


def main() -> None:
    """Compute, print, draw."""
    parser = command_line(__doc__, out=HERE)
    parser.add_argument("--rank", type=int, default=4)
    parser.add_argument("--links", type=int, default=40)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    shape = (len(RATIOS), len(STIFFNESSES), 2, len(BASES))
    errors, sound = np.full(shape, np.nan), np.ones(shape, dtype=bool)
    print("L0/chord, K [N]; errors in %: projected, then reduced model, each on the modes of " + ", ".join(BASES))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.NotConvergedWarning)  # such cells are marked
        for i, j in tqdm(list(np.ndindex(*shape[:2])), disable=None):
            errors[i, j], sound[i, j] = cell(RATIOS[i], STIFFNESSES[j], options.rank, options.links)
            print(
                RATIOS[i], f"{STIFFNESSES[j]:g}", np.array2string(100.0 * errors[i, j].ravel(), precision=3), flush=True
            )
    draw(errors, sound, options.rank).savefig(options.out / "rigid_basis.png", dpi=80)


if __name__ == "__main__":
    main()
