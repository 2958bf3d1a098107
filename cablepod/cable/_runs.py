"""Runs of the continuous cable, explicit and implicit: those of the chain, with elements for links."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from cablepod.cable._mesh import SpectralMesh
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.chain._implicit import ROUNDING, ImplicitChainRun, ImplicitStepper
from cablepod.conventions import COORDINATES, ENDS, label
from cablepod.discretisation._similarity import describe
from cablepod.integrate._march import advance_in_blocks
from cablepod.integrate._output_times import OutputTimes
from cablepod.integrate._run import ChainRun, Trajectory, law_suffix
from cablepod.integrate._step_control import damped_growth

SCHEMES = ("velocity_verlet", "trapezoidal")
#: A correction of the nodes as small as this part of their mean distance ends Newton's method.
NEWTON_RTOL = 1e-9
#: Where no stretch is below 1: first step, its place, step of the least stretch, its place, least square.
NO_SLACK = (-1.0, -1.0, -1.0, -1.0, 1.0)


def output_coordinates(mesh: SpectralMesh) -> dict[str, Any]:
    """Coordinates of a result on the particles of a mesh."""
    particles = mesh.particles
    return {
        "arc_length": ("particle", particles),
        "link_arc_length": ("link", 0.5 * (particles[1:] + particles[:-1])),
        "coordinate": list(COORDINATES[: mesh.p.dims]),
    }


class CableRun(ChainRun):
    """What both schemes share."""

    chain: SpectralMesh

    def extremes(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Extremes of the tensions before the run, where they are asked for."""
        if "tension_extremes" not in self.outputs:
            return None
        count = self.chain.particles.size - 1
        return np.full(count, np.inf), np.full(count, -np.inf)

    def first_force(self) -> np.ndarray:
        """Total forces on all nodes (nodes, dims) at the start, which is from rest [N]."""
        p, free = self.chain.p, self.chain.free_particles
        rates = np.zeros_like(self.initial)
        rates[0], rates[-1] = p.end_positions(np.zeros(1), 1)[0]
        rates[free] = 0.0
        return self.chain.forces(self.initial, rates) + self.chain.loads(0.0)

    @property
    def remedy(self) -> str:
        """What to try where a run gains energy from nothing."""
        return "a step half as long, or other elements"

    def end_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the prescribed coordinates in positions (dims, nodes), in the order of the motions."""
        motions = self.chain.p.motions
        rows = np.array([COORDINATES.index(axis) for _, axis in motions], dtype=np.int64)
        return rows, np.array([self.chain.links * ENDS.index(end) for end, _ in motions], dtype=np.int64)

    def note(self, state: Trajectory, slack: np.ndarray) -> Trajectory:
        """Say where and when the stretch fell below 1, at any step."""
        where, rate = self.chain.point_arc_length, state.instants.steps_per_second
        if slack[0] >= 0.0:
            state.diagnostics |= {
                "first_slack_time": float(slack[0]) / rate,
                "first_slack_arc_length": float(where[int(slack[1])]),
                "smallest_stretch": math.sqrt(float(slack[4])),
                "smallest_stretch_time": float(slack[2]) / rate,
                "smallest_stretch_arc_length": float(where[int(slack[3])]),
            }
        return state

    def dataset(self, state: Trajectory) -> xr.Dataset:
        """Label what a run gave."""
        mesh, rate = self.chain, state.instants.steps_per_second
        variables: dict[str, Any] = {}
        if "position" in self.outputs:
            variables["position"] = (("time", "particle", "coordinate"), mesh.interpolate(state.position))
        if "velocity" in self.outputs and state.velocity is not None:
            variables["velocity"] = (("time", "particle", "coordinate"), mesh.interpolate(state.velocity))
        if "tension" in self.outputs:
            variables["tension"] = (("time", "link"), mesh.tensions_and_forces(state.position, state.velocity)[0])
        if state.extremes is not None:
            variables["tension_minimum"], variables["tension_maximum"] = (("link", item) for item in state.extremes)
        variables["unstretched_length"] = ((), mesh.total_length)
        coordinates = output_coordinates(mesh)
        if not {"tension", "tension_extremes"} & set(self.outputs):
            del coordinates["link_arc_length"]
        about, names = describe(mesh.p, mesh.total_length, float(state.instants.times[-1]))
        coords = {"time": state.instants.times, **coordinates, **names}
        result = xr.Dataset({**variables, **about}, coords=coords)
        label(result)
        stretch = mesh.stretch(state.position)
        when, where = np.unravel_index(int(stretch.argmin()), stretch.shape)
        result.attrs.update(
            title=f"{self.title}: continuous cable{law_suffix(mesh)}",
            stage="trajectory",
            model="continuous cable",
            law=mesh.law,
            scheme=self.scheme,
            step=1.0 / rate,
            number_of_steps=int(state.instants.steps[-1]),
            elements=mesh.sizes.size,
            element_order=mesh.order,
            highest_angular_frequency=mesh.highest_frequency(mesh.tangent_stiffness_ratio(self.initial)),
            smallest_stretch=float(stretch[when, where]),
            smallest_stretch_time=float(state.instants.times[when]),
            smallest_stretch_arc_length=float(mesh.point_arc_length[where]),
        )
        result.attrs.update(state.diagnostics)
        return result


class ExplicitCableRun(CableRun, ExplicitChainRun):
    """Velocity Verlet: second order, symplectic without damping, stable below 2 over the highest angular frequency."""

    def __call__(self, rate: float) -> Trajectory:
        """Run with so many steps per second."""
        from cablepod.cable import _kernels_explicit as kernel  # numba is imported only to compute

        mesh, p, free = self.chain, self.chain.p, self.chain.free_particles
        instants = self.instants(rate)
        total = int(instants.steps[-1]) + 1
        step = 1.0 / rate
        mass = p.mass * mesh.tributary_length[free]
        decay, per_mass = 1.0, step / mass
        if p.mass_damping is not None:
            decay = math.exp(-p.mass_damping * step)
            per_mass = -math.expm1(-p.mass_damping * step) / (p.mass_damping * mass)
        x = np.ascontiguousarray(self.initial.T)
        half = 0.5 * step if p.mass_damping is None else damped_growth(p.mass_damping, step) / p.mass_damping
        v = np.ascontiguousarray((-half * self.first_force()[free] / mass[:, None]).T)
        # the prediction 1.5 v - 0.5 before then gives rest at the start
        before = None if p.link_viscosity is None else 3.0 * v
        drive = np.ascontiguousarray((per_mass[:, None] * mesh.loads()[free]).T)
        varying = mesh.time_dependent_loads()
        patterns = np.array([item[0][free].T for item in varying]).reshape(len(varying), *v.shape)
        saved = np.empty((instants.steps.size, p.dims, mesh.links + 1))
        halves = np.empty((instants.steps.size if self.wants_velocity(instants) else 0, 2, *v.shape))
        extremes = self.extremes()
        low, high = extremes or (np.empty(0), np.empty(0))
        d, weight, scale, stiffness, green = mesh.law_arguments
        element, rows = mesh.link_rows
        slack, bound, places = np.array(NO_SLACK), self.divergence_bound, self.end_places()

        def advance(start: int, steps: int) -> bool:
            first, last = np.searchsorted(instants.steps, (start, start + steps))
            time = np.arange(start, start + steps + 1) / rate
            kernel.verlet(
                x, v, free.start, d, weight, scale, mesh.fixed, stiffness, green, per_mass, drive, step, decay,
                *places, p.end_coordinates_at_steps(start, steps, rate), patterns, _factors(varying, time), p.link_viscosity, before,
                p.end_positions(time, 1) if before is not None else None,
                steps, start, instants.steps[first:last], saved[first:last], halves[first:last], element, rows, low, high, slack,
            )  # fmt: skip
            return bool(np.isfinite(x).all() and np.abs(x).max() < bound)

        state = (x, v, slack, *(() if before is None else (before,)))
        failed = advance_in_blocks(advance, state, total, self.progress)
        if failed is not None:
            self._stop(instants, saved, self._of_all(halves), failed, rate)
        result = self.note(self._gather(instants, saved, self._of_all(halves), extremes), slack)
        self._check_limit(result)
        return self.watch(result)

    def _of_all(self, halves: np.ndarray) -> np.ndarray | None:
        """Velocities of all nodes (saves, 2, dims, nodes) from those of the free ones; 0 at those that are held."""
        if len(halves) == 0:
            return None
        result = np.zeros((*halves.shape[:3], self.chain.links + 1))
        result[..., self.chain.free_particles] = halves
        return result


class ImplicitCableRun(CableRun, ImplicitChainRun):
    """The trapezoidal rule: second order, stable at any step as far as linear theory goes."""

    def march(self, instants: OutputTimes) -> ImplicitStepper:
        """Return the state of a run."""
        return _CableStepper(self, instants)

    def _gather(
        self, march: ImplicitStepper, instants: OutputTimes, keep: int, extremes: tuple[np.ndarray, np.ndarray] | None
    ) -> Trajectory:
        assert isinstance(march, _CableStepper)
        return self.note(super()._gather(march, instants, keep, extremes), march.slack)


class _CableStepper(ImplicitStepper):
    """The state of an implicit run, advanced in place by the kernel."""

    run: ImplicitCableRun

    def __init__(self, run: ImplicitCableRun, instants: OutputTimes) -> None:
        super().__init__(run, instants)
        self.slack = np.array(NO_SLACK)
        self.element, self.rows = run.chain.link_rows

    def substep(self, number: int) -> bool:
        """Take one step in pieces; what is noted of them counts as of the step, whose pieces have numbers of their own."""
        before = self.slack.copy()
        done = super().substep(number)
        if before[0] < 0.0 <= self.slack[0]:
            self.slack[0] = number + 1
        if self.slack[4] < before[4]:
            self.slack[2] = number + 1
        return done

    def _kernel(
        self, time: np.ndarray, step: float, start: int, steps: int, save: np.ndarray, saved: np.ndarray
    ) -> int:
        from cablepod.cable import _kernels_implicit as kernel  # numba is imported only to compute

        run, mesh, p = self.run, self.run.chain, self.run.chain.p
        low, high = self.extremes or (np.empty(0), np.empty(0))
        d, weight, scale, stiffness, green = mesh.law_arguments
        rows, columns = run.end_places()
        ends = p.end_positions(time)
        table = np.array([ends[:, -1 if column else 0, row] for row, column in zip(rows, columns, strict=True)])
        # where the cable is now and where its ends go: it may have been moved far from where it began
        rounding = ROUNDING * max(float(np.abs(self.x).max()), float(np.abs(table).max(initial=0.0)))
        # the kernel knows the free nodes only
        free = mesh.free_particles
        v, a, loads = (np.ascontiguousarray(item[:, free]) for item in (self.v, self.a, self.loads))
        patterns = np.zeros((0, *self.x.shape)) if self.patterns is None else self.patterns
        done, iterations = kernel.trapezoidal(
            self.x, v, a, free.start, d, weight, scale, mesh.fixed, stiffness, green,
            self.mass[free], p.mass_damping or 0.0, loads, np.ascontiguousarray(patterns[..., free]),
            _factors(self.varying, time), p.link_viscosity, rows, columns, table.reshape(rows.size, time.size),
            p.end_positions(time, 1) if p.link_viscosity is not None else None,
            step, max(NEWTON_RTOL * mesh.total_length / mesh.links, rounding), start, steps, save, saved,
            self.element, self.rows, low, high, self.slack,
        )  # fmt: skip
        self.v[:, free], self.a[:, free] = v, a
        self.iterations += iterations
        return done


def _factors(varying: list[Any], time: np.ndarray) -> np.ndarray:
    """Factors of the loads that vary (times, loads)."""
    return np.stack([factor(time) for _, factor in varying], axis=1) if varying else np.zeros((time.size, 0))
