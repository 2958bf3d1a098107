"""Compiled velocity Verlet steps of the Galerkin model."""

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.galerkin._kernels_energy import (
    POLYNOMIAL,
    _forces_of_ends,
    _set_coordinates,
    link_gradient,
    polynomial_energy,
    polynomial_gradient,
)


@compiled(fastmath=FAST_DIVISION)
def verlet(
    p, velocity, account, step, damping_factor, impulse_time, damping, step_filter, coupling, loads, ends, law,
    polynomial_form, gram, linear, link_form, start, steps, save_steps, with_energy, saved, saved_energy,
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
    step_filter : float array (modes, modes) or None
        Symmetric factor of the accelerations: the inverse of a mass matrix that slows vibrations which the step does not resolve.
        None, the unit matrix, is compiled away.
    coupling : float array (displacements, modes)
        Mass coupling C of the lifting fields to the modes [kg^1/2].
    loads : float array (steps or 1, modes)
        Generalised loads at the steps from `start` on; one row if they are constant.
    ends : float array (steps + 2, displacements)
        Displacements of the ends at the steps from `start` - 1 on (for step -1 those of step 0) [m].
    law : int
        POLYNOMIAL, GREEN_LINKS or LINEAR_LINKS.
    polynomial_form : tuple (factor, offset, first, second)
        R (rows, monomials), e (rows,), and index pairs of the quadratic monomials (unsigned: no index counts from the end);
        empty if not used.
    gram, linear : float arrays (monomials, monomials), (monomials,)
        R^T R and R^T e, filled up with zeros; empty if not used.
    link_form : tuple (shape, strain, field_slopes, active_axes, stiffness)
        Slopes of the mean shape (dims, n), its strains (n,), slopes of the fields (coordinates, dims, n), mask of the axes of
        each coordinate (coordinates, dims), K l (n,) [N m]; empty if not used.
    start, steps : int
        Number of the first step, and number of steps.
    save_steps : int array (saves,)
        Increasing numbers of the steps to save, start <= number < start + steps.
    with_energy : bool array (saves,)
        Whether the strain energy is needed; without, it is left as it is in polynomial form.
    saved : float array (saves, 3, modes)
        Filled with z and its first and second time derivatives.
    saved_energy : float array (saves, 4)
        Filled with the strain energy and `account` [J].
    """
    modes, moving = p.size, ends.shape[1]
    factor, offset, first, second = polynomial_form
    shape, strain, field_slopes, active_axes, stiffness = link_form
    y, gradient, force = np.zeros(modes + moving), np.zeros(modes + moving), np.zeros(modes)
    monomials, monomial_gradient = np.zeros(linear.size), np.zeros(linear.size)
    slopes, e, s = np.empty(shape.shape), np.empty(strain.size), np.empty(strain.size)
    save, next_save = 0, save_steps[0] if save_steps.size else -1
    varying = loads.shape[0] > 1
    half_step, damped_step, energy, end_forces = 0.5 * step, step * damping, 0.0, np.zeros(moving)
    for i in range(steps):
        _set_coordinates(y, p, ends, i + 1, coupling)
        if law == POLYNOMIAL:
            polynomial_gradient(y, gram, linear, first, second, monomials, monomial_gradient, gradient)
        else:
            energy = link_gradient(y, law, shape, strain, field_slopes, active_axes, stiffness, slopes, e, s, gradient)
        row = i if varying else 0
        power, dissipation = 0.0, 0.0
        for k in range(modes):
            force[k] = loads[row, k] - gradient[k]
            power += loads[row, k] * velocity[k]
            dissipation += velocity[k] * velocity[k]
        if start + i > 0:  # second half of the work since the previous step
            account[0] += half_step * power
            account[2] += damped_step * dissipation
        _forces_of_ends(gradient, coupling, end_forces)
        for f in range(moving):
            account[1] += 0.5 * end_forces[f] * (ends[i + 1, f] - ends[i, f])
        saving = start + i == next_save
        if saving:
            if law != POLYNOMIAL:
                saved_energy[save, 0] = energy
            elif with_energy[save]:
                saved_energy[save, 0] = polynomial_energy(y, factor, offset, first, second, monomials)
            for term in range(3):
                saved_energy[save, 1 + term] = account[term]
            for k in range(modes):
                saved[save, 0, k] = p[k]
                saved[save, 1, k] = velocity[k]
        power = 0.0
        for k in range(modes):
            if step_filter is None:
                total = force[k]
            else:
                total = 0.0
                for j in range(modes):
                    total += step_filter[k, j] * force[j]
            velocity[k] = damping_factor * velocity[k] + impulse_time * total
            power += loads[row, k] * velocity[k]
            p[k] += step * velocity[k]
        account[0] += half_step * power
        for f in range(moving):
            account[1] += 0.5 * end_forces[f] * (ends[i + 2, f] - ends[i + 1, f])
        if saving:
            for k in range(modes):
                earlier = saved[save, 1, k]
                saved[save, 1, k] = 0.5 * (earlier + velocity[k])
                saved[save, 2, k] = (velocity[k] - earlier) / step
            save += 1
            next_save = save_steps[save] if save < save_steps.size else -1
