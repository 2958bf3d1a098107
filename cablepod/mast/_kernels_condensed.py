"""Compiled terms of condensed guys, which lie abreast in lanes: deflections, forces, drag, steps.

A guy has the coordinates p = q + m n.u, with the deflections q in and out of its vertical plane and the displacement u of its
upper end.  The mass matrix of p and of the modal coordinates of the mast is constant and block diagonal, so that no step has an
iteration.  The energy of a guy, its chord c = |upper - lower| and its load g along it give the forces, closure and drag being
those of the condensed model,

    H = K (c/L - 1) + K/(2 L) (1 - 2 e) sum of kappa q^2,    F_i = -((1 - 2 e) H + e N0) kappa_i q_i - g (B q)_i + h P_i,

and the force H e + (q.B q h/2 + P.q g) n/c + half of the weight on its upper end at fixed q.

Guys are the last dimension of their arrays, padded to whole groups of lanes.  Loops over them write to arrays of which they read
no other row, so that they become a few instructions; modes are padded to multiples of four, which are taken together.
"""

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.condensed._kernels_closure import _chord_tensions
from cablepod.condensed._kernels_drag import _spatial_law
from cablepod.mast import _kernels_layout as at


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _place_guys(of_guys, guys, mast, beam, state):
    """Fill the upper ends with their rates, the axes along the chords and normal to them, and the deflections q = p - m n.u."""
    ends, axes, moved, chord, lanes = state.ends, of_guys.axes, state.moved, state.chord, state.chord.size
    for g in range(guys.level.size):
        n = guys.level[g]
        ends[at.X, g] = mast.upper[2 * n] - beam.level_rest[n, 0]
        ends[at.Y, g] = mast.lowered[n]
        ends[at.Z, g] = mast.upper[2 * n + 1] - beam.level_rest[n, 1]
        ends[at.RATE_X, g] = mast.upper_rate[n, 0]
        ends[at.RATE_Z, g] = mast.upper_rate[n, 1]
    for g in range(lanes):
        x, y, z = (
            of_guys.reach[0, g] - ends[at.X, g],
            of_guys.reach[1, g] - ends[at.Y, g],
            of_guys.reach[2, g] - ends[at.Z, g],
        )
        size = math.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / size
        chord[g] = size
        state.stretch[g] = size / of_guys.numbers[at.LENGTH, g]
        x *= inverse
        y *= inverse
        z *= inverse
        square = x * x + z * z
        beside = square > 1e-24
        level = math.sqrt(square) if beside else 1.0  # the vertical component of the normal; 0 along the mast
        turn = -y / level
        state.axis_x[g] = x
        state.axis_y[g] = y
        state.axis_z[g] = z
        state.level[g] = level if beside else 0.0
        state.normal_x[g] = turn * x if beside else 1.0
        state.normal_z[g] = turn * z if beside else 0.0
    for part in range(2):
        k = 3 + 3 * part
        for g in range(lanes):
            moved[part, g] = (
                axes[k, g] * ends[at.X, g] + axes[k + 1, g] * ends[at.Y, g] + axes[k + 2, g] * ends[at.Z, g]
            )
        for i in range(state.q.shape[1]):
            for g in range(lanes):
                state.q[part, i, g] = state.p[part, i, g] - of_guys.moments[part, i, g] * moved[part, g]


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _guy_forces(of_guys, state, on_mast):
    """Fill forces on the coordinates (2, r, lanes) and on the mast (3, lanes) [N], H [N] and the stiffness of the sag [1/s2]."""
    numbers, kappa, loads, tilt = of_guys.numbers, of_guys.kappa, of_guys.loads, of_guys.tilt
    q, tension, sag, straight, along, normal = (
        state.q, state.tension, state.sag, state.straight, state.along, state.normal
    )  # fmt: skip
    quadratic, linear, tilted = state.quadratic, state.linear, state.tilted
    r, lanes = q.shape[1], q.shape[2]
    _chord_tensions(of_guys.sizes, of_guys.terms, state.chord, q.reshape(q.size), tension)
    for g in range(lanes):
        straight[g] = -(tension[g] * numbers[at.SOFTENING, g] + numbers[at.STIFFENING, g])
        along[g] = numbers[at.WEIGHT, g] * state.axis_y[g]  # minus the load along the chord
        normal[g] = -numbers[at.WEIGHT, g] * state.level[g]  # the load across it
        sag[g] = 0.0
        quadratic[g] = 0.0
        linear[g] = 0.0
    for part in range(2):
        for i in range(r):
            for j in range(0, r, 4):
                kept = 1.0 if j > 0 else 0.0
                for g in range(lanes):
                    tilted[g] = kept * tilted[g] + (
                        tilt[part, i, j] * q[part, j, g] + tilt[part, i, j + 1] * q[part, j + 1, g]
                        + tilt[part, i, j + 2] * q[part, j + 2, g] + tilt[part, i, j + 3] * q[part, j + 3, g]
                    )  # fmt: skip
            for g in range(lanes):
                turned = numbers[at.SCALE, g] * numbers[at.SCALE, g] * tilted[g]
                x, bent = q[part, i, g], kappa[part, i, g] * q[part, i, g]
                state.on_q[part, i, g] = straight[g] * bent + along[g] * turned + normal[g] * loads[part, i, g]
                sag[g] += bent * bent
                quadratic[g] += x * turned
                linear[g] += x * loads[part, i, g]
    for g in range(lanes):
        turning = (0.5 * quadratic[g] * normal[g] - linear[g] * along[g]) / state.chord[g]
        on_mast[0, g] = tension[g] * state.axis_x[g] + turning * state.normal_x[g]
        on_mast[1, g] = (
            tension[g] * state.axis_y[g]
            + turning * state.level[g]
            - 0.5 * numbers[at.WEIGHT, g] * numbers[at.LENGTH, g]
        )
        on_mast[2, g] = tension[g] * state.axis_z[g] + turning * state.normal_z[g]
        sag[g] *= numbers[at.STIFFNESS, g] / numbers[at.LENGTH, g]


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _fill_own_rates(ahead, of_guys, state):
    """Fill rates of the ends along the chords (lanes,), of the deflections (2, r, lanes) `ahead` steps after the last."""
    axes, ends, moved, own, lanes = of_guys.axes, state.ends, state.moved, state.own, state.chord.size
    for g in range(lanes):
        state.end_along[g] = axes[0, g] * ends[at.RATE_X, g] + axes[2, g] * ends[at.RATE_Z, g]
    for part in range(2):
        k = 3 + 3 * part
        for g in range(lanes):
            moved[part, g] = axes[k, g] * ends[at.RATE_X, g] + axes[k + 2, g] * ends[at.RATE_Z, g]
        for i in range(own.shape[1]):
            for g in range(lanes):
                own[part, i, g] = (
                    (1.0 + ahead) * state.rates[part, i, g] - ahead * state.before[part, i, g]
                    - of_guys.moments[part, i, g] * moved[part, g]
                )  # fmt: skip


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _fill_drag(of_guys, state, wind):
    """Fill the drag on coordinates and mast that is held, of deflections and their rates relative to the chord."""
    numbers, axes, stretch = of_guys.numbers, of_guys.axes, state.stretch
    q, own, shapes, slopes, sigma, air = state.q, state.own, wind.shapes, wind.slopes, wind.sigma, wind.air
    slope, rate, chordwise, across, sums = wind.slope, wind.rate, wind.chordwise, wind.across, wind.sums
    r, lanes, points = q.shape[1], q.shape[2], sigma.size
    for k in range(points):
        for part in range(2):
            for i in range(0, r, 4):
                kept = 1.0 if i > 0 else 0.0
                for g in range(lanes):
                    slope[part, g] = kept * slope[part, g] + (
                        slopes[part, k, i] * q[part, i, g] + slopes[part, k, i + 1] * q[part, i + 1, g]
                        + slopes[part, k, i + 2] * q[part, i + 2, g] + slopes[part, k, i + 3] * q[part, i + 3, g]
                    )  # fmt: skip
                    rate[part, g] = kept * rate[part, g] + (
                        shapes[part, k, i] * own[part, i, g] + shapes[part, k, i + 1] * own[part, i + 1, g]
                        + shapes[part, k, i + 2] * own[part, i + 2, g] + shapes[part, k, i + 3] * own[part, i + 3, g]
                    )  # fmt: skip
        for g in range(lanes):
            scale = numbers[at.SCALE, g]
            a, b = slope[0, g] * numbers[at.SLOPE_SCALE, g], slope[1, g] * numbers[at.SLOPE_SCALE, g]
            x, y, z = air[3 * k * lanes + g], air[(3 * k + 1) * lanes + g], air[(3 * k + 2) * lanes + g]
            u = axes[0, g] * x + axes[1, g] * y + axes[2, g] * z - sigma[k] * state.end_along[g]
            v = axes[3, g] * x + axes[4, g] * y + axes[5, g] * z - sigma[k] * state.moved[0, g] - scale * rate[0, g]
            w = axes[6, g] * x + axes[7, g] * y + axes[8, g] * z - sigma[k] * state.moved[1, g] - scale * rate[1, g]
            # the tangent points from the anchor to the mast, the first axis the other way
            square = stretch[g] * stretch[g] + a * a + b * b
            u, v, w = _spatial_law(wind.drag[k, g], -stretch[g], square, u, v, w, a, b)
            chordwise[k, g] = u
            across[0, k, g] = v
            across[1, k, g] = w
    for part in range(2):
        for i in range(r):
            for k in range(0, points, 2):
                kept = 1.0 if k > 0 else 0.0
                for g in range(lanes):
                    wind.held_q[part, i, g] = kept * wind.held_q[part, i, g] + numbers[at.SCALE, g] * (
                        shapes[part, k, i] * across[part, k, g] + shapes[part, k + 1, i] * across[part, k + 1, g]
                    )
        for k in range(0, points, 2):
            kept = 1.0 if k > 0 else 0.0
            for g in range(lanes):
                sums[1 + part, g] = kept * sums[1 + part, g] + (
                    sigma[k] * across[part, k, g] + sigma[k + 1] * across[part, k + 1, g]
                )
    for k in range(0, points, 2):
        kept = 1.0 if k > 0 else 0.0
        for g in range(lanes):
            sums[0, g] = kept * sums[0, g] + sigma[k] * chordwise[k, g] + sigma[k + 1] * chordwise[k + 1, g]
    for d in range(3):
        for g in range(lanes):
            wind.held[d, g] = sums[0, g] * axes[d, g] + sums[1, g] * axes[3 + d, g] + sums[2, g] * axes[6 + d, g]


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _add_drag(state, wind, on_mast):
    """Add the drag that is held to the forces on the coordinates and on the mast."""
    for part in range(2):
        for i in range(state.on_q.shape[1]):
            for g in range(state.chord.size):
                state.on_q[part, i, g] += wind.held_q[part, i, g]
    for d in range(3):
        for g in range(state.chord.size):
            on_mast[d, g] += wind.held[d, g]


