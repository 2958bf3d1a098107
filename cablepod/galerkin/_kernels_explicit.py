"""Compiled velocity Verlet steps of the Galerkin model."""

from __future__ import annotations

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.galerkin._kernels_energy import POLYNOMIAL, link_gradient, polynomial_gradient


@compiled(fastmath=FAST_DIVISION)
def verlet(
    p, velocity, account, step, damping_factor, impulse_time, damping, coupling, loads, ends, law, polynomial_form, link_form,
    start, steps, save_steps, saved, saved_energy,
):  # fmt: skip
    """Advance the projection z by `steps` steps of velocity Verlet in leapfrog form.

    Parameters
    ----------
    p, velocity : float arrays (modes,)
        Projection z at step `start` [kg^1/2 m] and its rates half a step before; advanced in place.
    account : float array (3,)
        Work of the loads, work of the ends, dissipated energy [J] until step `start` or half a step before; advanced in place.
    step, damping_factor, impulse_time, damping : float
        [s], exp(-damping step), (1 - damping_factor) / damping or the step [s], damping per mass [1/s].
    coupling : float array (displacements, modes)
        Mass coupling C of the lifting fields to the modes [kg^1/2].
    loads : float array (steps or 1, modes)
        Generalised loads at the steps from `start` on; one row if they are constant.
    ends : float array (steps + 2, displacements)
        Displacements of the ends at the steps from `start` - 1 on (for step -1 those of step 0) [m].
    law : int
        POLYNOMIAL, GREEN_LINKS or LINEAR_LINKS.
    polynomial_form : tuple (factor, offset, first, second)
        R (rows, monomials), e (rows,), and index pairs of the quadratic monomials; empty if not used.
    link_form : tuple (shape, strain, field_slopes, active_axes, stiffness)
        Slopes of the mean shape (dims, n), its strains (n,), slopes of the fields (coordinates, dims, n), mask of the axes of
        each coordinate (coordinates, dims), K l (n,) [N m]; empty if not used.
    start, steps : int
        Number of the first step, and number of steps.
    save_steps : int array (saves,)
        Increasing numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, 3, modes)
        Filled with z and its first and second time derivatives.
    saved_energy : float array (saves, 4)
        Filled with the strain energy and `account` [J].
    """
    modes, moving = p.size, ends.shape[1]
    factor, offset, first, second = polynomial_form
    shape, strain, field_slopes, active_axes, stiffness = link_form
    y, gradient = np.zeros(modes + moving), np.zeros(modes + moving)
    monomials, monomial_gradient = np.zeros(factor.shape[1]), np.zeros(factor.shape[1])
    slopes, e, s = np.empty(shape.shape), np.empty(strain.size), np.empty(strain.size)
    save = 0
    varying = loads.shape[0] > 1
    for i in range(steps):
        for k in range(modes):
            y[k] = p[k]
        for f in range(moving):
            displacement = ends[i + 1, f]
            y[modes + f] = displacement
            for k in range(modes):
                y[k] -= displacement * coupling[f, k]
        if law == POLYNOMIAL:
            energy = polynomial_gradient(y, factor, offset, first, second, monomials, monomial_gradient, gradient)
        else:
            energy = link_gradient(y, law, shape, strain, field_slopes, active_axes, stiffness, slopes, e, s, gradient)
        saving = save < save_steps.size and save_steps[save] == start + i
        row = i if varying else 0
        if start + i > 0:  # second half of the work since the previous step
            for k in range(modes):
                account[0] += 0.5 * step * loads[row, k] * velocity[k]
                account[2] += step * damping * velocity[k] * velocity[k]
        if moving:
            _work_of_ends(account, 0.5, gradient, coupling, ends[i], ends[i + 1])
        if saving:
            saved_energy[save, 0] = energy
            for term in range(3):
                saved_energy[save, 1 + term] = account[term]
            for k in range(modes):
                saved[save, 0, k] = p[k]
                saved[save, 1, k] = velocity[k]
        for k in range(modes):
            velocity[k] = damping_factor * velocity[k] + impulse_time * (loads[row, k] - gradient[k])
            account[0] += 0.5 * step * loads[row, k] * velocity[k]
        if moving:
            _work_of_ends(account, 0.5, gradient, coupling, ends[i + 1], ends[i + 2])
        if saving:
            for k in range(modes):
                earlier = saved[save, 1, k]
                saved[save, 1, k] = 0.5 * (earlier + velocity[k])
                saved[save, 2, k] = (velocity[k] - earlier) / step
            save += 1
        for k in range(modes):
            p[k] += step * velocity[k]


@compiled(fastmath=FAST_DIVISION)
def _work_of_ends(account, weight, gradient, coupling, earlier, later):
    """Add the work of the ends between the displacements `earlier` and `later`; the force is dV/dd - C dV/dq."""
    moving, modes = coupling.shape
    for f in range(moving):
        force = gradient[modes + f]
        for k in range(modes):
            force -= coupling[f, k] * gradient[k]
        account[1] += weight * force * (later[f] - earlier[f])
