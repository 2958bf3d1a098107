"""Compiled RATTLE and index-1 steps of the chain of rigid links."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.rigid._kernels_constraints import (
    dimensions,
    dot,
    index1_accelerations,
    length_error,
    link_vectors,
    project_positions,
    project_velocities,
)
from cablepod.rigid._kernels_layout import (
    ACCELERATION,
    BALANCE,
    BASE,
    CORRECTION,
    DONE,
    ENDS,
    FIRST_KINETIC,
    FLOOR,
    FORCE,
    HALF,
    HIGH,
    INVERSE_LENGTH,
    INVERSE_MASS,
    KINETIC,
    LENGTH_ERROR,
    LOAD,
    LOADS,
    LOST,
    LOW,
    MASS,
    MAX_ENDS,
    MAX_KINETIC,
    MAX_LOADS,
    MAX_ROTATION_SQUARED,
    NOT_CONVERGED,
    NX,
    OUT_OF_BALANCE,
    ROWS,
    SINGULAR,
    STEADY,
    SUM_V,
    SUM_X,
    T_BEFORE,
    E,
    N,
    T,
    V,
    X,
)

#: Maximum energy imbalance over the energy supplied by start, loads and ends; a run beyond it is stopped.
MAX_IMBALANCE = 10.0


def new_state(links):
    """Allocate a state of zeros (ROWS, at least links + 2), with an odd number of cache lines per row."""
    return np.zeros((ROWS, 8 * ((links + 9) // 8 | 1)))


@compiled
def _load_accelerations(s, links, spatial, patterns, factors):
    """Compute the accelerations by constant and time-dependent loads."""
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[LOAD + c, j] = s[STEADY + c, j]
        for load in range(patterns.shape[0]):
            factor = factors[load]
            for j in range(links + 1):
                s[LOAD + c, j] += factor * patterns[load, c, j]


@compiled
def _set_ends(s, links, spatial, row, ends):
    """Put values (end, dims) of the held ends into the rows from `row` on."""
    for c in range(dimensions(spatial)):
        if s[INVERSE_MASS, 0] == 0.0:
            s[row + c, 0] = ends[0, c]
        if s[INVERSE_MASS, links] == 0.0:
            s[row + c, links] = ends[1, c]


@compiled
def _end_work(s, links, spatial, multiplier, unit, row):
    """Return the forces of the held ends times the vectors in the rows from `row` on: power, or work."""
    total = 0.0
    for c in range(dimensions(spatial)):
        if s[INVERSE_MASS, 0] == 0.0:
            total -= s[multiplier, 0] * s[unit + c, 0] * s[row + c, 0]
        if s[INVERSE_MASS, links] == 0.0:
            total += s[multiplier, links - 1] * s[unit + c, links - 1] * s[row + c, links]
    return total


@compiled
def _kinetic(s, links, spatial, velocity):
    """Return the kinetic energy [J] of the velocities in the rows `velocity`."""
    total = 0.0
    for j in range(links + 1):
        total += s[MASS, j] * dot(s, velocity, j, velocity, j, spatial)
    return 0.5 * total


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
def _check_balance(counts):
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
def _extremes(s, links):
    """Update the extremes of the tensions from the multipliers in CORRECTION."""
    for j in range(links):
        s[LOW, j] = min(s[LOW, j], s[CORRECTION, j])
        s[HIGH, j] = max(s[HIGH, j], s[CORRECTION, j])


@compiled
def _copy(s, links, spatial, source, target):
    """Copy the vectors in the rows `source` to the rows `target`."""
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[target + c, j] = s[source + c, j]


@compiled
def _save(s, links, save, saved):
    """Save positions and velocities as number `save`."""
    dims = saved.shape[2]
    saved[save, 0] = s[X : X + dims, : links + 1]
    saved[save, 1] = s[V : V + dims, : links + 1]


@compiled
def rattle(
    s, links, spatial, ends, patterns, factors, step, half, damping_factor, damping, tolerance, extremes,
    steps, number, save_steps, saved, counts,
):  # fmt: skip
    """Advance a chain by `steps` steps of RATTLE (Andersen 1983), symplectic and symmetric in time.

    A step has three parts.  The first half of the impulse of loads and multipliers is such that the links have their lengths
    after the drift; then the positions drift; the second half of the impulse is such that the velocities stretch no link.
    Damping is integrated exactly: `half` is (1 - damping_factor) / damping instead of half a step.

    Parameters
    ----------
    s : float array (ROWS, columns)
        State, see :mod:`cablepod.rigid._kernels_layout`; advanced in place.
    links : int
        Number of links n.
    spatial : True or None
        Whether there is a third coordinate.
    extremes : bool
        Whether extremes of the tensions are kept.
    ends : float array (steps + 1, 3, end, dims)
        Positions, velocities and accelerations of the ends; a table without rows if they are at rest.
    patterns, factors : float arrays (loads, dims, n + 1), (steps + 1, loads)
        Accelerations by time-dependent loads at factor 1 [m/s2], and the factors at the steps; without rows if there are none.
    step, half, damping_factor, damping : float
        [s], [s], exp(-damping step / 2), [1/s].
    tolerance : float
        Newton tolerance: relative length error.
    steps, number : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, number <= value < number + steps.
    saved : float array (saves, 2, dims, n + 1)
        Filled with positions and velocities.
    counts : float array (COUNTS,)
        Energy account and iterations, updated.

    Returns
    -------
    tuple
        Number of steps done, and the status of the last one.
    """
    save = 0
    dims = dimensions(spatial)
    moving = ends.shape[0] > 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == number + i:
            _save(s, links, save, saved)
            save += 1
        if extremes:
            if moving:
                _set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
            if not index1_accelerations(s, links, spatial, V, E, damping, -1.0):
                return i, SINGULAR
            _extremes(s, links)
        for c in range(dims):
            for j in range(links + 1):
                s[HALF + c, j] = damping_factor * s[V + c, j] + half * s[LOAD + c, j]
                s[BASE + c, j] = s[X + c, j] + step * s[HALF + c, j]
        if moving:  # ends at rest keep their place
            _set_ends(s, links, spatial, BASE, ends[i + 1, 0])
        for j in range(links):
            before = s[T_BEFORE, j]
            s[T_BEFORE, j] = s[T, j]
            s[T, j] = 2.0 * s[T, j] - before
        status = project_positions(s, links, spatial, step * half, tolerance, counts)
        if status != DONE:
            for j in range(links):
                s[T, j] = s[T_BEFORE, j]
            return i, status
        work = 0.0
        for c in range(dims):
            for j in range(links + 1):
                force = s[FORCE + c, j + 1] - s[FORCE + c, j]
                s[HALF + c, j] += half * s[INVERSE_MASS, j] * force
                s[SUM_X + c, j] = s[NX + c, j] - s[X + c, j]  # displacement
        for j in range(links + 1):
            work += s[MASS, j] * dot(s, LOAD, j, SUM_X, j, spatial)
        if moving:
            counts[ENDS] += 0.5 * _end_work(s, links, spatial, T, E, SUM_X)
        if patterns.shape[0] > 0:
            _load_accelerations(s, links, spatial, patterns, factors[i + 1])
            work_after = 0.0
            for j in range(links + 1):
                work_after += s[MASS, j] * dot(s, LOAD, j, SUM_X, j, spatial)
            work = 0.5 * (work + work_after)
        for c in range(dims):
            for j in range(links + 1):
                s[V + c, j] = damping_factor * s[HALF + c, j] + half * s[LOAD + c, j]
        if moving:
            _set_ends(s, links, spatial, V, ends[i + 1, 1])
        if not project_velocities(s, links, spatial, V, N):
            return i, SINGULAR
        if moving:
            counts[ENDS] += 0.5 * _end_work(s, links, spatial, CORRECTION, N, SUM_X) / half
        _copy(s, links, spatial, NX, X)
        _copy(s, links, spatial, N, E)
        kinetic = _kinetic(s, links, spatial, V)
        counts[LOADS] += work
        counts[LOST] += step * damping * (counts[KINETIC] + kinetic)
        counts[KINETIC] = kinetic
        counts[MAX_ROTATION_SQUARED] = max(counts[MAX_ROTATION_SQUARED], _max_rotation_squared(s, links, spatial))
        if not _check_balance(counts):
            return i + 1, OUT_OF_BALANCE
    return steps, DONE


@compiled
def _stage(s, links, spatial, velocity, unit, ends, patterns, factors, i, damping, stabilise, weight, powers):
    """Compute accelerations at place `i` of the tables, and add the weighted powers [W] of loads, ends and damping."""
    moving = ends.shape[0] > 0
    if moving:
        _set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
    if patterns.shape[0] > 0:
        _load_accelerations(s, links, spatial, patterns, factors[i])
    if not index1_accelerations(s, links, spatial, velocity, unit, damping, stabilise):
        return False
    total = 0.0
    for j in range(links + 1):
        total += s[MASS, j] * dot(s, LOAD, j, velocity, j, spatial)
    powers[0] += weight * total
    if moving:
        powers[1] += weight * _end_work(s, links, spatial, CORRECTION, unit, velocity)
    if damping > 0.0:
        powers[2] += weight * 2.0 * damping * _kinetic(s, links, spatial, velocity)
    return True


@compiled
def index1(
    s, links, spatial, ends, patterns, factors, step, damping, stabilise, tolerance, extremes,
    steps, number, save_steps, saved, counts,
):  # fmt: skip
    """Advance a chain by `steps` classical Runge-Kutta steps (fourth order) of the index-1 form.

    The multipliers follow from the constraint differentiated twice.  After each step positions and velocities are projected onto
    the constraints, orthogonally by mass; a rate `stabilise` [1/s] of at least 0 replaces the projection by Baumgarte's terms.

    Parameters are those of :func:`rattle`; the tables `ends` (2 steps + 1, 3, end, dims) and `factors` (2 steps + 1, loads) also
    have the middles of the steps.
    """
    save = 0
    dims = dimensions(spatial)
    moving = ends.shape[0] > 0
    powers = np.zeros(3)
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == number + i:
            _save(s, links, save, saved)
            save += 1
        powers[:] = 0.0
        for c in range(dims):
            for j in range(links + 1):
                s[NX + c, j] = s[X + c, j]
                s[HALF + c, j] = s[V + c, j]
                s[SUM_X + c, j] = 0.0
                s[SUM_V + c, j] = 0.0
        for stage in range(4):
            place = 2 * i + (stage + 1) // 2
            weight = 2.0 if stage == 1 or stage == 2 else 1.0
            if moving:
                _set_ends(s, links, spatial, NX, ends[place, 0])
                _set_ends(s, links, spatial, HALF, ends[place, 1])
            link_vectors(s, links, spatial, NX, N)
            if not _stage(
                s, links, spatial, HALF, N, ends, patterns, factors, place, damping, stabilise, weight, powers
            ):
                return i, SINGULAR
            if stage == 0 and extremes:
                _extremes(s, links)
            reach = step if stage == 2 else 0.5 * step
            for c in range(dims):
                for j in range(links + 1):
                    s[SUM_X + c, j] += weight * s[HALF + c, j]
                    s[SUM_V + c, j] += weight * s[ACCELERATION + c, j]
                    if stage < 3:
                        s[NX + c, j] = s[X + c, j] + reach * s[HALF + c, j]
                        s[HALF + c, j] = s[V + c, j] + reach * s[ACCELERATION + c, j]
        for c in range(dims):
            for j in range(links + 1):
                s[BASE + c, j] = s[X + c, j] + step / 6.0 * s[SUM_X + c, j]
                s[HALF + c, j] = s[V + c, j] + step / 6.0 * s[SUM_V + c, j]
        if moving:
            _set_ends(s, links, spatial, BASE, ends[2 * (i + 1), 0])
            _set_ends(s, links, spatial, HALF, ends[2 * (i + 1), 1])
        if stabilise < 0.0:
            link_vectors(s, links, spatial, BASE, N)
            for j in range(links):
                if not dot(s, N, j, E, j, spatial) > 0.0:
                    return i, NOT_CONVERGED
                s[T, j] = 0.0
            _copy(s, links, spatial, N, E)
            status = project_positions(s, links, spatial, 1.0, tolerance, counts)
            if status != DONE:
                link_vectors(s, links, spatial, X, E)
                return i, status
            if not project_velocities(s, links, spatial, HALF, N):
                link_vectors(s, links, spatial, X, E)
                return i, SINGULAR
            _copy(s, links, spatial, NX, X)
            _copy(s, links, spatial, N, E)
        else:
            _copy(s, links, spatial, BASE, X)
            link_vectors(s, links, spatial, X, E)
            worst = length_error(s, links, spatial, E)
            if not worst < 1e3:
                return i, NOT_CONVERGED
            counts[LENGTH_ERROR] = max(counts[LENGTH_ERROR], worst)
        _copy(s, links, spatial, HALF, V)
        counts[LOADS] += step / 6.0 * powers[0]
        counts[ENDS] += step / 6.0 * powers[1]
        counts[LOST] += step / 6.0 * powers[2]
        counts[KINETIC] = _kinetic(s, links, spatial, V)
        counts[MAX_ROTATION_SQUARED] = max(counts[MAX_ROTATION_SQUARED], _max_rotation_squared(s, links, spatial))
        if not _check_balance(counts):
            return i + 1, OUT_OF_BALANCE
    return steps, DONE


@compiled
def states(s, links, spatial, ends, patterns, factors, damping, is_projected, tolerance, x, v, a, tension, counts):
    """Compute accelerations and tensions at given states, and project the states onto the constraints.

    Parameters
    ----------
    s, links, spatial, patterns, damping, tolerance, counts
        As in :func:`rattle`; `s` holds the last state on return, without T.
    ends : float array (times, 3, end, dims)
        Positions, velocities and accelerations of the ends.
    factors : float array (times, loads)
        Factors of the loads.
    is_projected : bool array (times,)
        Whether to project the positions and velocities of a state.
    x, v : float arrays (times, dims, n + 1)
        Positions and velocities; overwritten by projected ones.
    a, tension : float arrays (times, dims, n + 1), (times, n)
        Filled.

    Returns
    -------
    tuple
        Number of states before the first failure, and the status of that one.
    """
    dims = dimensions(spatial)
    for i in range(x.shape[0]):
        s[X : X + dims, : links + 1] = x[i]
        s[V : V + dims, : links + 1] = v[i]
        _set_ends(s, links, spatial, X, ends[i, 0])
        _set_ends(s, links, spatial, V, ends[i, 1])
        link_vectors(s, links, spatial, X, E)
        if is_projected[i]:
            _copy(s, links, spatial, X, BASE)
            for j in range(links):
                s[T, j] = 0.0
            status = project_positions(s, links, spatial, 1.0, tolerance, counts)
            if status != DONE:
                return i, status
            _copy(s, links, spatial, NX, X)
            _copy(s, links, spatial, N, E)
            if not project_velocities(s, links, spatial, V, E):
                return i, SINGULAR
            x[i] = s[X : X + dims, : links + 1]
            v[i] = s[V : V + dims, : links + 1]
        if patterns.shape[0] > 0:
            _load_accelerations(s, links, spatial, patterns, factors[i])
        _set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
        if not index1_accelerations(s, links, spatial, V, E, damping, -1.0):
            return i, SINGULAR
        a[i] = s[ACCELERATION : ACCELERATION + dims, : links + 1]
        tension[i] = s[CORRECTION, :links]
    return x.shape[0], DONE
