"""The Galerkin model: velocity Verlet in mass-orthonormal amplitudes, with law (21) packed or the linear law by links.

Law (21) makes the strain quadratic in the coordinates y (amplitudes q, then the displacements of the ends), so with the
monomials m(y) = [y, y_j y_k] the energy is a sum of squares, V = |R m + r|^2 / 2: R is the triangular factor of the packed Gram
matrix, found once; energy is never negative and no digit is squared away.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Sums may be reordered here, which lets them vectorise; non-finite numbers keep their meaning.
# Without the interpreter lock, so that runs in several threads go on side by side.
_options: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "nogil": True,
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
}


@njit(**_options)
def _green_gradient(y, factor, offset, first, second, monomials, slopes, gradient):
    """Gradient of the energy of law (21) by the coordinates y."""
    count = y.size
    for j in range(count):
        monomials[j] = y[j]
    for pair in range(first.size):
        monomials[count + pair] = y[first[pair]] * y[second[pair]]
    rows, total = factor.shape
    for c in range(total):
        slopes[c] = 0.0
    # whole rows, though the factor is zero below the diagonal: a loop that begins at i is not vectorised, a slice costs more
    for i in range(rows):
        s = offset[i]
        for c in range(total):
            s += factor[i, c] * monomials[c]
        for c in range(total):
            slopes[c] += s * factor[i, c]
    for j in range(count):
        gradient[j] = slopes[j]
    for pair in range(first.size):
        slope = slopes[count + pair]
        gradient[first[pair]] += slope * y[second[pair]]
        gradient[second[pair]] += slope * y[first[pair]]


@njit(**_options)
def _linear_gradient(y, shape, rates, stiffness, reach, gradient):
    """Gradient of the energy of the linear law, link by link; a link that is slack carries nothing.

    `shape` (dims, n) and `rates` (coordinates, dims, n) are differences over the links divided by their lengths,
    `stiffness` (n,) is K l.
    """
    dims, n = shape.shape
    for c in range(dims):
        for j in range(n):
            reach[c, j] = shape[c, j]
        for k in range(y.size):
            for j in range(n):
                reach[c, j] += y[k] * rates[k, c, j]
    for j in range(n):
        square = 0.0
        for c in range(dims):
            square += reach[c, j] * reach[c, j]
        s = stiffness[j] * (1.0 - 1.0 / math.sqrt(square))
        s = s if s > 0.0 else 0.0
        for c in range(dims):
            reach[c, j] *= s
    for k in range(y.size):
        total = 0.0
        for c in range(dims):
            for j in range(n):
                total += reach[c, j] * rates[k, c, j]
        gradient[k] = total


@njit(**_options)
def verlet(
    q, velocity, step, decay, kick, drive, frozen, packed, linked, steps, start, save_steps, saved, saved_half
):  # fmt: skip
    """Advance the amplitudes by `steps` steps of velocity Verlet in leapfrog form.

    Parameters
    ----------
    q, velocity : float arrays (modes,)
        Mass-orthonormal amplitudes at step `start` [kg^1/2 m] and their rates half a step before; advanced in place.
    step : float
        [s].
    decay : float or None
        exp(-damping step); None without damping.
    kick : float
        Step, or (1 - decay) / damping.
    drive : float array (steps + 1 or 1, modes)
        Generalised loads at the steps from `start` on; one row if they stand still.
    frozen : float array (steps + 1, displacements) or None
        Displacements of the ends at the steps.
    packed : tuple (factor, offset, first, second) or None
        Law (21): R (rows, monomials), r (rows,), and the pairs of coordinates in the quadratic monomials.
    linked : tuple (shape, rates, stiffness) or None
        The linear law, see the gradient above.  Exactly one of `packed` and `linked` is None.
    steps, start : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save.
    saved : float array (saves, modes)
        Filled with amplitudes.
    saved_half : float array (saves, 2, modes)
        Filled with the rates half a step before and after.
    """
    modes = q.size
    moving = 0 if frozen is None else frozen.shape[1]
    y = np.zeros(modes + moving)
    gradient = np.zeros(modes + moving)
    if packed is not None:
        factor, offset, first, second = packed
        monomials, slopes = np.zeros(factor.shape[1]), np.zeros(factor.shape[1])
    if linked is not None:
        shape, rates, stiffness = linked
        reach = np.empty(shape.shape)
    save = 0
    varying = drive.shape[0] > 1
    for i in range(steps):
        for k in range(modes):
            y[k] = q[k]
        if frozen is not None:
            for k in range(moving):
                y[modes + k] = frozen[i, k]
        if packed is not None:
            _green_gradient(y, factor, offset, first, second, monomials, slopes, gradient)
        if linked is not None:
            _linear_gradient(y, shape, rates, stiffness, reach, gradient)
        saving = save < save_steps.size and save_steps[save] == start + i
        if saving:
            for k in range(modes):
                saved[save, k] = q[k]
                saved_half[save, 0, k] = velocity[k]
        row = i if varying else 0
        for k in range(modes):
            push = kick * (drive[row, k] - gradient[k])
            if decay is None:
                velocity[k] += push
            else:
                velocity[k] = decay * velocity[k] + push
        if saving:
            for k in range(modes):
                saved_half[save, 1, k] = velocity[k]
            save += 1
        for k in range(modes):
            q[k] += step * velocity[k]
