"""Compiled terms of the condensed model to leading order: closure, forces and tangent, for one run and for many.

Members lie in lanes, the last dimension of all arrays, which are flat: entry (j, m) of (r, lanes) has the index j lanes + m.  A
run alone is one lane.  Every scheme, single runs, batches, hosts and the error estimate call these functions.
"""

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_layout import LeadingTerms, Sizes
from cablepod.discretisation._kernels_laws import closure_tension


@compiled(fastmath=REORDERED_FUSED, noalias=True, forceinline=True, literal=False, counted=False)
def _chord_tensions(sizes, terms, row, q, tension):
    """Fill H (lanes) [N] by the closure to leading order.

    H = K (c / L0 - 1) - sum_a g_a mean_a + K / (2 L0) sum_j kappa_j q_j^2

    `row` holds the boundary data of an instant (columns, lanes), flat: chord c [m], loads along the chord g [N/m], loads along
    the normals p [N/m]; point loads [N].
    """
    lanes, size, patterns = len(sizes.lanes), len(sizes.modes), len(sizes.patterns)
    for m in range(lanes):
        load, squares = 0.0, 0.0
        for a in range(patterns):
            load += row[(1 + a) * lanes + m] * terms.mean_chordwise_forces[a * lanes + m]
        for j in range(size):
            k = j * lanes + m
            squares += terms.kappa[k] * q[k] * q[k]
        stretch, sag = row[m] * terms.inverse_length[m], terms.sag_stiffness[m] * squares
        tension[m] = closure_tension(terms.stiffness[m], stretch, load, sag)


@compiled(fastmath=REORDERED_FUSED, noalias=True, forceinline=True, literal=False, counted=False)
def _geometric_forces(sizes, terms, row, tension, x, f):
    """Fill f (r, lanes) with the geometric stiffness H kappa + sum_a g_a G_a times x (r, lanes)."""
    lanes, size, patterns = len(sizes.lanes), len(sizes.modes), len(sizes.patterns)
    for j in range(size):
        for m in range(lanes):
            total = tension[m] * terms.kappa[j * lanes + m] * x[j * lanes + m]
            for a in range(patterns):
                # indices without sign: a negative one would count from the end, a test that keeps loops from being vectorised
                stiff, first = 0.0, (a * size + j) * size
                for k in range(size):
                    stiff += terms.geometric_stiffness[np.uintp((first + k) * lanes + m)] * x[np.uintp(k * lanes + m)]
                total += row[(1 + a) * lanes + m] * stiff
            f[j * lanes + m] = total


@compiled(fastmath=REORDERED_FUSED, noalias=True, forceinline=True, literal=False, counted=False)
def _forces(sizes, terms, row, q, tension, f):
    """Fill H (lanes) [N] and the undamped accelerations f (r, lanes) = P p - (H kappa + sum_a g_a G_a) q."""
    lanes, size, patterns = len(sizes.lanes), len(sizes.modes), len(sizes.patterns)
    _chord_tensions(sizes, terms, row, q, tension)
    _geometric_forces(sizes, terms, row, tension, q, f)
    for j in range(size):
        for m in range(lanes):
            load = 0.0
            for a in range(len(sizes.normal_loads)):
                load += row[(1 + patterns + a) * lanes + m] * terms.load_projection[(a * size + j) * lanes + m]
            f[j * lanes + m] = load - f[j * lanes + m]


@compiled(noalias=True, literal=False, counted=False)
def _fill_tangent(terms, row, q, tension, tangent):
    """Fill the negative derivative of the accelerations of one lane by q (r, r): H kappa + g G + K / L0 kappa q (kappa q)^T."""
    size, patterns = q.size, terms.mean_chordwise_forces.size
    for i in range(size):
        by_sag = 2.0 * terms.sag_stiffness[0] * terms.kappa[i] * q[i]
        for j in range(size):
            tangent[i, j] = by_sag * terms.kappa[j] * q[j]
        for a in range(patterns):
            load = row[1 + a]
            for j in range(size):
                tangent[i, j] += load * terms.geometric_stiffness[(a * size + i) * size + j]
        tangent[i, i] += tension * terms.kappa[i]


@compiled(literal=False, counted=False, forceinline=True)
def _of_member(terms, member):
    """Return the coefficients of one member from arrays with a leading dimension; for kernels that count no references."""
    return LeadingTerms(
        terms.stiffness[member], terms.inverse_length[member], terms.sag_stiffness[member], terms.kappa[member],
        terms.mean_chordwise_forces[member], terms.geometric_stiffness[member], terms.load_projection[member],
    )  # fmt: skip


@compiled(counted=False)
def leading_forces(terms, rows, q, f, tangent, tension):
    """Fill undamped accelerations f (members, r), their tangents (members, r, r) and H (members,) [N] at one instant of each.

    `terms` have a leading dimension of members, and so have the boundary data `rows` (members, columns) and coordinates q.
    """
    for member in range(q.shape[0]):
        own, row = _of_member(terms, member), rows[member]
        mean = own.mean_chordwise_forces
        of_member = tension[member : member + 1]
        _forces(Sizes((0,), q[member], mean, row[1 + mean.size :]), own, row, q[member], of_member, f[member])
        _fill_tangent(own, row, q[member], tension[member], tangent[member])
