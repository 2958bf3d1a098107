"""Draw frequencies over Irvine's lambda^2, and the distance of the laws over the strain.

    python pipelines/cable_reference/figures.py [--out FOLDER]

Left: cable.frequencies against the roots of tan(z/2) = z/2 - 4/lambda^2 (z/2)^3 (Irvine and Caughey 1974) for a weight of a 50th
of the horizontal force, lambda^2 from 0.1 to 1000 through 4 pi^2.  Right: the slow motion of Example 2 for stiffnesses from 2e5
to 2e8 N, the maximum distance of law (21) from the linear law over the motion, against the strain at the top.  Also prints the
numbers.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
from _study import command_line
from matplotlib import pyplot as plt
from scipy.optimize import brentq

import cablepod as cp
from cablepod.examples import scene

HERE = Path(__file__).resolve().parent
SLOPE = 0.02  #: weight over horizontal force
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"


def horizontal(lam2: float):
    """Return a horizontal spatial cable by its lambda^2, and sqrt(H/mu)/span [rad/s]."""
    load, span = 10.0, 100.0
    force = load * span / SLOPE
    stiffness = lam2 * force * (1.0 + SLOPE**2 / 8.0) / SLOPE**2
    cable = {"youngs_modulus": stiffness, "area": 1.0, "specific_weight": load, "horizontal_force": force}
    given = cp.make_scene({"cable": cable, "ends": {"lower": [0.0, 0.0, 0.0], "upper": [span, 0.0, 0.0]}})
    return given, np.sqrt(force * 9.81 / load) / span


def roots(lam2: float, count: int) -> np.ndarray:
    """Return the lowest symmetric roots of Irvine and Caughey's equation."""

    def f(z):
        return np.sin(z / 2.0) + (4.0 / lam2 * (z / 2.0) ** 3 - z / 2.0) * np.cos(z / 2.0)

    z = np.linspace(1e-2, (2 * count + 3) * np.pi, 4001)
    change = np.flatnonzero(f(z[:-1]) * f(z[1:]) < 0.0)
    return np.array([brentq(f, z[i], z[i + 1]) for i in change])[:count]


def frequencies(ax: plt.Axes) -> None:
    """Draw and print frequencies over lambda^2."""
    fine = np.geomspace(0.1, 1000.0, 200)
    curves = np.array([roots(value, 3) for value in fine]) / np.pi
    ax.semilogx(fine, curves, "-", color="0.35", lw=1, label=["Irvine and Caughey, symmetric", None, None])
    for number, name in ((2, "antisymmetric"), (4, None)):
        ax.axhline(number, color="0.35", lw=1, ls="--", label=name)
    for number, name in ((1, "out of plane"), (3, None)):
        ax.axhline(number, color="0.7", lw=1, ls=":", label=name)
    worst = 0.0
    for lam2 in np.geomspace(0.1, 1000.0, 17):
        given, unit = horizontal(lam2)
        found = cp.cable.frequencies(given, count=10, law="linear")
        value = found["angular_frequency"].values / unit / np.pi
        out = found["out_of_plane_share"].values > 0.5
        theory = np.sort(np.concatenate([roots(lam2, 6), 2.0 * np.pi * np.arange(1, 7)]))[: (~out).sum()] / np.pi
        gap = np.abs(value[~out] / theory - 1.0).max()
        worst = max(worst, gap)
        across = np.abs(value[out] / np.arange(1, out.sum() + 1) - 1.0).max()
        print(f"lambda^2 {lam2:9.3f}: in-plane {gap:.1e}, out of plane {across:.1e}")
        ax.plot(np.full((~out).sum(), lam2), value[~out], "o", ms=4, color=BLUE)
        ax.plot(np.full(out.sum(), lam2), value[out], "x", ms=5, color=ORANGE)
    ax.plot([], [], "o", ms=4, color=BLUE, label="cable.frequencies, in the plane")
    ax.plot([], [], "x", ms=5, color=ORANGE, label="cable.frequencies, out of it")
    ax.axvline(4.0 * np.pi**2, color=GREEN, lw=1)
    ax.text(4.4 * np.pi**2, 0.25, "4π²", color=GREEN)
    ax.set(xlabel="Irvine's λ² [1]", ylabel="frequency over that of a taut string [1]", ylim=(0.0, 6.4))
    ax.legend(fontsize=7.5, loc="upper left", ncols=2)
    print(f"largest of all: {worst:.1e}")


def laws(ax: plt.Axes) -> None:
    """Draw and print the distance of the two laws over the strain."""
    given = scene("example2")
    times = np.arange(0.0, 63.0, 1.0)  # the first period of the motion
    strains, gaps = [], []
    for stiffness in (2e8, 6e7, 2e7, 6e6, 2e6, 6e5, 2e5):
        soft = given.assign(cable_youngs_modulus=given["cable_youngs_modulus"] * 0.0 + stiffness / 1.25e-4)
        runs = [
            cp.cable.simulate(soft, law=law, times=times, elements=8, scheme="trapezoidal", step=0.02)
            for law in ("green", "linear")
        ]
        strains.append(15000.0 / stiffness)
        gaps.append(float(cp.compare.errors(*runs)["error_max"]))
        print(f"K = {stiffness:.0e} N, strain {strains[-1]:.1e}: {100 * gaps[-1]:.3g} % of the motion")
    ax.loglog(strains, gaps, "o-", color=BLUE, ms=4, label="slow motion of Example 2")
    ax.loglog(
        strains, 1.5 * np.array(strains), "--", color="0.35", lw=1, label="1.5 × strain: difference of the forces"
    )
    ax.set(xlabel="strain at the top [1]", ylabel="law (21) from the linear law, over the motion [1]")
    ax.legend(fontsize=8)
    ax.grid(alpha=0.3)


def main(folder: Path) -> None:
    """Write the figure into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
    frequencies(left)
    laws(right)
    figure.savefig(folder / "cable.png", dpi=75)


if __name__ == "__main__":
    main(command_line(__doc__, out=HERE).parse_args().out)
