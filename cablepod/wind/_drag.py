"""Laws of the drag, for arrays; :mod:`cablepod.wind._kernels_drag` has them compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from cablepod.parameters._parameters import Parameters


def drag_of(p: Parameters, air_density: float) -> float:
    """Return half the density of the air times drag coefficient and diameter [kg/m2]."""
    return 0.5 * air_density * float(p.drag_coefficient) * float(p.diameter)


def straight_drag(
    drag: Any, tangent: np.ndarray, velocity: np.ndarray, axis: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the drag c |t| |u_n| u_n [N] on straight parts of a cable, and its size over that of u_n.

    Here u_n is the part normal to t of the relative velocity u of the air [m/s].

    Parameters
    ----------
    drag
        As :func:`drag_of` gives it, c [kg/m2]; of the shape of the others without `axis`.
    tangent, velocity
        Vectors t along the parts, of their lengths [m], and u [m/s].
    axis
        Of the coordinates.
    """
    square = (tangent * tangent).sum(axis, keepdims=True)
    normal = velocity - (velocity * tangent).sum(axis, keepdims=True) / square * tangent
    size = drag * np.sqrt((square * (normal * normal).sum(axis, keepdims=True)).squeeze(axis))
    return np.expand_dims(size, axis) * normal, size


def body_drag(drag: Any, velocity: np.ndarray, axis: int = -1) -> np.ndarray:
    """Return the drag b |u| u [N] of bodies, with half the density of the air times drag area b [kg/m]; others as above."""
    return np.expand_dims(drag * np.sqrt((velocity * velocity).sum(axis)), axis) * velocity
