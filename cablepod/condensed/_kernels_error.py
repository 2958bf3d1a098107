"""Compiled growth of the error that the residual of a richer model drives."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_exact import exact_force


@compiled
def error_growth(
    y, rate, acc, rows, step, damping, stiffness, slopes, plane, taus, h, green, pushes, inertia, first, guess, z, sigma, sizes
):  # fmt: skip
    """Integrate the error that the residual of a richer model drives, by the trapezoidal rule on sampled instants.

    Parameters
    ----------
    y, rate, acc
        Motion of the poorer model in the coordinates of the richer one, at the samples (samples, r).
    step
        Distance of the samples [s].
    first
        Error at the start (r,).
    sigma
        Relative arc length of the particles (n + 1,).
    sizes
        Filled: mean square of the error over the particles (samples,) [m^2], in the deflection and along the chord.

    The other parameters are those of :func:`exact_force` for the richer model.
    """
    r, m = slopes.shape
    f, tangent, mass = np.empty(r), np.empty((r, r)), np.empty((r, r))
    work, slope, speed, lever = np.empty((6, m)), np.empty((2, m)), np.empty((2, m)), np.empty((2 * r, m))
    error, v, a, ahead, moved = first.copy(), np.zeros(r), np.zeros(r), np.empty(r), np.empty((2, m))
    quarter = 0.25 * step * step
    for i in range(y.shape[0]):
        guess = exact_force(
            y[i], rate[i], rows, i, slopes, None, plane, taus, h, stiffness, green, pushes, inertia, guess, z, work, slope,
            speed, lever, f, tangent, mass,
        )  # fmt: skip
        for j in range(r):
            ahead[j] = error[j] if i == 0 else error[j] + step * v[j] + quarter * a[j]
        for j in range(r):
            # the residual, less what the error so far pulls back
            total = f[j]
            for k in range(r):
                known = rate[i, k] if i == 0 else rate[i, k] + v[k] + 0.5 * step * a[k]
                total -= mass[j, k] * (acc[i, k] + damping * known) + tangent[j, k] * ahead[k]
            f[j] = total
        for j in range(r):
            for k in range(r):
                if i:
                    mass[j, k] = (1.0 + 0.5 * step * damping) * mass[j, k] + quarter * tangent[j, k]
        if not _solve(mass, f):
            sizes[i:] = np.inf
            return
        for j in range(r):
            if i:
                error[j] = ahead[j] + quarter * f[j]
                v[j] += 0.5 * step * (a[j] + f[j])
            a[j] = f[j]
        for j in range(m):
            moved[0, j] = 0.0
            moved[1, j] = 0.0
        for k in range(r):
            s = 0 if k < plane else 1
            for j in range(m):
                moved[s, j] += slopes[k, j] * error[k]
        reach = 0.0
        for j in range(m):
            reach -= h[j] * (slope[0, j] * moved[0, j] + slope[1, j] * moved[1, j]) / z[j]
        normal, across, along, total = 0.0, 0.0, 0.0, 0.0
        for j in range(m):
            normal += h[j] * moved[0, j]
            across += h[j] * moved[1, j]
            along -= h[j] * (slope[0, j] * moved[0, j] + slope[1, j] * moved[1, j]) / z[j]
            shift = along - sigma[j + 1] * reach
            total += normal * normal + across * across + shift * shift
        sizes[i] = total / (m + 1)
