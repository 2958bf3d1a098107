"""Compare stringing tables by the exact catenary with those by parabolas, and with a published example.

    python pipelines/stringing/run.py [--readme]

The conductor ASTER 570 on level spans, tensioned at 15 degrees Celsius, from -20 to 80 degrees.  The parabola's change of state
is the cubic of textbooks, with the tension taken as constant along the conductor; its sag is q a^2 / (8 H).  The published
example has ice and wind at its first state; both states have the total load as a uniform one, as in the book.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, markdown_table, show_table
from scipy.optimize import brentq

import cablepod as cp

HERE = Path(__file__).resolve().parent
#: ASTER 570: mass per length [kg/m], axial stiffness [N], thermal expansion [1/K].
MASS, STIFFNESS, EXPANSION = 1.571, 3.653e7, 2.3e-5
#: Standard acceleration [m/s2], horizontal force [N] at the reference temperature [degC], spans [m], temperatures [degC].
GRAVITY, FORCE, REFERENCE = 9.80665, 30000.0, 15.0
SPANS, TEMPERATURES = (100.0, 400.0, 1000.0), (-20.0, 0.0, 15.0, 40.0, 80.0)
#: Chakrabarti, Soni, Gupta and Bhatnagar, Power System Engineering, 2nd ed., part II, example 5.9: span [m], area [mm2], diameter
#: [mm], mass [kg/m], modulus [kgf/mm2], expansion [1/K], ice [mm, kg/m3], wind [kgf/m2], tension in the worst state [kgf],
#: temperatures of worst state and erection [degC]; published tension at erection [kgf].
BOOK = {
    "span": 300.0, "area": 226.0, "diameter": 19.53, "mass": 0.844, "modulus": 9320.0, "expansion": 18.44e-6, "ice": 9.5,
    "ice_density": 915.0, "pressure": 39.0, "tension": 3975.0, "worst": -5.0, "erection": 45.0, "published": 1710.0,
}  # fmt: skip


def parabola(span: float, loads: tuple[float, float], stiffness: float, force: float, strain: float) -> float:
    """Return the horizontal force [N] of the second state: of a parabola, by the cubic of the change of state.

    Parameters
    ----------
    span
        [m].
    loads
        Loads per length in both states [N/m].
    stiffness
        Axial stiffness [N].
    force
        Horizontal force of the first state [N].
    strain
        Thermal strain from the first to the second state.
    """

    def misfit(other: float) -> float:
        slack = (loads[1] * span / other) ** 2 / 24.0 - (loads[0] * span / force) ** 2 / 24.0
        return slack - strain - (other - force) / stiffness

    return float(brentq(misfit, 1e-3 * force, 1e2 * force, xtol=1e-9 * force))


def conductor(span: float) -> tuple[np.ndarray, np.ndarray]:
    """Return horizontal forces [N] and sags [m] by catenary and parabola (2, temperatures)."""
    cable = {
        "axial_stiffness": STIFFNESS, "mass_per_length": MASS, "horizontal_force": FORCE, "thermal_expansion": EXPANSION
    }  # fmt: skip
    ends = {"lower": [0.0, 0.0], "chord": span, "inclination": 0.0}
    scene = cp.make_scene(
        {
            "title": f"ASTER 570, {span:g} m",
            "gravity": GRAVITY,
            "reference_temperature": REFERENCE,
            "cable": cable,
            "ends": ends,
        }
    )
    table = cp.catenary.stringing(scene, TEMPERATURES)
    load = MASS * GRAVITY
    forces = [parabola(span, (load, load), STIFFNESS, FORCE, EXPANSION * (value - REFERENCE)) for value in TEMPERATURES]
    exact = table["horizontal_force"].values, table["sag"].values
    return np.array([exact[0], forces]), np.array([exact[1], load * span**2 / (8.0 * np.array(forces))])


def example() -> tuple[float, float, float, float]:
    """Return tension [kgf] and sag [m] of the published example at erection, by the catenary and by the cubic."""
    ice = math.pi * BOOK["ice_density"] * BOOK["ice"] * (BOOK["diameter"] + BOOK["ice"]) * 1e-6
    wind = BOOK["pressure"] * (BOOK["diameter"] + 2.0 * BOOK["ice"]) * 1e-3
    loads = tuple(GRAVITY * load for load in (math.hypot(BOOK["mass"] + ice, wind), BOOK["mass"]))
    stiffness = BOOK["modulus"] * BOOK["area"] * GRAVITY
    strain = BOOK["expansion"] * (BOOK["erection"] - BOOK["worst"])
    force = BOOK["tension"] * GRAVITY
    length = float(
        cp.catenary.solve(BOOK["span"], 0.0, loads[0], stiffness, horizontal_force=force)["unstretched_length"]
    )
    scene = cp.make_scene(
        {
            "title": "published example",
            "gravity": GRAVITY,
            "reference_temperature": BOOK["worst"],
            "cable": {
                "axial_stiffness": stiffness,
                "mass_per_length": BOOK["mass"],
                "unstretched_length": length,
                "thermal_expansion": BOOK["expansion"],
            },
            "ends": {"lower": [0.0, 0.0], "chord": BOOK["span"], "inclination": 0.0},
        }
    )
    table = cp.catenary.stringing(scene, [BOOK["erection"]])
    cubic = parabola(BOOK["span"], (loads[0], loads[1]), stiffness, force, strain)
    exact = float(table["horizontal_force"][0])
    return exact / GRAVITY, float(table["sag"][0]), cubic / GRAVITY, loads[1] * BOOK["span"] ** 2 / (8.0 * cubic)


def main() -> None:
    """Compute and print both tables."""
    arguments = command_line(__doc__, readme=True).parse_args()
    page = HERE if arguments.readme else None
    rows = []
    for span in SPANS:
        forces, sags = conductor(span)
        for k, temperature in enumerate(TEMPERATURES):
            off = [round(100.0 * (both[1, k] / both[0, k] - 1.0), 3) for both in (forces, sags)]
            rows.append(
                [
                    f"{span:g}", f"{temperature:g}", f"{1e-3 * forces[0, k]:.4f}", f"{sags[0, k]:.4f}",
                    f"{1e-3 * forces[1, k]:.4f}", f"{sags[1, k]:.4f}", *(f"{value + 0.0:+.3f}" for value in off),
                ]
            )  # fmt: skip
    head = (
        "span [m]", "°C", "horizontal force [kN]", "sag [m]", "parabola: force [kN]", "sag [m]", "its force off by [%]",
        "its sag [%]",
    )  # fmt: skip
    show_table("conductor", markdown_table(head, rows), page)
    exact, sag, cubic, sag_of_cubic = example()
    published = BOOK["published"]
    sag_published = BOOK["mass"] * BOOK["span"] ** 2 / (8.0 * published)
    rows = [
        [
            "printed in the book",
            f"{published:.0f}",
            f"{sag_published:.3f}",
            f"{100.0 * (published / exact - 1.0):+.2f}",
        ],
        ["its cubic, solved", f"{cubic:.2f}", f"{sag_of_cubic:.3f}", f"{100.0 * (cubic / exact - 1.0):+.2f}"],
        ["exact catenary", f"{exact:.2f}", f"{sag:.3f}", ""],
    ]
    show_table("example", markdown_table(("", "tension [kgf]", "sag [m]", "tension off by [%]"), rows), page)


if __name__ == "__main__":
    main()
