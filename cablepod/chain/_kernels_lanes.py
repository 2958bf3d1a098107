"""Compiled link forces and block tridiagonal solver of many chains abreast, for the implicit schemes.

Members lie in lanes, the last dimension of all arrays, and each loop over them is vectorised.  Each operation is that of
:mod:`cablepod.chain._kernels_links` and :mod:`cablepod.chain._kernels_banded`, in the same order, whose scalar functions are
inlined here.  Arrays of coordinates or matrix entries are tuples of arrays (particles, lanes), which share no memory.
"""

from __future__ import annotations

import math

from cablepod._jit import FUSED, compiled
from cablepod.chain._kernels_banded import block3, eliminate, sandwich3, times3
from cablepod.chain._kernels_links import conserving_moduli, link_moduli

# --- links ------------------------------------------------------------------------------------------------------------


@compiled(forceinline=True)
def _place(values, j, m):
    """Return the value of link `j` in lane `m`, None without values."""
    if values is None:
        return None
    return values[j, m]


@compiled(forceinline=True)
def _lane(values, m):
    """Return the value of lane `m`, None without values."""
    if values is None:
        return None
    return values[m]


@compiled(forceinline=True)
def _reach(x, c, j, m):
    """Return the coordinate `c` of the vector of link `j` in lane `m`."""
    return x[c][j + 1, m] - x[c][j, m]


@compiled(forceinline=True)
def _mean(x1, c, j, m, reach0):
    """Return the coordinate `c` of the mean vector of link `j` over a step, from that at its beginning."""
    return 0.5 * (reach0 + x1[c][j + 1, m] - x1[c][j, m])


@compiled(forceinline=True)
def _store_planar(j, m, t, along, g, dx, dy, f, s):
    """Store the force t d of a link and its tangent, `along` I + g d d^T."""
    f[0][j + 1, m], f[1][j + 1, m] = t * dx, t * dy
    s[0][j + 1, m], s[1][j + 1, m], s[2][j + 1, m] = along + g * dx * dx, g * dx * dy, along + g * dy * dy


@compiled(forceinline=True)
def _store_spatial(j, m, t, along, g, dx, dy, dz, f, s):
    """Store the force t d of a link and its tangent, `along` I + g d d^T."""
    f[0][j + 1, m], f[1][j + 1, m], f[2][j + 1, m] = t * dx, t * dy, t * dz
    s[0][j + 1, m], s[1][j + 1, m], s[2][j + 1, m] = along + g * dx * dx, g * dx * dy, g * dx * dz
    s[3][j + 1, m], s[4][j + 1, m], s[5][j + 1, m] = along + g * dy * dy, g * dy * dz, along + g * dz * dz


@compiled(noalias=True, forceinline=True)
def _links_planar(j, x, rates, k, length, inverse_squares, viscosity, rate, f, s):
    """Compute forces and tangents of the planar links `j`."""
    for m in range(k.shape[1]):
        dx, dy = _reach(x, 0, j, m), _reach(x, 1, j, m)
        stretching = dx * _reach(rates, 0, j, m) + dy * _reach(rates, 1, j, m)
        t, g = link_moduli(
            dx * dx + dy * dy,
            stretching,
            k[j, m],
            length[j, m],
            _place(inverse_squares, j, m),
            _lane(viscosity, m),
            rate,
        )
        _store_planar(j, m, t, t, g, dx, dy, f, s)


@compiled(noalias=True, forceinline=True)
def _links_spatial(j, x, rates, k, length, inverse_squares, viscosity, rate, f, s):
    """Compute forces and tangents of the spatial links `j`."""
    for m in range(k.shape[1]):
        dx, dy, dz = _reach(x, 0, j, m), _reach(x, 1, j, m), _reach(x, 2, j, m)
        stretching = dx * _reach(rates, 0, j, m) + dy * _reach(rates, 1, j, m) + dz * _reach(rates, 2, j, m)
        t, g = link_moduli(
            dx * dx + dy * dy + dz * dz, stretching, k[j, m], length[j, m], _place(inverse_squares, j, m),
            _lane(viscosity, m), rate,
        )  # fmt: skip
        _store_spatial(j, m, t, t, g, dx, dy, dz, f, s)


