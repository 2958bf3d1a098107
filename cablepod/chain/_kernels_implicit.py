"""Implicit steps of the elastic chain: generalized alpha (the trapezoidal rule is one) and energy-momentum; O(n) per step.

Every step solves for the displacements by Newton's method.  A link couples its two particles alone, so the tangent is block
tridiagonal with blocks of 2 x 2 or 3 x 3; it is eliminated from both ends towards the middle, two chains of operations that do
not wait for each other, which halves the time.

Arrays over links have n + 2 places: link j stands at j + 1, and the zeros at both ends stand for the links that a free end lacks.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED, compiled
from cablepod.chain._kernels_banded import solve_planar, solve_spatial
from cablepod.chain._kernels_links import _pull_conserving, _pull_planar, _pull_spatial

MOST_ITERATIONS = 30


@compiled
def _correction(f, s, held, diagonal, d, b, kept, first, last, per_length):
    """Compute the correction b of the displacements d, and by how much it turns the links.

    The right side is the forces of the links and what is `held` during a step, less what grows with d.
    """
    dims, particles = b.shape
    flat = b.reshape(-1)
    # one loop for all coordinates: the place before the first link of one is that after the last link of the other
    for q in range(flat.size):
        flat[q] = f[q + 1] - f[q] + (held[q] - diagonal[q] * d[q])
    for c in range(dims):
        if first == 1:
            b[c, 0] = 0.0
        if last == particles - 1:
            b[c, last] = 0.0
    if dims == 2:
        solve_planar(diagonal, (s[0], s[1], s[2]), (b[0], b[1]), (kept[0], kept[1], kept[2], kept[3]), first, last)
    else:
        solve_spatial(
            diagonal, (s[0], s[1], s[2], s[3], s[4], s[5]), (b[0], b[1], b[2]),
            (kept[0], kept[1], kept[2], kept[3], kept[4], kept[5]), first, last,
        )  # fmt: skip
    return _turn(flat, per_length)


@compiled(fastmath=REORDERED)
def _turn(b, per_length):
    """Root of the mean square by which a correction turns and stretches the links, in any order of addition.

    Not a number where a correction is not: the options of the compiler assume nothing about that.
    """
    total = 0.0
    for q in range(b.size - 1):
        turn = (b[q + 1] - b[q]) * per_length[q]
        total += turn * turn
    return math.sqrt(total / b.size)


@compiled(inline="always")
def _correct(d, b, x, trial):
    """Add the correction b to the displacements d and put the particles there."""
    for q in range(d.size):
        new = d[q] + b[q]
        d[q] = new
        trial[q] = x[q] + new


@compiled
def _hold(held, patterns, factors):
    """Add loads that vary in time to what is held during a step."""
    flat = patterns.reshape((patterns.shape[0], held.size))
    for load in range(patterns.shape[0]):
        factor = factors[load]
        for q in range(held.size):
            held[q] += factor * flat[load, q]


@compiled
def _set_ends(trial, lower, upper, i):
    last = trial.shape[1] - 1
    for c in range(trial.shape[0]):
        if lower is not None:
            trial[c, 0] = lower[i, c]
        if upper is not None:
            trial[c, last] = upper[i, c]


@compiled
def _note_tension(x, low, high, inverse, k, length):
    """Update the extremes of the tensions [N] at positions x."""
    for j in range(low.size):
        square = 0.0
        for c in range(x.shape[0]):
            reach = x[c, j + 1] - x[c, j]
            square += reach * reach
        size = math.sqrt(square)
        if inverse is None:  # an if that the compiler can prune
            low[j] = min(low[j], max(k[j] * (size - length[j]), 0.0))
            high[j] = max(high[j], k[j] * (size - length[j]), 0.0)
        else:
            tension = 0.5 * k[j] * (square * inverse[j] - 1.0) * size
            low[j] = min(low[j], tension)
            high[j] = max(high[j], tension)


# --- time steps -------------------------------------------------------------------------------------------------------


@compiled
def generalized_alpha(
    x, v, a, g, first, last, k, length, inverse, mass, damping, loads, patterns, factors, viscosity, lower, upper, end_rates,
    step, alpha_m, alpha_f, beta, gamma, enough, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the generalized-alpha method (Chung and Hulbert 1993); trapezoidal with alphas 0.

    Parameters
    ----------
    x, v, a, g : float arrays (dims, n + 1)
        Positions [m], velocities [m/s], accelerations [m/s2] and total forces [N]; advanced in place.  All but the positions are
        0 at particles that are held, which so take part in every loop and stay.
    first, last : int
        The free particles, first ... last - 1.
    k, length : float arrays (n,)
        Stiffness [N/m] and unstretched length [m] of the links.
    inverse : float array (n,) or None
        1 / length^2 for law (21), None for the linear law.
    mass : float array (n + 1,)
        [kg]; 0 at held particles, and so the loads.
    damping : float or None
        Damping per mass [1/s].
    loads : float array (dims, n + 1)
        Constant loads [N].
    patterns, factors : float arrays (loads, dims, n + 1), (steps + 1, loads) or None
        Loads that vary in time [N] and their factors at the steps.
    viscosity : float or None
        Viscosity of the links over their stiffness [s].
    lower, upper : float arrays (steps + 1, dims) or None
        Positions of the ends at the steps [m].
    end_rates : float array (steps + 1, 2, dims) or None
        Velocities of the ends [m/s]; only with viscosity.
    step : float
        [s].
    alpha_m, alpha_f, beta, gamma : float
        Of the method.
    enough : float
        A correction that turns the links by as little as this, in the mean, ends Newton's method.
    start, steps : int
        Number of the first step, number of steps.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, 3, dims, n + 1)
        Filled with positions, velocities and accelerations.
    low, high : float arrays (n,) or None
        Extremes of the tensions at the steps, updated [N].

    Returns
    -------
    tuple of int
        Steps done, fewer than `steps` where Newton's method did not converge (the state is then that before the step), and
        iterations.
    """
    dims, particles = x.shape
    f, s = np.zeros(dims * particles + 1), np.zeros((3 if dims == 2 else 6, particles + 1))
    d, b, kept, held = np.zeros(x.size), np.zeros((dims, particles)), np.zeros((2 * dims, particles)), np.zeros(x.size)
    trial, rates = x.copy(), np.zeros((dims, particles))
    inert, per_length = _for_each(mass, dims), _for_each(np.append(1.0 / length, 0.0), dims)
    flat_x, flat_v, flat_a, flat_g, flat_trial = (
        x.reshape(-1),
        v.reshape(-1),
        a.reshape(-1),
        g.reshape(-1),
        trial.reshape(-1),
    )
    # acceleration a1 = per_d d - per_v v - per_a a, velocity v1 = v + step ((1 - gamma) a + gamma a1)
    per_d, per_v, per_a = 1.0 / (beta * step * step), 1.0 / (beta * step), 0.5 / beta - 1.0
    rate, inertia = gamma / (beta * step), (1.0 - alpha_m) / (1.0 - alpha_f)
    old_g, old_a = alpha_f / (1.0 - alpha_f), alpha_m / (1.0 - alpha_f)
    diagonal = inert * (inertia * per_d + (0.0 if damping is None else damping * rate))
    steady, last_a, first_a = loads.reshape(-1), flat_a.copy(), flat_a.copy()
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1] = v
            saved[save, 2] = a
            save += 1
        if low is not None:
            _note_tension(x, low, high, inverse, k, length)
        for q in range(d.size):
            vq, aq = flat_v[q], flat_a[q]
            # what is resolved goes on linearly, what is not swings from step to step: a1 = a + a(-1) - a(-2) is right for both
            d[q] = step * (vq + step * ((0.5 - beta) * aq + beta * (aq + last_a[q] - first_a[q])))
            flat_trial[q] = flat_x[q] + d[q]
            # all of the balance that the unknowns of the step do not change
            balance = old_g * flat_g[q] + inert[q] * (inertia * (per_v * vq + per_a * aq) - old_a * aq)
            held[q] = steady[q] + balance
        if damping is not None:
            for q in range(d.size):
                after = (1.0 - gamma) * flat_a[q] - gamma * (per_v * flat_v[q] + per_a * flat_a[q])
                held[q] -= damping * inert[q] * (flat_v[q] + step * after)
        if patterns is not None:
            _hold(held, patterns, factors[i + 1])
        _set_ends(trial, lower, upper, i + 1)
        converged = False
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            if viscosity is not None:
                flat_rates = rates.reshape(-1)
                for q in range(d.size):
                    a1 = per_d * (d[q] - step * flat_v[q]) - per_a * flat_a[q]
                    flat_rates[q] = flat_v[q] + step * ((1.0 - gamma) * flat_a[q] + gamma * a1)
                for c in range(dims):
                    if first == 1:
                        rates[c, 0] = end_rates[i + 1, 0, c]
                    if last == particles - 1:
                        rates[c, last] = end_rates[i + 1, 1, c]
            if dims == 2:
                _pull_planar(
                    trial[0], trial[1], rates[0], rates[1], k, length, inverse, viscosity, rate,
                    f, f[particles:], s[0], s[1], s[2],
                )  # fmt: skip
            else:
                _pull_spatial(
                    trial[0], trial[1], trial[2], rates[0], rates[1], rates[2], k, length, inverse, viscosity, rate,
                    f, f[particles:], f[2 * particles :], s,
                )  # fmt: skip
            size = _correction(f, s, held, diagonal, d, b, kept, first, last, per_length)
            _correct(d, b.reshape(-1), flat_x, flat_trial)
            _set_ends(trial, lower, upper, i + 1)
            if size <= enough:
                converged = True
                break
            if not size < 1e300:
                break
        if not converged:
            return i, iterations
        for q in range(d.size):
            vq, aq = flat_v[q], flat_a[q]
            new = per_d * (d[q] - step * vq) - per_a * aq
            flat_v[q] = vq + step * ((1.0 - gamma) * aq + gamma * new)
            flat_g[q] = inert[q] * (inertia * new + old_a * aq) - old_g * flat_g[q]
            first_a[q], last_a[q] = last_a[q], aq
            flat_a[q] = new
            flat_x[q] = flat_trial[q]
    return steps, iterations


