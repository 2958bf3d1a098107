"""Compiled forces and tangents of the links for the implicit schemes.

Loops run over all links of all lanes, j lanes + m; arrays as in :mod:`cablepod.chain._kernels_arguments`.
"""

import math

from cablepod._jit import compiled
from cablepod.discretisation._kernels_laws import (
    damping_by_tension,
    green_secant,
    linear_secant,
    taut_secant,
    viscous_secant,
)

#: A link of this squared length over the unstretched one is taut, whatever the rounding.
TAUT = 1.0 + 1e-12


@compiled(noalias=True, counted=False)
def elastic_links(sizes, chain, x, reach, t, g):
    """Fill the vectors of the links, tension over length t [N/m], and its derivative g by half the squared length."""
    lanes, dims, n = len(sizes.lanes), len(sizes.dims), chain.k.size
    for q in range(n):
        square = 0.0
        for c in range(dims):
            at = c * (n + lanes) + q
            difference = x[at + lanes] - x[at]
            reach[c * n + q] = difference
            square += difference * difference
        t[q] = square
    if chain.inverse_squares.size:
        for q in range(n):
            g[q] = chain.k[q] * chain.inverse_squares[q]
            t[q] = green_secant(t[q] * chain.inverse_squares[q], chain.k[q])
    else:
        for q in range(n):
            part = chain.length[q] / math.sqrt(t[q])
            secant, slope = linear_secant(part, chain.k[q]), chain.k[q] * part / t[q]
            g[q] = slope if secant > 0.0 else 0.0
            t[q] = taut_secant(secant, secant)


@compiled(forceinline=True)
def _taut_secant(length0, length1, k, length):
    """Return difference quotient and derivative of a link that is taut at both ends of a step, see :func:`_energy_secant`."""
    total = length0 + length1
    return linear_secant(2.0 * length / total, k), 2.0 * k * length / (total * total * length1)


@compiled(forceinline=True)
def _energy_secant(square0, square1, k, length):
    """Return the difference quotient of a link's energy, 2 (W1 - W0) / (|R1|^2 - |R0|^2) [N/m], and its derivative by |R1|^2 / 2.

    The form avoids cancellation for nearly equal lengths.
    """
    length0, length1 = math.sqrt(square0), math.sqrt(square1)
    over0, over1 = length0 - length, length1 - length
    total = length0 + length1
    if over0 > 0.0 and over1 > 0.0:
        return _taut_secant(length0, length1, k, length)
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


@compiled(noalias=True, counted=False)
def conserving_links(sizes, chain, x0, x1, reach, t, g):
    """Fill the mean vectors of the links over a step from x0 to x1, difference quotients t of their energies, and slopes g."""
    lanes, dims, n, slack = len(sizes.lanes), len(sizes.dims), chain.k.size, 0
    for q in range(n):
        square0, square1 = 0.0, 0.0
        for c in range(dims):
            at = c * (n + lanes) + q
            before, after = x0[at + lanes] - x0[at], x1[at + lanes] - x1[at]
            square0 += before * before
            square1 += after * after
            reach[c * n + q] = 0.5 * (before + after)
        t[q], g[q] = square0, square1
        slack += 0 if min(square0, square1) > TAUT * chain.length[q] * chain.length[q] else 1
    if chain.inverse_squares.size:
        for q in range(n):
            t[q] = green_secant(0.5 * (t[q] + g[q]) * chain.inverse_squares[q], chain.k[q])
            g[q] = 0.5 * chain.k[q] * chain.inverse_squares[q]
    elif slack == 0:  # a loop without branches is vectorised
        for q in range(n):
            t[q], g[q] = _taut_secant(math.sqrt(t[q]), math.sqrt(g[q]), chain.k[q], chain.length[q])
    else:
        for q in range(n):
            t[q], g[q] = _energy_secant(t[q], g[q], chain.k[q], chain.length[q])


@compiled(noalias=True, counted=False)
def _add_viscosity(sizes, chain, rates, rate, reach, t, g):
    """Add viscosity to taut links, which no force makes push: their tension and its slope are 0 then.

    `rates` are the velocities, `rate` their derivative by the unknowns [1/s].
    """
    lanes, dims, n = len(sizes.lanes), len(sizes.dims), chain.k.size
    for q in range(n):
        square, stretching = 0.0, 0.0
        for c in range(dims):
            along, at = reach[c * n + q], c * (n + lanes) + q
            square += along * along
            stretching += along * (rates[at + lanes] - rates[at])
        t[q] = taut_secant(t[q], viscous_secant(t[q], stretching, square, chain.viscosity[q]))
        g[q] = g[q] + chain.viscosity[q] / square * rate if t[q] > 0.0 else 0.0


@compiled(noalias=True, counted=False)
def assemble_links(sizes, part, reach, t, g, f, s):
    """Fill forces t R and tangents `part` t I + g R R^T of the links with the vectors R."""
    lanes, dims, n = len(sizes.lanes), len(sizes.dims), t.size
    row = lanes
    for c in range(dims):
        at = c * (n + lanes) + lanes
        for q in range(n):
            f[at + q] = t[q] * reach[c * n + q]
        for e in range(c, dims):
            own = part if e == c else 0.0
            for q in range(n):
                s[row + q] = own * t[q] + g[q] * reach[c * n + q] * reach[e * n + q]
            row += n + 2 * lanes


@compiled(noalias=True, counted=False)
def _add_tension_damping(sizes, chain, rates, rate, t, f, s):
    """Add damping by the tension: its product with tension over length and the difference of the velocities.

    Of its tangent only the part by the velocities is kept.
    """
    lanes, dims, n = len(sizes.lanes), len(sizes.dims), t.size
    row = lanes
    for c in range(dims):
        at = c * (n + lanes)
        for q in range(n):
            damping = damping_by_tension(t[q], t[q], chain.tension_damping[q])
            f[at + lanes + q] += damping * (rates[at + lanes + q] - rates[at + q])
            s[row + q] += damping * rate
        row += (dims - c) * (n + 2 * lanes)


@compiled(noalias=True, counted=False)
def _update_extremes(sizes, chain, x, low, high):
    """Update the extremes of the tensions [N]."""
    lanes, dims, n = len(sizes.lanes), len(sizes.dims), low.size
    for q in range(n):
        square = 0.0
        for c in range(dims):
            at = c * (n + lanes) + q
            square += (x[at + lanes] - x[at]) * (x[at + lanes] - x[at])
        stretched = math.sqrt(square)
        if chain.inverse_squares.size:
            tension = green_secant(square * chain.inverse_squares[q], chain.k[q]) * stretched
        else:
            tension = max(linear_secant(chain.length[q] / stretched, chain.k[q]), 0.0) * stretched
        low[q] = min(low[q], tension)
        high[q] = max(high[q], tension)
