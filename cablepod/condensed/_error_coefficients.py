"""Coefficients of the equation of the error: enriched modes, and points along the cable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.condensed._attached import loading
from cablepod.condensed._coefficients import Coefficients
from cablepod.condensed._kernels_layout import ErrorTerms, LeadingTerms, runtime_sizes
from cablepod.condensed._rest_tangent import with_vector
from cablepod.discretisation._chain import LumpedChain
from cablepod.parameters._parameters import Parameters

#: Number of sines that the enriched model has beyond the modes of each deflection (fewer where particles are few).
EXTRA_MODES = 3
#: Minimum part of a triangle that modes lack.
INDEPENDENT = 1e-6
#: Joint Newton corrections of the closure, for order "leading" and for others (one leaves 1e-2 of the change, two 1e-4).
CORRECTIONS_LEADING, CORRECTIONS = 1, 2


def enriched_modes(
    sets: Sequence[np.ndarray], sigma: np.ndarray, masses: np.ndarray | None = None, kinks: Sequence[float] = ()
) -> tuple[np.ndarray, ...]:
    """Complete each set of modes (mode, particle) by the EXTRA_MODES sines of the relative arc length that it lacks most.

    What a sine lacks is what is left of it, per its norm, without the parts along the modes and the sines taken before, in the
    product of masses; over its squared number, as a force of that shape displaces a taut string.  So a sine that the modes
    contain is never taken, in whatever form and order they are given.

    Parameters
    ----------
    sets, sigma
        Modes of each deflection, independent, and relative arc lengths of the particles (particle,).
    masses
        Of the particles, of any unit (particle,); by default in proportion to the lengths.
    kinks
        Places, as fractions of the length, of triangles that the bases contain too.

    Returns
    -------
    tuple of numpy.ndarray
        Bases of each deflection, orthonormal in that product, zero at the ends; as many rows as inner particles at most.
    """
    length, inner = np.diff(sigma), sigma.size - 2
    # of the masses at the inner particles
    root = np.sqrt(0.5 * (length[1:] + length[:-1]) if masses is None else masses[1:-1] / masses.sum())
    triangles = np.array([np.minimum(sigma / place, (1.0 - sigma) / (1.0 - place)) for place in kinks])
    bases = []
    for psi in sets:
        number = np.arange(1, min(2 * (len(psi) + EXTRA_MODES), inner) + 1)
        left = np.sin(math.pi * np.outer(number, sigma[1:-1])) * root
        left /= np.linalg.norm(left, axis=1)[:, None]
        basis = np.linalg.qr((psi[:, 1:-1] * root).T)[0].T
        for triangle in triangles[:, 1:-1] * root if len(triangles) else ():
            basis = with_vector(basis, triangle, inner, INDEPENDENT)
        for _ in range(min(EXTRA_MODES, inner - len(basis))):
            for _ in range(2):  # the second time takes off what rounding left
                left -= left @ basis.T @ basis
            norm = np.linalg.norm(left, axis=1)
            chosen = int(np.argmax(norm / number**2))
            basis = np.concatenate([basis, left[chosen : chosen + 1] / norm[chosen]])
        bases.append(np.pad(basis / root, ((0, 0), (1, 1))))
    return tuple(bases)


class _UnitCable(NamedTuple):
    """The parameters that coefficients depend on, for a cable of unit mass per length."""

    dims: int
    motions: bool
    point_loads: tuple[_PointLoad, ...]
    mass: float = 1.0
    masses: None = None
    segments: tuple[()] = ()
    attachments: tuple[()] = ()


class _PointLoad(NamedTuple):
    fraction: float


class _Points(NamedTuple):
    """Points along a cable of unit length and mass."""

    weights: np.ndarray
    #: chordwise inertia, of links its factors, see :attr:`Coefficients.inertia`; grows with the mass per length, and with the
    #: length as `inertia_powers` say
    inertia: np.ndarray
    inertia_powers: np.ndarray  #: powers of the length, a column
    patterns: np.ndarray
    slopes: np.ndarray


class Cables(NamedTuple):
    """Numbers of cables (cables,)."""

    stiffness: np.ndarray  #: K [N]
    mass: np.ndarray  #: per unstretched length [kg/m]
    damping: np.ndarray  #: by mass [1/s]
    length: np.ndarray  #: L0 [m]


def unit_coefficients(
    sets: Sequence[np.ndarray], sigma: np.ndarray, p: Parameters, points: int
) -> tuple[Coefficients, _Points]:
    """Return the coefficients of an enriched model of unit length and mass.

    Parameters
    ----------
    sets, sigma
        Modes of each deflection (mode, particle), and relative arc lengths (particle,).
    p
        Parameters with the kinds of loads of the scene.
    points
        Number of points of a Gauss rule; 0 for the links.
    """
    return _unit_coefficients(
        tuple(np.ascontiguousarray(part, dtype=float).tobytes() for part in sets),
        np.round(sigma, 12).tobytes(),  # the same for all lengths
        bool(p.motions),
        tuple(load.fraction for load in p.point_loads),
        points,
    )


@lru_cache(maxsize=64)
def _unit_coefficients(
    modes: tuple[bytes, ...], sigma: bytes, moving: bool, fractions: tuple[float, ...], points: int
) -> tuple[Coefficients, _Points]:
    """Return the coefficients of an enriched model of unit length and mass; cached, as many scenes share modes.

    Parameters
    ----------
    modes, sigma
        Bytes of the modes of each set (mode, particle), and of the relative arc lengths (particle,).
    moving, fractions
        Whether ends move; places of the point loads.
    points
        Number of points of a Gauss rule; 0 for the links.
    """
    places = np.frombuffer(sigma)
    sets = [np.frombuffer(part).reshape(-1, places.size) for part in modes]
    p: Any = _UnitCable(len(sets) + 1, moving, tuple(map(_PointLoad, fractions)))
    chain = LumpedChain(p, np.diff(places), places)
    unit = Coefficients(chain, "inertial", enriched_modes(sets, places))
    slopes, patterns = unit.slopes, unit.chordwise_force_patterns
    if not 0 < points < chain.links:
        return unit, _Points(chain.length, unit.inertia, np.array([[1.0], [0.0]]), patterns, slopes)
    at, weights = gauss_rule(points)
    middles = 0.5 * (places[1:] + places[:-1])
    left = np.clip(np.searchsorted(middles, at) - 1, 0, middles.size - 2)
    fraction = (at - middles[left]) / (middles[left + 1] - middles[left])

    def interpolated(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values[:, left] * (1.0 - fraction) + values[:, left + 1] * fraction)

    # a point moves by the stretches below it and half of its own, less sigma times all
    displacement = (np.tri(points, k=-1) + 0.5 * np.eye(points) - at[:, None]) * weights
    inertia = np.ascontiguousarray((displacement.T * weights) @ displacement)
    return unit, _Points(weights, inertia, np.array([[3.0]]), interpolated(patterns), interpolated(slopes))


def terms_of_model(model: Coefficients, change: np.ndarray, in_plane: int) -> ErrorTerms:
    """Return the coefficients of the error equation of a motion to leading order, on the links, with a leading dimension of one.

    Parameters
    ----------
    model
        Enriched model of a cable that is not uniform.
    change, in_plane
        As in :func:`scaled_terms`, without the dimension of cables.
    """
    chain, stiffness = model.chain, np.array([attachment.spring for attachment, _ in loading(model.chain)])
    springs = (np.sqrt(stiffness)[:, None] * model.attached_shapes)[stiffness > 0.0]
    enriched = LeadingTerms.of(
        chain.p.stiffness, chain.total_length, model.slope_norms_squared, model.mean_chordwise_forces,
        model.geometric_stiffness, model.load_projection,
    )  # fmt: skip
    return ErrorTerms(
        sizes=runtime_sizes(len(change), len(model.load_patterns), len(model.load_projection)),
        enriched=enriched,
        change=change[None],
        weights=chain.length[None],
        flexibility=1.0 / np.broadcast_to(chain.axial_stiffness, chain.links)[None],
        force_patterns=np.ascontiguousarray(model.chordwise_force_patterns.T[None]),
        slopes_of_motion=(np.swapaxes(model.slopes, 0, 1) @ change)[None],
        slopes=model.slopes[None],
        in_plane=in_plane,
        enriched_in_plane=model.n_in_plane,
        inertia=model.inertia[None],
        damping=np.array([chain.p.damping], dtype=float),
        springs=springs[None] if len(springs) else None,
        green=None,
        leading=True,
        corrections=CORRECTIONS_LEADING,
    )


def scaled_terms(
    unit: Coefficients,
    at: _Points,
    cables: Cables,
    load: np.ndarray,
    change: np.ndarray,
    in_plane: int,
    *,
    leading: bool,
    green: bool,
) -> ErrorTerms:
    """Return the coefficients of the error equations of cables from those of unit length and mass, with a leading dimension.

    Parameters
    ----------
    unit, at
        Coefficients of the enriched model, and points along the cable, of unit length and mass.
    cables
        Numbers of the cables.
    load
        Factor of each load pattern (cables, patterns).
    change, in_plane
        Matrices from the coordinates of the motion to the enriched ones (cables, R, r), and the number of the motion's in plane.
    leading, green
        Whether the motion obeys the closure to leading order; whether law (21) holds.
    """
    size, normals = change.shape[1], len(unit.load_projection) // load.shape[1]
    length, mass = cables.length[:, None], cables.mass[:, None]
    shape = 1.0 / np.sqrt(mass * length)
    slopes = (shape / length)[..., None] * at.slopes
    matrices = (load * shape * shape / length)[:, :, None, None] * unit.geometric_stiffness
    projection = (np.tile(load, normals) * shape)[:, :, None] * unit.load_projection
    kappa, means = unit.slope_norms_squared * (shape * shape / length), load * unit.mean_chordwise_forces
    enriched = LeadingTerms.of(cables.stiffness, cables.length, kappa, means, matrices, projection)
    powers = at.inertia_powers
    return ErrorTerms(
        sizes=runtime_sizes(size, load.shape[1], len(unit.load_projection)),
        enriched=enriched,
        change=change,
        weights=length * at.weights,
        flexibility=np.repeat(1.0 / cables.stiffness[:, None], at.weights.size, axis=1),
        force_patterns=np.ascontiguousarray(at.patterns.T * load[:, None, :]),
        slopes_of_motion=np.swapaxes(slopes, 1, 2) @ change,
        slopes=slopes,
        in_plane=in_plane,
        enriched_in_plane=unit.n_in_plane,
        inertia=mass[..., None] ** (powers > 0.0) * length[..., None] ** powers * at.inertia,
        damping=cables.damping,
        springs=None,
        green=green or None,
        leading=leading,
        corrections=CORRECTIONS_LEADING if leading else CORRECTIONS,
    )
