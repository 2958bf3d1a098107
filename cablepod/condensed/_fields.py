"""Positions, velocities and tensions of a condensed trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cablepod.condensed._kernels_layout import CLOSURE_ROWS
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._formulas import closure_tension, green_tangent_along, linear_tangent_along
from cablepod.discretisation._laws import law_tension
from cablepod.integrate._means import Means, means, wants_means
from cablepod.integrate._output import Extremes
from cablepod.integrate._output_times import OutputTimes

#: Chordwise stretch, chordwise force [N], squared slopes (times, n) and deflections (normals, times, particle) [m].
ClosedChord = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass
class CondensedTrajectory:
    """Saved states of one run, and its diagnostics."""

    instants: OutputTimes
    saved: np.ndarray  #: coordinates at the saved steps (steps, r)
    half_step_rates: np.ndarray  #: rates half a step before and after (steps, 2, r)
    extremes: Extremes  #: minimum and maximum of the link tensions (n,) [N]
    monitor: np.ndarray  #: extremes of the run, rows as in ``_kernels_layout``
    scheme: str
    sample_interval: int = 0  #: number of steps between the samples of the error estimate, all saved; 0 without samples
    boundary_data: np.ndarray | None = None  #: boundary data of the saved steps (steps, columns); None where not kept
    peak_times: tuple[float, float] | None = None  #: of the smallest and the largest tension [s]; None if not requested
    window: tuple[float, float] | None = None  #: part of the run of extremes and means [s]; None for all
    #: Result of :func:`close_chord_of` at the instants of the output; None where it was not computed yet
    closed: ClosedChord | None = None
    means: Means = None  #: of the tensions; None where they were not computed yet

    @cached_property
    def samples(self) -> slice | np.ndarray:
        """Rows of the saved steps that are samples of the error estimate."""
        remainder = self.instants.steps % self.sample_interval
        return np.flatnonzero(remainder == 0) if remainder.any() else slice(None)

    @cached_property
    def q(self) -> np.ndarray:
        """Coordinates at the instants of the output (times, r)."""
        if not self.instants.needs_interpolation:
            return self.saved[self.instants.left]
        return self.instants.at_times(self.saved, self.saved_rates, self.saved_accelerations)

    def only(self, times: np.ndarray) -> CondensedTrajectory:
        """Return the trajectory at some of its instants [s]."""
        if times.size == self.instants.times.size:
            return self
        rows = np.isin(self.instants.times, times)
        closed = self.closed
        if closed is not None:
            closed = closed[0][rows], closed[1][rows], closed[2][rows], closed[3][:, rows]
        return replace(self, instants=self.instants.only(times), closed=closed)

    @property
    def saved_rates(self) -> np.ndarray:
        """Rates of the coordinates at the saved steps (steps, r)."""
        return 0.5 * (self.half_step_rates[:, 0] + self.half_step_rates[:, 1])

    @property
    def saved_accelerations(self) -> np.ndarray:
        """Accelerations of the coordinates at the saved steps (steps, r)."""
        return (self.half_step_rates[:, 1] - self.half_step_rates[:, 0]) * self.instants.steps_per_second

    @property
    def rates(self) -> np.ndarray:
        """Rates of the coordinates at the instants of the output (times, r)."""
        v = self.saved_rates
        i, s = self.instants.left, self.instants.fraction[:, None]
        after = np.minimum(i + 1, len(v) - 1)
        return np.where(s > 0, (1 - s) * v[i] + s * v[after], v[i])


def boundary_data_of(model: CondensedModel, state: CondensedTrajectory, ends: np.ndarray) -> np.ndarray:
    """Return the boundary data at the instants of the output (times, columns), between steps for given `ends`."""
    instants = state.instants
    if instants.needs_interpolation:
        return model.boundary_data_at(instants.times, ends)
    if state.boundary_data is None:  # at the steps' own instants, which may differ from those asked for in the last bit
        return model.boundary_data_at(instants.steps[instants.left] / instants.steps_per_second)
    return state.boundary_data[instants.left]


def close_chord_of(model: CondensedModel, q: np.ndarray, boundary_data: np.ndarray) -> ClosedChord:
    """Return chordwise stretch, force, squared slopes and deflections.

    `q` are coordinates (times, r), and `boundary_data` those of the instants (times, columns).
    """
    chain = model.chain
    deflection, squared = deflections(model.shapes, model.sets, chain.length, q)
    stretch, force = close(model, squared, q[0], boundary_data)
    return stretch, force, squared, deflection


def close(
    model: CondensedModel, squared: np.ndarray, q: np.ndarray, boundary_data: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the closure of a model's order for given shapes on the links.

    Parameters
    ----------
    model
        Model, whose closure it is.
    squared
        Squared slopes (times, n).
    q
        Coordinates at the first time (r,), for a guess.
    boundary_data
        Of the instants (times, columns).

    Returns
    -------
    tuple of numpy.ndarray
        Chordwise stretch, and chordwise force [N], on the links (times, n); with orders "exact" and "inertial" the force is nan
        where there is none.
    """
    chain, patterns, chord = model.chain, model.chordwise_force_patterns, boundary_data[:, 0].copy()
    tau, k = boundary_data[:, 1 : 1 + len(patterns)] @ patterns, chain.p.stiffness
    if model.order == "leading":
        reduced, compliance = squared * model.slope_factor, relative_compliance(chain)
        chord_tension, stretch = close_leading(reduced, tau, chain.length, chord, k, compliance)
    else:
        guess = model.tension_guess(boundary_data[0], q), model.stretch_guess(boundary_data[0])
        chord_tension, stretch = close_exactly(squared, tau, chain.length, chord, k, model.green, guess)
    return stretch, chord_tension[:, None] + tau


