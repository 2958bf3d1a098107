"""Small vibrations of one deflection about rest: tangent, static shapes, frequencies, also with attachments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cablepod.chain._air import ChainAir
from cablepod.chain._start import rest_shape
from cablepod.condensed._attached import chordwise_motion, place_of
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._damped_vibrations import damped_vibrations
from cablepod.discretisation._formulas import green_tangent
from cablepod.pod._label import fix_sign
from cablepod.wind._air import mean_air_of

#: Minimum norm of a shape after orthogonalisation, relative to its norm before (below, it is a sum of the others up to rounding).
INDEPENDENT = 1e-8
#: Least mass of an attachment that has a kink shape, over that of the cable.
HEAVY = 0.01
#: Sine of the angle between the direction of an attachment and a deflection below which it does not act on that.
LEAST_SINE = 1e-6


class RestTangent(NamedTuple):
    """Deflection at rest and its tangent with chordwise inertia neglected, for one normal of the chord."""

    deflection: np.ndarray  #: at rest (particle,) [m]
    stiffness: np.ndarray  #: force per unit slope at constant chordwise force (n,) [N]
    shortening: np.ndarray  #: decrease of the chordwise stretch per unit slope at constant chordwise force (n,)
    compliance: float  #: chordwise compliance of the whole cable [m/N]
    #: Displacements of attachments along their directions for unit deflections of the inner particles (attachments, n - 1): of
    #: springs times the root of the spring [(N/m)^1/2], of dampers times the root of the damper [(N s/m)^1/2], of all that have a
    #: kink shape; None without any
    springs: np.ndarray | None = None
    dampers: np.ndarray | None = None
    kinks: np.ndarray | None = None


def tangents_at_rest(chain: LumpedChain) -> list[RestTangent]:
    """Return the tangent of each deflection at rest."""
    air = mean_air_of(chain.p)
    position, tension = rest_shape(chain, None if air is None else ChainAir(chain, air))
    stretch = chain.stretch(position)
    frame = ChordFrame.of((position[-1] - position[0])[None])
    direction = np.diff(position, axis=0) / (stretch * chain.length)[:, None]
    along = direction @ frame.along[0]
    # strain energy by chordwise stretch and slope: secant times the projection normal to the link, plus tangent along it
    secant = tension / stretch
    k = chain.axial_stiffness
    tangent = green_tangent(stretch * stretch, k) if chain.green else k * np.ones(chain.links)
    chordwise = secant + (tangent - secant) * along * along
    compliance = float((chain.length / chordwise).sum())
    result = []
    for deflection, normal in zip(frame.split(position[None])[1][:, 0], frame.normals[0], strict=True):
        slope = direction @ normal
        mixed = (tangent - secant) * along * slope
        transverse = secant + (tangent - secant) * slope * slope
        shortening = mixed / chordwise
        attached = _attached(chain, frame.along[0], normal, shortening) if chain.p.attachments else ()
        result.append(RestTangent(deflection, transverse - mixed * shortening, shortening, compliance, *attached))
    return result


def _attached(
    chain: LumpedChain, along: np.ndarray, normal: np.ndarray, shortening: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rows of springs, dampers and kink shapes of a tangent, see :class:`RestTangent`."""
    springs, dampers, kinks = [], [], []
    steps = np.eye(chain.links + 1)[1:-1]
    of_links = shortening * np.diff(steps, axis=1)  # by each inner particle (n - 1, n)
    heavy = HEAVY * chain.p.mass * chain.total_length
    for attachment, fraction in zip(chain.p.attachments, chain.attached_fractions, strict=True):
        place = place_of(chain, fraction)
        if attachment.mass >= heavy:
            kinks.append(place[1:-1])
        d = attachment.direction
        if d is None or abs(d @ normal) < LEAST_SINE:
            continue
        row = (d @ normal) * place[1:-1] + (d @ along) * chordwise_motion(chain, of_links, place)
        springs += [np.sqrt(attachment.spring) * row] if attachment.spring else []
        dampers += [np.sqrt(attachment.damper) * row] if attachment.damper else []
        kinks.append(row)

    def array(rows: list[np.ndarray]) -> np.ndarray:
        return np.array(rows).reshape(-1, chain.links - 1)

    return array(springs), array(dampers), array(kinks)


def _root_of_stiffness(chain: LumpedChain, tangent: RestTangent) -> np.ndarray:
    """Return the matrix B (n + 1 + springs, inner particles) [(N/m)^1/2] with the stiffness B^T B."""
    rows = np.zeros((chain.links + 1, chain.links - 1))
    inner, root = np.arange(chain.links - 1), np.sqrt(tangent.stiffness / chain.length)
    rows[inner, inner], rows[inner + 1, inner] = root[:-1], -root[1:]
    rows[-1] = (tangent.shortening[:-1] - tangent.shortening[1:]) / np.sqrt(tangent.compliance)
    return rows if tangent.springs is None else np.concatenate([rows, tangent.springs])


