"""Repeated runs of a prepared model with other motions, loads and parameters: plain arrays in and out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.condensed import _kernels_host_layout as layout
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._air_motion import DragOfMotion
from cablepod.condensed._fields import (
    ClosedChord,
    CondensedTrajectory,
    boundary_data_of,
    close_chord_of,
    link_tensions,
    positions_of,
    selected_tensions,
)
from cablepod.condensed._host import CHORD_RANGE, CHORD_TURN_TEXT, chord_range_text
from cablepod.condensed._kernels_layout import MIN_FORCE, MIN_FORCE_STEP, UNSTABLE_STEP, initial_monitor
from cablepod.condensed._model import CondensedModel, end_tables
from cablepod.condensed._output import padded
from cablepod.condensed._prepared_parameters import ChangedModel, Variant
from cablepod.condensed._runs import SCHEMES, CondensedRun, initial_state
from cablepod.condensed._simulate import check_links
from cablepod.condensed._stepper import DIVERGENCE_FACTOR
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.errors import scene_error
from cablepod.integrate._march import BLOCK
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._particle_air import OF_DRAG
from cablepod.integrate._request import check_outputs, check_resolved, check_step, check_times
from cablepod.integrate._step_control import damped_growth
from cablepod.parameters._parameters import Parameters
from cablepod.reduced._validity import CHECKS, check_forcing, forcing_attributes
from cablepod.wind._air import CableAir, air_of

OUTPUTS = ("position", "tension", "end_force")
#: Parameters that fix the air along the cable beside the tables of the wind.
FIXING_AIR = (
    "stiffness", "weight", "mass", "load", "length_value", "lower", "upper", "initial_ends", "diameter", "drag_coefficient",
)  # fmt: skip
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
    wind
        Field of the wind in place of that of the scene; None without.
    """

    def __init__(
        self,
        scene: xr.Dataset,
        modes: xr.Dataset,
        model: CondensedModel,
        step: float,
        wind: xr.Dataset | None = None,
    ) -> None:
        self.modes, self.model, self.step, self.wind = modes, model, step, wind
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
            self._check_chords(path, variant)
        instants = self._output_times(times, variant.p, path)
        cable_air, force = self._cable_air(variant.p, float(instants.times[-1])), None
        air = None if cable_air is None else self._air(variant.model, cable_air, instants, path)
        if self.model.order == "leading" and air is None:
            state, force = self._leading(variant, instants, "end_force" in outputs)
        else:
            state = self._other(variant.model, instants, air)
        self._warn(variant, state)
        return self._result(variant, state, force, outputs, chosen, air)

    def _cable_air(self, p: Parameters, end_time: float) -> CableAir | None:
        """Return the air along the cable; that of the prepared scene, which is kept, unless what fixes it has changed."""
        if p.wind is None and self.wind is None:
            return None
        base = self.model.chain.p
        same = all(np.array_equal(getattr(p, name), getattr(base, name)) for name in FIXING_AIR)
        is_kept = same and p.wind is base.wind and p.turbulence is base.turbulence
        return air_of(base if is_kept else p, end_time, self.wind)

    def _air(
        self, model: CondensedModel, air: CableAir, instants: OutputTimes, path: np.ndarray | None
    ) -> CondensedAir:
        """Return the air along the cable; with a given path of the end it is sampled at every step."""
        longest = math.inf if path is None else self.step
        return CondensedAir(model, air, float(instants.times[-1]), longest_interval=longest)

    def _warn(self, variant: Variant, state: CondensedTrajectory) -> None:
        """Warn of a cable that goes slack, of motions that the step does not resolve, and of waves along the cable."""
        p, monitor = variant.p, state.monitor
        smallest, scale = float(monitor[MIN_FORCE]), p.shortest_time_scale
        if smallest < 0.0:
            CHECKS["smallest_chordwise_force"][-1](
                {
                    "smallest_chordwise_force": smallest,
                    "time_of_smallest_force": float(monitor[MIN_FORCE_STEP]) * self.step,
                    "scheme": SCHEMES[0],
                }
            )
        if scale < math.inf:
            check_resolved(self.step, scale)
            check_forcing(
                forcing_attributes(p, float(variant.coefficients.numbers[layout.LENGTH])),
                "the condensed model lacks",
            )

    def _output_times(self, times: Any, p: Parameters, path: np.ndarray | None) -> OutputTimes:
        """Place the instants of the output on the steps; those of the scene once."""
        if times is None and path is not None:
            instants = OutputTimes.of(np.arange(len(path)) * self.step, self.steps_per_second)
        elif times is None:
            if self._instants is None:
                self._instants = OutputTimes.of(p.times(), self.steps_per_second)
            instants = self._instants
        else:
            instants = OutputTimes.of(check_times(times), self.steps_per_second)
        last = float(instants.times[-1])
        if path is None:
            if self.changed.has_records:
                p.check_reach(last)
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
            path = np.array(end_position)
            path = np.array(path, dtype=float) if path.dtype.kind in "fiu" else np.array("", dtype=float)
        except (TypeError, ValueError):
            raise scene_error("end_position", end_position, f"an array (steps + 1, {dims}) of numbers [m]") from None
        if path.ndim != 2 or path.shape[1] != dims or len(path) < MIN_PATH:
            raise scene_error(
                "end_position", path.shape, f"an array (steps + 1, {dims}) of at least {MIN_PATH} positions [m]"
            )
        if not np.isfinite(path).all():
            raise scene_error("end_position", float(path[~np.isfinite(path)][0]), "finite numbers [m]")
        return path

    def _check_chords(self, path: np.ndarray, variant: Variant) -> None:
        """Refuse ends so near to each other or so far from each other that the model no longer holds."""
        length = float(variant.coefficients.numbers[layout.LENGTH])
        chords = path - variant.p.lower
        ratio = np.sqrt(np.sum(chords**2, axis=1)) / length
        outside = (ratio < CHORD_RANGE[0]) | (ratio > CHORD_RANGE[1])
        if outside.any():
            raise scene_error("end_position", path[int(outside.argmax())].tolist(), chord_range_text(length))
        reversed_chords = np.einsum("kd,kd->k", chords[1:], chords[:-1]) < 0.0
        if reversed_chords.any():
            raise scene_error("end_position", path[1 + int(reversed_chords.argmax())].tolist(), CHORD_TURN_TEXT)

    def _leading(
        self, variant: Variant, instants: OutputTimes, with_force: bool
    ) -> tuple[CondensedTrajectory, np.ndarray | None]:
        """Run to leading order; return the trajectory, and the end forces at the saved steps (steps, dims) [N]."""
        from cablepod.condensed import _kernels_prepared_run as kernel  # numba is imported only to compute

        p, q, step, total = variant.p, variant.q.copy(), self.step, int(instants.steps[-1]) + 1
        r, count, damping = q.size, instants.steps.size, p.mass_damping or 0.0
        v, rates = np.empty(r), initial_rates(variant)
        saved, half = np.empty((count, r)), np.empty((count, 2, r))
        saved_ends, force = np.empty((count, 2, p.dims)), np.empty((count if with_force else 0, p.dims))
        monitor = initial_monitor(4.0 / (step * step), 0.0)
        part = slice(0, count)
        for begin in range(0, total, BLOCK):
            steps = min(BLOCK, total - begin)
            if total > BLOCK:
                part = slice(*np.searchsorted(instants.steps, (begin, begin + steps)).tolist())
            kernel.leading_run(
                variant.coefficients, q, v, rates, step, damping_factors(damping, step),
                *end_tables(p, begin, steps - 1, self.steps_per_second), begin, instants.steps[part], saved[part],
                half[part], saved_ends[part], force[part], monitor,
            )  # fmt: skip
        length = float(variant.coefficients.numbers[layout.LENGTH])
        if not (
            monitor[UNSTABLE_STEP] == np.inf
            and np.abs(q).max() < DIVERGENCE_FACTOR * math.sqrt(p.mass * length) * length
        ):
            self._other(variant.model, instants)  # once more, step by step, to say when and to keep what was computed
        return CondensedTrajectory(instants, saved, half, None, monitor, SCHEMES[0]), force if with_force else None

    def _other(
        self, model: CondensedModel, instants: OutputTimes, air: CondensedAir | None = None
    ) -> CondensedTrajectory:
        """Run as :func:`cablepod.condensed.simulate` does."""
        start = initial_state(model, air)
        self._check_step(model.omega_max_squared(start.q, model.initial_boundary_data, start.chord_tension))
        if air is not None:
            check_step(self.step, air.step_limit, OF_DRAG)
        run = CondensedRun(model, instants.times, start, (), None, None, SCHEMES[0], air=air)
        return run(self.steps_per_second)

    def _check_step(self, omega_squared: float) -> None:
        """Refuse a step above the stability limit at the start of a run."""
        if not self.step * self.step * omega_squared < 4.0:
            omega = math.sqrt(omega_squared)
            check_step(self.step, 2.0 / omega, f"2 over the highest angular frequency of this run, {omega:.6g} rad/s")

    def _result(
        self,
        variant: Variant,
        state: CondensedTrajectory,
        force: np.ndarray | None,
        outputs: tuple[str, ...],
        links: np.ndarray | None,
        air: CondensedAir | None,
    ) -> PreparedRun:
        """Collect the arrays of a run."""
        instants, q, times = state.instants, state.q, state.instants.times
        amplitudes = [
            padded((q[:, which] @ turn.T) * variant.shape, self.model.rank)
            for turn, which in zip(self.changed.bases, self.model.sets, strict=True)
        ]
        position = tension = None
        if "end_force" in outputs and (force is None or instants.needs_interpolation):
            force = end_forces(variant, q, times, state.closed)
            if air is not None:
                force += end_forces_by_drag(variant, air, times, q, state.rates)
        if "position" in outputs:
            ends = variant.p.end_positions(times)
            data = boundary_data_of(variant.model, state, ends)
            closed = close_chord_of(variant.model, q, data) if state.closed is None else state.closed
            position = positions_of(variant.model, closed[0], closed[3], ends)
        if "tension" in outputs:
            tension = (
                selected_tensions(variant.model, q, times, links)
                if state.closed is None
                else link_tensions(variant.model, *state.closed[:3])[:, slice(None) if links is None else links]
            )
        smallest = float(state.monitor[MIN_FORCE])
        second = amplitudes[1] if len(amplitudes) > 1 else None
        return PreparedRun(times, amplitudes[0], second, force, position, tension, smallest)


