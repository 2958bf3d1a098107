"""Compiled error equation: residual of a motion in the enriched model, and the growth of the error that it drives.

Arguments that all kernels share are tuples:

constants
    K [N], L0 [m], mass damping [1/s], whether law (21) holds, whether the motion obeys the closure to leading order, number of
    joint Newton corrections of the closure, numbers of in-plane coordinates of the motion and of the enriched model.
points
    Weights (m,) [m], relative arc lengths (m,) and masses (m,) [kg] of the points along the cable, the part of its own stretch
    that displaces a point, chordwise force patterns (patterns, m), slopes of the motion's coordinates (r, m) and of the enriched
    ones (R, m).
coefficients
    Matrix from the motion's coordinates to the enriched ones (R, r), squared slope norms (R,), mean chordwise forces (patterns,),
    geometric stiffness (patterns, R, R), its product with the matrix (patterns, R, r), load projection (normals times patterns,
    R).
"""

from __future__ import annotations

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_error_point import (
    _add,
    _add_inertia,
    _add_product,
    _add_second_rate,
    _add_three,
    _apply_correction,
    _correct_green,
    _correct_linear,
    _start_stretch,
    _take_difference,
)

#: Number of samples that are computed side by side (a multiple of the vectors of processors; no power of two, as rows would then
#: share lines of the cache).
BLOCK = 136
#: Maximum number of Newton iterations for the error at the start, and its tolerance: last correction over the error.
START_ITERATIONS, START_RTOL = 20, 1e-9
#: Mass that is added to unresolved modes, over their stiffness times the squared step (stable above a quarter), and part of the
#: stability margin of the others that the stiffness of the sag may use.
ADDED_MASS, MARGIN = 0.3, 0.95
# Sums of a block (SUMS, BLOCK).
LEADING_TENSION, TENSION_CHANGE, LARGEST_FORCE = (
    0,
    1,
    2,
)  #: H to leading order, change by the exact closure, largest N [N]
CHORD, REACH, FLEXIBILITY = (
    3,
    4,
    5,
)  #: integrals of zeta' to leading order and now [m], and of its derivative by N [m/N]
SUMS = 6
# Fields of a block (FIELDS, m, BLOCK); slopes and their rates take two rows, in and out of plane.
SLOPE, SLOPE_RATE, SLOPE_ACCELERATION = 0, 2, 4
FORCE, STRETCH, COMPLIANCE, CORRECTION, DISPLACEMENT = 6, 7, 8, 9, 10
INVERSE = 8  #: later, in place of COMPLIANCE: 1 / zeta'
FIELDS = 11


@compiled(fastmath=FAST_DIVISION, literal=False)
def _close_samples(count, constants, points, loads, sums, fields):
    """Fill chordwise force and stretch at the points for given slopes, and the change of H by the exact closure.

    The integral of zeta' is that of 1 + N / K - w'^2 / 2 at the same points, so that errors of the quadrature only enter the
    differences from the leading order.
    """
    stiffness, green, corrections = constants[0], constants[3], constants[5]
    shift = 0.0 if constants[4] else 1.0  # a motion to leading order has the tension to leading order
    weights, patterns = points[0], points[4]
    m, flexibility = weights.size, 1.0 / stiffness
    tension, tension_change, largest_force = sums[LEADING_TENSION], sums[TENSION_CHANGE], sums[LARGEST_FORCE]
    chord, reach, of_tension = sums[CHORD], sums[REACH], sums[FLEXIBILITY]
    tension_change[:] = 0.0
    chord[:] = 0.0
    largest_force[:] = -np.inf
    for j in range(m):
        force = fields[FORCE, j, :count]
        for t in range(count):
            force[t] = tension[t]
        for a in range(patterns.shape[0]):
            _add(patterns[a, j], loads[1 + a, :count], force)
        _start_stretch(
            green, weights[j], flexibility, fields[SLOPE, j, :count], fields[SLOPE + 1, j, :count], force,
            fields[STRETCH, j, :count], chord, largest_force,
        )  # fmt: skip
    for _ in range(corrections):
        reach[:] = 0.0
        of_tension[:] = 0.0
        for j in range(m):
            x, y, force = fields[SLOPE, j, :count], fields[SLOPE + 1, j, :count], fields[FORCE, j, :count]
            stretch, compliance, correction = fields[STRETCH, j], fields[COMPLIANCE, j], fields[CORRECTION, j]
            if green:
                _correct_green(
                    weights[j], flexibility, x, y, force, tension_change, stretch, compliance, correction, reach,
                    of_tension,
                )  # fmt: skip
            else:
                _correct_linear(
                    weights[j], flexibility, x, y, force, tension_change, stretch, compliance, correction, reach,
                    of_tension,
                )  # fmt: skip
        for t in range(count):
            reach[t] = (chord[t] - reach[t]) / of_tension[t]
            tension_change[t] += reach[t]
        for j in range(m):
            _apply_correction(shift, fields[CORRECTION, j], fields[COMPLIANCE, j], reach, fields[STRETCH, j, :count])