@compiled(noalias=True, counted=False, fastmath=FAST_DIVISION)
def drag_at_rest(of_guys, state, wind):
    """Fill the drag on guys whose deflections, upper ends and air are given; nothing moves."""
    _fill_drag(of_guys, state, wind)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _watch(k, step, of_guys, state, guys):
    """Update least H and its steps; return status and guy, where the squared frequency of one is not below its limit."""
    tension, sag, kappa, least = state.tension, state.sag, of_guys.numbers, guys.least
    limit, beyond = 4.0 / (step * step), 0.0
    for g in range(guys.breaks.size):
        if k >= guys.breaks[g]:  # no longer watched
            tension[g] = least[g]
            sag[g] = 0.0
    for g in range(tension.size):
        less = tension[g] < least[g]
        least[g] = tension[g] if less else least[g]
        guys.least_step[g] = k if less else guys.least_step[g]
        beyond += 0.0 if abs(tension[g]) * kappa[at.LARGEST_KAPPA, g] + sag[g] < limit else 1.0
    if beyond > 0.0:
        for g in range(guys.breaks.size):
            if not abs(tension[g]) * kappa[at.LARGEST_KAPPA, g] + sag[g] < limit:
                return at.UNSTABLE if abs(tension[g]) < np.inf else at.DIVERGED, g
    return at.DONE, 0


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _damp(damping, of_guys, state):
    """Change the forces f on the coordinates into A (f - D u), with rates u of deflections half a step before.

    With A = (1 + step / 2 D F)^-1 and the fitted factors F the damping is that of the mean rates of the step.
    """
    if damping is None:
        return
    _fill_own_rates(0.0, of_guys, state)
    own, on_q, damped = state.own, state.on_q, state.damped
    r, lanes = on_q.shape[1], on_q.shape[2]
    for part in range(2):
        for i in range(r):
            for g in range(lanes):
                damped[part, i, g] = on_q[part, i, g]
            for j in range(r):
                for g in range(lanes):
                    damped[part, i, g] -= damping[0, part, i, j, g] * own[part, j, g]
        for i in range(r):
            for j in range(r):
                kept = 1.0 if j > 0 else 0.0
                for g in range(lanes):
                    on_q[part, i, g] = kept * on_q[part, i, g] + damping[1, part, i, j, g] * damped[part, j, g]


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _advance_guys(k, pace, of_guys, scheme, state, guys):
    """Advance rates and coordinates by a step, the first by half an impulse; take forces on the moments from the mast."""
    moved, on_q, rates, before, r, lanes = (
        state.moved, state.on_q, state.rates, state.before, state.q.shape[1], state.q.shape[2]
    )  # fmt: skip
    for g in range(guys.breaks.size):
        if k >= guys.breaks[g]:  # a broken guy rests
            for part in range(2):
                for i in range(r):
                    on_q[part, i, g] = rates[part, i, g] = 0.0
    last = scheme.keep if k > 0 else 0.0
    impulse = 1.0 if k > 0 else 0.5
    sign = 1.0 if k > 0 else -1.0
    for part in range(2):
        for i in range(r):
            kept = 1.0 if i > 0 else 0.0
            for g in range(lanes):
                force = on_q[part, i, g]
                old = rates[part, i, g]
                new = last * old + impulse * scheme.gain[part, i, g] * force
                moved[part, g] = kept * moved[part, g] + of_guys.moments[part, i, g] * force
                before[part, i, g] = old if sign > 0.0 else -new
                rates[part, i, g] = new
                state.p[part, i, g] += pace.step * new
    for d in range(3):
        for g in range(lanes):
            guys.force[d, g] -= moved[0, g] * of_guys.axes[3 + d, g] + moved[1, g] * of_guys.axes[6 + d, g]
    if k % pace.every == 0 and state.saved.shape[0] > 0:
        row = k // pace.every
        for part in range(2):
            for i in range(r):
                for g in range(lanes):
                    state.saved[row, 0, part, i, g] = state.q[part, i, g]
                    state.saved[row, 1, part, i, g] = before[part, i, g]
                    state.saved[row, 2, part, i, g] = rates[part, i, g]
