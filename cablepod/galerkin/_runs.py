"""Time integration of the Galerkin model, common to all schemes: blocks of steps, failures, labelled output."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, ENDS, labelled_dataset
from cablepod.discretisation._chain import LumpedChain
from cablepod.galerkin._model import GalerkinModel
from cablepod.galerkin._record import GalerkinTrajectory, RunRecord
from cablepod.integrate._comparison import ComparableRuns
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._means import wants_means
from cablepod.integrate._output import (
    is_over_links,
    mean_variables,
    middles_of,
    peak_variables,
    trajectory_attributes,
    trajectory_variables,
)
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._run import Run
from cablepod.integrate._window import window_attributes
from cablepod.pod._project import numbers_of

#: Cost of the polynomial form, monomials x rows, relative to the link form, coordinates x axes x links (explicit steps take the
#: cheaper one); and minimum ratio of links to rows for the polynomial form in implicit steps, whose tangent costs modes^2 x rows.
#: Both as measured for 2 to 48 amplitudes and 20 to 320 links.
POLYNOMIAL_COST, MIN_ROW_RATIO = 1.0, 2.0


@dataclass(frozen=True)
class GalerkinRun(Run):
    """Galerkin model of a scene with one scheme, callable with the number of steps per second."""

    model: GalerkinModel
    q0: np.ndarray  #: mass-orthonormal amplitudes at the start (modes,) [kg^1/2 m]
    scene: xr.Dataset
    modes: xr.Dataset
    scheme: str
    #: Steps between samples for the error estimate, by steps per second
    sample_interval: Callable[[float], int] = lambda _: 0
    sampled: bool = False  #: whether runs have samples

    @property
    def cells(self) -> LumpedChain:
        """Discretisation of the cable in space."""
        return self.model.chain

    def __call__(self, steps_per_second: float, *, sampled: bool | None = None) -> GalerkinTrajectory:
        """Integrate the equations of motion with a given number of steps per second.

        `sampled` overrides the attribute; a run with False, which only serves to be compared with a finer one, is not checked.
        """
        instants = self.instants(steps_per_second)
        interval = self.sample_interval(steps_per_second) if sampled or (sampled is None and self.sampled) else 0
        record = RunRecord(self, instants, interval)
        advance, state, total = self._stepper(record)
        failed_step = advance_in_blocks(advance, state, total, self.progress)
        diagnostics = self._diagnostics()
        if failed_step is not None:
            self._stop(record, failed_step, diagnostics)
        trajectory = GalerkinTrajectory(record, instants, diagnostics)
        return trajectory if sampled is False else self._check(trajectory)

    def _stepper(self, record: RunRecord) -> tuple[Callable[[int, int], bool], tuple[np.ndarray, ...], int]:
        """Return the function that advances the state by a block of steps, the state, and the number of steps."""
        raise NotImplementedError

    def _diagnostics(self) -> dict[str, Any]:
        """Return attributes of the last run."""
        return {}

    def _check(self, trajectory: GalerkinTrajectory) -> GalerkinTrajectory:
        """Return a valid trajectory; a scheme raises RunStopped for an invalid one."""
        return trajectory

    def second_derivatives(self, differences: np.ndarray, step: float) -> np.ndarray:
        """Return second time derivatives from the differences that a scheme saves (saves, modes)."""
        return differences

    def compared(self, state: GalerkinTrajectory) -> np.ndarray:
        """Return positions of one particle, whose distances are rms distances of all (times, 1, coordinates) [m]."""
        return state.rms_displacements[:, None]

    def motion(self, state: GalerkinTrajectory) -> float:
        """Return the largest rms displacement, or the chord if nothing moves [m]."""
        return state.motion

    def has_kinks(self, state: GalerkinTrajectory) -> bool:
        """Whether links go slack, which are kinks of the linear law only."""
        model = self.model
        return not model.chain.green and bool(
            (model.chain.stretch(model.positions(state.q, state.instants.times)) < 1.0).any()
        )

    def unforced_step(self, limit: float) -> float:
        """Return the step of the first run without regard to motions and loads, for a stability limit of explicit steps [s]."""
        raise NotImplementedError

    def comparable_runs(self, limit: float) -> ComparableRuns:
        """Describe runs with any step for the step control."""
        return self.comparable(self.unforced_step(limit))

    @cached_property
    def displacements(self) -> np.ndarray:
        """Displacements of the moving ends at the output instants (times, moving) [m]."""
        return self.model.displacements(self.times)

    @cached_property
    def p0(self) -> np.ndarray:
        """Projection z = q + C^T d at the start (modes,) [kg^1/2 m]."""
        return self.q0 + self.model.initial_displacements @ self.model.coupling

    @property
    def damping(self) -> float:
        """Damping per mass [1/s]."""
        return self.model.chain.p.mass_damping or 0.0

    @property
    def use_polynomial_form(self) -> bool:
        """Select the polynomial form of the energy if it is the faster one."""
        raise NotImplementedError

    @cached_property
    def law(self) -> int:
        """Form in which the kernels evaluate the energy, a constant of ``_kernels_energy``."""
        from cablepod.galerkin import _kernels_energy as kernel  # numba is imported only to compute

        if not self.model.chain.green:
            return kernel.LINEAR_LINKS
        return kernel.POLYNOMIAL if self.use_polynomial_form else kernel.GREEN_LINKS

    @cached_property
    def tables(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Coefficients of the polynomial form and of the link form; those not needed are empty."""
        model = self.model
        no_pairs = np.zeros(0, dtype=np.uint64)
        count, dims = len(model.modes) + len(model.moving), model.chain.p.dims
        if self.law == 0:
            unused = np.zeros((dims, 0)), np.zeros(0), np.zeros((count, dims, 0)), model.active_axes, np.zeros(0)
            factor, offset, *pairs = model.polynomial_form
            # an index without a sign is not tested for counting from the end
            return (factor, offset, *(part.astype(np.uint64) for part in pairs)), unused
        return (np.zeros((0, 0)), np.zeros(0), no_pairs, no_pairs), model.link_form

    @cached_property
    def divergence_bound(self) -> float:
        """Amplitude above which a run counts as divergent [kg^1/2 m]."""
        model = self.model
        return 1e6 * math.sqrt(model.mass.sum()) * (model.chain.total_length + float(np.abs(model.shape).max()))

    def is_finite(self, p: np.ndarray) -> bool:
        """Check that all amplitudes are finite and below the divergence bound."""
        return bool(np.isfinite(p).all() and np.abs(p).max() < self.divergence_bound)

    @cached_property
    def initial_energy(self) -> float:
        """Strain energy at the start [J]."""
        from cablepod.galerkin import _kernels_energy as kernel

        polynomial_form, link_form = self.tables
        y = np.concatenate([self.q0, self.model.initial_displacements])
        gradient, links = np.zeros(y.size), link_form[1].size
        if self.law == kernel.POLYNOMIAL:
            return kernel.polynomial_energy(y, *polynomial_form, np.zeros(polynomial_form[0].shape[1]))
        slopes, e, s = np.zeros_like(link_form[0]), np.zeros(links), np.zeros(links)
        return kernel.link_gradient(y, self.law, *link_form, slopes, e, s, gradient)

    def _stop(self, record: RunRecord, failed_step: int, diagnostics: dict[str, Any]) -> None:
        """Raise RunStopped with the output before the failed step."""
        instants = OutputTimes.of(self.times, record.instants.steps_per_second)
        steps_per_second = instants.steps_per_second
        time, completed, partial = failed_step / steps_per_second, instants.before_step(failed_step), None
        # the state at the failed step is finite, but the second rate of an explicit step may not be
        if completed is not None:
            record.extremes = None
            partial = self.dataset(GalerkinTrajectory(record, completed, diagnostics))
        self.stop(
            partial,
            time,
            f"{self.failure} at {time:.6g} s ({self.scheme}, step {1 / steps_per_second:.4g} s, step number {failed_step}); "
            f"try a shorter step, {self.alternative}, more modes, or the chain itself",
        )

    @property
    def failure(self) -> str:
        """Reason for stopping, as stated in the message."""
        return "the reduced model left the finite numbers"

    #: Scheme to try instead, as stated in the message.
    alternative = "scheme trapezoidal"

    def dataset(self, trajectory: GalerkinTrajectory) -> xr.Dataset:
        """Convert a trajectory to a labelled Dataset."""
        model, time = self.model, trajectory.instants.times
        amplitude = trajectory.q @ model.amplitudes_of_orthonormal
        lead: tuple[str, ...] = ()
        count = len(model.modes)
        if model.layout == "separate":
            lead, count = ("coordinate",), count // model.chain.p.dims
        dims = ("time", *lead, "mode")
        variables: dict[str, Any] = {
            "amplitude": (dims, amplitude.reshape(time.size, *[-1] * len(lead), count)),
            "end_position": (("time", "end", "coordinate"), model.chain.p.end_positions(time)),
            "unstretched_length": ((), model.chain.total_length),
        }
        # always computed, because the minimum stretch shows whether the cable went slack
        position = model.positions(trajectory.q, time)
        values = {
            "position": lambda: position,
            "tension": lambda: model.tension(position),
            "velocity": lambda: model.velocities(trajectory.rates, time),
        }
        variables |= trajectory_variables(self.outputs, trajectory.extremes, values)
        if wants_means(self.outputs) and trajectory.instants.times.size == self.times.size:
            variables |= mean_variables(self.outputs, trajectory.means)
        if trajectory.extremes is not None:
            (_, least), (_, largest) = trajectory.record.peaks
            variables |= peak_variables(trajectory.extremes, (least, largest), middles_of(model.chain.arc_length))
        labels = {
            "coordinate": np.array(COORDINATES[: model.chain.p.dims]),
            "time": time,
            "mode": numbers_of(self.modes, count),
            "end": np.array(ENDS),
        }
        options = {"law": model.chain.law, "rank": count, "layout": model.layout}
        places: dict[str, Any] = {"arc_length": (("particle",), model.chain.arc_length)}
        if is_over_links(variables):
            places["link_arc_length"] = (("link",), middles_of(model.chain.arc_length))
        result = labelled_dataset(variables, labels, places)
        stretch = model.chain.stretch(position)
        result.attrs = {
            "smallest_stretch": float(stretch.min()),
            "largest_stretch": float(stretch.max()),
            "title": f"{self.scene.attrs.get('title', 'scene')}: Galerkin model, r = {count}, {model.chain.law} law",
            **trajectory_attributes("Galerkin", self.scheme, trajectory.instants, **options),
            "energy_defect": trajectory.energy_defect,
            **model.chain.p.offsets(),
            **window_attributes(self.window),
            **trajectory.diagnostics,
        }
        return result
