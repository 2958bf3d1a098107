"""Compiled harmonic balance and monodromy matrix of a chain: block-tridiagonal matrices along the cable.

Coordinates of a particle are its displacement times the square root of its mass, over a scale; time is without dimension.  The
unknowns of a particle are its harmonics, in the order mean, cosine 1, sine 1, ..., all coordinates in each harmonic together.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from cablepod.periodic._kernels_balance import harmonic_blocks


@numba.njit(cache=True)
def link_samples(x, basis, lower, upper, length, stiffness, force, tangent):
    """Evaluate the forces of links at the samples of a period.

    Parameters
    ----------
    x
        Harmonics of the positions of the free particles (n - 1, columns, d) [m].
    basis
        Values of the harmonics at the samples (N, columns).
    lower, upper
        Positions of the ends at the samples (N, d) [m].
    length, stiffness
        Unstretched lengths (n,) [m]; product of Young's modulus and area [N].  A compressed link has no force.
    force, tangent
        Filled: forces of the links (n, N, d) [N], and their derivatives by the difference of positions (n, N, d, d) [N/m].

    Returns
    -------
    float
        Smallest tension [N].
    """
    links, samples, d = force.shape
    columns = basis.shape[1]
    before, here = np.empty((samples, d)), np.empty((samples, d))
    before[:] = lower
    least = np.inf
    for j in range(links):
        if j == links - 1:
            here[:] = upper
        else:
            for s in range(samples):
                for a in range(d):
                    total = 0.0
                    for c in range(columns):
                        total += basis[s, c] * x[j, c, a]
                    here[s, a] = total
        for s in range(samples):
            square = 0.0
            for a in range(d):
                square += (here[s, a] - before[s, a]) ** 2
            stretched = math.sqrt(square)
            secant = stiffness / length[j] * (1.0 - length[j] / stretched)
            along = stiffness / (stretched * square)
            least = min(least, secant * stretched)
            if secant < 0.0:
                secant, along = 0.0, 0.0
            for a in range(d):
                reach = here[s, a] - before[s, a]
                force[j, s, a] = secant * reach
                for b in range(d):
                    tangent[j, s, a, b] = along * reach * (here[s, b] - before[s, b])
                tangent[j, s, a, a] += secant
        before, here = here, before
    return least


@numba.njit(cache=True)
def hill(tangent, basis, odd, count, mean, matrix):
    """Fill the action of a periodic matrix on harmonics, see :func:`cablepod.periodic._kernels_balance.harmonic_blocks`.

    Parameters
    ----------
    tangent
        Matrix at the samples (N, d, d).
    basis
        Values of the harmonics at the samples (N, 4 H + 1).
    odd, count
        0 for whole harmonics, 1 for odd halves (the period of the motion is twice that of the matrix), and their number.
    mean
        Work array (4 H + 1, d, d).
    matrix
        Filled: (unknowns, unknowns).
    """
    samples, d = tangent.shape[:2]
    mean[:] = 0.0
    for s in range(samples):
        for c in range(mean.shape[0]):
            weight = basis[s, c] / samples
            for a in range(d):
                for b in range(d):
                    mean[c, a, b] += weight * tangent[s, a, b]
    harmonic_blocks(mean, count, odd, matrix)


@numba.njit(cache=True)
def diagonal_block(before, after, mass, omega, damping, first, count, d, block):
    """Fill the block of a particle: the matrices of the links beside it over its mass, with its inertia and damping."""
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            block[i, j] = (before[i, j] + after[i, j]) / mass
    for i in range(count):
        frequency = omega * (i + first)
        if frequency == 0.0:
            continue
        cosine = ((2 * i - 1) if first == 0.0 else 2 * i) * d
        for a in range(d):
            c, s = cosine + a, cosine + d + a
            block[c, c] -= frequency * frequency
            block[s, s] -= frequency * frequency
            block[c, s] += damping * frequency
            block[s, c] -= damping * frequency


@numba.njit(cache=True)
def newton_step(x, omega, basis, load, load_rate, force, tangent, mass, unit, damping, residual, right):
    """Solve the linearised balance for two right-hand sides by block elimination along the cable.

    Parameters
    ----------
    x, omega
        Displacements of the free particles from rest (n - 1, columns, d), scaled, and angular frequency of the forcing.
    basis
        Values of the harmonics at the samples (N, 4 H + 1).
    load, load_rate
        Harmonics of the loads (n - 1, columns, d) over the square root of the mass, scaled, and their derivative by omega.
    force, tangent
        Filled by :func:`link_samples`.
    mass, unit
        Masses of the free particles (n - 1,) [kg]; factors of forces over the square root of the mass, and of stiffnesses over
        masses, that make them numbers without dimension.
    damping
        Mass-proportional damping without dimension.
    residual
        Filled: residual (n - 1, columns, d).
    right
        Filled: the solutions for minus the residual and for minus its derivative by omega (n - 1, columns d, 2).
    """
    particles, columns, d = x.shape
    harmonics, samples, b = columns // 2, basis.shape[0], columns * d
    previous, after, mean = np.zeros((b, b)), np.zeros((b, b)), np.empty((4 * harmonics + 1, d, d))
    block, eliminated = np.empty((b, b)), np.empty((particles, b, b + 2))
    joint = np.zeros((b, b + 2))
    hill(tangent[0], basis, 0, harmonics + 1, mean, previous)
    for j in range(particles):
        hill(tangent[j + 1], basis, 0, harmonics + 1, mean, after)
        root = math.sqrt(mass[j])
        diagonal_block(previous, after, mass[j] / unit[1], omega, damping, 0.0, harmonics + 1, d, block)
        for c in range(columns):
            k = (c + 1) // 2
            frequency = k * omega
            partner, sign = (c + 1, 1.0) if c % 2 == 1 else (c - 1, -1.0)
            for a in range(d):
                total = 0.0
                for s in range(samples):
                    total += basis[s, c] * (force[j + 1, s, a] - force[j, s, a])
                total *= (1.0 if c == 0 else 2.0) / samples * unit[0] / root
                value, rate = -total - load[j, c, a], -load_rate[j, c, a]
                if c > 0:
                    value += -frequency * frequency * x[j, c, a] + sign * damping * frequency * x[j, partner, a]
                    rate += k * (-2.0 * frequency * x[j, c, a] + sign * damping * x[j, partner, a])
                residual[j, c, a] = value
                joint[c * d + a, b], joint[c * d + a, b + 1] = -value, -rate
        factor = 0.0 if j == particles - 1 else -unit[1] / math.sqrt(mass[j] * mass[j + 1])
        joint[:, :b] = factor * after
        if j > 0:
            back = -unit[1] / math.sqrt(mass[j] * mass[j - 1])
            product = (back * previous) @ eliminated[j - 1]
            block -= product[:, :b]
            joint[:, b:] -= product[:, b:]
        eliminated[j] = np.linalg.solve(block, joint)
        previous, after = after, previous
    right[particles - 1] = eliminated[particles - 1, :, b:]
    for i in range(1, particles):
        j = particles - 1 - i
        right[j] = eliminated[j, :, b:] - np.ascontiguousarray(eliminated[j, :, :b]) @ right[j + 1]


@numba.njit(cache=True)
def determinant(tangent, basis, harmonics, first, omega, damping, mass, unit):
    """Return sign and logarithm of the determinant of the balance of small disturbances (Hill's determinant).

    Parameters
    ----------
    tangent, basis, harmonics
        As in :func:`hill`, of all links (n, N, d, d); number of harmonics H of the orbit.
    first
        0.0 for disturbances of the period of the forcing, 0.5 for those of twice that.
    omega, damping, mass, unit
        As in :func:`newton_step`.
    """
    d, particles = tangent.shape[2], mass.size
    count = harmonics + 1 if first == 0.0 else harmonics
    b = (1 + 2 * harmonics) * d if first == 0.0 else 2 * harmonics * d
    previous, after, mean = np.zeros((b, b)), np.zeros((b, b)), np.empty((4 * harmonics + 1, d, d))
    block, eliminated = np.empty((b, b)), np.empty((b, b))
    sign, total = 1.0, 0.0
    hill(tangent[0], basis, int(2.0 * first), count, mean, previous)
    for j in range(particles):
        hill(tangent[j + 1], basis, int(2.0 * first), count, mean, after)
        diagonal_block(previous, after, mass[j] / unit[1], omega, damping, first, count, d, block)
        if j > 0:
            block += unit[1] / math.sqrt(mass[j] * mass[j - 1]) * (previous @ eliminated)
        one, logarithm = np.linalg.slogdet(block)
        sign *= one
        total += logarithm
        if j < particles - 1:
            eliminated[:] = np.linalg.solve(block, -unit[1] / math.sqrt(mass[j] * mass[j + 1]) * after)
        previous, after = after, previous
    return sign, total


@numba.njit(cache=True)
def _invert(block, inverse):
    """Fill the inverse of a small matrix (d, d)."""
    d = block.shape[0]
    if d == 1:
        inverse[0, 0] = 1.0 / block[0, 0]
    elif d == 2:
        scale = 1.0 / (block[0, 0] * block[1, 1] - block[0, 1] * block[1, 0])
        inverse[0, 0], inverse[1, 1] = scale * block[1, 1], scale * block[0, 0]
        inverse[0, 1], inverse[1, 0] = -scale * block[0, 1], -scale * block[1, 0]
    else:
        inverse[:] = np.linalg.inv(block)


@numba.njit(cache=True)
def _eliminate(tangent, mass, factor, shift, pivots, upper):
    """Factorise T = 1 - shift + factor A of one phase along the chain, by blocks of a particle.

    Parameters
    ----------
    tangent, mass
        Derivatives of the forces of links (n, d, d), masses (n - 1,); A has them over the masses.
    factor, shift
        Numbers.
    pivots, upper
        Filled: inverses of the diagonal blocks, and these times the blocks after them (n - 1, d, d).
    """
    particles, d = mass.size, tangent.shape[1]
    block = np.empty((d, d))
    for j in range(particles):
        for a in range(d):
            for b in range(d):
                block[a, b] = factor / mass[j] * (tangent[j, a, b] + tangent[j + 1, a, b])
            block[a, a] += 1.0 - shift
        if j > 0:
            lower = -factor / math.sqrt(mass[j] * mass[j - 1])
            for a in range(d):
                for b in range(d):
                    for c in range(d):
                        block[a, b] -= lower * tangent[j, a, c] * upper[j - 1, c, b]
        _invert(block, pivots[j])
        if j < particles - 1:
            scale = -factor / math.sqrt(mass[j] * mass[j + 1])
            for a in range(d):
                for b in range(d):
                    total = 0.0
                    for c in range(d):
                        total += pivots[j, a, c] * tangent[j + 1, c, b]
                    upper[j, a, b] = scale * total


@numba.njit(cache=True)
def _add(factor, source, target):
    """Add a multiple of an array to another one."""
    for i in range(target.size):
        target[i] += factor * source[i]


@numba.njit(cache=True)
def _substitute(tangent, mass, factor, pivots, upper, given, solved):
    """Fill `solved`, T^-1 times the rows of `given` (particles d, columns), with the factors of :func:`_eliminate`."""
    particles, d = mass.size, tangent.shape[1]
    solved[:] = 0.0
    for j in range(particles):
        right = given[j * d : (j + 1) * d].copy()
        if j > 0:
            lower = -factor / math.sqrt(mass[j] * mass[j - 1])
            for a in range(d):
                for c in range(d):
                    _add(-lower * tangent[j, a, c], solved[(j - 1) * d + c], right[a])
        for a in range(d):
            for c in range(d):
                _add(pivots[j, a, c], right[c], solved[j * d + a])
    for back in range(1, particles):
        j = particles - 1 - back
        for a in range(d):
            for c in range(d):
                _add(-upper[j, a, c], solved[(j + 1) * d + c], solved[j * d + a])


@numba.njit(cache=True)
def monodromy(tangent, mass, unit, damping, step, matrix):
    """Fill the matrix of the trapezoidal rule over the phases of `tangent`, for disturbances without their damping.

    With T = 1 + step^2 A / 4 and y = T u the rule for u'' = -A u is y_{k+1} = (4 / T_k - 2) y_k - y_{k-1}: of second order and
    stable at any step, however fast waves along the links are.

    Parameters
    ----------
    tangent
        Derivatives of the forces of links by the difference of positions (M, n, d, d) [N/m].
    mass, unit, damping, step
        As in :func:`newton_step`; duration of one of the M steps.
    matrix
        Filled: (2 r, 2 r), from (y_0, y_{-1}) to (y_M, y_{M-1}), r = (n - 1) d.
    """
    phases, links, d = tangent.shape[0], tangent.shape[1], tangent.shape[2]
    particles = links - 1
    r = particles * d
    now, old = np.zeros((r, 2 * r)), np.zeros((r, 2 * r))
    for a in range(r):
        now[a, a], old[a, r + a] = 1.0, 1.0
    factor, shift = 0.25 * step * step * unit[1], 0.0625 * step * step * damping * damping
    pivots, upper, solved = np.empty((particles, d, d)), np.empty((particles, d, d)), np.empty((r, 2 * r))
    for k in range(phases):
        _eliminate(tangent[k], mass, factor, shift, pivots, upper)
        _substitute(tangent[k], mass, factor, pivots, upper, now, solved)
        for a in range(r):
            for i in range(2 * r):
                old[a, i] = 4.0 * solved[a, i] - 2.0 * now[a, i] - old[a, i]
        now, old = old, now
    for a in range(r):
        for i in range(2 * r):
            matrix[a, i], matrix[r + a, i] = now[a, i], old[a, i]
