"""Uniform elastic catenaries as arrays: chords across and against their loads, solutions for one given quantity, errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cablepod.catenary import _formulas as formulas
from cablepod.errors import scene_error
from cablepod.parameters._keys import CATENARY_KEYS

#: Number of cables up to which they are solved one by one, in some 10 us each, without code that takes two seconds to compile.
FEW = 64


class LoadPlane(NamedTuple):
    """Chord of a cable in the plane of chord and total load; arrays with a leading dimension for many cables."""

    span: Any  #: of the upper end from the lower one, across the load (>= 0) [m]
    rise: Any  #: the same, against the load [m]
    chord: Any  #: distance of the ends [m]
    load: Any  #: total load per unstretched length [N/m]
    across: np.ndarray  #: unit vector across the load (dims,), zero where the chord lies along the load
    against: np.ndarray  #: unit vector against the load (dims,)


def resolved(chords: np.ndarray, loads: np.ndarray) -> LoadPlane:
    """Resolve chords c [m] across and against total loads p [N/m] (cables, dims).

    Against the load is -p/|p|, up without load, the rise b = c . against, the span a = |c - b against|; the direction across the
    load is zero where the chord lies along it.
    """
    load, chord = np.hypot.reduce(loads, axis=1), np.hypot.reduce(chords, axis=1)
    has_load = load > 0.0
    against = -loads / np.where(has_load, load, 1.0)[:, None]
    against[~has_load, 1] = 1.0
    rise = (chords * against).sum(axis=1)
    across = chords - rise[:, None] * against
    across -= (across * against).sum(axis=1)[:, None] * against  # the first difference may have cancelled
    span = np.hypot.reduce(across, axis=1)
    is_along = span <= 1e-15 * chord
    span[is_along], across[is_along], rise[is_along] = 0.0, 0.0, np.copysign(chord, rise)[is_along]
    across /= np.where(is_along, 1.0, span)[:, None]
    return LoadPlane(span, rise, chord, load, across, against)


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
        (cables, 6), columns as in ``_formulas.COLUMNS``; nan without a solution.
    numpy.ndarray
        Status of each cable (cables,), see :func:`check_solved`.
    """
    if value.size > FEW:
        return _solve_compiled(plane, stiffness, key, value)
    rows = np.stack([*plane, stiffness, value], axis=1).tolist()
    found = [solve_catenary(row[:4], row[4], key, row[5]) for row in rows]
    solutions = np.array([solution for solution, _ in found]).reshape(-1, 6)
    return solutions, np.array([status for _, status in found], dtype=np.int64)


def solve_catenary(plane: Sequence[float], stiffness: float, key: str, value: float) -> tuple[np.ndarray, int]:
    """Solve one catenary as :func:`solve_catenaries` does many; return its statics (6,) and status."""
    span, rise, chord, load = (float(number) for number in plane[:4])
    solution, kind = np.empty(6), CATENARY_KEYS.index(key)  # the formulas number the quantities in the same order
    try:
        status = formulas.solve(span, rise, chord, load, float(stiffness), kind, float(value), solution)
    except (ArithmeticError, ValueError):  # beyond the range of numbers, where compiled code goes on with inf and nan
        arrays = [np.array([number]) for number in (span, rise, chord, load, float(stiffness), float(value))]
        solutions, statuses = _solve_compiled(arrays[:4], arrays[4], key, arrays[5])
        return solutions[0], int(statuses[0])
    return solution, int(status)


def _solve_compiled(
    plane: Sequence[np.ndarray], stiffness: np.ndarray, key: str, value: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Do :func:`solve_catenaries` by compiled code."""
    from cablepod.catenary import _kernels_solve as kernel  # takes seconds to compile

    solutions, status = np.empty((value.size, 6)), np.empty(value.size, dtype=np.int64)
    kernel.solve_many(*plane, stiffness, CATENARY_KEYS.index(key), value, solutions, status)
    return solutions, status


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
    if status == formulas.FOUND:
        return
    if status == formulas.BELOW_LEAST_TENSION:
        sign = 1.0 if CATENARY_KEYS.index(key) == formulas.UPPER_TENSION else -1.0
        span, rise, chord, load = plane
        least = least_tension(span, rise, chord, load, stiffness, sign)
        raise scene_error(name, value, f"at least {max(least, 0.0):.6g} N, the minimum over all lengths of this cable")
    if status == formulas.SLACK_WEIGHTLESS:
        allowed = f"at most the chord, {plane[2]:.12g} m, as a slack cable without load has no shape at rest"
        raise scene_error(name, value, allowed)
    if status == formulas.VERTICAL_WITH_FORCE:
        allowed = "a tension or a length, as the chord lies along the load and no force acts across it"
        raise scene_error(name, value, allowed)
    allowed = "a finite value with a catenary in double precision (span, load >= 0, stiffness > 0)"
    raise scene_error(name, value, allowed)


def _mean_tension_at(eta: float, a: float, c: float, q: float, stiffness: float) -> float:
    """Compute the mean end tension for the sag parameter `eta`: T (1 + T/K) tanh(eta) = q l / 2."""
    mean = 0.0
    for _ in range(100):
        sigma, _ = formulas._sigma(eta, mean / stiffness, 0.0)
        p = 0.5 * q * math.sqrt(c * c + a * a * sigma) / math.tanh(eta)
        new = 2.0 * p / (1.0 + math.sqrt(1.0 + 4.0 * p / stiffness))
        if abs(new - mean) <= 1e-15 * new:
            return new
        mean = new
    return mean


def least_tension(a: float, b: float, c: float, q: float, stiffness: float, sign: float) -> float:
    """Return the minimum tension [N] at the upper (`sign` 1) or lower (-1) end over all lengths.

    The end tension T + q b / (2 (1 + e)) increases with the mean T, because no cable has T (1 + e) < q c / 2 (so that
    (K + T)^2 > q b K / 2).  The minimum of the mean is searched over eta.
    """
    from scipy.optimize import minimize_scalar  # costly to import

    def mean_tension(logarithm: float) -> float:
        return _mean_tension_at(math.exp(logarithm), a, c, q, stiffness)

    bounds = math.log(1e-4), math.log(300.0)
    mean = float(minimize_scalar(mean_tension, bounds=bounds, method="bounded", options={"xatol": 1e-12}).fun)
    return mean + sign * 0.5 * q * b / (1.0 + mean / stiffness)
