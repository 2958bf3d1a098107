"""Explicit runs of the Galerkin model: velocity Verlet."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cablepod.errors import RunStopped
from cablepod.galerkin._runs import PACKED_COST, GalerkinRun, GalerkinTrajectory, RunRecord
from cablepod.integrate._step_control import damped_growth


class ExplicitGalerkinRun(GalerkinRun):
    """Velocity Verlet: second order, its energy swings and does not drift; stable below 2 over the highest frequency."""

    @property
    def packs(self) -> bool:
        """Whether packed coefficients are the faster way."""
        monomials = len(self.model.used) + self.model.pairs[0].size
        rows = min(monomials, self.model.chain.links)
        return monomials * rows <= PACKED_COST * self.model.used.sum() * self.model.chain.links

    def _begin(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        from cablepod.galerkin import _kernels_explicit as kernel  # numba is imported only to compute

        model, damping, rate = self.model, self.damping, record.instants.steps_per_second
        step = 1.0 / rate
        decay = math.exp(-damping * step)
        kick = -math.expm1(-damping * step) / damping if damping else step
        law, (packed, linked) = self.law, self.tables
        p, account = self.p0.copy(), np.zeros(3)
        slope, _ = model.gradient(np.concatenate([self.q0, model.displacements(np.zeros(1))[0]]))
        half = damped_growth(damping, step) / damping if damping else 0.5 * step
        velocity = -half * (
            model.loads_on_steps(0, 0, rate)[0] - slope
        )  # half a step before the start, which is from rest

        def advance(begin: int, steps: int) -> bool:
            marks, saved, energy = record.rows(begin, begin + steps)
            ends = model.displacements_on_steps(max(begin - 1, 0), steps + (begin > 0), rate)
            if begin == 0:
                ends = np.concatenate([ends[:1], ends])
            kernel.verlet(
                p, velocity, account, step, decay, kick, damping, model.coupling, model.loads_on_steps(begin, steps, rate),
                ends, law, packed, linked, begin, steps, marks, saved, energy,
            )  # fmt: skip
            if not self.is_finite(p):
                return False
            record.take(begin, begin + steps, saved, energy)
            return True

        return advance, (p, velocity, account), int(record.instants.steps[-1]) + 1

    def _check(self, state: GalerkinTrajectory) -> GalerkinTrajectory:
        """Stop where the highest frequency on the way is too high for the step."""
        rate = state.instants.steps_per_second
        picked = np.unique(np.linspace(0, len(state.q) - 1, 50).astype(int))
        for i in picked:
            time = float(state.instants.times[i])
            omega = self.model.highest_frequency(state.q[i], time)
            if omega >= 2.0 * rate:
                raise RunStopped(
                    f"the reduced model stiffened: at {time:.6g} s its stability limit is {2 / omega:.6g} s, below the step "
                    f"{1 / rate:.6g} s ({self.scheme}); try a shorter step, or scheme energy_momentum",
                    self.dataset(state),
                )
        return state
