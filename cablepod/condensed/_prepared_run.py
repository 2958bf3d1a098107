"""Repeated runs of a prepared model with other motions, loads and parameters: plain arrays in and out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.condensed import _kernels_host_layout as layout
from cablepod.condensed._fields import CondensedTrajectory, close_chord_of, positions, selected_tensions
from cablepod.condensed._host import CHORD_RANGE, chord_range_text
from cablepod.condensed._kernels_layout import MIN_FORCE, UNSTABLE_STEP, initial_monitor
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import padded
from cablepod.condensed._prepared_parameters import ChangedModel, Variant
from cablepod.condensed._runs import SCHEMES, CondensedRun, InitialState
from cablepod.condensed._simulate import check_links
from cablepod.condensed._stepper import DIVERGENCE_FACTOR
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import scene_error
from cablepod.integrate._march import BLOCK
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._request import check_outputs, check_step, check_times
from cablepod.integrate._step_control import damped_growth

OUTPUTS = ("position", "tension", "end_force")
#: Minimum number of positions of a path: second differences at both ends.
MIN_PATH = 4


class PreparedRun(NamedTuple):
    """Result of :meth:`PreparedModel.run`; None for what was not asked for."""

    time: np.ndarray  #: (time,) [s]
    amplitude: np.ndarray  #: (time, mode) [m]
    amplitude_out_of_plane: np.ndarray | None  #: the same of the second normal, in space
    end_force: np.ndarray | None  #: force of the cable on its upper support, inertia included (time, dims) [N]
    position: np.ndarray | None  #: (time, particle, dims) [m]
    tension: np.ndarray | None  #: (time, link) [N]
    smallest_chordwise_force: float  #: over all steps [N]; below zero the cable goes slack


class PreparedRunner:
    """Prepared arrays of the runs of one model.

    Parameters
    ----------
    scene, modes, model
        Scene, modes and model that were prepared.
    step
        Step of the runs [s].
    """

    def __init__(self, scene: xr.Dataset, modes: xr.Dataset, model: CondensedModel, step: float) -> None:
        self.modes, self.model, self.step = modes, model, step
        self.steps_per_second = 1.0 / step
        self.changed = ChangedModel(scene, model)
        self._instants: OutputTimes | None = None

    def run(
        self,
        parameters: Mapping[str, float] | None,
        times: Any,
        end_position: Any,
        outputs: tuple[str, ...],
        links: Any,
    ) -> PreparedRun:
        """Run the model; see :meth:`cablepod.condensed.PreparedModel.run`."""
        outputs = check_outputs(outputs, OUTPUTS)
        chosen = None if links is None else check_links(links, self.modes)
        path = None if end_position is None else self._checked_path(end_position)
        variant = self.changed.variant(parameters, path, self.step)
        if path is not None:
            self._check_chords(path, variant.model)
        instants = self._output_times(times, variant.model, path)
        if variant.model.order == "leading":
            state, rows = self._leading(variant, instants)
        else:
            state, rows = self._other(variant.model, instants)
        return self._result(variant, state, rows, outputs, chosen)

    def _output_times(self, times: Any, model: CondensedModel, path: np.ndarray | None) -> OutputTimes:
        """Place the instants of the output on the steps; those of the scene once."""
        if times is None and path is not None:
            instants = OutputTimes.of(np.arange(len(path)) * self.step, self.steps_per_second)
        elif times is None:
            if self._instants is None:
                self._instants = OutputTimes.of(model.chain.p.times(), self.steps_per_second)
            instants = self._instants
        else:
            instants = OutputTimes.of(check_times(times), self.steps_per_second)
        last = float(instants.times[-1])
        if path is None:
            model.chain.p.check_reach(last)
        elif instants.steps[-1] >= len(path) or instants.needs_interpolation:
            allowed = f"multiples of the step, {self.step:g} s, up to {(len(path) - 1) * self.step:g} s, where end_position ends"
            raise scene_error(
                "times", last if instants.steps[-1] >= len(path) else "instants between the steps", allowed
            )
        return instants

    def _checked_path(self, end_position: Any) -> np.ndarray:
        """Return given positions of the upper end as an array (steps + 1, dims) [m]."""
        dims = self.model.chain.p.dims
        try:
            path = np.array(end_position, dtype=float)
        except (TypeError, ValueError):
            raise scene_error("end_position", end_position, f"an array (steps + 1, {dims}) of numbers [m]") from None
        if path.ndim != 2 or path.shape[1] != dims or len(path) < MIN_PATH:
            raise scene_error(
                "end_position", path.shape, f"an array (steps + 1, {dims}) of at least {MIN_PATH} positions [m]"
            )
        if not np.isfinite(path).all():
            raise scene_error("end_position", float(path[~np.isfinite(path)][0]), "finite numbers [m]")
        return path

    def _check_chords(self, path: np.ndarray, model: CondensedModel) -> None:
        """Refuse ends so near to each other or so far from each other that the model no longer holds."""
        length = model.chain.total_length
        ratio = np.sqrt(np.sum((path - model.chain.p.lower) ** 2, axis=1)) / length
        outside = (ratio < CHORD_RANGE[0]) | (ratio > CHORD_RANGE[1])
        if outside.any():
            raise scene_error("end_position", path[int(outside.argmax())].tolist(), chord_range_text(length))

    def _leading(self, variant: Variant, instants: OutputTimes) -> tuple[CondensedTrajectory, np.ndarray]:
        """Run to leading order; return the trajectory, and the boundary data at the saved steps."""
        from cablepod.condensed import _kernels_leading as kernel  # numba is imported only to compute

        model, q = variant.model, variant.q.copy()
        step, r, total = self.step, q.size, int(instants.steps[-1]) + 1
        damping, coefficients = model.chain.p.mass_damping or 0.0, model.leading_coefficients
        f = np.empty(r)
        data = model.boundary_data(0, min(BLOCK, total) - 1, self.steps_per_second)
        tension = kernel.leading_force(q, data, 0, *coefficients, f, np.empty((r, r)))
        self._check_step(model.omega_max_squared(q, data[0], tension))
        rates, growth = initial_rates(variant), damped_growth(damping, step)
        v = rates * (1.0 + growth) - (growth / damping if damping else 0.5 * step) * f
        factors = math.exp(-damping * step), -math.expm1(-damping * step) / damping if damping else step
        count = instants.steps.size
        saved, half, rows = np.empty((count, r)), np.empty((count, 2, r)), np.empty((count, data.shape[1]))
        monitor, none, series = initial_monitor(4.0 / (step * step), tension), np.empty(0), np.empty((count, 0))
        links = np.empty((r, 0)), model.n_in_plane, np.empty((layout.PATTERNS, 0))
        for begin in range(0, total, BLOCK):
            steps, part = min(BLOCK, total - begin), slice(0, count)
            if total > BLOCK:
                part = slice(*np.searchsorted(instants.steps, (begin, begin + steps)).tolist())
            if begin:
                data = model.boundary_data(begin, steps - 1, self.steps_per_second)
            rows[part] = data[instants.steps[part] - begin]
            kernel.leading_verlet(
                q, v, step, *factors, data, *coefficients, model.geometric_stiffness_norms,
                model.chordwise_forces_at_candidates, *links, begin, instants.steps[part], saved[part], half[part], none,
                none, monitor, series[part],
            )  # fmt: skip
        bound = DIVERGENCE_FACTOR * math.sqrt(model.chain.p.mass * model.chain.total_length) * model.chain.total_length
        if not (monitor[UNSTABLE_STEP] == np.inf and float(np.abs(q).max()) < bound):
            self._other(model, instants)  # once more, step by step, to say when and to keep what was computed
        return CondensedTrajectory(instants, saved, half, None, monitor, SCHEMES[0]), rows

    def _other(self, model: CondensedModel, instants: OutputTimes) -> tuple[CondensedTrajectory, np.ndarray]:
        """Run as :func:`cablepod.condensed.simulate` does; result as of :meth:`_leading`."""
        q, v = model.initial()
        acceleration, _, tension = model.force(q, v, model.initial_boundary_data)
        self._check_step(model.omega_max_squared(q, model.initial_boundary_data, tension))
        start = InitialState(q, v, acceleration, tension)
        state = CondensedRun(model, instants.times, start, (), None, None, SCHEMES[0])(self.steps_per_second)
        return state, model.boundary_data_at(instants.steps * self.step)

    def _check_step(self, omega_squared: float) -> None:
        """Refuse a step above the stability limit at the start of a run."""
        if not self.step * self.step * omega_squared < 4.0:
            omega = math.sqrt(omega_squared)
            check_step(self.step, 2.0 / omega, f"2 over the highest angular frequency of this run, {omega:.6g} rad/s")

    def _result(
        self,
        variant: Variant,
        state: CondensedTrajectory,
        rows: np.ndarray,
        outputs: tuple[str, ...],
        links: np.ndarray | None,
    ) -> PreparedRun:
        """Collect the arrays of a run."""
        model, instants, q = variant.model, state.instants, state.q
        times, rank = instants.times, model.rank
        amplitudes = [
            padded(q[:, which] @ turn.T, rank) for turn, which in zip(model.spectral_basis[0], model.sets, strict=True)
        ]
        force = position = tension = None
        if "end_force" in outputs:
            if instants.needs_interpolation:
                rows = model.boundary_data_at(times)
            force = end_forces(variant, q, rows, times)
        if "position" in outputs:
            position = positions(model, q, times)
        if "tension" in outputs:
            tension = selected_tensions(model, q, times, links)
        smallest = float(state.monitor[MIN_FORCE])
        second = amplitudes[1] if len(amplitudes) > 1 else None
        return PreparedRun(times, amplitudes[0], second, force, position, tension, smallest)


def end_forces(variant: Variant, q: np.ndarray, boundary_data: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the forces of the cable on its upper support, inertia included (times, dims) [N].

    Parameters
    ----------
    variant
        Model of the run.
    q, boundary_data, times
        Coordinates (times, r) and boundary data at instants [s].
    """
    from cablepod.condensed import _kernels_end_force as kernel

    model, coefficients = variant.model, variant.coefficients
    ends = model.chain.p.end_positions(times)
    force = np.empty((times.size, model.chain.p.dims))
    if model.order == "leading":
        kernel.leading_end_forces(coefficients, np.ascontiguousarray(q), boundary_data, ends, force)
    else:
        stretch, chordwise_force, _, deflection = close_chord_of(model, q, boundary_data)
        slopes = np.diff(deflection, axis=2) / model.chain.length
        kernel.exact_end_forces(
            coefficients, np.ascontiguousarray(stretch), np.ascontiguousarray(chordwise_force), slopes, boundary_data,
            ends, force,
        )  # fmt: skip
    return force


def initial_rates(variant: Variant) -> np.ndarray:
    """Return the initial rates (r,): the particles are at rest, and the chord frame moves with the ends."""
    p, coefficients = variant.model.chain.p, variant.coefficients
    rates = np.zeros((2, p.dims))
    for (end, axis), motion in p.motions.items():
        rates[ENDS.index(end), COORDINATES.index(axis)] = motion(0.0, 1)
    result = np.zeros(variant.q.size)
    if not rates.any():
        return result
    ends = p.end_positions(np.zeros(1))
    normals = ChordFrame.of(ends[:, 1] - ends[:, 0], variant.model.reference).normals[0]
    uniform = coefficients.by_coordinate[layout.PROJECTION :: layout.PATTERNS].sum(axis=0) * p.mass
    for normal, which in zip(normals, variant.model.sets, strict=True):
        lower, upper = rates @ normal
        result[which] = -lower * uniform[which] - (upper - lower) * coefficients.by_coordinate[layout.MOMENTS, which]
    return result
