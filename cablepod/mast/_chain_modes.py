"""Chains as guys in small vibrations about rest: their modes between held ends, and the static shapes of a moved upper end.

The mass of a link is half lumped, half that of linear shapes, so that frequencies of taut chains err by the fourth power of the
length of the links (Hughes 2000, section 9.1).  With the modes of the chain between held ends and its static shapes (Craig and
Bampton 1968), the momentum coordinates p = q + m.u of the modes q make the mass matrix block diagonal, as for condensed guys.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cablepod.chain._small_vibrations import assembled, stiffness_of_links
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._nonuniform import compliances
from cablepod.mast._chain_run import ChainGuys


class GuyModes(NamedTuple):
    """Guys in modes of unit mass and the displacement of their upper ends in x and z, as momentum coordinates."""

    tangents: np.ndarray  #: stiffness (guys, modes + 2, modes + 2)
    end_mass: np.ndarray  #: mass of the upper ends at fixed coordinates (guys, 2, 2) [kg]


def guy_modes(guys: ChainGuys, count: int) -> GuyModes:
    """Return up to `count` modes of each guy of a mast about rest in the air of the guys."""
    count = min(count, 3 * (guys.links - 1))
    found = [_modes(chain, x.T, count) for chain, x in zip(guys.chains, guys.rest, strict=True)]
    tangents, masses = (np.array([pair[k] for pair in found]) for k in range(2))
    return GuyModes(tangents.reshape(-1, count + 2, count + 2), masses.reshape(-1, 2, 2))


def _modes(chain: LumpedChain, position: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices of :class:`GuyModes` of one guy at rest at positions (n + 1, 3) [m]."""
    from scipy.linalg import eigh  # costly to import

    n = chain.links
    mass, stiffness = _mass(chain), _stiffness(chain, position)
    inner, end = slice(3, 3 * n), [3 * n, 3 * n + 2]
    static = -np.linalg.solve(stiffness[inner, inner], stiffness[inner, end])
    squared, shapes = eigh(stiffness[inner, inner], mass[inner, inner], subset_by_index=[0, count - 1])
    with_static = mass[inner, inner] @ static + mass[inner, end]
    moments = shapes.T @ with_static
    end_mass = mass[np.ix_(end, end)] + static.T @ with_static + mass[inner, end].T @ static - moments.T @ moments
    tangent = np.zeros((count + 2, count + 2))
    tangent[:count, :count] = np.diag(squared)
    tangent[:count, count:] = -squared[:, None] * moments
    tangent[count:, :count] = tangent[:count, count:].T
    held = stiffness[np.ix_(end, end)] + stiffness[inner, end].T @ static
    tangent[count:, count:] = held + moments.T @ (squared[:, None] * moments)
    return tangent, end_mass


def _mass(chain: LumpedChain) -> np.ndarray:
    """Return the mass matrix of all particles (3 (n + 1), 3 (n + 1)) [kg]."""
    p = chain.p
    per_length = [segment.mass for segment in p.segments] or [float(p.mass)]
    borders = [0.0, *(segment.end for segment in p.segments)] if p.segments else [0.0, 1.0]
    of_links = compliances(chain.arc_length, borders, 1.0 / np.array(per_length))  # their integral over each link
    return np.kron(np.diag(chain.mass) - assembled(of_links[:, None, None] / 12.0)[:, 0, :, 0], np.eye(3))


def _stiffness(chain: LumpedChain, position: np.ndarray) -> np.ndarray:
    """Return the stiffness of links and springs about rest (3 (n + 1), 3 (n + 1)) [N/m]."""
    tension = chain.tensions_and_forces(position)[0]
    result = assembled(stiffness_of_links(np.diff(position, axis=0), tension, chain.k))
    for particle, attachment in zip(chain.attached_particles, chain.p.attachments, strict=True):
        if attachment.spring:
            assert attachment.direction is not None
            result[particle, :, particle] += attachment.spring * np.outer(attachment.direction, attachment.direction)
    return result.reshape(3 * len(result), -1)
