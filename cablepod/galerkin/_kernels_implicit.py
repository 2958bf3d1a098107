"""Compiled implicit steps of the Galerkin model."""

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.discretisation._kernels_dense import _solve
from cablepod.galerkin._kernels_energy import (
    LINEAR_LINKS,
    POLYNOMIAL,
    _elongation,
    _forces_of_ends,
    _set_coordinates,
    _strains,
    _stresses,
)

#: Maximum number of Newton iterations in a step.
MAX_ITERATIONS = 25


@compiled(fastmath=FAST_DIVISION, literal=False)
def _rows(y, law, table, offset, first, second, link_form, slopes, e, jacobian):
    """Fill the strains e of the rows and their Jacobian (coordinates, rows), which is linear in y."""
    count = y.size
    if law == POLYNOMIAL:
        for k in range(count):
            for i in range(offset.size):
                jacobian[k, i] = table[k, i]
        for pair in range(first.size):
            a, b = first[pair], second[pair]
            ya, yb = y[a], y[b]
            for i in range(offset.size):
                jacobian[a, i] += table[count + pair, i] * yb
            for i in range(offset.size):
                jacobian[b, i] += table[count + pair, i] * ya
        for i in range(offset.size):
            e[i] = offset[i]
        for k in range(count):
            half = 0.5 * y[k]
            for i in range(offset.size):
                e[i] += half * (table[k, i] + jacobian[k, i])
        return
    shape, strain, field_slopes, active_axes, _ = link_form
    _strains(y, shape, strain, field_slopes, active_axes, slopes, e)
    for k in range(count):
        for j in range(strain.size):
            jacobian[k, j] = 0.0
        for c in range(shape.shape[0]):
            if active_axes[k, c]:
                for j in range(strain.size):
                    jacobian[k, j] += slopes[c, j] * field_slopes[k, c, j]


@compiled(fastmath=FAST_DIVISION)
def _stress_slopes(law, stiffness, e, ds):
    """Fill the derivatives ds of the stresses of the rows by their strains e."""
    for j in range(e.size):
        ds[j] = stiffness[j]
        if law == LINEAR_LINKS:
            elongation, xi = _elongation(e[j])
            ds[j] = stiffness[j] / (xi * xi * xi) if elongation > 0.0 else 0.0


@compiled(fastmath=FAST_DIVISION)
def _gradient(jacobian, s, gradient):
    for k in range(jacobian.shape[0]):
        total = 0.0
        for j in range(s.size):
            total += jacobian[k, j] * s[j]
        gradient[k] = total


@compiled(fastmath=FAST_DIVISION)
def _tangent(law, jacobian, s, ds, table, first, second, field_slopes, active_axes, scaled, weighted, tangent):
    """Fill the derivative of the gradient `jacobian` s by z."""
    modes, rows = tangent.shape[0], s.size
    for k in range(modes):
        for j in range(rows):
            scaled[j] = ds[j] * jacobian[k, j]
        for m in range(k + 1):
            total = 0.0
            for j in range(rows):
                total += scaled[j] * jacobian[m, j]
            tangent[k, m] = total
    if law == POLYNOMIAL:
        count = jacobian.shape[0]
        for pair in range(first.size):
            a, b = first[pair], second[pair]
            if a < modes and b < modes:
                slope = 0.0
                for i in range(rows):
                    slope += table[count + pair, i] * s[i]
                tangent[b, a] += slope
                if a == b:
                    tangent[a, b] += slope
    else:
        for k in range(modes):
            for c in range(weighted.shape[0]):
                if not active_axes[k, c]:
                    continue
                for j in range(rows):
                    weighted[c, j] = s[j] * field_slopes[k, c, j]
                for m in range(k + 1):
                    if active_axes[m, c]:
                        total = 0.0
                        for j in range(rows):
                            total += weighted[c, j] * field_slopes[m, c, j]
                        tangent[k, m] += total
    for k in range(modes):
        for m in range(k):
            tangent[m, k] = tangent[k, m]


@compiled(fastmath=FAST_DIVISION)
def _save(saved, saved_energy, p, velocity, load, gradient, damping, energy, account):
    for k in range(p.size):
        saved[0, k] = p[k]
        saved[1, k] = velocity[k]
        saved[2, k] = load[k] - gradient[k] - damping * velocity[k]
    saved_energy[0] = energy
    saved_energy[1:] = account


