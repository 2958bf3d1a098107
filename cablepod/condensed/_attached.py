"""Attachments in the condensed model: shapes, stiffness, damping and loads of dampers and springs, drag of bodies on the chord.

An attachment moves by u = psi q along its direction d, beside the line between the ends: psi = (d.n) phi(S_d) + (d.e) eta(S_d),
where eta is the chordwise motion of the place that belongs to the deflection phi, by the slopes at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._reference_state import between_held_ends
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.parameters._parameters import Attachment, Parameters
from cablepod.scene._wind_field import linear_between

if TYPE_CHECKING:
    from cablepod.condensed._coefficients import Coefficients


@dataclass(frozen=True, eq=False)
class BodyLoads:
    """Drag of bodies along the chord, where they move with the line between the ends."""

    fractions: tuple[float, ...]  #: places as fractions of the length (bodies,)
    force: np.ndarray  #: along the chord, linear between samples (samples, bodies) [N]
    samples_per_second: float  #: from t = 0 on [1/s]
    mean: np.ndarray  #: that of the equilibrium from which runs start (bodies,) [N]

    def at(self, times: np.ndarray) -> np.ndarray:
        """Return the forces at instants [s] (bodies, times) [N]."""
        samples = np.arange(len(self.force))
        return linear_between(samples, self.force, times * self.samples_per_second, axis=0).T


def has_load(p: Parameters, attachment: Attachment) -> bool:
    """Whether an attachment is a load of the coordinates: a spring, or a damper between ends that move."""
    return bool(attachment.spring or (attachment.damper and p.motions))


def loading(chain: LumpedChain) -> list[tuple[Attachment, float]]:
    """Return the attachments that are loads, and their places as fractions of the length."""
    pairs = zip(chain.p.attachments, chain.attached_fractions, strict=True)
    return [(attachment, fraction) for attachment, fraction in pairs if has_load(chain.p, attachment)]


def shape_along(model: Coefficients, attachment: Attachment, fraction: float) -> np.ndarray:
    """Return psi (r,) [kg^-1/2], by which an attachment moves along its direction for unit coordinates."""
    chain, place = model.chain, place_of(model.chain, fraction)
    frame, d = ChordFrame.of(np.diff(chain.p.initial_ends, axis=0), model.reference), np.asarray(attachment.direction)
    psi = np.zeros(len(model.shapes))
    for which, normal, slope in zip(model.sets, frame.normals[0], model.rest_slopes, strict=True):
        shortening = slope * model.slopes[which] * chain.length
        psi[which] = (d @ normal) * (model.shapes[which] @ place)
        psi[which] += (d @ frame.along[0]) * chordwise_motion(chain, shortening, place)
    return psi


def place_of(chain: LumpedChain, fraction: float) -> np.ndarray:
    """Return the shares of the particles in a place, by the lever rule (n + 1,)."""
    j, right = chain.lever(fraction)
    shares = np.zeros(chain.links + 1)
    shares[j], shares[j + 1] = 1.0 - right, right
    return shares


def chordwise_motion(chain: LumpedChain, shortening: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the motion of a place along the chord (...) [m] by links that shorten (..., n) [m] between held ends.

    The change of H, which keeps the distance of the ends, lengthens each link by its compliance.
    """
    return np.asarray(between_held_ends(-shortening, compliance_shares(chain)) @ place[1:])


def compliance_shares(chain: LumpedChain) -> np.ndarray:
    """Return the shares of the compliance of the cable that the links up to each particle have (n,)."""
    sums = np.cumsum(1.0 / chain.k)
    return np.asarray(sums / sums[-1])


def damping_of_dampers(model: Coefficients) -> np.ndarray:
    """Return the damping matrix of all dampers (r, r) [1/s]; without entries: none."""
    chain, matrix = model.chain, np.zeros((len(model.shapes), len(model.shapes)))
    for attachment, fraction in zip(chain.p.attachments, chain.attached_fractions, strict=True):
        if attachment.damper:
            psi = shape_along(model, attachment, fraction)
            matrix += attachment.damper * np.outer(psi, psi)
    return matrix if matrix.any() else np.empty((0, 0))


def forces_of_line(
    model: Coefficients, ends: np.ndarray, velocities: np.ndarray, rest: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the boundary data of the attachments that are loads.

    Parameters
    ----------
    model
        Model, whose rest is at the initial positions of the ends.
    ends, velocities
        Positions [m] and velocities [m/s] of the ends, all coordinates of the lower one first (2 dims, instants); no columns of
        velocities where no end moves.
    rest
        Coordinates in which the springs have no force (r,).

    Returns
    -------
    tuple of numpy.ndarray
        Factors of their stiffness, ones (loads, instants), and forces along their shapes (loads, instants) [N]: those of springs
        on the line between the ends, at the coordinates of rest, and of dampers on its velocity.
    """
    p, pairs = model.chain.p, loading(model.chain)
    moved = ends - p.initial_ends.reshape(-1, 1)
    axis = ChordFrame.of(np.diff(p.initial_ends, axis=0), model.reference).along[0]
    compliance = compliance_shares(model.chain)
    forces = np.zeros((len(pairs), ends.shape[1]))
    for force, psi, (attachment, fraction) in zip(forces, model.attached_shapes, pairs, strict=True):
        d = np.asarray(attachment.direction)
        # a longer chord lengthens the parts by their compliance
        share = compliance @ place_of(model.chain, fraction)[1:] - fraction
        stretch = share * (d @ axis) * axis
        along = np.concatenate([(1.0 - fraction) * d - stretch, fraction * d + stretch])
        force += attachment.spring * (psi @ rest - along @ moved)
        if velocities.shape[1]:
            force -= attachment.damper * (along @ velocities)
    return np.ones_like(forces), forces
