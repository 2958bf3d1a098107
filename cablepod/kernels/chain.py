"""The elastic chain: velocity Verlet in leapfrog form, and the chain at rest.

Floats and arrays only; a term that a scene lacks is None and is compiled away.  No fastmath: the loops over links vectorise
without it (nothing is summed), a planar and a spatial run give the same bits, and so do two machines.  Each loop over
particles works on slices of equal length, because a signed loop index with an offset keeps numba from vectorising.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# without the interpreter lock, so that runs in several threads go on side by side
_options: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True}


@njit(**_options)
def _drift(x, v, dt):
    for j in range(x.size):
        x[j] += dt * v[j]


@njit(**_options)
def _pull(x0, x1, y0, y1, z0, z1, k, length, fx, fy, fz):
    """Compute forces of the links [N]: k (1 - l/|R|) R where |R| > l, else 0."""
    if z0 is None:
        for j in range(k.size):
            dx = x1[j] - x0[j]
            dy = y1[j] - y0[j]
            s = k[j] * (1.0 - length[j] / math.sqrt(dx * dx + dy * dy))
            s = s if s > 0.0 else 0.0
            fx[j] = s * dx
            fy[j] = s * dy
    else:
        for j in range(k.size):
            dx = x1[j] - x0[j]
            dy = y1[j] - y0[j]
            dz = z1[j] - z0[j]
            s = k[j] * (1.0 - length[j] / math.sqrt(dx * dx + dy * dy + dz * dz))
            s = s if s > 0.0 else 0.0
            fx[j] = s * dx
            fy[j] = s * dy
            fz[j] = s * dz


@njit(**_options)
def _pull_green(x0, x1, y0, y1, z0, z1, k, inverse, fx, fy, fz):
    """Compute forces of the links by law (21) [N]: k/2 (|R|^2/l^2 - 1) R; `inverse` is 1/l^2."""
    if z0 is None:
        for j in range(k.size):
            dx = x1[j] - x0[j]
            dy = y1[j] - y0[j]
            s = 0.5 * k[j] * ((dx * dx + dy * dy) * inverse[j] - 1.0)
            fx[j] = s * dx
            fy[j] = s * dy
    else:
        for j in range(k.size):
            dx = x1[j] - x0[j]
            dy = y1[j] - y0[j]
            dz = z1[j] - z0[j]
            s = 0.5 * k[j] * ((dx * dx + dy * dy + dz * dz) * inverse[j] - 1.0)
            fx[j] = s * dx
            fy[j] = s * dy
            fz[j] = s * dz


@njit(**_options)
def _pull_viscous(x, y, z, u, v, w, k, length, viscosity, fx, fy, fz):
    """Compute forces of links with viscosity; velocities u, v(, w) of all particles.  A link that is slack carries nothing."""
    for j in range(k.size):
        dx = x[j + 1] - x[j]
        dy = y[j + 1] - y[j]
        square = dx * dx + dy * dy
        rate = dx * (u[j + 1] - u[j]) + dy * (v[j + 1] - v[j])
        if z is not None:
            dz = z[j + 1] - z[j]
            square += dz * dz
            rate += dz * (w[j + 1] - w[j])
        s = k[j] * (1.0 - length[j] / math.sqrt(square))
        total = s + viscosity * k[j] * rate / square
        s = total if s > 0.0 and total > 0.0 else 0.0
        fx[j + 1] = s * dx
        fy[j + 1] = s * dy
        if z is not None:
            fz[j + 1] = s * dz


@njit(**_options)
def _kick(v, f0, f1, h, c, decay):
    """V <- decay v + (f1 - f0) h + c; decay None means 1."""
    if decay is None:
        for j in range(v.size):
            v[j] += (f1[j] - f0[j]) * h[j] + c[j]
    else:
        for j in range(v.size):
            v[j] = decay * v[j] + (f1[j] - f0[j]) * h[j] + c[j]


@njit(**_options)
def _push(v, pattern, factor, scale):
    """Add a load that varies in time."""
    for j in range(v.size):
        v[j] += scale[j] * factor * pattern[j]


@njit(**_options)
def _predict(ahead, v, v_before):
    """Velocity at the step from the last two half steps: second order, so that damping does not cost the scheme its order."""
    for j in range(v.size):
        ahead[j] = v[j] + 0.5 * (v[j] - v_before[j])


@njit(**_options)
def _extremes(fx, fy, fz, low, high):
    for j in range(low.size):
        square = fx[j] * fx[j] + fy[j] * fy[j]
        if fz is not None:
            square += fz[j] * fz[j]
        tension = math.sqrt(square)
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


@njit(**_options)
def _extremes_green(x0, x1, y0, y1, z0, z1, k, inverse, low, high):
    """Update the extremes with sign, which the size of a force does not tell."""
    for j in range(low.size):
        dx = x1[j] - x0[j]
        dy = y1[j] - y0[j]
        square = dx * dx + dy * dy
        if z0 is not None:
            dz = z1[j] - z0[j]
            square += dz * dz
        tension = 0.5 * k[j] * (square * inverse[j] - 1.0) * math.sqrt(square)
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


@njit(**_options)
def _copy(target, source):
    for j in range(source.size):
        target[j] = source[j]


@njit(**_options)
def _advance(
    x, y, z, vx, vy, vz, fz, uz, first, last, k, length, inverse, per_mass, drive, step, decay,
    lower, upper, patterns, factors, viscosity, before, end_rates, begin, end, low, high,
):  # fmt: skip
    """Take the steps begin ... end - 1 of the tables; apart from saving, so that the compiler sees a plain loop."""
    n = k.size
    free = slice(first, last)
    after = slice(first + 1, last + 1)
    # link j pulls at index j + 1; the zeros at both ends stand for the links that a free end lacks
    fx, fy = np.zeros(n + 2), np.zeros(n + 2)
    x0, x1, y0, y1 = x[:-1], x[1:], y[:-1], y[1:]
    gx, gy = fx[1:-1], fy[1:-1]
    # views are made once: making one in every step costs as much as ten links
    x_free, y_free, fx0, fx1, fy0, fy1 = x[free], y[free], fx[free], fx[after], fy[free], fy[after]
    drive_x, drive_y = drive[0], drive[1]
    if viscosity is not None:
        ux, uy = np.zeros(n + 1), np.zeros(n + 1)
    for i in range(begin, end):
        if inverse is not None:
            if z is None:
                _pull_green(x0, x1, y0, y1, None, None, k, inverse, gx, gy, None)
            else:
                _pull_green(x0, x1, y0, y1, z[:-1], z[1:], k, inverse, gx, gy, fz[1:-1])
        elif viscosity is None:
            if z is None:
                _pull(x0, x1, y0, y1, None, None, k, length, gx, gy, None)
            else:
                _pull(x0, x1, y0, y1, z[:-1], z[1:], k, length, gx, gy, fz[1:-1])
        else:
            ux[0], uy[0], ux[n], uy[n] = end_rates[i, 0, 0], end_rates[i, 0, 1], end_rates[i, 1, 0], end_rates[i, 1, 1]
            _predict(ux[free], vx, before[0])
            _predict(uy[free], vy, before[1])
            _copy(before[0], vx)
            _copy(before[1], vy)
            if z is not None:
                uz[0], uz[n] = end_rates[i, 0, 2], end_rates[i, 1, 2]
                _predict(uz[free], vz, before[2])
                _copy(before[2], vz)
            _pull_viscous(x, y, z, ux, uy, uz, k, length, viscosity, fx, fy, fz)
        if low is not None:
            if inverse is not None:
                if z is None:
                    _extremes_green(x0, x1, y0, y1, None, None, k, inverse, low, high)
                else:
                    _extremes_green(x0, x1, y0, y1, z[:-1], z[1:], k, inverse, low, high)
            elif z is None:
                _extremes(gx, gy, None, low, high)
            else:
                _extremes(gx, gy, fz[1:-1], low, high)
        _kick(vx, fx0, fx1, per_mass, drive_x, decay)
        _kick(vy, fy0, fy1, per_mass, drive_y, decay)
        if z is not None:
            _kick(vz, fz[free], fz[after], per_mass, drive[2], decay)
        if patterns is not None:
            for load in range(patterns.shape[0]):
                _push(vx, patterns[load, 0], factors[i, load], per_mass)
                _push(vy, patterns[load, 1], factors[i, load], per_mass)
                if z is not None:
                    _push(vz, patterns[load, 2], factors[i, load], per_mass)
        _drift(x_free, vx, step)
        _drift(y_free, vy, step)
        if z is not None:
            _drift(z[free], vz, step)
        if lower is not None:
            x[0] = lower[i + 1, 0]
            y[0] = lower[i + 1, 1]
            if z is not None:
                z[0] = lower[i + 1, 2]
        if upper is not None:
            x[n] = upper[i + 1, 0]
            y[n] = upper[i + 1, 1]
            if z is not None:
                z[n] = upper[i + 1, 2]


@njit(**_options)
def verlet(
    x, y, z, vx, vy, vz, fz, uz, first, last, k, length, inverse, per_mass, drive, step, decay,
    lower, upper, patterns, factors, viscosity, before, end_rates,
    steps, start, save_steps, saved, saved_half, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of velocity Verlet in leapfrog form.

    Entering and leaving, positions are those of step `start`, velocities those half a step before it: the forces of a step
    are computed once, and saving changes nothing.

    Parameters
    ----------
    x, y, z : float arrays (n + 1,)
        Positions of all particles [m]; advanced in place.  In a planar chain z, vz, fz and uz are None.
    vx, vy, vz : float arrays (last - first,)
        Velocities of the free particles first ... last - 1 half a step before [m/s]; advanced in place.
    fz, uz : float arrays (n + 2,), (n + 1,)
        Zeros to work in; arguments because only an argument that is None is compiled away.
    first, last : int
        The free particles.
    k, length : float arrays (n,)
        Stiffness [N/m] and unstretched length [m] of the links.
    inverse : float array (n,) or None
        1/length^2 [1/m^2] for law (21); None for the linear law.
    per_mass : float array (last - first,)
        Step over mass [s/kg]; with decay (1 - decay) / (damping mass), which integrates the damping exactly.
    drive : tuple of float arrays (last - first,)
        What constant loads add to the velocity in a step [m/s].
    step : float
        [s].
    decay : float or None
        exp(-damping step), damping per mass; None without.
    lower, upper : float arrays (steps + 1, dims) or None
        Positions of the ends at the steps from `start` on [m]; None for an end that stands still or is free.
    patterns, factors : float arrays (loads, dims, last - first), (steps + 1, loads) or None
        Loads that vary in time [N] and their factors at the steps.
    viscosity : float or None
        Viscosity of the links over their stiffness [s]; only with the linear law.
    before : tuple of float arrays or None
        Velocities a whole step before those in `velocity`; only with viscosity.
    end_rates : float array (steps + 1, 2, dims) or None
        Velocities of the ends [m/s]; only with viscosity.
    steps, start : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save, start <= number < start + steps.
    saved : float array (saves, dims, n + 1)
        Filled with positions.
    saved_half : float array (saves, 2, dims, last - first) or None
        Filled with the velocities half a step before and half a step after.
    low, high : float arrays (n,) or None
        Extremes of the tensions, updated [N]; with law (21) compression is negative.
    """
    save, i = 0, 0
    while i < steps:
        target = steps
        saving = save < save_steps.size and save_steps[save] == start + i
        if saving:
            saved[save, 0] = x
            saved[save, 1] = y
            if z is not None:
                saved[save, 2] = z
            if saved_half is not None:
                saved_half[save, 0, 0] = vx
                saved_half[save, 0, 1] = vy
                if z is not None:
                    saved_half[save, 0, 2] = vz
                target = i + 1
        if target == steps and save + saving < save_steps.size:
            target = save_steps[save + saving] - start
        _advance(
            x, y, z, vx, vy, vz, fz, uz, first, last, k, length, inverse, per_mass, drive, step, decay,
            lower, upper, patterns, factors, viscosity, before, end_rates, i, target, low, high,
        )  # fmt: skip
        i = target
        if saving:
            if saved_half is not None:
                saved_half[save, 1, 0] = vx
                saved_half[save, 1, 1] = vy
                if z is not None:
                    saved_half[save, 1, 2] = vz
            save += 1


