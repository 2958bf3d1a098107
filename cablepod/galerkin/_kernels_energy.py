"""Compiled strain energy of the Galerkin model: gradients in polynomial form and on the links."""

import math

from cablepod._jit import FAST_DIVISION, compiled

#: Form in which the strain energy is evaluated: polynomial of law (21), or a sum over links by law (21) or the linear law.
POLYNOMIAL, GREEN_LINKS, LINEAR_LINKS = 0, 1, 2


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _set_coordinates(y, z, ends, row, coupling):
    """Fill the coordinates y = (q, d) of a projection z = q + C^T d and a row of displacements d of the ends."""
    moving, modes = coupling.shape
    for k in range(modes):
        y[k] = z[k]
    for f in range(moving):
        displacement = ends[row, f]
        y[modes + f] = displacement
        for k in range(modes):
            y[k] -= displacement * coupling[f, k]


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _forces_of_ends(gradient, coupling, forces):
    """Fill the forces of the ends along their displacements, dV/dd - C dV/dq."""
    moving, modes = coupling.shape
    for f in range(moving):
        total = gradient[modes + f]
        for k in range(modes):
            total -= coupling[f, k] * gradient[k]
        forces[f] = total


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _fill_monomials(y, first, second, monomials):
    """Fill the coordinates, then their products of the given pairs."""
    count = y.size
    for j in range(count):
        monomials[j] = y[j]
    for pair in range(first.size):
        monomials[count + pair] = y[first[pair]] * y[second[pair]]


@compiled(fastmath=FAST_DIVISION)
def polynomial_energy(y, factor, offset, first, second, monomials):
    """Return the energy of law (21) |R m + e|^2 / 2 [J]: a sum of squares, which loses no digit where K is large."""
    _fill_monomials(y, first, second, monomials)
    energy = 0.0
    for i in range(offset.size):
        s = offset[i]
        for c in range(factor.shape[1]):
            s += factor[i, c] * monomials[c]
        energy += 0.5 * s * s
    return energy


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def polynomial_gradient(y, gram, linear, first, second, monomials, monomial_gradient, gradient):
    """Fill the gradient of the energy of law (21) with respect to y: (dm/dy)^T (R^T R m + R^T e).

    Its rounding is that of R^T (R m + e), which costs twice as much.  `gram` is R^T R and `linear` is R^T e, both filled up with
    zeros to the size of `monomials`.
    """
    _fill_monomials(y, first, second, monomials)
    count, total = y.size, gram.shape[0]
    for i in range(total):
        s = linear[i]
        for c in range(total):
            s += gram[i, c] * monomials[c]
        monomial_gradient[i] = s
    for j in range(count):
        gradient[j] = monomial_gradient[j]
    for pair in range(first.size):
        slope = monomial_gradient[count + pair]
        gradient[first[pair]] += slope * y[second[pair]]
        gradient[second[pair]] += slope * y[first[pair]]


@compiled(fastmath=FAST_DIVISION)
def _strains(y, shape, strain, field_slopes, active_axes, slopes, e):
    """Fill the slopes of the links (dims, n) and their strains e = (xi^2 - 1)/2 (n,), expanded about the mean shape."""
    dims, n = shape.shape
    for j in range(n):
        e[j] = strain[j]
    for c in range(dims):
        for j in range(n):
            slopes[c, j] = 0.0
        for k in range(y.size):
            if active_axes[k, c]:
                yk = y[k]
                for j in range(n):
                    slopes[c, j] += yk * field_slopes[k, c, j]
        for j in range(n):
            e[j] += (shape[c, j] + 0.5 * slopes[c, j]) * slopes[c, j]
            slopes[c, j] += shape[c, j]


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _elongation(e):
    """Return xi - 1 at a strain e = (xi^2 - 1) / 2 without cancellation, 0 for slack links, nan for nan; and xi."""
    xi = math.sqrt(1.0 + 2.0 * e)
    elongation = 2.0 * e / (1.0 + xi)
    return elongation if elongation > 0.0 else 0.0 * xi, xi


@compiled(fastmath=FAST_DIVISION)
def _stresses(law, e, stiffness, s):
    """Fill s with the derivatives of the energies by the strains e; return the total energy [J].

    By the linear law a slack link carries no tension.
    """
    energy = 0.0
    if law == LINEAR_LINKS:
        for j in range(e.size):
            elongation, xi = _elongation(e[j])
            s[j] = stiffness[j] * elongation / xi
            energy += 0.5 * stiffness[j] * elongation * elongation
    else:
        for j in range(e.size):
            s[j] = stiffness[j] * e[j]
            energy += 0.5 * s[j] * e[j]
    return energy


@compiled(fastmath=FAST_DIVISION)
def link_gradient(y, law, shape, strain, field_slopes, active_axes, stiffness, slopes, e, s, gradient):
    """Fill the gradient of the energy with respect to y as a sum over links; return the energy [J]."""
    dims, n = shape.shape
    _strains(y, shape, strain, field_slopes, active_axes, slopes, e)
    energy = _stresses(law, e, stiffness, s)
    for c in range(dims):
        for j in range(n):
            slopes[c, j] *= s[j]
    for k in range(y.size):
        total = 0.0
        for c in range(dims):
            if active_axes[k, c]:
                for j in range(n):
                    total += slopes[c, j] * field_slopes[k, c, j]
        gradient[k] = total
    return energy
