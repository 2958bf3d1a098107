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
MOST_ITERATIONS = 30


# --- block tridiagonal systems ----------------------------------------------------------------------------------------


@njit(**_options)
def _inverse2(a, b, c):
    """Inverse of the symmetric matrix [[a, b], [b, c]], as three numbers."""
    scale = 1.0 / (a * c - b * b)
    return c * scale, -b * scale, a * scale


@njit(**_options)
def _sandwich2(s, i):
    """S I S of symmetric matrices, as three numbers."""
    p = s[0] * i[0] + s[1] * i[1]
    q = s[0] * i[1] + s[1] * i[2]
    r = s[1] * i[0] + s[2] * i[1]
    t = s[1] * i[1] + s[2] * i[2]
    return p * s[0] + q * s[1], p * s[1] + q * s[2], r * s[1] + t * s[2]


@njit(**_options)
def solve_planar(diagonal, s, b, kept, first):
    """Solve the system of the chain, planar.

    Row i, for particle first + i, is (diagonal_i + S_below + S_above) d_i - S_below d_(i-1) - S_above d_(i+1) = b_i.

    Parameters
    ----------
    diagonal : float array (m,)
        What is added to the diagonal of each block, inertia over the square of the step [N/m].
    s : tuple of 3 float arrays (n + 2,)
        xx, xy, yy of the tangent stiffness of the links [N/m].
    b : tuple of 2 float arrays (m,)
        Right side [N]; overwritten by the solution [m].
    kept : tuple of 3 float arrays (m,)
        To work in.
    first : int
        The first particle.
    """
    sxx, sxy, syy = s
    bx, by = b
    kxx, kxy, kyy = kept
    m = bx.size
    half = m // 2
    up = (0.0, 0.0, 0.0)
    down = (0.0, 0.0, 0.0)
    ux, uy, wx, wy = 0.0, 0.0, 0.0, 0.0
    for i in range(half):
        # from the lower end upwards: particle i
        p = first + i
        above = (sxx[p + 1], sxy[p + 1], syy[p + 1])
        inverse = _inverse2(
            diagonal[i] + sxx[p] + above[0] - up[0], sxy[p] + above[1] - up[1], diagonal[i] + syy[p] + above[2] - up[2]
        )
        kxx[i], kxy[i], kyy[i] = inverse
        rx, ry = bx[i] + ux, by[i] + uy
        bx[i], by[i] = rx, ry
        tx, ty = inverse[0] * rx + inverse[1] * ry, inverse[1] * rx + inverse[2] * ry
        ux, uy = above[0] * tx + above[1] * ty, above[1] * tx + above[2] * ty
        up = _sandwich2(above, inverse)
        # from the upper end downwards: particle m - 1 - i
        j = m - 1 - i
        if j > half:
            p = first + j
            below = (sxx[p], sxy[p], syy[p])
            inverse = _inverse2(
                diagonal[j] + below[0] + sxx[p + 1] - down[0],
                below[1] + sxy[p + 1] - down[1],
                diagonal[j] + below[2] + syy[p + 1] - down[2],
            )
            kxx[j], kxy[j], kyy[j] = inverse
            rx, ry = bx[j] + wx, by[j] + wy
            bx[j], by[j] = rx, ry
            tx, ty = inverse[0] * rx + inverse[1] * ry, inverse[1] * rx + inverse[2] * ry
            wx, wy = below[0] * tx + below[1] * ty, below[1] * tx + below[2] * ty
            down = _sandwich2(below, inverse)
    p = first + half
    inverse = _inverse2(
        diagonal[half] + sxx[p] + sxx[p + 1] - up[0] - down[0],
        sxy[p] + sxy[p + 1] - up[1] - down[1],
        diagonal[half] + syy[p] + syy[p + 1] - up[2] - down[2],
    )
    rx, ry = bx[half] + ux + wx, by[half] + uy + wy
    tx, ty = inverse[0] * rx + inverse[1] * ry, inverse[1] * rx + inverse[2] * ry
    bx[half], by[half] = tx, ty
    qx, qy = tx, ty
    for i in range(half):
        j = half - 1 - i
        p = first + j + 1
        rx, ry = bx[j] + sxx[p] * tx + sxy[p] * ty, by[j] + sxy[p] * tx + syy[p] * ty
        tx, ty = kxx[j] * rx + kxy[j] * ry, kxy[j] * rx + kyy[j] * ry
        bx[j], by[j] = tx, ty
        j = half + 1 + i
        if j < m:
            p = first + j
            rx, ry = bx[j] + sxx[p] * qx + sxy[p] * qy, by[j] + sxy[p] * qx + syy[p] * qy
            qx, qy = kxx[j] * rx + kxy[j] * ry, kxy[j] * rx + kyy[j] * ry
            bx[j], by[j] = qx, qy


