"""MoorDyn for comparisons: its input, and its lines at positions of ours instead of catenaries of its own."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

INPUT = """--- MoorDyn input file ---
lines of a study
--- LINE TYPES ---
TypeName Diam Mass/m EA BA/-zeta EI Cd Ca CdAx CaAx
(name) (m) (kg/m) (N) (N-s/-) (N-m^2) (-) (-) (-) (-)
{types}
--- POINTS ---
ID Attachment X Y Z M V CdA CA
(#) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
{points}
--- LINES ---
ID LineType AttachA AttachB UnstrLen NumSegs LineOutputs
(#) (name) (#) (#) (m) (-) (-)
{lines}
--- OPTIONS ---
0 writeLog
1 disableOutput
RK4 tScheme
{options}
0 dtIC
0 TmaxIC
0 kBot
0 cBot
--- need this line ---
"""
#: Options without water, where the diameter plays no part.
DRY = {"WtrDnsty": 0, "WtrDpth": 1000}


class Line(NamedTuple):
    """Line of MoorDyn; its z is up."""

    nodes: np.ndarray  #: at the start (segments + 1, 3) [m]
    mass: float  #: per length [kg/m]
    stiffness: float  #: axial [N]
    length: float  #: unstretched [m]
    ends: tuple[int, int]  #: numbers of its points, from 1
    diameter: float = 0.01  #: [m]
    drag: float = 0.0  #: drag coefficient


def moordyn_of(
    lines: Sequence[Line], points: Sequence[tuple[str, float]], step: float, gravity: float, *,
    options: Mapping[str, Any] = DRY, current: str = "",
) -> tuple[Any, list[Any]]:  # fmt: skip
    """Load lines at their start, with RK4 and a step [s]; return system and lines.

    Points are "Fixed", "Free" or "Coupled", with a mass [kg], and stand where their lines end; `current` is a file of it.
    """
    import moordyn as md

    places = {
        number: line.nodes[place].tolist() for line in lines for number, place in zip(line.ends, (0, -1), strict=True)
    }
    text = INPUT.format(
        types="\n".join(
            f"type{n} {line.diameter!r} {float(line.mass)!r} {float(line.stiffness)!r} 0 0 {line.drag!r} 0 0 0"
            for n, line in enumerate(lines)
        ),
        points="\n".join(
            f"{n} {kind} {' '.join(map(repr, places[n]))} {mass!r} 0 0 0" for n, (kind, mass) in enumerate(points, start=1)
        ),
        lines="\n".join(
            f"{n + 1} type{n} {line.ends[0]} {line.ends[1]} {float(line.length)!r} {len(line.nodes) - 1} -"
            for n, line in enumerate(lines)
        ),
        options="\n".join(f"{value!r} {name}" for name, value in {"dtM": step, "g": gravity, **options}.items()),
    )  # fmt: skip
    coupled = [x for n, (kind, _) in enumerate(points, start=1) if kind == "Coupled" for x in places[n]]
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        Path("lines.txt").write_text(text)
        if current:
            Path("current_profile.txt").write_text(current)
        model = md.Create("lines.txt")
        md.SetVerbosity(model, md.LEVEL_ERR)
        md.Init_NoIC(model, coupled, [0.0] * len(coupled))
        found = [md.GetLine(model, n + 1) for n in range(len(lines))]
        state = bytes(md.Serialize(model))
        for line, own in zip(lines, found, strict=True):
            for j in range(1, len(line.nodes) - 1):
                state = state.replace(
                    struct.pack("<3d", *md.GetLineNodePos(own, j)), struct.pack("<3d", *line.nodes[j])
                )
        md.Deserialize(model, state)
    for line, own in zip(lines, found, strict=True):
        if np.abs(nodes_of(own, len(line.nodes)) - line.nodes).max() > 1e-12:
            raise RuntimeError("MoorDyn did not take the start")
    return model, found


def nodes_of(line: Any, count: int) -> np.ndarray:
    """Return the positions of the nodes of a line (nodes, 3) [m]."""
    import moordyn as md

    return np.array([md.GetLineNodePos(line, j) for j in range(count)])
