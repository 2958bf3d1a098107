"""Explicit runs of the chain: velocity Verlet in leapfrog form."""

from __future__ import annotations

import math

import numpy as np

from cablepod import stepping
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

        chain, p, free = self.chain, self.chain.p, self.chain.free
        instants = self.instants(rate)
        total = int(instants.steps[-1]) + 1
        step = 1.0 / rate
        mass = p.mass * chain.share[free]
        decay, per_mass = None, step / mass
        if p.mass_damping is not None:
            decay = math.exp(-p.mass_damping * step)
            per_mass = -math.expm1(-p.mass_damping * step) / (p.mass_damping * mass)
        position = tuple(np.ascontiguousarray(self.initial[:, c]) for c in range(p.dims))
        velocity, before = self._first_half_step(step, mass)
        planar = p.dims == 2
        xyz = (*position, None) if planar else position
        uvw = (*velocity, None) if planar else velocity
        work = (None, None) if planar else (np.zeros(chain.links + 2), np.zeros(chain.links + 1))
        drive = tuple(np.ascontiguousarray(column) for column in (per_mass[:, None] * chain.loads()[free]).T)
        varying = chain.varying()
        patterns = np.array([np.ascontiguousarray(item[0][free].T) for item in varying]) if varying else None
        saved = np.empty((instants.steps.size, p.dims, chain.links + 1))
        wanted = self.wants_velocity(instants)
        halves = np.empty((instants.steps.size, 2, p.dims, mass.size)) if wanted else None
        extremes = self.extremes()
        low, high = extremes or (None, None)
        inverse = chain.inverse_squares
        moving, bound = self.moving, self.bound

        def advance(start: int, steps: int) -> bool:
            time = np.arange(start, start + steps + 1) / rate
            ends = p.end_positions(time) if moving else None
            first, last = np.searchsorted(instants.steps, (start, start + steps))
            kernel.verlet(
                *xyz, *uvw, *work, free.start, free.stop, chain.k, chain.length, inverse, per_mass, drive, step, decay,
                np.ascontiguousarray(ends[:, 0]) if ends is not None and "lower" in moving else None,
                np.ascontiguousarray(ends[:, 1]) if ends is not None and "upper" in moving else None,
                patterns,
                np.stack([factor(time) for _, factor in varying], axis=1) if varying else None,
                p.link_viscosity, before,
                p.end_positions(time, 1) if before is not None else None,
                steps, start, instants.steps[first:last], saved[first:last],
                halves[first:last] if halves is not None else None, low, high,
            )  # fmt: skip
            return all(np.isfinite(x).all() and np.abs(x).max() < bound for x in position)

        failed = stepping.march(advance, (*position, *velocity, *(before or ())), total, self.progress)
        if failed is not None:
            self._stop(instants, saved, halves, failed, rate)
        result = self._gather(instants, saved, halves, extremes)
        self._check_limit(result)
        return self.watch(result)

    def _first_half_step(
        self, step: float, mass: np.ndarray
    ) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...] | None]:
        """Velocities half a step before the start from rest, and with viscosity those a step earlier."""
        p, free = self.chain.p, self.chain.free
        half = 0.5 * step if p.mass_damping is None else math.expm1(0.5 * p.mass_damping * step) / p.mass_damping
        back = -half * self.first_force()[free] / mass[:, None]
        velocity = tuple(np.ascontiguousarray(column) for column in back.T)
        # the prediction 1.5 v - 0.5 before then gives rest at the start
        return velocity, None if p.link_viscosity is None else tuple(3.0 * v for v in velocity)

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
            free = self.chain.free
            v, a = np.zeros_like(x), np.zeros_like(x)
            v[:, free] = np.moveaxis(0.5 * (halves[:, 0] + halves[:, 1]), 1, 2)
            a[:, free] = np.moveaxis((halves[:, 1] - halves[:, 0]) * instants.rate, 1, 2)
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