@compiled
def energy_momentum(
    x, v, first, last, k, length, inverse, mass, damping, loads, patterns, factors, viscosity, lower, upper, step,
    enough, rounding, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the energy-momentum method (Simo and Tarnow 1992).

    The forces of the links over a step are difference quotients of their energies, so that with ends and loads at rest the sum of
    kinetic, strain and potential energy stays what it is, at any step, as far as Newton's method is carried.  Parameters and
    result as in :func:`generalized_alpha`; loads that vary are taken as the mean of both ends of the step.  What Newton's method
    leaves has a sign, and adds up in the energy over many steps: so corrections are made until they turn the links by as little
    as `enough`, or, below `rounding`, no longer shrink.
    """
    dims, particles = x.shape
    f, s = np.zeros(dims * particles + 1), np.zeros((3 if dims == 2 else 6, particles + 1))
    d, b, kept, held = np.zeros(x.size), np.zeros((dims, particles)), np.zeros((2 * dims, particles)), np.zeros(x.size)
    trial, before = x.copy(), step * v.reshape(-1)
    inert, per_length = _for_each(mass, dims), _for_each(np.append(1.0 / length, 0.0), dims)
    flat_x, flat_v, flat_trial, steady = x.reshape(-1), v.reshape(-1), trial.reshape(-1), loads.reshape(-1)
    diagonal = inert * (2.0 / (step * step) + (0.0 if damping is None else damping / step))
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1] = v
            save += 1
        if low is not None:
            _note_tension(x, low, high, inverse, k, length)
        for q in range(d.size):
            # what the last step moved, and as much more as it moved more than the velocity then said
            d[q] = 2.0 * step * flat_v[q] - before[q]
            flat_trial[q] = flat_x[q] + d[q]
            held[q] = steady[q] + 2.0 * inert[q] * flat_v[q] / step
        if patterns is not None:
            _hold(held, patterns, 0.5 * (factors[i] + factors[i + 1]))
        _set_ends(trial, lower, upper, i + 1)
        converged, before_size = False, np.inf
        for _ in range(MOST_ITERATIONS):
            iterations += 1
            _pull_conserving(x, trial, k, length, inverse, viscosity, 1.0 / step, f, s)
            size = _correction(f, s, held, diagonal, d, b, kept, first, last, per_length)
            _correct(d, b.reshape(-1), flat_x, flat_trial)
            _set_ends(trial, lower, upper, i + 1)
            if size <= enough or (size <= rounding and size > 0.5 * before_size):
                converged = True
                break
            if not size < 1e300:
                break
            before_size = size
        if not converged:
            return i, iterations
        for q in range(d.size):
            flat_v[q] = 2.0 * d[q] / step - flat_v[q]
            before[q] = d[q]
            flat_x[q] = flat_trial[q]
    return steps, iterations


@compiled
def _for_each(values, dims):
    """Values at the particles once for each coordinate (dims (n + 1),)."""
    result = np.empty(dims * values.size)
    for c in range(dims):
        result[c * values.size : (c + 1) * values.size] = values
    return result
