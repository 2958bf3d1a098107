"""Compiled nodal forces of the spectral elements."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.discretisation._kernels_laws import green_secant, linear_secant, taut_secant, viscous_secant

# Arrays of elements have the shape (node or point, element), so that the inner loop over elements vectorises.  `unrolled` is None
# or a tuple with one entry for each node of an element.  The compiler knows its length and unrolls sums over nodes.


@compiled
def _gradient(x, d, scale, unrolled, nodal, g):
    """Fill the derivative g (points, elements) of x (N,) with respect to arc length."""
    count = d.shape[0] if unrolled is None else len(unrolled)
    elements = scale.size
    for e in range(elements):
        for i in range(count):
            nodal[i, e] = x[e * (count - 1) + i]
    for q in range(count):
        for e in range(elements):
            total = 0.0
            for i in range(count):
                total += d[q, i] * nodal[i, e]
            g[q, e] = total * scale[e]


@compiled
def _assemble(g, s, d_transposed, unrolled, nodal, f):
    """Assemble the nodal forces f = -D^T (s g) from the quadrature points; g is overwritten."""
    count = d_transposed.shape[0] if unrolled is None else len(unrolled)
    elements = g.shape[1]
    for q in range(count):
        for e in range(elements):
            g[q, e] *= s[q, e]
    for i in range(count):
        for e in range(elements):
            total = 0.0
            for q in range(count):
                total += d_transposed[i, q] * g[q, e]
            nodal[i, e] = total
    for j in range(f.size):
        f[j] = 0.0
    for e in range(elements):
        for i in range(count):
            f[e * (count - 1) + i] -= nodal[i, e]


@compiled
def _law(square, stretching, weight, stiffness, green, viscosity, s):
    """Fill s with weight times T / xi [N] at the points; return whether the stretch is below 1 anywhere.

    Law (21): T / xi = K (xi^2 - 1) / 2.  Linear law: T / xi = K max(1 - 1/xi, 0), with viscous terms as in the chain.
    `stretching` is the product of g and its rate.
    """
    below = False
    for q in range(s.shape[0]):
        w = weight[q]
        if green:
            for e in range(s.shape[1]):
                secant = green_secant(square[q, e], stiffness)
                below |= secant < 0.0
                s[q, e] = w * secant
        elif viscosity == 0.0:
            for e in range(s.shape[1]):
                elastic = linear_secant(1.0 / math.sqrt(square[q, e]), stiffness)
                below |= elastic < 0.0
                s[q, e] = w * taut_secant(elastic, elastic)
        else:
            for e in range(s.shape[1]):
                elastic = linear_secant(1.0 / math.sqrt(square[q, e]), stiffness)
                below |= elastic < 0.0
                total = viscous_secant(elastic, stretching[q, e], square[q, e], viscosity * stiffness)
                s[q, e] = w * taut_secant(elastic, total)
    return below


@compiled
def _scale_elements(s, ratio):
    """Multiply numbers of the points (points, elements) by one number for each element."""
    for q in range(s.shape[0]):
        for e in range(s.shape[1]):
            s[q, e] *= ratio[e]


@compiled
def _add_tension_damping(g, g_dot, s, tension_damping):
    """Add the damping by the tension to g (points, elements): tension_damping times its rate, 0 where the cable is slack."""
    for q in range(g.shape[0]):
        for e in range(g.shape[1]):
            if s[q, e] > 0.0:
                g[q, e] += tension_damping * g_dot[q, e]


@compiled
def _products(first, second, result):
    """Fill the scalar products of the vectors `first` and `second` (dims, points, elements)."""
    for q in range(result.shape[0]):
        for e in range(result.shape[1]):
            result[q, e] = first[0, q, e] * second[0, q, e] + first[1, q, e] * second[1, q, e]
    if first.shape[0] == 3:
        for q in range(result.shape[0]):
            for e in range(result.shape[1]):
                result[q, e] += first[2, q, e] * second[2, q, e]


@compiled(literal=False)
def _record_slack(square, step, slack):
    """Update `slack`: first step with a stretch below 1 and its point, step and point of the minimum, minimum of the square."""
    for e in range(square.shape[1]):
        for q in range(square.shape[0]):
            if square[q, e] < 1.0 and slack[0] < 0.0:
                slack[0] = step
                slack[1] = e * square.shape[0] + q
            if square[q, e] < slack[4]:
                slack[2] = step
                slack[3] = e * square.shape[0] + q
                slack[4] = square[q, e]


@compiled
def _nodal_forces(
    x, u, d, d_transposed, weight, scale, unrolled, stiffness, green, ratios, viscosity, tension_damping, f, g, g_dot, square,
    stretching, s, nodal, step, slack,
):  # fmt: skip
    """Fill the internal nodal forces f (dims, N) [N] at positions x; velocities u are used with these dampings only."""
    dims = x.shape[0]
    for c in range(dims):
        _gradient(x[c], d, scale, unrolled, nodal, g[c])
    _products(g, g, square)
    if viscosity > 0.0:
        for c in range(dims):
            _gradient(u[c], d, scale, unrolled, nodal, g_dot[c])
        _products(g, g_dot, stretching)
    if _law(square, stretching, weight, stiffness, green, viscosity, s):
        _record_slack(square, step, slack)
    if ratios is not None:
        _scale_elements(s, ratios[0])
    if tension_damping > 0.0:
        for c in range(dims):
            _gradient(u[c], d, scale, unrolled, nodal, g_dot[c])
            _add_tension_damping(g[c], g_dot[c], s, tension_damping)
    for c in range(dims):
        _assemble(g[c], s, d_transposed, unrolled, nodal, f[c])


@compiled
def _extremes(x, u, order, link_element, link_rows, stiffness, green, ratios, viscosity, low, high):
    """Update the extremes of the tensions [N] midway between output particles."""
    dims = x.shape[0]
    for j in range(low.size):
        a = link_element[j] * order
        square, stretching = 0.0, 0.0
        for c in range(dims):
            g, g_dot = 0.0, 0.0
            for i in range(order + 1):
                g += link_rows[j, i] * x[c, a + i]
                if viscosity > 0.0:
                    g_dot += link_rows[j, i] * u[c, a + i]
            square += g * g
            stretching += g * g_dot
        stretch = math.sqrt(square)
        if green:
            tension = green_secant(square, stiffness) * stretch
        else:
            elastic = linear_secant(1.0 / stretch, stiffness)
            tension = taut_secant(elastic, viscous_secant(elastic, stretching, square, viscosity * stiffness)) * stretch
        if ratios is not None:
            tension *= ratios[0, link_element[j]]
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


@compiled
def _is_inside(x, bound):
    """Return whether all coordinates are finite and below `bound`; counts, because a loop with an exit is not vectorised."""
    outside = 0
    for coordinate in x.flat:
        if not abs(coordinate) < bound:
            outside += 1
    return outside == 0


@compiled
def _pairs(d):
    """Return the products D_qi D_qj at [i, j, q]."""
    count = d.shape[0]
    pairs = np.empty((count, count, count))
    for i in range(count):
        for j in range(count):
            for q in range(count):
                pairs[i, j, q] = d[q, i] * d[q, j]
    return pairs