@compiled(noalias=True, forceinline=True)
def _conserving_planar(j, x0, x1, k, length, inverse_squares, viscosity, per_step, f, s):
    """Compute energy-conserving forces and tangents of the planar links `j`."""
    for m in range(k.shape[1]):
        ax, ay, bx, by = _reach(x0, 0, j, m), _reach(x0, 1, j, m), _reach(x1, 0, j, m), _reach(x1, 1, j, m)
        middle = 0.25 * (ax + bx) * (ax + bx) + 0.25 * (ay + by) * (ay + by)
        stretching = 0.5 * (ax + bx) * (bx - ax) + 0.5 * (ay + by) * (by - ay)
        t, g = conserving_moduli(
            ax * ax + ay * ay, bx * bx + by * by, middle, stretching, k[j, m], length[j, m],
            _place(inverse_squares, j, m), _lane(viscosity, m), per_step,
        )  # fmt: skip
        dx, dy = _mean(x1, 0, j, m, ax), _mean(x1, 1, j, m, ay)
        _store_planar(j, m, t, 0.5 * t, g, dx, dy, f, s)


@compiled(noalias=True, forceinline=True)
def _conserving_spatial(j, x0, x1, k, length, inverse_squares, viscosity, per_step, f, s):
    """Compute energy-conserving forces and tangents of the spatial links `j`."""
    for m in range(k.shape[1]):
        ax, ay, az = _reach(x0, 0, j, m), _reach(x0, 1, j, m), _reach(x0, 2, j, m)
        bx, by, bz = _reach(x1, 0, j, m), _reach(x1, 1, j, m), _reach(x1, 2, j, m)
        middle = 0.25 * (ax + bx) * (ax + bx) + 0.25 * (ay + by) * (ay + by) + 0.25 * (az + bz) * (az + bz)
        stretching = 0.5 * (ax + bx) * (bx - ax) + 0.5 * (ay + by) * (by - ay) + 0.5 * (az + bz) * (bz - az)
        t, g = conserving_moduli(
            ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, middle, stretching, k[j, m], length[j, m],
            _place(inverse_squares, j, m), _lane(viscosity, m), per_step,
        )  # fmt: skip
        dx, dy, dz = _mean(x1, 0, j, m, ax), _mean(x1, 1, j, m, ay), _mean(x1, 2, j, m, az)
        _store_spatial(j, m, t, 0.5 * t, g, dx, dy, dz, f, s)


@compiled
def link_forces_lanes(x, rates, k, length, inverse_squares, viscosity, rate, f, s):
    """Compute forces and tangents of all links at positions x (dims, n + 1, lanes), see ``_kernels_links``."""
    dims, particles = x.shape[:2]
    for j in range(k.shape[0]):
        if dims == 2:
            _links_planar(
                j, (x[0], x[1]), (rates[0], rates[1]), k, length, inverse_squares, viscosity, rate, (f, f[particles:]),
                (s[0], s[1], s[2]),
            )  # fmt: skip
        else:
            _links_spatial(
                j, (x[0], x[1], x[2]), (rates[0], rates[1], rates[2]), k, length, inverse_squares, viscosity, rate,
                (f, f[particles:], f[2 * particles :]), (s[0], s[1], s[2], s[3], s[4], s[5]),
            )  # fmt: skip


