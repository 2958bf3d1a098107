"""Modes of small vibrations about rest, from the linearised condensed equations instead of snapshots."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import SCENE, taken
from cablepod.chain._air import ChainAir
from cablepod.chain._start import rest_shape
from cablepod.conventions import COORDINATES, FEATURES, label, shared_coordinates
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._laws import LAWS, check_law
from cablepod.discretisation._similarity import features
from cablepod.errors import scene_error
from cablepod.parameters._checks import integer
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._nonuniform import refuse_nonuniform
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._particles import refuse_own
from cablepod.pod import _normal as pod_normal
from cablepod.pod._label import fix_sign
from cablepod.pod._snapshots import tributary_weights
from cablepod.pod._training_range import add_training_range
from cablepod.wind._air import mean_air_of
from cablepod.wind._profile import air_at_rest

#: Similarity numbers that vanish at rest.
MOTION_FEATURES = ("end_motion", "end_acceleration", "frequency")
#: Minimum norm of a shape after orthogonalisation, relative to its norm before (below, it is a sum of the others up to rounding).
INDEPENDENT = 1e-8
#: Minimum norm of a static shape out of the plane, relative to that in the plane (below, it is rounding).
MIN_STATIC_SHAPE = 1e-9


def vibration_modes(
    scene: xr.Dataset, *, rank: int, static_modes: bool = False, links: int | None = None, law: str = LAWS[0]
) -> xr.Dataset:
    """Compute modes of layout "normal" from small vibrations about rest, without snapshots.

    Parameters
    ----------
    scene
        A scene with both ends held and without ``member``.  Positions of the ends and loads are those at time 0, with the mean
        wind of the start and with ice.
    rank
        Number of modes of each deflection, at most the number of inner particles.
    static_modes
        Begin with two static shapes: the deflection at rest and its derivative by the distance of the ends.  Vibration modes
        follow, made orthogonal to them.  A few modes then hold the sag while the tension changes, for which many vibration modes
        are needed: use them where ends or loads move slowly.
    links
        Number of links, instead of the scene's.  Mode i of n links has an error of (i pi / n)^2 / 24 in its frequency.
    law
        "linear", the law of the chain, or "green", eq. (21).

    Returns
    -------
    xarray.Dataset
        ``mode_shape (mode, particle)`` and ``angular_frequency (mode)`` [rad/s] in increasing order, in space also with the
        suffix ``_out_of_plane``, and ``unstretched_length`` [m].  With static modes the frequencies are those of the cable held
        to the one shape (root of the Rayleigh quotient).  The Dataset takes the place of modes of
        :func:`cablepod.pod.decompose` with layout "normal" and weights "mass", but has no singular values.  ``training_range``
        is that of the scene at rest, so that ``outside_training`` of a run measures how far its ends and loads leave this state.
        The attribute ``air`` says in which air the cable is at rest: the mean wind of the scene, or with ``wind.ramp`` still air.

    Raises
    ------
    SceneError
        For invalid options, a free end, several members, and a scene whose chain has a slack link at rest.

    Notes
    -----
    At rest the tension T, its derivative T' by the stretch xi and the slopes follow from the discrete catenary.  With
    chordwise inertia neglected the deflection obeys mu w_tt = (s w')' + (a dH)', where s is the force per unit slope at constant
    chordwise force, a = -d(zeta')/d(w') at constant chordwise force, and the change dH of the chord tension keeps the distance
    of the ends: c dH = int a w' dS, with c the chordwise compliance of the whole cable.  For a shallow sag s = T, a = w0' and
    c = L0 / K, which is Irvine's equation.  On the links s D^T D + a a^T / c is a sum of squares, and the angular frequencies are
    singular values, so that a nearly inextensible cable loses no digits.  In space each deflection vibrates with the other one
    held, which differs from free vibrations only where the cable sags out of the plane of chord and vertical.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> scene = examples.scene("example2")
    >>> modes = cp.condensed.vibration_modes(scene, rank=2)
    >>> modes.angular_frequency.values.round(3).tolist(), modes.angular_frequency.units
    ([6.291, 12.444], 'rad s-1')
    >>> model = cp.condensed.simulate(scene, modes)
    """
    check_law(law)
    scene = taken("scene", scene, SCENE)
    p = parameters(scene)
    refuse_nonuniform(p, "cable.frequencies")
    refuse_own(p, "chain.simulate and pod.decompose")
    if p.free_end is not None:
        raise scene_error("ends.free", p.free_end, "two held ends, which define the chord")
    chain = chain_of(p, links, law)
    integer(least=1)("rank", rank)
    if rank > chain.links - 1:
        raise scene_error("rank", rank, f"at most {chain.links - 1}, the number of inner particles")
    variables: dict[str, Any] = {}
    tangents = tangents_at_rest(chain)
    largest = max(float(np.abs(tangent.deflection).max()) for tangent in tangents)
    for suffix, tangent in zip(pod_normal.SETS, tangents, strict=False):
        omega, shapes = vibrations(chain, tangent)
        if static_modes and np.abs(tangent.deflection).max() > MIN_STATIC_SHAPE * largest:
            omega, shapes = _with_static_shapes(chain, tangent, shapes, int(rank))
        variables[f"mode_shape{suffix}"] = (("mode", "particle"), shapes[:rank])
        variables[f"angular_frequency{suffix}"] = ("mode", omega[:rank])
    variables["unstretched_length"] = ((), chain.total_length)
    coords = {
        "mode": np.arange(1, rank + 1),
        "coordinate": list(COORDINATES[: p.dims]),
        "arc_length": ("particle", chain.arc_length),
    }
    result = xr.Dataset(variables, coords=shared_coordinates(coords))
    add_training_range(result, np.tile(_features_at_rest(p, chain.total_length), (2, 1)))
    names = {
        "mode_shape": ("1", "shape of the vibration, of unit norm in the mass of the inner particles over its mean")
    }
    if static_modes:
        names["angular_frequency"] = ("rad s-1", "root of the Rayleigh quotient of the mode about rest")
    label(
        result,
        mode=("1", "number of the mode, from 1, " + ("static modes first" if static_modes else "by rising frequency")),
        bound=("1", "least or largest, both of the scene at rest in still air"),
        training_range=("1", "numbers without dimension that decide how the scene moves, at rest in still air"),
        **names,
        **{
            f"{name}_out_of_plane": (units, f"{text}, out of the plane of chord and vertical")
            for name, (units, text) in names.items()
        },
    )
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: vibration modes about rest"
        + (f", {law} law" if law != LAWS[0] else ""),
        stage="modes",
        layout="normal",
        method="vibration",
        weights="mass",
        law=law,
        air=air_at_rest(p),
    )
    return provenance.record(
        result,
        function="condensed.vibration_modes",
        parameters={"rank": int(rank), "static_modes": bool(static_modes), "links": chain.links, "law": law},
        inputs=[scene],
        chosen=provenance.defaulted_options(links=links),
    )


class RestTangent(NamedTuple):
    """Deflection at rest and its tangent with chordwise inertia neglected, for one normal of the chord."""

    deflection: np.ndarray  #: at rest (particle,) [m]
    stiffness: np.ndarray  #: force per unit slope at constant chordwise force (n,) [N]
    shortening: np.ndarray  #: decrease of the chordwise stretch per unit slope at constant chordwise force (n,)
    compliance: float  #: chordwise compliance of the whole cable [m/N]


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
    tangent = chain.p.stiffness * (1.5 * stretch * stretch - 0.5 if chain.green else np.ones(chain.links))
    chordwise = secant + (tangent - secant) * along * along
    compliance = float((chain.length / chordwise).sum())
    result = []
    for deflection, normal in zip(frame.split(position[None])[1][:, 0], frame.normals[0], strict=True):
        slope = direction @ normal
        mixed = (tangent - secant) * along * slope
        transverse = secant + (tangent - secant) * slope * slope
        shortening = mixed / chordwise
        result.append(RestTangent(deflection, transverse - mixed * shortening, shortening, compliance))
    return result


def _root_of_stiffness(chain: LumpedChain, tangent: RestTangent) -> np.ndarray:
    """Return the matrix B (n + 1, inner particles) [(N/m)^1/2] with the stiffness B^T B."""
    rows = np.zeros((chain.links + 1, chain.links - 1))
    inner, root = np.arange(chain.links - 1), np.sqrt(tangent.stiffness / chain.length)
    rows[inner, inner], rows[inner + 1, inner] = root[:-1], -root[1:]
    rows[-1] = (tangent.shortening[:-1] - tangent.shortening[1:]) / np.sqrt(tangent.compliance)
    return rows


def vibrations(chain: LumpedChain, tangent: RestTangent) -> tuple[np.ndarray, np.ndarray]:
    """Return angular frequencies (mode,) [rad/s] and shapes (mode, particle) of all vibrations of one deflection about rest."""
    from scipy.linalg import svd  # costly to import

    mass_root = np.sqrt(chain.p.mass * chain.tributary_length[1:-1])
    _, omega, vectors = svd(_root_of_stiffness(chain, tangent) / mass_root, full_matrices=False)
    return omega[::-1], _shapes(chain, vectors[::-1])


def _shapes(chain: LumpedChain, vectors: np.ndarray) -> np.ndarray:
    """Return shapes (mode, particle) of mass-weighted orthonormal vectors (mode, inner particle)."""
    shapes = vectors / np.sqrt(tributary_weights(chain.arc_length / chain.total_length)[1:-1])
    return fix_sign(np.pad(shapes, ((0, 0), (1, 1)))[:, :, None])[:, :, 0]


def _with_static_shapes(
    chain: LumpedChain, tangent: RestTangent, shapes: np.ndarray, rank: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return `rank` modes that begin with the static shapes, and the roots of their Rayleigh quotients."""
    root, mass_root = _root_of_stiffness(chain, tangent), np.sqrt(chain.p.mass * chain.tributary_length[1:-1])
    flexibility = chain.length / tangent.stiffness
    mean = (flexibility @ tangent.shortening) / flexibility.sum()
    derivative = np.cumsum(flexibility * (tangent.shortening - mean))[:-1]  # by the distance of the ends, of any size
    candidates = [tangent.deflection[1:-1], derivative, *shapes[:, 1:-1]]
    basis = np.empty((0, chain.links - 1))
    for candidate in candidates:
        vector = candidate * mass_root / np.linalg.norm(candidate * mass_root)
        for _ in range(2):  # once more against rounding
            vector = vector - (basis @ vector) @ basis
        norm = np.linalg.norm(vector)
        if norm > INDEPENDENT and len(basis) < rank:
            basis = np.concatenate([basis, vector[None] / norm])
    return np.linalg.norm((basis / mass_root) @ root.T, axis=1), _shapes(chain, basis)


def _features_at_rest(p: Parameters, length: float) -> np.ndarray:
    """Return the similarity numbers of a scene at rest (features,)."""
    values = features(p, length, 0.0)
    values[[FEATURES.index(name) for name in MOTION_FEATURES]] = 0.0
    return values
