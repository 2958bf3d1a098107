"""Define the elastic chain of a scene for other packages: numbers, right side and Jacobian.

All numbers come from the objects of cablepod's own runs (parameters, chain_of, chain.rest).  Right side and Jacobian are compiled
by numba with the numbers of the chain as constants, so that a solver in C or Fortran rarely waits for Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numba import njit

import cablepod as cp
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.parameters._from_scene import parameters

#: Width of the Jacobian's band below and above its diagonal, with the unknowns ordered as in System
BELOW, ABOVE = 3, 7


@dataclass(frozen=True, eq=False)  # so that it can be a key
class System:
    """Chain of a planar scene whose upper end alone moves, along x, by amplitude (1 - cos(omega t)).

    The unknowns are, particle after particle, vx, vy [m/s] and the displacements ux, uy [m] from the start: with velocities
    first the band of the Jacobian is narrow below the diagonal, which is where elimination works, and with displacements
    relative tolerances are relative to the motion and not to the length of the cable.
    """

    chain: LumpedChain
    start: np.ndarray  #: positions at rest (n + 1, 2) [m]
    amplitude: float  #: [m]
    omega: float  #: [rad/s]

    @property
    def particles(self) -> int:
        """Number of free particles."""
        return self.chain.links - 1

    @property
    def mass(self) -> np.ndarray:
        """Masses of the free particles (n - 1,) [kg]."""
        return self.chain.p.mass * self.chain.tributary_length[self.chain.free_particles]

    @property
    def load(self) -> np.ndarray:
        """Loads on the free particles (n - 1, 2) [N]."""
        return self.chain.loads()[self.chain.free_particles]

    def upper(self, time: float) -> float:
        """Displacement of the upper end along x [m]."""
        return self.amplitude * (1.0 - math.cos(self.omega * time))

    def positions(self, states: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Positions of all particles (time, n + 1, 2) [m] of states (time, 4 (n - 1))."""
        result = np.repeat(self.start[None], len(times), axis=0)
        result[:, 1:-1] += states.reshape(len(times), -1, 4)[..., 2:]
        result[:, -1, 0] += [self.upper(time) for time in times]
        return result


def system_of(scene: xr.Dataset) -> System:
    """Return the chain of a scene, at rest at its start.

    Raises
    ------
    ValueError
        For a scene with more than weight and the upper end's motion along x, the common ground of the packages.
    """
    p = parameters(scene)
    motion = p.motions.get(("upper", "x"))
    chain = chain_of(p)
    more = (p.free_end, p.load, p.mass_damping, p.link_viscosity, p.link_lengths)
    if p.dims != 2 or len(p.motions) != 1 or motion is None or motion.kind != "one_minus_cosine":
        raise ValueError(
            "given other motions; allowed: a planar scene with one_minus_cosine of the upper end along x alone"
        )
    if any(item is not None for item in more) or p.point_loads or p.initial:
        raise ValueError("given a free end, loads, damping, unequal links or an initial shape; allowed: none of them")
    start = cp.chain.rest(scene)["position"].values
    return System(chain, start, float(motion.values["amplitude"]), float(motion.values["angular_frequency"]))


def rates_of(system: System) -> Callable[[float, np.ndarray, np.ndarray], None]:
    """Return the compiled right side: f(t, y, out) writes y' into `out`, both (4 (n - 1),)."""
    k, length, x, y = (np.ascontiguousarray(item) for item in (system.chain.k, system.chain.length, *system.start.T))
    per_mass = 1.0 / system.mass
    drive_x, drive_y = (np.ascontiguousarray(item) for item in (system.load / system.mass[:, None]).T)
    amplitude, omega, m = system.amplitude, system.omega, system.particles

    @njit(error_model="numpy")
    def rates(time, state, out):
        force_x, force_y, px, py = 0.0, 0.0, x[0], y[0]
        for j in range(m + 1):
            if j < m:
                qx, qy = x[j + 1] + state[4 * j + 2], y[j + 1] + state[4 * j + 3]
            else:
                qx, qy = x[j + 1] + amplitude * (1.0 - math.cos(omega * time)), y[j + 1]
            dx, dy = qx - px, qy - py
            s = k[j] * (1.0 - length[j] / math.sqrt(dx * dx + dy * dy))
            s = max(s, 0.0)  # a slack link has no tension
            fx, fy = s * dx, s * dy
            if j > 0:
                i = 4 * (j - 1)
                out[i] = (fx - force_x) * per_mass[j - 1] + drive_x[j - 1]
                out[i + 1] = (fy - force_y) * per_mass[j - 1] + drive_y[j - 1]
                out[i + 2] = state[i]
                out[i + 3] = state[i + 1]
            force_x, force_y, px, py = fx, fy, qx, qy

    return rates


