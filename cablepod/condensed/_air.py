"""Drag of the wind on the condensed model: velocity of the air in the chord frame at Gauss points, equilibrium in the wind."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.chain._start import refuse_rest_in_wind
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.wind._air import CableAir, refined

#: Number of Gauss points along the cable beyond that of the modes of each deflection.
EXTRA_POINTS = 2
#: Samples of the air in the chord frame per time scale of the motion of the ends.
SAMPLES_PER_CHANGE = 40.0
#: Relative tolerance of the equilibrium in wind, maximum number of Newton iterations, increments of the drag up to its full size.
DRAG_RTOL, MAX_DRAG_ITERATIONS, INCREMENTS = 1e-12, 100, 4


@dataclass(frozen=True, eq=False)
class CondensedAir:
    """Air along the cable of a condensed model until `end_time` [s]."""

    model: CondensedModel
    air: CableAir
    end_time: float
    points: int | None = None  #: number of Gauss points; two more than the modes of a deflection by default
    longest_interval: float = math.inf  #: of the samples of the air in the chord frame, where the ends move [s]

    @cached_property
    def rule(self) -> tuple[np.ndarray, np.ndarray]:
        """Relative arc lengths and weights [m] of the Gauss points."""
        model = self.model
        count = max(model.n_in_plane, len(model.shapes) - model.n_in_plane) + EXTRA_POINTS
        nodes, weights = np.polynomial.legendre.leggauss(count if self.points is None else self.points)
        return 0.5 * (1.0 + nodes), 0.5 * model.chain.total_length * weights

    def at_points(self, values: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Interpolate values (r, particle), or a derivative of them by arc length, at the Gauss points (points, r)."""
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.model.chain.arc_length, values, axis=1)
        return spline(self.rule[0] * self.model.chain.total_length, derivative).T

    @cached_property
    def shapes(self) -> np.ndarray:
        """Shapes, their slopes and test functions at the points (3, points, r)."""
        model = self.model
        parts = (
            self.at_points(model.shapes), self.at_points(model.shapes, 1), self.at_points(model.test_functions),
        )  # fmt: skip
        return np.ascontiguousarray(np.stack(parts))

    @cached_property
    def _projection(self) -> np.ndarray:
        """Matrix from the velocity at the points of the air to that at the Gauss points.

        Integrals of the velocity times polynomials of a degree below the number of Gauss points are kept.  Single values would
        alias gusts that are shorter than the distance of these points.
        """
        nodes, weights = self.rule
        places = np.unique(np.concatenate([[0.0, 1.0], np.clip(self.air.sigma, 0.0, 1.0)]))
        inner, inner_weights = np.polynomial.legendre.leggauss(nodes.size)  # exact on each interval between two points
        width = np.diff(places)
        sigma = (places[:-1, None] + 0.5 * width[:, None] * (1.0 + inner)).ravel()
        parts = (0.5 * width[:, None] * inner_weights).ravel()
        lagrange = np.ones((nodes.size, sigma.size))
        for g, node in enumerate(nodes):
            for other in np.delete(nodes, g):
                lagrange[g] *= (sigma - other) / (node - other)
        hats = replace(self.air, velocity=np.eye(self.air.sigma.size)[:, :, None]).at(sigma)[:, :, 0]
        length = self.model.chain.total_length
        return (lagrange * parts) @ hats.T / (weights[:, None] / length)

    @cached_property
    def at_samples(self) -> tuple[np.ndarray, float]:
        """Velocity of the air at the Gauss points (samples, points, dims) [m/s], and its samples per second."""
        velocity = refined(np.tensordot(self.air.velocity, self._projection, (1, 1)).transpose(0, 2, 1))
        return velocity, self.air.samples_per_second * self.air.refinement

    @cached_property
    def _sampled(self) -> tuple[np.ndarray, float]:
        """Velocity of the air less that of the line between the ends, in the chord frame, and its samples per second.

        Along the chord and each normal: (samples, 1 + normals, points) [m/s].
        """
        p, sigma = self.model.chain.p, self.rule[0]
        velocity, rate = self.at_samples
        if p.motions:
            scale = min(p.shortest_time_scale / SAMPLES_PER_CHANGE, self.longest_interval)
            parts = max(1, math.ceil(1.0 / (rate * scale)))
            count = math.ceil(self.end_time * rate * parts) + 2
            place = np.minimum(np.arange(count) / parts, len(velocity) - 1.0)
            left = np.minimum(place.astype(int), len(velocity) - 2)
            share = (place - left)[:, None, None]
            velocity, rate = (1.0 - share) * velocity[left] + share * velocity[left + 1], rate * parts
            time = np.arange(count) / rate
            ends, rates = p.end_positions(time), p.end_positions(time, 1)
            velocity = velocity - (rates[:, :1] + sigma[:, None] * (rates[:, 1:] - rates[:, :1]))
            chord = ends[:, 1] - ends[:, 0]
        else:
            chord = np.diff(p.initial_ends, axis=0)
        frame = ChordFrame.of(chord, self.model.reference)
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
        place = np.clip(times * rate, 0.0, len(velocity) - 1.0)
        left = np.minimum(place.astype(int), len(velocity) - 2)
        share = (place - left)[:, None, None]
        return (1.0 - share) * velocity[left] + share * velocity[left + 1]

    @cached_property
    def in_mean_wind(self) -> CondensedAir:
        """The same points in the mean wind of the start."""
        result = replace(self, air=self.air.steady)
        result.__dict__.update(rule=self.rule, shapes=self.shapes, _projection=self._projection)
        return result

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Arguments of the kernel: wind, samples per second, drag, shapes."""
        return *self._sampled, self.air.drag * self.rule[1], self.shapes

    def acceleration(self, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the accelerations of the coordinates (r,) by the drag at the start."""
        from cablepod.condensed import _kernels_drag as kernel

        wind, _, drag, shapes = self.arguments
        model, f, exact = self.model, np.empty_like(q), None
        if model.order == "leading":
            stretch = model.initial_boundary_data[0] / model.chain.total_length
        else:
            stretch, exact = 1.0 + model.force(q, rates, model.initial_boundary_data)[2] / model.chain.p.stiffness, True
        kernel.drag_force(q, rates, stretch, exact, wind, 0.0, drag, *shapes, model.n_in_plane, f)
        return model.accelerations(f, q, rates) if model.inertia.size else f

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """Return initial coordinates and rates (r,), in equilibrium with the drag at the start unless a shape is given.

        Raises
        ------
        SceneError
            Where no equilibrium is found.
        """
        model = self.model
        q, rates = model.initial()
        if model.chain.p.initial:
            return q, rates
        static, still, mean = model.static_boundary_data, np.zeros_like(q), self.in_mean_wind
        for increment in range(1, INCREMENTS + 1):  # the deflection may change by more than itself, also in sign
            share, converged = increment / INCREMENTS, False
            for _ in range(MAX_DRAG_ITERATIONS):
                force, tangent, _ = model.force(q, still, static)
                try:
                    change = np.linalg.solve(tangent, force + share * mean.acceleration(q, still))
                except np.linalg.LinAlgError:
                    break
                q = q + change
                if not np.isfinite(q).all():
                    break
                if np.abs(change).max() <= DRAG_RTOL * np.abs(q).max():
                    converged = True
                    break
            if not converged:
                refuse_rest_in_wind()
        return q, rates
