r"""Sag of the elastic catenary below its chord, along the total load, and the catenary of a given sag.

The tangent is parallel to the chord at the point :math:`S_*` of the sag.  With the turn :math:`\Delta` of
:math:`\mathrm{arsinh}(V/H)` from the lower end to this point, and its forces :math:`V_* = Hb/a` and :math:`T_*`,

.. math::
    f = \frac{q S_*^2}{2K} + \frac{V_*\Delta - T_* + T_0}{q}
      = \frac{q S_*^2}{2K} + \frac{T_*(\cosh\Delta - 1) - V_*(\sinh\Delta - \Delta)}{q},

where the second form does not cancel for small :math:`\Delta`.  The sag falls as the force across the load rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cablepod.catenary._bracket import force_by_sag
from cablepod.catenary._formulas import sag_excess
from cablepod.catenary._uniform import check_solved, solve_catenary
from cablepod.errors import SceneError, scene_error

#: Turn below which the second form is used.
SMALL_TURN = 0.5
#: Half the load over the mean tension below which a cable is taut.
SMALL_LOAD = 0.4
#: Denominators of the series of sinh(turn) - turn, from the last one.
SERIES = (210.0, 156.0, 110.0, 72.0, 42.0, 20.0)


def irvine_parameter(normal_load: Any, length: Any, tension: Any, stiffness: Any) -> Any:
    """Return Irvine's lambda squared (q_n L0 / T)^2 K / T, for the load normal to the chord q_n [N/m] and the mean tension T."""
    return (normal_load * length / tension) ** 2 * stiffness / tension


def sag_of(plane: Sequence[float], stiffness: float, statics: Sequence[float]) -> float:
    """Return the largest distance of a catenary below its chord, along the load [m]; 0 without load or span.

    Parameters
    ----------
    plane
        Span, rise, chord [m] and load [N/m], see :class:`cablepod.catenary._uniform.LoadPlane`.
    stiffness
        Axial stiffness [N].
    statics
        (6,) as in ``_formulas.COLUMNS``.
    """
    span, rise, _, load = plane[:4]
    length, _, force, middle, lower, upper = statics
    if not (load > 0.0 and span > 0.0):
        return 0.0
    across = force * (rise / span)
    half, mean = 0.5 * load * length, 0.5 * (lower + upper)
    before = (middle - across) / load  # from the point of the sag to the middle
    if half < SMALL_LOAD * mean:  # the same by the equations of _formulas.py, without cancellation
        excess = sag_excess(math.atanh(half / mean))[0] / (1.0 + mean / stiffness)
        before = middle / load * (excess / (1.0 + excess))
    place = min(max(0.5 * length - before, 0.0), length)
    tension = math.hypot(force, across)
    turn = math.asinh(across / force) - math.asinh((middle - half) / force)
    if turn < SMALL_TURN:
        turn = 2.0 * math.atanh(load * place / (tension + lower))  # the same without cancellation
        rest = 1.0
        for number in SERIES:
            rest = 1.0 + turn * turn / number * rest
        curved = 2.0 * tension * math.sinh(0.5 * turn) ** 2 - across * turn**3 / 6.0 * rest
    else:
        curved = across * turn - (tension - lower)
    return 0.5 * load * place * place / stiffness + curved / load


def force_of_sag(plane: Sequence[float], stiffness: float, sag: float, *, name: str) -> float:
    """Return the force across the load of the catenary of a given sag [N].

    Parameters
    ----------
    plane, stiffness
        As in :func:`sag_of`.
    sag
        Largest distance below the chord, along the load [m].
    name
        Key in messages.

    Raises
    ------
    SceneError
        For a cable without load or along it, which has no sag, and for a sag that no catenary in double precision has.
    """
    span, _, chord, load = plane[:4]
    if not load > 0.0:
        raise scene_error(name, sag, "a tension or a length, as a cable without load has no sag")
    if not span > 0.0:
        raise scene_error(
            name, sag, "a tension or a length, as the chord lies along the load, where a cable has no sag"
        )

    def excess(logarithm: float) -> float:
        statics, status = solve_catenary(plane, stiffness, "horizontal_force", math.exp(logarithm))
        check_solved(status, plane, stiffness, "horizontal_force", sag, name=name)
        return math.log(max(sag_of(plane, stiffness, statics.tolist()), 1e-300) / sag)

    # the parabola of a taut cable, or the sag parameter of a deep one
    deep = 2.0 + 2.0 * math.log1p(8.0 * sag / span)
    first = math.log(load * max(chord * span / (8.0 * sag), span / (2.0 * deep)))
    return force_by_sag(excess, first)


def forces_of_sags(plane: Sequence[np.ndarray], stiffness: np.ndarray, sags: np.ndarray) -> np.ndarray:
    """Do :func:`force_of_sag` for stacked members (members,); nan where there is none."""
    result = np.full(sags.size, math.nan)
    for k in range(sags.size):
        try:
            numbers = [float(number[k]) for number in plane[:4]]
            result[k] = force_of_sag(numbers, float(stiffness[k]), float(sags[k]), name="cable.sag")
        except (SceneError, ValueError):
            continue
    return result


def least_sag(plane: Sequence[float], stiffness: float, strain: float) -> float:
    """Return the sag of the shorter cable whose larger end tension strains it by `strain` [m]; 0 where there is none."""
    key = "top_tension" if plane[1] >= 0.0 else "bottom_tension"
    statics, status = solve_catenary(plane, stiffness, key, strain * stiffness)
    return 0.0 if status else sag_of(plane, stiffness, statics.tolist())
