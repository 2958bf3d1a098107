"""Statics of the elastic catenary of a scene from any one given quantity."""

from __future__ import annotations

from typing import Any

import numpy as np

from cablepod.errors import scene_error
from cablepod.parameters._keys import LENGTH_KEYS
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters


def kind_of(key: str) -> int:
    """Return the kernels' number of the quantity that a scene gives, one of LENGTH_KEYS."""
    return LENGTH_KEYS.index(key)  # the kernels count them in the same order


def solve_statics(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> np.ndarray:
    """Solve the elastic catenary of a scene for one given quantity.

    Parameters
    ----------
    p
        The scene's parameters; weight and uniform load at time 0 act.
    key, value
        One of ``schema.LENGTH_KEYS`` and its value [N or m].
    prefix
        The table named in an error.

    Returns
    -------
    numpy.ndarray
        (6,) as in ``kernels.catenary.COLUMNS``; nan for a weightless slack cable that starts from given points, which
        needs no rest.

    Raises
    ------
    SceneError
        Where no such cable exists; the message names the least possible tension.
    """
    from cablepod.catenary import _kernels_solve as kernel  # only here: numba is imported to compute, not to read

    a, b, c, q, _, _ = load_plane(p)
    out = np.empty(6)
    kind = kind_of(key)
    status = kernel.solve(a, b, c, q, p.stiffness, kind, value, out)
    if status == kernel.FOUND:
        return out
    name = f"{prefix}.{key}"
    if status == kernel.BELOW_LEAST_TENSION:
        least = kernel.least_tension(a, b, c, q, p.stiffness, 1.0 if kind == kernel.UPPER_TENSION else -1.0)
        raise scene_error(
            name, value, f"at least {max(least, 0.0):.6g} N, the least that a cable between these ends can have"
        )
    if status == kernel.SLACK_WEIGHTLESS:
        if "points" in p.initial and prefix == "cable":
            out[0] = value
            return out
        raise scene_error(
            name, value, f"at most the chord, {c:.12g} m, as a slack cable without load has no shape at rest"
        )
    if status == kernel.VERTICAL_WITH_FORCE:
        raise scene_error(
            name, value, "another way to give the length, as a cable along the load has no force across it"
        )
    raise scene_error(name, value, "a value for which the catenary can be computed in double precision")


def load_plane(p: Parameters) -> tuple[float, float, float, float, np.ndarray, np.ndarray]:
    """Span across the total load, rise against it, chord [m], load [N/m], unit vectors across and against it."""
    chord = p.end_positions(np.zeros(1))[0]
    chord = chord[1] - chord[0]
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
        return 0.0, float(np.copysign(c, b)), c, q, np.zeros(p.dims), against
    return a, b, c, q, across / a, against


def _norm(vector: np.ndarray) -> float:
    # hypot is right to the last digit or two and, unlike BLAS, gives planar and spatial scenes the same bits
    return float(np.hypot.reduce(vector))


def unstretched_length(p: Parameters) -> float:
    """Unstretched length [m] of the cable of a scene: as given, or of the cable that has the given tension at rest."""
    return float(solve_statics(p, p.length_key, p.length_value)[0])


def member_statics(columns: MemberParameters) -> tuple[np.ndarray, np.ndarray]:
    """Solve the catenaries of many members (members, 6), as :func:`solve_statics` does one; tell which of them exist."""
    from cablepod.catenary import _kernels_solve as kernel  # numba is imported only to compute

    a, b, c, q = _load_planes(columns.chord, columns.load)
    out, status = np.empty((a.size, 6)), np.empty(a.size, dtype=np.int64)
    kernel.solve_many(a, b, c, q, columns.stiffness, kind_of(columns.length_key), columns.length_value, out, status)
    return out, status == kernel.FOUND


def _load_planes(chord: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Span across the load, rise against it, chord [m], load [N/m] of each member, as :func:`load_plane` of one."""
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
