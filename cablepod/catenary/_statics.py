"""Statics of the elastic catenary of a scene from any one given quantity: for one scene and many members.

A scene is solved as a batch of one.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cablepod.catenary._formulas import FOUND, SLACK_WEIGHTLESS
from cablepod.catenary._piecewise import PiecewiseCatenary, has_no_shape, is_piecewise, pieces_of
from cablepod.catenary._piecewise_solve import solve_pieces
from cablepod.catenary._sag import force_of_sag, forces_of_sags, sag_of
from cablepod.catenary._uniform import LoadPlane, check_solved, resolved, solve_catenaries, solve_catenary
from cablepod.parameters._parameters import Parameters


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
        (6,) as in ``_formulas.COLUMNS``; nan but for the length for a weightless slack cable that starts from given
        points, which needs no equilibrium.

    Raises
    ------
    SceneError
        If no such cable exists; the message names the least possible tension.
    """
    if is_piecewise(p):
        return piecewise_statics(p, key, value, prefix=prefix).columns
    key, value = _as_tensioned(p, key, value, prefix)
    plane = [float(number) for number in load_plane(p)[:4]]
    if key == "sag":
        key, value = "horizontal_force", force_of_sag(plane, p.stiffness, value, name=f"{prefix}.sag")
    statics, status = solve_catenary(plane, p.stiffness, key, value)
    if status == SLACK_WEIGHTLESS and "points" in p.initial and prefix == "cable":
        statics[0] = value
    elif status != FOUND:
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
    if key == "unstretched_length" and "points" in p.initial and prefix == "cable":
        pieces = pieces_of(p, value)
        if has_no_shape(pieces, p.initial_ends[1] - p.initial_ends[0]):
            return PiecewiseCatenary(pieces, np.full(p.dims, np.nan))
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
    plane, key, value = load_planes(p), p.length_key, p.length_value
    if p.bare is not None and key != "unstretched_length":
        key, value = "unstretched_length", p.expansion * member_statics(p.bare)[0][:, 0]
    if key == "sag":
        key, value = "horizontal_force", forces_of_sags(plane[:4], p.stiffness, value)
    solutions, status = solve_catenaries(plane[:4], p.stiffness, key, value)
    return solutions, status == FOUND


def unstretched_length(p: Parameters) -> float:
    """Unstretched length of the cable of a scene [m], as given or from the given tension at rest."""
    return float(solve_statics(p, p.length_key, p.length_value)[0])


def sag_of_scene(p: Parameters, statics: np.ndarray) -> float:
    """Return the sag of the cable of a scene in still air [m], along the load, for its statics (6,)."""
    if is_piecewise(p):
        return piecewise_statics(p, p.length_key, p.length_value).sag
    return sag_of(load_plane(p)[:4], p.stiffness, statics.tolist())


@lru_cache(64)
def load_plane(p: Parameters) -> LoadPlane:
    """Resolve the chord of a scene at time 0 across and against the total load."""
    return LoadPlane(*(field[0] for field in load_planes(p)))


def load_planes(p: Parameters) -> LoadPlane:
    """Do :func:`load_plane` for stacked members, or for one scene as a batch of one; fields are arrays."""
    ends = p.initial_ends.reshape(-1, 2, p.dims)
    return resolved(ends[:, 1] - ends[:, 0], p.load_at(0.0).reshape(-1, p.dims))
