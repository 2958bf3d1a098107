"""Compare a clump weight, two segments and a damper in motion with MoorDyn and OpenSees.

    python pipelines/benchmarks/peers/things.py [--links 20 40 80] [--readme]

Needs the extra ``peers`` (MoorDyn, OpenSeesPy); a package that is missing is a line that says so.  A cable of 61 m hangs
between ends 60 m apart, one of which swings along the chord by a sine of 10 cm for ten seconds.  In one scene a clump weight of
60 kg hangs at four tenths of the length, in another the cable beyond that place is of another rope, and in the third a damper
acts there, which MoorDyn does not have.  No water, no wind, no other damping.

Masses, stiffnesses and lengths of links are computed here, from the tables; only the positions at rest are those of
`chain.rest`, and each program has to stay there.  MoorDyn: two lines that meet in a free point, RK4.  OpenSees: corotational
trusses, lumped masses, a viscous zero-length element, Newmark's average acceleration, the end moved by a single-point
constraint.  Differences are the largest ones over time: of a particle over the largest displacement, and of the tension of the
uppermost link over its largest change.  Beside the chain with as many links stands the continuous cable, with 16 elements, at
the places of the particles and the middle of the uppermost link.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import xarray as xr
from _moordyn import Line, moordyn_of, nodes_of
from _study import command_line, markdown_table, percent, show_table

import cablepod as cp
from benchmarks.peers.solvers import quiet

HERE = Path(__file__).resolve().parent
GRAVITY, SPAN, LENGTH, PLACE = 9.81, 60.0, 61.0, 0.4
#: Axial stiffness [N] and mass per length [kg/m] of the rope, of the other rope; clump weight [kg], vertical damper [N s/m].
ROPE, OTHER, CLUMP, DAMPER = (2e6, 1.0), (1e6, 2.5), 60.0, 20.0
#: Motion of the upper end, amplitude sin(omega t) times a smooth step over the ramp: [m], [rad/s], [s].
AMPLITUDE, OMEGA, RAMP = 0.1, 1.5, 3.0
#: End of the run and interval of the output [s]; steps of MoorDyn, of its calls and of OpenSees [s].
END, INTERVAL, STEP, CALL, NEWMARK = 10.0, 0.05, 2e-4, 1e-3, 2.5e-3
SCENES = ("clump weight", "two segments", "damper")


@dataclass(frozen=True)
class Hanging:
    """The cable as links: what every program is given."""

    start: np.ndarray  #: positions at rest (links + 1, 2) [m]
    stiffness: np.ndarray  #: axial, of the links (links,) [N]
    mass: np.ndarray  #: of the particles (links + 1,) [kg]
    clump: float  #: [kg], part of the mass of the particle at the place
    second: tuple[float, float]  #: stiffness [N] and mass per length [kg/m] beyond the place
    damper: float  #: to the ground, vertical, at the particle at the place [N s/m]

    @property
    def links(self) -> int:
        """Number of links."""
        return self.stiffness.size

    @property
    def at(self) -> int:
        """Particle at the place."""
        return round(PLACE * self.links)

    def tension(self, position: np.ndarray) -> np.ndarray:
        """Return the tension of the uppermost link (times,) [N] of positions (times, links + 1, 2) [m]."""
        reach = np.linalg.norm(position[:, -1] - position[:, -2], axis=1)
        return np.asarray(self.stiffness[-1] * (reach * self.links / LENGTH - 1.0))


def upper(t: np.ndarray) -> np.ndarray:
    """Return the displacement of the upper end [m]."""
    s = np.minimum(t / RAMP, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2) * AMPLITUDE * np.sin(OMEGA * t)


def scene(kind: str, links: int) -> xr.Dataset:
    """Return the scene of a kind."""
    parts: dict[str, Any] = {
        "clump weight": {"attachment": [{"arc_length": PLACE, "mass": CLUMP}]},
        "two segments": {"segment": [{"to": PLACE}, {"axial_stiffness": OTHER[0], "mass_per_length": OTHER[1]}]},
        "damper": {"attachment": [{"arc_length": PLACE, "damper": DAMPER, "direction": [0.0, 1.0]}]},
    }[kind]
    swing = {"kind": "harmonic", "amplitude": AMPLITUDE, "angular_frequency": OMEGA, "ramp": RAMP}
    return cp.make_scene(
        {
            "title": kind,
            "gravity": GRAVITY,
            "cable": {"axial_stiffness": ROPE[0], "mass_per_length": ROPE[1], "unstretched_length": LENGTH},
            "ends": {"lower": [0.0, 0.0], "upper": [SPAN, 0.0]},
            "motion": {"upper": {"x": swing}},
            "chain": {"links": links},
            "time": {"duration": END, "interval": INTERVAL},
            **parts,
        }
    )


def hanging(kind: str, start: np.ndarray) -> Hanging:
    """Return the links of a kind, from its tables and positions at rest."""
    links = len(start) - 1
    at = round(PLACE * links)
    if abs(at / links - PLACE) > 1e-12:
        raise ValueError(f"links: given {links}; allowed: a multiple of 5, so that equal links end at {PLACE}")
    clump, damper = CLUMP * (kind == "clump weight"), DAMPER * (kind == "damper")
    second = OTHER if kind == "two segments" else ROPE
    stiffness, per_length = np.array([ROPE] * at + [second] * (links - at)).T
    half = 0.5 * per_length * LENGTH / links
    mass = np.append(half, 0.0) + np.append(0.0, half)
    mass[at] += clump
    return Hanging(start, stiffness, mass, clump, second, damper)


# --- programs ---------------------------------------------------------------------------------------------------------


def by_moordyn(cable: Hanging) -> np.ndarray:
    """Return positions (times, links + 1, 2) [m] of MoorDyn."""
    import moordyn as md

    if cable.damper:
        raise RuntimeError("no damper to the ground")
    place = np.stack([cable.start[:, 0], np.zeros(cable.links + 1), cable.start[:, 1]], axis=1)
    parts = [
        Line(place[: cable.at + 1], ROPE[1], ROPE[0], PLACE * LENGTH, (1, 2)),
        Line(place[cable.at :], cable.second[1], cable.second[0], (1.0 - PLACE) * LENGTH, (2, 3)),
    ]
    points = [("Fixed", 0.0), ("Free", cable.clump), ("Coupled", 0.0)]
    model, lines = moordyn_of(parts, points, STEP, GRAVITY)

    def nodes() -> np.ndarray:
        below, above = (nodes_of(line, len(part.nodes)) for line, part in zip(lines, parts, strict=True))
        return np.concatenate([below, above[1:]])[:, [0, 2]]

    grid, every = CALL * np.arange(round(END / CALL) + 1), round(INTERVAL / CALL)
    x = SPAN + upper(grid)
    velocity, found = np.diff(x) / CALL, [cable.start]
    for i in range(len(velocity)):
        md.Step(model, [x[i], 0.0, place[-1, 2]], [velocity[i], 0.0, 0.0], grid[i], CALL)
        if (i + 1) % every == 0:
            found.append(nodes())
    md.Close(model)
    result = np.array(found)
    result[:, -1, 0] = x[::every]
    return result


def by_opensees(cable: Hanging) -> np.ndarray:
    """Return positions (times, links + 1, 2) [m] of OpenSees."""
    import openseespy.opensees as ops

    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 2)
    length = LENGTH / cable.links
    for j, (place, mass) in enumerate(zip(cable.start.tolist(), cable.mass.tolist(), strict=True), start=1):
        ops.node(j, *place)
        ops.mass(j, mass, mass)
    ops.fix(1, 1, 1)
    ops.fix(cable.links + 1, 0, 1)
    for j in range(1, cable.links + 1):
        present = float(np.linalg.norm(cable.start[j] - cable.start[j - 1]))
        own = float(cable.stiffness[j - 1])
        modulus = own * present / length  # over the present length, without force at `length`
        ops.uniaxialMaterial("Elastic", 2 * j, modulus)
        ops.uniaxialMaterial("InitStrainMaterial", 2 * j + 1, 2 * j, own * (present / length - 1.0) / modulus)
        ops.element("corotTruss", j, j, j + 1, 1.0, 2 * j + 1)
    if cable.damper:
        ground = cable.links + 2
        ops.node(ground, *cable.start[cable.at].tolist())
        ops.fix(ground, 1, 1)
        ops.uniaxialMaterial("Viscous", 1, cable.damper, 1.0)
        ops.element("zeroLength", ground, ground, cable.at + 1, "-mat", 1, "-dir", 2)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    for j, mass in enumerate(cable.mass.tolist(), start=1):
        ops.load(j, 0.0, -GRAVITY * mass)
    ops.timeSeries("Path", 2, "-dt", NEWMARK, "-values", *upper(np.arange(0.0, END + 2.0 * NEWMARK, NEWMARK)).tolist())
    ops.pattern("Plain", 2, 2)
    ops.sp(cable.links + 1, 1, 1.0)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.test("NormUnbalance", 1e-7, 50)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    count, found = round(INTERVAL / NEWMARK), []
    for k in range(round(END / INTERVAL) + 1):
        if k and ops.analyze(count, NEWMARK):
            raise RuntimeError(f"OpenSees stopped at {k * INTERVAL:g} s")
        found.append([ops.nodeDisp(j) for j in range(1, cable.links + 2)])
    return cable.start + np.array(found)


PROGRAMS = {"MoorDyn": by_moordyn, "OpenSees": by_opensees}


# --- comparison -------------------------------------------------------------------------------------------------------


def differences(run: xr.Dataset, position: np.ndarray, tension: np.ndarray) -> tuple[float, float]:
    """Return the largest difference of a particle over the motion, and of the top tension over its change."""
    own, pull = run["position"].values, run["tension"].values[:, -1]
    motion = np.linalg.norm(own - own[0], axis=2).max()
    return (
        float(np.linalg.norm(position - own, axis=2).max() / motion),
        float(np.abs(tension - pull).max() / np.abs(pull - pull[0]).max()),
    )


def runs(kind: str, links: int) -> tuple[xr.Dataset, xr.Dataset]:
    """Return chain and continuous cable."""
    given = scene(kind, links)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.CoarseWarning)  # the table says what few links cost
        chain = cp.chain.simulate(given, tolerance=1e-6)
    cable = cp.cable.simulate(given, law="linear", elements=16, tolerance=1e-6, points=np.linspace(0.0, 1.0, links + 1))
    return chain, cable


def main() -> None:
    """Run all and write the table."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--links", type=int, nargs="+", default=[20, 40, 80], help="links of the cable, multiples of 5")
    options = parser.parse_args()
    rows = []
    for kind in SCENES:
        for links in options.links:
            chain, cable = runs(kind, links)
            given = hanging(kind, chain.position.values[0])
            found = differences(cable, chain.position.values, chain.tension.values[:, -1])
            rows.append([kind, str(links), "cablepod, chain", "", "", *map(percent, found)])
            print(rows[-1], flush=True)
            for name, call in PROGRAMS.items():
                try:
                    with quiet():
                        position = call(given)
                except (ImportError, RuntimeError) as failure:  # also of an installed OpenSees without its libraries
                    print(f"{name}, {kind}: {failure}", flush=True)
                    continue
                both = [differences(run, position, given.tension(position)) for run in (chain, cable)]
                rows.append([kind, str(links), name, *map(percent, both[0] + both[1])])
                print(rows[-1], flush=True)
    head = (
        "scene", "links", "program", "position, beside the chain", "top tension", "position, beside the cable", "top tension",
    )  # fmt: skip
    show_table("things", markdown_table(head, rows), HERE if options.readme else None)


if __name__ == "__main__":
    main()
