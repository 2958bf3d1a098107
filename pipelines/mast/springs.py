"""Compute the dynamic stiffness of the guys of a mast, bare and iced, over that of static springs.

    python pipelines/mast/springs.py [--readme]

The guys of the mast of 120 m, one of each level, in the plane and in still air.  The upper end moves harmonically along the
chord, so little that the guy is linear, and the force on it is resolved into its harmonic, after the start has decayed: the
complex stiffness of a prepared condensed model.  A static spring has the stiffness of the catenary at every frequency.  The
figure has the frequencies of vibrations of mast and guys together in which the mast has most of the energy.
"""

from __future__ import annotations

import math
import sys
import tomllib
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, markdown_table, short, show_table
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import cablepod as cp
from cablepod import examples

HERE = Path(__file__).parent
TABLES = tomllib.loads(examples.scene_path("mast120").read_text(encoding="utf-8"))
#: Radial thickness of the ice [m]; rank, particles, and damping [1/s] of the guys.
ICE, RANK, POINTS, DAMPING = 0.02, 6, 81, 0.1
#: Frequencies of the table and of the figure [Hz].
TOLD, DRAWN = (0.2, 0.5, 1.0, 1.5, 2.0), np.round(np.arange(0.1, 2.51, 0.05), 2)
#: Amplitude [m] and steps a second; decay of the start, as a multiple of 1/DAMPING.
AMPLITUDE, STEPS_PER_SECOND, DECAY = 1e-6, 200, 16.0
#: Share of the kinetic energy in the mast, of modes that are drawn.
MAST_SHARE = 0.5
COLOURS = ("#0072B2", "#D55E00", "#009E73")


def guy_of(table: dict[str, Any], thickness: float) -> Any:
    """Return the prepared model of a guy with ice of a thickness [m]: a bare cable as heavy and as tight as the iced one."""
    cable = TABLES["cables"][table["cable"]] | {"top_tension": table["top_tension"]}
    tables: dict[str, Any] = {
        "cable": cable,
        "ends": {"lower": [0.0, 0.0], "upper": [table["radius"], table["level"]]},
        "damping": {"mass_proportional": DAMPING},
    }
    iced = cp.make_scene(tables | {"ice": {"thickness": thickness}})
    mass, tension = float(cp.summary(iced)["mass_per_length"]), float(cp.catenary.rest(iced)["tension_upper"])
    scene = cp.make_scene(tables | {"cable": cable | {"density": mass / cable["area"], "top_tension": tension}})
    modes = cp.condensed.vibration_modes(scene, rank=RANK, links=POINTS - 1)
    return cp.condensed.prepare(scene, modes, rank=RANK)


def stiffness(guy: Any, hertz: float) -> complex:
    """Return the complex stiffness of a guy along its chord at a frequency [N/m]."""
    omega, per_period = 2.0 * math.pi * hertz, max(round(STEPS_PER_SECOND / hertz), 100)
    step = 1.0 / (hertz * per_period)
    settle = math.ceil(DECAY / DAMPING * hertz) * per_period
    rest, before = guy.end_position, guy.force
    along = rest / np.linalg.norm(rest)
    found = 0.0j
    for k in range(1, settle + per_period + 1):
        phase = omega * step * k
        force = guy.step(
            rest + AMPLITUDE * math.sin(phase) * along, AMPLITUDE * omega * math.cos(phase) * along, step,
            -AMPLITUDE * omega**2 * math.sin(phase) * along,
        )  # fmt: skip
        if k > settle:
            found -= 2.0 / per_period * float((force - before) @ along) * complex(math.sin(phase), math.cos(phase))
    return found / AMPLITUDE


def static_stiffness(guy: Any) -> float:
    """Return the stiffness of the catenary along its chord [N/m]."""
    along = guy.end_position / np.linalg.norm(guy.end_position)
    return float(along @ guy.stiffness @ along)


def draw(curves: dict[tuple[float, float], np.ndarray], frequencies: np.ndarray) -> Figure:
    """Draw the modulus of the stiffness over that of the static spring."""
    figure, ax = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
    for (level, ice), values in curves.items():
        colour = COLOURS[[table["level"] for table in TABLES["guy"]].index(level)]
        name = f"guys at {level:g} m{', iced' if ice else ''}"
        ax.plot(DRAWN, values, color=colour, linestyle="--" if ice else "-", label=name)
    for number, hertz in enumerate(frequencies[frequencies < DRAWN[-1]]):
        ax.axvline(hertz, color="#bbbbbb", linewidth=0.8, zorder=0, label=None if number else "vibrations of the mast")
    ax.axhline(1.0, color="black", linewidth=0.8, linestyle=":", label="static spring")
    ax.set(xlabel="frequency [Hz]", ylabel="stiffness / static stiffness", yscale="log", xlim=(0.0, DRAWN[-1]))
    ax.legend(fontsize=7, ncols=2)
    return figure


def main() -> None:
    """Compute and write table and figure."""
    options = command_line(__doc__, readme=True).parse_args()
    found = cp.mast.frequencies(examples.scene("mast120"), count=60)
    own = found["angular_frequency"].values[found["mast_share"].values > MAST_SHARE] / (2.0 * np.pi)
    rows, curves = [], {}
    for table in TABLES["guy"]:
        for ice in (0.0, ICE):
            spring = static_stiffness(guy_of(table, ice))
            ratios = {f: abs(stiffness(guy_of(table, ice), f)) / spring for f in {*TOLD, *DRAWN.tolist()}}
            curves[table["level"], ice] = np.array([ratios[f] for f in DRAWN.tolist()])
            rows.append([
                f"{table['level']:g} m", f"{1e3 * ice:g} mm", f"{spring / 1e3:.0f} kN/m", *(short(ratios[f]) for f in TOLD),
            ])  # fmt: skip
            print(*rows[-1], flush=True)
    head = ["guys at", "ice", "static stiffness", *(f"at {f:g} Hz" for f in TOLD)]
    show_table("springs", markdown_table(head, rows), HERE if options.readme else None)
    if options.readme:
        draw(curves, own).savefig(HERE / "springs.png", dpi=75)


if __name__ == "__main__":
    main()
