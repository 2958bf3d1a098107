"""Static stiffness of the upper end of elastic catenaries.

A force dF on the end moves a point of the cable by (I/K + (I - t t)/T) dF for each unit of unstretched length, with the
direction t of the tension T.  The integral over the length is the compliance.  Against the load V = H sinh u, so that the second
part is the integral of (I - t t)/q over u, smooth for every cable.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from cablepod.catenary._statics import load_plane, solve_statics
from cablepod.parameters._parameters import Parameters

#: Points of Gauss's rule along a cable.
GAUSS_POINTS = 48
#: Load, or force across it, over the end tensions below which a cable is straight, or hangs along the load.
STRAIGHT = 1e-12


@lru_cache
def gauss_rule(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of Gauss's rule on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def static_stiffness(p: Parameters, length: float, upper: np.ndarray) -> np.ndarray:
    """Return the stiffness of the upper end (dims, dims) [N/m].

    Parameters
    ----------
    p
        Parameters of the scene; weight and uniform load act with their values at time 0.
    length
        Unstretched length [m].
    upper
        Position of the upper end (dims,) [m].
    """
    moved = replace(p, upper=upper, motions={})
    plane = load_plane(moved)
    solved = solve_statics(moved, "unstretched_length", length)
    _, _, force, mid, lower, top = solved
    elastic, across = length / p.stiffness, plane.across
    if not across.any():  # the chord lies along the load: any direction across it
        across = np.eye(across.size)[int(np.argmin(np.abs(plane.against)))]
        across = across - (across @ plane.against) * plane.against
        across /= np.linalg.norm(across)
    if plane.load * length <= STRAIGHT * (lower + top):  # a straight spring
        along = np.array([force, mid]) / np.hypot(force, mid)
        geometric = length / np.hypot(force, mid)
        compliance = elastic * np.eye(2) + geometric * (np.eye(2) - np.outer(along, along))
        return _in_space(across, plane.against, np.linalg.inv(compliance), elastic + geometric)
    if force <= STRAIGHT * (lower + top):  # along the load
        low, high = mid - 0.5 * plane.load * length, mid + 0.5 * plane.load * length
        geometric = np.log(top / lower) / np.copysign(plane.load, low) if low * high > 0.0 else np.inf
        return _in_space(
            across, plane.against, np.diag([1.0 / (elastic + geometric), 1.0 / elastic]), elastic + geometric
        )
    return curved_stiffness(across, plane.against, solved, plane.load, length, elastic)


def curved_stiffness(
    across: np.ndarray, against: np.ndarray, solved: np.ndarray, load: Any, length: Any, elastic: Any
) -> np.ndarray:
    """Return the stiffness of the upper ends of curved catenaries (..., dims, dims) [N/m].

    Parameters
    ----------
    across, against
        Unit vectors across and against the load (..., dims).
    solved
        Solutions (..., 6), see ``cablepod.catenary._formulas``.
    load, length, elastic
        Load [N/m], unstretched length [m], and that over the axial stiffness [m/N] (...).
    """
    _, _, force, middle, lower, top = np.moveaxis(solved, -1, 0)
    hanging = load * length
    low, high = middle - 0.5 * hanging, middle + 0.5 * hanging
    start = np.arcsinh(low / force)
    # the difference of both angles, without cancellation where the cable is taut
    ratio = np.minimum(hanging / (lower + top), 1.0 - 1e-16)
    angle = np.where((low < 0.0) & (high > 0.0), np.arcsinh(high / force) - start, 2.0 * np.arctanh(ratio))
    nodes, weights = gauss_rule(GAUSS_POINTS)
    u = start[..., None] + angle[..., None] * nodes
    sine, cosine, part = np.tanh(u), 1.0 / np.cosh(u), angle / load
    mixed = -part * ((sine * cosine) @ weights)
    compliance = np.array(
        [[elastic + part * (sine**2 @ weights), mixed], [mixed, elastic + part * (cosine**2 @ weights)]]
    )
    return _in_space(across, against, np.linalg.inv(np.moveaxis(compliance, (0, 1), (-2, -1))), elastic + part)


def _in_space(across: np.ndarray, against: np.ndarray, in_plane: np.ndarray, normal: Any) -> np.ndarray:
    """Return the stiffness (..., dims, dims) of one in the plane of the load (..., 2, 2) [N/m] and a compliance normal to it."""
    basis = np.stack([across, against], axis=-2)
    result = np.swapaxes(basis, -1, -2) @ in_plane @ basis
    if across.shape[-1] == 3:
        third = np.cross(across, against)
        result += third[..., :, None] * third[..., None, :] / np.asarray(normal)[..., None, None]
    return 0.5 * (result + np.swapaxes(result, -1, -2))
