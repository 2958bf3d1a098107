"""Compiled implicit steps of many chains abreast: generalized alpha, the trapezoidal rule, energy-momentum.

Members lie in lanes, the last dimension of all arrays.  All lanes iterate together; one that has converged is no longer
corrected, so that each member takes the iterations of its run alone.  Equations as in ``_kernels_generalized_alpha`` and
``_kernels_energy_momentum``.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.chain._kernels_generalized_alpha import MAX_ITERATIONS
from cablepod.chain._kernels_lanes import conserving_forces_lanes, correct_lanes, link_forces_lanes

# --- parts of a step --------------------------------------------------------------------------------------------------


@compiled(noalias=True, forceinline=True)
def _predict_alpha(
    step, beta, gamma, inertia, old_g, old_a, per_v, per_a, x, v, a, g, last_a, first_a, mass, damped_mass, loads, d, trial,
    fixed_force,
):  # fmt: skip
    """Predict the displacements of a step of generalized alpha, and sum up the forces that do not depend on them."""
    for q in range(x.size):
        vq, aq = v[q], a[q]
        d[q] = step * (vq + step * ((0.5 - beta) * aq + beta * (aq + last_a[q] - first_a[q])))
        trial[q] = x[q] + d[q]
        balance = old_g * g[q] + mass[q] * (inertia * (per_v * vq + per_a * aq) - old_a * aq)
        fixed = loads[q] + balance
        if damped_mass is not None:
            after = (1.0 - gamma) * aq - gamma * (per_v * vq + per_a * aq)
            fixed -= damped_mass[q] * (vq + step * after)
        fixed_force[q] = fixed


@compiled(noalias=True, forceinline=True)
def _accept_alpha(step, gamma, per_d, per_v, per_a, inertia, old_g, old_a, x, v, a, g, last_a, first_a, mass, d, trial):
    """Go on to the end of a step of generalized alpha."""
    for q in range(x.size):
        vq, aq = v[q], a[q]
        new = per_d * (d[q] - step * vq) - per_a * aq
        v[q] = vq + step * ((1.0 - gamma) * aq + gamma * new)
        g[q] = mass[q] * (inertia * new + old_a * aq) - old_g * g[q]
        first_a[q] = last_a[q]
        last_a[q] = aq
        a[q] = new
        x[q] = trial[q]


@compiled(noalias=True, forceinline=True)
def _rates_alpha(step, gamma, per_d, per_a, v, a, d, rates):
    """Compute the velocities at the end of a step of generalized alpha."""
    for q in range(v.size):
        new = per_d * (d[q] - step * v[q]) - per_a * a[q]
        rates[q] = v[q] + step * ((1.0 - gamma) * a[q] + gamma * new)


@compiled(noalias=True, forceinline=True)
def _predict_conserving(step, x, v, last_displacement, mass, loads, d, trial, fixed_force):
    """Predict the displacements of an energy-momentum step, and sum up the forces that do not depend on them."""
    for q in range(x.size):
        d[q] = 2.0 * step * v[q] - last_displacement[q]
        trial[q] = x[q] + d[q]
        fixed_force[q] = loads[q] + 2.0 * mass[q] * v[q] / step


@compiled(noalias=True, forceinline=True)
def _accept_conserving(step, x, v, last_displacement, d, trial):
    """Go on to the end of an energy-momentum step."""
    for q in range(x.size):
        v[q] = 2.0 * d[q] / step - v[q]
        last_displacement[q] = d[q]
        x[q] = trial[q]


@compiled
def _add_loads(fixed_force, patterns, factors, begin, end):
    """Add time-dependent loads, means of those at the steps `begin` and `end` of the tables."""
    for load in range(patterns.shape[0]):
        for q in range(fixed_force.shape[0]):
            for m in range(fixed_force.shape[1]):
                factor = 0.5 * (factors[begin, load, m] + factors[end, load, m])
                fixed_force[q, m] += factor * patterns[load, q, m]


@compiled
def _set_ends(trial, lower, upper, i):
    """Put the moving ends at their positions at step `i` of the tables."""
    last = trial.shape[1] - 1
    for c in range(trial.shape[0]):
        for m in range(trial.shape[2]):
            if lower is not None:
                trial[c, 0, m] = lower[i, c, m]
            if upper is not None:
                trial[c, last, m] = upper[i, c, m]


@compiled
def _update_extremes(x, low, high, inverse_squares, k, length):
    """Update the extremes of the tensions (links, lanes) [N] at positions x (dims, n + 1, lanes)."""
    for j in range(low.shape[0]):
        for m in range(low.shape[1]):
            square = 0.0
            for c in range(x.shape[0]):
                reach = x[c, j + 1, m] - x[c, j, m]
                square += reach * reach
            stretched = math.sqrt(square)
            if inverse_squares is None:
                tension = max(k[j, m] * (stretched - length[j, m]), 0.0)
            else:
                tension = 0.5 * k[j, m] * (square * inverse_squares[j, m] - 1.0) * stretched
            low[j, m] = min(low[j, m], tension)
            high[j, m] = max(high[j, m], tension)


@compiled
def _save(state, i, saved):
    """Save coordinates (dims, n + 1, lanes) of all members (members, variables, dims, n + 1) as variable `i`."""
    for m in range(saved.shape[0]):
        for c in range(state.shape[0]):
            for p in range(state.shape[1]):
                saved[m, i, c, p] = state[c, p, m]


# --- convergence ------------------------------------------------------------------------------------------------------


@compiled
def _begin(is_running, active, failed, last_rotation):
    """Prepare the marks of the lanes for a step."""
    for m in range(is_running.size):
        active[m] = 1.0 if is_running[m] else 0.0
        failed[m] = False
        last_rotation[m] = np.inf


@compiled
def _judge(active, failed, rotation, last_rotation, tolerance, rounding, iterations):
    """Mark the lanes that have converged, or diverged, in an iteration; returns how many are left."""
    left = 0
    for m in range(active.size):
        if active[m] > 0.0:
            iterations[m] += 1
            small = rotation[m] <= tolerance[m]
            if rounding is not None:
                small = small or (rotation[m] <= rounding[m] and rotation[m] > 0.5 * last_rotation[m])
                last_rotation[m] = rotation[m]
            failed[m] = not small and not rotation[m] < 1e300
            active[m] = 0.0 if small or failed[m] else 1.0
            left += active[m] > 0.0
    return left


@compiled
def _any_failed(active, failed):
    """Mark the lanes that have not converged as failed; returns whether any has."""
    result = False
    for m in range(active.size):
        failed[m] = failed[m] or active[m] > 0.0
        result = result or failed[m]
    return result


@compiled
def _restore(failed, states, before):
    """Set the states (arrays, rows, lanes) of failed lanes back."""
    for m in range(failed.size):
        if failed[m]:
            states[:, :, m] = before[:, :, m]


@compiled(noalias=True, forceinline=True)
def _count_outside(x, bound, outside):
    """Count the coordinates of each lane that are not finite and below its bound."""
    for m in range(outside.size):
        outside[m] = 0.0
    for q in range(x.shape[0]):
        for m in range(outside.size):
            outside[m] += 0.0 if abs(x[q, m]) < bound[m] else 1.0


@compiled
def _any_outside(is_running, outside):
    """Take the lanes with coordinates outside their bound out of the run; returns whether there are any."""
    result = False
    for m in range(is_running.size):
        if is_running[m] and outside[m] > 0.0:
            is_running[m], result = False, True
    return result


# --- time steps -------------------------------------------------------------------------------------------------------


@compiled
def _per_link(length, dims):
    """Return the inverse length of the links at their first particles, 0 at the last one, for each coordinate."""
    links, lanes = length.shape
    result = np.zeros((dims, links + 1, lanes))
    for c in range(dims):
        result[c, :links] = 1.0 / length
    return result.reshape((dims * (links + 1), lanes))


@compiled
def alpha_lanes(
    is_running, failed, states, first, last, k, length, inverse_squares, mass, damping, loads, patterns, factors, viscosity,
    lower, upper, end_rates, step, alpha_m, alpha_f, beta, gamma, tolerance, bound, start, steps, save_steps, saved, low,
    high, iterations,
):  # fmt: skip
    """Advance chains by up to `steps` steps of generalized alpha, as ``generalized_alpha`` advances one.

    Parameters
    ----------
    is_running, failed : bool arrays (lanes,)
        Lanes to advance, changed: those that leave their bound are taken out.  Filled: the lanes in which Newton's method did
        not converge in the last step, and which remain at its beginning.
    states : float array (6, dims (n + 1), lanes)
        Positions, velocities, accelerations, forces, accelerations one and two steps before; advanced in place.
    first, last : int
        The free particles.
    k, length, inverse_squares : float arrays (n, lanes)
        Of the links, the last only for law (21), else None.
    mass, damping, loads : float arrays (dims (n + 1), lanes)
        Mass, damping per mass or None, constant loads; 0 at held particles.
    patterns, factors : float arrays (loads, dims (n + 1), lanes), (steps + 1, loads, lanes) or None
        Time-dependent loads and their factors at the steps.
    viscosity : float array (lanes,) or None
        Of the links.
    lower, upper, end_rates : float arrays (steps + 1, dims, lanes), (steps + 1, 2, dims, lanes) or None
        Positions of moving ends, and velocities of both, the latter only with viscosity.
    step, alpha_m, alpha_f, beta, gamma : float
        Step and parameters of the method.
    tolerance, bound : float arrays (lanes,)
        Newton tolerances [rad]; coordinates above which a chain is considered divergent [m].
    start, steps, save_steps
        As for one chain.
    saved : float array (members, saves, 1 or 3, dims, n + 1)
        Filled with positions, or with positions, velocities and accelerations.  The first lanes are the members.
    low, high : float arrays (n, lanes) or None
        Extremes of the tensions, updated.
    iterations : int array (lanes,)
        Raised by the iterations taken.

    Returns
    -------
    int
        Number of steps done: fewer if lanes failed or left their bound in the last one.
    """
    dims, particles, lanes = saved.shape[3], saved.shape[4], is_running.size
    rows, places = dims * particles, (dims, particles, lanes)
    f, s = np.zeros((rows + 1, lanes)), np.zeros((3 if dims == 2 else 6, particles + 1, lanes))
    b, matrix = np.zeros((rows + 1, lanes)), np.zeros((4 if dims == 2 else 6, particles, lanes))
    d, fixed_force, rates = np.zeros((rows, lanes)), np.zeros((rows, lanes)), np.zeros(places)
    carry, per_length = np.zeros((10 if dims == 2 else 18, lanes)), _per_link(length, dims)
    active, rotation, last_rotation, outside = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    x, v, a, g, last_a, first_a = states[0], states[1], states[2], states[3], states[4], states[5]
    trial = x.copy()
    per_d, per_v, per_a = 1.0 / (beta * step * step), 1.0 / (beta * step), 0.5 / beta - 1.0
    rate, inertia = gamma / (beta * step), (1.0 - alpha_m) / (1.0 - alpha_f)
    old_g, old_a = alpha_f / (1.0 - alpha_f), alpha_m / (1.0 - alpha_f)
    diagonal = mass * (inertia * per_d) if damping is None else mass * (inertia * per_d + damping * rate)
    damped_mass = None if damping is None else (damping * mass).reshape(-1)
    save = 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            for variable in range(saved.shape[2]):
                _save(states[variable].reshape(places), variable, saved[:, save])
            save += 1
        if low is not None:
            _update_extremes(x.reshape(places), low, high, inverse_squares, k, length)
        _predict_alpha(
            step, beta, gamma, inertia, old_g, old_a, per_v, per_a, x.reshape(-1), v.reshape(-1), a.reshape(-1),
            g.reshape(-1), last_a.reshape(-1), first_a.reshape(-1), mass.reshape(-1), damped_mass, loads.reshape(-1),
            d.reshape(-1), trial.reshape(-1), fixed_force.reshape(-1),
        )  # fmt: skip
        if patterns is not None:
            _add_loads(fixed_force, patterns, factors, i + 1, i + 1)
        _set_ends(trial.reshape(places), lower, upper, i + 1)
        _begin(is_running, active, failed, last_rotation)
        for _ in range(MAX_ITERATIONS):
            if viscosity is not None:
                _rates_alpha(step, gamma, per_d, per_a, v.reshape(-1), a.reshape(-1), d.reshape(-1), rates.reshape(-1))
                for c in range(dims):
                    if first == 1:
                        rates[c, 0] = end_rates[i + 1, 0, c]
                    if last == particles - 1:
                        rates[c, last] = end_rates[i + 1, 1, c]
            link_forces_lanes(trial.reshape(places), rates, k, length, inverse_squares, viscosity, rate, f, s)
            correct_lanes(
                active, f, s, fixed_force, diagonal, d, b, matrix, carry, first, last, per_length, x, trial, rotation
            )
            _set_ends(trial.reshape(places), lower, upper, i + 1)
            if not _judge(active, failed, rotation, last_rotation, tolerance, None, iterations):
                break
        stopped = _any_failed(active, failed)
        before = states.copy() if stopped else states
        _accept_alpha(
            step, gamma, per_d, per_v, per_a, inertia, old_g, old_a, x.reshape(-1), v.reshape(-1), a.reshape(-1),
            g.reshape(-1), last_a.reshape(-1), first_a.reshape(-1), mass.reshape(-1), d.reshape(-1), trial.reshape(-1),
        )  # fmt: skip
        if stopped:
            _restore(failed, states, before)
        _count_outside(x, bound, outside)
        if _any_outside(is_running, outside) or stopped:
            return i + 1
    return steps


@compiled
def conserving_lanes(
    is_running, failed, states, first, last, k, length, inverse_squares, mass, damping, loads, patterns, factors, viscosity,
    lower, upper, step, tolerance, rounding, bound, start, steps, save_steps, saved, low, high, iterations,
):  # fmt: skip
    """Advance chains by up to `steps` energy-momentum steps, as ``energy_momentum`` advances one.

    `states` (3, dims (n + 1), lanes) are positions, velocities and last displacements; `rounding` (lanes,) is that of one chain.
    Saved are positions, or positions and velocities with room for accelerations.  All else as in :func:`alpha_lanes`.
    """
    dims, particles, lanes = saved.shape[3], saved.shape[4], is_running.size
    rows, places = dims * particles, (dims, particles, lanes)
    f, s = np.zeros((rows + 1, lanes)), np.zeros((3 if dims == 2 else 6, particles + 1, lanes))
    b, matrix = np.zeros((rows + 1, lanes)), np.zeros((4 if dims == 2 else 6, particles, lanes))
    d, fixed_force = np.zeros((rows, lanes)), np.zeros((rows, lanes))
    carry, per_length = np.zeros((10 if dims == 2 else 18, lanes)), _per_link(length, dims)
    active, rotation, last_rotation, outside = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    x, v, last_displacement = states[0], states[1], states[2]
    trial = x.copy()
    diagonal = mass * (2.0 / (step * step)) if damping is None else mass * (2.0 / (step * step) + damping / step)
    save = 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            for variable in range(min(saved.shape[2], 2)):
                _save(states[variable].reshape(places), variable, saved[:, save])
            save += 1
        if low is not None:
            _update_extremes(x.reshape(places), low, high, inverse_squares, k, length)
        _predict_conserving(
            step, x.reshape(-1), v.reshape(-1), last_displacement.reshape(-1), mass.reshape(-1), loads.reshape(-1),
            d.reshape(-1), trial.reshape(-1), fixed_force.reshape(-1),
        )  # fmt: skip
        if patterns is not None:
            _add_loads(fixed_force, patterns, factors, i, i + 1)
        _set_ends(trial.reshape(places), lower, upper, i + 1)
        _begin(is_running, active, failed, last_rotation)
        for _ in range(MAX_ITERATIONS):
            conserving_forces_lanes(
                x.reshape(places), trial.reshape(places), k, length, inverse_squares, viscosity, 1.0 / step, f, s
            )
            correct_lanes(
                active, f, s, fixed_force, diagonal, d, b, matrix, carry, first, last, per_length, x, trial, rotation
            )
            _set_ends(trial.reshape(places), lower, upper, i + 1)
            if not _judge(active, failed, rotation, last_rotation, tolerance, rounding, iterations):
                break
        stopped = _any_failed(active, failed)
        before = states.copy() if stopped else states
        _accept_conserving(
            step, x.reshape(-1), v.reshape(-1), last_displacement.reshape(-1), d.reshape(-1), trial.reshape(-1)
        )
        if stopped:
            _restore(failed, states, before)
        _count_outside(x, bound, outside)
        if _any_outside(is_running, outside) or stopped:
            return i + 1
    return steps
