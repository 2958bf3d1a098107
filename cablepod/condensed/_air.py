"""Drag of the wind on the condensed model: velocity of the air in the chord frame at Gauss points, equilibrium in the wind."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from cablepod.chain._air import ChainAir
from cablepod.chain._start import refuse_rest_in_wind
from cablepod.condensed._air_places import AirPlaces, projection_matrix
from cablepod.condensed._attached import BodyLoads
from cablepod.condensed._kernels_layout import Bodies
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._newton import solve_each
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._lifting import line_between
from cablepod.scene._wind_field import linear_between
from cablepod.wind._air import CableAir, density_of, refined
from cablepod.wind._drag import (
    TENSION_MARGIN,
    body_drag,
    drag_rate,
    drag_step_limit,
    largest_speed,
    longest_hold,
    tension_by_drag,
)

#: Number of Gauss points along the cable beyond that of the modes of each deflection.
EXTRA_POINTS = 2
#: Samples of the air in the chord frame per time scale of the motion of the ends.
SAMPLES_PER_CHANGE = 40.0
#: Relative tolerance of the equilibrium in wind, maximum number of Newton iterations, increments of the drag up to its full size.
DRAG_RTOL, MAX_DRAG_ITERATIONS, INCREMENTS = 1e-12, 100, 4
#: Number of models whose shapes at the Gauss points and rest in the mean wind are kept.
KEPT_MODELS = 16
#: Maximum number of steps from one evaluation of the drag to the next (two cost no accuracy, three a tenth of the time error),
#: and maximum time of these steps over the shortest transverse period at the start: a fifth of it for a tension twice as large.
MAX_HOLD, HOLD_OVER_PERIOD = 2, 0.14
#: Relative tolerance of the increments before the last, which are only its first guess.
INCREMENT_RTOL = 0.03


@dataclass(frozen=True, eq=False)
class CondensedAir:
    """Air along the cable of a condensed model until `end_time` [s]."""

    model: CondensedModel
    air: CableAir
    end_time: float
    points: int | None = None  #: number of Gauss points; two more than the modes of a deflection by default

    @cached_property
    def places(self) -> AirPlaces:
        """Gauss points along the cable, and bodies, which are points without weight."""
        model = self.model
        count = max(model.n_in_plane, len(model.shapes) - model.n_in_plane) + EXTRA_POINTS
        return AirPlaces.of(model, count if self.points is None else self.points, EXTRA_POINTS)

    @cached_property
    def rule(self) -> tuple[np.ndarray, np.ndarray]:
        """Relative arc lengths and weights [m] of the points."""
        return self.places.sigma, self.places.weights(self.model.chain.total_length)

    @property
    def shapes(self) -> np.ndarray:
        """Shapes at the points, their slopes, and the shapes that loads act on (3, r, points)."""
        return _shapes_at(self.model, self.places)

    @property
    def drag(self) -> np.ndarray:
        """Quadrature weights times half the density of the air, drag coefficient and diameter (points,) [kg/m]."""
        return self.air.drag * self.drag_ratios * self.rule[1]

    @property
    def wire_points(self) -> int:
        """Number of points without bodies, which come last."""
        return self.rule[0].size - len(self.places.bodies)

    @property
    def weights_of_forces(self) -> np.ndarray:
        """Weights of forces at the points: those of the rule [m], and 1 of bodies (points,)."""
        weights = self.rule[1].copy()
        weights[self.wire_points :] = 1.0
        return weights

    @property
    def drag_ratios(self) -> float | np.ndarray:
        """Drag coefficient times diameter at the points over the mean of the cable; 1 where it is the same along the cable."""
        p = self.model.chain.p
        if self.model.chain.drag_ratio is None:
            return 1.0
        return p.drag_widths(self.rule[0]) / (p.drag_coefficient * p.diameter)

    @cached_property
    def bodies(self) -> Bodies | None:
        """Drag of bodies; None without any."""
        p, count = self.model.chain.p, len(self.places.bodies)
        if not count:
            return None
        areas = np.array([attachment.drag_area for attachment in p.attachments if attachment.drag_area])
        points = np.arange(self.rule[0].size - count, self.rule[0].size)
        return Bodies(points, 0.5 * density_of(p) * areas)

    @cached_property
    def _projected(self) -> np.ndarray:
        """Velocity of the air at the Gauss points (samples of the air, dims, points) [m/s]."""
        return np.tensordot(self.air.velocity, projection_matrix(self.places, self.air.sigma.tobytes()), (1, 1))

    @property
    def _rate(self) -> float:
        """Refined samples per second."""
        return self.air.samples_per_second * self.air.refinement

    @cached_property
    def at_samples(self) -> tuple[np.ndarray, float]:
        """Velocity of the air at the Gauss points (samples, points, dims) [m/s], and its samples per second."""
        return refined(self._projected).transpose(0, 2, 1), self._rate

    @cached_property
    def _sampled(self) -> tuple[np.ndarray, float]:
        """Velocity of the air less that of the line between the ends, in the chord frame, and its samples per second.

        Along the chord and each normal, at the points: (samples, 1 + normals, points) [m/s].
        """
        p, sigma = self.model.chain.p, self.rule[0]
        if not p.motions:
            frame = ChordFrame.of(np.diff(p.initial_ends, axis=0), self.model.reference)
            axes = np.concatenate([frame.along, frame.normals[0]])
            of_air = self._projected.reshape(len(self._projected), -1)
            turned = (of_air @ np.kron(axes, np.eye(sigma.size)).T).reshape(self._projected.shape)
            return refined(turned), self._rate
        velocity, rate = self.at_samples
        scale = p.shortest_time_scale / SAMPLES_PER_CHANGE
        parts = max(1, math.ceil(1.0 / (rate * scale)))
        count = math.ceil(self.end_time * rate * parts) + 2
        samples = np.arange(len(velocity))
        velocity, rate = linear_between(samples, velocity, np.arange(count) / parts, axis=0), rate * parts
        time = np.arange(count) / rate
        ends, rates = p.end_positions(time), p.end_positions(time, 1)
        velocity = velocity - line_between(rates, sigma)
        frame = ChordFrame.of(ends[:, 1] - ends[:, 0], self.model.reference)
        axes = np.concatenate([frame.along[:, None], frame.normals], axis=1)
        result = np.empty((len(velocity), p.dims, sigma.size))
        for k in range(p.dims):  # three times as fast as one product of small matrices for each sample
            np.multiply(velocity[:, :, 0], axes[:, k, :1], out=result[:, k])
            for c in range(1, p.dims):
                result[:, k] += velocity[:, :, c] * axes[:, k, c : c + 1]
        return result, rate

    def velocity_at(self, times: np.ndarray) -> np.ndarray:
        """Return the velocity of the air less that of the line between the ends (times, 1 + normals, points) [m/s].

        Along the chord and each normal, at instants [s].
        """
        velocity, rate = self._sampled
        samples = np.arange(len(velocity))
        return linear_between(samples, velocity, times * rate, axis=0)

    @cached_property
    def in_mean_wind(self) -> CondensedAir:
        """The same points in the mean wind of the start."""
        air = self.air
        return _in_mean_wind(self.model, self.points, air.drag, air.sigma.tobytes(), air.mean.tobytes())

    @property
    def body_loads(self) -> BodyLoads | None:
        """Drag of bodies along the chord; None without any."""
        if self.bodies is None:
            return None
        velocity, rate = self._sampled
        mean = CondensedAir(self.model, self.air.steady, 0.0, self.points)._sampled[0][:1]
        forces = []
        for of_air in (velocity, mean):
            u = of_air[:, :, self.bodies.points]
            forces.append(body_drag(self.bodies.drag, u, axis=1)[:, 0])
        return BodyLoads(self.places.bodies, forces[0], rate, forces[1][0])

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Arguments of the kernel: wind (samples, (1 + normals) points), samples per second, drag, shapes."""
        velocity, rate = self._sampled
        return velocity.reshape(len(velocity), -1), rate, self.drag, self.shapes

    def acceleration(self, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the accelerations of the coordinates (r,) by the drag at the start."""
        f, model = self.force(q, rates), self.model
        return model.accelerations(f, q, rates) if model.inertia.size else f

    def force(self, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the forces on the coordinates (r,) by the drag at the start."""
        from cablepod.condensed import _kernels_drag as kernel

        wind, _, drag, shapes = self.arguments
        model, f, exact = self.model, np.empty_like(q), None
        if model.order == "leading":
            stretch = model.initial_boundary_data[0] / model.chain.total_length
        else:
            stretch, exact = model.mean_stretch(q, model.initial_boundary_data), True
        kernel.drag_force(q, rates, stretch, exact, wind, drag, shapes, model.n_in_plane, self.bodies, f)
        return f

    def hold(self, chord_tension: float, step: float) -> int:
        """Return the number of steps [s] from one evaluation of the drag to the next, for a chord tension [N] at the start."""
        chain = self.model.chain
        area = self.air.drag * chain.total_length + (0.0 if self.bodies is None else float(self.bodies.drag.sum()))
        by_drag = tension_by_drag(chain.p, chord_tension, area * self.air.largest_speed**2)
        tension = max(chord_tension, TENSION_MARGIN * by_drag, 1e-300)
        omega = math.sqrt(tension * float(self.model.slope_norms_squared.max()))
        longest = min(HOLD_OVER_PERIOD * 2.0 * math.pi / omega, longest_hold(self.rate))
        return max(1, min(MAX_HOLD, int(longest / step)))

    @cached_property
    def rate(self) -> float:
        """Bound of the rate at which drag takes away a motion along the wind [1/s]."""
        model, p = self.model, self.model.chain.p
        speed = largest_speed(p, self.air, self.end_time)
        if model.is_uniform:
            return float(drag_rate(self.air.drag, p.mass, speed))
        areas = self.drag
        if self.bodies is not None:
            areas[self.bodies.points] += self.bodies.drag
        shapes = self.shapes[0]
        return float(drag_rate(np.linalg.norm((shapes * areas) @ shapes.T, 2), 1.0, speed))  # of modes of unit mass

    @property
    def step_limit(self) -> float:
        """Longest stable step by the rate of the drag [s]."""
        return drag_step_limit(self.rate)

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """Return initial coordinates and rates (r,), in equilibrium with the drag at the start unless a start is given.

        Raises
        ------
        SceneError
            Where no equilibrium is found.
        """
        model, rates = self.model, self.model.initial_state[1].copy()
        if model.chain.p.initial:
            return model.coordinates(self.start_deflection)[0], rates
        return self.in_mean_wind.rest.copy(), rates

    @cached_property
    def start_deflection(self) -> np.ndarray:
        """Deflection of the chain at the start, see :meth:`CondensedModel.start_deflection`."""
        return self.model.start_deflection(self.of_chain)

    @property
    def of_chain(self) -> ChainAir:
        """The same air along the particles of the chain."""
        return ChainAir(self.model.chain, self.air)

    @cached_property
    def rest(self) -> np.ndarray:
        """Coordinates (r,) in equilibrium with the drag of this air at the start.

        Raises
        ------
        SceneError
            Where no equilibrium is found.
        """
        model = self.model
        q = model.initial_state[0][None]
        static, still = model.static_boundary_data, np.zeros_like(q[0])
        for increment in range(1, INCREMENTS + 1):  # the deflection may change by more than itself, also in sign
            share, rtol = increment / INCREMENTS, DRAG_RTOL if increment == INCREMENTS else INCREMENT_RTOL

            def forces(q: np.ndarray, _: np.ndarray, share: float = share) -> tuple[np.ndarray, np.ndarray]:
                force, tangent, _mass, _tension = model.forces(q[0], still, static)
                return (force + share * self.force(q[0], still))[None], tangent[None]

            def is_found(change: np.ndarray, q: np.ndarray, _: np.ndarray, rtol: float = rtol) -> np.ndarray:
                return np.isfinite(q).all(axis=1) & (np.abs(change).max(axis=1) <= rtol * np.abs(q).max(axis=1))

            q, found = solve_each(q, forces, is_found, MAX_DRAG_ITERATIONS)
            if not found[0]:
                refuse_rest_in_wind()
        return q[0]


def with_loads_of_air(air: CondensedAir) -> CondensedAir:
    """Return air along a model that has the drag of bodies along the chord, and springs without force in the mean wind."""
    model = air.model
    if air.bodies is not None:
        model = replace(model, body_loads=air.body_loads)
    if model.has_springs:
        model = replace(model, spring_rest=replace(air, model=model.without_springs).in_mean_wind.rest)
    return replace(air, model=model)


@lru_cache(KEPT_MODELS)
def _in_mean_wind(model: CondensedModel, points: int | None, drag: float, sigma: bytes, mean: bytes) -> CondensedAir:
    """Return the mean wind along a model; kept with the rest in it, as runs in other gusts share it.

    `sigma` and `mean` are the bytes of relative arc lengths (points,) and mean velocities (points, dims).
    """
    places = np.frombuffer(sigma)
    velocity = np.frombuffer(mean).reshape(places.size, -1)
    air = CableAir(np.stack([velocity, velocity]), places, 1.0, drag, velocity, math.inf)
    return CondensedAir(model, air, 0.0, points)


@lru_cache(KEPT_MODELS)
def _shapes_at(model: CondensedModel, places: AirPlaces) -> np.ndarray:
    """Return shapes, slopes and shapes of loads at places (3, r, points); kept with the model."""
    return np.stack(places.shapes(model, model.shapes))
