"""Compiled terms of a condensed guy of masts abreast: deflections, forces, drag, steps.

A guy has the coordinates p = q + m n.u, with the deflections q in and out of its vertical plane and the displacement u of its
upper end.  The energy of a guy, its chord c = |upper - lower| and its load g along it give the forces,

    H = K (c/L - 1) + K/(2 L) (1 - 2 e) sum of kappa q^2,    F_i = -((1 - 2 e) H + e N0) kappa_i q_i - g (B q)_i + h P_i,

and the force H e + (q.B q h/2 + P.q g) n/c + half of the weight on its upper end at fixed q.

Coordinates are those in the plane, then those out of it (2 r).  Rows of arrays hold a number for each mast.  All guys have the
same shapes: `shared` holds rows of 2 r numbers.
"""

from __future__ import annotations

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.mast._kernels_vectors import all_lanes, load, root, size_of, store, where_less

#: Rows of the numbers of a guy: K [N], K/L [N/m], 1/L [1/m], weight [N/m] and half of the whole [N], 1 - 2 e, e N0 [N], scale of
#: the shapes [kg^-1/2] and its inverse, its square over L [1/(kg m)], L times it [m kg^-1/2], drag [kg/m], largest fitted kappa.
(
    STIFFNESS, SPRING, INVERSE_LENGTH, WEIGHT, HALF_WEIGHT, SOFTENING, STIFFENING, SCALE, INVERSE_SCALE, KAPPA, LOAD, DRAG,
    FITTED_KAPPA,
) = range(13)  # fmt: skip
#: First rows of the axes at rest (9), of the anchor less the height of the end (3) [m], of the mass of the end without that of
#: the coordinates, force in x, y, z by acceleration in x and z (6) [kg]; and number of all rows.
AXES, LOWER, END_MASS, GUY_ROWS = 13, 22, 25, 31
#: Rows of the numbers of the shapes of unit length: squared slope norms, moments, means, and the first of the tilt (r); shapes
#: and slopes at the points of the drag follow.
SLOPE_NORMS, MOMENTS, MEANS, TILT = range(4)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _guy_forces(k, g, n, r, p, numbers, shared, upper, level_rest, q, on_q, on_end, squared, stretch_of, monitor):
    """Fill deflections and the forces on them (2 r, masts), forces on the ends (3 guys, masts) [N]; update the least H.

    Filled are also the squared frequencies (guys, masts) [1/s2] and the chord over the length (guys, masts); `n` is the row of
    the level of the guy in `upper` and `level_rest`.
    """
    at, first = GUY_ROWS * g, 2 * r * g
    # deflections
    at_x, at_z = load(upper, n), load(upper, n + 1)
    x, z = at_x - load(level_rest, n), at_z - load(level_rest, n + 1)
    inverse_scale = load(numbers, at + INVERSE_SCALE)
    moved = inverse_scale * (load(numbers, at + AXES + 3) * x + load(numbers, at + AXES + 5) * z)
    moved_out = inverse_scale * (load(numbers, at + AXES + 6) * x + load(numbers, at + AXES + 8) * z)
    stretching, sag, linear = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
    for i in range(r):
        own = load(p, first + i) - shared[MOMENTS, i] * moved
        out = load(p, first + r + i) - shared[MOMENTS, r + i] * moved_out
        a, b = shared[SLOPE_NORMS, i] * own, shared[SLOPE_NORMS, r + i] * out
        stretching = stretching + a * own + b * out
        sag = sag + a * a + b * b
        linear = linear + shared[MEANS, i] * own
        store(q, i, own)
        store(q, r + i, out)
    # axes
    x, y, z = load(numbers, at + LOWER) - at_x, load(numbers, at + LOWER + 1), load(numbers, at + LOWER + 2) - at_z
    square = x * x + y * y + z * z
    inverse = 1.0 / root(square)
    x, y, z = x * inverse, y * inverse, z * inverse
    flat_square, tiny, one, zero = x * x + z * z, all_lanes(1e-24), all_lanes(1.0), all_lanes(0.0)
    inverse_level = 1.0 / root(where_less(tiny, flat_square, flat_square, one))
    turn = -1.0 * y * inverse_level  # of the normal; along the mast it is that of x
    flat = where_less(tiny, flat_square, flat_square * inverse_level, zero)
    nx = where_less(tiny, flat_square, turn * x, one)
    nz = where_less(tiny, flat_square, turn * z, zero)
    # forces
    stiffness, spring, factor = load(numbers, at + STIFFNESS), load(numbers, at + SPRING), load(numbers, at + KAPPA)
    softening, scale, weight = load(numbers, at + SOFTENING), load(numbers, at + SCALE), load(numbers, at + WEIGHT)
    stretch = square * inverse * load(numbers, at + INVERSE_LENGTH)
    tension = stiffness * (stretch - 1.0) + 0.5 * spring * softening * factor * stretching
    store(stretch_of, g, stretch)
    store(squared, g, size_of(tension) * load(numbers, at + FITTED_KAPPA) + spring * factor * factor * sag)
    straight = factor * (tension * softening + load(numbers, at + STIFFENING))
    along, normal = scale * scale * weight * y, -1.0 * weight * flat * load(numbers, at + LOAD)
    quadratic = all_lanes(0.0)
    for i in range(0, r, 2):
        a, b, c, d = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
        for j in range(r):
            own, out = load(q, j), load(q, r + j)
            a = a + shared[TILT + i, j] * own
            b = b + shared[TILT + i, r + j] * out
            c = c + shared[TILT + i + 1, j] * own
            d = d + shared[TILT + i + 1, r + j] * out
        own, out, own1, out1 = load(q, i), load(q, r + i), load(q, i + 1), load(q, r + i + 1)
        quadratic = quadratic + (own * a + out * b) + (own1 * c + out1 * d)
        store(on_q, i, along * a - straight * shared[SLOPE_NORMS, i] * own + normal * shared[MEANS, i])
        store(on_q, i + 1, along * c - straight * shared[SLOPE_NORMS, i + 1] * own1 + normal * shared[MEANS, i + 1])
        store(on_q, r + i, along * b - straight * shared[SLOPE_NORMS, r + i] * out)
        store(on_q, r + i + 1, along * d - straight * shared[SLOPE_NORMS, r + i + 1] * out1)
    turning = inverse * (
        -0.5 * weight * flat * scale * scale * quadratic - linear * load(numbers, at + LOAD) * weight * y
    )
    store(on_end, 3 * g, tension * x + turning * nx)
    store(on_end, 3 * g + 1, tension * y + turning * flat - load(numbers, at + HALF_WEIGHT))
    store(on_end, 3 * g + 2, tension * z + turning * nz)
    least = load(monitor, 2 * g)
    store(monitor, 2 * g + 1, where_less(tension, least, all_lanes(1.0 * k), load(monitor, 2 * g + 1)))
    store(monitor, 2 * g, where_less(tension, least, tension, least))


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _guy_drag(
    g, n, r, ahead, rates, before, numbers, shared, sigma, weights, air, stretch_of, upper_rate, q, own, drag, held_q, held_end
):  # fmt: skip
    """Fill the drag on a guy, c |t| |u_n| u_n at points along it: forces on its coordinates and on its upper end, to be held.

    u_n is the part normal to the tangent t of the air less the velocity of the guy, whose rates are those `ahead` steps after
    the last.
    """
    at, first, places = GUY_ROWS * g, 2 * r * g, sigma.size
    scale, inverse_scale, stretch = load(numbers, at + SCALE), load(numbers, at + INVERSE_SCALE), load(stretch_of, g)
    a0, a1, a2 = load(numbers, at + AXES), load(numbers, at + AXES + 1), load(numbers, at + AXES + 2)
    a3, a4, a5 = load(numbers, at + AXES + 3), load(numbers, at + AXES + 4), load(numbers, at + AXES + 5)
    a6, a7, a8 = load(numbers, at + AXES + 6), load(numbers, at + AXES + 7), load(numbers, at + AXES + 8)
    x, z = load(upper_rate, n), load(upper_rate, n + 1)
    end_along, end_normal, end_binormal = a0 * x + a2 * z, a3 * x + a5 * z, a6 * x + a8 * z
    moved, moved_out = inverse_scale * end_normal, inverse_scale * end_binormal
    for i in range(r):
        j = first + i
        store(own, i, (1.0 + ahead) * load(rates, j) - ahead * load(before, j) - shared[MOMENTS, i] * moved)
        j += r
        store(own, r + i, (1.0 + ahead) * load(rates, j) - ahead * load(before, j) - shared[MOMENTS, r + i] * moved_out)
    slope_scale = scale * load(numbers, at + INVERSE_LENGTH)
    straight = stretch * stretch
    constant = load(numbers, at + DRAG)
    sum_along, sum_normal, sum_binormal = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
    shapes, slopes, guys = TILT + r, TILT + r + places, air.size // (3 * places)
    for k in range(places):
        a, b, c, d = all_lanes(0.0), all_lanes(0.0), all_lanes(0.0), all_lanes(0.0)
        for i in range(r):
            a = a + shared[slopes + k, i] * load(q, i)
            b = b + shared[slopes + k, r + i] * load(q, r + i)
            c = c + shared[shapes + k, i] * load(own, i)
            d = d + shared[shapes + k, r + i] * load(own, r + i)
        a, b = a * slope_scale, b * slope_scale
        wx, wy, wz = air[3 * k * guys + g], air[(3 * k + 1) * guys + g], air[(3 * k + 2) * guys + g]
        u = a0 * wx + a1 * wy + a2 * wz - sigma[k] * end_along
        v = a3 * wx + a4 * wy + a5 * wz - sigma[k] * end_normal - scale * c
        w = a6 * wx + a7 * wy + a8 * wz - sigma[k] * end_binormal - scale * d
        # the tangent points from the anchor to the mast, the first axis the other way
        square = straight + a * a + b * b
        product = (v * a + w * b - u * stretch) / square
        u, v, w = u + product * stretch, v - product * a, w - product * b
        size = weights[k] * constant * root(square * (u * u + v * v + w * w))
        u, v, w = size * u, size * v, size * w
        sum_along = sum_along + sigma[k] * u
        sum_normal = sum_normal + sigma[k] * v
        sum_binormal = sum_binormal + sigma[k] * w
        store(drag, k, scale * v)
        store(drag, places + k, scale * w)
    for i in range(r):
        a, b = all_lanes(0.0), all_lanes(0.0)
        for k in range(places):
            a = a + shared[shapes + k, i] * load(drag, k)
            b = b + shared[shapes + k, r + i] * load(drag, places + k)
        store(held_q, first + i, a)
        store(held_q, first + r + i, b)
    store(held_end, 3 * g, sum_along * a0 + sum_normal * a3 + sum_binormal * a6)
    store(held_end, 3 * g + 1, sum_along * a1 + sum_normal * a4 + sum_binormal * a7)
    store(held_end, 3 * g + 2, sum_along * a2 + sum_normal * a5 + sum_binormal * a8)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _advance_guy(
    at_rest, step, g, n, r, p, rates, before, gain, keep, numbers, shared, on_q, held_q, on_end, held_end, level_force
):  # fmt: skip
    """Advance rates and coordinates by a step, the first by half an impulse; take the forces on the moments from the end."""
    at, first = GUY_ROWS * g, 2 * r * g
    taken, taken_out = all_lanes(0.0), all_lanes(0.0)
    last, impulse = keep, 1.0
    if at_rest:
        last, impulse = 0.0, 0.5
    for i in range(r):
        a, b = load(on_q, i) + load(held_q, first + i), load(on_q, r + i) + load(held_q, first + r + i)
        taken = taken + shared[MOMENTS, i] * a
        taken_out = taken_out + shared[MOMENTS, r + i] * b
        j = first + i
        old = load(rates, j)
        new = last * old + impulse * load(gain, j) * a
        store(before, j, -1.0 * new if at_rest else old)
        store(rates, j, new)
        store(p, j, load(p, j) + step * new)
        j += r
        old = load(rates, j)
        new = last * old + impulse * load(gain, j) * b
        store(before, j, -1.0 * new if at_rest else old)
        store(rates, j, new)
        store(p, j, load(p, j) + step * new)
    inverse_scale = load(numbers, at + INVERSE_SCALE)
    taken, taken_out = taken * inverse_scale, taken_out * inverse_scale
    j = at + AXES
    x = load(on_end, 3 * g) + load(held_end, 3 * g)
    y = load(on_end, 3 * g + 1) + load(held_end, 3 * g + 1)
    z = load(on_end, 3 * g + 2) + load(held_end, 3 * g + 2)
    x = x - taken * load(numbers, j + 3) - taken_out * load(numbers, j + 6)
    y = y - taken * load(numbers, j + 4) - taken_out * load(numbers, j + 7)
    z = z - taken * load(numbers, j + 5) - taken_out * load(numbers, j + 8)
    store(on_end, 3 * g, x)
    store(on_end, 3 * g + 1, y)
    store(on_end, 3 * g + 2, z)
    store(level_force, n, load(level_force, n) + x)
    store(level_force, n + 1, load(level_force, n + 1) + z)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _end_tension(g, n, numbers, acceleration, on_end):
    """Take the inertia of the upper end from the force on it; return the tension [N]."""
    at = GUY_ROWS * g + END_MASS
    x, z = load(acceleration, n), load(acceleration, n + 1)
    u = load(on_end, 3 * g) - load(numbers, at) * x - load(numbers, at + 1) * z
    v = load(on_end, 3 * g + 1) - load(numbers, at + 2) * x - load(numbers, at + 3) * z
    w = load(on_end, 3 * g + 2) - load(numbers, at + 4) * x - load(numbers, at + 5) * z
    store(on_end, 3 * g, u)
    store(on_end, 3 * g + 1, v)
    store(on_end, 3 * g + 2, w)
    return root(u * u + v * v + w * w)
