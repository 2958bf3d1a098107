"""Implicit runs of the Galerkin model: trapezoidal and energy-momentum steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cablepod.chain._implicit import MAX_ROTATION, MAX_SUBSTEPS, MIN_ROTATION, TENSION_RTOL
from cablepod.galerkin._runs import FEWER_ROWS, ROUNDING, GalerkinRun, RunRecord


@dataclass(frozen=True)
class ImplicitGalerkinRun(GalerkinRun):
    """Trapezoidal rule or energy-momentum method: second order, stable at any step as far as linear theory goes."""

    counts: list[int] = field(default_factory=lambda: [0, 0])  #: of the last run: iterations, steps cut

    @property
    def fault(self) -> str:
        """What a stopped run says."""
        return f"Newton's method did not converge, with the step cut into {MAX_SUBSTEPS},"

    other = "scheme velocity_verlet"

    @property
    def packs(self) -> bool:
        """Whether packed coefficients are the faster way."""
        return FEWER_ROWS * (len(self.model.used) + self.model.pairs[0].size) <= self.model.chain.links

    def _begin(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        model, total = self.model, int(record.instants.steps[-1])
        p = self.p0.copy()
        state = (
            p,
            np.zeros_like(p),
            np.zeros((3, p.size)),
            np.zeros(3),
        )  # with rates, mean accelerations, energy account
        tension = float(np.abs(model.tension(model.positions(self.q0[None], np.zeros(1)))).mean())
        enough = min(max(math.sqrt(2.0 * TENSION_RTOL * tension / model.chain.p.stiffness), MIN_ROTATION), MAX_ROTATION)
        rate = record.instants.steps_per_second
        self.counts[:] = [0, 0]

        def advance(begin: int, steps: int) -> bool:
            end = begin + steps + (begin + steps == total)  # a last step is saved when it is done
            rows = record.rows(begin, end)
            done = 0
            while True:
                first = int(np.searchsorted(rows[0], begin + done))
                done += self._kernel(state, enough, rate, begin + done, steps - done, *(item[first:] for item in rows))
                if done == steps:
                    break
                if not self._cut(state, enough, rate, begin + done):
                    return False
                done += 1
            if not self.is_finite(p):
                return False
            record.take(begin, end, *rows[1:])
            return True

        if total == 0:
            advance(0, 0)
        return advance, state, total

    def _cut(self, state: tuple[np.ndarray, ...], enough: float, rate: float, number: int) -> bool:
        """Take one step in pieces, so short that Newton's method converges; returns whether it did."""
        keep, pieces, nothing = [item.copy() for item in state], 2, np.zeros(0, dtype=np.int64)
        while pieces <= MAX_SUBSTEPS:
            saved = np.empty((0, 3, self.q0.size)), np.empty((0, 4))
            if self._kernel(state, enough, pieces * rate, pieces * number, pieces, nothing, *saved) == pieces:
                self.counts[1] += 1
                return True
            for target, source in zip(state, keep, strict=True):
                target[:] = source
            pieces *= 4
        return False

    def _kernel(
        self,
        state: tuple[np.ndarray, ...],
        enough: float,
        rate: float,
        start: int,
        steps: int,
        marks: np.ndarray,
        saved: np.ndarray,
        energy: np.ndarray,
    ) -> int:
        """Take steps of 1 / rate; returns how many were done."""
        from cablepod.galerkin import _kernels_energy as kernel_energy
        from cablepod.galerkin import _kernels_implicit as kernel_implicit  # numba is imported only to compute

        model, law, (packed, linked) = self.model, self.law, self.tables
        stiffness = np.ones(packed[1].size) if law == kernel_energy.PACKED else linked[4]
        done, iterations = kernel_implicit.implicit(
            *state, 1.0 / rate, self.scheme == "energy_momentum", self.damping, model.coupling,
            model.loads_on_steps(start, steps, rate), model.displacements_on_steps(start, steps, rate), law,
            np.ascontiguousarray(packed[0].T), packed[1:], linked, stiffness, model.turns, enough, ROUNDING, start, steps,
            marks, saved, energy,
        )  # fmt: skip
        self.counts[0] += iterations
        return done

    def _notes(self) -> dict[str, Any]:
        return {"newton_iterations": self.counts[0], "steps_cut": self.counts[1]}