@njit(**_options)
def green_strain(load):
    """Find xi - 1 of a pulled link by law (21), xi (xi^2 - 1)/2 = load, tension over stiffness.

    In e = xi - 1 this is e (1 + e) (1 + e/2) = load, convex and rising, so Newton's method from e = load, too large, comes down
    to the solution without a jump beyond it, and no digit of a small strain is lost.
    """
    e = load
    for _ in range(60):
        e_next = e - (e * (1.0 + e) * (1.0 + 0.5 * e) - load) / (1.0 + 3.0 * e + 1.5 * e * e)
        if not e_next < e:
            break
        e = e_next
    return e


@njit(**_options)
def secant_modulus(size, stiffness, green):
    """Tension over strain [N] of a link under the tension `size` [N]: K, by law (21) K (1 + e) (1 + e/2)."""
    if not green:
        return stiffness
    e = green_strain(size / stiffness)
    return stiffness * (1.0 + e) * (1.0 + 0.5 * e)


@njit(**_options)
def _stretch(force, loads, length, stiffness, green, gap, hessian):
    """Gap between the end of a chain of given first link force and `gap`'s target (added in place); also its Jacobian.

    Returns the complementary energy's part that depends on the force, sum l c(|F|): by the linear law c = T + T^2 / (2 K), by law
    (21) c = T xi - K (xi^2 - 1)^2 / 8.
    """
    dims = force.size
    f = force.copy()
    hessian[:] = 0.0
    energy = 0.0
    for j in range(length.size):
        if j > 0:
            for c in range(dims):
                f[c] -= loads[j - 1, c]
        square = 0.0
        for c in range(dims):
            square += f[c] * f[c]
        size = math.sqrt(square)
        if green:
            e = green_strain(size / stiffness)
            strain = e * (1.0 + 0.5 * e)
            energy += length[j] * (size * (1.0 + e) - 0.5 * stiffness * strain * strain)
        else:
            energy += length[j] * size * (1.0 + 0.5 * size / stiffness)
        if size == 0.0:
            continue
        secant = secant_modulus(size, stiffness, green)
        for c in range(dims):
            gap[c] += length[j] * (f[c] / size + f[c] / secant)
            for d in range(dims):
                hessian[c, d] -= length[j] * (f[c] / size) * (f[d] / size) / size
            hessian[c, c] += length[j] * (1.0 / size + 1.0 / secant)
        if green:
            # along the link the tangent counts: d xi / dT = 1 / (K (3 xi^2 - 1) / 2)
            excess = 1.0 / (stiffness * (1.0 + 3.0 * e + 1.5 * e * e)) - 1.0 / secant
            for c in range(dims):
                for d in range(dims):
                    hessian[c, d] += length[j] * (f[c] / size) * (f[d] / size) * excess
    return energy


