"""Compiled error equation: exact forces at the points of a motion, and the growth of the error that it drives.

With the forces F to leading order of the enriched model, the motion y in its coordinates and the difference D of the exact forces
from F at y, the error e obeys e'' = D + F(y + e) - y'' - c y' - c e'.  Forces and closure are those of the steps.  All arrays
have a leading dimension of members.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_closure import _chord_tensions, _forces, _of_member
from cablepod.condensed._kernels_exact_closure import _chordwise_momentum, _newton_green, _newton_linear
from cablepod.condensed._kernels_layout import BLOCK

#: Mass that is added to unresolved modes, over their stiffness times the squared step (stable above a quarter), and part of the
#: stability margin of the others that the stiffness of the sag may use.
ADDED_MASS, MARGIN = 0.3, 0.95
# Fields at the points (FIELDS, m, BLOCK).
SQUARED, STRETCH, COMPLIANCE, RATE, SECOND_RATE, MOMENTUM = 0, 1, 2, 3, 4, 5
# Sums over the points (SUMS, BLOCK).
TENSION, TENSION_CHANGE, LARGEST_FORCE = 0, 1, 2  #: H to leading order, its change by the exact closure, largest N [N]
#: Integrals of zeta' to leading order and now [m], and of its derivative by N [m/N].
CHORD, REACH, FLEXIBILITY = 3, 4, 5


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _sum_slopes(slopes, begin, end, force, fields, sums):
    """Add H to the forces of the loads, and sum the products of slopes w' and their rates over the deflections.

    The second rates of zeta' at constant stretch of the cable are -(w' w'_tt + w'_t^2 + zeta'_t^2) / zeta' with the rate
    zeta'_t = -w' w'_t / zeta'.
    """
    for j in range(slopes.shape[2]):
        for t in range(begin, end):
            force[j, t] += sums[TENSION, t - begin]
            fields[SQUARED, j, t - begin], fields[RATE, j, t - begin], fields[SECOND_RATE, j, t - begin] = 0.0, 0.0, 0.0
        for plane in range(slopes.shape[0]):
            for t in range(begin, end):
                slope, rate = slopes[plane, 0, j, t], slopes[plane, 1, j, t]
                fields[SQUARED, j, t - begin] += slope * slope
                fields[RATE, j, t - begin] += slope * rate
                fields[SECOND_RATE, j, t - begin] += slope * slopes[plane, 2, j, t] + rate * rate


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _close_samples(weights, flexibility, green, shift, corrections, begin, end, force, fields, sums):
    """Fill the inverse of zeta' at the points with its second rate, and the change of H by the exact closure.

    The integral of zeta' is that of 1 + N / K - w'^2 / 2 at the same points, so that errors of the quadrature only enter the
    difference from the leading order.  `shift` is 0 for a motion to leading order, which has the tension to leading order.
    """
    count = end - begin
    for t in range(count):
        sums[CHORD, t], sums[TENSION_CHANGE, t], sums[LARGEST_FORCE, t] = 0.0, 0.0, -np.inf
    for j in range(weights.size):
        for t in range(count):
            own, squared = force[j, begin + t], fields[SQUARED, j, t]
            strain = own * flexibility[j]
            leading = 1.0 + strain - 0.5 * squared
            inner = 1.0 - squared + (2.0 * strain / leading if green else 2.0 * strain + strain * strain)
            sums[CHORD, t] += weights[j] * leading
            sums[LARGEST_FORCE, t] = own if own > sums[LARGEST_FORCE, t] else sums[LARGEST_FORCE, t]
            fields[STRETCH, j, t] = math.sqrt(inner)
    for _ in range(corrections):
        for t in range(count):
            sums[REACH, t], sums[FLEXIBILITY, t] = 0.0, 0.0
        for j in range(weights.size):
            for t in range(count):
                strain = (force[j, begin + t] + shift * sums[TENSION_CHANGE, t]) * flexibility[j]
                if green:
                    correction, derivative, _ = _newton_green(strain, fields[SQUARED, j, t], fields[STRETCH, j, t])
                else:
                    correction, derivative, _ = _newton_linear(strain, fields[SQUARED, j, t], fields[STRETCH, j, t])
                fields[STRETCH, j, t] += correction
                fields[COMPLIANCE, j, t] = derivative * flexibility[j]
                sums[REACH, t] += weights[j] * fields[STRETCH, j, t]
                sums[FLEXIBILITY, t] += weights[j] * fields[COMPLIANCE, j, t]
        for t in range(count):
            sums[REACH, t] = (sums[CHORD, t] - sums[REACH, t]) / sums[FLEXIBILITY, t]
            sums[TENSION_CHANGE, t] += sums[REACH, t]
        for j in range(weights.size):
            for t in range(count):
                fields[STRETCH, j, t] += shift * fields[COMPLIANCE, j, t] * sums[REACH, t]
    for j in range(weights.size):
        for t in range(count):
            inverse = 1.0 / fields[STRETCH, j, t]
            rate = fields[RATE, j, t] * inverse
            fields[SECOND_RATE, j, t] = -(fields[SECOND_RATE, j, t] + rate * rate) * inverse
            fields[STRETCH, j, t] = inverse


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _fill_forces_on_slopes(weights, shift, begin, end, force, fields, sums, slopes):
    """Replace the slopes by the forces on them less those to leading order, times the weights: (N - inertia) / zeta' - N."""
    for j in range(weights.size):
        for t in range(begin, end):
            leading = weights[j] * force[j, t]
            exact = leading + weights[j] * shift * sums[TENSION_CHANGE, t - begin] - fields[MOMENTUM, j, t - begin]
            fields[SQUARED, j, t - begin] = exact * fields[STRETCH, j, t - begin] - leading
        for plane in range(slopes.shape[0]):
            for t in range(begin, end):
                slopes[plane, 0, j, t] *= fields[SQUARED, j, t - begin]