@compiled
def conserving_forces_lanes(x0, x1, k, length, inverse_squares, viscosity, per_step, f, s):
    """Compute energy-conserving forces and tangents of all links over a step from x0 to x1 (dims, n + 1, lanes)."""
    dims, particles = x0.shape[:2]
    for j in range(k.shape[0]):
        if dims == 2:
            _conserving_planar(
                j, (x0[0], x0[1]), (x1[0], x1[1]), k, length, inverse_squares, viscosity, per_step, (f, f[particles:]),
                (s[0], s[1], s[2]),
            )  # fmt: skip
        else:
            _conserving_spatial(
                j, (x0[0], x0[1], x0[2]), (x1[0], x1[1], x1[2]), k, length, inverse_squares, viscosity, per_step,
                (f, f[particles:], f[2 * particles :]), (s[0], s[1], s[2], s[3], s[4], s[5]),
            )  # fmt: skip


# --- block tridiagonal systems ----------------------------------------------------------------------------------------


@compiled(fastmath=FUSED, noalias=True, forceinline=True)
def _eliminate_planar(p, link, diagonal, s, b, matrix, up, u):
    """Eliminate the particles `p`; `up` and `u` change from their sums to those for the next particles, through `link`."""
    for m in range(diagonal.shape[1]):
        own, right, update, change = eliminate(
            diagonal[p, m] + s[0][p, m] + s[0][p + 1, m] - up[0][m],
            s[1][p, m] + s[1][p + 1, m] - up[1][m],
            diagonal[p, m] + s[2][p, m] + s[2][p + 1, m] - up[2][m],
            (s[0][link, m], s[1][link, m], s[2][link, m]), b[0][p, m] + u[0][m], b[1][p, m] + u[1][m],
        )  # fmt: skip
        matrix[0][p, m], matrix[1][p, m], matrix[2][p, m], matrix[3][p, m] = own
        b[0][p, m], b[1][p, m] = right
        up[0][m], up[1][m], up[2][m] = update
        u[0][m], u[1][m] = change


@compiled(fastmath=FUSED, noalias=True, forceinline=True)
def _middle_planar(p, diagonal, s, b, up, u, down, w):
    """Solve for the particles `p`, where both eliminations meet; `u` and `w` become the solution."""
    for m in range(diagonal.shape[1]):
        _, t, _, _ = eliminate(
            diagonal[p, m] + s[0][p, m] + s[0][p + 1, m] - up[0][m] - down[0][m],
            s[1][p, m] + s[1][p + 1, m] - up[1][m] - down[1][m],
            diagonal[p, m] + s[2][p, m] + s[2][p + 1, m] - up[2][m] - down[2][m],
            (0.0, 0.0, 0.0), b[0][p, m] + u[0][m] + w[0][m], b[1][p, m] + u[1][m] + w[1][m],
        )  # fmt: skip
        b[0][p, m], b[1][p, m] = t
        u[0][m], u[1][m] = t
        w[0][m], w[1][m] = t


@compiled(fastmath=FUSED, noalias=True, forceinline=True)
def _substitute_planar(p, b, matrix, t):
    """Solve for the particles `p`; `t` changes from the solution of their neighbours to theirs."""
    for m in range(b[0].shape[1]):
        x, y = t[0][m], t[1][m]
        x, y = (
            matrix[0][p, m] * x + matrix[1][p, m] * y + b[0][p, m],
            matrix[2][p, m] * x + matrix[3][p, m] * y + b[1][p, m],
        )
        b[0][p, m], b[1][p, m] = x, y
        t[0][m], t[1][m] = x, y


@compiled
def solve_planar_lanes(diagonal, s, b, matrix, up, u, down, w, first, last):
    """Solve the systems of planar chains, as ``solve_planar`` does one.

    `up` and `down` (3 arrays), `u` and `w` (2 arrays) are workspace of zeros (lanes,).
    """
    half = (last - first) // 2
    for i in range(half):
        _eliminate_planar(first + i, first + i + 1, diagonal, s, b, matrix, up, u)
        p = last - 1 - i
        if p > first + half:
            _eliminate_planar(p, p, diagonal, s, b, matrix, down, w)
    _middle_planar(first + half, diagonal, s, b, up, u, down, w)
    for i in range(half):
        _substitute_planar(first + half - 1 - i, b, matrix, u)
        p = first + half + 1 + i
        if p < last:
            _substitute_planar(p, b, matrix, w)


