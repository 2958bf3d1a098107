"""Compiled terms of a step that RATTLE and the index-1 form share.

Constraints: tridiagonal systems, projection of positions and velocities.  Then loads, held ends, energy account, saved states.
"""

import numpy as np

from cablepod._jit import compiled
from cablepod.integrate._kernels_assign import assign
from cablepod.rigid import _kernels_layout as at

#: Minimum pivot over its diagonal (below, the system is singular: all links lie on a line between held ends).
MIN_PIVOT = 1e-13
#: Maximum number of Newton iterations.
MAX_ITERATIONS = 25
#: Maximum relative length error that is accepted when rounding stalls Newton's method.
STALLED_RTOL = 1e-11
#: Maximum energy imbalance over the energy supplied by start, loads and ends; a run beyond it is stopped.
MAX_IMBALANCE = 10.0

# --- constraints ------------------------------------------------------------------------------------------------------


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
            s[unit + c, j] = (s[position + c, j + 1] - s[position + c, j]) * s[at.INVERSE_LENGTH, j]


@compiled(literal=False)
def link_forces(s, links, spatial, multiplier, unit):
    """Compute the forces of the links [N] from the multipliers in the row `multiplier`."""
    for c in range(dimensions(spatial)):
        for j in range(links):
            s[at.FORCE + c, j + 1] = s[multiplier, j] * s[unit + c, j]


@compiled(literal=False)
def length_error(s, links, spatial, unit):
    """Fill RIGHT with the constraints [m]; returns the maximum relative length error."""
    worst = 0.0
    for j in range(links):
        g = 0.5 * (dot(s, unit, j, unit, j, spatial) - 1.0)
        s[at.RIGHT, j] = g * s[at.LENGTH, j]
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
        diagonal = (s[at.INVERSE_MASS, j] + s[at.INVERSE_MASS, j + 1]) * dot(s, left, j, right, j, spatial)
        pivot = diagonal
        value = s[at.RIGHT, j]
        if j > 0:
            lower = -s[at.INVERSE_MASS, j] * dot(s, left, j, right, j - 1, spatial)
            pivot -= lower * beside
            value -= lower * before
        if not pivot > MIN_PIVOT * diagonal:
            return False
        inverse = 1.0 / pivot
        if j < links - 1:
            beside = -s[at.INVERSE_MASS, j + 1] * dot(s, left, j, right, j + 1, spatial) * inverse
        before = value * inverse
        s[at.PIVOT, j] = beside
        s[at.CORRECTION, j] = before
    for j in range(links - 2, -1, -1):
        s[at.CORRECTION, j] -= s[at.PIVOT, j] * s[at.CORRECTION, j + 1]
    return True


@compiled
def project_positions(s, links, spatial, factor, tolerance, counts):
    """Solve for T and NX = BASE + factor (forces T e) / m with the lengths of the links, by Newton's method from T.

    Returns DONE, NOT_CONVERGED or SINGULAR.  A root with a link rotated by more than a right angle is rejected, as it does not
    belong to the motion.
    """
    last = np.inf
    for iteration in range(MAX_ITERATIONS):
        link_forces(s, links, spatial, at.T, at.E)
        for c in range(dimensions(spatial)):
            for j in range(links + 1):
                force = s[at.FORCE + c, j + 1] - s[at.FORCE + c, j]
                s[at.NX + c, j] = s[at.BASE + c, j] + factor * s[at.INVERSE_MASS, j] * force
        link_vectors(s, links, spatial, at.NX, at.N)
        worst = length_error(s, links, spatial, at.N)
        if worst <= tolerance or (iteration > 0 and 0.5 * last <= worst <= STALLED_RTOL):
            for j in range(links):
                if not dot(s, at.N, j, at.E, j, spatial) > 0.0:
                    return at.NOT_CONVERGED
            counts[at.LENGTH_ERROR] = max(counts[at.LENGTH_ERROR], worst)
            return at.DONE
        if not worst < 1e3:
            return at.NOT_CONVERGED
        last = worst
        if not solve_tridiagonal(s, links, spatial, at.N, at.E):
            # the first system has nearly equal gradients and directions: only a straight chain makes it singular
            return at.SINGULAR if iteration == 0 else at.NOT_CONVERGED
        for j in range(links):
            s[at.T, j] += s[at.CORRECTION, j] / factor
        counts[at.ITERATIONS] += 1.0
    return at.NOT_CONVERGED


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
        s[at.RIGHT, j] = total
    if not solve_tridiagonal(s, links, spatial, unit, unit):
        return False
    link_forces(s, links, spatial, at.CORRECTION, unit)
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[velocity + c, j] += s[at.INVERSE_MASS, j] * (s[at.FORCE + c, j + 1] - s[at.FORCE + c, j])
    return True


# --- terms of a step --------------------------------------------------------------------------------------------------


