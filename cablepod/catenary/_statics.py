"""Statics of the elastic catenary from any one given quantity: for arrays, one scene and many members."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cablepod.errors import scene_error
from cablepod.parameters._keys import LENGTH_KEYS
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters


class LoadPlane(NamedTuple):
    """Chord of a cable in the plane of chord and total load."""

    span: float  #: of the upper end from the lower one, across the load (>= 0) [m]
    rise: float  #: the same, against the load [m]
    chord: float  #: distance of the ends [m]
    load: float  #: total load per unstretched length [N/m]
    across: np.ndarray  #: unit vector across the load (dims,), zero where the chord lies along the load
    against: np.ndarray  #: unit vector against the load (dims,)


def solve_catenaries(
    plane: Sequence[np.ndarray], stiffness: np.ndarray, key: str, value: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve elastic catenaries for one given quantity.

    Parameters
    ----------
    plane
        Span, rise, chord and load as in :class:`LoadPlane` (cables,) [m, m, m, N/m].
    stiffness
        Axial stiffness K (cables,) [N].
    key, value
        One of ``LENGTH_KEYS`` and its values (cables,) [N or m].

    Returns
    -------
    numpy.ndarray
        (cables, 6), columns as in ``_kernels_solve.COLUMNS``; nan without a solution.
    numpy.ndarray
        Status of each cable (cables,), see :func:`check_solved`.
    """
    from cablepod.catenary import _kernels_solve as kernel  # numba is imported only to compute

    solutions, status = np.empty((value.size, 6)), np.empty(value.size, dtype=np.int64)
    kind = LENGTH_KEYS.index(key)  # the kernels number the quantities in the same order
    kernel.solve_many(*plane, stiffness, kind, value, solutions, status)
    return solutions, status


def check_solved(status: int, plane: Sequence[float], stiffness: float, key: str, value: float, *, name: str) -> None:
    """Raise the error of a catenary without solution.

    Parameters
    ----------
    status
        As :func:`solve_catenaries` returns it.
    plane, stiffness, key, value
        As in :func:`solve_catenaries`, of one cable.
    name
        Key in the message.

    Raises
    ------
    SceneError
        Names the least possible tension, or another reason.
    """
    from cablepod.catenary import _kernels_solve as kernel

    if status == kernel.FOUND:
        return
    if status == kernel.BELOW_LEAST_TENSION:
        sign = 1.0 if LENGTH_KEYS.index(key) == kernel.UPPER_TENSION else -1.0
        least = kernel.least_tension(*plane, stiffness, sign)
        raise scene_error(name, value, f"at least {max(least, 0.0):.6g} N, the minimum over all lengths of this cable")
    if status == kernel.SLACK_WEIGHTLESS:
        allowed = f"at most the chord, {plane[2]:.12g} m, as a slack cable without load has no shape at rest"
        raise scene_error(name, value, allowed)
    if status == kernel.VERTICAL_WITH_FORCE:
        allowed = "a tension or a length, as the chord lies along the load and no force acts across it"
        raise scene_error(name, value, allowed)
    allowed = "a finite value with a catenary in double precision (span, load >= 0, stiffness > 0)"
    raise scene_error(name, value, allowed)


def solve_statics(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> np.ndarray:
    """Solve the elastic catenary of a scene for one given quantity.

    Parameters
    ----------
    p
        Parameters of the scene; weight and uniform load act with their values at time 0.
    key, value
        One of ``LENGTH_KEYS`` and its value [N or m].
    prefix
        Table of the scene named in an error.

    Returns
    -------
    numpy.ndarray
        (6,) as in ``_kernels_solve.COLUMNS``; nan but for the length for a weightless slack cable that starts from given
        points, which needs no equilibrium.

    Raises
    ------
    SceneError
        If no such cable exists; the message names the least possible tension.
    """
    from cablepod.catenary import _kernels_solve as kernel

    plane = load_plane(p)
    numbers = np.array([*plane[:4], p.stiffness, value])[:, None]
    solutions, status = solve_catenaries(tuple(numbers[:4]), numbers[4], key, numbers[5])
    if status[0] == kernel.SLACK_WEIGHTLESS and "points" in p.initial and prefix == "cable":
        solutions[0, 0] = value
    else:
        check_solved(int(status[0]), plane[:4], p.stiffness, key, value, name=f"{prefix}.{key}")
    return solutions[0]


def member_statics(members: MemberParameters) -> tuple[np.ndarray, np.ndarray]:
    """Solve the catenaries of many members (members, 6); also return which have a solution (members,)."""
    from cablepod.catenary import _kernels_solve as kernel

    planes = _load_planes(members.chord, members.load)
    solutions, status = solve_catenaries(planes, members.stiffness, members.length_key, members.length_value)
    return solutions, status == kernel.FOUND


def unstretched_length(p: Parameters) -> float:
    """Unstretched length of the cable of a scene [m], as given or from the given tension at rest."""
    return float(solve_statics(p, p.length_key, p.length_value)[0])


def load_plane(p: Parameters) -> LoadPlane:
    """Resolve the chord of a scene at time 0 across and against the total load."""
    ends = p.end_positions(np.zeros(1))[0]
    chord = ends[1] - ends[0]
    load = p.load_at(0.0)
    q = _norm(load)
    against = -load / q if q > 0.0 else np.eye(p.dims)[1]
    if q > 0.0 and np.count_nonzero(load) == 1:
        against = np.sign(against)  # exactly an axis
    b = float(chord @ against)
    across = chord - b * against
    across = across - (across @ against) * against  # once more: the first difference may have cancelled
    a = _norm(across)
    c = _norm(chord)
    if a <= 1e-15 * c:
        return LoadPlane(0.0, float(np.copysign(c, b)), c, q, np.zeros(p.dims), against)
    return LoadPlane(a, b, c, q, across / a, against)


def _norm(vector: np.ndarray) -> float:
    # hypot is right to the last digit or two and, unlike BLAS, gives planar and spatial scenes the same bits
    return float(np.hypot.reduce(vector))


def _load_planes(chord: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Span, rise, chord [m] and load [N/m] of each member, as :func:`load_plane` computes them for one scene."""
    q = _norms(load)
    loaded = q > 0.0
    up: Any = np.eye(chord.shape[1])[1]
    against = np.where(loaded[:, None], -load / np.where(loaded, q, 1.0)[:, None], up)
    axis = loaded & (np.count_nonzero(load, axis=1) == 1)
    against[axis] = np.sign(against[axis])
    b = (chord * against).sum(axis=1)
    across = chord - b[:, None] * against
    again = (across * against).sum(axis=1)  # once more: the first difference may have cancelled
    across -= again[:, None] * against
    a, c = _norms(across), _norms(chord)
    along = a <= 1e-15 * c
    return np.where(along, 0.0, a), np.where(along, np.copysign(c, b), b), c, q


def _norms(vectors: np.ndarray) -> np.ndarray:
    return np.hypot.reduce(vectors, axis=1)