@compiled(fastmath=FAST_DIVISION, literal=False)
def _transverse_forces(count, constants, points, sums, fields):
    """Replace the slopes by slopes times (N - inertia) / zeta' - N to leading order, times the weights.

    The inertia is that of the chordwise motion at constant stretch of the cable: the second rate of zeta' is
    -(w' w'_tt + w'_t^2 + zeta'_t^2) / zeta' with zeta'_t = -w' w'_t / zeta'.  A point moves by its integral less sigma times the
    whole integral, and the force on a stretch is the inertia above it.
    """
    weights, sigma, masses, share = points[0], points[1], points[2], points[3]
    m, shift = weights.size, 0.0 if constants[4] else 1.0
    reach, above = sums[REACH, :count], sums[FLEXIBILITY]  # from here on the inertia above a point
    reach[:] = 0.0
    above[:] = 0.0
    for j in range(m):
        _add_second_rate(
            weights[j], share, fields[STRETCH, j, :count], fields[SLOPE, j], fields[SLOPE + 1, j], fields[SLOPE_RATE, j],
            fields[SLOPE_RATE + 1, j], fields[SLOPE_ACCELERATION, j], fields[SLOPE_ACCELERATION + 1, j], reach,
            fields[INVERSE, j], fields[DISPLACEMENT, j],
        )  # fmt: skip
    for j in range(m):
        _add_inertia(masses[j], sigma[j], reach, fields[DISPLACEMENT, j], above)
    for back in range(m):
        j = m - 1 - back
        _take_difference(
            weights[j], share, shift, fields[FORCE, j, :count], sums[TENSION_CHANGE], fields[INVERSE, j],
            fields[DISPLACEMENT, j], above, fields[SLOPE, j], fields[SLOPE + 1, j],
        )  # fmt: skip


@compiled(fastmath=FAST_DIVISION, literal=False)
def _residuals(count, constants, points, coefficients, loads, motion, sums, fields, residual):
    """Fill the residual (R, BLOCK) of a block of a motion (3, r, BLOCK): coordinates, rates, accelerations with damping.

    It is that of the leading order, by its exact coefficients, plus the differences of the exact forces by the points.
    """
    stiffness, length, in_plane, enriched_in_plane = constants[0], constants[1], constants[6], constants[7]
    slopes_of_motion, slopes = points[5], points[6]
    change, kappa, mean_forces, _, geometric_stiffness, load_projection = coefficients
    r, patterns, m = motion.shape[1], mean_forces.size, slopes.shape[1]
    tension = sums[LEADING_TENSION]
    for t in range(count):
        tension[t] = stiffness * (loads[0, t] / length - 1.0)
    for a in range(patterns):
        _add(-mean_forces[a], loads[1 + a], tension[:count])
    for i in range(kappa.size):
        coordinate = sums[REACH, :count]
        coordinate[:] = 0.0
        for j in range(r):
            _add(change[i, j], motion[0, j], coordinate)
        sag = 0.5 * stiffness / length * kappa[i]
        for t in range(count):
            tension[t] += sag * coordinate[t] * coordinate[t]
    for j in range(m):
        for row in range(6):
            fields[row, j, :count] = 0.0
        for i in range(r):
            row = 0 if i < in_plane else 1
            _add_three(
                slopes_of_motion[i, j], motion[0, i, :count], motion[1, i], motion[2, i], fields[SLOPE + row, j],
                fields[SLOPE_RATE + row, j], fields[SLOPE_ACCELERATION + row, j],
            )  # fmt: skip
    _close_samples(count, constants, points, loads, sums, fields)
    _transverse_forces(count, constants, points, sums, fields)
    for i in range(kappa.size):
        row, own = 0 if i < enriched_in_plane else 1, residual[i, :count]
        own[:] = 0.0
        for a in range(load_projection.shape[0]):
            _add(load_projection[a, i], loads[1 + patterns + a], own)
        for j in range(m):
            _add(-slopes[i, j], fields[SLOPE + row, j], own)
        for j in range(r):
            _add(-change[i, j], motion[2, j], own)
            _add_product(-change[i, j] * kappa[i], tension, motion[0, j], own)
            for a in range(patterns):
                _add_product(-geometric_stiffness[a, i, j], loads[1 + a], motion[0, j], own)
    if not constants[4]:
        for t in range(count):  # the motion obeys the exact closure
            tension[t] += sums[TENSION_CHANGE, t]
            sums[LARGEST_FORCE, t] += sums[TENSION_CHANGE, t]
            sums[TENSION_CHANGE, t] = 0.0