@compiled
def load_accelerations(s, links, spatial, patterns, factors):
    """Compute the accelerations by constant and time-dependent loads."""
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[at.LOAD + c, j] = s[at.STEADY + c, j]
        for load in range(patterns.shape[0]):
            factor = factors[load]
            for j in range(links + 1):
                s[at.LOAD + c, j] += factor * patterns[load, c, j]


@compiled(literal=False)
def set_ends(s, links, spatial, row, ends):
    """Put values (end, dims) of the held ends into the rows from `row` on."""
    for c in range(dimensions(spatial)):
        if s[at.INVERSE_MASS, 0] == 0.0:
            s[row + c, 0] = ends[0, c]
        if s[at.INVERSE_MASS, links] == 0.0:
            s[row + c, links] = ends[1, c]


@compiled(literal=False)
def end_work(s, links, spatial, multiplier, unit, row):
    """Return the forces of the held ends times the vectors in the rows from `row` on: power, or work."""
    total = 0.0
    for c in range(dimensions(spatial)):
        if s[at.INVERSE_MASS, 0] == 0.0:
            total -= s[multiplier, 0] * s[unit + c, 0] * s[row + c, 0]
        if s[at.INVERSE_MASS, links] == 0.0:
            total += s[multiplier, links - 1] * s[unit + c, links - 1] * s[row + c, links]
    return total


@compiled(literal=False, forceinline=True)
def by_mass(s, links, spatial, first, second):
    """Return the sum of the masses times the inner products of the vectors in the rows from `first` and from `second` on."""
    total = 0.0
    for j in range(links + 1):
        total += s[at.MASS, j] * dot(s, first, j, second, j, spatial)
    return total


@compiled(literal=False, forceinline=True)
def kinetic_energy(s, links, spatial, velocity):
    """Return the kinetic energy [J] of the velocities in the rows `velocity`."""
    return 0.5 * by_mass(s, links, spatial, velocity, velocity)


@compiled(forceinline=True)
def end_step(s, links, spatial, counts):
    """Go on to the new positions and link vectors; update the maximum rotation; returns whether the energies are in balance."""
    copy_vectors(s, links, spatial, at.NX, at.X)
    copy_vectors(s, links, spatial, at.N, at.E)
    counts[at.KINETIC] = kinetic_energy(s, links, spatial, at.V)
    counts[at.MAX_ROTATION_SQUARED] = max(counts[at.MAX_ROTATION_SQUARED], _max_rotation_squared(s, links, spatial))
    return _is_balanced(counts)


@compiled
def _max_rotation_squared(s, links, spatial):
    """Return the square of the maximum rotation rate of a link [1/s2]."""
    largest = 0.0
    for j in range(links):
        square = (s[at.V, j + 1] - s[at.V, j]) ** 2 + (s[at.V + 1, j + 1] - s[at.V + 1, j]) ** 2
        if spatial is not None:
            square += (s[at.V + 2, j + 1] - s[at.V + 2, j]) ** 2
        largest = max(largest, square * s[at.INVERSE_LENGTH, j] * s[at.INVERSE_LENGTH, j])
    return largest


@compiled
def _is_balanced(counts):
    """Update the energy balance and the maximum energies; returns whether the imbalance is acceptable."""
    balance = counts[at.KINETIC] - counts[at.FIRST_KINETIC] - counts[at.LOADS] - counts[at.ENDS] + counts[at.LOST]
    if not abs(balance) <= counts[at.BALANCE]:
        counts[at.BALANCE] = abs(balance)
    counts[at.MAX_KINETIC] = max(counts[at.MAX_KINETIC], counts[at.KINETIC])
    counts[at.MAX_LOADS] = max(counts[at.MAX_LOADS], abs(counts[at.LOADS]))
    counts[at.MAX_ENDS] = max(counts[at.MAX_ENDS], abs(counts[at.ENDS]))
    supplied = counts[at.FIRST_KINETIC] + counts[at.MAX_LOADS] + counts[at.MAX_ENDS]
    return counts[at.BALANCE] <= MAX_IMBALANCE * supplied + counts[at.FLOOR]


@compiled
def update_extremes(s, links):
    """Update the extremes of the tensions from the multipliers in CORRECTION."""
    for j in range(links):
        s[at.LOW, j] = min(s[at.LOW, j], s[at.CORRECTION, j])
        s[at.HIGH, j] = max(s[at.HIGH, j], s[at.CORRECTION, j])


@compiled(literal=False)
def copy_vectors(s, links, spatial, source, target):
    """Copy the vectors in the rows `source` to the rows `target`."""
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[target + c, j] = s[source + c, j]


@compiled(literal=False)
def save_state(s, links, save, saved):
    """Save positions and velocities as number `save`."""
    dims = saved.shape[2]
    assign(saved[save, 0], s[at.X : at.X + dims, : links + 1])
    assign(saved[save, 1], s[at.V : at.V + dims, : links + 1])