@compiled(forceinline=True)
def _at3(s, p, m):
    """Return the six numbers of place `p` in lane `m`."""
    return s[0][p, m], s[1][p, m], s[2][p, m], s[3][p, m], s[4][p, m], s[5][p, m]


@compiled(forceinline=True)
def _six(v, m):
    """Return the six numbers of lane `m`."""
    return v[0][m], v[1][m], v[2][m], v[3][m], v[4][m], v[5][m]


@compiled(fastmath=FUSED, noalias=True, forceinline=True)
def _eliminate_spatial(p, link, diagonal, s, b, inverses, up, u):
    """Eliminate the particles `p`, as :func:`_eliminate_planar`."""
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for m in range(diagonal.shape[1]):
        onward = _at3(s, link, m)
        inverse = block3(diagonal[p, m], _at3(s, p, m), _at3(s, p + 1, m), _six(up, m), none)
        x, y, z = b[0][p, m] + u[0][m], b[1][p, m] + u[1][m], b[2][p, m] + u[2][m]
        b[0][p, m], b[1][p, m], b[2][p, m] = x, y, z
        t = times3(inverse, x, y, z)
        u[0][m], u[1][m], u[2][m] = times3(onward, t[0], t[1], t[2])
        inverses[0][p, m], inverses[1][p, m], inverses[2][p, m] = inverse[0], inverse[1], inverse[2]
        inverses[3][p, m], inverses[4][p, m], inverses[5][p, m] = inverse[3], inverse[4], inverse[5]
        up[0][m], up[1][m], up[2][m], up[3][m], up[4][m], up[5][m] = sandwich3(onward, inverse)


@compiled(fastmath=FUSED, noalias=True, forceinline=True)
def _middle_spatial(p, diagonal, s, b, up, u, down, w):
    """Solve for the particles `p`, as :func:`_middle_planar`."""
    for m in range(diagonal.shape[1]):
        inverse = block3(diagonal[p, m], _at3(s, p, m), _at3(s, p + 1, m), _six(up, m), _six(down, m))
        t = times3(
            inverse, b[0][p, m] + u[0][m] + w[0][m], b[1][p, m] + u[1][m] + w[1][m], b[2][p, m] + u[2][m] + w[2][m]
        )
        b[0][p, m], b[1][p, m], b[2][p, m] = t
        u[0][m], u[1][m], u[2][m] = t
        w[0][m], w[1][m], w[2][m] = t


@compiled(fastmath=FUSED, noalias=True, forceinline=True)
def _substitute_spatial(p, link, s, b, inverses, t):
    """Solve for the particles `p`; `t` changes from the solution of their neighbours through `link` to theirs."""
    for m in range(b[0].shape[1]):
        r = times3(_at3(s, link, m), t[0][m], t[1][m], t[2][m])
        new = times3(_at3(inverses, p, m), b[0][p, m] + r[0], b[1][p, m] + r[1], b[2][p, m] + r[2])
        b[0][p, m], b[1][p, m], b[2][p, m] = new
        t[0][m], t[1][m], t[2][m] = new


@compiled
def solve_spatial_lanes(diagonal, s, b, inverses, up, u, down, w, first, last):
    """Solve the systems of spatial chains; `up` and `down` have 6 arrays, `u` and `w` have 3."""
    half = (last - first) // 2
    for i in range(half):
        _eliminate_spatial(first + i, first + i + 1, diagonal, s, b, inverses, up, u)
        p = last - 1 - i
        if p > first + half:
            _eliminate_spatial(p, p, diagonal, s, b, inverses, down, w)
    _middle_spatial(first + half, diagonal, s, b, up, u, down, w)
    for i in range(half):
        p = first + half - 1 - i
        _substitute_spatial(p, p + 1, s, b, inverses, u)
        p = first + half + 1 + i
        if p < last:
            _substitute_spatial(p, p, s, b, inverses, w)


