"""Compare a guyed mast under a pulse at its tip with OpenSees, whose guys are chains of corotational trusses.

    python pipelines/mast/opensees.py [--trusses 20 40 80] [--readme]

Needs the extra ``peers`` (OpenSeesPy).  The mast of 120 m stands still, without wind and damping; a push of two seconds at its
tip makes it swing for eight seconds.  OpenSees: elastic beam-columns with P-delta, trusses with unstretched length and tension of
links at rest, Newmark's average acceleration.  Written are the largest differences of the top's displacement over its
maximum, and of the tension of each guy over the largest change of its tension, for the guys of the top level, which hold the tip,
and for those of the level below, whose tensions change by a twelfth of that.
"""

from __future__ import annotations

import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, show_table

import cablepod as cp
from cablepod import examples
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import chain_of
from cablepod.mast._static_guys import StaticGuy
from cablepod.mast._statics import MastRest, rest_of
from cablepod.parameters._mast import mast_parameters

HERE = Path(__file__).parent
#: Push at the tip [N] and its duration [s]; end of the run and interval of the output [s]; step of OpenSees [s].
FORCE, DURATION, END, INTERVAL, STEP = 2000.0, 2.0, 8.0, 0.02, 0.005


def pulse(t: np.ndarray) -> np.ndarray:
    """Return the factor of the push over time."""
    return np.where(t < DURATION, np.sin(np.pi * np.minimum(t, DURATION) / DURATION) ** 2, 0.0)


def still_mast(folder: Path) -> xr.Dataset:
    """Return the scene: mast120 without wind and damping, pushed at its tip."""
    tables = tomllib.loads(examples.scene_path("mast120").read_text(encoding="utf-8"))
    for name in ("wind", "damping"):
        del tables[name]
    instants = np.arange(0.0, END + 0.5, 0.01)
    np.savetxt(
        folder / "pulse.csv",
        np.stack([instants, pulse(instants)], axis=1),
        delimiter=",",
        header="time,value",
        comments="",
    )
    tables["mast"] |= {"damping_ratio": 0.0, "modes": 24}  # a force at the tip bends it at once: eight modes miss 1.6 %
    tables["mast"]["load"] = [
        {"level": 120.0, "force": [FORCE, 0.0, 0.0], "kind": "file", "path": str(folder / "pulse.csv")}
    ]
    tables["time"] = {"duration": END, "interval": INTERVAL}
    return cp.make_scene(tables)


def add_mast(ops: Any, rest: MastRest) -> dict[int, float]:
    """Add the mast, a beam-column with P-delta; return its weight by node [N]."""
    beam, p, rigid = rest.beam, rest.p, 1e12
    bending, mass = float(p.sections[0, 2]), float(p.sections[0, 3])
    for n, height in enumerate(beam.height.tolist()):
        ops.node(n + 1, 0.0, height, 0.0)
    ops.fix(1, 1, 1, 1, 0, 1, 0)  # pinned, no rotation about its axis
    ops.geomTransf("PDelta", 1, 0.0, 0.0, 1.0)
    inertia = bending / rigid
    weight: dict[int, float] = {}
    for n, length in enumerate(beam.length.tolist()):
        section = (1.0, rigid, rigid, rigid, inertia, inertia)
        ops.element("elasticBeamColumn", n + 1, n + 1, n + 2, *section, 1, "-mass", mass, "-cMass")
        for node in (n + 1, n + 2):
            weight[node] = weight.get(node, 0.0) + 0.5 * mass * p.gravity * length
    return weight


def add_guy(
    ops: Any, guy: StaticGuy, trusses: int, at_mast: int, first: tuple[int, int]
) -> tuple[dict[int, float], float]:
    """Add a guy from the node and the element `first` on; return its masses by node and that at the mast [kg]."""
    x, (node, element) = rest_shape(chain_of(guy.p, trusses), None)[0], first
    length = guy.length / trusses
    ends = [*range(node, node + trusses), at_mast]
    own = guy.p.mass * length
    masses = {}
    for k in range(trusses):
        ops.node(ends[k], *map(float, x[k]))
        ops.fix(ends[k], *([1] * 6 if k == 0 else [0, 0, 0, 1, 1, 1]))
        masses[ends[k]] = own if k else 0.5 * own
        if k:
            ops.mass(ends[k], own, own, own, 0.0, 0.0, 0.0)
    for k in range(trusses):
        present, number = float(np.linalg.norm(x[k + 1] - x[k])), element + k
        stiffness = guy.p.stiffness * present / length  # over the present length, without force at `length`
        strain = guy.p.stiffness * (present / length - 1.0) / stiffness
        ops.uniaxialMaterial("Elastic", 2 * number, stiffness)
        ops.uniaxialMaterial("InitStrainMaterial", 2 * number + 1, 2 * number, strain)
        ops.element("corotTruss", number, ends[k], ends[k + 1], 1.0, 2 * number + 1)
    return masses, 0.5 * own


