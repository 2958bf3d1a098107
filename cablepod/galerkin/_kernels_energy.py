"""Compiled strain energy of the Galerkin model: gradients in polynomial form and on the links."""

from __future__ import annotations

import math

from cablepod._jit import FAST_DIVISION, compiled

#: Form in which the strain energy is evaluated: polynomial of law (21), or a sum over links by law (21) or the linear law.
POLYNOMIAL, GREEN_LINKS, LINEAR_LINKS = 0, 1, 2


@compiled(fastmath=FAST_DIVISION)
def polynomial_gradient(y, factor, offset, first, second, monomials, monomial_gradient, gradient):
    """Fill the gradient of the energy of law (21) with respect to y from its polynomial form; return the energy [J]."""
    count = y.size
    for j in range(count):
        monomials[j] = y[j]
    for pair in range(first.size):
        monomials[count + pair] = y[first[pair]] * y[second[pair]]
    rows, total = factor.shape
    for c in range(total):
        monomial_gradient[c] = 0.0
    energy = 0.0
    # whole rows, although the factor is upper triangular: a loop from i is not vectorised, and a slice costs more
    for i in range(rows):
        s = offset[i]
        for c in range(total):
            s += factor[i, c] * monomials[c]
        energy += 0.5 * s * s
        for c in range(total):
            monomial_gradient[c] += s * factor[i, c]
    for j in range(count):
        gradient[j] = monomial_gradient[j]
    for pair in range(first.size):
        slope = monomial_gradient[count + pair]
        gradient[first[pair]] += slope * y[second[pair]]
        gradient[second[pair]] += slope * y[first[pair]]
    return energy


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


@compiled(fastmath=FAST_DIVISION)
def _stresses(law, e, stiffness, s):
    """Fill s with the derivatives of the energies by the strains e; return the total energy [J].

    By the linear law a slack link carries no tension.
    """
    energy = 0.0
    if law == LINEAR_LINKS:
        for j in range(e.size):
            xi = math.sqrt(1.0 + 2.0 * e[j])
            elongation = 2.0 * e[j] / (1.0 + xi)
            elongation = elongation if elongation > 0.0 else 0.0 * xi  # keeps nan
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
