"""Compiled error equation: residual of a motion in the enriched model, and the growth of the error that it drives.

With the forces F to leading order of the enriched model, the motion y in its coordinates and the difference D of the exact forces
from F at y, the error e obeys e'' = D + F(y + e) - y'' - c y' - c e'.  Forces, closure and tangent are those of the steps.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_closure import _chordwise_momentum, _newton_green, _newton_linear
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_layout import BLOCK
from cablepod.condensed._kernels_leading import leading_force
from cablepod.condensed._kernels_terms import _chord_tensions, _forces

#: Maximum number of Newton iterations for the error at the start, and its tolerance: last correction over the error.
START_ITERATIONS, START_RTOL = 20, 1e-9
#: Mass that is added to unresolved modes, over their stiffness times the squared step (stable above a quarter), and part of the
#: stability margin of the others that the stiffness of the sag may use.
ADDED_MASS, MARGIN = 0.3, 0.95
# Fields at the points (FIELDS, m, BLOCK); slopes and their rates take two rows, in and out of plane.
SLOPE, SLOPE_RATE, SLOPE_ACCELERATION = 0, 2, 4
FORCE, SQUARED, STRETCH, CORRECTION, COMPLIANCE, SECOND_RATE, MOMENTUM = 6, 7, 8, 9, 10, 11, 12
# Sums over the points (SUMS, BLOCK).
TENSION, TENSION_CHANGE, LARGEST_FORCE = 0, 1, 2  #: H to leading order, its change by the exact closure, largest N [N]
CHORD, REACH, FLEXIBILITY = (
    3,
    4,
    5,
)  #: integrals of zeta' to leading order and now [m], and of its derivative by N [m/N]


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _add_products(factor, matrix, first_row, last_row, first, last, source, count, target):
    """Add a factor times the product of a part of a matrix and source (columns, count) to target (rows, count).

    The part are the rows `first_row` ... `last_row` - 1 and the columns `first` ... `last` - 1.
    """
    for i in range(first_row, last_row):
        for k in range(first, last):
            weight = factor * matrix[i, k]
            for t in range(count):
                target[i, t] += weight * source[k, t]


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _close_samples(weights, stiffness, green, shift, corrections, count, fields, sums):
    """Fill chordwise stretch at the points, and the change of H by the exact closure.

    The integral of zeta' is that of 1 + N / K - w'^2 / 2 at the same points, so that errors of the quadrature only enter the
    difference from the leading order.  `shift` is 0 for a motion to leading order, which has the tension to leading order.
    """
    flexibility = 1.0 / stiffness
    for t in range(count):
        sums[CHORD, t], sums[TENSION_CHANGE, t], sums[LARGEST_FORCE, t] = 0.0, 0.0, -np.inf
    for j in range(weights.size):
        for t in range(count):
            force, x, y = fields[FORCE, j, t] + sums[TENSION, t], fields[SLOPE, j, t], fields[SLOPE + 1, j, t]
            squared, strain = x * x + y * y, force * flexibility
            leading = 1.0 + strain - 0.5 * squared
            inner = 1.0 - squared + (2.0 * strain / leading if green else 2.0 * strain + strain * strain)
            sums[CHORD, t] += weights[j] * leading
            sums[LARGEST_FORCE, t] = force if force > sums[LARGEST_FORCE, t] else sums[LARGEST_FORCE, t]
            fields[FORCE, j, t], fields[SQUARED, j, t], fields[STRETCH, j, t] = force, squared, math.sqrt(inner)
    for _ in range(corrections):
        for t in range(count):
            sums[REACH, t], sums[FLEXIBILITY, t] = 0.0, 0.0
        for j in range(weights.size):
            for t in range(count):
                strain = (fields[FORCE, j, t] + shift * sums[TENSION_CHANGE, t]) * flexibility
                if green:
                    correction, derivative, _ = _newton_green(strain, fields[SQUARED, j, t], fields[STRETCH, j, t])
                else:
                    correction, derivative, _ = _newton_linear(strain, fields[SQUARED, j, t], fields[STRETCH, j, t])
                fields[STRETCH, j, t] += correction
                fields[COMPLIANCE, j, t] = derivative * flexibility
                sums[REACH, t] += weights[j] * fields[STRETCH, j, t]
                sums[FLEXIBILITY, t] += weights[j] * fields[COMPLIANCE, j, t]
        for t in range(count):
            sums[REACH, t] = (sums[CHORD, t] - sums[REACH, t]) / sums[FLEXIBILITY, t]
            sums[TENSION_CHANGE, t] += sums[REACH, t]
        for j in range(weights.size):
            for t in range(count):
                fields[STRETCH, j, t] += shift * fields[COMPLIANCE, j, t] * sums[REACH, t]


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _fill_second_rates(count, fields):
    """Fill the second rates of zeta' at constant stretch of the cable, and replace zeta' by its inverse.

    They are -(w' w'_tt + w'_t^2 + zeta'_t^2) / zeta' with zeta'_t = -w' w'_t / zeta'.
    """
    for j in range(fields.shape[1]):
        for t in range(count):
            x, y = fields[SLOPE, j, t], fields[SLOPE + 1, j, t]
            x_dot, y_dot = fields[SLOPE_RATE, j, t], fields[SLOPE_RATE + 1, j, t]
            inverse = 1.0 / fields[STRETCH, j, t]
            rate = (x * x_dot + y * y_dot) * inverse
            second = x * fields[SLOPE_ACCELERATION, j, t] + y * fields[SLOPE_ACCELERATION + 1, j, t]
            fields[SECOND_RATE, j, t] = -(second + x_dot * x_dot + y_dot * y_dot + rate * rate) * inverse
            fields[STRETCH, j, t] = inverse


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _fill_forces_on_slopes(weights, shift, count, fields, sums):
    """Replace the slopes by the forces on them less those to leading order, times the weights: (N - inertia) / zeta' - N."""
    for j in range(weights.size):
        for t in range(count):
            leading = weights[j] * fields[FORCE, j, t]
            exact = leading + weights[j] * shift * sums[TENSION_CHANGE, t] - fields[MOMENTUM, j, t]
            difference = exact * fields[STRETCH, j, t] - leading
            fields[SLOPE, j, t] *= difference
            fields[SLOPE + 1, j, t] *= difference


