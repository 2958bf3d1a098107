"""Compiled link forces and tangent stiffness of the implicit schemes."""

from __future__ import annotations

import math

from cablepod._jit import compiled

# --- links ------------------------------------------------------------------------------------------------------------


@compiled(forceinline=True)
def place(values, j):
    """Return the value of link `j`, None without values."""
    if values is None:
        return None
    return values[j]


@compiled(forceinline=True)
def link_moduli(square, stretching, k, length, inverse_square, viscosity, rate):
    """Return tension over length [N/m], and its derivative by half the squared length, of a link.

    `stretching` is the product of the link's vector and its rate, `rate` the derivative of the new velocity by the new position.
    """
    if inverse_square is None:
        part = length / math.sqrt(square)
        t = k * (1.0 - part)
        g = k * part / square
        taut = t > 0.0
        if viscosity is not None:
            c = viscosity * k / square
            total = t + c * stretching
            taut = taut and total > 0.0
            t, g = total, g + c * rate
        t = t if taut else 0.0
        g = g if taut else 0.0
    else:
        t = 0.5 * k * (square * inverse_square - 1.0)
        g = k * inverse_square
    return t, g


@compiled
def link_forces_planar(x, y, u, v, k, length, inverse_squares, viscosity, tension_damping, rate, fx, fy, sxx, sxy, syy):
    """Compute forces [N] and tangent stiffness [N/m] of planar links.

    `x`, `y`, `u`, `v` are positions and velocities (n + 1,), `rate` the derivative of the new velocity by the new position [1/s].
    `tension_damping` [s] adds its product with tension over length and the difference of the velocities; of its tangent only the
    part by the velocities is kept.  `fx`, `fy`, `sxx`, `sxy`, `syy` are filled for link j at j + 1.
    """
    for j in range(k.size):
        dx, dy = x[j + 1] - x[j], y[j + 1] - y[j]
        square = dx * dx + dy * dy
        stretching = dx * (u[j + 1] - u[j]) + dy * (v[j + 1] - v[j])
        t, g = link_moduli(square, stretching, k[j], length[j], place(inverse_squares, j), viscosity, rate)
        fx[j + 1] = t * dx
        fy[j + 1] = t * dy
        sxx[j + 1] = t + g * dx * dx
        sxy[j + 1] = g * dx * dy
        syy[j + 1] = t + g * dy * dy
        if tension_damping is not None:
            damping = tension_damping * max(t, 0.0)
            fx[j + 1] += damping * (u[j + 1] - u[j])
            fy[j + 1] += damping * (v[j + 1] - v[j])
            sxx[j + 1] += damping * rate
            syy[j + 1] += damping * rate


@compiled
def link_forces_spatial(x, y, z, u, v, w, k, length, inverse_squares, viscosity, tension_damping, rate, fx, fy, fz, s):
    """Compute forces and tangent stiffness of spatial links; s (6, n + 2) is filled with xx, xy, xz, yy, yz, zz."""
    for j in range(k.size):
        dx, dy, dz = x[j + 1] - x[j], y[j + 1] - y[j], z[j + 1] - z[j]
        square = dx * dx + dy * dy + dz * dz
        stretching = dx * (u[j + 1] - u[j]) + dy * (v[j + 1] - v[j]) + dz * (w[j + 1] - w[j])
        t, g = link_moduli(square, stretching, k[j], length[j], place(inverse_squares, j), viscosity, rate)
        fx[j + 1] = t * dx
        fy[j + 1] = t * dy
        fz[j + 1] = t * dz
        _fill3(s, j + 1, t, g, dx, dy, dz)
        if tension_damping is not None:
            damping = tension_damping * max(t, 0.0)
            fx[j + 1] += damping * (u[j + 1] - u[j])
            fy[j + 1] += damping * (v[j + 1] - v[j])
            fz[j + 1] += damping * (w[j + 1] - w[j])
            _add_identity(s, j + 1, damping * rate)


