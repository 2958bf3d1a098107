"""Chain of lumped masses in space, written link by link and integrated by SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Links:
    """A chain whose lower end is held, and the upper one too unless `is_free`."""

    length: np.ndarray  #: unstretched (links,) [m]
    stiffness: np.ndarray  #: (links,) [N/m]
    mass: np.ndarray  #: (particles,) [kg]
    loads: Callable[[float], np.ndarray]  #: of a time, all but the links' forces (particles, 3) [N]
    ends: Callable[[float], tuple[np.ndarray, np.ndarray]]  #: of a time: positions and velocities of both ends (2, 3)
    damping: float = 0.0  #: per mass [1/s]
    viscosity: float = 0.0  #: over the stiffness [s]
    is_free: bool = False

    def rates(self, t: float, state: np.ndarray) -> np.ndarray:
        """Return velocities and accelerations of the moving particles: m r'' = P + T_j - T_(j-1) - c m r'."""
        inner = np.array(state).reshape(2, -1, 3)
        held = self.ends(t)
        r, v = ([end[0], *own] + ([] if self.is_free else [end[1]]) for end, own in zip(held, inner, strict=True))
        force = self.loads(t) - self.damping * self.mass[:, None] * np.array(v)
        for j, rest in enumerate(self.length):
            gap = r[j + 1] - r[j]
            size = np.sqrt(gap @ gap)
            if size > rest:
                rate = gap @ (v[j + 1] - v[j]) / size
                pull = max(0.0, self.stiffness[j] * (size - rest + self.viscosity * rate)) * gap / size
                force[j] += pull
                force[j + 1] -= pull
        moving = slice(1, None if self.is_free else -1)
        return np.concatenate([np.ravel(inner[1]), np.ravel(force[moving] / self.mass[moving, None])])

    def positions(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return positions of the moving particles (times, moving, 3) from rest at `start` (particles, 3) on."""
        moving = np.asarray(start)[1 : None if self.is_free else -1].ravel()
        state = np.concatenate([moving, np.zeros(moving.size)])
        solution = solve_ivp(self.rates, (0.0, times[-1]), state, "DOP853", times, rtol=1e-11, atol=1e-12)
        return solution.y[: moving.size].T.reshape(times.size, -1, 3)