@compiled(fastmath=FAST_DIVISION, forceinline=True, literal=False)
def _restoring_force(e, q, loads, t, sums, sag_stiffness, kappa, geometric_stiffness, total, force):
    """Fill the force (R,) against the error e, and kappa (q + e) in `total`; return H [N] of the motion with the error.

    To the change of H by the error comes what the closure of the motion misses, which the error makes good for the most part.
    """
    chord_tension, tension_change = sums[LEADING_TENSION, t], 0.0
    for i in range(kappa.size):
        own = kappa[i] * e[i]
        total[i] = kappa[i] * q[i]
        tension_change += (total[i] + 0.5 * own) * e[i]
        total[i] += own
        force[i] = chord_tension * own
    tension_change = sag_stiffness * tension_change + sums[TENSION_CHANGE, t]
    for a in range(geometric_stiffness.shape[0]):
        for j in range(kappa.size):
            factor = loads[1 + a, t] * e[j]
            for i in range(kappa.size):
                force[i] += geometric_stiffness[a, j, i] * factor
    for i in range(kappa.size):
        force[i] += tension_change * total[i]
    return chord_tension + tension_change


@compiled(fastmath=FAST_DIVISION)
def error_growth(
    q, q_dot, q_ddot, boundary_data, step, constants, points, coefficients, initial_error, initial_rate, mean_squares,
    largest,
):  # fmt: skip
    """Integrate the error equation on sampled instants.

    Central differences with an effective mass: M (e(t + h) - 2 e(t) + e(t - h)) / h^2 = residual - restoring force, where M is
    1 + h^2 K / 12 for modes that the step resolves (fourth order for constant K) and at least 0.3 h^2 K for others (stable at any
    step), with N at most its maximum along the cable for K, plus a multiple of the dyad of the sag's stiffness.

    Parameters
    ----------
    q, q_dot, q_ddot
        Motion in its own coordinates, with rates and accelerations (samples, r).
    boundary_data
        See :func:`cablepod.condensed._kernels_frame.frames`; a row for each sample.
    step
        Interval of the samples [s].
    constants, points, coefficients
        See above.
    initial_error, initial_rate
        Error at the start and its rate (R,).
    mean_squares
        Filled: sum of the squares of the error's coordinates (samples,) [kg m^2].
    largest
        Filled: the error where that is largest, and the number of the sample (R + 1,).
    """
    change, kappa, _, geometric_stiffness, _, _ = coefficients
    (samples, r), size, m = q.shape, kappa.size, points[0].size
    damping, sag_stiffness = constants[2], constants[0] / constants[1]
    loads, motion = np.empty((boundary_data.shape[1], BLOCK)), np.empty((3, r, BLOCK))
    sums, fields, residual = np.empty((SUMS, BLOCK)), np.empty((FIELDS, m, BLOCK)), np.empty((size, BLOCK))
    e, increment, enriched_q = initial_error.copy(), np.zeros(size), np.empty(size)
    total, force, inverse_mass = np.empty(size), np.empty(size), np.empty(size)
    squared_step, furthest = step * step, -1.0
    for begin in range(0, samples, BLOCK):
        count = min(BLOCK, samples - begin)
        for t in range(count):
            for k in range(boundary_data.shape[1]):
                loads[k, t] = boundary_data[begin + t, k]
            for j in range(r):
                motion[0, j, t] = q[begin + t, j]
                motion[1, j, t] = q_dot[begin + t, j]
                motion[2, j, t] = q_ddot[begin + t, j] + damping * q_dot[begin + t, j]
        _residuals(count, constants, points, coefficients, loads, motion, sums, fields, residual)
        for t in range(count):
            square = 0.0
            for i in range(size):
                enriched_q[i] = 0.0
                for j in range(r):
                    enriched_q[i] += change[i, j] * motion[0, j, t]
                square += e[i] * e[i]
            mean_squares[begin + t] = square
            if square > furthest:
                furthest = square
                for i in range(size):
                    largest[i] = e[i]
                largest[size] = begin + t
            _restoring_force(e, enriched_q, loads, t, sums, sag_stiffness, kappa, geometric_stiffness, total, force)
            stiffest, need, cross, dyad = squared_step * max(sums[LARGEST_FORCE, t], 0.0), 0.0, 0.0, 0.0
            for i in range(size):
                own = stiffest * kappa[i]
                mass = max(1.0 + own / 12.0, ADDED_MASS * own)
                need += total[i] * total[i] / (mass - 0.25 * own)
                inverse_mass[i] = 1.0 / (mass + 0.5 * damping * step)
                if begin + t:
                    force[i] = squared_step * (residual[i, t] - force[i]) - damping * step * increment[i]
                else:
                    force[i] = 0.5 * squared_step * (residual[i, t] - force[i] - damping * initial_rate[i])
                    increment[i] = step * initial_rate[i]
                cross += total[i] * force[i] * inverse_mass[i]
                dyad += total[i] * total[i] * inverse_mass[i]
            # as little of the sag's stiffness as stability allows: a twelfth, as for the other modes, or up to a quarter
            sag = squared_step * sag_stiffness
            part = max(sag / 12.0, 0.25 * sag - MARGIN / max(need, 1e-300))
            cross *= part / (1.0 + part * dyad)
            for i in range(size):
                increment[i] += (force[i] - cross * total[i]) * inverse_mass[i]
                e[i] += increment[i]


