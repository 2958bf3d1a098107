"""Compiled velocity Verlet steps of the Galerkin model."""

from __future__ import annotations

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.galerkin._kernels_energy import PACKED, link_gradient, packed_gradient


@compiled(fastmath=FAST_DIVISION)
def verlet(
    p, velocity, account, step, decay, kick, damping, coupling, loads, ends, law, packed, linked,
    start, steps, save_steps, saved, saved_energy,
):  # fmt: skip
    """Advance the amplitudes by `steps` steps of velocity Verlet in leapfrog form.

    Parameters
    ----------
    p, velocity : float arrays (modes,)
        Amplitudes of the particles at step `start` [kg^1/2 m] and their rates half a step before; advanced in place.
    account : float array (3,)
        Work of the loads, work of the ends, energy dissipated [J] until step `start` or half a step before; advanced in place.
    step, decay, kick, damping : float
        [s], exp(-damping step), (1 - decay) / damping or the step [s], [1/s].
    coupling : float array (displacements, modes)
        C, what displacements of the ends do to the amplitudes [kg^1/2].
    loads : float array (steps or 1, modes)
        Generalised loads at the steps from `start` on; one row if they stand still.
    ends : float array (steps + 2, displacements)
        Displacements of the ends at the steps from the one before `start` on (at step 0 that of step 0 again) [m].
    law : int
        PACKED, GREEN_LINKS or LINEAR_LINKS.
    packed : tuple (factor, offset, first, second)
        R (rows, monomials), r (rows,), and the pairs of coordinates in the quadratic monomials; of size 0 where not used.
    linked : tuple (shape, strain, rates, used, stiffness)
        Differences over the links by their lengths, of the mean shape (dims, n) and the coordinates (coordinates, dims, n);
        strains of the mean shape (n,), which coordinates move along which axes, K l (n,) [N m].
    start, steps : int
        Number of the first step, number of steps.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, 3, modes)
        Filled with amplitudes, rates and second rates.
    saved_energy : float array (saves, 4)
        Filled with the strain energy and the account.
    """
    modes, moving = p.size, ends.shape[1]
    factor, offset, first, second = packed
    shape, strain, rates, used, stiffness = linked
    y, gradient = np.zeros(modes + moving), np.zeros(modes + moving)
    monomials, slopes = np.zeros(factor.shape[1]), np.zeros(factor.shape[1])
    reach, e, s = np.empty(shape.shape), np.empty(strain.size), np.empty(strain.size)
    save = 0
    varying = loads.shape[0] > 1
    for i in range(steps):
        for k in range(modes):
            y[k] = p[k]
        for f in range(moving):
            here = ends[i + 1, f]
            y[modes + f] = here
            for k in range(modes):
                y[k] -= here * coupling[f, k]
        if law == PACKED:
            energy = packed_gradient(y, factor, offset, first, second, monomials, slopes, gradient)
        else:
            energy = link_gradient(y, law, shape, strain, rates, used, stiffness, reach, e, s, gradient)
        saving = save < save_steps.size and save_steps[save] == start + i
        row = i if varying else 0
        if start + i > 0:  # the second half of what was done since the step before
            for k in range(modes):
                account[0] += 0.5 * step * loads[row, k] * velocity[k]
                account[2] += step * damping * velocity[k] * velocity[k]
        if moving:
            _work_of_ends(account, 0.5, gradient, coupling, ends[i], ends[i + 1])
        if saving:
            saved_energy[save, 0] = energy
            for part in range(3):
                saved_energy[save, 1 + part] = account[part]
            for k in range(modes):
                saved[save, 0, k] = p[k]
                saved[save, 1, k] = velocity[k]
        for k in range(modes):
            velocity[k] = decay * velocity[k] + kick * (loads[row, k] - gradient[k])
            account[0] += 0.5 * step * loads[row, k] * velocity[k]
        if moving:
            _work_of_ends(account, 0.5, gradient, coupling, ends[i + 1], ends[i + 2])
        if saving:
            for k in range(modes):
                before = saved[save, 1, k]
                saved[save, 1, k] = 0.5 * (before + velocity[k])
                saved[save, 2, k] = (velocity[k] - before) / step
            save += 1
        for k in range(modes):
            p[k] += step * velocity[k]


@compiled(fastmath=FAST_DIVISION)
def _work_of_ends(account, weight, gradient, coupling, before, after):
    """Add the work of the ends on their way from `before` to `after`: their force is dV/dd - C dV/dq."""
    moving, modes = coupling.shape
    for f in range(moving):
        force = gradient[modes + f]
        for k in range(modes):
            force -= coupling[f, k] * gradient[k]
        account[1] += weight * force * (after[f] - before[f])