@njit(**_options)
def _solve_small(matrix, right):
    """Solve a positive definite system of 2 or 3 unknowns in place; elementary order, so that dimensions agree bit for bit."""
    n = right.size
    for i in range(n):
        for j in range(i):
            factor = matrix[i, j] / matrix[j, j]
            for m in range(j, n):
                matrix[i, m] -= factor * matrix[j, m]
            right[i] -= factor * right[j]
    for i in range(n - 1, -1, -1):
        for m in range(i + 1, n):
            right[i] -= matrix[i, m] * right[m]
        right[i] /= matrix[i, i]


@njit(**_options)
def equilibrium(chord, loads, length, stiffness, green, force):
    """Find the force in the first link of a chain at rest between two points, by Newton's method.

    The force minimises the complementary energy, sum l c(|F|) - F . chord with c(T) = T + T^2 / 2K or its like by law (21), which
    is strictly convex: the steps, shortened until the energy falls, converge from anywhere where no link ends up without force.

    Parameters
    ----------
    chord : float array (dims,)
        From the lower to the upper end [m].
    loads : float array (n - 1, dims)
        Forces on the inner particles [N].
    length : float array (n,)
        Unstretched lengths of the links [m].
    stiffness : float
        Axial stiffness [N].
    green : bool
        Whether law (21) holds instead of the linear one.
    force : float array (dims,)
        A guess of the force in the first link, pointing up the chain; overwritten by the solution [N].

    Returns
    -------
    float
        Largest component of the closing gap that is left [m].
    """
    dims = chord.size
    gap, trial_gap = -chord, np.empty(dims)
    hessian, trial_hessian = np.empty((dims, dims)), np.empty((dims, dims))
    energy = _stretch(force, loads, length, stiffness, green, gap, hessian)
    energy -= _dot(force, chord)
    for _ in range(200):
        move = -gap
        _solve_small(hessian.copy(), move)
        slope = _dot(gap, move)
        part = 1.0
        size = _size(gap)
        for _ in range(60):
            trial = force + part * move
            trial_gap[:] = -chord
            trial_energy = _stretch(trial, loads, length, stiffness, green, trial_gap, trial_hessian)
            trial_energy -= _dot(trial, chord)
            if trial_energy <= energy + 1e-4 * part * slope or _size(trial_gap) < 0.5 * size:
                break
            part *= 0.5
        if not _size(trial_gap) < size and _size(move) <= 1e-9 * _size(force):
            break  # rounding: no step makes the gap smaller
        force[:] = trial
        gap[:] = trial_gap
        hessian[:] = trial_hessian
        energy = trial_energy
        if _size(gap) == 0.0:
            break
    return _size(gap)


@njit(**_options)
def _size(vector):
    largest = 0.0
    for c in range(vector.size):
        if not abs(vector[c]) <= largest:
            largest = abs(vector[c])
    return largest


@njit(**_options)
def _dot(a, b):
    total = 0.0
    for c in range(a.size):
        total += a[c] * b[c]
    return total