@compiled(fastmath=FAST_DIVISION)
def error_at_rest(q, boundary_data, constants, points, coefficients, e):
    """Fill e (R,) with the distance to the equilibrium of the enriched model from coordinates q (1, r) at rest; False if none."""
    change, kappa, _, geometric_stiffness, _, _ = coefficients
    r, size, m = q.shape[1], kappa.size, points[0].size
    loads, motion = np.empty((boundary_data.shape[1], BLOCK)), np.zeros((3, r, BLOCK))
    sums, fields, residual = np.empty((SUMS, BLOCK)), np.empty((FIELDS, m, BLOCK)), np.empty((size, BLOCK))
    for k in range(boundary_data.shape[1]):
        loads[k, 0] = boundary_data[0, k]
    for j in range(r):
        motion[0, j, 0] = q[0, j]
    _residuals(1, constants, points, coefficients, loads, motion, sums, fields, residual)
    enriched_q, total, force, tangent = np.empty(size), np.empty(size), np.empty(size), np.empty((size, size))
    for i in range(size):
        enriched_q[i] = 0.0
        for j in range(r):
            enriched_q[i] += change[i, j] * q[0, j]
    sag_stiffness = constants[0] / constants[1]
    e[:] = 0.0
    for _ in range(START_ITERATIONS):
        chord_tension = _restoring_force(
            e, enriched_q, loads, 0, sums, sag_stiffness, kappa, geometric_stiffness, total, force
        )
        for i in range(size):
            force[i] = residual[i, 0] - force[i]
            for j in range(size):
                tangent[i, j] = sag_stiffness * total[i] * total[j]
                for a in range(geometric_stiffness.shape[0]):
                    tangent[i, j] += loads[1 + a, 0] * geometric_stiffness[a, i, j]
            tangent[i, i] += chord_tension * kappa[i]
        if not _solve(tangent, force):
            return False
        correction, largest = 0.0, 0.0
        for i in range(size):
            e[i] += force[i]
            correction, largest = max(correction, abs(force[i])), max(largest, abs(e[i]))
        if correction <= START_RTOL * largest:
            return True
    return False