@njit(**_options)
def _inverse3(a, b, c, d, e, f):
    """Inverse of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]], as six numbers in the same order."""
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * p + b * q + c * r)
    return p * scale, q * scale, r * scale, (a * f - c * c) * scale, (b * c - a * e) * scale, (a * d - b * b) * scale


@njit(**_options)
def _times3(s, x, y, z):
    """Product of a symmetric matrix and a vector."""
    return s[0] * x + s[1] * y + s[2] * z, s[1] * x + s[3] * y + s[4] * z, s[2] * x + s[4] * y + s[5] * z


@njit(**_options)
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


@njit(**_options)
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


@njit(**_options)
def solve_spatial(diagonal, s, b, kept, first):
    """Solve the system of the chain, spatial; s and kept are tuples of 6 arrays (xx, xy, xz, yy, yz, zz), b one of 3."""
    bx, by, bz = b
    m = bx.size
    half = m // 2
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    up, down = none, none
    u, w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(half):
        p = first + i
        above = _at3(s, p + 1)
        inverse = _block3(diagonal[i], _at3(s, p), above, up, none)
        kept[0][i], kept[1][i], kept[2][i], kept[3][i], kept[4][i], kept[5][i] = inverse
        bx[i] += u[0]
        by[i] += u[1]
        bz[i] += u[2]
        t = _times3(inverse, bx[i], by[i], bz[i])
        u = _times3(above, t[0], t[1], t[2])
        up = _sandwich3(above, inverse)
        j = m - 1 - i
        if j > half:
            p = first + j
            below = _at3(s, p)
            inverse = _block3(diagonal[j], below, _at3(s, p + 1), down, none)
            kept[0][j], kept[1][j], kept[2][j], kept[3][j], kept[4][j], kept[5][j] = inverse
            bx[j] += w[0]
            by[j] += w[1]
            bz[j] += w[2]
            t = _times3(inverse, bx[j], by[j], bz[j])
            w = _times3(below, t[0], t[1], t[2])
            down = _sandwich3(below, inverse)
    p = first + half
    inverse = _block3(diagonal[half], _at3(s, p), _at3(s, p + 1), up, down)
    t = _times3(inverse, bx[half] + u[0] + w[0], by[half] + u[1] + w[1], bz[half] + u[2] + w[2])
    bx[half], by[half], bz[half] = t
    q = t
    for i in range(half):
        j = half - 1 - i
        r = _times3(_at3(s, first + j + 1), t[0], t[1], t[2])
        t = _times3(_at3(kept, j), bx[j] + r[0], by[j] + r[1], bz[j] + r[2])
        bx[j], by[j], bz[j] = t
        j = half + 1 + i
        if j < m:
            r = _times3(_at3(s, first + j), q[0], q[1], q[2])
            q = _times3(_at3(kept, j), bx[j] + r[0], by[j] + r[1], bz[j] + r[2])
            bx[j], by[j], bz[j] = q


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
    dims = x0.shape[0]
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
        f[0, j + 1] = t * dx
        f[1, j + 1] = t * dy
        if dims == 2:
            s[0, j + 1] = 0.5 * t + g * dx * dx
            s[1, j + 1] = g * dx * dy
            s[2, j + 1] = 0.5 * t + g * dy * dy
        else:
            dz = 0.5 * (x0[2, j + 1] - x0[2, j] + x1[2, j + 1] - x1[2, j])
            f[2, j + 1] = t * dz
            _fill3(s, j + 1, 0.5 * t, g, dx, dy, dz)


@njit(**_options)
def _solve(diagonal, s, b, kept, first):
    if b.shape[0] == 2:
        solve_planar(diagonal, (s[0], s[1], s[2]), (b[0], b[1]), (kept[0], kept[1], kept[2]), first)
    else:
        solve_spatial(
            diagonal,
            (s[0], s[1], s[2], s[3], s[4], s[5]),
            (b[0], b[1], b[2]),
            (kept[0], kept[1], kept[2], kept[3], kept[4], kept[5]),
            first,
        )


