"""Section forces and reactions of a run by the equilibrium of the mast, over time and their envelopes."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from cablepod.conventions import ENDS
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastTrajectory
from cablepod.mast._statics import load_vectors, seen_by

#: Outputs over time that follow from the equilibrium of the run -> their dimensions.
OVER_TIME = {
    "bending_moment": ("time", "node", "coordinate"), "shear_force": ("time", "element", "end", "coordinate"),
    "axial_compression": ("time", "element"), "foot_force": ("time", "coordinate"),
    "anchor_force": ("time", "guy", "coordinate"),
}  # fmt: skip
#: Output of all envelopes, and outputs that need the forces of each instant.
ENVELOPES = "envelopes"
NEED_FORCES = {*OVER_TIME, ENVELOPES, "extremes"}


def section_forces(mast: ModalMast, run: MastTrajectory, *, shear: bool = True) -> tuple[np.ndarray, np.ndarray]:
    r"""Return bending moments (outputs, nodes, 2) [N m] and horizontal forces (outputs, elements, end, 2) [N] in x and z.

    The displacement u of the modes kept lacks the static displacement by the forces that these modes do not contain,

    .. math::

        u_c = K^{-1} \big[(1 - M \Phi \Phi^T) R - (K \Phi - M \Phi \Omega^2) a\big], \qquad
        R = F + K_g u - \sum_l (P_l - P_{l,0}) G_l (u_0 + u),

    with loads, drag and forces of the guys F less those at rest, their static stiffness K_g about rest, stiffness K and mass M of
    mast and guys, the pull P of the guys at each level and the geometric stiffness G of a pull of one.  The second term vanishes
    for modes of K and M.  Section forces S are those of the elements,

    .. math:: S (u_0 + u + u_c) + \sum_l (P_l - P_{l,0}) S_l (u_0 + u),

    and of drag and inertia on the elements themselves: in equilibrium with loads, drag, guys, weight and inertia above.  Without
    `shear` the second array has no elements.

    References
    ----------
    R. R. Craig and A. J. Kurdila, Fundamentals of Structural Dynamics (2006), section 11.4: mode acceleration method.
    """
    n, rest, request = run.completed, mast.rest, run.request
    beam, modal, force = rest.beam, run.modal[:n], run.force[:n] - run.force[:1]
    shape, inertia = mast.modes, mast.mass_with_guys @ mast.modes
    nodes = beam.height.size
    kept = slice(None) if shear else slice(nodes)
    rows = rest.section_rows[kept].reshape(-1, beam.count)
    # section forces (2 (nodes + element ends), count) by static forces, and by what of them the modes do not contain
    by_forces = np.linalg.solve(rest.stiffness, rows.T).T
    by_inertia = by_forces @ inertia + beam.inertia_sections[kept].reshape(-1, beam.count) @ shape
    by_others = by_forces - by_inertia @ shape.T
    by_modes = by_inertia * mast.omega**2
    by_modes = by_modes + by_others @ seen_by(rest.rows, rest.guy_stiffness) @ shape
    total = modal @ by_modes.T
    total += force[:, :, [0, 2]].reshape(n, -1) @ (by_others @ rest.rows.reshape(-1, beam.count).T).T
    factors = request.factors(rest.p.loads)
    if factors.size:
        at_outputs = factors[:, :: request.every][:, :n]
        total += (at_outputs - factors[:, :1]).T @ (by_others @ load_vectors(rest.p, beam).T).T
    if run.drag.size:
        drag = np.swapaxes(run.drag[:n, :, : nodes - 1] - run.drag[:1, :, : nodes - 1], 1, 2)  # the foot carries none
        by_drag = by_others @ rest.drag.rows[1:].reshape(-1, beam.count).T + np.kron(
            rest.drag.section_rows[kept, 1:], np.eye(2)
        )
        total += drag.reshape(n, -1) @ by_drag.T
    for level, pull in _added_pulls(mast, run):
        by_pull = beam.sections_of_pull(level)[kept].reshape(-1, beam.count) - by_others @ beam.of_pull(level)
        total += pull[:, None] * (by_pull @ rest.unknowns + modal @ (by_pull @ shape).T)
    result = rest.sections[kept] + total.reshape(n, -1, 2)
    return result[:, :nodes], result[:, nodes:].reshape(n, -1, len(ENDS), 2)


def _added_pulls(mast: ModalMast, run: MastTrajectory) -> list[tuple[float, np.ndarray]]:
    """Return the levels of guys [m] and the downward pull on each, less that at rest (outputs,) [N]."""
    force = run.force[: run.completed, :, 1] - run.force[:1, :, 1]
    return [
        (float(mast.heights[level]), -force[:, mast.level_of_guy == level].sum(axis=1))
        for level in np.unique(mast.level_of_guy).tolist()
    ]


def foot_force(shear: np.ndarray, axial: np.ndarray) -> np.ndarray:
    """Return the force of the mast on its foundation (..., 3) [N]: section forces at the lower end of its lowest element."""
    across = shear[..., 0, 0, :]
    return np.stack([across[..., 0], -axial[..., 0], across[..., 1]], axis=-1)


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
        middle = self.mast.rest.beam.middle
        total = np.repeat(self.mast.rest.compression[None], self.run.completed, axis=0)
        for level, pull in _added_pulls(self.mast, self.run):
            total += pull[:, None] * (middle < level)
        return total

    @cached_property
    def foot_force(self) -> np.ndarray:
        """Forces on the foundation (outputs, 3) [N]."""
        return foot_force(self.shear_force, self.axial_compression)

    @cached_property
    def anchor_force(self) -> np.ndarray:
        r"""Forces of the guys on their anchors (outputs, guys, 3) [N].

        At rest they are those of the catenaries.  In motion the force along the present chord is that at the mast, and both ends
        carry the same change of the transverse forces, drag and inertia, as for a motion symmetric about the middle of the guy:
        with the force f of the guy on the mast and the direction e of the chord,

        .. math:: f_a = f_{a,0} + g - g_0, \qquad g = f - 2 (f \cdot e) e.
        """
        mast, run = self.mast, self.run
        rest, n = mast.rest, run.completed
        lower = np.array([guy.p.lower for guy in rest.p.guys], dtype=float).reshape(-1, 3)
        along = mast.upper_ends(run.modal[:n]) - lower
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        force = run.force[:n]
        turned = force - 2.0 * (force * along).sum(axis=-1, keepdims=True) * along
        result = rest.statics.anchor_forces + turned - turned[:1]
        result[run.request.broken_at_outputs(rest.p)[:n]] = 0.0
        return result


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
    along_axes = np.maximum(-run.of_levels.least, run.of_levels.largest).max(axis=-1)  # at all steps
    result: dict[str, Any] = {
        "displacement_largest": (("level",), np.maximum(_largest(displacement[within]), along_axes)),
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
            result["guy_axial_force_minimum"] = (("guy",), run.least)
    return result


def _largest(vectors: np.ndarray) -> np.ndarray:
    """Return the largest magnitude over time of vectors (outputs, ..., components)."""
    # faster than a sum along so short an axis
    squared = sum(vectors[..., c] * vectors[..., c] for c in range(vectors.shape[-1]))
    return np.sqrt(np.max(squared, axis=0))
