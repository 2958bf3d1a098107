"""Compiled steps of the rigid links, by RATTLE and by the index-1 form, in which the constraint differentiated twice gives T.

RATTLE, without damping, with the multipliers T and U of positions and velocities:
x_new = x + h v_half,  v_half = v + h / 2m (P + G^T T),  |x_(j+1) - x_j| = l,
v_new = v_half + h / 2m (P_new + G_new^T U),  e.(v_(j+1) - v_j) = 0.

Index-1 form: m a = P + G^T T - alpha m v,  e.(a_(j+1) - a_j) + |v_(j+1) - v_j|^2 / l = 0.  :func:`index1` takes Runge-Kutta
steps; :func:`states` evaluates the form at the output times of either formulation.
"""

import numpy as np

from cablepod._jit import compiled
from cablepod.integrate._kernels_assign import assign
from cablepod.rigid import _kernels_layout as at
from cablepod.rigid._kernels_terms import (
    by_mass,
    copy_vectors,
    dimensions,
    dot,
    end_step,
    end_work,
    kinetic_energy,
    link_forces,
    link_vectors,
    load_accelerations,
    project_positions,
    project_velocities,
    save_state,
    set_ends,
    solve_tridiagonal,
    update_extremes,
)


@compiled(literal=False)
def index1_accelerations(s, links, spatial, velocity, unit, damping):
    """Compute accelerations by the index-1 form from the velocities `velocity` and link vectors `unit` (rows).

    ACCELERATION of held ends must be set before.  The constraint differentiated twice, e.(a_(j+1) - a_j) + |v_(j+1) - v_j|^2 / l
    = 0, gives the multipliers in CORRECTION.  Returns False if the system is singular.
    """
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            if s[at.INVERSE_MASS, j] > 0.0:
                s[at.ACCELERATION + c, j] = s[at.LOAD + c, j] - damping * s[velocity + c, j]
    for j in range(links):
        square, along = 0.0, 0.0
        for c in range(dimensions(spatial)):
            dv = s[velocity + c, j + 1] - s[velocity + c, j]
            square += dv * dv
            along += s[unit + c, j] * (s[at.ACCELERATION + c, j + 1] - s[at.ACCELERATION + c, j])
        s[at.RIGHT, j] = square * s[at.INVERSE_LENGTH, j] + along
    if not solve_tridiagonal(s, links, spatial, unit, unit):
        return False
    link_forces(s, links, spatial, at.CORRECTION, unit)
    for c in range(dimensions(spatial)):
        for j in range(links + 1):
            s[at.ACCELERATION + c, j] += s[at.INVERSE_MASS, j] * (s[at.FORCE + c, j + 1] - s[at.FORCE + c, j])
    return True


@compiled(literal=False)
def _stage(s, links, spatial, velocity, unit, ends, patterns, factors, i, damping, weight, powers):
    """Compute accelerations at place `i` of the tables, and add the weighted powers [W] of loads, ends and damping."""
    moving = ends.shape[0] > 0
    if moving:
        set_ends(s, links, spatial, at.ACCELERATION, ends[i, 2])
    if patterns.shape[0] > 0:
        load_accelerations(s, links, spatial, patterns, factors[i])
    if not index1_accelerations(s, links, spatial, velocity, unit, damping):
        return False
    powers[0] += weight * by_mass(s, links, spatial, at.LOAD, velocity)
    if moving:
        powers[1] += weight * end_work(s, links, spatial, at.CORRECTION, unit, velocity)
    if damping > 0.0:
        powers[2] += weight * 2.0 * damping * kinetic_energy(s, links, spatial, velocity)
    return True


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
            save_state(s, links, save, saved)
            save += 1
        if extremes:
            if moving:
                set_ends(s, links, spatial, at.ACCELERATION, ends[i, 2])
            if not index1_accelerations(s, links, spatial, at.V, at.E, damping):
                return i, at.SINGULAR
            update_extremes(s, links)
        for c in range(dims):
            for j in range(links + 1):
                s[at.HALF + c, j] = damping_factor * s[at.V + c, j] + half * s[at.LOAD + c, j]
                s[at.BASE + c, j] = s[at.X + c, j] + step * s[at.HALF + c, j]
        if moving:  # ends at rest keep their place
            set_ends(s, links, spatial, at.BASE, ends[i + 1, 0])
        for j in range(links):
            before = s[at.T_BEFORE, j]
            s[at.T_BEFORE, j] = s[at.T, j]
            s[at.T, j] = 2.0 * s[at.T, j] - before
        status = project_positions(s, links, spatial, step * half, tolerance, counts)
        if status != at.DONE:
            for j in range(links):
                s[at.T, j] = s[at.T_BEFORE, j]
            return i, status
        for c in range(dims):
            for j in range(links + 1):
                force = s[at.FORCE + c, j + 1] - s[at.FORCE + c, j]
                s[at.HALF + c, j] += half * s[at.INVERSE_MASS, j] * force
                s[at.SUM_X + c, j] = s[at.NX + c, j] - s[at.X + c, j]  # displacement
        work = by_mass(s, links, spatial, at.LOAD, at.SUM_X)
        if moving:
            counts[at.ENDS] += 0.5 * end_work(s, links, spatial, at.T, at.E, at.SUM_X)
        if patterns.shape[0] > 0:
            load_accelerations(s, links, spatial, patterns, factors[i + 1])
            work = 0.5 * (work + by_mass(s, links, spatial, at.LOAD, at.SUM_X))
        for c in range(dims):
            for j in range(links + 1):
                s[at.V + c, j] = damping_factor * s[at.HALF + c, j] + half * s[at.LOAD + c, j]
        if moving:
            set_ends(s, links, spatial, at.V, ends[i + 1, 1])
        if not project_velocities(s, links, spatial, at.V, at.N):
            return i, at.SINGULAR
        if moving:
            counts[at.ENDS] += 0.5 * end_work(s, links, spatial, at.CORRECTION, at.N, at.SUM_X) / half
        counts[at.LOADS] += work
        if damping > 0.0:
            counts[at.LOST] += step * damping * (counts[at.KINETIC] + kinetic_energy(s, links, spatial, at.V))
        if not end_step(s, links, spatial, counts):
            return i + 1, at.OUT_OF_BALANCE
    return steps, at.DONE


