"""Members whose steps fit their models: two runs in lanes and an estimate, as :func:`cablepod.condensed._runs.solve` of one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cablepod.condensed._coefficients import from_momenta
from cablepod.condensed._error_coefficients import Cables, scaled_terms, unit_coefficients
from cablepod.condensed._error_equation import LinkSlopes, errors_at_rest, mean_squares
from cablepod.condensed._estimate import (
    MAX_ERROR,
    MOTION_SAMPLES,
    POINTS,
    POINTS_PER_MODE,
    largest_motions,
    sample_interval,
)
from cablepod.condensed._estimate_neglected import INTEGRATED_RATIO, chord_direction, waves_of_start
from cablepod.condensed._lanes import LaneResults, Lanes, MemberCoefficients
from cablepod.condensed._runs import (
    FIT_INTERVALS,
    FOURTH_ORDER_AT_FIRST,
    MIN_EXPLICIT_STEPS,
    fourth_order_step,
    suits_fourth_order,
    taut_limit,
    time_tolerance,
    whole_steps_per_second,
)
from cablepod.integrate._output_times import OutputTimes, judged_instants, with_judged
from cablepod.integrate._refinement import MAX_WORK, economical_error
from cablepod.integrate._step_control import STEPS_PER_CHANGE
from cablepod.reduced._validity import forcing_attributes

if TYPE_CHECKING:
    from cablepod.condensed._batch import CondensedPlan


def first_steps(
    plan: CondensedPlan, members: MemberCoefficients, limit: np.ndarray, chord_tension: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the steps of the first runs, as :func:`cablepod.condensed._runs.solve` does.

    Parameters
    ----------
    plan, members
        Request and coefficients.
    limit, chord_tension
        Stability limits of velocity Verlet [s] and H [N] at the start (members,).

    Returns
    -------
    tuple of numpy.ndarray
        Steps per second of the first runs [1/s], 0 for members that run alone; steps of the second runs between samples of the
        error estimate.
    """
    p, end_time, kappa = members.parameters, float(plan.times[-1]), members.scaled.slope_norms_squared.max(axis=1)
    at_start = 4.0 / (limit * limit)
    ends = p.end_positions(np.linspace(0.0, end_time, FIT_INTERVALS + 1))
    longest = np.sqrt(((ends[:, :, 1] - ends[:, :, 0]) ** 2).sum(axis=2).max(axis=1))
    omega_squared = np.maximum(at_start, p.stiffness * np.maximum(longest / members.total - 1.0, 0.0) * kappa)
    suited = np.isfinite(omega_squared) & (omega_squared > 0.0)
    # waves by the start alone
    suited &= forcing_attributes(p, members.total)["forcing_over_axial_frequency"] <= INTEGRATED_RATIO
    if plan.chooses_scheme:
        suited &= suits_fourth_order(limit, taut_limit(chord_tension, kappa), p.damping, at_start)
    free = fourth_order_step(omega_squared, p.damping)
    time_scales = np.broadcast_to(p.shortest_time_scale, free.shape)
    first = np.minimum(free, time_scales / STEPS_PER_CHANGE)
    largest = MAX_WORK / (end_time * plan.unit.chain.links)
    window = end_time if plan.window is None else plan.window[1] - plan.window[0]
    rates, intervals, modes = np.zeros(limit.size), np.ones(limit.size), plan.unit.n_in_plane
    for m in np.flatnonzero(suited).tolist():
        rate = whole_steps_per_second(1.0 / float(first[m]))
        if rate <= largest and end_time * rate >= MIN_EXPLICIT_STEPS and window * rate > 2.0:
            rates[m] = rate
            bound = float(omega_squared[m]), modes, 2.0 * rate, end_time
            intervals[m] = sample_interval(*bound, time_scale=float(time_scales[m]))
    return rates, intervals


def fit(
    lanes: Lanes, members: MemberCoefficients, rate: float, interval: int, q: np.ndarray, v: np.ndarray
) -> tuple[LaneResults, dict[str, list[Any]]]:
    """Run members twice, with `rate` and twice as many steps per second, and estimate their errors.

    Parameters
    ----------
    lanes, members
        The same members.
    rate, interval
        See :func:`first_steps`.
    q, v
        Coordinates and rates at the start (members, r).

    Returns
    -------
    tuple
        Results of the second run, completed where both were stable and it meets its tolerance; the errors, as attributes.
    """
    times = lanes.plan.times
    compared = with_judged(times, judged_instants(times, rate))
    fine = OutputTimes.of(compared, 2.0 * rate).with_multiples(interval)
    first = lanes.advance(OutputTimes.of(compared, rate), q, v, extremes=False)
    second = lanes.advance(fine, q, v, extremes=True)
    scale, error = _motions_and_errors(members, second, interval, v)
    gap, mass = second.q - first.q, members.parameters.mass * members.total
    distance = np.sqrt((gap * gap).sum(axis=2).max(axis=1) / mass) / scale
    time_error = economical_error(distance, 2.0, FOURTH_ORDER_AT_FIRST)
    completed = first.completed & second.completed & (time_error <= time_tolerance(error))
    errors = {"time_error_estimate": time_error.tolist()}
    if "error_estimate" in lanes.plan.outputs:
        errors["error_estimate"] = (error + time_error).tolist()
    return replace(second.only(times), completed=completed), errors


