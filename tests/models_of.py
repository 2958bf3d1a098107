"""What each model of one cable needs beside a scene: elements, modes, a cable given by its length."""

from __future__ import annotations

from typing import Any

from scenes import rigid_scene

import cablepod as cp

#: Models of one cable, and layouts of the modes of reduced ones.
ALL = ("chain", "cable", "rigid", "galerkin", "condensed")
LAYOUTS = {"galerkin": "separate", "condensed": "normal"}


def options_of(model: str, mapping: dict[str, Any], rank: int = 2) -> dict[str, Any]:
    """Return elements, or modes by a chain of the scene of a mapping."""
    if model in LAYOUTS:
        chain = cp.chain.simulate(cp.make_scene(mapping), step=1e-3)
        return {"modes": cp.pod.decompose(chain, layout=LAYOUTS[model], rank=rank)}
    return {"elements": 2} if model == "cable" else {}


def scene_of(model: str, mapping: dict[str, Any]) -> Any:
    """Make the scene of a mapping, for rigid links with a cable given by its length."""
    return rigid_scene(mapping) if model == "rigid" else cp.make_scene(mapping)
