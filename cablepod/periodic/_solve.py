"""Periodic solutions of the model: one state, its correction by Newton's method, its multipliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.periodic._model import PeriodicModel, harmonics_at
from cablepod.periodic._multipliers import eigenvalues
from cablepod.periodic._period import check_period

#: Least and largest number of harmonics of one period of the forcing where it is adapted, and its change.
MIN_HARMONICS, MAX_HARMONICS, MORE_HARMONICS = 6, 32, 4
#: Largest number of unknowns for which harmonics are added: their matrix is solved at every iteration.
MAX_UNKNOWNS = 450
#: Share of the last two harmonics in the motion, above which more are taken.
TAIL_RTOL = 1e-6
#: Share of the motion in the mean deflection below which a motion counts as none.
NO_MOTION = 1e-9
#: Largest product of highest frequency and step of the scheme for multipliers (its phases err by the fourth power over 480).
MAX_PHASE_STEP = 0.2
#: Largest number of its steps in a period, by memory.
MAX_PHASES = 8192
#: Least number of its steps for each sample of the harmonic balance.
MIN_STRIDE = 4
#: Distance from the unit circle that counts as on it.
NEUTRAL = 1e-7
#: Number of tables of harmonics that are kept, of at most 4 MB.
KEPT_BASES = 32
#: Sets of coordinates whose disturbances do not couple with those of others, and the set of all.
IN_PLANE, OUT_OF_PLANE, COUPLED = "in_plane", "out_of_plane", "coupled"


class Stability(NamedTuple):
    """Floquet multipliers of a solution, and the smallest chordwise force."""

    multipliers: np.ndarray  #: complex (2 r,), of the coordinates in the plane first
    smallest_force: float  #: over phases and length [N]

    @property
    def is_stable(self) -> bool:
        """Whether no multiplier lies outside of the unit circle."""
        return bool(np.abs(self.multipliers).max(initial=0.0) <= 1.0 + NEUTRAL)


@dataclass(frozen=True, eq=False)
class State:
    """Coefficients of the harmonics, without dimension, and the angular frequency of the forcing."""

    z: np.ndarray  #: ((1 + 2 harmonics) coordinates + 1,), see :mod:`cablepod.periodic._kernels_balance`
    planar: bool  #: whether the coordinates are those in the plane only
    size: int  #: number of coordinates
    periods: int = 1  #: of the forcing in one of the motion

    @property
    def omega(self) -> float:
        """Angular frequency of the forcing."""
        return float(self.z[-1])

    @cached_property
    def harmonics(self) -> int:
        """Number of harmonics."""
        return ((self.z.size - 1) // self.size - 1) // 2

    @property
    def coefficients(self) -> np.ndarray:
        """Coefficients (1 + 2 harmonics, coordinates)."""
        return self.z[:-1].reshape(-1, self.size)

    def changed(self, coefficients: np.ndarray, omega: float | None = None) -> State:
        """Return the state with other coefficients (1 + 2 harmonics, coordinates)."""
        z = np.append(coefficients.ravel(), self.omega if omega is None else omega)
        return State(z, self.planar, coefficients.shape[1], self.periods)

    def resized(self, harmonics: int) -> State:
        """Return the state with another number of harmonics."""
        old = self.coefficients
        new = np.zeros((1 + 2 * harmonics, self.size))
        new[: min(len(old), len(new))] = old[: len(new)]
        return self.changed(new)

    def full(self, model: PeriodicModel) -> State:
        """Return the state with all coordinates."""
        if self.size == model.size:
            return replace(self, planar=False)
        coefficients = np.zeros((1 + 2 * self.harmonics, model.size))
        coefficients[:, : self.size] = self.coefficients
        return replace(self.changed(coefficients), planar=False)

    def doubled(self) -> State:
        """Return the state over twice as many periods."""
        old = self.coefficients
        new = np.zeros((1 + 4 * self.harmonics, self.size))
        new[0], new[3::4], new[4::4] = old[0], old[1::2], old[2::2]
        return replace(self.changed(new), periods=2 * self.periods)

    def towards(self, other: State, share: float) -> State:
        """Return the state at a share of the straight way to another one."""
        return replace(self, z=self.z + share * (other.z - self.z))

    @property
    def most_harmonics(self) -> int:
        """Largest number of harmonics to which it is extended."""
        fitting = MAX_UNKNOWNS // (2 * self.size)
        return max(min(MAX_HARMONICS * self.periods, fitting), MIN_HARMONICS * self.periods)

    @property
    def tail(self) -> float:
        """Share of the last two harmonics in the motion."""
        return float(tail_of(self.coefficients))


def tail_of(coefficients: np.ndarray) -> np.ndarray:
    """Return the share of the last two harmonics in the motion, for coefficients (..., 1 + 2 harmonics, coordinates)."""
    squares = (coefficients**2).sum(axis=-1)
    motion, last = np.sqrt(squares[..., 1:].sum(axis=-1)), np.sqrt(squares[..., -4:].sum(axis=-1))
    return np.asarray(last / np.maximum(motion, np.maximum(NO_MOTION * np.sqrt(squares.sum(axis=-1)), 1e-300)))


def sets_of(model: PeriodicModel, state: State) -> list[tuple[str, slice]]:
    """Return name and multipliers of each set of coordinates that does not couple with another."""
    n, r = model.n_in_plane, model.size
    if not state.planar:
        return [(COUPLED if r > n else IN_PLANE, slice(0, 2 * r))]
    return [(IN_PLANE, slice(0, 2 * n)), (OUT_OF_PLANE, slice(2 * n, 2 * r))][: 1 + (r > n)]


def strides(duration: np.ndarray | float, rate: float, samples: int) -> np.ndarray:
    """Return the numbers of steps of the scheme for multipliers for each sample, powers of two, in periods of durations."""
    steps = np.minimum(duration * rate / MAX_PHASE_STEP, MAX_PHASES)
    return MIN_STRIDE * 2 ** np.ceil(np.log2(np.maximum(steps / (samples * MIN_STRIDE), 1.0))).astype(int)


def rates_of(coefficients: np.ndarray) -> np.ndarray:
    """Return the coefficients of the harmonics of the derivative by the phase (1 + 2 harmonics, n)."""
    result, k = np.zeros_like(coefficients), np.arange(1, len(coefficients) // 2 + 1)[:, None]
    result[1::2], result[2::2] = k * coefficients[2::2], -k * coefficients[1::2]
    return result


class Forces(NamedTuple):
    """Forces of coordinates without dimension at M phases, and their derivatives."""

    force: np.ndarray  #: (M, n)
    rate: np.ndarray  #: derivative by the angular frequency, at constant coordinates and rates (M, n)
    stiffness: np.ndarray  #: negative derivative by the coordinates (M, n, n)
    #: negative derivative by the rates (M, n, n), mass-proportional damping left out; None for none
    damping: np.ndarray | None
    least: float  #: smallest chordwise force, without dimension


@lru_cache(KEPT_BASES)
def basis_at(phases: int, harmonics: int) -> np.ndarray:
    """Do :func:`harmonics_at`, once."""
    return harmonics_at(phases, harmonics)


def along_frequency(state: State) -> np.ndarray:
    """Return the direction of the frequency among the unknowns of a state."""
    direction = np.zeros(state.z.size)
    direction[-1] = 1.0
    return direction


class Solver:
    """Newton's method and multipliers for one model."""

    #: Work of a call beside that of its linear systems, in units of those: unknowns cubed.
    overhead = 2e6

    def __init__(self, model: PeriodicModel) -> None:
        from cablepod.periodic import _kernels_balance  # numba is imported only to compute

        self.model = model
        #: Unknowns cubed of all linear systems so far, with the overhead of calls
        self.work = 0.0
        self.balance = _kernels_balance

    def correct(
        self, state: State, direction: np.ndarray, active: np.ndarray | None = None
    ) -> tuple[State, np.ndarray, int]:
        """Change a state normal to `direction` into a solution, in the unknowns with the numbers `active`; None: all.

        Returns
        -------
        tuple
            The solution, the direction of the branch there, and the number of iterations, -1 where there is none.
        """
        if active is None:
            active = np.arange(state.z.size)
        z, tangent, iterations = self._newton(state, direction[active], active)
        self.work += self.overhead + abs(iterations) * active.size**3
        whole = np.zeros_like(direction)
        whole[active] = tangent
        return replace(state, z=z), whole, iterations

    def _forces(self, state: State, phases: int, *, tangents_only: bool = False) -> Forces:
        """Evaluate the forces at equidistant phases of the motion, for the coordinates of the state.

        With `tangents_only` forces and their rates may be left out; without them the least chordwise force is there.
        """
        from cablepod.periodic._kernels_forces import leading_samples  # numba is imported only to compute

        n, basis, count = state.size, basis_at(phases, state.harmonics), 0 if tangents_only else phases
        force, rate, tangent = np.empty((count, n)), np.empty((count, n)), np.empty((phases, n, n))
        forced = self.model.forced(n, phases, state.periods)
        least = leading_samples(state.z, basis, forced, 1, force, rate, tangent)
        return Forces(force, rate, tangent, None, least)

    def _balance(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the residual of all harmonics, its derivative by the angular frequency, and that by the coefficients."""
        samples, n, size, columns = 4 * state.harmonics + 4, state.size, state.z.size - 1, 1 + 2 * state.harmonics
        forces, basis = self._forces(state, samples), basis_at(samples, 2 * state.harmonics)
        residual, rate, jacobian = np.empty(size), np.empty(size), np.empty((size, size))
        self.balance.balance(state.z, basis, self.model.damping, state.periods, *forces[:3], residual, rate, jacobian)
        if forces.damping is None:
            return residual, rate, jacobian
        mean, blocks = np.tensordot(basis.T, forces.damping, 1) / samples, np.empty((size, size))
        self.balance.harmonic_blocks(mean, state.harmonics + 1, 0, blocks)
        rates = rates_of(np.eye(columns)) / state.periods  # from coefficients to rates, over the frequency
        of_damping = np.einsum("ira,rc->ica", blocks.reshape(size, columns, n), rates).reshape(size, size)
        return residual, rate + of_damping @ state.z[:-1], jacobian + state.omega * of_damping

    def _newton(self, state: State, direction: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Return all unknowns, the direction of the branch in the active ones, and the number of iterations."""
        kernel, z, before = self.balance, state.z.copy(), np.inf
        target = direction @ z[active]
        matrix, rows = np.empty((active.size, active.size)), active[:-1]
        right = np.zeros((active.size, 2))
        for iteration in range(kernel.MAX_ITERATIONS):
            residual, rate, jacobian = self._balance(replace(state, z=z))
            matrix[:-1, :-1], matrix[:-1, -1], matrix[-1] = jacobian[np.ix_(rows, rows)], rate[rows], direction
            right[:-1, 0], right[-1] = -residual[rows], (target - direction @ z[active], 1.0)
            largest = max(1.0, float(np.abs(z[active]).max()))
            try:
                change, tangent = np.linalg.solve(matrix, right).T
            except np.linalg.LinAlgError:
                break
            z[active] += change
            size_of_change = float(np.abs(change).max())
            if not size_of_change < 1e6 * largest or (iteration > 3 and size_of_change > before):
                break
            before = size_of_change
            if before <= kernel.NEWTON_RTOL * largest:
                return z, tangent / np.linalg.norm(tangent), iteration + 1
        return z, direction, -1

    def at_frequency(self, state: State) -> tuple[State, np.ndarray, int]:
        """Solve at the frequency of the state."""
        return self.correct(state, along_frequency(state))

    def jacobian(self, state: State) -> np.ndarray:
        """Return the derivative of the balance by the coefficients, all coordinates in each harmonic together."""
        return self._balance(state)[2]

    def stride(self, state: State) -> int:
        """Return the number of steps of the scheme for multipliers for each sample: a power of two.

        Raises
        ------
        RunStopped
            For a period too long for multipliers.
        """
        duration = 2.0 * np.pi * state.periods / max(abs(state.omega), 1e-12)
        check_period(self.model, duration)
        return int(strides(duration, self.model.fastest_rate, 4 * state.harmonics + 4))

    def stability(self, state: State, stride: int | None = None) -> Stability:
        """Compute the multipliers of a solution over its period."""
        matrices, least = self.monodromies(state, stride)
        alike = len({len(matrix) for matrix in matrices}) == 1  # eigenvalues of both at once are faster
        found = eigenvalues(np.stack(matrices)) if alike else [eigenvalues(matrix) for matrix in matrices]
        if np.abs(state.coefficients).max() > NO_MOTION and self.model.is_axisymmetric:
            found[-1][np.abs(found[-1] - 1.0).argmin()] = 1.0  # of turned orbits
        return Stability(np.concatenate(found), least * self.model.force_scale)

    def monodromies(self, state: State, stride: int | None = None) -> tuple[list[np.ndarray], float]:
        """Return a matrix for each set of coordinates, whose eigenvalues are its multipliers, and the least chordwise force."""
        self.work += self.overhead
        phases = (4 * state.harmonics + 4) * (stride or self.stride(state))
        forces = self._forces(state.full(self.model), phases, tangents_only=True)
        duration = 2.0 * np.pi * state.periods / state.omega
        parts = [slice(which.start // 2, which.stop // 2) for _, which in sets_of(self.model, state)]
        return [self._monodromy(forces, part, duration) for part in parts], forces.least

    def _monodromy(self, forces: Forces, part: slice, duration: float) -> np.ndarray:
        """Return the matrix of the coordinates of one set over a period."""
        from cablepod.periodic._kernels_floquet import monodromy  # numba is imported only to compute

        size, alpha = 2 * (part.stop - part.start), self.model.damping
        matrix = np.empty((size, size))
        monodromy(forces.stiffness, part.start, part.stop, alpha, duration / len(forces.stiffness), matrix)
        return matrix * np.exp(-0.5 * alpha * duration)

    def rest(self, omega: float, harmonics: int) -> State:
        """Return the state of rest of all coordinates that the forcing moves."""
        model = self.model
        size = model.n_in_plane if model.is_planar else model.size
        coefficients = np.zeros((1 + 2 * harmonics, size))
        coefficients[0] = model.rest[:size] / model.scales[1]
        return State(np.append(coefficients.ravel(), omega), model.is_planar, size)
