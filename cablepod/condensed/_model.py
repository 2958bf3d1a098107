"""The condensed model: boundary data of each step, initial state, forces and frequencies, on given coefficients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.chain._air import ChainAir
from cablepod.chain._start import start
from cablepod.condensed._attached import damping_of_dampers, forces_of_line, loading
from cablepod.condensed._coefficients import Coefficients, from_momenta
from cablepod.condensed._frame import add_damping_of_turning, chord_and_loads, end_tables, end_velocities, longest_chord
from cablepod.condensed._kernels_layout import (
    SLOPE_SQUARED,
    Bounds,
    ExactTerms,
    ExactWork,
    LeadingTerms,
    Sizes,
    constant_sizes,
    runtime_sizes,
)
from cablepod.condensed._newton import equilibria, leading_forces
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._formulas import closure_tension
from cablepod.discretisation._lifting import line_between
from cablepod.discretisation._modal_damping import modal_damping
from cablepod.discretisation._step_limit import largest_frequencies_squared
from cablepod.errors import SceneError

#: What the modes of a sagging cable have to be, in words.
MODES_WITH_SAG = "modes that hold it: of condensed.vibration_modes with static_modes=True, of snapshots, or more"


@dataclass(frozen=True, eq=False)
class CondensedModel(Coefficients):
    """Condensed model of a cable: quasi-static along the chord, modes for the deflection normal to it.

    Boundary data of an instant: chord length [m], loads along the chord and loads along each normal, one per pattern [N/m]
    (point loads [N]); see :func:`cablepod.condensed._frame.chord_and_loads`.  Dampers and springs are loads too, see
    :mod:`cablepod.condensed._attached`.
    """

    #: Numbers of the modes of the larger set, their labels in results (rank,)
    mode_numbers: tuple[Any, ...] = ()
    #: Coordinates in which the springs have no force (r,), where that is not in still air
    spring_rest: np.ndarray | None = None

    def boundary_data(self, begin: int, steps: int, steps_per_second: float) -> np.ndarray:
        """Return the boundary data of the steps `begin` ... `begin + steps`, both included."""
        p = self.chain.p
        tables = end_tables(p, begin, steps, steps_per_second)
        velocities = end_velocities(p, begin, steps, steps_per_second) if self.has_loads_of_velocities else None
        return self._project_loads(*tables, begin, steps, steps_per_second, velocities)

    def boundary_data_at(self, times: np.ndarray, ends: np.ndarray | None = None) -> np.ndarray:
        """Return the boundary data at any instants [s]; `ends` are the positions of the ends there, computed if None."""
        p = self.chain.p
        ends, accelerations = p.end_positions(times) if ends is None else ends, np.zeros((0, 2, p.dims))
        if p.motions:
            accelerations = p.end_positions(times, 2)
            if p.mass_damping:  # damping acts on the motion of the chord frame too
                accelerations += p.mass_damping * p.end_positions(times, 1)
        ends, accelerations = (np.ascontiguousarray(array.reshape(-1, 2 * p.dims).T) for array in (ends, accelerations))
        velocities = None
        if self.has_loads_of_velocities and p.motions:
            velocities = p.end_positions(times, 1).reshape(-1, 2 * p.dims).T
        return self._project_loads(ends, accelerations, times, 0, 0.0, velocities)

    def _project_loads(
        self,
        ends: np.ndarray,
        accelerations: np.ndarray,
        begin: Any,
        steps: int,
        steps_per_second: float,
        velocities: np.ndarray | None = None,
        *,
        is_static: bool = False,
    ) -> np.ndarray:
        """Return the boundary data for ends [m] and their accelerations [m/s^2], (2 dims, instants) each.

        The instants are the steps `begin` ... `begin + steps`, or, with 0 steps per second, the times `begin` [s].  `velocities`
        are those of the ends (2 dims, instants) [m/s], which dampers and the damping by the tension need; None for ends at rest.
        `is_static` is whether the air is that of the equilibrium at the start.
        """
        p = self.chain.p

        def factor(function: Any) -> np.ndarray:
            return function.at_steps(begin, steps, steps_per_second) if steps_per_second else function(begin)

        points = [
            point.force[:, None] * (np.ones(1) if point.factor is None else factor(point.factor))
            for point in p.point_loads
        ]
        load = p.weight[:, None] if p.load is None else (p.weight + p.load)[:, None]
        if p.load is not None and p.load_factor is not None:
            load = p.weight[:, None] + p.load[:, None] * factor(p.load_factor)
        if p.load is not None and not self.is_uniform:  # not in proportion to the mass
            points, load = [load - p.weight[:, None], *points], p.weight[:, None]
        instants = ends.shape[1]
        attached = self._attached_loads(ends, velocities)
        if self.body_loads is not None:
            times = np.arange(begin, begin + steps + 1) / steps_per_second if steps_per_second else begin
            of_bodies = np.zeros((p.dims, len(self.body_loads.fractions), instants))
            of_bodies[0] = -(self.body_loads.mean[:, None] if is_static else self.body_loads.at(times))
            attached = np.concatenate([of_bodies, attached], axis=1)
        is_steady = all(values.shape[1] == 1 for values in (load, *points))
        if is_steady and not accelerations.shape[1] and self.body_loads is None:  # the same at all instants
            ends, attached = ends[:, :1].copy(), attached[:, :, :1]
        rows = chord_and_loads(ends, accelerations, load, p.mass, self.reference, points)
        if p.tension_damping is not None and velocities is not None and velocities.shape[1]:
            add_damping_of_turning(rows, ends, velocities, self.reference, p.tension_damping)
        if attached.shape[1]:
            others = rows[:, 1:].reshape(len(rows), p.dims, -1)
            loads = np.concatenate([others, attached.transpose(2, 0, 1)], axis=2)
            rows = np.ascontiguousarray(np.concatenate([rows[:, :1], loads.reshape(len(rows), -1)], axis=1))
        return rows if len(rows) == instants else np.repeat(rows, instants, axis=0)

    def _attached_loads(self, ends: np.ndarray, velocities: np.ndarray | None) -> np.ndarray:
        """Return the loads of dampers and springs along the chord and each normal (dims, loads, instants)."""
        p, count = self.chain.p, len(loading(self.chain))
        result = np.zeros((p.dims, count, ends.shape[1]))
        if count:
            velocities = np.empty((0, 0)) if velocities is None else velocities
            result[0], result[1] = forces_of_line(self, ends, velocities, self.rest_of_springs)
        return result

    @cached_property
    def rest_of_springs(self) -> np.ndarray:
        """Coordinates in which the springs have no force (r,): those at rest without them."""
        if self.spring_rest is not None:
            return self.spring_rest
        return self.without_springs.rest if self.has_springs else np.zeros(len(self.shapes))

    @property
    def has_loads_of_velocities(self) -> bool:
        """Whether velocities of the ends are loads."""
        return self.chain.p.tension_damping is not None or bool(loading(self.chain))

    @property
    def has_springs(self) -> bool:
        """Whether there are springs."""
        return any(attachment.spring for attachment in self.chain.p.attachments)

    @property
    def without_springs(self) -> CondensedModel:
        """The same model without the springs to the ground."""
        p = self.chain.p
        attachments = tuple(replace(attachment, spring=0.0) for attachment in p.attachments)
        return replace(self, chain=replace(self.chain, p=replace(p, attachments=attachments)))

    def coordinates(self, deflection: np.ndarray) -> np.ndarray:
        """Project deflections (normals, times, particle) [m] onto the coordinates (times, r)."""
        momenta = self.momenta(deflection)
        return momenta if self.reference_state is None else from_momenta(momenta, self.shapes, self.mass, self.sets)

    def momenta(self, deflection_rates: np.ndarray) -> np.ndarray:
        """Project rates of deflections (normals, times, particle) [m/s] onto rates of the coordinates (times, r), as impulses."""
        parts = [
            (part * self.mass) @ self.shapes[which].T for part, which in zip(deflection_rates, self.sets, strict=False)
        ]
        return np.concatenate(parts, axis=1)

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """Return initial coordinates and rates (r,), see :attr:`initial_state`.

        Raises
        ------
        SceneError
            For a start from equilibrium on modes that have none near the rest of the chain.
        """
        if not self.chain.p.initial and self.found_rest is None:
            raise SceneError(
                f"modes: given {self.rank}, on which no deflection near that at rest is in equilibrium; allowed: {MODES_WITH_SAG}"
            )
        q, v = self.initial_state
        return q.copy(), v.copy()

    @cached_property
    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Initial coordinates and rates; a run from equilibrium starts from that of the model, not of the chain.

        Without an equilibrium they are those of the chain: the first guess of one in wind.
        """
        q = None if self.chain.p.initial else self.found_rest
        if q is None:
            q = self.coordinates(self.start_deflection())[0]
        rates = self.start_deflection_rates
        return q, np.zeros_like(q) if rates is None else self.momenta(rates[:, None])[0]

    @cached_property
    def found_rest(self) -> np.ndarray | None:
        """Coordinates of the equilibrium at the start (r,); None where the modes have none near the rest of the chain."""
        found = None if self.first_guess is None else self.equilibrium(self.first_guess)
        return self.equilibrium(self.coordinates(self.start_deflection())[0]) if found is None else found

    @cached_property
    def initial_forces(self) -> tuple[np.ndarray, float, float]:
        """Undamped accelerations (r,), H [N] and a bound of the squared frequencies [1/s^2] in the initial state."""
        (q, v), boundary_data = self.initial_state, self.initial_boundary_data
        acceleration, _, chord_tension = self.force(q, v, boundary_data)
        return acceleration, chord_tension, self.omega_max_squared(q, boundary_data, chord_tension)

    def start_deflection(self, air: ChainAir | None = None) -> np.ndarray:
        """Return the deflection of the chain at the start (normals, 1, particle) [m], in air along it; None for still air."""
        position = start(self.chain, air)
        return ChordFrame.of((position[-1] - position[0])[None], self.reference).split(position[None])[1]

    @cached_property
    def start_deflection_rates(self) -> np.ndarray | None:
        """Rates of the deflection at the start (normals, particle) [m/s]; None for ends without speed.

        The particles are at rest, the chord frame moves.
        """
        p = self.chain.p
        rates = p.initial_end_rates[0]
        if not rates.any():
            return None
        frame = ChordFrame.of(np.diff(p.initial_ends, axis=0), self.reference)
        sigma = self.chain.arc_length / self.chain.total_length
        return -np.einsum("pc,kc->kp", line_between(rates, sigma), frame.normals[0])

    @cached_property
    def first_guess(self) -> np.ndarray | None:
        """Coordinates of the parabola that approximates the equilibrium; None with point loads or a given initial shape."""
        p = self.chain.p
        if p.initial:
            return None
        if not self.is_uniform:
            return self.coordinates(
                np.cumsum(np.pad(self.rest_slopes * self.chain.length, ((0, 0), (1, 0))), axis=1)[:, None]
            )[0]
        if p.point_loads:
            return None
        boundary_data, sigma = self.static_boundary_data, self.chain.arc_length / self.chain.total_length
        transverse = boundary_data[
            1 + len(self.load_patterns) :: len(self.load_patterns)
        ]  # uniform load along each normal
        sag = 0.5 * self.chain.total_length**2 / self.rest_tension * sigma * (1.0 - sigma)
        return self.coordinates(transverse[:, None, None] * sag)[0]

    def equilibrium(self, q: np.ndarray) -> np.ndarray | None:
        """Find the equilibrium near q by Newton's method; None where it fails, or converges to another one."""
        static = self.static_boundary_data

        def forces(unknowns: np.ndarray, _: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            force, tangent, _mass, _tension = self.forces(unknowns[0], np.zeros_like(q), static)
            return force[None], tangent[None]

        found, is_near = equilibria(q[None], forces)
        return found[0] if is_near[0] else None

    @cached_property
    def damping_matrix(self) -> np.ndarray:
        """Damping matrix of the ratios of the scene, of vibrations about rest (r, r) [1/s]; without entries: none."""
        if self.chain.p.damping_ratios is None:
            return np.empty((0, 0))
        _, stiffness, mass, _ = self.forces(self.rest, np.zeros_like(self.rest), self.static_boundary_data)
        return modal_damping(
            self.chain.p.damping_ratios, stiffness, mass if self.inertia.size else np.ones(len(stiffness))
        )

    @cached_property
    def damper_matrix(self) -> np.ndarray:
        """Damping matrix of the attached dampers (r, r) [1/s]; without entries: none."""
        return damping_of_dampers(self) if self.chain.p.attachments else np.empty((0, 0))

    @cached_property
    def rest(self) -> np.ndarray:
        """Coordinates at rest in still air (r,), also where the run starts from another shape."""
        p = self.chain.p
        at_rest = replace(self, chain=replace(self.chain, p=replace(p, initial={}))) if p.initial else self
        return at_rest.initial()[0]

    @cached_property
    def terms(self) -> LeadingTerms:
        """Coefficients of the forces to leading order."""
        coefficients = self.slope_norms_squared, self.mean_chordwise_forces, self.geometric_stiffness
        of_cable = self.chain.p.stiffness, self.chain.total_length
        return LeadingTerms.of(*of_cable, *coefficients, self.load_projection).take(0)

    @cached_property
    def exact_terms(self) -> ExactTerms:
        """Coefficients of the exact forces, at the points of `rule`."""
        slopes, patterns, weights = self.rule
        p = self.chain.p
        of_cable, inertia = (p.stiffness, self.green or None), self.inertia if self.inertia.size else None
        return ExactTerms(*of_cable, slopes, self.n_in_plane, patterns, weights, self.load_projection, inertia)

    def sizes(self, *, constant: bool) -> Sizes:
        """Return the numbers of coordinates and loads, as constants of the compiled code or not."""
        make = constant_sizes if constant else runtime_sizes
        return make(len(self.shapes), len(self.load_patterns), len(self.load_projection))

    def bounds(self) -> Bounds:
        """Return what the monitor of a run compares."""
        return Bounds(
            self.geometric_stiffness_norms, np.ascontiguousarray(self.chordwise_forces_at_candidates.T), np.empty(1)
        )

    @cached_property
    def initial_boundary_data(self) -> np.ndarray:
        """Boundary data at the start."""
        if not self.chain.p.motions and self.body_loads is None:
            return self.static_boundary_data
        return self.boundary_data_at(np.zeros(1), self.chain.p.initial_ends[None])[0]

    @cached_property
    def static_boundary_data(self) -> np.ndarray:
        """Boundary data at the start without accelerations of the ends."""
        p = self.chain.p
        accelerations = np.zeros((2 * p.dims, 1 if p.motions else 0))
        return self._project_loads(p.initial_ends.reshape(-1, 1), accelerations, np.zeros(1), 0, 0.0, is_static=True)[0]

    def force(self, q: np.ndarray, v: np.ndarray, boundary_data: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return undamped accelerations (r,), tangent of the forces (r, r) and H [N] of one state."""
        f, tangent, mass, chord_tension = self.forces(q, v, boundary_data)
        return (np.linalg.solve(mass, f) if self.inertia.size else f), tangent, chord_tension

    def accelerations(self, f: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the accelerations (r,) by forces f (r,) in a state at the start, with the chordwise inertia."""
        return np.linalg.solve(self.forces(q, v, self.initial_boundary_data)[2], f)

    def forces(
        self, q: np.ndarray, v: np.ndarray, boundary_data: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Return undamped forces (r,), their tangent (r, r), mass matrix (r, r) and H [N] of one state."""
        if self.order == "leading":
            force, tangent, tension = leading_forces(self.terms.take(None), boundary_data[None], q[None])
            return force[0], tangent[0], np.eye(q.size), float(tension[0])
        from cablepod.condensed import _kernels_exact as kernel  # numba is imported only to compute

        work, guess = self.exact_work(boundary_data, tangent=True), self.tension_guess(boundary_data, q)
        f = np.empty(q.size)
        chord_tension = kernel.exact_force(self.exact_terms, boundary_data, q, v, guess, work, f)
        return f, work.tangent, work.mass, chord_tension

    def mean_stretch(self, q: np.ndarray, boundary_data: np.ndarray) -> float:
        """Return the mean stretch of the cable in one state by the exact closure."""
        from cablepod.condensed import _kernels_exact as kernel

        terms, guess = self.exact_terms, self.tension_guess(boundary_data, q)
        work = self.exact_work(boundary_data, tangent=False)
        kernel.exact_force(terms, boundary_data, q, np.zeros_like(q), guess, work, np.empty_like(q))
        return float(kernel.mean_stretch(terms.weights, work.stretch[0], work.closure[SLOPE_SQUARED]))

    def exact_work(self, boundary_data: np.ndarray, *, tangent: bool) -> ExactWork:
        """Return work arrays of the exact forces with a first guess of the stretch, with a tangent or without."""
        return ExactWork.of(len(self.shapes), self.rule[2].size, self.stretch_guess(boundary_data), tangent=tangent)

    def stretch_guess(self, boundary_data: np.ndarray) -> float:
        """Return a first guess of the chordwise stretch."""
        return max(1.0, float(boundary_data[0]) / self.chain.total_length)

    def tension_guess(self, boundary_data: np.ndarray, q: np.ndarray) -> float:
        """Return a first guess of H [N]: that to leading order, with a lower bound for large slopes."""
        chain, k = self.chain, self.chain.p.stiffness
        sag = 0.5 * k / chain.total_length * float(self.slope_norms_squared @ q**2)
        load = boundary_data[1 : 1 + self.mean_chordwise_forces.size] @ self.mean_chordwise_forces
        leading = closure_tension(k, boundary_data[0] / chain.total_length, load, sag)
        # lower bound: H that carries the transverse loads with a sag of an eighth of the length
        transverse = np.abs(boundary_data[1 + self.mean_chordwise_forces.size :]).sum() * chain.total_length / 8.0
        return max(leading, transverse, 1e-6 * k)

    def omega_max_squared(self, q: np.ndarray, boundary_data: np.ndarray, chord_tension: float) -> float:
        """Return an upper bound of the squared angular frequencies about a state [1/s^2]."""
        chain, kappa, norms = self.chain, self.slope_norms_squared, self.geometric_stiffness_norms
        stiffness = chain.p.stiffness / chain.total_length
        return float(largest_frequencies_squared(kappa, norms, stiffness, q, boundary_data, chord_tension))

    def omega_taut_squared(self, end_time: float, intervals: int = 1000) -> float:
        """Return the largest squared angular frequency without sag, at the longest chord up to `end_time` [s], in 1/s^2."""
        longest = longest_chord(self.chain.p, end_time, intervals)
        chord_tension = self.chain.p.stiffness * max(longest / self.chain.total_length - 1.0, 0.0)
        return chord_tension * float(self.slope_norms_squared.max())
