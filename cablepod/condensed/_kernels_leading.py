"""Compiled forces to leading order on states of the condensed model, and those that damp their rates."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.condensed._kernels_layout import Sizes
from cablepod.condensed._kernels_rates import _add_rate_forces
from cablepod.condensed._kernels_terms import _chord_tensions, _fill_tangent, _forces, _of_member


@compiled(counted=False)
def leading_forces(terms, rows, q, f, tangent, tension):
    """Fill undamped accelerations f (members, r), their tangents (members, r, r) and H (members,) [N] at one instant of each.

    `terms` have a leading dimension of members, and so have the boundary data `rows` (members, columns) and coordinates q.
    """
    for member in range(q.shape[0]):
        own, row = _of_member(terms, member), rows[member]
        mean = own.mean_chordwise_forces
        of_member = tension[member : member + 1]
        _forces(Sizes((0,), q[member], mean, row[1 + mean.size :]), own, row, 0, q[member], of_member, f[member])
        _fill_tangent(own, row, 0, q[member], tension[member], tangent[member])


@compiled(counted=False)
def rate_forces(terms, rate_terms, rows, q, u, work, f, tension):
    """Fill the damping f (times, r) of rates u at coordinates q (times, r), and H (times,) [N].

    `rows` are the boundary data (times, columns); `work` (r,) is overwritten.
    """
    mean = terms.mean_chordwise_forces
    for t in range(q.shape[0]):
        row, of_time = rows[t], tension[t : t + 1]
        sizes = Sizes((0,), q[t], mean, row[1 + mean.size :])
        _chord_tensions(sizes, terms, row, 0, q[t], of_time)
        for j in range(q.shape[1]):
            f[t, j] = 0.0
        _add_rate_forces(sizes, terms, rate_terms, row, 0, of_time, u[t], work, f[t])
