"""Modes of small vibrations about rest, from the linearised condensed equations instead of snapshots."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import SCENE, taken
from cablepod.condensed._rest_tangent import (
    kinks_beside,
    tangents_at_rest,
    vibrations,
    with_dampers,
    with_static_shapes,
)
from cablepod.conventions import COORDINATES, FEATURES, label, shared_coordinates
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.discretisation._laws import LAWS, check_law
from cablepod.discretisation._similarity import features
from cablepod.errors import scene_error
from cablepod.integrate._output import particle_coordinates
from cablepod.parameters._checks import integer, truth
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._particles import refuse_own
from cablepod.pod import _normal as pod_normal
from cablepod.pod._training_range import add_training_range
from cablepod.wind._profile import air_at_rest

#: Similarity numbers that vanish at rest.
MOTION_FEATURES = ("end_motion", "end_acceleration", "frequency")
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
        Number of modes of each deflection, at most the number of inner particles.  Beside them, after the last one, there is a
        kink shape for each damper, spring and mass of at least 1 % of that of the cable: the static deflection by a force there,
        along the direction of the attachment, which sines approach slowly.
    static_modes
        Begin with two static shapes: the deflection at rest and its derivative by the distance of the ends.  Vibration modes
        follow, made orthogonal to them.  A few modes then hold the sag while the tension changes, for which many vibration modes
        are needed: use them where ends or loads move slowly.  There are no damping ratios then.
    links
        Number of links, instead of the scene's.  Mode i of n links has an error of (i pi / n)^2 / 24 in its frequency.
    law
        "linear", the law of the chain, or "green", eq. (21).

    Returns
    -------
    xarray.Dataset
        ``mode_shape (mode, particle)`` and ``angular_frequency (mode)`` [rad/s] in increasing order, in space also with the
        suffix ``_out_of_plane`` and ``normal_reference (coordinate)``, and ``unstretched_length`` [m].  With static modes the
        frequencies are those of the cable held to the one shape (root of the Rayleigh quotient), as are those of kink shapes.

        With dampers, and without static modes, ``angular_frequency`` is abs(lambda) and ``damping_ratio (mode)`` is
        -Re(lambda) / abs(lambda) of the roots lambda with which vibrations go as exp(lambda t); their shapes are
        ``mode_shape_real`` and ``mode_shape_imaginary (mode, particle)``.  ``mode_shape`` is that without dampers, which with the
        kink shapes is the better basis.

        The Dataset takes the place of modes of
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
    held, which differs from free vibrations where wind or loads bend the cable out of the plane of chord and vertical:
    :func:`cablepod.cable.frequencies` and :func:`cablepod.summary` have those.

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
    refuse_own(p, "chain.simulate and pod.decompose")
    if p.free_end is not None:
        raise scene_error("ends.free", p.free_end, "two held ends, which define the chord")
    chain = chain_of(p, links, law)
    integer(least=1)("rank", rank)
    truth("static_modes", static_modes)
    if rank > chain.links - 1:
        raise scene_error("rank", rank, f"at most {chain.links - 1}, the number of inner particles")
    has_dampers = not static_modes and any(re.fullmatch(r"attachment_\d+_damper", str(name)) for name in scene)
    sets = _sets(chain, int(rank), static_modes=static_modes, has_dampers=has_dampers)
    variables: dict[str, Any] = {
        f"{name}{suffix}": (("mode", "particle") if name.startswith("mode_shape") else ("mode",), values)
        for suffix, found in sets.items()
        for name, values in found.items()
    }
    variables["unstretched_length"] = ((), np.array(chain.total_length))
    variables |= pod_normal.reference_variable(pod_normal.reference_of(p.ends[None]))
    count = len(sets[""]["angular_frequency"])
    coords: dict[str, Any] = {
        "mode": np.arange(1, count + 1),
        "coordinate": list(COORDINATES[: p.dims]),
        **particle_coordinates(chain),
    }
    result = xr.Dataset(variables, coords=shared_coordinates(coords))
    add_training_range(result, np.tile(_features_at_rest(p, chain.total_length), (2, 1)))
    names = {
        "mode_shape": ("1", "shape of the vibration, of unit norm in the mass of the inner particles over its mean")
    }
    if p.dims == 3:
        names["angular_frequency"] = (
            "rad s-1",
            "angular frequency of small vibrations about rest with the other deflection held",
        )
    if static_modes:
        names["angular_frequency"] = ("rad s-1", "root of the Rayleigh quotient of the mode about rest")
    if has_dampers:
        names["mode_shape_real"] = ("1", "real part of the shape of the vibration with dampers")
        names["mode_shape_imaginary"] = ("1", "imaginary part of that shape, 0 of kink shapes")
        names["damping_ratio"] = (
            "1",
            "damping ratio of small vibrations about rest, by the attached dampers; nan of kink shapes",
        )
    order = "static modes first" if static_modes else "by rising frequency"
    if count > rank:
        order += ", kink shapes of attachments last"
    label(
        result,
        mode=("1", f"number of the mode, from 1, {order}"),
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


def _sets(chain: LumpedChain, rank: int, *, static_modes: bool, has_dampers: bool) -> dict[str, dict[str, np.ndarray]]:
    """Return the variables of each deflection by its suffix: `rank` modes and the kink shapes of attachments.

    A deflection with fewer kink shapes than the other one has more modes in their place.
    """
    tangents = tangents_at_rest(chain)
    kinks = max(0 if tangent.kinks is None else len(tangent.kinks) for tangent in tangents)
    largest = max(float(np.abs(tangent.deflection).max()) for tangent in tangents)
    total, sets = min(rank + kinks, chain.links - 1), {}
    for suffix, tangent in zip(pod_normal.SETS, tangents, strict=False):
        all_omega, all_shapes = vibrations(chain, tangent)
        count = total - (0 if tangent.kinks is None else len(tangent.kinks))
        omega, shapes = all_omega, all_shapes
        if static_modes and np.abs(tangent.deflection).max() > MIN_STATIC_SHAPE * largest:
            omega, shapes = with_static_shapes(chain, tangent, shapes, total)
        beside, roots_of_quotients = kinks_beside(chain, tangent, shapes[:count])
        count = total - len(beside)  # fewer where kink shapes depend on the modes
        found = {
            "mode_shape": np.concatenate([shapes[:count], beside]),
            "angular_frequency": np.concatenate([omega[:count], roots_of_quotients]),
        }
        if has_dampers:
            damped, ratio = found["mode_shape"].astype(complex), np.full(total, np.nan)
            ratio[:count] = 0.0
            if tangent.dampers is not None and len(tangent.dampers):
                roots, fields = with_dampers(chain, tangent, all_omega, all_shapes, count)
                found["angular_frequency"][:count] = np.abs(roots)
                damped[:count] = fields
                ratio[:count] = np.maximum(-roots.real, 0.0) / np.abs(roots)
            found |= {"damping_ratio": ratio, "mode_shape_real": damped.real, "mode_shape_imaginary": damped.imag}
        sets[suffix] = found
    return sets


def _features_at_rest(p: Parameters, length: float) -> np.ndarray:
    """Return the similarity numbers of a scene at rest (features,)."""
    values = features(p, length, 0.0)
    values[[FEATURES.index(name) for name in MOTION_FEATURES]] = 0.0
    return values
