"""Drag: its laws for arrays, how fast it acts on a cable, and how taut it pulls it, from which the steps of light lines follow.

:mod:`cablepod.wind._kernels_drag` has the laws compiled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.parameters._parameters import Parameters

if TYPE_CHECKING:
    from cablepod.wind._air import CableAir

#: Number of instants at which the speed of the ends is taken.
INSTANTS = 1025
#: Bounds of the rate of the drag times the longest explicit step, and times that over which an evaluation is held.  The
#: extrapolation of three evaluations is stable up to 6 / 11, in vibrations at the limit of the links up to 0.4; held drag is
#: not to decide on the error.
LIMIT_TIMES_RATE, HOLD_TIMES_RATE = 0.4, 0.08
#: Share of the tension by the largest drag that counts for a hold: what is twice as large as at the start is in its own bound.
TENSION_MARGIN = 0.5
#: Default step over this limit, where no error has decided on it.
STEP_OVER_DRAG_LIMIT = 0.5


def drag_of(p: Parameters, air_density: float) -> float:
    """Return half the density of the air times drag coefficient and diameter [kg/m2]."""
    return 0.5 * air_density * float(p.drag_coefficient) * float(p.diameter)


def straight_drag(
    drag: Any, tangent: np.ndarray, velocity: np.ndarray, axis: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the drag c |t| |u_n| u_n [N] on straight parts t of a cable [m], and its size over that of u_n.

    Here u_n is the part normal to t of the relative velocity of the air [m/s], and c that of :func:`drag_of`, without `axis`.
    """
    square = (tangent * tangent).sum(axis, keepdims=True)
    normal = velocity - (velocity * tangent).sum(axis, keepdims=True) / square * tangent
    size = drag * np.sqrt((square * (normal * normal).sum(axis, keepdims=True)).squeeze(axis))
    return np.expand_dims(size, axis) * normal, size


def body_drag(drag: Any, velocity: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the drag b |u| u [N] of bodies, with half the density of the air times drag area b [kg/m]; others as above."""
    return np.expand_dims(drag * np.sqrt((velocity * velocity).sum(axis)), axis) * velocity


def drag_rate(drag: Any, mass: Any, speed: float) -> Any:
    """Return a bound of the rate at which drag takes away a motion along the wind [1/s], up to a relative speed [m/s].

    The drag b |u| u on a mass [kg], with half the density of the air times drag area b [kg/m], changes with the relative
    velocity u by 2 b |u| along u.  Both may be those of a length of cable.
    """
    return 2.0 * drag * speed / mass


def largest_speed(p: Parameters, air: CableAir, end_time: float) -> float:
    """Return a bound of the speed of the air relative to the ends until an instant [s] [m/s]."""
    speed = air.largest_speed
    if p.motions:
        rates = p.end_positions(np.linspace(0.0, end_time, INSTANTS), 1)
        speed += float(np.sqrt((rates * rates).sum(axis=-1)).max())
    return speed


def drag_step_limit(rate: float) -> float:
    """Return the longest stable explicit step [s] for a rate [1/s]."""
    return LIMIT_TIMES_RATE / max(rate, 1e-300)


def longest_hold(rate: float) -> float:
    """Return the longest time [s] from one evaluation of the drag to the next, if that is more than a step, for a rate [1/s]."""
    return HOLD_TIMES_RATE / max(rate, 1e-300)


def tension_by_drag(p: Parameters, tension: float, load: float) -> float:
    """Return the tension [N] of a taut cable with the tension T0 [N] under the largest drag q L [N] on all of it.

    A parabola under the load q across the chord: T^2 (T - T0) = EA (q L)^2 / 24; with the force at its ends.
    """
    roots = np.roots([1.0, -tension, 0.0, -p.stiffness * load**2 / 24.0])
    return float(np.hypot(roots.real.max(), 0.5 * load))
