"""Compiled equilibrium of the chain: moduli of links by both laws, Newton's method on the force in the first link."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled


@compiled
def green_strain(load):
    """Solve xi (xi^2 - 1)/2 = load for the strain xi - 1 of law (21); `load` is tension over stiffness.

    With e = xi - 1 the equation reads e (1 + e) (1 + e/2) = load.  The left side is convex and increasing, so that Newton's
    method from e = load decreases monotonically to the solution, without cancellation for small strains.
    """
    e = load
    for _ in range(60):
        e_next = e - (e * (1.0 + e) * (1.0 + 0.5 * e) - load) / (1.0 + 3.0 * e + 1.5 * e * e)
        if not e_next < e:
            break
        e = e_next
    return e


@compiled
def secant_modulus(tension, stiffness, green):
    """Return tension over strain of a link [N]: K, by law (21) K (1 + e) (1 + e/2)."""
    if not green:
        return stiffness
    e = green_strain(tension / stiffness)
    return stiffness * (1.0 + e) * (1.0 + 0.5 * e)


@compiled
def secant_moduli(tensions, stiffness, green, out):
    """Fill `out` (links,) with the :func:`secant_modulus` of each link, of an axial stiffness (links,) [N]."""
    for j in range(tensions.size):
        out[j] = secant_modulus(tensions[j], stiffness[j], green)


@compiled
def end_gap(force, loads, length, stiffness, green, gap, hessian):
    """Add the end position of a chain with a given first link force to `gap`, and compute the Jacobian `hessian`.

    Returns the complementary energy without its linear part, sum l c(|F|), with c = T + T^2 / (2 K) by the linear law and
    c = T xi - K (xi^2 - 1)^2 / 8 by law (21).
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
        norm = math.sqrt(square)
        if green:
            e = green_strain(norm / stiffness[j])
            strain = e * (1.0 + 0.5 * e)
            energy += length[j] * (norm * (1.0 + e) - 0.5 * stiffness[j] * strain * strain)
        else:
            energy += length[j] * norm * (1.0 + 0.5 * norm / stiffness[j])
        if norm == 0.0:
            continue
        secant = secant_modulus(norm, stiffness[j], green)
        for c in range(dims):
            gap[c] += length[j] * (f[c] / norm + f[c] / secant)
            for d in range(dims):
                hessian[c, d] -= length[j] * (f[c] / norm) * (f[d] / norm) / norm
            hessian[c, c] += length[j] * (1.0 / norm + 1.0 / secant)
        if green:
            # along the link the tangent modulus enters: d xi / dT = 1 / (K (3 xi^2 - 1) / 2)
            compliance = 1.0 / (stiffness[j] * (1.0 + 3.0 * e + 1.5 * e * e)) - 1.0 / secant
            for c in range(dims):
                for d in range(dims):
                    hessian[c, d] += length[j] * (f[c] / norm) * (f[d] / norm) * compliance
    return energy


@compiled
def _solve_small(matrix, right):
    """Solve a positive definite system of 2 or 3 unknowns in place, in a fixed order, so that dimensions agree bit for bit."""
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
    """Solve for the force in the first link of a chain at rest between two points, by Newton's method.

    The force minimises the strictly convex complementary energy, sum l c(|F|) - F . chord, with c as in :func:`end_gap`.  Steps
    are shortened until the energy decreases, so that the method converges from any start unless a link has no force at rest.

    Parameters
    ----------
    chord : float array (dims,)
        From the lower to the upper end [m].
    loads : float array (n - 1, dims)
        Forces on the inner particles [N].
    length : float array (n,)
        Unstretched lengths of the links [m].
    stiffness : float array (n,)
        Axial stiffness of the links [N]; infinite for rigid ones.
    green : bool
        Whether law (21) holds instead of the linear one.
    force : float array (dims,)
        Initial guess of the force in the first link, pointing up the chain; overwritten by the solution [N].

    Returns
    -------
    float
        Largest component of the remaining gap [m].
    """
    dims = chord.size
    gap, trial_gap, move, trial = np.empty(dims), np.empty(dims), np.empty(dims), np.empty(dims)
    hessian, trial_hessian = np.empty((dims, dims)), np.empty((dims, dims))
    for c in range(dims):
        gap[c] = -chord[c]
    energy = end_gap(force, loads, length, stiffness, green, gap, hessian)
    energy -= _dot(force, chord)
    for _ in range(200):
        for c in range(dims):
            move[c] = -gap[c]
        _solve_small(hessian.copy(), move)
        slope = _dot(gap, move)
        fraction = 1.0
        gap_norm = _max_norm(gap)
        for _ in range(60):
            for c in range(dims):
                trial[c] = force[c] + fraction * move[c]
                trial_gap[c] = -chord[c]
            trial_energy = end_gap(trial, loads, length, stiffness, green, trial_gap, trial_hessian)
            trial_energy -= _dot(trial, chord)
            if trial_energy <= energy + 1e-4 * fraction * slope or _max_norm(trial_gap) < 0.5 * gap_norm:
                break
            fraction *= 0.5
        if not _max_norm(trial_gap) < gap_norm and _max_norm(move) <= 1e-9 * _max_norm(force):
            break  # the gap is at rounding
        for c in range(dims):
            force[c], gap[c] = trial[c], trial_gap[c]
            for d in range(dims):
                hessian[c, d] = trial_hessian[c, d]
        energy = trial_energy
        if _max_norm(gap) == 0.0:
            break
    return _max_norm(gap)


@compiled
def _max_norm(vector):
    """Return the maximum norm."""
    largest = 0.0
    for c in range(vector.size):
        if not abs(vector[c]) <= largest:
            largest = abs(vector[c])
    return largest


@compiled
def _dot(a, b):
    """Return the inner product."""
    total = 0.0
    for c in range(a.size):
        total += a[c] * b[c]
    return total