@compiled
def _add_identity(s, p, value):
    """Add a value to the diagonal of column p of s (3 or 6 rows)."""
    s[0, p] += value
    s[2 if s.shape[0] == 3 else 3, p] += value
    if s.shape[0] == 6:
        s[5, p] += value


@compiled
def _fill3(s, p, t, g, dx, dy, dz):
    """Fill column p of s with the six numbers of t I + g d d^T."""
    s[0, p] = t + g * dx * dx
    s[1, p] = g * dx * dy
    s[2, p] = g * dx * dz
    s[3, p] = t + g * dy * dy
    s[4, p] = g * dy * dz
    s[5, p] = t + g * dz * dz


@compiled(forceinline=True)
def energy_secant(square0, square1, k, length, inverse_squares):
    """Return the difference quotient of a link's energy, 2 (W1 - W0) / (|R1|^2 - |R0|^2) [N/m], and its derivative by |R1|^2 / 2.

    The form avoids cancellation for nearly equal lengths.
    """
    if inverse_squares is not None:
        return 0.25 * k * ((square0 + square1) * inverse_squares - 2.0), 0.5 * k * inverse_squares
    length0, length1 = math.sqrt(square0), math.sqrt(square1)
    over0, over1 = length0 - length, length1 - length
    total = length0 + length1
    if over0 > 0.0 and over1 > 0.0:
        return k * (1.0 - 2.0 * length / total), 2.0 * k * length / (total * total * length1)
    if over0 <= 0.0 and over1 <= 0.0:
        return 0.0, 0.0
    # the link is slack at one end of the step: only the part beyond the unstretched length has energy
    over = max(over0, over1)
    gap = abs(length1 - length0)
    quotient = k * over * over / (gap * total)
    # derivative by |R1| of over^2 / (|R1|^2 - |R0|^2) if taut at the end, else of -over^2 / (...)
    slope = (
        (2.0 * k * over - 2.0 * quotient * length1) / (gap * total)
        if over1 > 0.0
        else 2.0 * quotient * length1 / (gap * total)
    )
    return quotient, max(slope, 0.0) / length1


@compiled(forceinline=True)
def conserving_moduli(square0, square1, middle_square, stretching, k, length, inverse_square, viscosity, per_step):
    """Return tension over length of a link over a step [N/m], and its derivative by half the squared length at the end.

    The squared lengths are those at both ends of the step and that of the mean vector; `stretching` is the product of the mean
    vector and its change.
    """
    t, g = energy_secant(square0, square1, k, length, inverse_square)
    if viscosity is not None:
        damper = viscosity * k * per_step / middle_square
        total = t + damper * stretching
        is_viscous, taut = t > 0.0, total > 0.0
        g = (g + damper if taut else 0.0) if is_viscous else g
        t = (total if taut else 0.0) if is_viscous else t
    return t, g


@compiled
def link_forces_conserving(x0, x1, k, length, inverse_squares, viscosity, tension_damping, per_step, f, s):
    """Compute energy-conserving forces over a step from x0 to x1, and their tangent without the rotation of the links."""
    dims, particles = x0.shape
    for j in range(k.size):
        square0, square1, middle_square, stretching = 0.0, 0.0, 0.0, 0.0
        for c in range(dims):
            a, b = x0[c, j + 1] - x0[c, j], x1[c, j + 1] - x1[c, j]
            square0 += a * a
            square1 += b * b
            middle_square += 0.25 * (a + b) * (a + b)
            stretching += 0.5 * (a + b) * (b - a)
        t, g = conserving_moduli(
            square0, square1, middle_square, stretching, k[j], length[j], place(inverse_squares, j), viscosity, per_step
        )
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
        if tension_damping is not None:
            damping = tension_damping * per_step * max(t, 0.0)
            for c in range(dims):
                f[c * particles + j + 1] += damping * (x1[c, j + 1] - x1[c, j] - (x0[c, j + 1] - x0[c, j]))
            _add_identity(s, j + 1, damping)