@compiled(fastmath=FAST_DIVISION, counted=False)
def exact_differences(terms, boundary_data, q, q_dot, q_ddot, work, y, difference, tension_change, largest_force):
    """Compute what drives the error: exact forces less those to leading order, less accelerations of the motion.

    The exact force on a slope is (N - inertia) / zeta', with the inertia of the chordwise motion.

    Parameters
    ----------
    terms
        See :class:`cablepod.condensed._kernels_layout.ErrorTerms`.
    boundary_data
        See :func:`cablepod.condensed._kernels_frame.frames`; a row for each sample.
    q, q_dot, q_ddot
        Motion in its own coordinates, with rates and accelerations (samples, r).
    work
        Work arrays, see :class:`cablepod.condensed._kernels_layout.ErrorWork`.
    y, difference
        Filled: the motion in enriched coordinates, and D less its accelerations with damping (samples, R).
    tension_change, largest_force
        Filled: change of H by the exact closure, and largest chordwise force (samples,) [N].
    """
    loads, motion, fields, sums, own, forces, tension = work
    (samples, r), size, columns, shift = q.shape, y.shape[1], boundary_data.shape[1], 0.0 if terms.leading else 1.0
    rows, n, enriched, m = boundary_data.reshape(-1), terms.in_plane, terms.enriched_in_plane, terms.weights.size
    for begin in range(0, samples, BLOCK):
        count = min(BLOCK, samples - begin)
        for t in range(count):
            for a in range(loads.shape[0]):
                loads[a, t] = boundary_data[begin + t, 1 + a]
            for j in range(r):
                motion[0, j, t], motion[1, j, t] = q[begin + t, j], q_dot[begin + t, j]
                motion[2, j, t] = q_ddot[begin + t, j] + terms.damping * q_dot[begin + t, j]
            for i in range(size):
                own[i, t], forces[i, t] = 0.0, 0.0
            for k in range(FORCE + 1):
                for j in range(fields.shape[1]):
                    fields[k, j, t] = 0.0
        _add_products(1.0, terms.change, 0, size, 0, r, motion[0], count, own)
        for t in range(count):
            for i in range(size):
                y[begin + t, i] = own[i, t]
            _chord_tensions(terms.sizes, terms.enriched, rows, (begin + t) * columns, y[begin + t], tension)
            sums[TENSION, t] = tension[0]
        for k in range(3):
            for plane in range(2):
                first, last = (0, n) if plane == 0 else (n, r)
                _add_products(1.0, terms.slopes_of_motion, 0, m, first, last, motion[k], count, fields[2 * k + plane])
        _add_products(1.0, terms.force_patterns, 0, m, 0, loads.shape[0], loads, count, fields[FORCE])
        _close_samples(
            terms.weights, terms.enriched.stiffness[0], terms.green, shift, terms.corrections, count, fields, sums
        )
        _fill_second_rates(count, fields)
        _chordwise_momentum(count, fields[SECOND_RATE], terms.weights, terms.inertia, fields[MOMENTUM])
        _fill_forces_on_slopes(terms.weights, shift, count, fields, sums)
        for plane in range(2):
            first, last = (0, enriched) if plane == 0 else (enriched, size)
            _add_products(-1.0, terms.slopes, first, last, 0, m, fields[SLOPE + plane], count, forces)
        _add_products(-1.0, terms.change, 0, size, 0, r, motion[2], count, forces)
        for t in range(count):
            tension_change[begin + t] = sums[TENSION_CHANGE, t]
            largest_force[begin + t] = sums[LARGEST_FORCE, t] + shift * sums[TENSION_CHANGE, t]
            for i in range(size):
                difference[begin + t, i] = forces[i, t]


