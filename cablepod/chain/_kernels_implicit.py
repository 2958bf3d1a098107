"""Implicit steps of the elastic chain: generalized alpha (the trapezoidal rule is one) and energy-momentum; O(n) per step.

Every step solves for the displacements by Newton's method.  A link couples its two particles alone, so the tangent is block
tridiagonal with blocks of 2 x 2 or 3 x 3; it is eliminated from both ends towards the middle, two chains of operations that do
not wait for each other, which halves the time.

Arrays over links have n + 2 places: link j stands at j + 1, and the zeros at both ends stand for the links that a free end lacks.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

_options: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True}
# products and sums in one instruction, where the machine has it: the elimination is a fifth faster, and no test for numbers that
# are not finite is weakened
_fused: dict[str, Any] = {**_options, "fastmath": {"contract"}}
MOST_ITERATIONS = 30


# --- block tridiagonal systems ----------------------------------------------------------------------------------------


@njit(**_fused)
def _eliminate(a, b, c, s, rx, ry):
    """Eliminate a particle with the block D = [[a, b], [b, c]], the link S to the next one and the right side r.

    Returns D^-1 S (four numbers), D^-1 r, and what the next one loses, S D^-1 S (three), and gains, S D^-1 r.  The products wait
    for no division: that by the determinant, the slowest operation, goes on beside them.
    """
    scale = 1.0 / (a * c - b * b)
    sxx, sxy, syy = s
    # the adjugate of D times S, and S times that
    mxx, mxy = c * sxx - b * sxy, c * sxy - b * syy
    myx, myy = a * sxy - b * sxx, a * syy - b * sxy
    lost = (sxx * mxx + sxy * myx) * scale, (sxx * mxy + sxy * myy) * scale, (sxy * mxy + syy * myy) * scale
    tx, ty = (c * rx - b * ry) * scale, (a * ry - b * rx) * scale
    return (
        (mxx * scale, mxy * scale, myx * scale, myy * scale),
        (tx, ty),
        lost,
        (sxx * tx + sxy * ty, sxy * tx + syy * ty),
    )


@njit(**_fused)
def solve_planar(diagonal, s, b, kept, first, last):
    """Solve the system of the chain, planar.

    Row p, for the free particle p, is (diagonal_p + S_below + S_above) d_p - S_below d_(p-1) - S_above d_(p+1) = b_p; the
    particles before `first` and from `last` on do not move.

    Parameters
    ----------
    diagonal : float array (n + 1,)
        What is added to the diagonal of each block, inertia over the square of the step [N/m].
    s : tuple of 3 float arrays (n + 2,)
        xx, xy, yy of the tangent stiffness of the links [N/m].
    b : tuple of 2 float arrays (n + 1,)
        Right side [N]; overwritten by the solution [m] from `first` to `last` - 1.
    kept : tuple of 4 float arrays (n + 1,)
        To work in.
    first, last : int
        The free particles.
    """
    sxx, sxy, syy = s
    bx, by = b
    mxx, mxy, myx, myy = kept
    half = (last - first) // 2
    up, u = (0.0, 0.0, 0.0), (0.0, 0.0)
    down, w = up, u
    for i in range(half):
        # from the lower end upwards
        p = first + i
        above = (sxx[p + 1], sxy[p + 1], syy[p + 1])
        matrix, t, up, u = _eliminate(
            diagonal[p] + sxx[p] + above[0] - up[0],
            sxy[p] + above[1] - up[1],
            diagonal[p] + syy[p] + above[2] - up[2],
            above, bx[p] + u[0], by[p] + u[1],
        )  # fmt: skip
        mxx[p], mxy[p], myx[p], myy[p] = matrix
        bx[p], by[p] = t
        # from the upper end downwards
        p = last - 1 - i
        if p > first + half:
            below = (sxx[p], sxy[p], syy[p])
            matrix, t, down, w = _eliminate(
                diagonal[p] + below[0] + sxx[p + 1] - down[0],
                below[1] + sxy[p + 1] - down[1],
                diagonal[p] + below[2] + syy[p + 1] - down[2],
                below, bx[p] + w[0], by[p] + w[1],
            )  # fmt: skip
            mxx[p], mxy[p], myx[p], myy[p] = matrix
            bx[p], by[p] = t
    p = first + half
    _, t, _, _ = _eliminate(
        diagonal[p] + sxx[p] + sxx[p + 1] - up[0] - down[0],
        sxy[p] + sxy[p + 1] - up[1] - down[1],
        diagonal[p] + syy[p] + syy[p + 1] - up[2] - down[2],
        (0.0, 0.0, 0.0), bx[p] + u[0] + w[0], by[p] + u[1] + w[1],
    )  # fmt: skip
    tx, ty = t
    bx[p], by[p] = tx, ty
    qx, qy = tx, ty
    for i in range(half):
        p = first + half - 1 - i
        tx, ty = mxx[p] * tx + mxy[p] * ty + bx[p], myx[p] * tx + myy[p] * ty + by[p]
        bx[p], by[p] = tx, ty
        p = first + half + 1 + i
        if p < last:
            qx, qy = mxx[p] * qx + mxy[p] * qy + bx[p], myx[p] * qx + myy[p] * qy + by[p]
            bx[p], by[p] = qx, qy


@njit(**_fused)
def _inverse3(a, b, c, d, e, f):
    """Inverse of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]], as six numbers in the same order."""
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * p + b * q + c * r)
    return p * scale, q * scale, r * scale, (a * f - c * c) * scale, (b * c - a * e) * scale, (a * d - b * b) * scale


@njit(**_fused)
def _times3(s, x, y, z):
    """Product of a symmetric matrix and a vector."""
    return s[0] * x + s[1] * y + s[2] * z, s[1] * x + s[3] * y + s[4] * z, s[2] * x + s[4] * y + s[5] * z


@njit(**_fused)
def _sandwich3(s, i):
    """S I S of symmetric matrices, as six numbers."""
    a = _times3(i, s[0], s[1], s[2])
    b = _times3(i, s[1], s[3], s[4])
    c = _times3(i, s[2], s[4], s[5])
    xx, xy, xz = _times3(s, a[0], a[1], a[2])
    _, yy, yz = _times3(s, b[0], b[1], b[2])
    _, _, zz = _times3(s, c[0], c[1], c[2])
    return xx, xy, xz, yy, yz, zz


@njit(**_options)
def _at3(s, p):
    return s[0][p], s[1][p], s[2][p], s[3][p], s[4][p], s[5][p]


@njit(**_fused)
def _block3(diagonal, below, above, taken, also):
    """Inverse of the block of a particle, less what elimination took off."""
    return _inverse3(
        diagonal + below[0] + above[0] - taken[0] - also[0],
        below[1] + above[1] - taken[1] - also[1],
        below[2] + above[2] - taken[2] - also[2],
        diagonal + below[3] + above[3] - taken[3] - also[3],
        below[4] + above[4] - taken[4] - also[4],
        diagonal + below[5] + above[5] - taken[5] - also[5],
    )


@njit(**_fused)
def solve_spatial(diagonal, s, b, kept, first, last):
    """Solve the system of the chain, spatial; s and kept are tuples of 6 arrays (xx, xy, xz, yy, yz, zz), b one of 3."""
    bx, by, bz = b
    half = (last - first) // 2
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    up, down = none, none
    u, w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(half):
        p = first + i
        above = _at3(s, p + 1)
        inverse = _block3(diagonal[p], _at3(s, p), above, up, none)
        kept[0][p], kept[1][p], kept[2][p], kept[3][p], kept[4][p], kept[5][p] = inverse
        bx[p] += u[0]
        by[p] += u[1]
        bz[p] += u[2]
        t = _times3(inverse, bx[p], by[p], bz[p])
        u = _times3(above, t[0], t[1], t[2])
        up = _sandwich3(above, inverse)
        p = last - 1 - i
        if p > first + half:
            below = _at3(s, p)
            inverse = _block3(diagonal[p], below, _at3(s, p + 1), down, none)
            kept[0][p], kept[1][p], kept[2][p], kept[3][p], kept[4][p], kept[5][p] = inverse
            bx[p] += w[0]
            by[p] += w[1]
            bz[p] += w[2]
            t = _times3(inverse, bx[p], by[p], bz[p])
            w = _times3(below, t[0], t[1], t[2])
            down = _sandwich3(below, inverse)
    p = first + half
    inverse = _block3(diagonal[p], _at3(s, p), _at3(s, p + 1), up, down)
    t = _times3(inverse, bx[p] + u[0] + w[0], by[p] + u[1] + w[1], bz[p] + u[2] + w[2])
    bx[p], by[p], bz[p] = t
    q = t
    for i in range(half):
        p = first + half - 1 - i
        r = _times3(_at3(s, p + 1), t[0], t[1], t[2])
        t = _times3(_at3(kept, p), bx[p] + r[0], by[p] + r[1], bz[p] + r[2])
        bx[p], by[p], bz[p] = t
        p = first + half + 1 + i
        if p < last:
            r = _times3(_at3(s, p), q[0], q[1], q[2])
            q = _times3(_at3(kept, p), bx[p] + r[0], by[p] + r[1], bz[p] + r[2])
            bx[p], by[p], bz[p] = q


# --- links ------------------------------------------------------------------------------------------------------------


@njit(**_options)
def _pull_planar(x, y, u, v, k, length, inverse, viscosity, rate, fx, fy, sxx, sxy, syy):
    """Compute forces of the links [N] and tangent stiffness [N/m]; `rate` [1/s] is d velocity / d position of the step."""
    for j in range(k.size):
        dx, dy = x[j + 1] - x[j], y[j + 1] - y[j]
        square = dx * dx + dy * dy
        if inverse is None:
            part = length[j] / math.sqrt(square)
            s = k[j] * (1.0 - part)
            g = k[j] * part / square
            taut = s > 0.0
            if viscosity is not None:
                c = viscosity * k[j] / square
                total = s + c * (dx * (u[j + 1] - u[j]) + dy * (v[j + 1] - v[j]))
                taut = taut and total > 0.0
                s, g = total, g + c * rate
            s = s if taut else 0.0
            g = g if taut else 0.0
        else:
            s = 0.5 * k[j] * (square * inverse[j] - 1.0)
            g = k[j] * inverse[j]
        fx[j + 1] = s * dx
        fy[j + 1] = s * dy
        sxx[j + 1] = s + g * dx * dx
        sxy[j + 1] = g * dx * dy
        syy[j + 1] = s + g * dy * dy


@njit(**_options)
def _pull_spatial(x, y, z, u, v, w, k, length, inverse, viscosity, rate, fx, fy, fz, s):
    """Do the same in space; s (6, n + 2) is filled with xx, xy, xz, yy, yz, zz."""
    for j in range(k.size):
        dx, dy, dz = x[j + 1] - x[j], y[j + 1] - y[j], z[j + 1] - z[j]
        square = dx * dx + dy * dy + dz * dz
        if inverse is None:
            part = length[j] / math.sqrt(square)
            t = k[j] * (1.0 - part)
            g = k[j] * part / square
            taut = t > 0.0
            if viscosity is not None:
                c = viscosity * k[j] / square
                total = t + c * (dx * (u[j + 1] - u[j]) + dy * (v[j + 1] - v[j]) + dz * (w[j + 1] - w[j]))
                taut = taut and total > 0.0
                t, g = total, g + c * rate
            t = t if taut else 0.0
            g = g if taut else 0.0
        else:
            t = 0.5 * k[j] * (square * inverse[j] - 1.0)
            g = k[j] * inverse[j]
        fx[j + 1] = t * dx
        fy[j + 1] = t * dy
        fz[j + 1] = t * dz
        _fill3(s, j + 1, t, g, dx, dy, dz)


@njit(**_options)
def _fill3(s, p, t, g, dx, dy, dz):
    s[0, p] = t + g * dx * dx
    s[1, p] = g * dx * dy
    s[2, p] = g * dx * dz
    s[3, p] = t + g * dy * dy
    s[4, p] = g * dy * dz
    s[5, p] = t + g * dz * dz


@njit(**_options)
def _secant(square0, square1, k, length, inverse):
    """Difference quotient of a link's energy, 2 (W1 - W0) / (|R1|^2 - |R0|^2) [N/m], and its slope by |R1|^2 / 2.

    Written so that nothing cancels where both lengths are nearly the same.
    """
    if inverse is not None:
        return 0.25 * k * ((square0 + square1) * inverse - 2.0), 0.5 * k * inverse
    size0, size1 = math.sqrt(square0), math.sqrt(square1)
    over0, over1 = size0 - length, size1 - length
    total = size0 + size1
    if over0 > 0.0 and over1 > 0.0:
        return k * (1.0 - 2.0 * length / total), 2.0 * k * length / (total * total * size1)
    if over0 <= 0.0 and over1 <= 0.0:
        return 0.0, 0.0
    # one end of the step is slack: only the part beyond the unstretched length counts
    over = max(over0, over1)
    gap = abs(size1 - size0)
    value = k * over * over / (gap * total)
    # by |R1|: of over^2 / (|R1|^2 - |R0|^2) where the end is taut, else of -over^2 / (...)
    slope = (
        (2.0 * k * over - 2.0 * value * size1) / (gap * total) if over1 > 0.0 else 2.0 * value * size1 / (gap * total)
    )
    return value, max(slope, 0.0) / size1


@njit(**_options)
def _pull_conserving(x0, x1, k, length, inverse, viscosity, per_step, f, s):
    """Compute forces that keep the energy over a step from x0 to x1, and their tangent, exact but for the turn of the links."""
    dims, particles = x0.shape
    for j in range(k.size):
        square0, square1, middle, growth = 0.0, 0.0, 0.0, 0.0
        for c in range(dims):
            a, b = x0[c, j + 1] - x0[c, j], x1[c, j + 1] - x1[c, j]
            square0 += a * a
            square1 += b * b
            middle += 0.25 * (a + b) * (a + b)
            growth += 0.5 * (a + b) * (b - a)
        if inverse is None:
            t, g = _secant(square0, square1, k[j], length[j], None)
        else:
            t, g = _secant(square0, square1, k[j], length[j], inverse[j])
        if viscosity is not None and t > 0.0:
            damper = viscosity * k[j] * per_step / middle
            total = t + damper * growth
            t, g = (total, g + damper) if total > 0.0 else (0.0, 0.0)
        dx, dy = (
            0.5 * (x0[0, j + 1] - x0[0, j] + x1[0, j + 1] - x1[0, j]),
            0.5 * (x0[1, j + 1] - x0[1, j] + x1[1, j + 1] - x1[1, j]),
        )
        f[j + 1] = t * dx
        f[particles + j + 1] = t * dy
        if dims == 2:
            s[0, j + 1] = 0.5 * t + g * dx * dx
            s[1, j + 1] = g * dx * dy
            s[2, j + 1] = 0.5 * t + g * dy * dy
        else:
            dz = 0.5 * (x0[2, j + 1] - x0[2, j] + x1[2, j + 1] - x1[2, j])
            f[2 * particles + j + 1] = t * dz
            _fill3(s, j + 1, 0.5 * t, g, dx, dy, dz)


@njit(**_options)
def _correction(f, s, held, diagonal, d, b, kept, first, last, per_length):
    """Compute the correction b of the displacements d, and by how much it turns the links.

    The right side is the forces of the links and what is `held` during a step, less what grows with d.
    """
    dims, particles = b.shape
    flat = b.reshape(-1)
    # one loop for all coordinates: the place before the first link of one is that after the last link of the other
    for q in range(flat.size):
        flat[q] = f[q + 1] - f[q] + (held[q] - diagonal[q] * d[q])
    for c in range(dims):
        if first == 1:
            b[c, 0] = 0.0
        if last == particles - 1:
            b[c, last] = 0.0
    if dims == 2:
        solve_planar(diagonal, (s[0], s[1], s[2]), (b[0], b[1]), (kept[0], kept[1], kept[2], kept[3]), first, last)
    else:
        solve_spatial(
            diagonal, (s[0], s[1], s[2], s[3], s[4], s[5]), (b[0], b[1], b[2]),
            (kept[0], kept[1], kept[2], kept[3], kept[4], kept[5]), first, last,
        )  # fmt: skip
    return _turn(flat, per_length)


@njit(fastmath={"reassoc", "nsz"}, **_options)
def _turn(b, per_length):
    """Root of the mean square by which a correction turns and stretches the links, in any order of addition.

    Not a number where a correction is not: the options of the compiler assume nothing about that.
    """
    total = 0.0
    for q in range(b.size - 1):
        turn = (b[q + 1] - b[q]) * per_length[q]
        total += turn * turn
    return math.sqrt(total / b.size)


@njit(inline="always", **_options)
def _correct(d, b, x, trial):
    """Add the correction b to the displacements d and put the particles there."""
    for q in range(d.size):
        new = d[q] + b[q]
        d[q] = new
        trial[q] = x[q] + new


@njit(**_options)
def _hold(held, patterns, factors):
    """Add loads that vary in time to what is held during a step."""
    flat = patterns.reshape((patterns.shape[0], held.size))
    for load in range(patterns.shape[0]):
        factor = factors[load]
        for q in range(held.size):
            held[q] += factor * flat[load, q]


@njit(**_options)
def _set_ends(trial, lower, upper, i):
    last = trial.shape[1] - 1
    for c in range(trial.shape[0]):
        if lower is not None:
            trial[c, 0] = lower[i, c]
        if upper is not None:
            trial[c, last] = upper[i, c]


@njit(**_options)
def _note_tension(x, low, high, inverse, k, length):
    """Update the extremes of the tensions [N] at positions x."""
    for j in range(low.size):
        square = 0.0
        for c in range(x.shape[0]):
            reach = x[c, j + 1] - x[c, j]
            square += reach * reach
        size = math.sqrt(square)
        if inverse is None:  # an if that the compiler can prune
            low[j] = min(low[j], max(k[j] * (size - length[j]), 0.0))
            high[j] = max(high[j], k[j] * (size - length[j]), 0.0)
        else:
            tension = 0.5 * k[j] * (square * inverse[j] - 1.0) * size
            low[j] = min(low[j], tension)
            high[j] = max(high[j], tension)


# --- time steps -------------------------------------------------------------------------------------------------------


@njit(**_options)
def generalized_alpha(
    x, v, a, g, first, last, k, length, inverse, mass, damping, loads, patterns, factors, viscosity, lower, upper, end_rates,
    step, alpha_m, alpha_f, beta, gamma, enough, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the generalized-alpha method (Chung and Hulbert 1993); trapezoidal with alphas 0.

    Parameters
    ----------
    x, v, a, g : float arrays (dims, n + 1)
        Positions [m], velocities [m/s], accelerations [m/s2] and total forces [N]; advanced in place.  All but the positions are
        0 at particles that are held, which so take part in every loop and stay.
    first, last : int
        The free particles, first ... last - 1.
    k, length : float arrays (n,)
        Stiffness [N/m] and unstretched length [m] of the links.
    inverse : float array (n,) or None
        1 / length^2 for law (21), None for the linear law.
    mass : float array (n + 1,)
        [kg]; 0 at held particles, and so the loads.
    damping : float or None
        Damping per mass [1/s].
    loads : float array (dims, n + 1)
        Constant loads [N].
    patterns, factors : float arrays (loads, dims, n + 1), (steps + 1, loads) or None
        Loads that vary in time [N] and their factors at the steps.
    viscosity : float or None
        Viscosity of the links over their stiffness [s].
    lower, upper : float arrays (steps + 1, dims) or None
        Positions of the ends at the steps [m].
    end_rates : float array (steps + 1, 2, dims) or None
        Velocities of the ends [m/s]; only with viscosity.
    step : float
        [s].
    alpha_m, alpha_f, beta, gamma : float
        Of the method.
    enough : float
        A correction that turns the links by as little as this, in the mean, ends Newton's method.
    start, steps : int
        Number of the first step, number of steps.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, 3, dims, n + 1)
        Filled with positions, velocities and accelerations.
    low, high : float arrays (n,) or None
        Extremes of the tensions at the steps, updated [N].

    Returns
    -------
    tuple of int
        Steps done, fewer than `steps` where Newton's method did not converge (the state is then that before the step), and
        iterations.
    """
    dims, particles = x.shape
    f, s = np.zeros(dims * particles + 1), np.zeros((3 if dims == 2 else 6, particles + 1))
    d, b, kept, held = np.zeros(x.size), np.zeros((dims, particles)), np.zeros((2 * dims, particles)), np.zeros(x.size)
    trial, rates = x.copy(), np.zeros((dims, particles))
    inert, per_length = _for_each(mass, dims), _for_each(np.append(1.0 / length, 0.0), dims)
    flat_x, flat_v, flat_a, flat_g, flat_trial = (
        x.reshape(-1),
        v.reshape(-1),
        a.reshape(-1),
        g.reshape(-1),
        trial.reshape(-1),
    )
    # acceleration a1 = per_d d - per_v v - per_a a, velocity v1 = v + step ((1 - gamma) a + gamma a1)
    per_d, per_v, per_a = 1.0 / (beta * step * step), 1.0 / (beta * step), 0.5 / beta - 1.0
    rate, inertia = gamma / (beta * step), (1.0 - alpha_m) / (1.0 - alpha_f)
    old_g, old_a = alpha_f / (1.0 - alpha_f), alpha_m / (1.0 - alpha_f)
    diagonal = inert * (inertia * per_d + (0.0 if damping is None else damping * rate))
    steady, last_a, first_a = loads.reshape(-1), flat_a.copy(), flat_a.copy()
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1] = v
            saved[save, 2] = a
            save += 1
        if low is not None:
            _note_tension(x, low, high, inverse, k, length)
        for q in range(d.size):
            vq, aq = flat_v[q], flat_a[q]
            # what is resolved goes on linearly, what is not swings from step to step: a1 = a + a(-1) - a(-2) is right for both
            d[q] = step * (vq + step * ((0.5 - beta) * aq + beta * (aq + last_a[q] - first_a[q])))
            flat_trial[q] = flat_x[q] + d[q]
            # all of the balance that the unknowns of the step do not change
            balance = old_g * flat_g[q] + inert[q] * (inertia * (per_v * vq + per_a * aq) - old_a * aq)
            held[q] = steady[q] + balance
        if damping is not None:
            for q in range(d.size):
                after = (1.0 - gamma) * flat_a[q] - gamma * (per_v * flat_v[q] + per_a * flat_a[q])
                held[q] -= damping * inert[q] * (flat_v[q] + step * after)
        if patterns is not None:
            _hold(held, patterns, factors[i + 1])
        _set_ends(trial, lower, upper, i + 1)
        converged = False
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            if viscosity is not None:
                flat_rates = rates.reshape(-1)
                for q in range(d.size):
                    a1 = per_d * (d[q] - step * flat_v[q]) - per_a * flat_a[q]
                    flat_rates[q] = flat_v[q] + step * ((1.0 - gamma) * flat_a[q] + gamma * a1)
                for c in range(dims):
                    if first == 1:
                        rates[c, 0] = end_rates[i + 1, 0, c]
                    if last == particles - 1:
                        rates[c, last] = end_rates[i + 1, 1, c]
            if dims == 2:
                _pull_planar(
                    trial[0], trial[1], rates[0], rates[1], k, length, inverse, viscosity, rate,
                    f, f[particles:], s[0], s[1], s[2],
                )  # fmt: skip
            else:
                _pull_spatial(
                    trial[0], trial[1], trial[2], rates[0], rates[1], rates[2], k, length, inverse, viscosity, rate,
                    f, f[particles:], f[2 * particles :], s,
                )  # fmt: skip
            size = _correction(f, s, held, diagonal, d, b, kept, first, last, per_length)
            _correct(d, b.reshape(-1), flat_x, flat_trial)
            _set_ends(trial, lower, upper, i + 1)
            if size <= enough:
                converged = True
                break
            if not size < 1e300:
                break
        if not converged:
            return i, iterations
        for q in range(d.size):
            vq, aq = flat_v[q], flat_a[q]
            new = per_d * (d[q] - step * vq) - per_a * aq
            flat_v[q] = vq + step * ((1.0 - gamma) * aq + gamma * new)
            flat_g[q] = inert[q] * (inertia * new + old_a * aq) - old_g * flat_g[q]
            first_a[q], last_a[q] = last_a[q], aq
            flat_a[q] = new
            flat_x[q] = flat_trial[q]
    return steps, iterations


