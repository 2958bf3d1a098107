"""Compiled constraint equations of the rigid links: tridiagonal systems, projection of positions and velocities."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.rigid._kernels_layout import (
    BASE,
    CORRECTION,
    DONE,
    FORCE,
    INVERSE_LENGTH,
    INVERSE_MASS,
    ITERATIONS,
    LENGTH,
    LENGTH_ERROR,
    NOT_CONVERGED,
    NX,
    PIVOT,
    RIGHT,
    SINGULAR,
    E,
    N,
    T,
)

#: Minimum pivot over its diagonal (below, the system is singular: all links lie on a line between held ends).
MIN_PIVOT = 1e-13
#: Maximum number of Newton iterations.
MAX_ITERATIONS = 25
#: Maximum relative length error that is accepted when rounding stalls Newton's method.
STALLED_RTOL = 1e-11


@compiled(literal=False)
def dot(s, a, i, b, j, spatial):
    """Return the inner product of the vectors in rows `a`, column `i` and rows `b`, column `j`."""
    total = s[a, i] * s[b, j] + s[a + 1, i] * s[b + 1, j]
    if spatial is not None:
        total += s[a + 2, i] * s[b + 2, j]
    return total


@compiled
def dimensions(spatial):
    """Return the number of coordinates."""
    return 2 if spatial is None else 3


@compiled(literal=False)
def link_vectors(s, links, spatial, position, unit):
    """Compute link vectors over lengths from the rows `position` into the rows `unit`."""
    for c in range(dimensions(spatial)):
        for j in range(links):
            s[unit + c, j] = (s[position + c, j + 1] - s[position + c, j]) * s[INVERSE_LENGTH, j]


@compiled(literal=False)
def link_forces(s, links, spatial, multiplier, unit):
    """Compute the forces of the links [N] from the multipliers in the row `multiplier`."""
    for c in range(dimensions(spatial)):
        for j in range(links):
            s[FORCE + c, j + 1] = s[multiplier, j] * s[unit + c, j]


@compiled(literal=False)
def length_error(s, links, spatial, unit):
    """Fill RIGHT with the constraints [m]; returns the maximum relative length error."""
    worst = 0.0
    for j in range(links):
        g = 0.5 * (dot(s, unit, j, unit, j, spatial) - 1.0)
        s[RIGHT, j] = g * s[LENGTH, j]
        if not abs(g) <= worst:  # also for NaN
            worst = abs(g)
    return worst


@compiled(literal=False)
def solve_tridiagonal(s, links, spatial, left, right):
    """Solve the tridiagonal system with constraint gradients `left`, force directions `right` and right side RIGHT.

    Row j has (1/m_j + 1/m_(j+1)) l_j.r_j on the diagonal, -l_j.r_(j+1) / m_(j+1) and -l_j.r_(j-1) / m_j beside it.  Elimination
    needs no pivoting: the matrix is diagonally dominant if left and right differ little.  The solution is in CORRECTION; returns
    False if the system is singular.
    """
    beside, before = 0.0, 0.0  # upper neighbour and right side of the row before, over its pivot
    for j in range(links):
        diagonal = (s[INVERSE_MASS, j] + s[INVERSE_MASS, j + 1]) * dot(s, left, j, right, j, spatial)
        pivot = diagonal
        value = s[RIGHT, j]
        if j > 0:
            lower = -s[INVERSE_MASS, j] * dot(s, left, j, right, j - 1, spatial)
            pivot -= lower * beside
            value -= lower * before
        if not pivot > MIN_PIVOT * diagonal:
            return False
        inverse = 1.0 / pivot
        if j < links - 1:
            beside = -s[INVERSE_MASS, j + 1] * dot(s, left, j, right, j + 1, spatial) * inverse
        before = value * inverse
        s[PIVOT, j] = beside
        s[CORRECTION, j] = before
    for j in range(links - 2, -1, -1):
        s[CORRECTION, j] -= s[PIVOT, j] * s[CORRECTION, j + 1]
    return True


@compiled
def project_positions(s, links, spatial, factor, tolerance, counts):
    """Solve for T and NX = BASE + factor (forces T e) / m with the lengths of the links, by Newton's method from T.

    Returns DONE, NOT_CONVERGED or SINGULAR.  A root with a link rotated by more than a right angle is rejected, as it does not
    belong to the motion.
    """
    last = np.inf
    for iteration in range(MAX_ITERATIONS):
        link_forces(s, links, spatial, T, E)
        for c in range(dimensions(spatial)):
            for j in range(links + 1):
                force = s[FORCE + c, j + 1] - s[FORCE + c, j]
                s[NX + c, j] = s[BASE + c, j] + factor * s[INVERSE_MASS, j] * force
        link_vectors(s, links, spatial, NX, N)
        worst = length_error(s, links, spatial, N)
        if worst <= tolerance or (iteration > 0 and 0.5 * last <= worst <= STALLED_RTOL):
            for j in range(links):
                if not dot(s, N, j, E, j, spatial) > 0.0:
                    return NOT_CONVERGED
            counts[LENGTH_ERROR] = max(counts[LENGTH_ERROR], worst)
            return DONE
        if not worst < 1e3:
            return NOT_CONVERGED
        last = worst
        if not solve_tridiagonal(s, links, spatial, N, E):
            # the first system has nearly equal gradients and directions: only a straight chain makes it singular
            return SINGULAR if iteration == 0 else NOT_CONVERGED
        for j in range(links):
            s[T, j] += s[CORRECTION, j] / factor
        counts[ITERATIONS] += 1.0
    return NOT_CONVERGED


@compiled(literal=False)
def project_velocities(s, links, spatial, velocity, unit):
    """Project the velocities in the rows `velocity` so that they stretch no link, by impulses along the links.

    The impulses [N s] are in CORRECTION; returns False if the system is singular.
    """
    for j in range(links):
        total = (s[velocity, j + 1] - s[velocity, j]) * s[unit, j]
        total += (s[velocity + 1, j + 1] - s[velocity + 1, j]) * s[unit + 1, j]
        if spatial is not None:
            total += (s[velocity + 2, j + 1] - s[velocity + 2, j]) * s[unit + 2, j]
        s[RIGHT, j] = total
    if not solve_tridiagonal(s, links, spatial, unit, unit):
        return False
    link_forces(s, links, spatial, CORRECTION, unit)
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[velocity + c, j] += s[INVERSE_MASS, j] * (s[FORCE + c, j + 1] - s[FORCE + c, j])
    return True