@compiled(fastmath=FAST_DIVISION, counted=False, forceinline=True)
def _add_difference(kappa, leading, position, e, difference, change, f):
    """Add D less accelerations of the motion to F(y + e) in f (R,), at the tension that its closure misses.

    What the closure of a motion to leading order misses acts on the whole shape: the error makes good most of it.  A motion with
    the exact closure has that tension in D.
    """
    for i in range(e.size):
        f[i] += difference[i] - change * kappa[i] * (position[i] if leading else e[i])


@compiled(fastmath=FAST_DIVISION, counted=False)
def error_growth(
    sizes, enriched, leading, damping, step, boundary_data, y, difference, tension_change, largest_force, vectors, mean_squares,
    largest,
):  # fmt: skip
    """Integrate the error equation on sampled instants.

    Central differences with an effective mass: M (e(t + h) - 2 e(t) + e(t - h)) / h^2 = force, where M is 1 + h^2 K / 12 for
    modes that the step resolves (fourth order for constant K) and at least 0.3 h^2 K for others (stable at any step), with N at
    most its maximum along the cable for K, plus a multiple of the dyad of the sag's stiffness.

    Parameters
    ----------
    sizes, enriched, leading
        See :class:`cablepod.condensed._kernels_layout.ErrorTerms`.
    damping, step
        Damping of the error [1/s], and interval of the samples [s].
    boundary_data
        See :func:`cablepod.condensed._kernels_frame.frames`; a row for each sample.
    y, difference, tension_change, largest_force
        See :func:`exact_differences`.
    vectors
        Error at the start, its rate, and work arrays (7, R); changed.
    mean_squares
        Filled: sum of the squares of the error's coordinates (samples,) [kg m^2].
    largest
        Filled: the error where that is largest, and the number of the sample (R + 1,).
    """
    size, kappa, sag_stiffness = y.shape[1], enriched.kappa, 2.0 * enriched.sag_stiffness[0]
    e, increment, position, force, inverse_mass = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    slope, tension, rows = vectors[5], vectors[6], boundary_data.reshape(-1)
    squared_step, furthest = step * step, -1.0
    for t in range(boundary_data.shape[0]):
        square = 0.0
        for i in range(size):
            square += e[i] * e[i]
            position[i] = y[t, i] + e[i]
        mean_squares[t] = square
        if square > furthest:
            furthest = square
            for i in range(size):
                largest[i] = e[i]
            largest[size] = t
        _forces(sizes, enriched, rows, t * boundary_data.shape[1], position, tension, force)
        _add_difference(kappa, leading, position, e, difference[t], tension_change[t], force)
        # at the start `increment` is the rate: half a force acts, and half of the damping
        stiffest, need, cross, dyad = squared_step * max(largest_force[t], 0.0), 0.0, 0.0, 0.0
        part, factor = (1.0, 1.0) if t else (0.5, step)
        for i in range(size):
            own = stiffest * kappa[i]
            mass = max(1.0 + own / 12.0, ADDED_MASS * own)
            slope[i], increment[i] = kappa[i] * position[i], factor * increment[i]
            need += slope[i] * slope[i] / (mass - 0.25 * own)
            inverse_mass[i] = 1.0 / (mass + 0.5 * damping * step)
            force[i] = part * (squared_step * force[i] - damping * step * increment[i])
            cross += slope[i] * force[i] * inverse_mass[i]
            dyad += slope[i] * slope[i] * inverse_mass[i]
        # as little of the sag's stiffness as stability allows: a twelfth, as for the other modes, or up to a quarter
        sag = squared_step * sag_stiffness
        part = max(sag / 12.0, 0.25 * sag - MARGIN / max(need, 1e-300))
        cross *= part / (1.0 + part * dyad)
        for i in range(size):
            increment[i] += (force[i] - cross * slope[i]) * inverse_mass[i]
            e[i] += increment[i]


@compiled(fastmath=FAST_DIVISION, counted=False)
def error_at_rest(enriched, leading, row, y, difference, change, vectors, tangent, tension):
    """Fill row 0 of `vectors` (3, R) with the distance to the equilibrium of the enriched model from y at rest; False if none.

    `difference` (R,) and `change` are those of one sample, see :func:`exact_differences`; `tangent` (R, R) and `tension`
    (1,) are work arrays.
    """
    e, position, force = vectors[0], vectors[1], vectors[2]
    for i in range(y.size):
        e[i] = 0.0
    for _ in range(START_ITERATIONS):
        for i in range(y.size):
            position[i] = y[i] + e[i]
        leading_force(enriched, row, position, force, tangent, tension)
        _add_difference(enriched.kappa, leading, position, e, difference, change, force)
        for i in range(y.size):
            tangent[i, i] += change * enriched.kappa[i]
        if not _solve(tangent, force):
            return False
        correction, largest = 0.0, 0.0
        for i in range(y.size):
            e[i] += force[i]
            correction, largest = max(correction, abs(force[i])), max(largest, abs(e[i]))
        if correction <= START_RTOL * largest:
            return True
    return False