@njit(**_options)
def energy_momentum(
    x, v, first, last, k, length, inverse, mass, damping, loads, patterns, factors, viscosity, lower, upper, step,
    enough, rounding, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the energy-momentum method (Simo and Tarnow 1992).

    The forces of the links over a step are difference quotients of their energies, so that with ends and loads at rest the sum of
    kinetic, strain and potential energy stays what it is, at any step, as far as Newton's method is carried.  Parameters and
    result as in :func:`generalized_alpha`; loads that vary are taken as the mean of both ends of the step.  What Newton's method
    leaves has a sign, and adds up in the energy over many steps: so corrections are made until they turn the links by as little
    as `enough`, or, below `rounding`, no longer shrink.
    """
    dims, particles = x.shape
    f, s = np.zeros(dims * particles + 1), np.zeros((3 if dims == 2 else 6, particles + 1))
    d, b, kept, held = np.zeros(x.size), np.zeros((dims, particles)), np.zeros((2 * dims, particles)), np.zeros(x.size)
    trial, before = x.copy(), step * v.reshape(-1)
    inert, per_length = _for_each(mass, dims), _for_each(np.append(1.0 / length, 0.0), dims)
    flat_x, flat_v, flat_trial, steady = x.reshape(-1), v.reshape(-1), trial.reshape(-1), loads.reshape(-1)
    diagonal = inert * (2.0 / (step * step) + (0.0 if damping is None else damping / step))
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1] = v
            save += 1
        if low is not None:
            _note_tension(x, low, high, inverse, k, length)
        for q in range(d.size):
            # what the last step moved, and as much more as it moved more than the velocity then said
            d[q] = 2.0 * step * flat_v[q] - before[q]
            flat_trial[q] = flat_x[q] + d[q]
            held[q] = steady[q] + 2.0 * inert[q] * flat_v[q] / step
        if patterns is not None:
            _hold(held, patterns, 0.5 * (factors[i] + factors[i + 1]))
        _set_ends(trial, lower, upper, i + 1)
        converged, before_size = False, np.inf
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            _pull_conserving(x, trial, k, length, inverse, viscosity, 1.0 / step, f, s)
            size = _correction(f, s, held, diagonal, d, b, kept, first, last, per_length)
            _correct(d, b.reshape(-1), flat_x, flat_trial)
            _set_ends(trial, lower, upper, i + 1)
            if size <= enough or (size <= rounding and size > 0.5 * before_size):
                converged = True
                break
            if not size < 1e300:
                break
            before_size = size
        if not converged:
            return i, iterations
        for q in range(d.size):
            flat_v[q] = 2.0 * d[q] / step - flat_v[q]
            before[q] = d[q]
            flat_x[q] = flat_trial[q]
    return steps, iterations


@njit(**_options)
def _for_each(values, dims):
    """Values at the particles once for each coordinate (dims (n + 1),)."""
    result = np.empty(dims * values.size)
    for c in range(dims):
        result[c * values.size : (c + 1) * values.size] = values
    return result