@njit(**_options)
def _correct(d, b, x, trial, first):
    """Add the correction b to the displacement d; returns its largest component."""
    largest = 0.0
    for c in range(d.shape[0]):
        for i in range(d.shape[1]):
            d[c, i] += b[c, i]
            trial[c, first + i] = x[c, first + i] + d[c, i]
            size = abs(b[c, i])
            if not size <= largest:  # also where it is not a number
                largest = size
    return largest


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
    x, v, a, g, first, k, length, inverse, mass, damping, loads, patterns, factors, viscosity, lower, upper, end_rates, step,
    alpha_m, alpha_f, beta, gamma, enough, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the generalized-alpha method (Chung and Hulbert 1993); trapezoidal with alphas 0.

    Parameters
    ----------
    x : float array (dims, n + 1)
        Positions [m]; advanced in place.
    v, a, g : float arrays (dims, m)
        Velocities [m/s], accelerations [m/s2] and total forces [N] of the free particles; advanced in place.
    first : int
        The first free particle.
    k, length : float arrays (n,)
        Stiffness [N/m] and unstretched length [m] of the links.
    inverse : float array (n,) or None
        1 / length^2 for law (21), None for the linear law.
    mass : float array (m,)
        [kg].
    damping : float or None
        Damping per mass [1/s].
    loads : float array (dims, m)
        Constant loads [N].
    patterns, factors : float arrays (loads, dims, m), (steps + 1, loads) or None
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
        A correction as small as this ends Newton's method [m].
    start, steps : int
        Number of the first step, number of steps.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, 3, dims, n + 1)
        Filled with positions, and velocities and accelerations of the free particles.
    low, high : float arrays (n,) or None
        Extremes of the tensions at the steps, updated [N].

    Returns
    -------
    tuple of int
        Steps done, fewer than `steps` where Newton's method did not converge (the state is then that before the step), and
        iterations.
    """
    dims, m = v.shape
    n = k.size
    f, s = np.zeros((dims, n + 2)), np.zeros((3 if dims == 2 else 6, n + 2))
    d, b, kept = np.zeros((dims, m)), np.zeros((dims, m)), np.zeros((s.shape[0], m))
    trial, rates = x.copy(), np.zeros((dims, n + 1))
    a1 = np.zeros((dims, m))
    inertia = (1.0 - alpha_m) / (beta * step * step * (1.0 - alpha_f))
    rate = gamma / (beta * step)
    diagonal = np.empty(m)
    for i in range(m):
        diagonal[i] = mass[i] * (inertia + (0.0 if damping is None else damping * rate))
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1, :, first : first + m] = v
            saved[save, 2, :, first : first + m] = a
            save += 1
        if low is not None:
            _note_tension(x, low, high, inverse, k, length)
        for c in range(dims):
            for j in range(m):
                d[c, j] = step * (v[c, j] + 0.5 * step * a[c, j])
                trial[c, first + j] = x[c, first + j] + d[c, j]
        _set_ends(trial, lower, upper, i + 1)
        converged = False
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            for c in range(dims):
                for j in range(m):
                    a1[c, j] = (d[c, j] - step * v[c, j]) / (beta * step * step) - (0.5 / beta - 1.0) * a[c, j]
            if viscosity is not None or damping is not None:
                for c in range(dims):
                    for j in range(m):
                        rates[c, first + j] = v[c, j] + step * ((1.0 - gamma) * a[c, j] + gamma * a1[c, j])
            if viscosity is not None:
                for c in range(dims):
                    if first == 1:
                        rates[c, 0] = end_rates[i + 1, 0, c]
                    if first + m == n:
                        rates[c, n] = end_rates[i + 1, 1, c]
            if dims == 2:
                _pull_planar(
                    trial[0], trial[1], rates[0], rates[1], k, length, inverse, viscosity, rate, f[0], f[1], s[0], s[1], s[2]
                )  # fmt: skip
            else:
                _pull_spatial(
                    trial[0], trial[1], trial[2], rates[0], rates[1], rates[2], k, length, inverse, viscosity, rate,
                    f[0], f[1], f[2], s,
                )  # fmt: skip
            for c in range(dims):
                for j in range(m):
                    total = f[c, first + j + 1] - f[c, first + j] + loads[c, j]
                    if patterns is not None:
                        for load in range(patterns.shape[0]):
                            total += factors[i + 1, load] * patterns[load, c, j]
                    if damping is not None:
                        total -= damping * mass[j] * rates[c, first + j]
                    inert = mass[j] * ((1.0 - alpha_m) * a1[c, j] + alpha_m * a[c, j])
                    b[c, j] = total + (alpha_f * g[c, j] - inert) / (1.0 - alpha_f)
            _solve(diagonal, s, b, kept, first)
            size = _correct(d, b, x, trial, first)
            if size <= enough:
                converged = True
                break
            if not size < 1e300:
                break
        if not converged:
            return i, iterations
        for c in range(dims):
            for j in range(m):
                new = (d[c, j] - step * v[c, j]) / (beta * step * step) - (0.5 / beta - 1.0) * a[c, j]
                v[c, j] += step * ((1.0 - gamma) * a[c, j] + gamma * new)
                inert = mass[j] * ((1.0 - alpha_m) * new + alpha_m * a[c, j])
                g[c, j] = (inert - alpha_f * g[c, j]) / (1.0 - alpha_f)
                a[c, j] = new
        for c in range(dims):
            for j in range(n + 1):
                x[c, j] = trial[c, j]
    return steps, iterations


@njit(**_options)
def energy_momentum(
    x, v, first, k, length, inverse, mass, damping, loads, patterns, factors, viscosity, lower, upper, step,
    enough, rounding, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the energy-momentum method (Simo and Tarnow 1992).

    The forces of the links over a step are difference quotients of their energies, so that with ends and loads at rest the sum of
    kinetic, strain and potential energy stays what it is, at any step, as far as Newton's method is carried.  Parameters and
    result as in :func:`generalized_alpha`; loads that vary are taken as the mean of both ends of the step.  What Newton's method
    leaves has a sign, and adds up in the energy over many steps: so corrections are made until they are as small as `enough`
    [m], or, below `rounding` [m], no longer shrink.
    """
    dims, m = v.shape
    n = k.size
    f, s = np.zeros((dims, n + 2)), np.zeros((3 if dims == 2 else 6, n + 2))
    d, b, kept = np.zeros((dims, m)), np.zeros((dims, m)), np.zeros((s.shape[0], m))
    trial, before = x.copy(), np.zeros((dims, m))
    diagonal = np.empty(m)
    for j in range(m):
        diagonal[j] = mass[j] * (2.0 / (step * step) + (0.0 if damping is None else damping / step))
    for c in range(dims):
        for j in range(m):
            before[c, j] = step * v[c, j]
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1, :, first : first + m] = v
            save += 1
        if low is not None:
            _note_tension(x, low, high, inverse, k, length)
        for c in range(dims):
            for j in range(m):
                # what the last step moved, and as much more as it moved more than the velocity then said
                d[c, j] = 2.0 * step * v[c, j] - before[c, j]
                trial[c, first + j] = x[c, first + j] + d[c, j]
        _set_ends(trial, lower, upper, i + 1)
        converged, last = False, np.inf
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            _pull_conserving(x, trial, k, length, inverse, viscosity, 1.0 / step, f, s)
            for c in range(dims):
                for j in range(m):
                    total = f[c, first + j + 1] - f[c, first + j] + loads[c, j]
                    if patterns is not None:
                        for load in range(patterns.shape[0]):
                            total += 0.5 * (factors[i, load] + factors[i + 1, load]) * patterns[load, c, j]
                    if damping is not None:
                        total -= damping * mass[j] * d[c, j] / step
                    b[c, j] = total - mass[j] * 2.0 * (d[c, j] / step - v[c, j]) / step
            _solve(diagonal, s, b, kept, first)
            size = _correct(d, b, x, trial, first)
            if size <= enough or (size <= rounding and size > 0.5 * last):
                converged = True
                break
            if not size < 1e300:
                break
            last = size
        if not converged:
            return i, iterations
        for c in range(dims):
            for j in range(m):
                v[c, j] = 2.0 * d[c, j] / step - v[c, j]
                before[c, j] = d[c, j]
            for j in range(n + 1):
                x[c, j] = trial[c, j]
    return steps, iterations