def damping_factors(damping: float, step: float) -> tuple[float, float, float, float]:
    """Return factors of the rates over a step and over half a step back, and rates gained for unit acceleration [s]."""
    if not damping:
        return 1.0, 1.0, step, 0.5 * step
    growth = damped_growth(damping, step)
    return math.exp(-damping * step), 1.0 + growth, -math.expm1(-damping * step) / damping, growth / damping


def end_forces(variant: Variant, q: np.ndarray, times: np.ndarray, closed: ClosedChord | None = None) -> np.ndarray:
    """Return the forces of the cable on its upper support, inertia included (times, dims) [N].

    Parameters
    ----------
    variant, q
        Model of the run, coordinates (times, r).
    times
        Instants [s].
    closed
        Closed chords at these, see :func:`close_chord_of`; computed if None.
    """
    from cablepod.condensed import _kernels_end_force as kernel

    model, coefficients = variant.model, variant.coefficients
    ends, boundary_data = variant.p.end_positions(times), model.boundary_data_at(times)
    force = np.empty((len(q), variant.p.dims))
    if model.order == "leading":
        kernel.leading_end_forces(coefficients, np.ascontiguousarray(q), boundary_data, ends, force)
    else:
        closed = close_chord_of(model, q, boundary_data) if closed is None else closed
        stretch, chordwise_force, _, deflection = closed
        slopes = np.diff(deflection, axis=2) / model.chain.length
        kernel.exact_end_forces(
            coefficients, np.ascontiguousarray(stretch), np.ascontiguousarray(chordwise_force), slopes, boundary_data,
            ends, force,
        )  # fmt: skip
    return force


