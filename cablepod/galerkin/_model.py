"""Galerkin model of a cable: masses, loads, strain energy and its derivatives in modal amplitudes, eqs. (34)-(36)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cablepod.chain._start import start
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._formulas import green_secant
from cablepod.discretisation._laws import law_tension, taut_secant
from cablepod.discretisation._lifting import line_between, weights_of_ends
from cablepod.parameters._time_functions import TimeFunction
from cablepod.reduced._validity import check_independent

#: Number of instants whose mean is the mean of ends and loads.
MEAN_INSTANTS = 201
#: Number of monomials that vectors of the processor take together.
PADDING = 8


@dataclass(frozen=True, eq=False)
class GalerkinModel:
    """Galerkin projection of a lumped-mass chain on modes.

    The coordinates y are the mass-orthonormal amplitudes q, followed by the displacements d of the moving ends.  Positions
    are shape + sum y_k field_k on the particles of the modes.  Links and masses are those of a chain on these particles.
    """

    chain: LumpedChain  #: with the law of the model
    mean: np.ndarray  #: (particle, dims) [m]
    modes: np.ndarray  #: as given (modes, particle, dims)
    layout: str

    @cached_property
    def sigma(self) -> np.ndarray:
        """Relative arc length of the particles."""
        return self.chain.arc_length / self.chain.total_length

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses of the free particles (n - 1,) [kg]."""
        return self.chain.p.mass * self.chain.tributary_length[1:-1]

    @cached_property
    def mass_cholesky(self) -> np.ndarray:
        """Lower Cholesky factor of the mass matrix of the modes (modes, modes) [kg^1/2]."""
        inner = self.modes[:, 1:-1]
        products = np.einsum("ipc,p,kpc->ik", inner, self.mass, inner)
        check_independent(products)
        return np.linalg.cholesky(products)

    @cached_property
    def amplitudes_of_orthonormal(self) -> np.ndarray:
        """Matrix (modes, modes) from mass-orthonormal amplitudes, in rows, to those of the modes as given [kg^-1/2]."""
        from scipy.linalg import solve_triangular  # costly to import

        return solve_triangular(self.mass_cholesky, np.eye(len(self.modes)), lower=True)

    @cached_property
    def fields(self) -> np.ndarray:
        """Mass-orthonormal modes (modes, particle, dims) [kg^-1/2]."""
        from scipy.linalg import solve_triangular  # costly to import

        flat = solve_triangular(self.mass_cholesky, self.modes.reshape(len(self.modes), -1), lower=True)
        return flat.reshape(self.modes.shape)

    @cached_property
    def moving(self) -> tuple[tuple[str, str], ...]:
        """Moving coordinates of the ends, as (end, axis)."""
        return tuple(self.chain.p.motions)

    @cached_property
    def lifts(self) -> np.ndarray:
        """Lifting fields of the displacements of the ends (moving, particle, dims)."""
        result = np.zeros((len(self.moving), self.sigma.size, self.chain.p.dims))
        for lift, (end, axis) in zip(result, self.moving, strict=True):
            lift[:, COORDINATES.index(axis)] = weights_of_ends(self.sigma)[ENDS.index(end)]
        return result

    @cached_property
    def shape(self) -> np.ndarray:
        """Positions in the mean shape between the undisplaced ends (particle, dims) [m]."""
        return line_between(np.array([self.chain.p.lower, self.chain.p.upper]), self.sigma) + self.mean

    @cached_property
    def coupling(self) -> np.ndarray:
        """Mass coupling of the lifting fields to the modes (moving, modes) [kg^1/2]."""
        return np.einsum("fpc,p,kpc->fk", self.lifts[:, 1:-1], self.mass, self.fields[:, 1:-1])

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Slopes of the links d/dS: of the shape (n, dims), of the fields (coordinates, n, dims)."""
        length = self.chain.length[:, None]
        fields = np.concatenate([self.fields, self.lifts])
        return np.diff(self.shape, axis=0) / length, np.diff(fields, axis=1) / length

    @cached_property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Index pairs of the coordinates whose product occurs in the strain, because they share an axis."""
        first, second = np.triu_indices(len(self.active_axes))
        common = (self.active_axes[first] & self.active_axes[second]).any(axis=1)
        return first[common], second[common]

    @cached_property
    def active_axes(self) -> np.ndarray:
        """Mask of the axes along which each coordinate displaces the cable (coordinates, dims)."""
        return np.ascontiguousarray(np.abs(self.slopes[1]).max(axis=1) > 0.0)

    @cached_property
    def strain(self) -> np.ndarray:
        """Strain (xi^2 - 1)/2 of the links in the mean shape (n,)."""
        length = self.chain.length
        stretched = np.sqrt(np.sum(np.diff(self.shape, axis=0) ** 2, axis=1))
        return 0.5 * (stretched - length) / length * (stretched + length) / length

    @cached_property
    def polynomial_form(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Energy of law (21) as a polynomial: factor R (rows, monomials), offset e (rows,), index pairs of the monomials."""
        shape, fields = self.slopes
        first, second = self.pairs
        # strain (xi^2 - 1)/2 about the mean shape, which avoids cancellation
        linear = np.einsum("jc,kjc->jk", shape, fields)
        quadratic = np.einsum("pjc,pjc->jp", fields[first], fields[second]) * np.where(first == second, 0.5, 1.0)
        weight = np.sqrt(self.chain.p.stiffness * self.chain.length)[:, None]
        table = weight * np.concatenate([linear, quadratic, self.strain[:, None]], axis=1)
        triangle: Any = np.linalg.qr(table, mode="r")
        factor = triangle[: table.shape[1] - 1]  # a last row would only add a constant to the energy
        return np.ascontiguousarray(factor[:, :-1]), np.ascontiguousarray(factor[:, -1]), first, second

    @cached_property
    def gram_form(self) -> tuple[np.ndarray, np.ndarray]:
        """Products R^T R (monomials, monomials) and R^T e (monomials,) of the polynomial form, for its gradient.

        Zeros fill them up to a multiple of PADDING, which vectors of the processor need.
        """
        factor, offset, _, _ = self.polynomial_form
        padded = np.zeros((len(factor), -(-factor.shape[1] // PADDING) * PADDING))
        padded[:, : factor.shape[1]] = factor
        return padded.T @ padded, padded.T @ offset

    @cached_property
    def link_form(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Energy as a sum over links: slopes of shape and fields, strain of the shape, active axes, K l [N m]."""
        shape, fields = self.slopes
        k = self.chain.p.stiffness * self.chain.length
        return (
            np.ascontiguousarray(shape.T),
            self.strain,
            np.ascontiguousarray(np.moveaxis(fields, 1, 2)),
            self.active_axes,
            k,
        )

    @cached_property
    def rms_root(self) -> np.ndarray:
        """Matrix (coordinates, coordinates) W: the norm of (z, d) W is the rms displacement of the particles [m].

        The projections z = q + C^T d are followed by the displacements d of the ends.
        """
        flat = self.fields_of_projections.reshape(len(self.fields_of_projections), -1)
        squared, vectors = np.linalg.eigh(flat @ flat.T / self.sigma.size)
        return vectors * np.sqrt(np.maximum(squared, 0.0))

    @cached_property
    def fields_of_projections(self) -> np.ndarray:
        """Fields of the projections z = q + C^T d, then of the displacements d (coordinates, particle, dims)."""
        relative = self.lifts - np.tensordot(self.coupling, self.fields, axes=1)
        return np.concatenate([self.fields, relative])

    @property
    def modes_per_coordinate(self) -> int:
        """Number of modes of each coordinate if they are separate, otherwise of all."""
        return len(self.modes) // (self.chain.p.dims if self.layout == "separate" else 1)

    @cached_property
    def rms_slopes(self) -> np.ndarray:
        """Root mean square over the links of the slope of each mode (modes,) [kg^-1/2 m^-1]."""
        return np.sqrt(np.mean(np.sum(self.slopes[1][: len(self.modes)] ** 2, axis=2), axis=1))

    def loads_at_steps(self, start: int, steps: int, steps_per_second: float) -> np.ndarray:
        """Generalised loads (steps + 1, modes) at the steps from `start` on; one row if they are constant."""
        total, varying = self._generalised_loads
        for pattern, factor in varying:
            total = total + factor.at_steps(start, steps, steps_per_second)[:, None] * pattern
        return total

    @cached_property
    def _generalised_loads(self) -> tuple[np.ndarray, list[tuple[np.ndarray, TimeFunction]]]:
        """Constant generalised loads (1, modes), and patterns (modes,) of time-dependent ones with their factors."""
        varying = [
            (np.einsum("pc,kpc->k", pattern, self.fields), factor)
            for pattern, factor in self.chain.time_dependent_loads()
        ]
        return np.einsum("pc,kpc->k", self.chain.loads(), self.fields)[None], varying

    def displacements_at_steps(self, start: int, steps: int, steps_per_second: float) -> np.ndarray:
        """Displacements of the moving ends (steps + 1, moving) [m] at the steps from `start` on."""
        return self.motions_at_steps(start, steps, steps_per_second, (0,))[0]

    def motions_at_steps(
        self, start: int, steps: int, steps_per_second: float, derivatives: tuple[int, ...]
    ) -> np.ndarray:
        """Time derivatives of the displacements of the moving ends (derivatives, steps + 1, moving) from `start` on."""
        result = np.empty((len(derivatives), steps + 1, len(self.moving)))
        for k, key in enumerate(self.moving):
            result[:, :, k] = self.chain.p.motions[key].all_at_steps(start, steps, steps_per_second, derivatives)
        return result

    def displacements(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Displacements of the moving ends (time, moving) [m], or their time derivatives."""
        time = np.asarray(time, dtype=float)
        columns = [self.chain.p.motions[key](time, derivative) for key in self.moving]
        return np.stack(columns, axis=1) if columns else np.zeros((time.size, 0))

    @cached_property
    def initial_displacements(self) -> np.ndarray:
        """Displacements of the moving ends at the start (moving,) [m]."""
        return self.displacements(np.zeros(1))[0]

    @cached_property
    def field_products(self) -> np.ndarray:
        """Scalar products of the slopes of each two modes on each link (n, modes, modes)."""
        modal = np.moveaxis(self.slopes[1][: len(self.modes)], 0, 1)
        return modal @ modal.swapaxes(1, 2)

    def gradients(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradients (states, modes) and Hessians (states, modes, modes) of the strain energy by the amplitudes."""
        shape, fields = self.slopes
        stiffness = self.chain.p.stiffness * self.chain.length
        slopes = shape + (y @ fields.reshape(len(fields), -1)).reshape(-1, *shape.shape)
        axes, modal = range(shape.shape[1]), fields[: len(self.modes)]
        # axis by axis, as einsum loops over the axes innermost
        square = sum(slopes[:, :, c] ** 2 for c in axes)
        along = sum(slopes[:, None, :, c] * modal[:, :, c] for c in axes)
        if self.chain.green:
            s, ds = green_secant(square, stiffness), stiffness
        else:
            xi = np.sqrt(square)
            s, ds = taut_secant(xi, 1.0, stiffness), np.where(xi > 1.0, stiffness / xi**3, 0.0)
        products = self.field_products
        hessian = (s @ products.reshape(len(products), -1)).reshape(-1, *products.shape[1:])
        hessian += (along * (ds if ds.ndim == 1 else ds[:, None])) @ along.swapaxes(1, 2)
        return (along @ s[..., None])[..., 0], hessian

    def gradient(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (modes,) and Hessian (modes, modes) of the strain energy with respect to the amplitudes."""
        gradients, hessians = self.gradients(y[None])
        return gradients[0], hessians[0]

    def vibrations(self, q: np.ndarray, displacements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared angular frequencies (modes,) [1/s^2] and shapes (amplitudes, modes) of small vibrations about a state.

        `q` are its amplitudes, `displacements` those of its ends (moving,) [m].
        """
        squared, shapes = np.linalg.eigh(self.gradient(np.concatenate([q, displacements]))[1])
        return squared, shapes

    @cached_property
    def initial_vibrations(self) -> tuple[np.ndarray, np.ndarray]:
        """Small vibrations about the start, see :meth:`vibrations`."""
        return self.vibrations(self.initial, self.initial_displacements)

    @cached_property
    def initial(self) -> np.ndarray:
        """Initial amplitudes (modes,): equilibrium of the model, or projection of the scene's initial shape."""
        p, ends = self.chain.p, self.initial_displacements
        lifting = np.tensordot(ends, self.lifts, axes=1)
        offset = start(self.chain) - self.shape - lifting
        q = np.einsum("pc,p,kpc->k", offset[1:-1], self.mass, self.fields[:, 1:-1])
        if p.initial:
            return q
        load = np.einsum("pc,kpc->k", self.chain.loads(0.0), self.fields)
        return _equilibrium(lambda q: self.gradient(np.concatenate([q, ends])), load, q, self._floor)

    @cached_property
    def initial_gradient(self) -> np.ndarray:
        """Gradient (modes,) of the strain energy at the start."""
        return self.gradient(np.concatenate([self.initial, self.initial_displacements]))[0]

    def mean_vibrations(self, end_time: float) -> tuple[np.ndarray, np.ndarray]:
        """Small vibrations about the equilibrium of ends and loads at their means until `end_time` [s], see :meth:`vibrations`.

        Those about the start where there is no such equilibrium, or where it is unstable.
        """
        if end_time not in self._mean_vibrations:
            times = np.linspace(0.0, end_time, MEAN_INSTANTS)
            ends = self.displacements(times).mean(axis=0)
            total, varying = self._generalised_loads
            load = total[0] + sum(float(factor(times).mean()) * pattern for pattern, factor in varying)
            rest = _equilibrium(lambda q: self.gradient(np.concatenate([q, ends])), load, self.initial, self._floor)
            # the start itself is what Newton's method returns where it fails
            found = self.initial_vibrations if rest is self.initial else self.vibrations(rest, ends)
            self._mean_vibrations[end_time] = found if found[0][0] > 0.0 else self.initial_vibrations
        return self._mean_vibrations[end_time]

    @cached_property
    def _mean_vibrations(self) -> dict[float, tuple[np.ndarray, np.ndarray]]:
        return {}

    @cached_property
    def _floor(self) -> float:
        """Amplitude that Newton corrections are compared with beside the largest one [kg^1/2 m]."""
        return 1e-6 * math.sqrt(self.mass.sum()) * self.chain.total_length

    def tension(self, position: np.ndarray) -> np.ndarray:
        """Tensions of the links (..., n) [N] by the law of the model."""
        green = self.chain.green
        tension = law_tension(self.chain.stretch(position), self.chain.p.stiffness, green=green)
        return tension if green else np.maximum(tension, 0.0)

    def positions(self, q: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Positions (time, particle, dims) [m] from amplitudes (time, modes)."""
        ends = self.chain.p.end_positions(time)
        # the summation order of a matrix product would depend on the number of instants
        position = np.einsum("tk,kp->tp", np.concatenate([q, ends.reshape(time.size, -1)], axis=1), self._composition)
        position = position.reshape(time.size, *self.mean.shape)
        position += self.mean
        position[:, [0, -1]] = ends  # exactly, without rounding errors of sigma
        return position

    @cached_property
    def _composition(self) -> np.ndarray:
        """Fields of the amplitudes, then of both ends along each axis (modes + 2 dims, particle dims)."""
        dims = self.chain.p.dims
        lines = np.einsum("ep,cd->ecpd", weights_of_ends(self.sigma), np.eye(dims))
        return np.concatenate([self.fields.reshape(len(self.modes), -1), lines.reshape(2 * dims, -1)])

    def velocities(self, rates: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Velocities (time, particle, dims) [m/s] from the rates of the amplitudes (time, modes)."""
        moving = np.tensordot(self.displacements(time, 1), self.lifts, axes=1)
        return np.tensordot(rates, self.fields, axes=1) + moving


def _equilibrium(
    gradient: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], load: np.ndarray, q: np.ndarray, floor: float
) -> np.ndarray:
    """Find the equilibrium amplitudes (modes,) by Newton's method, starting at the projection `q`.

    Corrections are relative to the largest amplitude plus `floor` [kg^1/2 m].  If the Hessian is singular or Newton's method
    does not converge (a locked or slack model), `q` itself is returned.
    """
    iterate = q
    last = math.inf
    for _ in range(50):
        slope, hessian = gradient(iterate)
        try:
            correction = np.linalg.solve(hessian, load - slope)
        except np.linalg.LinAlgError:
            return q
        norm = float(np.abs(correction).max())
        if not norm < last and last < 1e-6 * (float(np.abs(q).max()) + floor):
            return iterate  # rounding: corrections decrease no further
        iterate = iterate + correction
        if norm == 0.0:
            return iterate
        last = norm
    return iterate if last <= 1e-9 * (float(np.abs(q).max()) + floor) else q
