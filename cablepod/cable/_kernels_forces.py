"""Compiled nodal forces of the spectral elements."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled

# --- forces -----------------------------------------------------------------------------------------------------------
# Work on elements has the shape (node or point, element): the loop over elements is the inner one that vectorises.  `fixed` is a
# tuple with one entry for each node of an element, whose length the compiler knows, so that it unrolls sums over nodes; or None.


@compiled
def _gradient(x, d, scale, fixed, spread, g):
    """Compute the derivative g (points, elements) of x (N,) by arc length."""
    count = d.shape[0] if fixed is None else len(fixed)
    elements = scale.size
    for e in range(elements):
        for i in range(count):
            spread[i, e] = x[e * (count - 1) + i]
    for q in range(count):
        for e in range(elements):
            total = 0.0
            for i in range(count):
                total += d[q, i] * spread[i, e]
            g[q, e] = total * scale[e]


@compiled
def _gather(g, s, d_transposed, fixed, spread, f):
    """Take what the points pull with, s g each, to the nodes: f = -D^T (s g); g is overwritten."""
    count = d_transposed.shape[0] if fixed is None else len(fixed)
    elements = g.shape[1]
    for q in range(count):
        for e in range(elements):
            g[q, e] *= s[q, e]
    for i in range(count):
        for e in range(elements):
            total = 0.0
            for q in range(count):
                total += d_transposed[i, q] * g[q, e]
            spread[i, e] = total
    for j in range(f.size):
        f[j] = 0.0
    for e in range(elements):
        for i in range(count):
            f[e * (count - 1) + i] -= spread[i, e]


@compiled
def _law(square, growth, weight, stiffness, green, viscosity, s):
    """Weight times tension over stretch [N] at the points; tells whether the stretch is below 1 anywhere.

    Law (21): T / xi = K (xi^2 - 1) / 2.  Linear law: K (1 - 1/xi) where xi > 1, else 0; viscous parts as in the chain.
    """
    below = False
    for q in range(s.shape[0]):
        w = weight[q]
        if green is not None:
            half = 0.5 * stiffness * w
            for e in range(s.shape[1]):
                strain = square[q, e] - 1.0
                below |= strain < 0.0
                s[q, e] = half * strain
        elif viscosity is None:
            for e in range(s.shape[1]):
                value = stiffness * (1.0 - 1.0 / math.sqrt(square[q, e]))
                below |= value < 0.0
                s[q, e] = w * (value if value > 0.0 else 0.0)
        else:
            for e in range(s.shape[1]):
                value = stiffness * (1.0 - 1.0 / math.sqrt(square[q, e]))
                below |= value < 0.0
                total = value + viscosity * stiffness * growth[q, e] / square[q, e]
                s[q, e] = w * (total if value > 0.0 and total > 0.0 else 0.0)
    return below


@compiled
def _products(g, h, result):
    """Scalar products of the vectors g and h (dims, points, elements)."""
    for q in range(result.shape[0]):
        for e in range(result.shape[1]):
            result[q, e] = g[0, q, e] * h[0, q, e] + g[1, q, e] * h[1, q, e]
    if g.shape[0] == 3:
        for q in range(result.shape[0]):
            for e in range(result.shape[1]):
                result[q, e] += g[2, q, e] * h[2, q, e]


@compiled
def _note_slack(square, step, slack):
    """Note the stretch below 1: slack is (first step, its place, step of the least, its place, least square)."""
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
def _pull(
    x, u, d, d_transposed, weight, scale, fixed, stiffness, green, viscosity, f, g, rate, square, growth, s, spread, step, slack
):  # fmt: skip
    """Compute the forces f (dims, N) [N] of the cable on its nodes at positions x; u are velocities, only with viscosity."""
    dims = x.shape[0]
    for c in range(dims):
        _gradient(x[c], d, scale, fixed, spread, g[c])
    _products(g, g, square)
    if viscosity is not None:
        for c in range(dims):
            _gradient(u[c], d, scale, fixed, spread, rate[c])
        _products(g, rate, growth)
    if _law(square, growth, weight, stiffness, green, viscosity, s):
        _note_slack(square, step, slack)
    for c in range(dims):
        _gather(g[c], s, d_transposed, fixed, spread, f[c])


@compiled
def forces(x, u, d, weight, scale, stiffness, green, viscosity):
    """Compute the forces of the cable on its nodes (dims, N) [N]; parameters as in :func:`verlet`, u only with viscosity."""
    shape = (weight.size, scale.size)
    f = np.empty_like(x)
    g, rate = np.empty((x.shape[0], *shape)), np.empty((x.shape[0], *shape))
    _pull(
        x, u, d, np.ascontiguousarray(d.T), weight, scale, None, stiffness, green, viscosity, f, g, rate, np.empty(shape),
        np.empty(shape), np.empty(shape), np.empty(shape), 0, np.array([-1.0, 0.0, 0.0, 0.0, 1.0]),
    )  # fmt: skip
    return f


@compiled
def _extremes(x, u, order, link_element, link_rows, stiffness, green, viscosity, low, high):
    """Update the extremes of the tensions [N] at places between particles."""
    dims = x.shape[0]
    for j in range(low.size):
        a = link_element[j] * order
        square, growth = 0.0, 0.0
        for c in range(dims):
            g, rate = 0.0, 0.0
            for i in range(order + 1):
                g += link_rows[j, i] * x[c, a + i]
                if viscosity is not None:
                    rate += link_rows[j, i] * u[c, a + i]
            square += g * g
            growth += g * rate
        size = math.sqrt(square)
        if green is not None:
            tension = 0.5 * stiffness * (square - 1.0) * size
        else:
            tension = stiffness * (size - 1.0)
            total = tension
            if viscosity is not None:
                total += viscosity * stiffness * growth / size
            tension = total if tension > 0.0 and total > 0.0 else 0.0
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)