def end_forces_by_drag(
    variant: Variant, air: CondensedAir, times: np.ndarray, q: np.ndarray, rates: np.ndarray
) -> np.ndarray:
    """Return the part of the drag in the forces on the upper support (times, dims) [N], from its moments and accelerations."""
    model, coefficients, ends = variant.model, variant.coefficients, variant.p.end_positions(times)
    chord = ends[:, 1] - ends[:, 0]
    drag = DragOfMotion.of(air, times, q, rates, np.sqrt(np.sum(chord**2, axis=1)) / model.chain.total_length)
    accelerations = drag.on(air.shapes[0], model.n_in_plane) * coefficients.by_coordinate[layout.MOMENTS]
    transverse = drag.moments - np.stack([accelerations[:, which].sum(axis=1) for which in model.sets], axis=1)
    return np.einsum("tk,tkc->tc", transverse, ChordFrame.of(chord, model.reference).normals)


def initial_rates(variant: Variant) -> np.ndarray:
    """Return the initial rates (r,): the particles are at rest, and the chord frame moves with the ends."""
    p, coefficients, dims = variant.p, variant.coefficients, variant.p.dims
    rates = [0.0] * (2 * dims)
    for (end, axis), motion in p.motions.items():
        if motion.kind != "one_minus_cosine":
            rates[ENDS.index(end) * dims + COORDINATES.index(axis)] = float(motion(0.0, 1))
    result = np.zeros(variant.q.size)
    if not any(rates):
        return result
    ends = p.end_positions(np.zeros(1))
    normals = ChordFrame.of(ends[:, 1] - ends[:, 0], int(coefficients.sizes[layout.REFERENCE])).normals[0]
    uniform = coefficients.by_coordinate[layout.PROJECTION :: layout.PATTERNS].sum(axis=0) * p.mass
    n_in_plane = coefficients.sizes[layout.IN_PLANE]
    sets = (slice(0, n_in_plane), slice(n_in_plane, None))[: dims - 1]
    for normal, which in zip(normals, sets, strict=True):
        lower, upper = np.reshape(rates, (2, dims)) @ normal
        result[which] = -lower * uniform[which] - (upper - lower) * coefficients.by_coordinate[layout.MOMENTS, which]
    return result
