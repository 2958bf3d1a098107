"""Compiled equilibrium of the chain: Newton's method on the force in the first link."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.chain._kernels_explicit import green_strain, secant_modulus


@compiled
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


@compiled
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


@compiled
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


@compiled
def _size(vector):
    largest = 0.0
    for c in range(vector.size):
        if not abs(vector[c]) <= largest:
            largest = abs(vector[c])
    return largest


@compiled
def _dot(a, b):
    total = 0.0
    for c in range(a.size):
        total += a[c] * b[c]
    return total
