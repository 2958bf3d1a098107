"""Explicit time integration of the Galerkin model: velocity Verlet."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cablepod.errors import RunStopped
from cablepod.galerkin._runs import POLYNOMIAL_COST, GalerkinRun, GalerkinTrajectory, RunRecord
from cablepod.integrate._step_control import damped_growth


class ExplicitGalerkinRun(GalerkinRun):
    """Velocity Verlet: second order, symplectic, stable for steps below 2 over the highest angular frequency."""

    @property
    def use_polynomial_form(self) -> bool:
        """Select the polynomial form of the energy if it is the faster one."""
        monomials = len(self.model.active_axes) + self.model.pairs[0].size
        rows = min(monomials, self.model.chain.links)
        return monomials * rows <= POLYNOMIAL_COST * self.model.active_axes.sum() * self.model.chain.links

    def _stepper(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        from cablepod.galerkin import _kernels_explicit as kernel  # numba is imported only to compute

        model, damping, steps_per_second = self.model, self.damping, record.instants.steps_per_second
        step = 1.0 / steps_per_second
        damping_factor = math.exp(-damping * step)
        impulse_time = -math.expm1(-damping * step) / damping if damping else step
        law, (polynomial_form, link_form) = self.law, self.tables
        p, account = self.p0.copy(), np.zeros(3)
        gradient, _ = model.gradient(np.concatenate([self.q0, model.displacements(np.zeros(1))[0]]))
        half_step = damped_growth(damping, step) / damping if damping else 0.5 * step
        # half a step before the start, at which the cable is at rest
        velocity = -half_step * (model.loads_at_steps(0, 0, steps_per_second)[0] - gradient)

        def advance(begin: int, steps: int) -> bool:
            save_steps, saved, energy = record.targets(begin, begin + steps)
            ends = model.displacements_at_steps(max(begin - 1, 0), steps + (begin > 0), steps_per_second)
            if begin == 0:
                ends = np.concatenate([ends[:1], ends])
            kernel.verlet(
                p, velocity, account, step, damping_factor, impulse_time, damping, model.coupling,
                model.loads_at_steps(begin, steps, steps_per_second), ends, law, polynomial_form, link_form, begin, steps,
                save_steps, saved, energy,
            )  # fmt: skip
            if not self.is_finite(p):
                return False
            record.store(begin, begin + steps, saved, energy)
            return True

        return advance, (p, velocity, account), int(record.instants.steps[-1]) + 1

    def _check(self, trajectory: GalerkinTrajectory) -> GalerkinTrajectory:
        """Raise RunStopped if the step exceeds the stability limit at up to 50 output instants."""
        steps_per_second = trajectory.instants.steps_per_second
        checked = np.unique(np.linspace(0, len(trajectory.q) - 1, 50).astype(int))
        displacements = self.model.displacements(trajectory.instants.times[checked])
        for i, displacement in zip(checked, displacements, strict=True):
            time = float(trajectory.instants.times[i])
            omega = self.model.highest_frequency(trajectory.q[i], displacement)
            if omega >= 2.0 * steps_per_second:
                raise RunStopped(
                    f"the reduced model stiffened: at {time:.6g} s its stability limit is {2 / omega:.6g} s, below the step "
                    f"{1 / steps_per_second:.6g} s ({self.scheme}); try a shorter step, or scheme energy_momentum",
                    self.dataset(trajectory),
                )
        return trajectory