@compiled
def index1(
    s, links, spatial, ends, patterns, factors, step, damping, tolerance, extremes,
    steps, number, save_steps, saved, counts,
):  # fmt: skip
    """Advance a chain by `steps` classical Runge-Kutta steps (fourth order) of the index-1 form.

    The multipliers follow from the constraint differentiated twice.  After each step positions and velocities are projected onto
    the constraints, orthogonally by mass.

    Parameters are those of :func:`rattle`; the tables `ends` (2 steps + 1, 3, end, dims) and `factors` (2 steps + 1, loads) also
    have the middles of the steps.
    """
    save = 0
    dims = dimensions(spatial)
    moving = ends.shape[0] > 0
    powers = np.zeros(3)
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == number + i:
            save_state(s, links, save, saved)
            save += 1
        powers[:] = 0.0
        for c in range(dims):
            for j in range(links + 1):
                s[at.NX + c, j] = s[at.X + c, j]
                s[at.HALF + c, j] = s[at.V + c, j]
                s[at.SUM_X + c, j] = 0.0
                s[at.SUM_V + c, j] = 0.0
        for stage in range(4):
            place = 2 * i + (stage + 1) // 2
            weight = 2.0 if stage == 1 or stage == 2 else 1.0
            if moving:
                set_ends(s, links, spatial, at.NX, ends[place, 0])
                set_ends(s, links, spatial, at.HALF, ends[place, 1])
            link_vectors(s, links, spatial, at.NX, at.N)
            if not _stage(s, links, spatial, at.HALF, at.N, ends, patterns, factors, place, damping, weight, powers):
                return i, at.SINGULAR
            if stage == 0 and extremes:
                update_extremes(s, links)
            reach = step if stage == 2 else 0.5 * step
            for c in range(dims):
                for j in range(links + 1):
                    s[at.SUM_X + c, j] += weight * s[at.HALF + c, j]
                    s[at.SUM_V + c, j] += weight * s[at.ACCELERATION + c, j]
                    if stage < 3:
                        s[at.NX + c, j] = s[at.X + c, j] + reach * s[at.HALF + c, j]
                        s[at.HALF + c, j] = s[at.V + c, j] + reach * s[at.ACCELERATION + c, j]
        for c in range(dims):
            for j in range(links + 1):
                s[at.BASE + c, j] = s[at.X + c, j] + step / 6.0 * s[at.SUM_X + c, j]
                s[at.HALF + c, j] = s[at.V + c, j] + step / 6.0 * s[at.SUM_V + c, j]
        if moving:
            set_ends(s, links, spatial, at.BASE, ends[2 * (i + 1), 0])
            set_ends(s, links, spatial, at.HALF, ends[2 * (i + 1), 1])
        link_vectors(s, links, spatial, at.BASE, at.N)
        for j in range(links):
            if not dot(s, at.N, j, at.E, j, spatial) > 0.0:
                return i, at.NOT_CONVERGED
            s[at.T, j] = 0.0
        copy_vectors(s, links, spatial, at.N, at.E)
        status = project_positions(s, links, spatial, 1.0, tolerance, counts)
        if status != at.DONE:
            link_vectors(s, links, spatial, at.X, at.E)
            return i, status
        if not project_velocities(s, links, spatial, at.HALF, at.N):
            link_vectors(s, links, spatial, at.X, at.E)
            return i, at.SINGULAR
        copy_vectors(s, links, spatial, at.HALF, at.V)
        counts[at.LOADS] += step / 6.0 * powers[0]
        counts[at.ENDS] += step / 6.0 * powers[1]
        counts[at.LOST] += step / 6.0 * powers[2]
        if not end_step(s, links, spatial, counts):
            return i + 1, at.OUT_OF_BALANCE
    return steps, at.DONE


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
        assign(s[at.X : at.X + dims, : links + 1], x[i])
        assign(s[at.V : at.V + dims, : links + 1], v[i])
        set_ends(s, links, spatial, at.X, ends[i, 0])
        set_ends(s, links, spatial, at.V, ends[i, 1])
        link_vectors(s, links, spatial, at.X, at.E)
        if is_projected[i]:
            copy_vectors(s, links, spatial, at.X, at.BASE)
            for j in range(links):
                s[at.T, j] = 0.0
            status = project_positions(s, links, spatial, 1.0, tolerance, counts)
            if status != at.DONE:
                return i, status
            copy_vectors(s, links, spatial, at.NX, at.X)
            copy_vectors(s, links, spatial, at.N, at.E)
            if not project_velocities(s, links, spatial, at.V, at.E):
                return i, at.SINGULAR
            assign(x[i], s[at.X : at.X + dims, : links + 1])
            assign(v[i], s[at.V : at.V + dims, : links + 1])
        if patterns.shape[0] > 0:
            load_accelerations(s, links, spatial, patterns, factors[i])
        set_ends(s, links, spatial, at.ACCELERATION, ends[i, 2])
        if not index1_accelerations(s, links, spatial, at.V, at.E, damping):
            return i, at.SINGULAR
        assign(a[i], s[at.ACCELERATION : at.ACCELERATION + dims, : links + 1])
        for j in range(links):
            tension[i, j] = s[at.CORRECTION, j]
    return x.shape[0], at.DONE
