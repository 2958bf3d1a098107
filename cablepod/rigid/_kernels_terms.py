"""Compiled terms of a step that RATTLE and the index-1 form share: loads, held ends, energy account, saved states."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.integrate._kernels_assign import assign
from cablepod.rigid._kernels_constraints import dimensions, dot
from cablepod.rigid._kernels_layout import (
    BALANCE,
    CORRECTION,
    ENDS,
    FIRST_KINETIC,
    FLOOR,
    HIGH,
    INVERSE_LENGTH,
    INVERSE_MASS,
    KINETIC,
    LOAD,
    LOADS,
    LOST,
    LOW,
    MASS,
    MAX_ENDS,
    MAX_KINETIC,
    MAX_LOADS,
    MAX_ROTATION_SQUARED,
    NX,
    STEADY,
    E,
    N,
    V,
    X,
)

#: Maximum energy imbalance over the energy supplied by start, loads and ends; a run beyond it is stopped.
MAX_IMBALANCE = 10.0


@compiled
def load_accelerations(s, links, spatial, patterns, factors):
    """Compute the accelerations by constant and time-dependent loads."""
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[LOAD + c, j] = s[STEADY + c, j]
        for load in range(patterns.shape[0]):
            factor = factors[load]
            for j in range(links + 1):
                s[LOAD + c, j] += factor * patterns[load, c, j]


@compiled(literal=False)
def set_ends(s, links, spatial, row, ends):
    """Put values (end, dims) of the held ends into the rows from `row` on."""
    for c in range(dimensions(spatial)):
        if s[INVERSE_MASS, 0] == 0.0:
            s[row + c, 0] = ends[0, c]
        if s[INVERSE_MASS, links] == 0.0:
            s[row + c, links] = ends[1, c]


@compiled(literal=False)
def end_work(s, links, spatial, multiplier, unit, row):
    """Return the forces of the held ends times the vectors in the rows from `row` on: power, or work."""
    total = 0.0
    for c in range(dimensions(spatial)):
        if s[INVERSE_MASS, 0] == 0.0:
            total -= s[multiplier, 0] * s[unit + c, 0] * s[row + c, 0]
        if s[INVERSE_MASS, links] == 0.0:
            total += s[multiplier, links - 1] * s[unit + c, links - 1] * s[row + c, links]
    return total


@compiled(literal=False)
def by_mass(s, links, spatial, first, second):
    """Return the sum of the masses times the inner products of the vectors in the rows from `first` and from `second` on."""
    total = 0.0
    for j in range(links + 1):
        total += s[MASS, j] * dot(s, first, j, second, j, spatial)
    return total


@compiled(literal=False)
def kinetic_energy(s, links, spatial, velocity):
    """Return the kinetic energy [J] of the velocities in the rows `velocity`."""
    return 0.5 * by_mass(s, links, spatial, velocity, velocity)


@compiled
def end_step(s, links, spatial, counts):
    """Go on to the new positions and link vectors; update the maximum rotation; returns whether the energies are in balance."""
    copy_vectors(s, links, spatial, NX, X)
    copy_vectors(s, links, spatial, N, E)
    counts[KINETIC] = kinetic_energy(s, links, spatial, V)
    counts[MAX_ROTATION_SQUARED] = max(counts[MAX_ROTATION_SQUARED], _max_rotation_squared(s, links, spatial))
    return _is_balanced(counts)


@compiled
def _max_rotation_squared(s, links, spatial):
    """Return the square of the maximum rotation rate of a link [1/s2]."""
    largest = 0.0
    for j in range(links):
        square = (s[V, j + 1] - s[V, j]) ** 2 + (s[V + 1, j + 1] - s[V + 1, j]) ** 2
        if spatial is not None:
            square += (s[V + 2, j + 1] - s[V + 2, j]) ** 2
        largest = max(largest, square * s[INVERSE_LENGTH, j] * s[INVERSE_LENGTH, j])
    return largest


@compiled
def _is_balanced(counts):
    """Update the energy balance and the maximum energies; returns whether the imbalance is acceptable."""
    balance = counts[KINETIC] - counts[FIRST_KINETIC] - counts[LOADS] - counts[ENDS] + counts[LOST]
    if not abs(balance) <= counts[BALANCE]:
        counts[BALANCE] = abs(balance)
    counts[MAX_KINETIC] = max(counts[MAX_KINETIC], counts[KINETIC])
    counts[MAX_LOADS] = max(counts[MAX_LOADS], abs(counts[LOADS]))
    counts[MAX_ENDS] = max(counts[MAX_ENDS], abs(counts[ENDS]))
    supplied = counts[FIRST_KINETIC] + counts[MAX_LOADS] + counts[MAX_ENDS]
    return counts[BALANCE] <= MAX_IMBALANCE * supplied + counts[FLOOR]


@compiled
def update_extremes(s, links):
    """Update the extremes of the tensions from the multipliers in CORRECTION."""
    for j in range(links):
        s[LOW, j] = min(s[LOW, j], s[CORRECTION, j])
        s[HIGH, j] = max(s[HIGH, j], s[CORRECTION, j])


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
    assign(saved[save, 0], s[X : X + dims, : links + 1])
    assign(saved[save, 1], s[V : V + dims, : links + 1])
