"""Compiled RATTLE and index-1 steps of the chain of rigid links."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.rigid._kernels_constraints import (
    _accelerations,
    _dims,
    _directions,
    _dot,
    _length_error,
    _onto_manifold,
    _onto_velocities,
)
from cablepod.rigid._kernels_layout import (
    ACCELERATION,
    BALANCE,
    BASE,
    BROKEN,
    CORRECTION,
    DONE,
    DRIVE,
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
    LOADS,
    LOST,
    LOW,
    MASS,
    MOST_ENDS,
    MOST_KINETIC,
    MOST_LOADS,
    NOT_CONVERGED,
    NX,
    ROWS,
    SINGULAR,
    STEADY,
    SUM_V,
    SUM_X,
    T_BEFORE,
    TURN,
    E,
    N,
    T,
    V,
    X,
)

#: A run whose energies are out of balance by more than so many times what the start, loads and ends have given has broken down.
MOST_IMBALANCE = 10.0


def new_state(links):
    """Make a state of zeros (ROWS, at least links + 2), an odd number of cache lines to a row."""
    return np.zeros((ROWS, 8 * ((links + 9) // 8 | 1)))


@compiled
def _drive(s, links, spatial, patterns, factors):
    """Make the accelerations by the loads: the constant ones and those that vary in time."""
    for c in range(_dims(spatial)):
        for j in range(links + 1):
            s[DRIVE + c, j] = s[STEADY + c, j]
        for load in range(patterns.shape[0]):
            factor = factors[load]
            for j in range(links + 1):
                s[DRIVE + c, j] += factor * patterns[load, c, j]


@compiled
def _set_ends(s, links, spatial, row, ends):
    """Put values (end, dims) of the held ends into the rows from `row` on."""
    for c in range(_dims(spatial)):
        if s[INVERSE_MASS, 0] == 0.0:
            s[row + c, 0] = ends[0, c]
        if s[INVERSE_MASS, links] == 0.0:
            s[row + c, links] = ends[1, c]


@compiled
def _pulled(s, links, spatial, multiplier, unit, row):
    """Force of the held ends on the chain times their vectors in the rows from `row` on: power, or work."""
    total = 0.0
    for c in range(_dims(spatial)):
        if s[INVERSE_MASS, 0] == 0.0:
            total -= s[multiplier, 0] * s[unit + c, 0] * s[row + c, 0]
        if s[INVERSE_MASS, links] == 0.0:
            total += s[multiplier, links - 1] * s[unit + c, links - 1] * s[row + c, links]
    return total


@compiled
def _kinetic(s, links, spatial, velocity):
    """Kinetic energy [J] of the velocities in the rows `velocity`."""
    total = 0.0
    for j in range(links + 1):
        total += s[MASS, j] * _dot(s, velocity, j, velocity, j, spatial)
    return 0.5 * total


@compiled
def _turn(s, links, spatial):
    """Square of the largest rate at which a link turns [1/s2]."""
    largest = 0.0
    for j in range(links):
        square = (s[V, j + 1] - s[V, j]) ** 2 + (s[V + 1, j + 1] - s[V + 1, j]) ** 2
        if spatial is not None:
            square += (s[V + 2, j + 1] - s[V + 2, j]) ** 2
        largest = max(largest, square * s[INVERSE_LENGTH, j] * s[INVERSE_LENGTH, j])
    return largest


@compiled
def _weigh(counts):
    """Update the balance of the energies and their largest sizes; returns whether the run is sound."""
    balance = counts[KINETIC] - counts[FIRST_KINETIC] - counts[LOADS] - counts[ENDS] + counts[LOST]
    if not abs(balance) <= counts[BALANCE]:
        counts[BALANCE] = abs(balance)
    counts[MOST_KINETIC] = max(counts[MOST_KINETIC], counts[KINETIC])
    counts[MOST_LOADS] = max(counts[MOST_LOADS], abs(counts[LOADS]))
    counts[MOST_ENDS] = max(counts[MOST_ENDS], abs(counts[ENDS]))
    given = counts[FIRST_KINETIC] + counts[MOST_LOADS] + counts[MOST_ENDS]
    return counts[BALANCE] <= MOST_IMBALANCE * given + counts[FLOOR]


@compiled
def _extremes(s, links):
    for j in range(links):
        s[LOW, j] = min(s[LOW, j], s[CORRECTION, j])
        s[HIGH, j] = max(s[HIGH, j], s[CORRECTION, j])


@compiled
def _copy(s, links, spatial, source, target):
    for c in range(_dims(spatial)):
        for j in range(links + 1):
            s[target + c, j] = s[source + c, j]


@compiled
def _keep(s, links, save, saved):
    dims = saved.shape[2]
    saved[save, 0] = s[X : X + dims, : links + 1]
    saved[save, 1] = s[V : V + dims, : links + 1]


@compiled
def rattle(
    s, links, spatial, ends, patterns, factors, step, half, decay, damping, tolerance, extremes,
    steps, number, save_steps, saved, counts,
):  # fmt: skip
    """Advance a chain by `steps` steps of RATTLE (Andersen 1983), symplectic and symmetric in time.

    Half a kick by the loads and by multipliers such that the links have their lengths after the drift, the drift, and the other
    half with multipliers such that no link is stretched by the velocities.  With damping the kicks are exact: `half` is
    (1 - decay) / damping instead of half a step.

    Parameters
    ----------
    s : float array (ROWS, columns)
        The state, see the constants of this module; advanced in place.
    links : int
        Number of links n.
    spatial : True or None
        Whether there is a third coordinate.
    extremes : bool
        Whether extremes of the tensions are kept.
    ends : float array (steps + 1, 3, end, dims)
        Positions, velocities and accelerations of the ends; a table without rows where they stand still.
    patterns, factors : float arrays (loads, dims, n + 1), (steps + 1, loads)
        Loads that vary in time, as accelerations [m/s2], and their factors at the steps; none is a table without rows.
    step, half, decay, damping : float
        [s], [s], exp(-damping step / 2), [1/s].
    tolerance : float
        Relative length error that ends Newton's method.
    steps, number : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, number <= value < number + steps.
    saved : float array (saves, 2, dims, n + 1)
        Filled with positions and velocities.
    counts : float array (COUNTS,)
        Energies and iterations, updated.

    Returns
    -------
    tuple
        Number of steps done, and how the last went.
    """
    save = 0
    dims = _dims(spatial)
    moving = ends.shape[0] > 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == number + i:
            _keep(s, links, save, saved)
            save += 1
        if extremes:
            if moving:
                _set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
            if not _accelerations(s, links, spatial, V, E, damping, -1.0):
                return i, SINGULAR
            _extremes(s, links)
        for c in range(dims):
            for j in range(links + 1):
                s[HALF + c, j] = decay * s[V + c, j] + half * s[DRIVE + c, j]
                s[BASE + c, j] = s[X + c, j] + step * s[HALF + c, j]
        if moving:  # ends that stand still have no velocity
            _set_ends(s, links, spatial, BASE, ends[i + 1, 0])
        for j in range(links):
            before = s[T_BEFORE, j]
            s[T_BEFORE, j] = s[T, j]
            s[T, j] = 2.0 * s[T, j] - before
        status = _onto_manifold(s, links, spatial, step * half, tolerance, counts)
        if status != DONE:
            for j in range(links):
                s[T, j] = s[T_BEFORE, j]
            return i, status
        work = 0.0
        for c in range(dims):
            for j in range(links + 1):
                force = s[FORCE + c, j + 1] - s[FORCE + c, j]
                s[HALF + c, j] += half * s[INVERSE_MASS, j] * force
                s[SUM_X + c, j] = s[NX + c, j] - s[X + c, j]  # how far it moved
        for j in range(links + 1):
            work += s[MASS, j] * _dot(s, DRIVE, j, SUM_X, j, spatial)
        if moving:
            counts[ENDS] += 0.5 * _pulled(s, links, spatial, T, E, SUM_X)
        if patterns.shape[0] > 0:
            _drive(s, links, spatial, patterns, factors[i + 1])
            other = 0.0
            for j in range(links + 1):
                other += s[MASS, j] * _dot(s, DRIVE, j, SUM_X, j, spatial)
            work = 0.5 * (work + other)
        for c in range(dims):
            for j in range(links + 1):
                s[V + c, j] = decay * s[HALF + c, j] + half * s[DRIVE + c, j]
        if moving:
            _set_ends(s, links, spatial, V, ends[i + 1, 1])
        if not _onto_velocities(s, links, spatial, V, N):
            return i, SINGULAR
        if moving:
            counts[ENDS] += 0.5 * _pulled(s, links, spatial, CORRECTION, N, SUM_X) / half
        _copy(s, links, spatial, NX, X)
        _copy(s, links, spatial, N, E)
        kinetic = _kinetic(s, links, spatial, V)
        counts[LOADS] += work
        counts[LOST] += step * damping * (counts[KINETIC] + kinetic)
        counts[KINETIC] = kinetic
        counts[TURN] = max(counts[TURN], _turn(s, links, spatial))
        if not _weigh(counts):
            return i + 1, BROKEN
    return steps, DONE


@compiled
def _stage(s, links, spatial, velocity, unit, ends, patterns, factors, i, damping, stabilise, weight, powers):
    """Accelerations at stage `i` of the tables, with what its powers [W] add to the sums."""
    moving = ends.shape[0] > 0
    if moving:
        _set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
    if patterns.shape[0] > 0:
        _drive(s, links, spatial, patterns, factors[i])
    if not _accelerations(s, links, spatial, velocity, unit, damping, stabilise):
        return False
    total = 0.0
    for j in range(links + 1):
        total += s[MASS, j] * _dot(s, DRIVE, j, velocity, j, spatial)
    powers[0] += weight * total
    if moving:
        powers[1] += weight * _pulled(s, links, spatial, CORRECTION, unit, velocity)
    if damping > 0.0:
        powers[2] += weight * 2.0 * damping * _kinetic(s, links, spatial, velocity)
    return True


@compiled
def index1(
    s, links, spatial, ends, patterns, factors, step, damping, stabilise, tolerance, extremes,
    steps, number, save_steps, saved, counts,
):  # fmt: skip
    """Advance a chain by `steps` steps of the index-1 form, by the classical Runge-Kutta scheme of fourth order.

    The multipliers follow from the constraint differentiated twice.  After each step positions and velocities are projected on
    the manifold, orthogonally by mass; with a rate `stabilise` [1/s] of at least 0 Baumgarte's terms take the place of the
    projection.

    Parameters are those of :func:`rattle` but that the tables `ends` (2 steps + 1, 3, end, dims) and `factors` (2 steps + 1,
    loads) have the middles of the steps too.
    """
    save = 0
    dims = _dims(spatial)
    moving = ends.shape[0] > 0
    powers = np.zeros(3)
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == number + i:
            _keep(s, links, save, saved)
            save += 1
        powers[:] = 0.0
        for c in range(dims):
            for j in range(links + 1):
                s[NX + c, j] = s[X + c, j]
                s[HALF + c, j] = s[V + c, j]
                s[SUM_X + c, j] = 0.0
                s[SUM_V + c, j] = 0.0
        for stage in range(4):
            at = 2 * i + (stage + 1) // 2
            weight = 2.0 if stage == 1 or stage == 2 else 1.0
            if moving:
                _set_ends(s, links, spatial, NX, ends[at, 0])
                _set_ends(s, links, spatial, HALF, ends[at, 1])
            _directions(s, links, spatial, NX, N)
            if not _stage(s, links, spatial, HALF, N, ends, patterns, factors, at, damping, stabilise, weight, powers):
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
            _directions(s, links, spatial, BASE, N)
            for j in range(links):
                if not _dot(s, N, j, E, j, spatial) > 0.0:
                    return i, NOT_CONVERGED
                s[T, j] = 0.0
            _copy(s, links, spatial, N, E)
            status = _onto_manifold(s, links, spatial, 1.0, tolerance, counts)
            if status != DONE:
                _directions(s, links, spatial, X, E)
                return i, status
            if not _onto_velocities(s, links, spatial, HALF, N):
                _directions(s, links, spatial, X, E)
                return i, SINGULAR
            _copy(s, links, spatial, NX, X)
            _copy(s, links, spatial, N, E)
        else:
            _copy(s, links, spatial, BASE, X)
            _directions(s, links, spatial, X, E)
            worst = _length_error(s, links, spatial, E)
            if not worst < 1e3:
                return i, NOT_CONVERGED
            counts[LENGTH_ERROR] = max(counts[LENGTH_ERROR], worst)
        _copy(s, links, spatial, HALF, V)
        counts[LOADS] += step / 6.0 * powers[0]
        counts[ENDS] += step / 6.0 * powers[1]
        counts[LOST] += step / 6.0 * powers[2]
        counts[KINETIC] = _kinetic(s, links, spatial, V)
        counts[TURN] = max(counts[TURN], _turn(s, links, spatial))
        if not _weigh(counts):
            return i + 1, BROKEN
    return steps, DONE


@compiled
def states(s, links, spatial, ends, patterns, factors, damping, onto, tolerance, x, v, a, tension, counts):
    """Accelerations and tensions at given states, and the states themselves put on the manifold.

    Parameters
    ----------
    s, links, spatial, patterns, damping, tolerance, counts
        As in :func:`rattle`; the last of the states is left in `s`, ready to be advanced but for T.
    ends : float array (times, 3, end, dims)
        Positions, velocities and accelerations of the ends.
    factors : float array (times, loads)
        Factors of the loads.
    onto : bool array (times,)
        Whether to project positions and velocities.
    x, v : float arrays (times, dims, n + 1)
        Positions and velocities; overwritten where projected.
    a, tension : float arrays (times, dims, n + 1), (times, n)
        Filled.

    Returns
    -------
    tuple
        Number of instants before the first at which it failed, and how that one went.
    """
    dims = _dims(spatial)
    for i in range(x.shape[0]):
        s[X : X + dims, : links + 1] = x[i]
        s[V : V + dims, : links + 1] = v[i]
        _set_ends(s, links, spatial, X, ends[i, 0])
        _set_ends(s, links, spatial, V, ends[i, 1])
        _directions(s, links, spatial, X, E)
        if onto[i]:
            _copy(s, links, spatial, X, BASE)
            for j in range(links):
                s[T, j] = 0.0
            status = _onto_manifold(s, links, spatial, 1.0, tolerance, counts)
            if status != DONE:
                return i, status
            _copy(s, links, spatial, NX, X)
            _copy(s, links, spatial, N, E)
            if not _onto_velocities(s, links, spatial, V, E):
                return i, SINGULAR
            x[i] = s[X : X + dims, : links + 1]
            v[i] = s[V : V + dims, : links + 1]
        if patterns.shape[0] > 0:
            _drive(s, links, spatial, patterns, factors[i])
        _set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
        if not _accelerations(s, links, spatial, V, E, damping, -1.0):
            return i, SINGULAR
        a[i] = s[ACCELERATION : ACCELERATION + dims, : links + 1]
        tension[i] = s[CORRECTION, :links]
    return x.shape[0], DONE