def jacobian_of(system: System) -> Callable[[float, np.ndarray, np.ndarray, int], None]:
    """Return the compiled Jacobian: f(t, y, out, packed) writes it into `out`.

    Entry (i, j) goes to ``out[i, j]``, or with `packed` to ``out[i - j + ABOVE, j]``, as LAPACK's banded storage has it.
    """
    k, length, x, y = (np.ascontiguousarray(item) for item in (system.chain.k, system.chain.length, *system.start.T))
    per_mass = 1.0 / system.mass
    amplitude, omega, m = system.amplitude, system.omega, system.particles

    @njit(error_model="numpy")
    def put(out, packed, row, column, value):
        if packed:
            out[row - column + ABOVE, column] += value
        else:
            out[row, column] += value

    @njit(error_model="numpy")
    def jacobian(time, state, out, packed):
        out[:] = 0.0
        px, py = x[0], y[0]
        for j in range(m + 1):
            if j < m:
                qx, qy = x[j + 1] + state[4 * j + 2], y[j + 1] + state[4 * j + 3]
                put(out, packed, 4 * j + 2, 4 * j, 1.0)
                put(out, packed, 4 * j + 3, 4 * j + 1, 1.0)
            else:
                qx, qy = x[j + 1] + amplitude * (1.0 - math.cos(omega * time)), y[j + 1]
            dx, dy = qx - px, qy - py
            square = dx * dx + dy * dy
            ratio = length[j] / math.sqrt(square)
            if ratio < 1.0:
                # derivative of k (1 - l/|R|) R: k ((1 - l/|R|) I + l/|R| R R' / |R|^2)
                sxx = k[j] * (1.0 - ratio + ratio * dx * dx / square)
                sxy = k[j] * ratio * dx * dy / square
                syy = k[j] * (1.0 - ratio + ratio * dy * dy / square)
                for row in (j - 1, j):  # the particles below and above the link, counted among the free ones
                    for column in (j - 1, j):
                        if 0 <= row < m and 0 <= column < m:
                            factor = per_mass[row] if row != column else -per_mass[row]
                            put(out, packed, 4 * row, 4 * column + 2, factor * sxx)
                            put(out, packed, 4 * row, 4 * column + 3, factor * sxy)
                            put(out, packed, 4 * row + 1, 4 * column + 2, factor * sxy)
                            put(out, packed, 4 * row + 1, 4 * column + 3, factor * syy)
            px, py = qx, qy

    return jacobian


def check_of(system: System, times: np.ndarray, step: float) -> np.ndarray:
    """Integrate by the eighth-order formula of DOP853 with a fixed step [s]; return positions (time, n + 1, 2) [m].

    SciPy's DOP853 takes minutes at so small a tolerance: the rounding of the right side shortens its steps.
    `times` rise from 0 and are multiples of the step.
    """
    from scipy.integrate import DOP853

    rates = rates_of(system)
    a, b, c = (np.ascontiguousarray(item) for item in (DOP853.A, DOP853.B, DOP853.C))
    stages, size = b.size, 4 * system.particles

    @njit(error_model="numpy")
    def march(state, first, count):
        slopes, place = np.empty((stages, size)), np.empty(size)
        for number in range(first, first + count):
            for i in range(stages):
                place[:] = state
                for j in range(i):
                    if a[i, j] != 0.0:
                        place += step * a[i, j] * slopes[j]
                rates(step * (number + c[i]), place, slopes[i])
            for i in range(stages):
                state += step * b[i] * slopes[i]

    numbers = np.rint(times / step).astype(int)
    states = np.zeros((times.size, size))
    for i in range(1, times.size):
        states[i] = states[i - 1]
        march(states[i], numbers[i - 1], numbers[i] - numbers[i - 1])
    return system.positions(states, times)


def error_of(position: np.ndarray, truth: np.ndarray, scale: float) -> np.ndarray:
    """Return the maximum distance of a particle from the truth (time,) over a scale.

    The scale is the maximum displacement [m].
    """
    return np.sqrt(((position - truth) ** 2).sum(axis=-1)).max(axis=-1) / scale


def largest_displacement(truth: np.ndarray) -> float:
    """Return the maximum displacement of a particle from its first position [m], of positions (time, particle, 2)."""
    return float(np.sqrt(((truth - truth[0]) ** 2).sum(axis=-1)).max())
