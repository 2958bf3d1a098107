"""Compiled error equation: exact closure at the points of a motion, and the growth of the error that it drives.

With the forces F to leading order of the enriched model, the motion y in its coordinates and the difference D of the exact forces
from F at y, the error e obeys e'' = D + F(y + e) - y'' - c y' - c e'.  Forces and closure are those of the steps.  All arrays
have a leading dimension of members.
"""

import math

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_closure import _chord_tensions, _forces, _of_member
from cablepod.condensed._kernels_exact_closure import _newton

#: Mass that is added to unresolved modes, over their stiffness times the squared step (stable above a quarter), and part of the
#: stability margin of the others that the stiffness of the sag may use.
ADDED_MASS, MARGIN = 0.3, 0.95
#: Sums over the points: H to leading order, its change by the exact closure [N]; integrals of zeta' to leading order and now
#: [m], and of its derivative by N [m/N].
TENSION, TENSION_CHANGE, CHORD, REACH, FLEXIBILITY = range(5)


@compiled(fastmath=FAST_DIVISION, noalias=True, counted=False)
def close_samples(
    sizes, enriched, weights, flexibility, green, leading, corrections, rows, y, squared, force, stretch, compliance, sums
):  # fmt: skip
    """Add H to leading order to chordwise forces at points, and fill zeta' and the change of H by the exact closure.

    The integral of zeta' is that of 1 + N / K - w'^2 / 2 at the same points, so that errors of the quadrature only enter the
    difference from the leading order.  A motion to leading order has the tension to leading order.

    Parameters
    ----------
    sizes, enriched, weights, flexibility, green, leading, corrections
        See :class:`cablepod.condensed._kernels_layout.ErrorTerms`.
    rows
        Boundary data of the samples, see :func:`cablepod.condensed._frame.chord_and_loads` (members, samples, columns).
    y
        Motion in enriched coordinates (members, samples, R).
    squared
        Squared slopes at the points (members, m, samples).
    force
        Chordwise forces of the loads at the points (members, m, samples) [N]; H is added.
    stretch, compliance
        Filled: zeta' and its derivative by N [1/N] (members, m, samples).
    sums
        Filled: the rows TENSION to FLEXIBILITY (members, 5, samples).
    """
    for member in range(y.shape[0]):
        own, total = _of_member(enriched, member), sums[member]
        for t in range(y.shape[1]):
            _chord_tensions(sizes, own, rows[member, t], y[member, t], total[TENSION, t:])
            total[CHORD, t], total[TENSION_CHANGE, t] = 0.0, 0.0
        for j in range(weights.shape[1]):
            weight, flexible = weights[member, j], flexibility[member, j]
            for t in range(y.shape[1]):
                force[member, j, t] += total[TENSION, t]
                strain, square = force[member, j, t] * flexible, squared[member, j, t]
                first = 1.0 + strain - 0.5 * square
                total[CHORD, t] += weight * first
                inner = 1.0 - square + (2.0 * strain + strain * strain if green is None else 2.0 * strain / first)
                stretch[member, j, t] = math.sqrt(inner)
        for _ in range(corrections):
            for t in range(y.shape[1]):
                total[REACH, t], total[FLEXIBILITY, t] = 0.0, 0.0
            for j in range(weights.shape[1]):
                weight, flexible = weights[member, j], flexibility[member, j]
                for t in range(y.shape[1]):
                    change = 0.0 if leading else total[TENSION_CHANGE, t]
                    strain, square = (force[member, j, t] + change) * flexible, squared[member, j, t]
                    correction, derivative, _ = _newton(green, strain, square, stretch[member, j, t])
                    stretch[member, j, t] += correction
                    compliance[member, j, t] = derivative * flexible
                    total[REACH, t] += weight * stretch[member, j, t]
                    total[FLEXIBILITY, t] += weight * compliance[member, j, t]
            for t in range(y.shape[1]):
                total[REACH, t] = (total[CHORD, t] - total[REACH, t]) / total[FLEXIBILITY, t]
                total[TENSION_CHANGE, t] += total[REACH, t]
            if not leading:
                for j in range(weights.shape[1]):
                    for t in range(y.shape[1]):
                        stretch[member, j, t] += compliance[member, j, t] * total[REACH, t]


@compiled(fastmath=FAST_DIVISION, noalias=True, counted=False)
def accelerate_stretch(slopes, stretch, stretching, acceleration):
    """Fill zeta'_tt at the points by zeta' zeta'_t = -w' w'_t and zeta' zeta'_tt = -(w' w'_tt + w'_t^2 + zeta'_t^2).

    The stretch of the cable counts as constant.

    Parameters
    ----------
    slopes
        Slopes w', their rates and accelerations (3, members, planes, m, samples).
    stretch
        zeta' (members, m, samples).
    stretching, acceleration
        Filled: -zeta'_t and zeta'_tt (members, m, samples) [1/s, 1/s^2].
    """
    for member in range(stretch.shape[0]):
        for j in range(stretch.shape[1]):
            for t in range(stretch.shape[2]):
                stretching[member, j, t], acceleration[member, j, t] = 0.0, 0.0
            for plane in range(slopes.shape[2]):
                for t in range(stretch.shape[2]):
                    slope, rate = slopes[0, member, plane, j, t], slopes[1, member, plane, j, t]
                    stretching[member, j, t] += slope * rate
                    acceleration[member, j, t] += slope * slopes[2, member, plane, j, t] + rate * rate
            for t in range(stretch.shape[2]):
                rate = stretching[member, j, t] / stretch[member, j, t]
                stretching[member, j, t] = rate
                acceleration[member, j, t] = -(acceleration[member, j, t] + rate * rate) / stretch[member, j, t]


@compiled(fastmath=FAST_DIVISION, noalias=True, counted=False)
def act_on_slopes(weights, change, force, stretch, momentum, slopes, acting, largest):
    """Fill the exact forces on the slopes, (N - inertia) / zeta' w', less N w' to leading order.

    Parameters
    ----------
    weights
        Of the points (members, m) [m].
    change
        That of H by the exact closure (members, samples) [N].
    force, stretch
        Chordwise force to leading order [N], and zeta' (members, m, samples).
    momentum
        Rate of the chordwise momentum above a point, times its weight (members, m, samples) [N m]; changed.
    slopes
        w' (members, planes, m, samples).
    acting
        Filled (members, planes, m, samples) [N m].
    largest
        Filled: largest exact force (members, samples) [N].
    """
    for member in range(force.shape[0]):
        for j in range(force.shape[1]):
            weight, own = weights[member, j], momentum[member, j]
            for t in range(force.shape[2]):
                exact = force[member, j, t] + change[member, t]
                largest[member, t] = exact if j == 0 else max(largest[member, t], exact)
                own[t] = (weight * exact - own[t]) / stretch[member, j, t] - weight * force[member, j, t]
            for plane in range(slopes.shape[1]):
                for t in range(force.shape[2]):
                    acting[member, plane, j, t] = own[t] * slopes[member, plane, j, t]


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