# --- estimates of the error, as _estimate makes that of one run -------------------------------------------------------


def _motions_and_errors(
    members: MemberCoefficients, results: LaneResults, interval: int, momenta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the motions of members [m], and their largest errors over time as fractions of these, see ``estimate`` there.

    Samples are the saved steps that are multiples of `interval`; `momenta` are the rates at the start (members, r).
    """
    samples, rate = np.flatnonzero(results.instants.steps % interval == 0), results.instants.steps_per_second
    q, rates, boundary_data = results.saved, results.half_step_rates, results.saved_boundary_data
    if samples.size < q.shape[1]:
        q, rates, boundary_data = (array.take(samples, axis=1) for array in (q, rates, boundary_data))
    scale = motions_of(members, q, interval / rate)
    model, p, total, shapes = members.unit, members.parameters, members.total, members.scaled.named["shapes"]
    unit, at = unit_coefficients(
        model.modes, model.chain.arc_length, model.chain.p, POINTS + POINTS_PER_MODE * max(map(len, model.modes))
    )
    shape, mass = (1.0 / np.sqrt(p.mass * total))[:, None, None], (p.mass * total)[:, None]
    change = (unit.shapes * unit.mass) / shape @ np.swapaxes(shapes, 1, 2)
    in_plane, enriched_in_plane = model.n_in_plane, unit.n_in_plane
    change[:, :enriched_in_plane, in_plane:] = change[:, enriched_in_plane:, :in_plane] = 0.0
    load = np.repeat(total[:, None], len(model.load_patterns), axis=1)  # there are no point loads
    cables = Cables(p.stiffness, p.mass, p.damping, total)
    terms = scaled_terms(unit, at, cables, load, change, in_plane, leading=True, green=False)
    error = errors_at_rest(terms, q[:, 0], members.rows_at(np.zeros(1), moving=False)[:, 0])
    error_rates, speeds = np.zeros_like(error), members.speeds_of_frames
    if speeds is not None:
        coordinates = from_momenta(momenta, shapes, mass * model.chain.tributary_length, model.sets)
        of_enriched = speeds[:, None] @ terms.enriched.load_projection.reshape(*speeds.shape, -1)
        error_rates = (of_enriched - coordinates[:, None] @ np.swapaxes(change, 1, 2))[:, 0]
    before, after = rates[:, :, 0], rates[:, :, 1]
    motion = q, 0.5 * (before + after), (after - before) * rate
    slopes = shape / total[:, None, None] * unit.slopes
    links = LinkSlopes(slopes, total[:, None] * model.chain.length, mass * model.chain.tributary_length)
    squares = mean_squares(terms, links, mass, motion, boundary_data, interval / rate, error, error_rates)
    omega = math.pi / total * np.sqrt(p.stiffness / p.mass)
    waves = waves_of_start(np.moveaxis(p.initial_end_rates, 0, 1), chord_direction(p.ends), omega, p.damping)
    return scale, np.minimum(np.sqrt(squares.max(axis=1) + waves**2) / scale, MAX_ERROR)


def motions_of(members: MemberCoefficients, q: np.ndarray, interval: float) -> np.ndarray:
    """Return the largest rms displacements of members from their initial shapes [m], see ``motion_of`` of one run.

    `q` are coordinates at samples (members, samples, r), `interval` is that of the samples [s].
    """
    p, unit, shapes = members.parameters, members.unit, members.scaled.named["shapes"]
    stride = -(-q.shape[1] // MOTION_SAMPLES)
    q = q[:, ::stride]
    ends = p.end_positions(np.arange(q.shape[1]) * (stride * interval)) if p.motions else None
    of_upper = shapes @ (unit.chain.tributary_length * unit.chain.arc_length)
    of_lower = shapes @ unit.chain.tributary_length - of_upper
    reach = p.ends[:, 1] - p.ends[:, 0]
    chord = np.sqrt((reach * reach).sum(axis=1))
    normals = members.reference[:, None]
    if p.dims == 3:
        normals = np.concatenate([normals, np.cross(reach / chord[:, None], members.reference)[:, None]], axis=1)
    normals = np.repeat(normals, [of_upper[:, which].shape[1] for which in unit.sets], axis=1)
    return largest_motions(q, ends, chord, (p.mass * members.total)[:, None], normals, of_lower, of_upper)
