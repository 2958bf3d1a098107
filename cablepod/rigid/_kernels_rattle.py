"""Compiled RATTLE steps of the rigid links.

Without damping, with the multipliers T and U of positions and velocities:
x_new = x + h v_half,  v_half = v + h / 2m (P + G^T T),  |x_(j+1) - x_j| = l,
v_new = v_half + h / 2m (P_new + G_new^T U),  e.(v_(j+1) - v_j) = 0.
"""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.rigid._kernels_constraints import dimensions, project_positions, project_velocities
from cablepod.rigid._kernels_index1 import index1_accelerations
from cablepod.rigid._kernels_layout import (
    ACCELERATION,
    BASE,
    CORRECTION,
    DONE,
    ENDS,
    FORCE,
    HALF,
    INVERSE_MASS,
    KINETIC,
    LOAD,
    LOADS,
    LOST,
    NX,
    OUT_OF_BALANCE,
    SINGULAR,
    SUM_X,
    T_BEFORE,
    E,
    N,
    T,
    V,
    X,
)
from cablepod.rigid._kernels_terms import (
    by_mass,
    end_step,
    end_work,
    kinetic_energy,
    load_accelerations,
    save_state,
    set_ends,
    update_extremes,
)


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
                set_ends(s, links, spatial, ACCELERATION, ends[i, 2])
            if not index1_accelerations(s, links, spatial, V, E, damping):
                return i, SINGULAR
            update_extremes(s, links)
        for c in range(dims):
            for j in range(links + 1):
                s[HALF + c, j] = damping_factor * s[V + c, j] + half * s[LOAD + c, j]
                s[BASE + c, j] = s[X + c, j] + step * s[HALF + c, j]
        if moving:  # ends at rest keep their place
            set_ends(s, links, spatial, BASE, ends[i + 1, 0])
        for j in range(links):
            before = s[T_BEFORE, j]
            s[T_BEFORE, j] = s[T, j]
            s[T, j] = 2.0 * s[T, j] - before
        status = project_positions(s, links, spatial, step * half, tolerance, counts)
        if status != DONE:
            for j in range(links):
                s[T, j] = s[T_BEFORE, j]
            return i, status
        for c in range(dims):
            for j in range(links + 1):
                force = s[FORCE + c, j + 1] - s[FORCE + c, j]
                s[HALF + c, j] += half * s[INVERSE_MASS, j] * force
                s[SUM_X + c, j] = s[NX + c, j] - s[X + c, j]  # displacement
        work = by_mass(s, links, spatial, LOAD, SUM_X)
        if moving:
            counts[ENDS] += 0.5 * end_work(s, links, spatial, T, E, SUM_X)
        if patterns.shape[0] > 0:
            load_accelerations(s, links, spatial, patterns, factors[i + 1])
            work = 0.5 * (work + by_mass(s, links, spatial, LOAD, SUM_X))
        for c in range(dims):
            for j in range(links + 1):
                s[V + c, j] = damping_factor * s[HALF + c, j] + half * s[LOAD + c, j]
        if moving:
            set_ends(s, links, spatial, V, ends[i + 1, 1])
        if not project_velocities(s, links, spatial, V, N):
            return i, SINGULAR
        if moving:
            counts[ENDS] += 0.5 * end_work(s, links, spatial, CORRECTION, N, SUM_X) / half
        counts[LOADS] += work
        if damping > 0.0:
            counts[LOST] += step * damping * (counts[KINETIC] + kinetic_energy(s, links, spatial, V))
        if not end_step(s, links, spatial, counts):
            return i + 1, OUT_OF_BALANCE
    return steps, DONE
