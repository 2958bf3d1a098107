"""Periodic responses of the full chain, by the technique of the reduced model: harmonic balance, continuation, multipliers.

Unknowns are the harmonics of the displacements of all particles, which links couple to their neighbours only.  Scales are those
of the reduced model, so that arc lengths, steps and the location of bifurcations are the same.  Bifurcations are zeros of Hill's
determinants: they err by the harmonics that are left out, not by time steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr

from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.errors import RunStopped
from cablepod.parameters._from_scene import Members
from cablepod.periodic._continuation import Branch, Limits, Point, trace
from cablepod.periodic._events import DOUBLING, FOLD, PITCHFORK, Event, _locate
from cablepod.periodic._forcing import periodic_forcing
from cablepod.periodic._model import PeriodicModel, harmonics_at
from cablepod.periodic._solve import IN_PLANE, OUT_OF_PLANE, Stability, State, along_frequency
from periodic import _kernels as kernel

#: Relative Newton correction below which the next one is rounding, and maximum number of iterations.
NEWTON_RTOL, MAX_ITERATIONS = 1e-9, 14
NO_MULTIPLIERS = np.empty(0, dtype=complex)


@dataclass(frozen=True, eq=False)
class ChainState(State):
    """State of a chain, which keeps its number of harmonics."""

    @property
    def most_harmonics(self) -> int:
        """Largest number of harmonics to which it is extended."""
        return self.harmonics

    def changed(self, coefficients: np.ndarray, omega: float | None = None) -> ChainState:
        """Return the state with other coefficients (1 + 2 harmonics, coordinates)."""
        z = np.append(coefficients.ravel(), self.omega if omega is None else omega)
        return replace(self, z=z)

    def resized(self, harmonics: int) -> ChainState:
        """Return the state as it is."""
        return self


@dataclass(eq=False)
class ChainModel:
    """Chain under periodic forcing, in the scales of a reduced model of the same scene."""

    chain: LumpedChain  #: of the scene at unit angular frequency
    scales: tuple[float, float]  #: of frequency [rad/s] and coordinates [kg^1/2 m]
    spatial: bool  #: whether a planar scene moves out of its plane

    @classmethod
    def of(cls, scene: xr.Dataset, reduced: PeriodicModel, links: int, *, spatial: bool = False) -> ChainModel:
        """Discretise a planar scene with some number of links."""
        p = periodic_forcing(Members(scene)[0]).parameters
        return cls(chain_of(p, links), reduced.scales[:2], spatial)

    @property
    def coordinates(self) -> int:
        """Number of coordinates of a particle."""
        return 3 if self.spatial else 2

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return (self.chain.links - 1) * self.coordinates

    @property
    def highest_frequency(self) -> float:
        """Bound of the frequencies, without dimension."""
        return self.chain.highest_frequency() / self.scales[0]

    @cached_property
    def damping(self) -> float:
        """Mass-proportional damping without dimension."""
        return float(self.chain.p.damping) / self.scales[0]

    #: The studies have damping by mass alone.
    is_damped_beside_mass = False

    @property
    def slowest_decays(self) -> tuple[float, float]:
        """Rates at which the slowest disturbance about rest decays, without dimension: of what the forcing moves, and of all."""
        return 0.5 * self.damping, 0.5 * self.damping

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses of the free particles (n - 1,) [kg]."""
        return self.chain.p.mass * self.chain.tributary_length[1:-1]

    @cached_property
    def unit(self) -> np.ndarray:
        """Factors of forces over the square root of the mass and of stiffnesses over masses."""
        omega, length = self.scales
        return np.array([1.0 / (length * omega**2), 1.0 / omega**2])

    @cached_property
    def rest(self) -> np.ndarray:
        """Positions of the free particles at rest (n - 1, d) [m]."""
        return self._in_space(rest_shape(self.chain)[0])[1:-1]

    def _in_space(self, values: np.ndarray) -> np.ndarray:
        """Append a third coordinate of zero to vectors (..., 2) where the chain moves in space."""
        return np.concatenate([values, np.zeros_like(values[..., :1])], axis=-1) if self.spatial else values

    def ends(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of both ends at equidistant phases (samples, d) [m]."""
        phase = 2.0 * np.pi / samples * np.arange(samples)
        ends = self._in_space(self.chain.p.end_positions(phase))
        return np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])

    def loads(self, harmonics: int) -> np.ndarray:
        """Return the harmonics of the loads (n - 1, columns, d), scaled."""
        samples = 4 * harmonics + 4
        phase = 2.0 * np.pi / samples * np.arange(samples)
        loads = np.stack([self.chain.loads(t) for t in phase])[:, 1:-1]
        basis = harmonics_at(samples, harmonics)
        weights = np.full(1 + 2 * harmonics, 2.0 / samples)
        weights[0] = 1.0 / samples
        found = np.einsum("c,sc,spa->pca", weights, basis, self._in_space(loads))
        return found / np.sqrt(self.mass)[:, None, None] * self.unit[0]

    def positions(self, state: State, phases: int) -> np.ndarray:
        """Return the positions of all particles at equidistant phases of a period (phases, n + 1, d) [m]."""
        x = harmonics_at(phases, state.harmonics) @ state.coefficients
        moved = x.reshape(phases, -1, self.coordinates) * (self.scales[1] / np.sqrt(self.mass)[:, None])
        lower, upper = self.ends(phases)
        return np.concatenate([lower[:, None], self.rest + moved, upper[:, None]], axis=1)


class ChainSolver:
    """Newton's method, determinants and multipliers of a chain, with a given number of harmonics."""

    def __init__(self, model: ChainModel, harmonics: int) -> None:
        self.model, self.harmonics = model, harmonics
        samples = 4 * harmonics + 4
        self.basis = harmonics_at(samples, 2 * harmonics)
        self.lower, self.upper = model.ends(samples)
        self.load = model.loads(harmonics)
        self.force = np.empty((model.chain.links, samples, model.coordinates))
        self.tangent = np.empty((*self.force.shape, model.coordinates))

    def rest(self, omega: float) -> State:
        """Return the state at an angular frequency without dimension in which all particles follow the ends from rest."""
        model = self.model
        lower, upper = model.ends(16)
        sigma = (model.chain.arc_length / model.chain.total_length)[:, None]
        at_rest = np.concatenate([lower[:1], model.rest, upper[:1]])
        moved = (lower - lower[0])[:, None] * (1.0 - sigma) + (upper - upper[0])[:, None] * sigma
        return self.state_of(at_rest + moved, omega)

    def state_of(self, position: np.ndarray, omega: float) -> State:
        """Return the state of positions at equidistant phases of a period (phases, n + 1, d) [m]."""
        model, phases = self.model, len(position)
        moved = (position[:, 1:-1] - model.rest) * (np.sqrt(model.mass)[:, None] / model.scales[1])
        kept = min(self.harmonics, (phases - 1) // 2)
        found = np.zeros((1 + 2 * self.harmonics, model.size))
        found[: 1 + 2 * kept] = 2.0 / phases * harmonics_at(phases, kept).T @ moved.reshape(phases, -1)
        found[0] *= 0.5
        return ChainState(np.append(found.ravel(), omega), False, model.size)

    def _evaluate(self, state: State) -> tuple[np.ndarray, float]:
        """Fill forces and tangents of the links; return the displacements (n - 1, columns, d) and the smallest tension [N]."""
        model = self.model
        if state.harmonics != self.harmonics:
            raise ValueError(f"given {state.harmonics} harmonics; allowed: the {self.harmonics} of the solver")
        x = state.coefficients.reshape(-1, model.chain.links - 1, model.coordinates).transpose(1, 0, 2)
        x = np.ascontiguousarray(x)
        position = x * (model.scales[1] / np.sqrt(model.mass))[:, None, None]
        position[:, 0] += model.rest
        least = kernel.link_samples(
            position, self.basis[:, : 1 + 2 * self.harmonics], self.lower, self.upper, model.chain.length,
            model.chain.p.stiffness, self.force, self.tangent,
        )  # fmt: skip
        return x, least

    def correct(self, state: State, direction: np.ndarray) -> tuple[State, np.ndarray, int]:
        """Do :meth:`cablepod.periodic._solve.Solver.correct` with the chain."""
        model, z, before = self.model, state.z.copy(), np.inf
        target = direction @ z
        residual = np.empty((model.chain.links - 1, 1 + 2 * self.harmonics, model.coordinates))
        right = np.empty((len(residual), residual[0].size, 2))
        for iteration in range(MAX_ITERATIONS):
            x, _ = self._evaluate(replace(state, z=z))
            kernel.newton_step(
                x, z[-1], self.basis, self.load, np.zeros_like(self.load), self.force, self.tangent, model.mass,
                model.unit, model.damping, residual, right,
            )  # fmt: skip
            parts = right.reshape(len(residual), *residual.shape[1:], 2).transpose(1, 0, 2, 3).reshape(-1, 2)
            slope = parts[:, 1] @ direction[:-1] + direction[-1]
            change = (target - direction @ z - parts[:, 0] @ direction[:-1]) / slope
            step = np.append(parts[:, 0] + change * parts[:, 1], change)
            z += step
            size, largest = float(np.abs(step).max()), max(1.0, float(np.abs(z).max()))
            if not size < 1e6 * largest or (iteration > 4 and size > before):
                break
            before = size
            if size <= NEWTON_RTOL * largest:
                tangent = np.append(parts[:, 1], 1.0) * np.sign(slope)
                return replace(state, z=z), tangent / np.linalg.norm(tangent), iteration + 1
        return replace(state, z=z), direction, -1

    def at_frequency(self, state: State) -> tuple[State, np.ndarray, int]:
        """Solve at the frequency of the state."""
        return self.correct(state, along_frequency(state))

    def stride(self, state: State) -> int:
        """Return a number that continuation passes on; determinants need no steps."""
        return 1

    def stability(self, state: State, stride: int = 1) -> Stability:
        """Return the smallest tension, without multipliers: determinants locate bifurcations, at a fraction of the cost."""
        return Stability(NO_MULTIPLIERS, self._evaluate(state)[1])

    def determinant(self, state: State, which: str, first: float) -> tuple[float, float]:
        """Return sign and logarithm of Hill's determinant of a planar orbit, of disturbances in the plane or out of it."""
        self._evaluate(state)
        model = self.model
        return kernel.determinant(
            self._tangents(which), self.basis, self.harmonics, first, state.omega, model.damping, model.mass, model.unit
        )

    def _tangents(self, which: str) -> np.ndarray:
        """Return the stiffness of links at the samples for disturbances in the plane, or out of it (n, N, d, d)."""
        return self.tangent if which == IN_PLANE else self._secant[..., None, None]

    @property
    def _secant(self) -> np.ndarray:
        """Tension over length of the links at the samples (n, N): the smaller eigenvalue of the tangent in the plane."""
        trace = np.trace(self.tangent, axis1=2, axis2=3)
        return np.ascontiguousarray(trace - self.model.chain.k[:, None])

    def multipliers(self, state: State, stride: int = 4) -> np.ndarray:
        """Return all Floquet multipliers by the trapezoidal rule, on a planar orbit those in the plane first.

        `stride` is the number of steps for each sample of the harmonic balance.
        """
        model = self.model
        phases = stride * len(self.basis)
        fine = ChainSolver.__new__(ChainSolver)
        fine.model, fine.harmonics = model, self.harmonics
        fine.basis = harmonics_at(phases, self.harmonics)
        fine.lower, fine.upper = model.ends(phases)
        fine.force = np.empty((model.chain.links, phases, model.coordinates))
        fine.tangent = np.empty((*fine.force.shape, model.coordinates))
        fine._evaluate(state)
        duration = 2.0 * np.pi / state.omega
        found = []
        sets = [fine.tangent] if model.spatial else [fine.tangent, fine._secant[..., None, None]]
        for tangent in sets:
            size = 2 * (model.chain.links - 1) * tangent.shape[2]
            matrix = np.empty((size, size))
            along = np.ascontiguousarray(tangent.swapaxes(0, 1))
            kernel.monodromy(along, model.mass, model.unit, model.damping, duration / phases, matrix)
            found.append(np.linalg.eigvals(matrix))
        return np.concatenate(found) * np.exp(-0.5 * model.damping * duration)


#: Bifurcations of a planar main branch: kind, set, lowest harmonic of the disturbance.
DETERMINANTS = ((PITCHFORK, OUT_OF_PLANE, 0.0), (DOUBLING, OUT_OF_PLANE, 0.5), (DOUBLING, IN_PLANE, 0.5))


def main_branch(solver: ChainSolver, frequency: tuple[float, float], points: int = 2000) -> tuple[Branch, list[Event]]:
    """Trace the planar branch of a chain from the lower to the higher frequency [rad/s], and locate its bifurcations."""
    scale = solver.model.scales[0]
    low, high = frequency[0] / scale, frequency[1] / scale
    state, direction, iterations = solver.at_frequency(solver.rest(low))
    if iterations < 0:
        raise RunStopped(f"the chain has no response near rest at {frequency[0]:g} rad/s")
    if direction[-1] < 0.0:
        direction = -direction
    branch, events, before = Branch(1), [], []

    def on_point(branch: Branch, _: bool) -> bool:
        last = branch.points[-1]
        before.append([solver.determinant(last.state, which, first) for _, which, first in DETERMINANTS])
        if len(before) == 1:
            return True
        a, b = branch.points[-2:]
        if a.direction[-1] * b.direction[-1] < 0.0:
            _add(solver, events, FOLD, IN_PLANE, a, b, lambda point: float(point.direction[-1]))
        for k, (kind, which, first) in enumerate(DETERMINANTS):
            if before[-2][k][0] != before[-1][k][0]:
                reference = before[-1][k][1]

                def test(point: Point, which: str = which, first: float = first, at: float = reference) -> float:
                    sign, logarithm = solver.determinant(point.state, which, first)
                    return float(sign * np.exp(logarithm - at))

                _add(solver, events, kind, which, a, b, test)
        return True

    trace(solver, branch, state, direction, Limits(low, high, points), on_point)
    return branch, events


def _add(
    solver: ChainSolver, events: list[Event], kind: str, which: str, first: Point, second: Point,
    test: Callable[[Point], float],
) -> None:  # fmt: skip
    """Locate a bifurcation between two points, and append it."""
    found = _locate(solver, first, second, test)
    if found is not None:
        events.append(Event(kind, which, found[1].state, 1))
