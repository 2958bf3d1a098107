"""Section forces and reactions of a run over time, and their envelopes."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastTrajectory
from cablepod.mast._sections import anchor_forces, compression, foot_force, section_forces

#: Outputs over time that follow from the equilibrium of the run -> their dimensions.
OVER_TIME = {
    "bending_moment": ("time", "node", "coordinate"), "shear_force": ("time", "element", "end", "coordinate"),
    "axial_compression": ("time", "element"), "foot_force": ("time", "coordinate"),
    "anchor_force": ("time", "guy", "coordinate"),
}  # fmt: skip
#: Output of all envelopes, and outputs that need the forces of each instant.
ENVELOPES = "envelopes"
NEED_FORCES = {*OVER_TIME, ENVELOPES, "extremes"}


def spatial(values: np.ndarray) -> np.ndarray:
    """Return values in x and z (..., 2) as vectors (..., 3) without vertical part."""
    result = np.zeros((*values.shape[:-1], 3))
    result[..., 0], result[..., 2] = values[..., 0], values[..., 1]
    return result


class Forces:
    """Forces of a run at its outputs; each is computed where it is asked for."""

    def __init__(self, mast: ModalMast, run: MastTrajectory, *, shear: bool) -> None:
        self.mast, self.run, self.shear = mast, run, shear

    @cached_property
    def _sections(self) -> tuple[np.ndarray, np.ndarray]:
        return section_forces(self.mast, self.run, shear=self.shear)

    @property
    def bending_moment(self) -> np.ndarray:
        """Bending moments in x and z (outputs, nodes, 2) [N m]."""
        return self._sections[0]

    @property
    def shear_force(self) -> np.ndarray:
        """Horizontal forces at both ends of the elements in x and z (outputs, elements, end, 2) [N]."""
        return self._sections[1]

    @cached_property
    def axial_compression(self) -> np.ndarray:
        """Axial forces at the lower ends of the elements (outputs, elements) [N]."""
        return compression(self.mast, self.run)

    @cached_property
    def foot_force(self) -> np.ndarray:
        """Forces on the foundation (outputs, 3) [N]."""
        return foot_force(self.shear_force, self.axial_compression)

    @cached_property
    def anchor_force(self) -> np.ndarray:
        """Forces on the anchors (outputs, guys, 3) [N]."""
        return anchor_forces(self.mast, self.run)


def over_time(forces: Forces, outputs: tuple[str, ...]) -> dict[str, Any]:
    """Return the outputs over time that are asked for."""
    result: dict[str, Any] = {}
    for name, dims in OVER_TIME.items():
        if name in outputs and (name != "anchor_force" or forces.mast.rest.p.guys):
            values = getattr(forces, name)
            result[name] = (dims, spatial(values) if name in ("bending_moment", "shear_force") else values)
    return result


def envelopes(forces: Forces, displacement: np.ndarray, within: np.ndarray, guys: str) -> dict[str, Any]:
    """Return largest and least values over the outputs of a window.

    Parameters
    ----------
    forces
        Of the run.
    displacement
        Of the levels in x and z (outputs, levels, 2) [m].
    within
        Which outputs are in the window (outputs,).
    guys
        Kind of guys.
    """
    mast, run = forces.mast, forces.run
    axial, foot = forces.axial_compression[within], forces.foot_force[within]
    result: dict[str, Any] = {
        "displacement_largest": (("level",), _largest(displacement[within])),
        "bending_moment_largest": (("node",), _largest(forces.bending_moment[within])),
        "shear_force_largest": (("element",), _largest(forces.shear_force[within]).max(axis=-1)),
        "axial_compression_minimum": (("element",), axial.min(axis=0)),
        "axial_compression_maximum": (("element",), axial.max(axis=0)),
        "foot_force_minimum": (("coordinate",), foot.min(axis=0)),
        "foot_force_maximum": (("coordinate",), foot.max(axis=0)),
        "foot_force_horizontal_largest": ((), _largest(foot[:, [0, 2]])),
    }
    if mast.rest.p.guys:
        anchor = forces.anchor_force[within]
        result |= {
            "anchor_force_minimum": (("guy", "coordinate"), anchor.min(axis=0)),
            "anchor_force_maximum": (("guy", "coordinate"), anchor.max(axis=0)),
            "anchor_force_largest": (("guy",), _largest(anchor)),
            "anchor_force_horizontal_largest": (("guy",), _largest(anchor[..., [0, 2]])),
        }
        if guys != "catenary":
            result["guy_axial_force_minimum"] = (("guy",), run.monitor[:, 0])
    return result


def _largest(vectors: np.ndarray) -> np.ndarray:
    """Return the largest magnitude over time of vectors (outputs, ..., components)."""
    # faster than a sum along so short an axis
    squared = sum(vectors[..., c] * vectors[..., c] for c in range(vectors.shape[-1]))
    return np.sqrt(np.max(squared, axis=0))
