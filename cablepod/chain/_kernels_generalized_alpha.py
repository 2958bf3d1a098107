"""Compiled steps of generalized alpha, with the trapezoidal rule as a case of it, for the elastic chain; O(n) per step.

Every step solves for the displacements by Newton's method.  A link couples its two particles only, so that the tangent is block
tridiagonal with blocks of 2 x 2 or 3 x 3.  It is eliminated from both ends towards the middle: two independent chains of
operations, which halve the time.

Arrays over links have n + 2 places: link j is at j + 1, and the zeros at both ends are the missing links of a free end.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED, compiled
from cablepod.chain._kernels_attached import attached_forces, attached_tangent, body_drag
from cablepod.chain._kernels_banded import solve_planar, solve_spatial
from cablepod.chain._kernels_drag import drag_forces, drag_tangent
from cablepod.chain._kernels_links import link_forces_planar, link_forces_spatial
from cablepod.discretisation._kernels_modal_damping import damping_forces

#: Maximum number of Newton iterations per step.
MAX_ITERATIONS = 30
#: With drag, whose tangent leaves out the direction of the cable: tolerance of what remains over that of the last correction.
REMAINDER = 1e-3
#: The same with damping by ratios, whose tangent is an approximation: what remains acts against the motion in every step.
MODAL_REMAINDER = 1e-6


@compiled
def _correction(f, s, fixed_force, diagonal, solved, own, d, b, workspace, first, last, per_length):
    """Compute the Newton correction b of the displacements d; returns its mean rotation of the links.

    The right side is the sum of link forces and `fixed_force` less `diagonal` d; `solved` takes its place in the tangent.  `own`
    is the negative derivative of `fixed_force` by the displacements of each particle, None for 0.
    """
    dims, particles = b.shape
    flat = b.reshape(-1)
    # one loop for all coordinates: the places after the last link of one and before the first of the next are the same
    for q in range(flat.size):
        flat[q] = f[q + 1] - f[q] + (fixed_force[q] - diagonal[q] * d[q])
    for c in range(dims):
        if first == 1:
            b[c, 0] = 0.0
        if last == particles - 1:
            b[c, last] = 0.0
    if dims == 2:
        solve_planar(
            solved, own, (s[0], s[1], s[2]), (b[0], b[1]), (workspace[0], workspace[1], workspace[2], workspace[3]), first,
            last,
        )  # fmt: skip
    else:
        solve_spatial(
            solved, own, (s[0], s[1], s[2], s[3], s[4], s[5]), (b[0], b[1], b[2]),
            (workspace[0], workspace[1], workspace[2], workspace[3], workspace[4], workspace[5]), first, last,
        )  # fmt: skip
    return _mean_rotation(flat, per_length)


@compiled(fastmath=REORDERED)
def _mean_rotation(b, per_length):
    """Return the root mean square rotation and stretch of the links by a correction, summed in any order.

    It is NaN for a NaN correction: the fast-math options do not assume finite numbers.
    """
    total = 0.0
    for q in range(b.size - 1):
        turn = (b[q + 1] - b[q]) * per_length[q]
        total += turn * turn
    return math.sqrt(total / b.size)


@compiled
def _remainder(rotation, before):
    """Return what a linear iteration leaves after two corrections, or after the first one (`before` = 0) at most."""
    return rotation * rotation / before if before > rotation else rotation


@compiled
def _with_modal_damping(modal, rates, first, part, fixed_force, forces, s):
    """Return the sum of `fixed_force` and the damping by ratios, in `forces` (dims, n + 1), flat.

    `part` times the stiffness of `modal` is added to that of the links, `s`.
    """
    damping_forces(modal, rates, first, forces)
    flat, links, stiffness = forces.reshape(-1), s.reshape(-1), modal.stiffness.reshape(-1)
    for q in range(flat.size):
        flat[q] += fixed_force[q]
    for q in range(links.size):
        links[q] += part * stiffness[q]
    return flat


@compiled
def _sum(forces, fixed_force):
    """Add `fixed_force`, flat, to forces (dims, n + 1); returns these, flat."""
    flat = forces.reshape(-1)
    for q in range(flat.size):
        flat[q] += fixed_force[q]
    return flat


@compiled
def _with_attached(particles, attached, x, v, part, rate, fixed_force, forces, own):
    """Return the sum of `fixed_force` and the forces of dampers and springs, in `forces` (dims, n + 1), flat.

    Their tangent is added to `own`, see :func:`cablepod.chain._kernels_attached.attached_tangent`.
    """
    forces[:] = 0.0
    attached_forces(x, v, particles, attached, forces)
    attached_tangent(particles, attached, part, rate, own)
    return _sum(forces, fixed_force)


@compiled(inline="always")
def _correct(d, b, x, trial):
    """Add the correction b to the displacements d and update the trial positions."""
    for q in range(d.size):
        new = d[q] + b[q]
        d[q] = new
        trial[q] = x[q] + new


@compiled
def _add_loads(fixed_force, patterns, factors):
    """Add time-dependent loads to the part of the right side that does not change in a step."""
    flat = patterns.reshape((patterns.shape[0], fixed_force.size))
    for load in range(patterns.shape[0]):
        factor = factors[load]
        for q in range(fixed_force.size):
            fixed_force[q] += factor * flat[load, q]


@compiled
def _set_ends(trial, lower, upper, i):
    """Put the moving ends at their positions at step `i` of the tables."""
    last = trial.shape[1] - 1
    for c in range(trial.shape[0]):
        if lower is not None:
            trial[c, 0] = lower[i, c]
        if upper is not None:
            trial[c, last] = upper[i, c]


@compiled
def _is_inside(x, bound):
    """Return whether all coordinates are finite and below `bound`; counts, because a loop with an exit is not vectorised."""
    outside = 0
    for coordinate in x.flat:
        if not abs(coordinate) < bound:
            outside += 1
    return outside == 0


@compiled
def _update_extremes(x, low, high, inverse_squares, k, length):
    """Update the extremes of the tensions [N] at positions x (dims, n + 1)."""
    for j in range(low.size):
        square = 0.0
        for c in range(x.shape[0]):
            reach = x[c, j + 1] - x[c, j]
            square += reach * reach
        stretched = math.sqrt(square)
        if inverse_squares is None:  # an if that the compiler can prune
            low[j] = min(low[j], max(k[j] * (stretched - length[j]), 0.0))
            high[j] = max(high[j], k[j] * (stretched - length[j]), 0.0)
        else:
            tension = 0.5 * k[j] * (square * inverse_squares[j] - 1.0) * stretched
            low[j] = min(low[j], tension)
            high[j] = max(high[j], tension)


# --- time steps -------------------------------------------------------------------------------------------------------


@compiled
def generalized_alpha(
    x, v, a, g, first, last, k, length, inverse_squares, mass, damping, loads, patterns, factors, viscosity,
    tension_damping, modal, particles, attached, wind, wind_places, drag, bodies, lower, upper, end_rates, step, alpha_m,
    alpha_f, beta, gamma, rotation_tolerance, rounding, bound, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of generalized alpha (Chung and Hulbert 1993); alphas 0 give the trapezoidal rule.

    Parameters
    ----------
    x, v, a, g : float arrays (dims, n + 1)
        Positions [m], velocities [m/s], accelerations [m/s2] and total forces [N]; advanced in place.  All but the positions are
        0 at held particles, which take part in every loop.
    first, last : int
        The free particles, first ... last - 1.
    k, length : float arrays (n,)
        Stiffness [N/m] and unstretched length [m] of the links.
    inverse_squares : float array (n,) or None
        1 / length^2 for law (21), None for the linear law.
    mass : float array (n + 1,)
        [kg]; 0 at held particles, and so the loads.
    damping : float or None
        Damping per mass [1/s].
    loads : float array (dims, n + 1)
        Constant loads [N].
    patterns, factors : float arrays (loads, dims, n + 1), (steps + 1, loads) or None
        Time-dependent loads [N] and their factors at the steps.
    viscosity : float or None
        Viscosity of the links over their stiffness [s].
    tension_damping : float or None
        Damping by the tension [s], see :func:`cablepod.chain._kernels_links.link_forces_planar`.
    modal : NodalDamping
        Damping by ratios, see :class:`cablepod.discretisation._modal_damping.NodalDamping`; it needs `end_rates`.
    particles, attached : int array (attachments,), float array (attachments, COLUMNS) or None
        Particles with dampers or springs, and their numbers, see :mod:`cablepod.chain._kernels_attached`; they need `end_rates`.
    wind, wind_places, drag : float arrays (samples, dims, n + 1), (steps + 1,), (n + 1,), or None
        Velocity of the air at the particles [m/s], linear between the samples; places of the steps between the samples; half the
        density of the air times drag coefficient and diameter [kg/m2].
    bodies : float array (n + 1,) or None
        Half the density of the air times drag area at the particles [kg/m]; only with wind.
    lower, upper : float arrays (steps + 1, dims) or None
        Positions of the ends at the steps [m].
    end_rates : float array (steps + 1, 2, dims) or None
        Velocities of the ends [m/s]; only where a force depends on velocities.
    step : float
        [s].
    alpha_m, alpha_f, beta, gamma : float
        Parameters of the method.
    rotation_tolerance, rounding : float
        Newton tolerance: root mean square rotation of the links by the last correction; the same by rounding.
    bound : float
        Coordinate above which the chain is considered divergent [m].
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
        Number of steps done and of iterations.  If Newton's method does not converge, fewer steps are done, and the state is that
        before the failing step.  A step that leaves the bound is the last one done.
    """
    dims, count = x.shape
    f, s = np.zeros(dims * count + 1), np.zeros((3 if dims == 2 else 6, count + 1))
    d, b, fixed_force = np.zeros(x.size), np.zeros((dims, count)), np.zeros(x.size)
    workspace = np.zeros((2 * dims, count))
    trial, rates = x.copy(), np.zeros((dims, count))
    air_force, air_damping, own = np.zeros((dims, count)), np.zeros(count), np.zeros((3 * dims - 3, count))
    masses, per_length = _repeat(mass, dims), _repeat(np.append(1.0 / length, 0.0), dims)
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
    diagonal = masses * (inertia * per_d + (0.0 if damping is None else damping * rate))
    solved = diagonal + modal.half_ratio * rate * rate * masses
    damping_force = np.zeros((dims, count))
    attached_force = np.zeros((dims, count))
    steady, last_a, first_a = loads.reshape(-1), flat_a.copy(), flat_a.copy()
    allowed = REMAINDER if modal.matrix.size == 0 else MODAL_REMAINDER
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1] = v
            saved[save, 2] = a
            save += 1
        if low is not None:
            _update_extremes(x, low, high, inverse_squares, k, length)
        for q in range(d.size):
            vq, aq = flat_v[q], flat_a[q]
            # prediction a1 = a + a(-1) - a(-2): exact for resolved linear motion and for oscillation from step to step
            d[q] = step * (vq + step * ((0.5 - beta) * aq + beta * (aq + last_a[q] - first_a[q])))
            flat_trial[q] = flat_x[q] + d[q]
            # terms of the balance that do not depend on the unknowns of the step
            balance = old_g * flat_g[q] + masses[q] * (inertia * (per_v * vq + per_a * aq) - old_a * aq)
            fixed_force[q] = steady[q] + balance
        if damping is not None:
            for q in range(d.size):
                after = (1.0 - gamma) * flat_a[q] - gamma * (per_v * flat_v[q] + per_a * flat_a[q])
                fixed_force[q] -= damping * masses[q] * (flat_v[q] + step * after)
        if patterns is not None:
            _add_loads(fixed_force, patterns, factors[i + 1])
        _set_ends(trial, lower, upper, i + 1)
        converged, before = False, 0.0
        for _ in range(MAX_ITERATIONS):
            iterations += 1
            if end_rates is not None:
                flat_rates = rates.reshape(-1)
                for q in range(d.size):
                    a1 = per_d * (d[q] - step * flat_v[q]) - per_a * flat_a[q]
                    flat_rates[q] = flat_v[q] + step * ((1.0 - gamma) * flat_a[q] + gamma * a1)
                for c in range(dims):
                    if first == 1:
                        rates[c, 0] = end_rates[i + 1, 0, c]
                    if last == count - 1:
                        rates[c, last] = end_rates[i + 1, 1, c]
            if dims == 2:
                link_forces_planar(
                    trial[0], trial[1], rates[0], rates[1], k, length, inverse_squares, viscosity, tension_damping,
                    rate, f, f[count:], s[0], s[1], s[2],
                )  # fmt: skip
            else:
                link_forces_spatial(
                    trial[0], trial[1], trial[2], rates[0], rates[1], rates[2], k, length, inverse_squares, viscosity,
                    tension_damping, rate, f, f[count:], f[2 * count :], s,
                )  # fmt: skip
            known = fixed_force
            if modal.matrix.size > 0:
                known = _with_modal_damping(modal, rates, first, 1.0, fixed_force, damping_force, s)
            if wind is not None:
                drag_forces(trial, rates, wind, wind_places[i + 1], drag, first, last, air_force, air_damping)
                drag_tangent(trial, first, last, rate, air_force, air_damping, own)
                if bodies is not None:
                    body_drag(rates, wind, wind_places[i + 1], bodies, air_force, rate, own)
                known = _sum(air_force, known)
            if attached is not None:
                if wind is None:
                    own[:] = 0.0
                known = _with_attached(particles, attached, trial, rates, 1.0, rate, known, attached_force, own)
            if wind is not None or attached is not None:
                rotation = _correction(f, s, known, diagonal, solved, own, d, b, workspace, first, last, per_length)
            else:
                rotation = _correction(f, s, known, diagonal, solved, None, d, b, workspace, first, last, per_length)
            _correct(d, b.reshape(-1), flat_x, flat_trial)
            _set_ends(trial, lower, upper, i + 1)
            remainder = 0.0 if wind is None and modal.matrix.size == 0 else _remainder(rotation, before)
            is_small = remainder <= allowed * rotation_tolerance or (rotation <= rounding and rotation > 0.5 * before)
            if rotation <= rotation_tolerance and is_small:
                converged = True
                break
            if not rotation < 1e300:
                break
            before = rotation
        if not converged:
            return i, iterations
        for q in range(d.size):
            vq, aq = flat_v[q], flat_a[q]
            new = per_d * (d[q] - step * vq) - per_a * aq
            flat_v[q] = vq + step * ((1.0 - gamma) * aq + gamma * new)
            flat_g[q] = masses[q] * (inertia * new + old_a * aq) - old_g * flat_g[q]
            first_a[q], last_a[q] = last_a[q], aq
            flat_a[q] = new
            flat_x[q] = flat_trial[q]
        if not _is_inside(x, bound):
            return i + 1, iterations
    return steps, iterations


@compiled
def _repeat(values, dims):
    """Repeat values at the particles for each coordinate (dims (n + 1),)."""
    result = np.empty(dims * values.size)
    for c in range(dims):
        result[c * values.size : (c + 1) * values.size] = values
    return result
