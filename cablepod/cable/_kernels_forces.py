"""Compiled nodal forces of the spectral elements.

Arrays as in :mod:`cablepod.cable._kernels_arguments`.
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


@compiled(noalias=True, counted=False)
def _clear(values):
    """Fill a table with zeros."""
    for row in range(values.shape[0]):
        for column in range(values.shape[1]):
            values[row, column] = 0.0


@compiled(noalias=True, counted=False)
def _gradient(elements, x, nodal, g):
    """Fill the derivative g (points, elements) of x (N,) with respect to arc length."""
    count = len(elements.nodes)
    for e in range(elements.scale.size):
        for i in range(count):
            nodal[i, e] = x[e * (count - 1) + i]
    for q in range(count):
        for e in range(elements.scale.size):
            total = 0.0
            for i in range(count):
                total += elements.d[q, i] * nodal[i, e]
            g[q, e] = total * elements.scale[e]


@compiled(noalias=True, counted=False)
def _assemble(elements, g, s, nodal, f):
    """Add the nodal forces -D^T (s g) from the quadrature points to f (N,); g is overwritten."""
    count = len(elements.nodes)
    for q in range(count):
        for e in range(elements.scale.size):
            g[q, e] *= s[q, e]
    for i in range(count):
        for e in range(elements.scale.size):
            total = 0.0
            for q in range(count):
                total += elements.d_transposed[i, q] * g[q, e]
            nodal[i, e] = total
    for e in range(elements.scale.size):
        for i in range(count):
            f[e * (count - 1) + i] -= nodal[i, e]


@compiled(noalias=True, counted=False)
def _law(elements, square, stretching, s):
    """Fill s with weight times T / xi [N] at the points; return whether the stretch is below 1 anywhere.

    Law (21): T / xi = K (xi^2 - 1) / 2.  Linear law: T / xi = K max(1 - 1/xi, 0), with viscous terms as in the chain.
    """
    below, stiffness, viscosity = False, elements.stiffness, elements.viscosity
    for q in range(s.shape[0]):
        w = elements.weight[q]
        if elements.green:
            for e in range(s.shape[1]):
                secant = green_secant(square[q, e], stiffness[e])
                below |= secant < 0.0
                s[q, e] = w * secant
        elif viscosity == 0.0:
            for e in range(s.shape[1]):
                elastic = linear_secant(1.0 / math.sqrt(square[q, e]), stiffness[e])
                below |= elastic < 0.0
                s[q, e] = w * taut_secant(elastic, elastic)
        else:
            for e in range(s.shape[1]):
                elastic = linear_secant(1.0 / math.sqrt(square[q, e]), stiffness[e])
                below |= elastic < 0.0
                total = viscous_secant(elastic, stretching[q, e], square[q, e], viscosity * stiffness[e])
                s[q, e] = w * taut_secant(elastic, total)
    return below


@compiled(noalias=True, counted=False)
def _add_tension_damping(g, g_dot, s, tension_damping):
    """Add the damping by the tension to g (points, elements): tension_damping times its rate, 0 where the cable is slack."""
    for q in range(g.shape[0]):
        for e in range(g.shape[1]):
            g[q, e] += damping_by_tension(g_dot[q, e], s[q, e], tension_damping)


@compiled(noalias=True, counted=False)
def _products(first, second, result):
    """Fill the scalar products of the vectors `first` and `second` (dims, points, elements)."""
    for q in range(result.shape[0]):
        for e in range(result.shape[1]):
            result[q, e] = first[0, q, e] * second[0, q, e] + first[1, q, e] * second[1, q, e]
    if first.shape[0] == 3:
        for q in range(result.shape[0]):
            for e in range(result.shape[1]):
                result[q, e] += first[2, q, e] * second[2, q, e]


@compiled(inline="always")
def _stresses(elements, x, work):
    """Fill g, its square and s at positions x; the velocities `work.u` count with dampings of the cable itself only.

    Returns
    -------
    bool
        Whether the stretch is below 1 anywhere.
    """
    for c in range(x.shape[0]):
        _gradient(elements, x[c], work.nodal, work.g[c])
    _products(work.g, work.g, work.square)
    if elements.viscosity > 0.0 or elements.tension_damping > 0.0:
        for c in range(x.shape[0]):
            _gradient(elements, work.u[c], work.nodal, work.g_dot[c])
        _products(work.g, work.g_dot, work.stretching)
    return _law(elements, work.square, work.stretching, work.s)


@compiled(inline="always")
def _add_forces(elements, work):
    """Add the internal nodal forces [N] of these stresses to `work.force`; g is overwritten."""
    for c in range(work.g.shape[0]):
        if elements.tension_damping > 0.0:
            _add_tension_damping(work.g[c], work.g_dot[c], work.s, elements.tension_damping)
        _assemble(elements, work.g[c], work.s, work.nodal, work.force[c])


@compiled(counted=False)
def _set_end_rates(elements, end_rates, i, u):
    """Give the held ends their velocities at step `i` of the tables."""
    last = u.shape[1] - 1
    for c in range(u.shape[0]):
        if elements.first == 1:
            u[c, 0] = end_rates[i, 0, c]
        if elements.last == last:
            u[c, last] = end_rates[i, 1, c]


@compiled(literal=False, counted=False)
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


@compiled(counted=False)
def _extremes(elements, record, work):
    """Update the extremes of the tensions [N] midway between output particles, by the stresses of `work`, unless unasked.

    Tensions are interpolated from the quadrature points, as in :meth:`cablepod.cable._mesh.SpectralMesh.tensions_and_forces`.
    """
    if record.low.size == 0:
        return
    for q in range(work.s.shape[0]):
        for e in range(work.s.shape[1]):
            work.nodal[q, e] = work.s[q, e] / elements.weight[q] * math.sqrt(work.square[q, e])
    for j in range(record.low.size):
        tension = 0.0
        for q in range(work.s.shape[0]):
            tension += record.link_weights[j, q] * work.nodal[q, record.element[j]]
        if not elements.green:
            tension = max(tension, 0.0)
        record.low[j] = min(record.low[j], tension)
        record.high[j] = max(record.high[j], tension)


@compiled(counted=False)
def _is_inside(x, bound):
    """Return whether all coordinates are finite and below `bound`; counts, because a loop with an exit is not vectorised."""
    outside = 0
    for coordinate in x.flat:
        if not abs(coordinate) < bound:
            outside += 1
    return outside == 0