# --- corrections ------------------------------------------------------------------------------------------------------


@compiled(noalias=True, forceinline=True)
def _residual(f, fixed_force, diagonal, d, b):
    """Compute the right side b from link forces, fixed forces and displacements (rows, lanes)."""
    for q in range(d.shape[0]):
        for m in range(d.shape[1]):
            b[q, m] = f[q + 1, m] - f[q, m] + (fixed_force[q, m] - diagonal[q, m] * d[q, m])


@compiled(noalias=True, forceinline=True)
def _correct(active, b, per_length, x, d, trial, squares):
    """Add the correction b to the displacements of active lanes; fills the sums of squares of its rotations (lanes,)."""
    for m in range(squares.size):
        squares[m] = 0.0
    for q in range(d.shape[0]):
        for m in range(squares.size):
            turn = (b[q + 1, m] - b[q, m]) * per_length[q, m]
            squares[m] += turn * turn
            new = d[q, m] + (b[q, m] if active[m] > 0.0 else 0.0)
            d[q, m] = new
            trial[q, m] = x[q, m] + new


@compiled
def correct_lanes(
    active, f, s, fixed_force, diagonal, d, b, matrix, carry, first, last, per_length, x, trial, rotation
):
    """Take a step of Newton's method, as ``_correction`` and ``_correct`` of one chain do.

    Parameters
    ----------
    active : float array (lanes,)
        1 in the lanes whose displacements are corrected, else 0.
    f, s : float arrays (dims (n + 1) + 1, lanes), (3 or 6, n + 2, lanes)
        Link forces, each coordinate after the other, and tangents.
    fixed_force, diagonal, d : float arrays (dims (n + 1), lanes)
        Forces that do not change in the step, diagonal of the tangent, displacements in the step; the last is corrected.
    b, matrix, carry : float arrays (dims (n + 1) + 1, lanes), (4 or 6, n + 1, lanes), (10 or 18, lanes)
        Workspace; the last row of b is 0.
    first, last : int
        The free particles.
    per_length, x, trial : float arrays (dims (n + 1), lanes)
        Inverse length of the links, 0 after the last one; positions at the beginning of the step; trial positions, updated.
    rotation : float array (lanes,)
        Filled with the root mean square rotations of the links by the corrections.
    """
    rows = d.shape[0]
    particles = matrix.shape[1]
    _residual(f, fixed_force, diagonal, d, b)
    for c in range(rows // particles):
        if first == 1:
            b[c * particles] = 0.0
        if last == particles - 1:
            b[c * particles + last] = 0.0
    carry[:] = 0.0
    if rows == 2 * particles:
        solve_planar_lanes(
            diagonal, (s[0], s[1], s[2]), (b, b[particles:]), (matrix[0], matrix[1], matrix[2], matrix[3]),
            (carry[0], carry[1], carry[2]), (carry[3], carry[4]), (carry[5], carry[6], carry[7]), (carry[8], carry[9]),
            first, last,
        )  # fmt: skip
    else:
        solve_spatial_lanes(
            diagonal, (s[0], s[1], s[2], s[3], s[4], s[5]), (b, b[particles:], b[2 * particles :]),
            (matrix[0], matrix[1], matrix[2], matrix[3], matrix[4], matrix[5]),
            (carry[0], carry[1], carry[2], carry[3], carry[4], carry[5]), (carry[6], carry[7], carry[8]),
            (carry[9], carry[10], carry[11], carry[12], carry[13], carry[14]), (carry[15], carry[16], carry[17]),
            first, last,
        )  # fmt: skip
    _correct(active, b, per_length, x, d, trial, rotation)
    for m in range(rotation.size):
        rotation[m] = math.sqrt(rotation[m] / rows)
