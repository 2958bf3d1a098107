"""Compiled strain energy of the Galerkin model: gradients in polynomial form and on the links."""

from __future__ import annotations

import math

from cablepod._jit import FAST_DIVISION, compiled

# Sums may be reordered here, which lets them vectorise; non-finite numbers keep their meaning.
# Without the interpreter lock, so that runs in several threads go on side by side.
#: How the energy is evaluated.
PACKED, GREEN_LINKS, LINEAR_LINKS = 0, 1, 2


@compiled(fastmath=FAST_DIVISION)
def packed_gradient(y, factor, offset, first, second, monomials, slopes, gradient):
    """Gradient of the energy of law (21) by the coordinates y, from packed coefficients; returns the energy."""
    count = y.size
    for j in range(count):
        monomials[j] = y[j]
    for pair in range(first.size):
        monomials[count + pair] = y[first[pair]] * y[second[pair]]
    rows, total = factor.shape
    for c in range(total):
        slopes[c] = 0.0
    energy = 0.0
    # whole rows, though the factor is zero below the diagonal: a loop that begins at i is not vectorised, a slice costs more
    for i in range(rows):
        s = offset[i]
        for c in range(total):
            s += factor[i, c] * monomials[c]
        energy += 0.5 * s * s
        for c in range(total):
            slopes[c] += s * factor[i, c]
    for j in range(count):
        gradient[j] = slopes[j]
    for pair in range(first.size):
        slope = slopes[count + pair]
        gradient[first[pair]] += slope * y[second[pair]]
        gradient[second[pair]] += slope * y[first[pair]]
    return energy


@compiled(fastmath=FAST_DIVISION)
def _strains(y, shape, strain, rates, used, reach, e):
    """Slopes of the links `reach` (dims, n) and their strains (xi^2 - 1)/2, about the mean shape."""
    dims, n = shape.shape
    for j in range(n):
        e[j] = strain[j]
    for c in range(dims):
        for j in range(n):
            reach[c, j] = 0.0
        for k in range(y.size):
            if used[k, c]:
                yk = y[k]
                for j in range(n):
                    reach[c, j] += yk * rates[k, c, j]
        for j in range(n):
            e[j] += (shape[c, j] + 0.5 * reach[c, j]) * reach[c, j]
            reach[c, j] += shape[c, j]


@compiled(fastmath=FAST_DIVISION)
def _stresses(law, e, stiffness, s):
    """Fill s with the derivatives of the energies of the rows by their strains e; returns the energy.

    A slack link carries nothing.
    """
    energy = 0.0
    if law == LINEAR_LINKS:
        for j in range(e.size):
            xi = math.sqrt(1.0 + 2.0 * e[j])
            longer = 2.0 * e[j] / (1.0 + xi)
            longer = longer if longer > 0.0 else 0.0 * xi  # not a number stays so
            s[j] = stiffness[j] * longer / xi
            energy += 0.5 * stiffness[j] * longer * longer
    else:
        for j in range(e.size):
            s[j] = stiffness[j] * e[j]
            energy += 0.5 * s[j] * e[j]
    return energy


@compiled(fastmath=FAST_DIVISION)
def link_gradient(y, law, shape, strain, rates, used, stiffness, reach, e, s, gradient):
    """Gradient of the energy by the coordinates y, link by link; returns the energy."""
    dims, n = shape.shape
    _strains(y, shape, strain, rates, used, reach, e)
    energy = _stresses(law, e, stiffness, s)
    for c in range(dims):
        for j in range(n):
            reach[c, j] *= s[j]
    for k in range(y.size):
        total = 0.0
        for c in range(dims):
            if used[k, c]:
                for j in range(n):
                    total += reach[c, j] * rates[k, c, j]
        gradient[k] = total
    return energy