@compiled(fastmath=FAST_DIVISION)
def implicit(
    p, velocity, history, account, step, damping, coupling, loads, ends, law, table, polynomial_form, link_form, stiffness,
    rms_slopes, newton_tolerance, start, steps, save_steps, saved, saved_energy,
):  # fmt: skip
    """Advance the projection z by steps of the trapezoidal rule.

    (v1 - v0)/h = load - g - damping (v0 + v1)/2, (p1 - p0)/h = (v0 + v1)/2, with the means of the loads and of the gradients g
    at both ends of the step.

    Parameters
    ----------
    p, velocity, account, coupling, law, link_form, start, steps, save_steps, saved, saved_energy
        As in ``verlet``, but with the rates at step `start`; the last saved step may be start + steps.
    history : float array (3, modes)
        Mean accelerations of the last three steps, latest first; advanced in place.
    step, damping : float
        [s], [1/s].
    loads : float array (steps + 1 or 1, modes)
        Generalised loads.
    ends : float array (steps + 1, displacements)
        Displacements of the ends [m].
    table : float array (monomials, rows)
        R transposed; empty without polynomial form.
    polynomial_form : tuple (offset, first, second)
        As in :func:`cablepod.galerkin._kernels_explicit.verlet`.
    stiffness : float array (rows,)
        Stiffness of the rows: K l, or 1 in polynomial form.
    rms_slopes : float array (modes,)
        Root mean square over the links of the slope of each mode [kg^-1/2 m^-1].
    newton_tolerance : float
        Tolerance of the last Newton correction, as a mean rotation of the links.

    Returns
    -------
    tuple of int
        Number of completed steps, fewer than `steps` if Newton's method did not converge (the state is then that before the
        failed step), and number of iterations.
    """
    modes, moving = p.size, ends.shape[1]
    offset, first, second = polynomial_form
    field_slopes, active_axes = link_form[2], link_form[3]
    rows, count, dims = stiffness.size, modes + moving, field_slopes.shape[1]
    y, gradient, force, slopes = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros((dims, link_form[1].size))
    jacobian, e, s, ds, scaled = np.zeros((count, rows)), np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(rows)
    weighted, tangent, end_forces = np.zeros((dims, rows)), np.zeros((modes, modes)), np.zeros(moving)
    z, increment, b, explicit_part = np.zeros(modes), np.zeros(modes), np.zeros(modes), np.zeros(modes)
    varying, save, iterations = loads.shape[0] > 1, 0, 0
    # the balance is that of twice the mean force, of which one half is that at the start
    diagonal = 2.0 * (2.0 / (step * step) + damping / step)
    _set_coordinates(y, p, ends, 0, coupling)
    _rows(y, law, table, offset, first, second, link_form, slopes, e, jacobian)
    energy = _stresses(law, e, stiffness, s)
    _gradient(jacobian, s, gradient)
    _forces_of_ends(gradient, coupling, end_forces)
    for i in range(steps):
        now, then = (i, i + 1) if varying else (0, 0)
        if save < save_steps.size and save_steps[save] == start + i:
            _save(saved[save], saved_energy[save], p, velocity, loads[now], gradient, damping, energy, account)
            save += 1
        for k in range(modes):
            if start + i == 0:
                for m in range(history.shape[0]):
                    history[m, k] = loads[now, k] - gradient[k] - damping * velocity[k]
            # extrapolation that is exact for linear change (resolved) and for alternating signs (unresolved)
            mean = history[0, k] + history[1, k] - history[2, k]
            increment[k] = step * (velocity[k] + 0.5 * step * mean)
            z[k] = p[k] + increment[k]
            explicit_part[k] = 2.0 * (0.5 * (loads[now, k] + loads[then, k]) + 2.0 * velocity[k] / step) - gradient[k]
        converged = False
        for _ in range(MAX_ITERATIONS):
            iterations += 1
            _set_coordinates(y, z, ends, i + 1, coupling)
            _rows(y, law, table, offset, first, second, link_form, slopes, e, jacobian)
            _stresses(law, e, stiffness, s)
            _stress_slopes(law, stiffness, e, ds)
            _gradient(jacobian, s, force)
            _tangent(law, jacobian, s, ds, table, first, second, field_slopes, active_axes, scaled, weighted, tangent)
            norm = 0.0
            for k in range(modes):
                b[k] = explicit_part[k] - diagonal * increment[k] - force[k]
                tangent[k, k] += diagonal
            if not _solve(tangent, b):
                break
            for k in range(modes):
                increment[k] += b[k]
                z[k] = p[k] + increment[k]
                norm += abs(b[k]) * rms_slopes[k]
            converged = norm <= newton_tolerance
            if converged or not norm < 1e300:
                break
        if not converged:
            return i, iterations
        for k in range(modes):
            mean = 2.0 * (increment[k] / step - velocity[k])
            history[2, k], history[1, k], history[0, k] = history[1, k], history[0, k], mean / step
            velocity[k] += mean
            account[0] += 0.5 * (loads[now, k] + loads[then, k]) * increment[k]
            account[2] += damping * increment[k] * increment[k] / step
        _set_coordinates(y, z, ends, i + 1, coupling)
        _rows(y, law, table, offset, first, second, link_form, slopes, e, jacobian)
        energy = _stresses(law, e, stiffness, s)
        _gradient(jacobian, s, gradient)
        for f in range(moving):
            account[1] += 0.5 * end_forces[f] * (ends[i + 1, f] - ends[i, f])
        _forces_of_ends(gradient, coupling, end_forces)
        for f in range(moving):
            account[1] += 0.5 * end_forces[f] * (ends[i + 1, f] - ends[i, f])
        for k in range(modes):
            p[k] = z[k]
    if save < save_steps.size and save_steps[save] == start + steps:
        row = steps if varying else 0
        _save(saved[save], saved_energy[save], p, velocity, loads[row], gradient, damping, energy, account)
    return steps, iterations
