"""Error estimates of many members with equal steps, as :mod:`cablepod.condensed._estimate` makes that of one."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._error_coefficients import Cables, scaled_terms, unit_coefficients
from cablepod.condensed._error_equation import drive_of, errors_at_rest, grown_errors, parts_of_members
from cablepod.condensed._estimate import MAX_ERROR, MOTION_SAMPLES, POINTS, POINTS_PER_MODE, largest_motions
from cablepod.condensed._estimate_neglected import chord_direction, waves_of_start

if TYPE_CHECKING:
    from cablepod.condensed._batch_fitted import FittedBatch
    from cablepod.condensed._lanes import LaneResults


class MemberRuns:
    """Runs of members with equal steps, and what their estimates share.

    Parameters
    ----------
    batch
        Parameters and coefficients of the chunk.
    part
        Numbers of the members (members,).
    results
        Saved states, those of the samples among them.
    interval
        Number of steps between two samples.
    """

    def __init__(self, batch: FittedBatch, part: np.ndarray, results: LaneResults, interval: int) -> None:
        self.batch, self.part, self.results, self.interval = batch, part, results, interval
        self.total, self.mass = batch.total[part], batch.parameters.mass[part]
        self.ends, self.shapes = batch.ends.take(part), batch.scaled.named["shapes"][part]
        self.samples = np.flatnonzero(results.instants.steps % interval == 0)

    @cached_property
    def normals(self) -> np.ndarray:
        """Normals of the chord at the start (members, normals, dims)."""
        ends = self.ends.positions(np.zeros(1))[:, 0]
        reach = ends[:, 1] - ends[:, 0]
        along = reach / np.sqrt((reach * reach).sum(axis=1, keepdims=True))
        if along.shape[1] == 2:
            return np.stack([-along[:, 1], along[:, 0]], axis=1)[:, None]
        first = self.batch.reference[self.part]
        return np.stack([first, np.cross(along, first)], axis=1)


def motions_of(runs: MemberRuns) -> np.ndarray:
    """Return the largest rms displacements of members from their initial shapes [m].

    See :func:`cablepod.condensed._estimate.motion_of`.
    """
    batch, results = runs.batch, runs.results
    stride = -(-runs.samples.size // MOTION_SAMPLES)
    q, unit = results.saved[:, runs.samples[::stride]], batch.plan.unit
    ends = None
    if runs.ends.rows.size:
        times = np.arange(q.shape[1]) * (stride * runs.interval / results.instants.steps_per_second)
        ends = runs.ends.positions(times)
    of_upper = runs.shapes @ (unit.chain.tributary_length * unit.chain.arc_length)
    of_lower = runs.shapes @ unit.chain.tributary_length - of_upper
    count = [of_upper[:, which].shape[1] for which in unit.sets]
    normals = np.repeat(runs.normals, count, axis=1)
    largest = np.sqrt(largest_motions(q, ends, (runs.mass * runs.total)[:, None], normals, of_lower, of_upper))
    reach = runs.ends.initial[:, 1] - runs.ends.initial[:, 0]
    chord = np.sqrt((reach * reach).sum(axis=1))
    return np.where(largest > 1e-9 * chord, largest, chord)


def errors_of(runs: MemberRuns, scale: np.ndarray) -> np.ndarray:
    """Estimate the largest errors of members over time as fractions of their motions `scale` [m]."""
    batch, results, part, total = runs.batch, runs.results, runs.part, runs.total
    model, p, shapes = batch.plan.unit, batch.parameters, runs.shapes
    unit, at = unit_coefficients(
        model.modes, model.chain.arc_length, model.chain.p, POINTS + POINTS_PER_MODE * max(map(len, model.modes))
    )
    shape = (1.0 / np.sqrt(runs.mass * total))[:, None, None]
    length, projection = total[:, None, None], (unit.shapes * unit.mass) / shape
    change = projection @ np.swapaxes(shapes, 1, 2)
    in_plane, enriched_in_plane = model.n_in_plane, unit.n_in_plane
    change[:, :enriched_in_plane, in_plane:] = change[:, enriched_in_plane:, :in_plane] = 0.0
    cables = Cables(p.stiffness[part], runs.mass, p.damping[part], total)
    load = np.repeat(total[:, None], len(model.load_patterns), axis=1)  # there are no point loads
    terms = scaled_terms(unit, at, cables, load, change, in_plane, leading=True, green=False)
    q, rates, boundary_data = results.saved, results.half_step_rates, results.boundary_data
    if runs.samples.size < q.shape[1]:
        q, rates, boundary_data = (array.take(runs.samples, axis=1) for array in (q, rates, boundary_data))
    rate, start = results.instants.steps_per_second, np.zeros(1)
    rest = batch.rows_at(part, start, moving=False)[:, 0]
    error = errors_at_rest(terms, batch.q_rest[part], rest)
    error_rates = _initial_error_rates(runs, projection, change, enriched_in_plane)
    squares, largest = np.empty(q.shape[:2]), np.empty((part.size, error.shape[1] + 1))
    for some, own in parts_of_members(terms, q.shape[1]):
        before, after = rates[some, :, 0], rates[some, :, 1]
        drive = drive_of(own, (q[some], 0.5 * (before + after), (after - before) * rate), boundary_data[some])
        squares[some], largest[some] = grown_errors(own, drive, runs.interval / rate, error[some], error_rates[some])
    count = part.size
    squares /= (runs.mass * total)[:, None]
    squares[np.isnan(squares)] = math.inf
    error, samples = largest[:, :-1], largest[:, -1].astype(int)
    at_largest = (change @ q[np.arange(count), samples][:, :, None])[:, :, 0]
    link_slopes = (shape / length) * unit.slopes
    share = _chordwise_shares(runs, error, at_largest, link_slopes, enriched_in_plane)
    return np.minimum(np.sqrt(squares.max(axis=1) * (1.0 + share) + _waves(runs) ** 2) / scale, MAX_ERROR)


def _waves(runs: MemberRuns) -> np.ndarray:
    """Return the rms displacements of waves along the cables that their starts excite (members,) [m]."""
    rates = np.stack([runs.ends.positions(np.zeros(1), derivative)[:, 0] for derivative in (1, 2)], axis=1)
    if not rates.any():
        return np.zeros(runs.part.size)
    p, along = runs.batch.parameters, chord_direction(runs.ends.positions(np.zeros(1))[:, 0])
    omega = math.pi / runs.total * np.sqrt(p.stiffness[runs.part] / runs.mass)
    return waves_of_start(rates, along, omega, p.damping[runs.part])


def _chordwise_shares(
    runs: MemberRuns, error: np.ndarray, q: np.ndarray, slopes: np.ndarray, in_plane: int
) -> np.ndarray:
    """Return the mean squares of the chordwise displacement over those of the deflection, for errors (members, R) at q."""
    chain = runs.batch.plan.unit.chain
    stretch = np.zeros((len(q), chain.links))
    for which in (slice(in_plane), slice(in_plane, None)):
        moved, wrong = ((part[:, None, which] @ slopes[:, which])[:, 0] for part in (q, error))
        stretch -= moved * wrong
    along = np.cumsum(stretch * (runs.total[:, None] * chain.length), axis=1)
    along -= chain.arc_length[1:] * along[:, -1:]
    square = (error * error).sum(axis=1)
    share = runs.mass * runs.total * (along**2 @ chain.tributary_length[1:]) / square
    return np.where((square > 0.0) & (square < math.inf), share, 0.0)


def _initial_error_rates(
    runs: MemberRuns, projection: np.ndarray, change: np.ndarray, enriched_in_plane: int
) -> np.ndarray:
    """Return the rates of the errors at the start (members, R): the particles are at rest, the chord frame moves."""
    rates, result = runs.ends.positions(np.zeros(1), 1)[:, 0], np.zeros(change.shape[:2])
    if not rates.any():
        return result
    unit, q_rates = runs.batch.plan.unit, np.zeros((len(rates), change.shape[2]))
    sigma = unit.chain.arc_length
    mass = (runs.mass * runs.total)[:, None, None] * unit.chain.tributary_length
    sets = (slice(enriched_in_plane), slice(enriched_in_plane, None))
    for k, (which, enriched) in enumerate(zip(unit.sets, sets, strict=False)):
        ends = -(rates @ runs.normals[:, k, :, None])  # (members, end, 1)
        deflection = ends[:, 0] * (1.0 - sigma) + ends[:, 1] * sigma
        shapes = runs.shapes[:, which]
        momenta = (shapes * mass) @ deflection[:, :, None]
        q_rates[:, which] = np.linalg.solve((shapes * mass) @ np.swapaxes(shapes, 1, 2), momenta)[:, :, 0]
        result[:, enriched] = (projection[:, enriched] @ deflection[:, :, None])[:, :, 0]
    return result - (change @ q_rates[:, :, None])[:, :, 0]