@compiled(fastmath=FAST_DIVISION, counted=False)
def exact_forces(
    sizes, enriched, weights, flexibility, inertia, green, leading, corrections, rows, y, force, slopes, fields, sums, tensions
):  # fmt: skip
    """Compute the exact forces on the slopes of motions at points along cables, less those to leading order.

    The exact force on a slope is (N - inertia) / zeta', with the inertia of the chordwise motion.

    Parameters
    ----------
    sizes, enriched, weights, flexibility, inertia, green, leading, corrections
        See :class:`cablepod.condensed._kernels_layout.ErrorTerms`.
    rows
        Boundary data of the samples, see :func:`cablepod.condensed._frame.chord_and_loads` (members, samples, columns).
    y
        Motion in enriched coordinates (members, samples, R).
    force
        Chordwise forces of the loads at the points (members, m, samples) [N]; changed.
    slopes
        Slopes of the deflections at the points, their rates, and accelerations (members, deflections, 3, m, samples); those
        without a rate are replaced by the forces times the weights.
    fields, sums
        Work arrays (FIELDS, m, BLOCK) and (SUMS, BLOCK).
    tensions
        Filled: change of H by the exact closure, and largest chordwise force (2, members, samples) [N].
    """
    shift, samples = 0.0 if leading else 1.0, y.shape[1]
    for member in range(y.shape[0]):
        own = _of_member(enriched, member)
        for begin in range(0, samples, BLOCK):
            end = begin + BLOCK if begin + BLOCK < samples else samples
            for t in range(begin, end):
                _chord_tensions(sizes, own, rows[member, t], y[member, t], sums[TENSION, t - begin :])
            _sum_slopes(slopes[member], begin, end, force[member], fields, sums)
            _close_samples(
                weights[member], flexibility[member], green, shift, corrections, begin, end, force[member], fields, sums
            )
            _chordwise_momentum(end - begin, fields[SECOND_RATE], weights[member], inertia[member], fields[MOMENTUM])
            _fill_forces_on_slopes(weights[member], shift, begin, end, force[member], fields, sums, slopes[member])
            for t in range(begin, end):
                tensions[0, member, t] = sums[TENSION_CHANGE, t - begin]
                tensions[1, member, t] = sums[LARGEST_FORCE, t - begin] + shift * sums[TENSION_CHANGE, t - begin]


@compiled(fastmath=FAST_DIVISION, noalias=True, literal=False, counted=False)
def _hold_by_springs(springs, part, inverse_mass, held, force, across):
    """Replace two vectors x (R,) by M (M + part sum_a s_a s_a^T)^-1 x, with the diagonal mass M.

    By Sherman and Morrison, dyad by dyad: (M + ...)^-1 x = M^-1 x - sum_a z_a (z_a . x), with the work vectors z_a in `held`.
    """
    size = springs.shape[1]
    for a in range(springs.shape[0]):
        for i in range(size):
            held[a, i] = springs[a, i] * inverse_mass[i]
        for b in range(a):
            along = 0.0
            for i in range(size):
                along += held[b, i] * springs[a, i]
            for i in range(size):
                held[a, i] -= along * held[b, i]
        square = 0.0
        for i in range(size):
            square += springs[a, i] * held[a, i]
        factor = math.sqrt(part / (1.0 + part * square))
        for i in range(size):
            held[a, i] *= factor
    for a in range(springs.shape[0]):  # all act on the given vectors
        of_force, of_across = 0.0, 0.0
        for i in range(size):
            of_force += held[a, i] * force[i]
            of_across += held[a, i] * across[i]
        held[a, size] = of_force
        held[a, size + 1] = of_across
    for a in range(springs.shape[0]):
        of_force, of_across = held[a, size], held[a, size + 1]
        for i in range(size):
            force[i] -= of_force * held[a, i] / inverse_mass[i]
            across[i] -= of_across * held[a, i] / inverse_mass[i]


