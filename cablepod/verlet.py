"""Explicit runs of the chain: velocity Verlet in leapfrog form."""

from __future__ import annotations

import math

import numpy as np

from cablepod import stepping
from cablepod.conventions import COORDINATES, ENDS
from cablepod.runs import Run, State
from cablepod.stepping import Instants, RunStopped


class VerletRun(Run):
    """Velocity Verlet: second order, symplectic without damping, stable below 2 over the highest angular frequency."""

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return "velocity_verlet"

    def __call__(self, rate: float) -> State:
        """Run with so many steps per second."""
        from cablepod.kernels import chain as kernel  # numba is imported only to compute

        instants = self.instants(rate)
        total = int(instants.steps[-1]) + 1
        state, decay, patterns = self._first_state(1.0 / rate)
        chain, p = self.chain, self.chain.p
        factors = [factor for _, factor in chain.varying()]
        saved = np.empty((instants.steps.size, p.dims, chain.links + 1))
        halves = np.empty((len(saved), 2, *saved.shape[1:])) if self.wants_velocity(instants) else None
        extremes = True if "tension_extremes" in self.outputs else None
        rows = np.array([kernel.X + COORDINATES.index(axis) for _, axis in p.motions], dtype=np.int64)
        columns = np.array([chain.links * ENDS.index(end) for end, _ in p.motions], dtype=np.int64)
        position, bound = state[kernel.X : kernel.X + p.dims, : chain.links + 1], self.bound

        def advance(start: int, steps: int) -> bool:
            first, last = np.searchsorted(instants.steps, (start, start + steps))
            kernel.verlet(
                state, chain.links, True if p.dims == 3 else None, True if chain.green else None, 1.0 / rate, decay,
                p.link_viscosity, patterns,
                np.stack([factor.on_steps(start, steps, rate) for factor in factors], axis=1) if factors else None,
                rows, columns, p.end_tables(start, steps, rate),
                p.end_tables(start, steps, rate, 1) if p.link_viscosity is not None else None, extremes,
                steps, start, instants.steps[first:last], saved[first:last],
                halves[first:last] if halves is not None else None,
            )  # fmt: skip
            return bool(np.isfinite(position).all() and np.abs(position).max() < bound)

        failed = stepping.march(advance, (state,), total, self.progress)
        if failed is not None:
            self._stop(instants, saved, halves, failed, rate)
        low, high = (_root(state[row, : chain.links]) for row in (kernel.LOW, kernel.HIGH))
        result = self._gather(instants, saved, halves, (low, high) if extremes else None)
        self._check_limit(result)
        return self.watch(result)

    def _first_state(self, step: float) -> tuple[np.ndarray, float | None, np.ndarray | None]:
        """State of the kernel at the start from rest, its decay, and its patterns of loads that vary in time."""
        from cablepod.kernels import chain as kernel

        chain, p, free = self.chain, self.chain.p, self.chain.free
        state, links, particles = kernel.new_state(chain.links), slice(chain.links), slice(chain.links + 1)
        mass = p.mass * chain.share[free]
        decay, half = None, 0.5 * step
        state[kernel.PER_MASS, free] = step / mass
        if p.mass_damping is not None:
            decay = math.exp(-p.mass_damping * step)
            half = stepping.damped_growth(p.mass_damping, step) / p.mass_damping
            state[kernel.PER_MASS, free] = -math.expm1(-p.mass_damping * step) / (p.mass_damping * mass)
        per_mass = state[kernel.PER_MASS, particles]
        varying = chain.varying()
        force, loads = self.first_force(), chain.loads()
        for c in range(p.dims):
            state[kernel.X + c, particles] = self.initial[:, c]
            state[kernel.VX + c, free] = -half * force[free, c] / mass
            state[(kernel.STEADY_X if varying else kernel.DRIVE_X) + c, particles] = per_mass * loads[:, c]
            # with viscosity the prediction 1.5 v - 0.5 before then gives rest at the start
            state[kernel.BX + c] = 3.0 * state[kernel.VX + c]
        state[kernel.STIFFNESS, links], state[kernel.LENGTH, links] = chain.k, chain.length
        if chain.inverse_squares is not None:
            state[kernel.INVERSE, links] = chain.inverse_squares
        state[kernel.LOW], state[kernel.HIGH] = np.inf, -np.inf
        patterns = (
            np.array([np.ascontiguousarray((per_mass[:, None] * item).T) for item, _ in varying]) if varying else None
        )
        return state, decay, patterns

    def _gather(
        self,
        instants: Instants,
        saved: np.ndarray,
        halves: np.ndarray | None,
        extremes: tuple[np.ndarray, np.ndarray] | None,
    ) -> State:
        x = np.ascontiguousarray(np.moveaxis(saved, 1, 2))
        v = a = None
        if halves is not None:
            v = np.ascontiguousarray(np.moveaxis(0.5 * (halves[:, 0] + halves[:, 1]), 1, 2))
            a = np.ascontiguousarray(np.moveaxis((halves[:, 1] - halves[:, 0]) * instants.rate, 1, 2))
        state = self.state(instants, x, v, a, extremes)
        state.notes = {"step_limit": self._limit()}
        return state

    def _check_limit(self, state: State, *, incomplete: int | None = None) -> None:
        """Raise :class:`RunStopped` where the links became too stiff for the step, which only law (21) lets them."""
        chain, rate = self.chain, state.instants.rate
        if not chain.green:
            return
        stiffening = chain.stiffening(state.position)
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
        return self.chain.step_limit(self.chain.stiffening(self.initial))

    def _stop(self, instants: Instants, saved: np.ndarray, halves: np.ndarray | None, done: int, rate: float) -> None:
        """Raise :class:`RunStopped` with what was computed before step `done`."""
        count = int(np.searchsorted(instants.times, done / rate * (1.0 - 1e-12)))
        partial = None
        if count:
            few = Instants.of(instants.times[:count], rate)
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


def _root(signed_square: np.ndarray) -> np.ndarray:
    """T from T |T|."""
    return np.copysign(np.sqrt(np.abs(signed_square)), signed_square)