def vibrations(chain: LumpedChain, tangent: RestTangent) -> tuple[np.ndarray, np.ndarray]:
    """Return angular frequencies (mode,) [rad/s] and shapes (mode, particle) of all vibrations of one deflection about rest."""
    from scipy.linalg import svd  # costly to import

    mass_root = np.sqrt(chain.mass[1:-1])
    _, omega, vectors = svd(_root_of_stiffness(chain, tangent) / mass_root, full_matrices=False)
    return omega[::-1], _shapes(chain, vectors[::-1])


def _shapes(chain: LumpedChain, vectors: np.ndarray) -> np.ndarray:
    """Return shapes (mode, particle) of mass-weighted orthonormal vectors (mode, inner particle)."""
    inner = chain.mass[1:-1]
    shapes = vectors / np.sqrt(inner / inner.mean())
    return fix_sign(np.pad(shapes, ((0, 0), (1, 1)))[:, :, None])[:, :, 0]


def with_vector(basis: np.ndarray, vector: np.ndarray, most: int, least: float = INDEPENDENT) -> np.ndarray:
    """Return orthonormal rows and what a vector has beside them, of unit norm; at most `most` rows.

    Without the vector where that is less than `least` of its norm.
    """
    vector = vector / np.linalg.norm(vector)
    for _ in range(2):  # once more against rounding
        vector = vector - (basis @ vector) @ basis
    norm = np.linalg.norm(vector)
    return np.concatenate([basis, vector[None] / norm]) if norm > least and len(basis) < most else basis


def with_static_shapes(
    chain: LumpedChain, tangent: RestTangent, shapes: np.ndarray, rank: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return `rank` modes that begin with the static shapes, and the roots of their Rayleigh quotients."""
    root, mass_root = _root_of_stiffness(chain, tangent), np.sqrt(chain.mass[1:-1])
    flexibility = chain.length / tangent.stiffness
    mean = (flexibility @ tangent.shortening) / flexibility.sum()
    derivative = np.cumsum(flexibility * (tangent.shortening - mean))[:-1]  # by the distance of the ends, of any size
    candidates = [tangent.deflection[1:-1], derivative, *shapes[:, 1:-1]]
    basis = np.empty((0, chain.links - 1))
    for candidate in candidates:
        basis = with_vector(basis, candidate * mass_root, rank)
    return np.linalg.norm((basis / mass_root) @ root.T, axis=1), _shapes(chain, basis)


def kinks_beside(chain: LumpedChain, tangent: RestTangent, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the kink shapes that modes lack (kinks, particle), and the roots of their Rayleigh quotients [rad/s].

    A kink shape is the deflection by a force on an attachment, along its direction, less its part along the modes and the other
    kink shapes; `shapes` are the modes (mode, particle), orthonormal in mass up to one factor.
    """
    if tangent.kinks is None:
        return np.empty((0, chain.links + 1)), np.empty(0)
    from scipy.linalg import solve_triangular  # costly to import

    mass_root = np.sqrt(chain.mass[1:-1])
    root = _root_of_stiffness(chain, tangent) / mass_root
    basis = shapes[:, 1:-1] * mass_root
    basis, count = basis / np.linalg.norm(basis, axis=1, keepdims=True), len(basis)
    upper = np.linalg.qr(root, mode="r")
    for row in tangent.kinks:
        vector = solve_triangular(upper, solve_triangular(upper, row / mass_root, trans=1))
        basis = with_vector(basis, vector, chain.links - 1)
    kinks = basis[count:]
    return _shapes(chain, kinks) if len(kinks) else np.empty((0, chain.links + 1)), np.linalg.norm(
        root @ kinks.T, axis=0
    )


def with_dampers(
    chain: LumpedChain, tangent: RestTangent, omega: np.ndarray, shapes: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the roots lambda (mode,) [1/s] and complex shapes (mode, particle) of `count` vibrations with dampers.

    `omega` and `shapes` are those of all vibrations without them.
    """
    assert tangent.dampers is not None
    mass_root = np.sqrt(chain.mass[1:-1])
    vectors = shapes[:, 1:-1] * mass_root
    vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    roots, found = damped_vibrations(omega, vectors.T, (tangent.dampers / mass_root).T, count)
    fields = found.T / np.sqrt(chain.mass[1:-1] / chain.mass[1:-1].mean())
    largest = fields[np.arange(len(fields)), np.abs(fields).argmax(axis=1)]
    fields = np.pad(fields * (np.abs(largest) / largest)[:, None], ((0, 0), (1, 1)))
    return roots, fields
