"""Compiled forces of one state of the condensed model to leading order, and its equilibrium."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_layout import Sizes
from cablepod.condensed._kernels_terms import _fill_tangent, _forces

#: Relative tolerance of the equilibrium: last Newton correction over the deflection.
EQUILIBRIUM_RTOL = 1e-9
#: Relative Newton correction below which only rounding is left.
ROUNDING_RTOL = 1e-14


@compiled(counted=False)
def leading_force(terms, row, q, f, tangent, tension):
    """Fill undamped accelerations f (r,), their tangent (r, r) and H (1,) [N] for the boundary data of one instant."""
    mean = terms.mean_chordwise_forces
    _forces(Sizes((0,), q, mean, row[1 + mean.size :]), terms, row, 0, q, tension, f)
    _fill_tangent(terms, row, 0, q, tension[0], tangent)


@compiled(counted=False)
def leading_rest(terms, row, q, first, f, tangent, tension):
    """Change q into the equilibrium near it by Newton's method; False where it fails, or converges to another one.

    `first` and `f` (r,), `tangent` (r, r) and `tension` (1,) are work arrays.
    """
    scale = 0.0
    for i in range(q.size):
        first[i], scale = q[i], max(scale, abs(q[i]))
    for _ in range(2 * MAX_ITERATIONS):
        leading_force(terms, row, q, f, tangent, tension)
        if not _solve(tangent, f):
            return False
        change, largest = 0.0, 0.0
        for i in range(q.size):
            q[i] += f[i]
            change, largest = max(change, abs(f[i])), max(largest, abs(q[i]))
            if not abs(q[i]) <= 10.0 * scale:
                return False
        if change <= ROUNDING_RTOL * scale:
            break
    # an equilibrium further away than the deflection is that of the cable turned over
    furthest = 0.0
    for i in range(q.size):
        furthest = max(furthest, abs(q[i] - first[i]))
    return change <= EQUILIBRIUM_RTOL * scale and furthest <= scale