def prepare(ops: Any, kind: str) -> None:
    """Set up an analysis by Newton's method."""
    ops.wipeAnalysis()
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.test("NormDispIncr", 1e-9, 50)
    ops.algorithm("Newton")
    ops.integrator(*(("LoadControl", 1.0) if kind == "Static" else ("Newmark", 0.5, 0.25)))
    ops.analysis(kind)


def by_opensees(scene: xr.Dataset, trusses: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return displacement of the top (outputs,), tensions at the mast (outputs, guys), and run time [s]."""
    import openseespy.opensees as ops

    rest = rest_of(mast_parameters(scene))
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    weight, at_levels = add_mast(ops, rest), dict[int, float]()
    top, element = len(rest.beam.height), len(rest.beam.length)
    gravity, node, upper = rest.p.gravity, top + 1, []
    for guy, own in zip(rest.bare, rest.p.guys, strict=True):
        at_mast = int(np.abs(rest.beam.height - own.level).argmin()) + 1
        masses, last = add_guy(ops, guy, trusses, at_mast, (node, element + 1))
        at_levels[at_mast] = at_levels.get(at_mast, 0.0) + last
        weight |= {number: gravity * mass for number, mass in masses.items()}
        weight[at_mast] += gravity * last
        node, element = node + trusses, element + trusses
        upper.append(element)
    for number, mass in at_levels.items():
        ops.mass(number, mass, mass, mass, 0.0, 0.0, 0.0)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    for number, force in weight.items():
        ops.load(number, 0.0, -force, 0.0, 0.0, 0.0, 0.0)
    prepare(ops, "Static")
    if ops.analyze(1):
        raise RuntimeError("OpenSees found no rest")
    ops.loadConst("-time", 0.0)
    ops.timeSeries("Path", 2, "-dt", STEP, "-values", *pulse(np.arange(0.0, END + 2.0 * STEP, STEP)).tolist())
    ops.pattern("Plain", 2, 2)
    ops.load(top, FORCE, 0.0, 0.0, 0.0, 0.0, 0.0)
    prepare(ops, "Transient")
    every, count, start = round(INTERVAL / STEP), round(END / INTERVAL), ops.nodeDisp(top, 1)
    displacement, tension = np.empty(count + 1), np.empty((count + 1, len(upper)))
    begin = time.process_time()
    for k in range(count + 1):
        if k and ops.analyze(every, STEP):
            raise RuntimeError(f"OpenSees stopped at {k * INTERVAL:g} s")
        displacement[k] = ops.nodeDisp(top, 1) - start
        tension[k] = [ops.basicForce(number)[0] for number in upper]
    return displacement, tension, time.process_time() - begin


def errors(run: xr.Dataset, top: np.ndarray, tension: np.ndarray) -> list[float]:
    """Return the errors of the top, and of the tensions of the guys of the top level and of that below."""
    own = run["displacement"].isel(level=-1, coordinate=0).values
    change, other = (values - values[0] for values in (run["guy_tension"].values, tension))
    largest = np.abs(other).max(axis=0)
    differences, level = np.abs(change - other).max(axis=0) / largest, run["guy_level"].values
    return [
        float(np.abs(own - own[0] - top).max() / np.abs(top).max()),
        *(float(differences[level == height].max()) for height in np.unique(level)[:-3:-1]),
    ]


def main() -> None:
    """Run both and write the table."""
    parser = command_line(__doc__, readme=True)
    parser.add_argument("--trusses", type=int, nargs="+", default=[20, 40, 80], help="trusses of a guy")
    options = parser.parse_args()
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        scene = still_mast(Path(folder))
        for trusses in options.trusses:
            top, tension, seconds = by_opensees(scene, trusses)
            for name, case in (
                ("condensed, r = 4", {"rank": 4}), ("condensed, r = 8", {"rank": 8}),
                (f"chain, {trusses} links", {"guys": "chain", "links": trusses}),
            ):  # fmt: skip
                cp.mast.simulate(scene, times=[0.0, INTERVAL], **case)  # compiles
                begin = time.process_time()
                run = cp.mast.simulate(scene, **case)
                spent = time.process_time() - begin
                found = errors(run, top, tension)
                rows.append(
                    [
                        str(trusses),
                        f"{seconds:.3g} s",
                        name,
                        f"{spent:.2g} s",
                        *(f"{100.0 * one:.2g} %" for one in found),
                    ]
                )
                print(rows[-1], flush=True)
    table = markdown_table(
        ["trusses a guy", "OpenSees", "beside", "time", "top", "tensions, upper guys", "guys below"], rows
    )
    show_table("opensees", table, HERE if options.readme else None)


if __name__ == "__main__":
    main()
