"""Static numbers and first frequencies of a chain with masses or stiffnesses of its own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cablepod.chain._air import ChainAir
from cablepod.chain._small_vibrations import assembled, stiffness_of_links
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain, chain_of, square
from cablepod.parameters._parameters import Parameters
from cablepod.wind._air import mean_air_of

#: Sine of the angle of chord and load below which they span no plane.
LEAST_SINE = 1e-12


def numbers_of_chain(p: Parameters) -> dict[str, Any]:
    """Return the numbers of a chain by name that do not depend on its rest."""
    chain = chain_of(p)
    result = {} if p.masses is None else {"mass": float(chain.mass.sum())}
    axial = angular_frequencies(chain, chain.k[:, None, None], 1)[0]
    return result | {"axial_stiffness": p.stiffness, "first_axial_frequency": float(axial)}


def numbers_at_rest(p: Parameters, count: int) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """Return the numbers of a chain at rest by name, and its first angular frequencies.

    Parameters
    ----------
    p
        Parameters, with the wind in which the chain rests.
    count
        Number of frequencies.

    Returns
    -------
    tuple
        Numbers by name, and angular frequencies in the plane of chord and load and normal to it [rad/s] (count,), each with the
        other displacement held; nan for a free end, and for frequencies that the chain does not have.
    """
    chain, air = chain_of(p), mean_air_of(p)
    of_air = None if air is None else ChainAir(chain, air)
    position, tension = rest_shape(chain, of_air)
    reach, chord = np.diff(position, axis=0), position[-1] - position[0]
    length, along = np.sqrt(square(reach)), chord / np.linalg.norm(chord)
    off = position - position[0]
    loads = chain.loads(0.0) if of_air is None else chain.loads(0.0) + of_air.at_rest(position)
    numbers = {
        "stretched_length": float(length.sum()),
        "tension_lower": float(tension[0]),
        "tension_upper": float(tension[-1]),
        "largest_tension": float(tension.max()),
        "strain": float((tension / chain.axial_stiffness).max()),
        "sag": float(np.sqrt(square(off - (off @ along)[:, None] * along)).max()),
    }
    if p.free_end is not None:
        none = np.full(count, math.nan)
        return numbers, none, none
    stiffness = stiffness_of_links(np.pad(reach, ((0, 0), (0, 3 - p.dims))), tension, chain.k)
    basis = _plane_and_normal(along, loads[1:-1].sum(axis=0))
    turned = np.einsum("ca,ncd,db->nab", basis, stiffness, basis)
    return (
        numbers,
        angular_frequencies(chain, turned[:, :2, :2], count),
        angular_frequencies(chain, turned[:, 2:, 2:], count),
    )


def _plane_and_normal(along: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Return two unit vectors in the plane of a unit vector and a load, and one normal to it (3, 3), as columns."""
    first, force = np.zeros(3), np.zeros(3)
    first[: along.size], force[: load.size] = along, load
    if along.size == 2:  # the plane of the scene
        normal = np.array([0.0, 0.0, 1.0])
    else:
        normal = np.cross(first, force)
        if np.linalg.norm(normal) <= LEAST_SINE * np.linalg.norm(force):  # any plane with the chord
            normal = np.cross(first, np.eye(3)[np.abs(first).argmin()])
        normal /= np.linalg.norm(normal)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def angular_frequencies(chain: LumpedChain, stiffness: np.ndarray, count: int) -> np.ndarray:
    """Return the lowest angular frequencies of the free particles [rad/s], nan beyond those that there are.

    Parameters
    ----------
    chain
        Its masses and held ends.
    stiffness
        Of the links at rest (n, directions, directions) [N/m].
    count
        Number of frequencies.
    """
    from scipy.linalg import eigvalsh  # costly to import

    free = chain.free_particles
    root = np.repeat(1.0 / np.sqrt(chain.mass[free]), stiffness.shape[1])
    inner = assembled(stiffness)[free, :, free].reshape(root.size, root.size)
    values = eigvalsh(root[:, None] * inner * root)[:count]
    return np.pad(np.sqrt(np.maximum(values, 0.0)), (0, count - values.size), constant_values=math.nan)
