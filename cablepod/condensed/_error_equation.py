"""Equation of the error of a motion, driven by its residual in an enriched condensed model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cablepod.condensed._coefficients import Coefficients
from cablepod.condensed._error_coefficients import (
    Cables,
    enriched_modes,
    scaled_terms,
    terms_of_model,
    unit_coefficients,
)
from cablepod.condensed._kernels_layout import Drive, ErrorTerms, runtime_sizes
from cablepod.condensed._newton import leading_forces, solve_each
from cablepod.condensed._reference_state import between_held_ends
from cablepod.discretisation._chain import LumpedChain

#: Maximum number of Newton iterations for the error at the start, and its tolerance: last correction over the error.
START_ITERATIONS, START_RTOL = 20, 1e-9
#: Number of values at points or links that are computed at a time: larger arrays are given back to the system and fetched anew
#: in each call, which takes longer than the products.
VALUES_AT_A_TIME = 10_000


def drive_of(terms: ErrorTerms, motion: Sequence[np.ndarray], rows: np.ndarray) -> Drive:
    """Compute what drives the errors of members.

    Parameters
    ----------
    terms
        Coefficients.
    motion
        Coordinates of the motion, rates and accelerations (members, samples, r).
    rows
        Boundary data of the samples (members, samples, columns).
    """
    samples, count = rows.shape[1], max(1, VALUES_AT_A_TIME // terms.weights.shape[1])
    if samples <= count:
        return _drive_of_part(terms, motion, rows)
    parts = [
        _drive_of_part(terms, [array[:, part] for array in motion], rows[:, part])
        for part in (slice(first, first + count) for first in range(0, samples, count))
    ]
    return Drive(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True)))


def _drive_of_part(terms: ErrorTerms, motion: Sequence[np.ndarray], rows: np.ndarray) -> Drive:
    """Return the same as :func:`drive_of`, for all samples at a time."""
    from cablepod.condensed import _kernels_error as kernel  # numba is imported only to compute

    q, rates, accelerations = motion
    (members, samples, r), (size, m) = q.shape, terms.slopes.shape[1:]
    accelerations = accelerations + terms.damping[:, None, None] * rates
    to_enriched = np.swapaxes(terms.change, 1, 2)
    y, difference = q @ to_enriched, -(accelerations @ to_enriched)
    planes = [slice(terms.in_plane)] if terms.in_plane == r else [slice(terms.in_plane), slice(terms.in_plane, r)]
    slopes = np.empty((3, members, len(planes), m, samples))
    for plane, which in enumerate(planes):
        for order, derivative in enumerate((q, rates, accelerations)):
            across = np.swapaxes(derivative[:, :, which], 1, 2)
            np.matmul(terms.slopes_of_motion[:, :, which], across, out=slopes[order, :, plane])
    along = rows[:, :, 1 : 1 + terms.force_patterns.shape[2]]
    force = terms.force_patterns @ np.swapaxes(along, 1, 2)
    slope, (stretch, compliance) = slopes[0], np.empty((2, *force.shape))
    sums, largest = np.empty((members, kernel.FLEXIBILITY + 1, samples)), np.empty((members, samples))
    with np.errstate(all="ignore"):  # an error that is not finite counts as infinite
        kernel.close_samples(
            terms.sizes, terms.enriched, terms.weights, terms.flexibility, terms.green, terms.leading, terms.corrections,
            np.ascontiguousarray(rows), y, (slope * slope).sum(axis=1), force, stretch, compliance, sums,
        )  # fmt: skip
        stretching, acceleration = compliance, np.empty_like(force)
        kernel.accelerate_stretch(slopes, stretch, stretching, acceleration)
        momentum = _chordwise_momentum(terms, acceleration)
        change = sums[:, kernel.TENSION_CHANGE]
        acting, of_force = slopes[1], np.zeros_like(change) if terms.leading else change
        kernel.act_on_slopes(terms.weights, of_force, force, stretch, momentum, slope, acting, largest)
    enriched = slice(terms.enriched_in_plane), slice(terms.enriched_in_plane, size)
    for plane, which in zip(range(len(planes)), enriched, strict=False):
        difference[:, :, which] -= np.swapaxes(acting[:, plane], 1, 2) @ np.swapaxes(terms.slopes[:, which], 1, 2)
    if not terms.leading:  # a motion with the exact closure has that tension in the difference
        difference += change[:, :, None] * terms.enriched.kappa[:, None] * y
    rows = rows.copy()
    rows[:, :, 0] += change / (terms.enriched.stiffness * terms.enriched.inverse_length)
    return Drive(rows, y, difference, largest)


def _chordwise_momentum(terms: ErrorTerms, rates: np.ndarray) -> np.ndarray:
    """Multiply rates of stretch at the points (members, m, samples) by the chordwise mass matrix [kg m^2]."""
    if terms.inertia.shape[1] != 2:  # full matrix, at quadrature points
        return terms.inertia @ rates
    from cablepod.condensed import _kernels_exact_closure as kernel  # numba is imported only to compute

    momentum = np.empty_like(rates)
    kernel.chordwise_momenta(rates, terms.weights, terms.inertia, momentum)
    return momentum


def errors_at_rest(terms: ErrorTerms, q: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the distances of members to the enriched equilibrium (members, R); zero where Newton's method finds none.

    Parameters
    ----------
    terms
        Coefficients.
    q, rows
        Coordinates at rest (members, r), and their boundary data (members, columns).
    """
    still = np.zeros_like(q[:, None])
    at_rest, y, difference, _ = (array[:, 0] for array in drive_of(terms, (q[:, None], still, still), rows[:, None]))

    def forces(error: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        force, tangent, _ = leading_forces(terms.enriched.take(part), at_rest[part], y[part] + error)
        return force + difference[part], tangent

    def is_found(change: np.ndarray, error: np.ndarray, part: np.ndarray) -> np.ndarray:
        return np.abs(change).max(axis=1) <= START_RTOL * np.abs(error).max(axis=1)

    errors, found = solve_each(np.zeros_like(y), forces, is_found, START_ITERATIONS)
    errors[~found] = 0.0
    return errors


@dataclass(frozen=True)
class LinkSlopes:
    """Slopes of the enriched shapes on the links of members."""

    slopes: np.ndarray  #: (members, R, n) [kg^-1/2 m^-1]
    length: np.ndarray  #: unstretched lengths of the links (..., n) [m]
    mass: np.ndarray  #: masses of the particles (..., n + 1) [kg]

    def chordwise_shares(self, error: np.ndarray, q: np.ndarray, in_plane: int) -> np.ndarray:
        """Return the mean squares of the chordwise displacement over those of the deflection (members,).

        `error` are errors at the enriched coordinates q (members, R), the first `in_plane` of them in plane; 0 without a finite
        error.
        """
        square = (error * error).sum(axis=1)
        is_finite = (square > 0.0) & (square < math.inf)
        error = np.where(is_finite[:, None], error, 0.0)
        stretch = np.zeros((len(q), self.slopes.shape[2]))
        for which in (slice(in_plane), slice(in_plane, None)):
            moved, wrong = ((part[:, None, which] @ self.slopes[:, which])[:, 0] for part in (q, error))
            stretch -= moved * wrong
        place = np.cumsum(self.length, axis=-1)
        along = between_held_ends(stretch * self.length, place / place[..., -1:])
        return (self.mass[..., 1:] * along**2).sum(axis=1) / np.where(is_finite, square, 1.0)


def mean_squares(
    terms: ErrorTerms,
    shapes: LinkSlopes,
    mass: float | np.ndarray,
    motion: Sequence[np.ndarray],
    rows: np.ndarray,
    interval: float,
    errors: np.ndarray,
    error_rates: np.ndarray,
) -> np.ndarray:
    """Integrate the error equations of members, driven by the residuals of their motions.

    Parameters
    ----------
    terms, shapes
        Coefficients, and slopes on the links.
    mass
        Masses of the cables, a number or (members, 1) [kg]: bounds of sums of squares over means over the length.
    motion, rows
        Coordinates of the motions, rates and accelerations (members, samples, r), and their boundary data.
    interval
        Interval of the samples [s].
    errors, error_rates
        Errors at the start, and their rates (members, R).

    Returns
    -------
    numpy.ndarray
        Mean squares of the errors over the length (members, samples) [m^2]: those of the deflection, with the part of the
        chordwise displacement that they have where they are largest; infinite where an error leaves the finite numbers.
    """
    from cablepod.condensed import _kernels_error as kernel  # numba is imported only to compute

    (members, samples, _), size, springs = rows.shape, errors.shape[1], terms.springs
    squares, largest = np.empty((members, samples)), np.zeros((members, size + 1))
    vectors = np.zeros((members, 8 + (0 if springs is None else springs.shape[1]), size + 2))
    vectors[:, 0, :size], vectors[:, 1, :size] = errors, error_rates
    for some, own in _parts_of_members(terms, samples):
        drive = drive_of(own, [array[some] for array in motion], rows[some])
        kernel.error_growth(
            own.sizes, own.enriched, own.damping, own.springs, interval, *drive, vectors[some], squares[some],
            largest[some],
        )  # fmt: skip
    squares /= mass
    squares[np.isnan(squares)] = math.inf
    error, furthest = largest[:, :-1], largest[:, -1].astype(int)
    at_largest = (terms.change @ motion[0][np.arange(members), furthest][:, :, None])[:, :, 0]
    return squares * (1.0 + shapes.chordwise_shares(error, at_largest, terms.enriched_in_plane)[:, None])


def _parts_of_members(terms: ErrorTerms, samples: int) -> Iterator[tuple[slice, ErrorTerms]]:
    """Divide members into parts whose values at the points fit into caches; yield their slices and coefficients."""
    members, points = terms.weights.shape
    count = max(1, VALUES_AT_A_TIME // (points * samples))
    for first in range(0, members, count):
        part = slice(first, first + count)
        arrays: dict[str, Any] = {
            name: value[part] for name, value in terms._asdict().items() if isinstance(value, np.ndarray)
        }
        yield part, terms._replace(enriched=terms.enriched.take(part), **arrays)


@dataclass(frozen=True)
class ErrorEquation:
    """Error equation of a motion in the enriched model of a chain."""

    chain: LumpedChain
    terms: ErrorTerms  #: of one member
    projection: np.ndarray  #: from deflections at the particles to enriched coordinates (R, particle) [kg^1/2]
    slopes: np.ndarray  #: slopes of the enriched shapes on the links (R, n)
    shapes: np.ndarray  #: enriched shapes (R, particle) [kg^-1/2]
    model: Coefficients | None = None  #: enriched model of a cable that is not uniform

    @classmethod
    def of(
        cls,
        chain: LumpedChain,
        sets: Sequence[np.ndarray],
        shapes: np.ndarray,
        in_plane: int,
        *,
        leading: bool,
        points: int = 0,
    ) -> ErrorEquation:
        """Prepare the equation for a motion on mass-orthonormal shapes.

        Parameters
        ----------
        chain
            Links and masses.
        sets
            Modes of each deflection (mode, particle), which the enriched model contains.
        shapes, in_plane
            Shapes of the coordinates of the motion (r, particle), and how many of them are in plane.
        leading
            Whether the motion obeys the closure to leading order.
        points
            Number of points of a Gauss rule for the residual; 0 for the links.
        """
        p, length = chain.p, chain.total_length
        unit, at = unit_coefficients(sets, chain.arc_length / length, p, points)
        shape = 1.0 / math.sqrt(p.mass * length)
        load = np.ones(len(unit.load_patterns))
        load[: load.size - len(p.point_loads)] = length  # point loads do not grow with the length
        projection = unit.shapes * unit.mass / shape
        change = projection @ shapes.T
        change[: unit.n_in_plane, in_plane:] = change[unit.n_in_plane :, :in_plane] = 0.0
        numbers = (p.stiffness, p.mass, p.damping, length)
        cables = Cables(*(np.array([number], dtype=float) for number in numbers))
        terms = scaled_terms(unit, at, cables, load[None], change[None], in_plane, leading=leading, green=chain.green)
        return cls(chain, terms, projection, (shape / length) * unit.slopes, shape * unit.shapes)

    @classmethod
    def of_nonuniform(cls, model: Coefficients) -> ErrorEquation:
        """Prepare the equation for a motion to leading order of a cable with segments or attachments, on its links."""
        chain = model.chain
        kinks = sorted({round(place, 9) for place in chain.attached_fractions})
        bases = enriched_modes(model.modes, chain.arc_length / chain.total_length, chain.mass, kinks)
        enriched = Coefficients(chain, "inertial", bases, body_loads=model.body_loads)
        projection = enriched.shapes * chain.mass
        change = projection @ model.shapes.T
        change[: enriched.n_in_plane, model.n_in_plane :] = change[enriched.n_in_plane :, : model.n_in_plane] = 0.0
        terms = terms_of_model(enriched, change, model.n_in_plane)
        return cls(chain, terms, projection, enriched.slopes, enriched.shapes, enriched)

    @property
    def least_mass(self) -> float:
        """Unstretched length times the least mass per length [kg]; sums of squares over it bound mean squares over the length."""
        p = self.chain.p
        return min([p.mass, *(segment.mass for segment in p.segments)]) * self.chain.total_length

    @property
    def change(self) -> np.ndarray:
        """Matrix from the coordinates of the motion to the enriched ones (R, r)."""
        return self.terms.change[0]

    @property
    def enriched_in_plane(self) -> int:
        """Number of in-plane coordinates of the enriched model."""
        return self.terms.enriched_in_plane

    def with_forces(self, damping: float = 0.0) -> ErrorEquation:
        """Return the equation with further forces on the enriched coordinates and further damping of the error [1/s].

        The forces (R) are further columns of the boundary data.
        """
        terms, size = self.terms, len(self.change)
        loads = np.concatenate([terms.enriched.load_projection, np.eye(size).reshape(1, -1)], axis=1)
        terms = terms._replace(
            sizes=runtime_sizes(size, len(terms.sizes.patterns), loads.size // size),
            enriched=terms.enriched._replace(load_projection=loads),
            damping=terms.damping + damping,
        )
        return replace(self, terms=terms)

    def coordinates(self, deflection: np.ndarray) -> np.ndarray:
        """Project deflections (normals, particle) [m] onto the enriched coordinates (R,)."""
        in_plane = self.enriched_in_plane
        parts = [self.projection[:in_plane] @ deflection[0]]
        parts += [self.projection[in_plane:] @ part for part in deflection[1:]]
        return np.concatenate(parts)

    def error_at_rest(self, q: np.ndarray, static_boundary_data: np.ndarray) -> np.ndarray:
        """Return the distance to the enriched equilibrium from coordinates (r,); zero where Newton's method finds none."""
        return errors_at_rest(self.terms, q[None], static_boundary_data[None])[0]

    def mean_squares(
        self,
        motion: tuple[np.ndarray, np.ndarray, np.ndarray],
        boundary_data: np.ndarray,
        interval: float,
        initial_error: np.ndarray,
        initial_rate: np.ndarray,
    ) -> np.ndarray:
        """Integrate the equation, driven by the residual of the motion.

        Parameters
        ----------
        motion
            Coordinates of the motion, rates and accelerations (samples, r).
        boundary_data
            Those of the samples.
        interval
            Interval of the samples [s].
        initial_error, initial_rate
            Error at the start, and its rate (R,).

        Returns
        -------
        numpy.ndarray
            Mean square of the error over the length (samples,) [m^2], see :func:`mean_squares`.
        """
        chain, (q, rates, accelerations) = self.chain, motion
        arrays = (q, rates, accelerations, boundary_data, initial_error, initial_rate, self.slopes)
        *of_motion, rows, error, error_rate, slopes = (array[None] for array in arrays)
        shapes = LinkSlopes(slopes, chain.length, chain.p.mass * chain.tributary_length)
        return mean_squares(self.terms, shapes, self.least_mass, of_motion, rows, interval, error, error_rate)[0]