def close_exactly(
    squared: np.ndarray,
    tau: np.ndarray,
    length: np.ndarray,
    chord: np.ndarray,
    stiffness: float,
    green: bool,
    guess: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the exact closure for shapes at many times, from one to the next; return H (times,) [N], stretch (times, n).

    Where Newton's method fails, H is searched by halving from no guess; where that finds none either, it is nan.

    Parameters
    ----------
    squared, tau
        Squared slopes, and chordwise forces of the loads [N], (times, n).
    length, chord
        Unstretched lengths of the links (n,) and distances of the ends (times,) [m].
    stiffness, green
        K [N], and whether law (21) holds.
    guess
        First guess of H [N] and of the chordwise stretch.
    """
    from cablepod.condensed import _kernels_exact_closure as kernel  # numba is imported only to compute

    chord_tension, stretch = np.empty(len(squared)), np.empty_like(squared)
    chord_tension[0], stretch[0] = guess
    i, last, law, work = 0, -1, green or None, np.empty((CLOSURE_ROWS, length.size))
    while True:
        i, last = kernel.close_all(squared, tau, length, chord, stiffness, law, i, last, work, chord_tension, stretch)
        if i == len(chord):
            return chord_tension, stretch
        chord_tension[i] = kernel.close_from_nothing(length, chord[i], stiffness, law, tau[i], squared[i], stretch[i])
        i, last = i + 1, i if math.isfinite(chord_tension[i]) else last


def deflections(
    shapes: np.ndarray, sets: Sequence[slice], length: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sum shapes to deflections w = q . shapes; return them, and their squared slopes w'^2, summed over the normals.

    All arrays may have leading dimensions of members.

    Parameters
    ----------
    shapes, sets
        Shapes (r, particle), and slices of them for each normal.
    length
        Unstretched lengths of the links (n,) [m].
    q
        Coordinates (times, r).

    Returns
    -------
    tuple of numpy.ndarray
        Deflections (normals, times, particle) [m], the normals before the members; squared slopes (times, n).
    """
    deflection = np.empty((len(sets), *q.shape[:-1], shapes.shape[-1]))
    for w, which in zip(deflection, sets, strict=True):
        np.matmul(q[..., which], shapes[..., which, :], out=w)
    slope = np.diff(deflection)
    slope /= length[..., None, :]
    slope *= slope
    return deflection, slope[0] if len(sets) == 1 else slope.sum(axis=0)


def relative_compliance(chain: LumpedChain) -> np.ndarray | None:
    """Return the stiffness under one tension over that of each link (n,); None where the cable has one stiffness."""
    return np.asarray(chain.p.stiffness / chain.axial_stiffness) if chain.p.segments else None


def close_leading(
    squared: np.ndarray,
    tau: np.ndarray,
    length: np.ndarray,
    chord: np.ndarray,
    stiffness: float | np.ndarray,
    compliance: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Close the chord to leading order, with zeta' = 1 + (H + tau) / K - w'^2 / 2.

    All arrays may have leading dimensions of members.

    Parameters
    ----------
    squared, tau
        Squared slopes, and chordwise forces of the loads [N] (times, n).
    length, chord, stiffness
        Unstretched lengths of the links (n,) [m], distance of the ends (times,) [m], axial stiffness K, a number or (1,) [N]; of
        a cable of several segments that under one tension.
    compliance
        See :func:`relative_compliance`.

    Returns
    -------
    tuple of numpy.ndarray
        H (times,) [N] and chordwise stretch zeta' (times, n).
    """
    total = length.sum(axis=-1, keepdims=True)
    share = (length / total)[..., None]
    load = (tau @ (share if compliance is None else share * compliance[:, None]))[..., 0]
    tension = closure_tension(stiffness, chord / total, load, 0.5 * stiffness * (squared @ share)[..., 0])
    stretch = (tension[..., None] + tau) / np.asarray(stiffness)[..., None]
    if compliance is not None:
        stretch *= compliance
    stretch -= 0.5 * squared
    stretch += 1.0
    return tension, stretch


def close_outputs(
    model: CondensedModel, state: CondensedTrajectory, outputs: tuple[str, ...] = (), links: np.ndarray | None = None
) -> float | None:
    """Close the chord of a trajectory at the instants of the output, and compute the means that are among `outputs`.

    Both are kept in `state`.

    Returns
    -------
    float or None
        First instant at which the chord does not close [s]; None where it always does.
    """
    times = state.instants.times
    state.closed = close_chord_of(model, state.q, boundary_data_of(model, state, model.chain.p.end_positions(times)))
    opened = times[~np.isfinite(state.closed[1]).all(axis=1)].tolist()
    if wants_means(outputs):
        state.means = tension_means(model, state, links, opened)
    return min(opened, default=None)


def positions(model: CondensedModel, q: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return positions of the particles (times, particle, dims) [m] for coordinates (times, r)."""
    ends = model.chain.p.end_positions(times)
    stretch, _, _, deflection = close_chord_of(model, q, model.boundary_data_at(times, ends))
    return positions_of(model, stretch, deflection, ends)


def positions_of(model: CondensedModel, stretch: np.ndarray, deflection: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return positions (times, particle, dims) [m] for chordwise stretch (times, n), deflections and positions of the ends."""
    along = running_sum(stretch * model.chain.length)
    return joined(ends, model.reference, along, deflection)


def joined(ends: np.ndarray, reference: np.ndarray, along: np.ndarray, deflection: np.ndarray) -> np.ndarray:
    """Return positions (times, particle, dims) [m] from distances along the chord and deflections [m].

    Raises
    ------
    SceneError
        Where there is no chord frame at some instant.
    """
    position = ChordFrame.of(ends[:, 1] - ends[:, 0], reference).join(ends[:, 0], along, deflection)
    position[:, -1] = ends[:, 1]  # free of rounding, and of modes that are not exactly zero there
    return position


def running_sum(parts: np.ndarray) -> np.ndarray:
    """Sum parts of the links (..., n) up to each particle (..., n + 1)."""
    result = np.zeros((*parts.shape[:-1], parts.shape[-1] + 1))
    np.cumsum(parts, axis=-1, out=result[..., 1:])
    return result


def stretch_derivatives(
    model: CondensedModel, stretch: np.ndarray, squared: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives of the chordwise stretch (times, n) by N / K, and by minus half the squared slope."""
    if model.order == "leading":
        compliance = relative_compliance(model.chain)
        by_force = np.ones(model.chain.links) if compliance is None else compliance
        return by_force, np.broadcast_to(model.slope_factor, stretch.shape)
    if model.green:
        by_force = 1.0 / green_tangent_along(squared, stretch)
        return by_force, by_force * stretch
    inverse = 1.0 / np.sqrt(stretch * stretch + squared)
    by_force = 1.0 / linear_tangent_along(squared, inverse)
    return by_force, by_force * stretch * inverse**3


def velocities(
    model: CondensedModel, stretch: np.ndarray, deflection: np.ndarray, rates: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Return velocities (times, particle, dims) [m/s], without the rate of stretch by time-dependent loads."""
    chain, p = model.chain, model.chain.p
    ends, end_velocities = p.end_positions(times), p.end_positions(times, 1)
    reach, reach_rate = ends[:, 1] - ends[:, 0], end_velocities[:, 1] - end_velocities[:, 0]
    frame = ChordFrame.of(reach, model.reference)
    chord_rate, direction_rate, normal_rates = frame.rates(reach, reach_rate)
    deflection_rate = np.stack([rates[:, which] @ model.shapes[which] for which in model.sets])
    slope, slope_rate = (np.diff(field, axis=2) / chain.length for field in (deflection, deflection_rate))
    compliance, jacobian = stretch_derivatives(model, stretch, (slope * slope).sum(axis=0))
    stretch_rate = -jacobian * (slope * slope_rate).sum(axis=0)
    stretch_rate += compliance * ((chord_rate - stretch_rate @ chain.length) / (compliance @ chain.length))[:, None]
    along, along_rate = running_sum(stretch * chain.length), running_sum(stretch_rate * chain.length)
    velocity = (
        end_velocities[:, :1]
        + along_rate[:, :, None] * frame.along[:, None]
        + along[:, :, None] * direction_rate[:, None]
    )
    velocity = (
        velocity
        + np.einsum("ktp,tkc->tpc", deflection_rate, frame.normals)
        + np.einsum("ktp,tkc->tpc", deflection, normal_rates)
    )
    velocity[:, -1] = end_velocities[:, 1]
    return velocity


def link_tensions(model: CondensedModel, stretch: np.ndarray, force: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """Return link tensions (times, n) [N] for chordwise stretch, chordwise force [N] and squared slopes."""
    if model.order == "leading":
        return force * np.sqrt(1.0 + squared)
    return law_tension(np.sqrt(stretch * stretch + squared), model.chain.p.stiffness, green=model.green)


def selected_tensions(model: CondensedModel, q: np.ndarray, times: np.ndarray, links: np.ndarray | None) -> np.ndarray:
    """Return tensions of all or selected links (times, links) [N]; to leading order only those are computed."""
    if links is None or model.order != "leading":
        stretch, force, squared, _ = close_chord_of(model, q, model.boundary_data_at(times))
        tension = link_tensions(model, stretch, force, squared)
        return tension if links is None else tension[:, links]
    from cablepod.condensed import _kernels_recorder as kernel  # numba is imported only to compute

    tension = np.empty((len(q), links.size))
    tables = (np.ascontiguousarray(table[:, links]) for table in (model.slopes, model.chordwise_force_patterns))
    slopes, patterns = tables
    q = np.ascontiguousarray(q)
    terms, rows = model.terms.take(None), model.boundary_data_at(times)
    tables = (array[None] for array in (rows, q, slopes))
    kernel.link_tensions(
        terms, *tables, model.n_in_plane, patterns[None], np.empty(1), np.zeros(1, dtype=int), tension[None]
    )
    return tension


def tension_means(
    model: CondensedModel, state: CondensedTrajectory, links: np.ndarray | None, opened: list[float] | None = None
) -> Means:
    """Return time mean and root mean square of the tensions of all or selected links (links,) [N], from the saved steps.

    Instants [s] of steps at which the chord does not close are appended to `opened`.
    """
    time = state.instants.steps / state.instants.steps_per_second
    count = model.chain.links if links is None else links.size

    def tensions(part: slice) -> np.ndarray:
        values = selected_tensions(model, state.saved[part], time[part], links)
        if opened is not None:
            opened.extend(time[part][~np.isfinite(values).all(axis=1)].tolist())
        return values

    return means(state.instants, state.window, tensions, count)
