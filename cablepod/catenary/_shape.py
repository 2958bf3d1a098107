"""Shape of the elastic catenary."""

from __future__ import annotations

import numpy as np

#: Difference of two asinh up to which it is computed as one atanh, without cancellation.
SMALL_TURN = 0.5


def shape(s: np.ndarray, solution: np.ndarray, q: float, stiffness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions across and against the load [m], and tensions [N], at unstretched arc lengths `s` from the lower end [m].

    `solution` (6,) is that of :func:`cablepod.catenary._formulas.solve`, `q` the load [N/m].
    """
    length, _, force, mid, lower, _ = solution
    first = mid - 0.5 * q * length
    against = first + q * s
    tension = np.hypot(force, against)
    total = tension + lower
    is_loose = total == 0.0
    total = np.where(is_loose, 1.0, total)
    along = np.where(is_loose, 0.0, s * ((first + 0.5 * q * s) / stiffness + (against + first) / total))
    if force == 0.0:
        return np.zeros_like(s), along, tension
    turn = np.arcsinh(against / force) - np.arcsinh(first / force)
    z = np.minimum(q * s / total, 1.0 - 1e-16)
    ratio = np.where(z > 1e-8, np.arctanh(z) / np.where(z > 0.0, z, 1.0), 1.0 + z * z / 3.0)
    small = force * s * (1.0 / stiffness + 2.0 * ratio / total)
    large = force * (s / stiffness + turn / q) if q > 0.0 else small
    return np.where(turn > SMALL_TURN, large, small), along, tension
