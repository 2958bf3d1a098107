"""Statics of the elastic catenary from any one given quantity: for arrays, one scene and many members.

A scene is solved as a batch of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cablepod.catenary._piecewise import PiecewiseCatenary, is_piecewise, is_slack_weightless, pieces_of
from cablepod.catenary._piecewise_solve import solve_pieces
from cablepod.errors import scene_error
from cablepod.parameters._keys import CATENARY_KEYS
from cablepod.parameters._parameters import Parameters


class LoadPlane(NamedTuple):
    """Chord of a cable in the plane of chord and total load; arrays with a leading dimension for many cables."""

    span: Any  #: of the upper end from the lower one, across the load (>= 0) [m]
    rise: Any  #: the same, against the load [m]
    chord: Any  #: distance of the ends [m]
    load: Any  #: total load per unstretched length [N/m]
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
        One of ``CATENARY_KEYS`` and its values (cables,) [N or m].

    Returns
    -------
    numpy.ndarray
        (cables, 6), columns as in ``_kernels_solve.COLUMNS``; nan without a solution.
    numpy.ndarray
        Status of each cable (cables,), see :func:`check_solved`.
    """
    from cablepod.catenary import _kernels_solve as kernel  # numba is imported only to compute

    solutions, status = np.empty((value.size, 6)), np.empty(value.size, dtype=np.int64)
    kind = CATENARY_KEYS.index(key)  # the kernels number the quantities in the same order
    kernel.solve_many(*plane, stiffness, kind, value, solutions, status)
    return solutions, status


def solve_catenary(plane: Sequence[float], stiffness: float, key: str, value: float) -> tuple[np.ndarray, int]:
    """Solve one catenary as :func:`solve_catenaries` does many; return its statics (6,) and status."""
    numbers = [np.array([float(number)]) for number in plane[:4]]
    solutions, status = solve_catenaries(numbers, np.array([stiffness]), key, np.array([value], dtype=float))
    return solutions[0], int(status[0])


def check_solved(
    status: int, plane: Sequence[float], stiffness: float, key: str, value: float | str, *, name: str
) -> None:
    """Raise the error of a catenary without solution.

    Parameters
    ----------
    status
        As :func:`solve_catenaries` returns it.
    plane, stiffness, key
        As in :func:`solve_catenaries`, of one cable.
    value, name
        What was given, and its key, in the message.

    Raises
    ------
    SceneError
        Names the least possible tension, or another reason.
    """
    from cablepod.catenary import _kernels_solve as kernel

    if status == kernel.FOUND:
        return
    if status == kernel.BELOW_LEAST_TENSION:
        from cablepod.catenary import _kernels_least as kernel_least

        sign = 1.0 if CATENARY_KEYS.index(key) == kernel.UPPER_TENSION else -1.0
        least = kernel_least.least_tension(*plane, stiffness, sign)
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

    if is_piecewise(p):
        return piecewise_statics(p, key, value, prefix=prefix).columns
    key, value = _as_tensioned(p, key, value, prefix)
    plane = [float(number) for number in load_plane(p)[:4]]
    if key == "sag":
        from cablepod.catenary._sag import force_of_sag  # imports this file

        key, value = "horizontal_force", force_of_sag(plane, p.stiffness, value, name=f"{prefix}.sag")
    statics, status = solve_catenary(plane, p.stiffness, key, value)
    if status == kernel.SLACK_WEIGHTLESS and "points" in p.initial and prefix == "cable":
        statics[0] = value
    elif status != kernel.FOUND:
        name: str = f"{prefix}.{key}"
        given: float | str = value
        if p.expansion != 1.0:
            name, given = "temperature", f"an unstretched length of {value:.12g} m"
        check_solved(status, plane, p.stiffness, key, given, name=name)
    return statics


def piecewise_statics(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> PiecewiseCatenary:
    """Solve the elastic catenary of a cable of several pieces, as :func:`solve_statics`.

    Raises
    ------
    SceneError
        As :func:`solve_statics`.
    """
    key, value = _as_tensioned(p, key, value, prefix)
    if key == "unstretched_length" and "points" in p.initial and prefix == "cable" and is_slack_weightless(p, value):
        return PiecewiseCatenary(pieces_of(p, value), np.full(p.dims, np.nan))
    return solve_pieces(p, key, float(value), f"{prefix}.{key}")


def _as_tensioned(p: Parameters, key: str, value: float, prefix: str) -> tuple[str, float]:
    """Return the length of a cable that was tensioned without ice, at the reference temperature; others as they are given."""
    if p.bare is None or prefix != "cable" or key == "unstretched_length":
        return key, value
    return "unstretched_length", length_as_tensioned(p, key, value)


def length_as_tensioned(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> float:
    """Return the unstretched length [m] by a quantity without ice, at the reference temperature; others as of `solve_statics`."""
    return float(p.expansion * solve_statics(p.bare or p, key, value, prefix=prefix)[0])


def length_and_strain(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> tuple[float, float]:
    """Return the unstretched length [m] and the largest strain at rest for one given quantity, as :func:`solve_statics`.

    Raises
    ------
    SceneError
        As :func:`solve_statics`.
    """
    if is_piecewise(p):
        solved = piecewise_statics(p, key, value, prefix=prefix)
        return solved.total, solved.largest_strain
    statics = solve_statics(p, key, value, prefix=prefix)
    return float(statics[0]), float(statics[4:].max()) / p.stiffness


def member_statics(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Solve the catenaries of stacked members (members, 6); also return which have a solution (members,)."""
    from cablepod.catenary import _kernels_solve as kernel

    plane, key, value = load_planes(p), p.length_key, p.length_value
    if p.bare is not None and key != "unstretched_length":
        key, value = "unstretched_length", p.expansion * member_statics(p.bare)[0][:, 0]
    if key == "sag":
        from cablepod.catenary._sag import forces_of_sags  # imports this file

        key, value = "horizontal_force", forces_of_sags(plane[:4], p.stiffness, value)
    solutions, status = solve_catenaries(plane[:4], p.stiffness, key, value)
    return solutions, status == kernel.FOUND


def unstretched_length(p: Parameters) -> float:
    """Unstretched length of the cable of a scene [m], as given or from the given tension at rest."""
    return float(solve_statics(p, p.length_key, p.length_value)[0])


def load_plane(p: Parameters) -> LoadPlane:
    """Resolve the chord of a scene at time 0 across and against the total load."""
    return LoadPlane(*(field[0] for field in load_planes(p)))


def load_planes(p: Parameters) -> LoadPlane:
    """Do :func:`load_plane` for stacked members, or for one scene as a batch of one; fields are arrays."""
    from cablepod.catenary import _kernels_plane as kernel

    ends = p.initial_ends.reshape(-1, 2, p.dims)
    chords, loads = ends[:, 1] - ends[:, 0], p.load_at(0.0).reshape(-1, p.dims)
    planes, across, against = np.empty((4, len(chords))), np.empty_like(chords), np.empty_like(chords)
    kernel.load_planes(chords, loads, planes, across, against)
    return LoadPlane(planes[0], planes[1], planes[2], planes[3], across, against)
