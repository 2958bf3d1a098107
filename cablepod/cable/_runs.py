"""Time integration of the continuous cable: the runs of the chain, with spectral elements instead of links."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.cable._air import MeshAir
from cablepod.cable._equilibrium import tangent_stiffness
from cablepod.cable._kernels_arguments import (
    NOTHING,
    Air,
    Attached,
    ExplicitState,
    Newton,
    Nodes,
    NodesInStep,
    Record,
    State,
    Tables,
    Work,
)
from cablepod.cable._mesh import SpectralMesh, rate_dampings
from cablepod.cable._start import start
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.chain._implicit import ImplicitChainRun, ImplicitStepper
from cablepod.chain._lanes import ROUNDING
from cablepod.discretisation._mass_damping import decay_and_impulse, half_step_back
from cablepod.discretisation._modal_damping import NodalDamping
from cablepod.integrate._chain_run import Trajectory
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output import Extremes, law_suffix, time_scale_attributes, trajectory_attributes
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._window import window_attributes

SCHEMES = ("velocity_verlet", "trapezoidal")
#: Remedy for a violated energy balance, as stated in the message.
REMEDY = "a step half as long, or other elements"
#: Relative tolerance of Newton's method: correction of the nodes over their mean distance.
NEWTON_RTOL = 1e-9
#: Initial slack record: first step with a stretch below 1 and its point, step and point of the minimum, minimum of the square.
NO_SLACK = (-1.0, -1.0, -1.0, -1.0, 1.0)


def with_slack(state: Trajectory, mesh: SpectralMesh, slack: np.ndarray) -> Trajectory:
    """Add time and arc length of the first and the smallest stretch below 1, over all steps, to the attributes of a run."""
    arc_length, steps_per_second = mesh.point_arc_length, state.instants.steps_per_second
    if slack[0] >= 0.0:
        state.diagnostics |= {
            "first_slack_time": float(slack[0]) / steps_per_second,
            "first_slack_arc_length": float(arc_length[int(slack[1])]),
            "smallest_stretch": math.sqrt(float(slack[4])),
            "smallest_stretch_time": float(slack[2]) / steps_per_second,
            "smallest_stretch_arc_length": float(arc_length[int(slack[3])]),
        }
    return state


def _attributes(run: CableRun, state: Trajectory) -> dict[str, Any]:
    """Return the attributes of the result."""
    mesh = run.chain
    stretch = mesh.stretch(state.position)
    instant, point = np.unravel_index(int(stretch.argmin()), stretch.shape)
    return {
        "title": f"{run.title}: continuous cable{law_suffix(mesh)}",
        **trajectory_attributes("continuous cable", run.scheme, state.instants, law=mesh.law),
        "elements": mesh.sizes.size,
        "element_order": mesh.order,
        "highest_angular_frequency": mesh.highest_frequency(mesh.tangent_stiffness_ratio(run.initial)),
        "smallest_stretch": float(stretch[instant, point]),
        "smallest_stretch_time": float(state.instants.times[instant]),
        "smallest_stretch_arc_length": float(mesh.point_arc_length[point]),
        **state.diagnostics,
        **time_scale_attributes(mesh.p),
        **mesh.p.offsets(),
        **window_attributes(run.window),
    }


class ExplicitCableRun(ExplicitChainRun):
    """Velocity Verlet: second order, symplectic without damping, stable below 2 over the highest angular frequency."""

    chain: SpectralMesh
    air: MeshAir | None
    remedy = REMEDY
    attributes = _attributes

    def __call__(self, steps_per_second: float) -> Trajectory:
        """Integrate the equations of motion with a given number of steps per second."""
        from cablepod.cable import _kernels_explicit as kernel  # numba is imported only to compute

        mesh, p, free = self.chain, self.chain.p, self.chain.free_particles
        instants = self.instants(steps_per_second)
        total = int(instants.steps[-1]) + 1
        step = 1.0 / steps_per_second
        damping_factor, impulse = decay_and_impulse(p.mass_damping or 0.0, step)
        per_mass = np.zeros(mesh.links + 1)
        per_mass[free] = impulse / mesh.mass[free]
        x = np.ascontiguousarray(self.initial.T)
        v = np.zeros_like(x)
        back = half_step_back(p.mass_damping or 0.0, step)[1]
        v[:, free] = back * self.first_force()[free].T / mesh.mass[free]
        # so that the predicted velocity 1.5 v - 0.5 v_before is zero at the start
        v_before = 3.0 * v if any(rate_dampings(p)) else np.empty((0, 0))
        load_increment, hold = np.ascontiguousarray(per_mass * mesh.loads().T), 1
        if self.air is not None:
            hold = self.air.hold(float(mesh.tensions_and_forces(self.initial)[0].max()), step, float(self.times[-1]))
        varying = mesh.time_dependent_loads()
        patterns = np.array([pattern.T for pattern, _ in varying]).reshape(len(varying), *x.shape)
        nodes = NodesInStep(per_mass, damping_factor, load_increment, patterns)
        saved = np.zeros((instants.steps.size, 3 if self.wants_velocity(instants) else 1, *x.shape))
        half_step_rates = saved[:, 1:] if saved.shape[1] > 1 else None
        extremes, slack, bound = self.extremes(), np.array(NO_SLACK), self.divergence_bound
        low, high = extremes or (NOTHING, NOTHING)
        state, work = ExplicitState(x, v, v_before, *np.zeros((2, *x.shape))), Work.of(mesh.arguments, x)
        on_nodes = _on_nodes(self, hold)

        def advance(start: int, steps: int) -> bool:
            first, last = np.searchsorted(instants.steps, (start, start + steps))
            record = Record(start, instants.steps[first:last], saved[first:last], *mesh.link_weights, low, high, slack)
            time = np.arange(start, start + steps + 1) / steps_per_second
            ends = p.end_coordinates_at_steps(start, steps, steps_per_second)
            tables = _tables(self, ends, varying, time, time - 0.5 * step)
            kernel.verlet(mesh.arguments, nodes, *on_nodes, tables, step, state, record, work)
            return bool(np.isfinite(x).all() and np.abs(x).max() < bound)

        watch = self.watch(steps_per_second, total, extremes)
        failed_step = advance_in_blocks(advance, (*state, slack), total, self.progress, watch)
        if failed_step is not None:
            self._stop(instants, saved[:, 0], half_step_rates, failed_step, steps_per_second)
        peaks = None if watch is None else watch.finish(advance, (*state, slack), steps_per_second)
        result = self._gather(instants, saved[:, 0], half_step_rates, extremes)
        result = replace(with_slack(result, mesh, slack), peak_times=peaks)
        self._check_limit(result)
        return self.check_energy(result)


class ImplicitCableRun(ImplicitChainRun):
    """Trapezoidal rule: second order, unconditionally stable in linear theory."""

    chain: SpectralMesh
    air: MeshAir | None
    remedy = REMEDY
    attributes = _attributes

    @property
    def alternatives(self) -> str:
        """What to try where a run stops."""
        return "a shorter step, scheme velocity_verlet, gentler loads or motion, or damping"

    @cached_property
    def modal_damping(self) -> NodalDamping:
        """Damping by the ratios of the scene, of vibrations of the cable about rest."""
        p, mesh = self.chain.p, self.chain
        if p.damping_ratios is None:
            return NodalDamping.none()
        mesh = replace(mesh, p=replace(p, initial={}))
        stiffness = tangent_stiffness(mesh, start(mesh))
        if self.attached is not None:
            self.attached.add_stiffness(stiffness)
        mass, width = np.repeat(mesh.mass[1:-1], p.dims), p.dims * (mesh.order + 1)
        return NodalDamping.of(p, stiffness, mass, mesh.arc_length / mesh.total_length, _band(stiffness, width))

    def new_stepper(self, instants: OutputTimes) -> ImplicitStepper:
        """Return the stepper of a run."""
        return _CableStepper(self, instants)

    def _gather(self, stepper: ImplicitStepper, instants: OutputTimes, extremes: Extremes) -> Trajectory:
        assert isinstance(stepper, _CableStepper)
        return with_slack(super()._gather(stepper, instants, extremes), self.chain, stepper.slack)


#: Run of the continuous cable by either scheme.
CableRun = ExplicitCableRun | ImplicitCableRun


class _CableStepper(ImplicitStepper):
    """State of an implicit run, advanced in place by the kernel."""

    run: ImplicitCableRun

    def __init__(self, run: ImplicitCableRun, instants: OutputTimes) -> None:
        super().__init__(run, instants)
        self.slack, elements = np.array(NO_SLACK), run.chain.arguments
        patterns = np.zeros((0, *self.x.shape)) if self.patterns is None else self.patterns
        self.nodes = Nodes(self.mass, run.chain.p.mass_damping or 0.0, self.loads, patterns, self.modal)
        self.work, self.newton = Work.of(elements, self.x), Newton.of(elements, len(self.x))

    @property
    def state(self) -> tuple[np.ndarray, ...]:
        """All arrays that a step changes, but for the extremes."""
        return *super().state, self.slack

    def substep(self, number: int) -> bool:
        """Repeat one step with substeps; slack recorded in a substep gets the number of the step."""
        before = self.slack.copy()
        converged = super().substep(number)
        if before[0] < 0.0 <= self.slack[0]:
            self.slack[0] = number + 1
        if self.slack[4] < before[4]:
            self.slack[2] = number + 1
        return converged

    def _kernel(self, time: np.ndarray, step: float, start: int, save: np.ndarray, at: int) -> int:
        from cablepod.cable import _kernels_trapezoidal as kernel  # numba is imported only to compute

        run, mesh, ends = self.run, self.run.chain, self.run.chain.p.end_positions(time)
        rows, columns = mesh.end_places
        end_table = np.ascontiguousarray(ends[:, np.minimum(columns, 1), rows].T)
        # current positions and those of the ends in these steps, as the cable may have moved far from its initial shape
        largest = max(float(np.abs(self.x).max()), float(np.abs(end_table).max(initial=0.0)))
        rounding = ROUNDING * min(run.divergence_bound, largest)
        tolerance = max(run.newton_factor * NEWTON_RTOL * mesh.total_length / mesh.links, rounding)
        tables = _tables(run, end_table, self.varying, time, time)
        low, high = self.extremes or (NOTHING, NOTHING)
        record = Record(start, save, self.saved[at : at + save.size], *mesh.link_weights, low, high, self.slack)
        self.work.position[:] = self.x
        self.newton.start_tangent(mesh.arguments, self.nodes, step)
        done, iterations = kernel.trapezoidal(
            mesh.arguments, self.nodes, *_on_nodes(run), tables, step, tolerance, run.divergence_bound,
            State(self.x, self.v, self.a), record, self.work, self.newton,
        )  # fmt: skip
        self.iterations += iterations
        return done


def _on_nodes(run: CableRun, hold: int = 1) -> tuple[Air | None, Attached | None]:
    """Return the wind, whose drag is held for a number of steps, and dampers and springs; None without."""
    air, attached = run.air, run.attached
    bodies = NOTHING if air is None or air.bodies is None else air.bodies
    return (
        None if air is None else Air(air.velocity, air.element_drag, bodies, hold),
        None if attached is None else Attached(attached.particles, attached.numbers),
    )


def _tables(run: CableRun, ends: np.ndarray, varying: list[Any], time: np.ndarray, wind_time: np.ndarray) -> Tables:
    """Return what changes from step to step, for prescribed coordinates (moving, steps + 1) and time-dependent loads.

    Times [s] are those of the steps, and those at which they take the wind.
    """
    p, air = run.chain.p, run.air
    factors = np.stack([factor(time) for _, factor in varying], axis=1) if varying else np.zeros((time.size, 0))
    places = NOTHING if air is None else wind_time * air.samples_per_second
    return Tables(*run.chain.end_places, ends, p.end_positions(time, 1), factors, places)


def _band(matrix: np.ndarray, width: int) -> np.ndarray:
    """Return the lower triangle of a symmetric band matrix: entry (row, column) is at [column, row - column]."""
    result = np.zeros((len(matrix), width))
    for k in range(min(width, len(matrix))):
        result[: len(matrix) - k, k] = np.diagonal(matrix, -k)
    return result
