"""Explicit time integration of the Galerkin model: velocity Verlet, plain or with filtered accelerations."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cablepod.discretisation._mass_damping import decay_and_impulse, half_step_back
from cablepod.errors import RunStopped
from cablepod.galerkin._model import GalerkinModel
from cablepod.galerkin._record import GalerkinTrajectory, RunRecord
from cablepod.galerkin._runs import POLYNOMIAL_COST, GalerkinRun
from cablepod.integrate._output_times import distinct

#: Phase up to which a vibration has its exact frequency in steps of the filtered scheme [rad].
FITTED_PHASE = 1.0
#: Squared frequency times squared step to which stiffer vibrations are slowed; 4 is the stability limit, and the rest is
#: left for the change of the stiffness during the run.
SLOWED = 3.0
#: First step of the filtered scheme times the lowest angular frequency about the mean state, for one mode of each coordinate
#: (inverse to the root of their number: more modes are resolved less well, and stiffen more often beyond a longer step).
FIRST_PHASE = 0.5
#: Number of filters that are kept between calls.
KEPT_FILTERS = 64


class StepFilter(NamedTuple):
    """Factor of the accelerations of velocity Verlet, S = B B^T, diagonal in small vibrations about a state.

    Velocity Verlet with S (F - dV/dq) has the modified mass matrix S^-1, so it stays symplectic, and equilibria do not change.
    On vibrations of phase x = omega h the factor is (2 - 2 cos x) / x^2 up to FITTED_PHASE, with which the scheme has their exact
    frequency (Gautschi 1961; Hairer, Lubich and Wanner, chapter XIII), and at most SLOWED / x^2, with which no step exceeds the
    stability limit.
    """

    factor: np.ndarray  #: S (modes, modes)
    root: np.ndarray  #: B (modes, modes)
    derivative: np.ndarray  #: second time derivatives of the motion from its second differences (modes, modes)

    @classmethod
    def of(cls, squared_frequencies: np.ndarray, shapes: np.ndarray, step: float) -> StepFilter:
        """Make the filter for a step [s] from vibrations, see :meth:`GalerkinModel.vibrations`."""
        squared_phase = np.maximum(squared_frequencies, 0.0) * step * step
        fitted = np.sqrt(np.clip(squared_phase, 1e-8, FITTED_PHASE**2))
        fit = (2.0 * np.sin(0.5 * fitted) / fitted) ** 2
        root = shapes * np.sqrt(np.minimum(fit, SLOWED / np.maximum(squared_phase, 1e-300)))
        resolved = np.where(squared_phase < FITTED_PHASE**2, 1.0 / fit, 1.0)
        return cls(root @ root.T, root, (shapes * resolved) @ shapes.T)


@lru_cache(KEPT_FILTERS)
def _filter_of(model: GalerkinModel, end_time: float, step: float) -> StepFilter:
    """Return the filter of a model, about its mean state until `end_time` [s], for a step [s]; kept as long as the model is."""
    return StepFilter.of(*model.mean_vibrations(end_time), step)


class ExplicitGalerkinRun(GalerkinRun):
    """Velocity Verlet: second order, symplectic, stable for steps below 2 over the highest angular frequency.

    As "filtered_verlet" it slows the vibrations that its step does not resolve, see :class:`StepFilter`.
    """

    def filter(self, step: float) -> StepFilter | None:
        """Filter for a step [s]; None for plain velocity Verlet."""
        if self.scheme != "filtered_verlet":
            return None
        return _filter_of(self.model, self.end_time, step)

    def unforced_step(self, limit: float) -> float:
        """Return the step of the first run without regard to motions and loads, for a stability limit of explicit steps [s]."""
        if self.scheme != "filtered_verlet":
            return 0.8 * limit
        squared = self.model.mean_vibrations(self.end_time)[0]
        lowest = math.sqrt(squared[squared > 0.0].min(initial=4.0 / limit**2))
        return max(FIRST_PHASE / (lowest * math.sqrt(self.model.modes_per_coordinate)), 0.8 * limit)

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
        damping_factor, impulse_time = decay_and_impulse(damping, step)
        law, (polynomial_form, link_form) = self.law, self.tables
        gram, linear = model.gram_form if law == 0 else (np.zeros((0, 0)), np.zeros(0))
        filtered = None if (step_filter := self.filter(step)) is None else step_filter.factor
        p, account = self.p0.copy(), np.zeros(3)
        # half a step before the start, at which the cable is at rest
        if self.q0 is model.initial:
            gradient = model.initial_gradient
        else:
            gradient = model.gradient(np.concatenate([self.q0, model.initial_displacements]))[0]
        force = model.loads_at_steps(0, 0, steps_per_second)[0] - gradient
        velocity = half_step_back(damping, step)[1] * (force if filtered is None else filtered @ force)

        def advance(begin: int, steps: int) -> bool:
            save_steps, saved, energy = record.targets(begin, begin + steps)
            ends = model.displacements_at_steps(max(begin - 1, 0), steps + (begin > 0), steps_per_second)
            if begin == 0:
                ends = np.concatenate([ends[:1], ends])
            kernel.verlet(
                p, velocity, account, step, damping_factor, impulse_time, damping, filtered, model.coupling,
                model.loads_at_steps(begin, steps, steps_per_second), ends, law, polynomial_form, gram, linear, link_form,
                begin, steps, save_steps, record.is_output(save_steps), saved, energy,
            )  # fmt: skip
            if not self.is_finite(p):
                return False
            record.store(begin, begin + steps, saved, energy)
            return True

        return advance, (p, velocity, account), int(record.instants.steps[-1]) + 1

    def second_derivatives(self, differences: np.ndarray, step: float) -> np.ndarray:
        step_filter = self.filter(step)
        return differences if step_filter is None else differences @ step_filter.derivative

    def _check(self, trajectory: GalerkinTrajectory) -> GalerkinTrajectory:
        """Raise RunStopped if the step exceeds the stability limit at up to 50 output instants."""
        steps_per_second = trajectory.instants.steps_per_second
        checked = distinct(np.linspace(0, len(trajectory.q) - 1, 50).astype(int))
        times = trajectory.instants.times[checked]
        state = np.concatenate([trajectory.q[checked], trajectory.displacements[checked]], axis=1)
        hessians = self.model.gradients(state)[1]
        if (step_filter := self.filter(1.0 / steps_per_second)) is not None:
            hessians = step_filter.root.T @ hessians @ step_filter.root
        if np.abs(hessians).sum(axis=2).max() < 4.0 * steps_per_second**2:  # a bound of all frequencies
            return trajectory
        highest = np.sqrt(np.maximum(np.linalg.eigvalsh(hessians)[:, -1], 0.0))
        unstable = np.flatnonzero(highest >= 2.0 * steps_per_second)
        if unstable.size:
            first = unstable[0]
            raise RunStopped(
                f"the reduced model stiffened: at {times[first]:.6g} s its stability limit is {2 / highest[first]:.6g} s, below "
                f"the step {1 / steps_per_second:.6g} s ({self.scheme}); try a shorter step, or scheme trapezoidal",
                self.dataset(self.at_output_times(trajectory)),
            )
        return trajectory
