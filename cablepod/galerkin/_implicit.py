"""Implicit time integration of the Galerkin model: trapezoidal rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cablepod.chain._implicit import MAX_ROTATION, MIN_ROTATION, TENSION_RTOL
from cablepod.galerkin._record import RunRecord
from cablepod.galerkin._runs import MIN_ROW_RATIO, GalerkinRun
from cablepod.integrate._march import cut_step, not_converged
from cablepod.integrate._scheme import first_implicit_step


@dataclass(frozen=True)
class ImplicitGalerkinRun(GalerkinRun):
    """Trapezoidal rule: second order, unconditionally stable in linear theory."""

    counts: list[int] = field(default_factory=lambda: [0, 0])  #: Newton iterations and substepped steps of the last run

    @property
    def failure(self) -> str:
        """Reason for stopping, as stated in the message."""
        return not_converged()

    alternative = "scheme velocity_verlet"

    def unforced_step(self, limit: float) -> float:
        """Return the step of the first run without regard to motions and loads, for a stability limit of explicit steps [s]."""
        tension = self.model.tension(self.model.positions(self.q0[None], np.zeros(1))[0])
        return first_implicit_step(self.model.chain, tension, self.end_time, limit)

    @property
    def use_polynomial_form(self) -> bool:
        """Select the polynomial form of the energy if it is the faster one."""
        return MIN_ROW_RATIO * (len(self.model.active_axes) + self.model.pairs[0].size) <= self.model.chain.links

    def _stepper(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        model, total = self.model, int(record.instants.steps[-1])
        p = self.p0.copy()
        # projection z, its rates, mean accelerations of the last three steps, energy account
        state = p, np.zeros_like(p), np.zeros((3, p.size)), np.zeros(3)
        tension = float(np.abs(model.tension(model.positions(self.q0[None], np.zeros(1)))).mean())
        rotation = math.sqrt(2.0 * TENSION_RTOL * tension / model.chain.p.stiffness)
        newton_tolerance = min(max(rotation, MIN_ROTATION), MAX_ROTATION)
        steps_per_second = record.instants.steps_per_second
        self.counts[:] = [0, 0]

        def advance(begin: int, steps: int) -> bool:
            end = begin + steps + (begin + steps == total)  # the last block also saves the state after its last step
            targets = record.targets(begin, end)
            done = 0
            while True:
                first = int(np.searchsorted(targets[0], begin + done))
                rest = [array[first:] for array in targets]
                done += self._advance(state, newton_tolerance, steps_per_second, begin + done, steps - done, *rest)
                if done == steps:
                    break
                if not self._substep(state, newton_tolerance, steps_per_second, begin + done):
                    return False
                done += 1
            if not self.is_finite(p):
                return False
            record.store(begin, end, *targets[1:])
            return True

        if total == 0:
            advance(0, 0)
        return advance, state, total

    def _substep(
        self, state: tuple[np.ndarray, ...], newton_tolerance: float, steps_per_second: float, number: int
    ) -> bool:
        """Repeat one step with substeps until Newton's method converges; return whether it does."""
        no_targets = np.zeros(0, dtype=np.int64), np.empty((0, 3, self.q0.size)), np.empty((0, 4))

        def take(substeps: int) -> int:
            finer = substeps * steps_per_second
            return self._advance(state, newton_tolerance, finer, substeps * number, substeps, *no_targets)

        converged = cut_step(take, state)
        self.counts[1] += converged
        return converged

    def _advance(
        self,
        state: tuple[np.ndarray, ...],
        newton_tolerance: float,
        steps_per_second: float,
        start: int,
        steps: int,
        save_steps: np.ndarray,
        saved: np.ndarray,
        energy: np.ndarray,
    ) -> int:
        """Advance the state by up to `steps` steps from step number `start` on; return the number of completed steps."""
        from cablepod.galerkin import _kernels_energy as kernel_energy
        from cablepod.galerkin import _kernels_implicit as kernel_implicit  # numba is imported only to compute

        model, law, (polynomial_form, link_form) = self.model, self.law, self.tables
        stiffness = np.ones(polynomial_form[1].size) if law == kernel_energy.POLYNOMIAL else link_form[4]
        done, iterations = kernel_implicit.implicit(
            *state, 1.0 / steps_per_second, self.damping, model.coupling,
            model.loads_at_steps(start, steps, steps_per_second),
            model.displacements_at_steps(start, steps, steps_per_second), law, np.ascontiguousarray(polynomial_form[0].T),
            polynomial_form[1:], link_form, stiffness, model.rms_slopes, newton_tolerance, start, steps, save_steps,
            saved, energy,
        )  # fmt: skip
        self.counts[0] += iterations
        return done

    def _diagnostics(self) -> dict[str, Any]:
        return {"newton_iterations": self.counts[0], "steps_cut": self.counts[1]}
