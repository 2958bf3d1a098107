"""Compiled constraint equations of the rigid links: projection of positions and velocities, accelerations."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.rigid._kernels_layout import (
    ACCELERATION,
    BASE,
    CORRECTION,
    DONE,
    DRIVE,
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

#: A pivot below this part of its diagonal leaves a multiplier with hardly a digit: all links lie on a line between held ends.
SMALLEST_PIVOT = 1e-13
MOST_ITERATIONS = 25
#: Where rounding lets no correction do better, a relative length error below this is accepted.
STAGNATED = 1e-11


@compiled
def _dot(s, a, i, b, j, spatial):
    """Product of the vectors in rows `a`, column `i` and rows `b`, column `j`."""
    total = s[a, i] * s[b, j] + s[a + 1, i] * s[b + 1, j]
    if spatial is not None:
        total += s[a + 2, i] * s[b + 2, j]
    return total


@compiled
def _dims(spatial):
    return 2 if spatial is None else 3


@compiled
def _directions(s, links, spatial, position, unit):
    """Link vectors over lengths, from the rows `position` to the rows `unit`."""
    for c in range(_dims(spatial)):
        for j in range(links):
            s[unit + c, j] = (s[position + c, j + 1] - s[position + c, j]) * s[INVERSE_LENGTH, j]


@compiled
def _forces(s, links, spatial, multiplier, unit):
    """Compute forces of the links from the multipliers in a row."""
    for c in range(_dims(spatial)):
        for j in range(links):
            s[FORCE + c, j + 1] = s[multiplier, j] * s[unit + c, j]


@compiled
def _length_error(s, links, spatial, unit):
    """Fill RIGHT with the constraints [m]; returns the largest relative length error."""
    worst = 0.0
    for j in range(links):
        g = 0.5 * (_dot(s, unit, j, unit, j, spatial) - 1.0)
        s[RIGHT, j] = g * s[LENGTH, j]
        if not abs(g) <= worst:  # nan too
            worst = abs(g)
    return worst


@compiled
def _solve(s, links, spatial, left, right):
    """Solve the tridiagonal system of the gradients `left` and the directions of the forces `right` for RIGHT.

    Row j has (1/m_j + 1/m_(j+1)) l_j.r_j on the diagonal, -l_j.r_(j+1) / m_(j+1) and -l_j.r_(j-1) / m_j beside it.  Elimination
    without exchanges: the diagonal is no smaller than the sum of the others as long as left and right are hardly different.  The
    solution is put into CORRECTION; returns whether there is one.
    """
    beside, before = 0.0, 0.0  # upper neighbour over the pivot, and right side over the pivot, of the row before
    for j in range(links):
        diagonal = (s[INVERSE_MASS, j] + s[INVERSE_MASS, j + 1]) * _dot(s, left, j, right, j, spatial)
        pivot = diagonal
        value = s[RIGHT, j]
        if j > 0:
            lower = -s[INVERSE_MASS, j] * _dot(s, left, j, right, j - 1, spatial)
            pivot -= lower * beside
            value -= lower * before
        if not pivot > SMALLEST_PIVOT * diagonal:
            return False
        inverse = 1.0 / pivot
        if j < links - 1:
            beside = -s[INVERSE_MASS, j + 1] * _dot(s, left, j, right, j + 1, spatial) * inverse
        before = value * inverse
        s[PIVOT, j] = beside
        s[CORRECTION, j] = before
    for j in range(links - 2, -1, -1):
        s[CORRECTION, j] -= s[PIVOT, j] * s[CORRECTION, j + 1]
    return True


@compiled
def _onto_manifold(s, links, spatial, factor, tolerance, counts):
    """Find NX = BASE + factor (forces T e) / m whose links have their lengths, by Newton's method for T from what is there.

    Returns DONE, NOT_CONVERGED or SINGULAR.  A root with a link turned by more than a right angle is none that a motion can
    have led to.
    """
    last = np.inf
    for iteration in range(MOST_ITERATIONS):
        _forces(s, links, spatial, T, E)
        for c in range(_dims(spatial)):
            for j in range(links + 1):
                force = s[FORCE + c, j + 1] - s[FORCE + c, j]
                s[NX + c, j] = s[BASE + c, j] + factor * s[INVERSE_MASS, j] * force
        _directions(s, links, spatial, NX, N)
        worst = _length_error(s, links, spatial, N)
        if worst <= tolerance or (iteration > 0 and 0.5 * last <= worst <= STAGNATED):
            for j in range(links):
                if not _dot(s, N, j, E, j, spatial) > 0.0:
                    return NOT_CONVERGED
            counts[LENGTH_ERROR] = max(counts[LENGTH_ERROR], worst)
            return DONE
        if not worst < 1e3:
            return NOT_CONVERGED
        last = worst
        if not _solve(s, links, spatial, N, E):
            # with the first guess the lines may have been turned too far; at rest it is the chain that is straight
            return SINGULAR if iteration == 0 else NOT_CONVERGED
        for j in range(links):
            s[T, j] += s[CORRECTION, j] / factor
        counts[ITERATIONS] += 1.0
    return NOT_CONVERGED


@compiled
def _onto_velocities(s, links, spatial, velocity, unit):
    """Change the velocities in the rows `velocity` by impulses along the links until no link is stretched.

    The impulses [N s] stay in CORRECTION; returns whether there are any.
    """
    for j in range(links):
        total = (s[velocity, j + 1] - s[velocity, j]) * s[unit, j]
        total += (s[velocity + 1, j + 1] - s[velocity + 1, j]) * s[unit + 1, j]
        if spatial is not None:
            total += (s[velocity + 2, j + 1] - s[velocity + 2, j]) * s[unit + 2, j]
        s[RIGHT, j] = total
    if not _solve(s, links, spatial, unit, unit):
        return False
    _forces(s, links, spatial, CORRECTION, unit)
    for c in range(_dims(spatial)):
        for j in range(links + 1):
            s[velocity + c, j] += s[INVERSE_MASS, j] * (s[FORCE + c, j + 1] - s[FORCE + c, j])
    return True


@compiled
def _accelerations(s, links, spatial, velocity, unit, damping, stabilise):
    """Accelerations by the index-1 form at the velocities in the rows `velocity` and link vectors in `unit`.

    ACCELERATION of held ends must have been set.  The constraint differentiated twice, e.(a_(j+1) - a_j) + |v_(j+1) - v_j|^2 / l
    = 0, gives the multipliers, left in CORRECTION; with a rate `stabilise` [1/s] of at least 0 Baumgarte's terms, 2 rate g' +
    rate^2 g, are added, which draw a drift back.
    """
    for c in range(_dims(spatial)):
        for j in range(links + 1):
            if s[INVERSE_MASS, j] > 0.0:
                s[ACCELERATION + c, j] = s[DRIVE + c, j] - damping * s[velocity + c, j]
    for j in range(links):
        square, along = 0.0, 0.0
        for c in range(_dims(spatial)):
            dv = s[velocity + c, j + 1] - s[velocity + c, j]
            square += dv * dv
            along += s[unit + c, j] * (s[ACCELERATION + c, j + 1] - s[ACCELERATION + c, j])
        s[RIGHT, j] = square * s[INVERSE_LENGTH, j] + along
    if stabilise >= 0.0:
        for j in range(links):
            g = 0.5 * (_dot(s, unit, j, unit, j, spatial) - 1.0) * s[LENGTH, j]
            rate = 0.0
            for c in range(_dims(spatial)):
                rate += s[unit + c, j] * (s[velocity + c, j + 1] - s[velocity + c, j])
            s[RIGHT, j] += stabilise * (2.0 * rate + stabilise * g)
    if not _solve(s, links, spatial, unit, unit):
        return False
    _forces(s, links, spatial, CORRECTION, unit)
    for c in range(_dims(spatial)):
        for j in range(links + 1):
            s[ACCELERATION + c, j] += s[INVERSE_MASS, j] * (s[FORCE + c, j + 1] - s[FORCE + c, j])
    return True
