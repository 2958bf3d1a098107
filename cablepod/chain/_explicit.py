"""Explicit runs of the chain: velocity Verlet in leapfrog form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cablepod.chain import _kernels_layout as layout
from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import RunStopped
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._run import ChainRun, Trajectory
from cablepod.integrate._step_control import damped_growth
from cablepod.parameters._time_functions import BatchedTimeFunction


class ExplicitChainRun(ChainRun):
    """Velocity Verlet: second order, symplectic without damping, stable below 2 over the highest angular frequency."""

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return "velocity_verlet"

    def __call__(self, rate: float) -> Trajectory:
        """Run with so many steps per second."""
        march = ExplicitStepper([self.begin(rate)])
        failed = advance_in_blocks(
            lambda start, steps: bool(march.advance(start, steps)[0]), (march.states,), march.total, self.progress
        )
        if failed is not None:
            self._stop(march.instants, march.saved[0], None if march.halves is None else march.halves[0], failed, rate)
        return self.finish(march, 0)

    def begin(self, rate: float) -> PreparedRun:
        """Make ready to run with so many steps per second."""
        return PreparedRun(self, self.instants(rate), *self._first_state(1.0 / rate))

    def finish(self, march: ExplicitStepper, place: int) -> Trajectory:
        """Return what this run gave, which was the one at some place among those of a march.

        Raises
        ------
        RunStopped
            Where the links hold more energy than anything explains, or became too stiff for the step.
        """
        links = slice(self.chain.links)
        low, high = (_root(march.states[place, row, links]) for row in (layout.LOW, layout.HIGH))
        result = self._gather(
            march.instants,
            march.saved[place],
            None if march.halves is None else march.halves[place],
            (low, high) if "tension_extremes" in self.outputs else None,
        )
        self._check_limit(result)
        return self.watch(result)

    @property
    def shape(self) -> tuple[Any, ...]:
        """What runs must have alike to go abreast, see :class:`March`."""
        chain, p = self.chain, self.chain.p
        terms = (p.mass_damping is None, p.link_viscosity is None, len(chain.time_dependent_loads()), tuple(p.motions))
        return chain.links, p.dims, chain.law, terms, self.outputs, self.times.tobytes()

    def _first_state(self, step: float) -> tuple[np.ndarray, float | None, np.ndarray | None]:
        """State of the kernel at the start from rest, its decay, and its patterns of loads that vary in time."""
        from cablepod.chain import _kernels_explicit as kernel_explicit

        chain, p, free = self.chain, self.chain.p, self.chain.free_particles
        state, links, particles = (
            kernel_explicit.new_states(1, chain.links)[0],
            slice(chain.links),
            slice(chain.links + 1),
        )
        mass = p.mass * chain.tributary_length[free]
        decay, half = None, 0.5 * step
        state[layout.PER_MASS, free] = step / mass
        if p.mass_damping is not None:
            decay = math.exp(-p.mass_damping * step)
            half = damped_growth(p.mass_damping, step) / p.mass_damping
            state[layout.PER_MASS, free] = -math.expm1(-p.mass_damping * step) / (p.mass_damping * mass)
        per_mass = state[layout.PER_MASS, particles]
        varying = chain.time_dependent_loads()
        force, loads = self.first_force(), chain.loads()
        for c in range(p.dims):
            state[layout.X + c, particles] = self.initial[:, c]
            state[layout.VX + c, free] = -half * force[free, c] / mass
            state[(layout.STEADY_X if varying else layout.DRIVE_X) + c, particles] = per_mass * loads[:, c]
            # with viscosity the prediction 1.5 v - 0.5 before then gives rest at the start
            state[layout.BX + c] = 3.0 * state[layout.VX + c]
        state[layout.STIFFNESS, links], state[layout.LENGTH, links] = chain.k, chain.length
        if chain.inverse_squares is not None:
            state[layout.INVERSE, links] = chain.inverse_squares
        state[layout.LOW], state[layout.HIGH] = np.inf, -np.inf
        patterns = (
            np.array([np.ascontiguousarray((per_mass[:, None] * item).T) for item, _ in varying]) if varying else None
        )
        return state, decay, patterns

    def _gather(
        self,
        instants: OutputTimes,
        saved: np.ndarray,
        halves: np.ndarray | None,
        extremes: tuple[np.ndarray, np.ndarray] | None,
    ) -> Trajectory:
        x = np.ascontiguousarray(np.moveaxis(saved, 1, 2))
        v = a = None
        if halves is not None:
            v = np.ascontiguousarray(np.moveaxis(0.5 * (halves[:, 0] + halves[:, 1]), 1, 2))
            a = np.ascontiguousarray(np.moveaxis((halves[:, 1] - halves[:, 0]) * instants.steps_per_second, 1, 2))
        state = self.state(instants, x, v, a, extremes)
        state.diagnostics = {"step_limit": self._limit()}
        return state

    def _check_limit(self, state: Trajectory, *, incomplete: int | None = None) -> None:
        """Raise :class:`RunStopped` where the links became too stiff for the step, which only law (21) lets them."""
        chain, rate = self.chain, state.instants.steps_per_second
        if not chain.green:
            return
        stiffening = chain.tangent_stiffness_ratio(state.position)
        if chain.step_limit(stiffening.max(axis=0)) > 1.0 / rate:
            return  # not even all links at their stiffest
        for time, now in zip(state.instants.times, stiffening, strict=True):
            limit = chain.step_limit(now)
            if limit <= 1.0 / rate:
                why = (
                    f"the chain stiffened: at {time:.6g} s its stability limit is {limit:.6g} s, below the step "
                    f"{1 / rate:.6g} s (velocity Verlet, law {chain.law}); try a shorter step"
                )
                if incomplete is None:
                    raise RunStopped(why, self.dataset(state))
                self.stop(state, incomplete, rate, why)

    def _limit(self) -> float:
        """Stability limit of the step at the start [s]."""
        return self.chain.step_limit(self.chain.tangent_stiffness_ratio(self.initial))

    def _stop(
        self, instants: OutputTimes, saved: np.ndarray, halves: np.ndarray | None, done: int, rate: float
    ) -> None:
        """Raise :class:`RunStopped` with what was computed before step `done`."""
        count = int(np.searchsorted(instants.times, done / rate * (1.0 - 1e-12)))
        partial = None
        if count:
            few = OutputTimes.of(instants.times[:count], rate)
            keep = few.steps.size
            partial = self._gather(few, saved[:keep], None if halves is None else halves[:keep], None)
            self._check_limit(partial, incomplete=done)  # why it broke down, if that shows at an instant of the output
        self.stop(
            partial,
            done,
            rate,
            f"the chain left the finite numbers at {done / rate:.6g} s (velocity Verlet, step {1 / rate:.4g} s, step number "
            f"{done}, stability limit {self._limit():.4g} s); try a shorter step, gentler loads or motion, or damping",
        )


@dataclass(frozen=True)
class PreparedRun:
    """A run that is ready to step."""

    run: ExplicitChainRun
    instants: OutputTimes
    state: np.ndarray  #: as the kernel has it
    decay: float | None
    patterns: np.ndarray | None

    @property
    def kept(self) -> int:
        """Bytes of what is saved at the steps."""
        parts = 3 if self.run.wants_velocity(self.instants) else 1
        return 8 * parts * self.instants.steps.size * self.run.initial.size


class ExplicitStepper:
    """Runs of equal :attr:`VerletRun.shape` and step abreast: one compiled call advances all of them."""

    def __init__(self, begun: Sequence[PreparedRun]) -> None:
        from cablepod.chain import _kernels_explicit as kernel_explicit

        first = begun[0]
        run, chain, p = first.run, first.run.chain, first.run.chain.p
        self.instants, self.bounds = first.instants, np.array([item.run.divergence_bound for item in begun])
        self.states = kernel_explicit.new_states(len(begun), chain.links)
        np.stack([item.state for item in begun], out=self.states)
        count, saves = len(begun), self.instants.steps.size
        self.total = int(self.instants.steps[-1]) + 1
        self.is_finite = np.ones(count, dtype=bool)  #: those that are advanced
        self.saved = np.empty((count, saves, p.dims, chain.links + 1))
        self.halves = np.empty((count, saves, 2, *self.saved.shape[2:])) if run.wants_velocity(self.instants) else None
        self._position = self.states[:, layout.X : layout.X + p.dims, : chain.links + 1]
        rows = np.array([layout.X + COORDINATES.index(axis) for _, axis in p.motions], dtype=np.int64)
        self._places = rows, np.array([chain.links * ENDS.index(end) for end, _ in p.motions], dtype=np.int64)
        ends = [_batched_motion(begun, end, axis) for end, axis in p.motions]
        loads = zip(*(item.run.chain.time_dependent_loads() for item in begun), strict=True)
        self._functions = {
            "ends": ends,
            "rates": ends,
            "factors": [BatchedTimeFunction([own[1] for own in load]) for load in loads],
        }
        self._tables: dict[str, np.ndarray] = {}
        self._patterns = _stacked([item.patterns for item in begun])
        self._decays = _stacked([item.decay for item in begun])
        self._viscosities = _stacked([item.run.chain.p.link_viscosity for item in begun])
        self._kind = chain.links, True if p.dims == 3 else None, True if chain.green else None
        self._extremes = True if "tension_extremes" in run.outputs else None

    def advance(self, start: int, steps: int) -> np.ndarray:
        """Take steps from the one number `start` on; tells which runs have not left the finite numbers (runs,)."""
        from cablepod.chain import _kernels_explicit as kernel  # numba is imported only to compute

        rate, viscous = self.instants.steps_per_second, self._viscosities is not None
        first, last = np.searchsorted(self.instants.steps, (start, start + steps))
        kernel.verlet(
            self.states, self.is_finite, *self._kind, 1.0 / rate, self._decays, self._viscosities, self._patterns,
            self._table("factors", start, steps) if self._functions["factors"] else None,
            *self._places, self._table("ends", start, steps), self._table("rates", start, steps) if viscous else None,
            self._extremes, steps, start, self.instants.steps, first, last, self.saved, self.halves,
        )  # fmt: skip
        axes = (1, 2)
        with np.errstate(invalid="ignore"):
            return np.isfinite(self._position).all(axis=axes) & (np.abs(self._position).max(axis=axes) < self.bounds)

    def _table(self, name: str, start: int, steps: int) -> np.ndarray:
        """Values of time functions at steps from `start` on: (runs, functions, steps + 1)."""
        functions = self._functions[name]
        shape = len(self.states), len(functions), steps + 1
        table = self._tables.get(name)
        if (
            table is None or table.shape != shape
        ):  # to have new memory cleared for each block costs as much as to fill it
            table = self._tables[name] = np.empty(shape)
        for row, function in enumerate(functions):
            function.fill(start, self.instants.steps_per_second, int(name == "rates"), row, table)
        return table


def _batched_motion(begun: Sequence[PreparedRun], end: str, axis: str) -> BatchedTimeFunction:
    """Gather the motion of one coordinate of an end in several runs."""
    own = [item.run.chain.p for item in begun]
    origins = [(p.lower if end == "lower" else p.upper)[COORDINATES.index(axis)] for p in own]
    return BatchedTimeFunction([p.motions[end, axis] for p in own], origins)


def _stacked(items: list[Any]) -> np.ndarray | None:
    return None if items[0] is None else np.stack(items)


def _root(signed_square: np.ndarray) -> np.ndarray:
    """T from T |T|."""
    return np.copysign(np.sqrt(np.abs(signed_square)), signed_square)
