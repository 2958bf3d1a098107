"""Compiled forces to leading order on states of the condensed model."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.condensed._kernels_layout import Sizes
from cablepod.condensed._kernels_terms import _fill_tangent, _forces, _of_member


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