@compiled(fastmath=FAST_DIVISION, counted=False)
def error_growth(
    sizes, enriched, damping, springs, step, rows, y, difference, largest_force, vectors, mean_squares, largest
):  # fmt: skip
    """Integrate the error equations of members on sampled instants.

    Central differences with an effective mass: M (e(t + h) - 2 e(t) + e(t - h)) / h^2 = force, where M is 1 + h^2 K / 12 for
    modes that the step resolves (fourth order for constant K) and at least 0.3 h^2 K for others (stable at any step), with N at
    most its maximum along the cable for K, plus multiples of the dyads of the stiffness of sag and springs.

    Parameters
    ----------
    sizes, enriched, damping, springs
        See :class:`cablepod.condensed._kernels_layout.ErrorTerms`.
    step
        Interval of the samples [s].
    rows, y, difference, largest_force
        See :class:`cablepod.condensed._kernels_layout.Drive`; the rows (members, samples, columns).
    vectors
        Errors at the start, their rates, and work arrays (members, 8 + springs, R + 2); changed.
    mean_squares
        Filled: sums of the squares of the error's coordinates (members, samples) [kg m^2].
    largest
        Filled: the errors where that is largest, and the number of the sample (members, R + 1).
    """
    size, squared_step = y.shape[2], step * step
    margin = MARGIN if springs is None else 0.5 * MARGIN  # shared by sag and springs
    for member in range(y.shape[0]):
        own, damped = _of_member(enriched, member), damping[member] * step
        kappa, sag_stiffness, furthest = own.kappa, 2.0 * own.sag_stiffness[0], -1.0
        e, increment, position, force = vectors[member, 0], vectors[member, 1], vectors[member, 2], vectors[member, 3]
        inverse_mass, slope, tension = vectors[member, 4], vectors[member, 5], vectors[member, 6]
        across, held = vectors[member, 7], vectors[member, 8:]
        for t in range(y.shape[1]):
            square = 0.0
            for i in range(size):
                square += e[i] * e[i]
                position[i] = y[member, t, i] + e[i]
            mean_squares[member, t] = square
            if square > furthest:
                furthest = square
                for i in range(size):
                    largest[member, i] = e[i]
                largest[member, size] = t
            _forces(sizes, own, rows[member, t], position, tension, force)
            # at the start `increment` is the rate: half a force acts, and half of the damping
            stiffest, need, cross, dyad = squared_step * max(largest_force[member, t], 0.0), 0.0, 0.0, 0.0
            need_of_springs = 0.0
            part, factor = (1.0, 1.0) if t else (0.5, step)
            for i in range(size):
                stiffness = stiffest * kappa[i]
                mass = max(1.0 + stiffness / 12.0, ADDED_MASS * stiffness)
                slope[i], increment[i] = kappa[i] * position[i], factor * increment[i]
                need += slope[i] * slope[i] / (mass - 0.25 * stiffness)
                if springs is not None:
                    for a in range(springs.shape[1]):
                        need_of_springs += springs[member, a, i] * springs[member, a, i] / (mass - 0.25 * stiffness)
                inverse_mass[i] = 1.0 / (mass + 0.5 * damped)
                force[i] = part * (squared_step * (force[i] + difference[member, t, i]) - damped * increment[i])
                across[i] = slope[i]
            # as little of these stiffnesses as stability allows: a twelfth, as for the other modes, or up to a quarter
            if springs is not None:
                part = max(squared_step / 12.0, 0.25 * squared_step - margin / max(need_of_springs, 1e-300))
                _hold_by_springs(springs[member], part, inverse_mass, held, force, across)
            for i in range(size):
                cross += slope[i] * force[i] * inverse_mass[i]
                dyad += slope[i] * across[i] * inverse_mass[i]
            sag = squared_step * sag_stiffness
            part = max(sag / 12.0, 0.25 * sag - margin / max(need, 1e-300))
            cross *= part / (1.0 + part * dyad)
            for i in range(size):
                increment[i] += (force[i] - cross * across[i]) * inverse_mass[i]
                e[i] += increment[i]
