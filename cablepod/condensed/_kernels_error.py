"""Compiled integration of the linearised error equation, driven by the residual of the enriched model."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_exact import exact_force
from cablepod.condensed._kernels_layout import CLOSURE_ROWS


@compiled
def error_growth(
    q, q_dot, q_ddot, boundary_data, step, damping, stiffness, slopes, n_in_plane, chordwise_force_patterns, weights,
    green, load_projection, inertia, initial_error, guess, stretch, sigma, mean_squares,
):  # fmt: skip
    """Integrate the linearised error equation by the trapezoidal rule on sampled instants.

    Parameters
    ----------
    q, q_dot, q_ddot
        Motion of the reduced model in the coordinates of the enriched one, with rates and accelerations (samples, r).
    step
        Interval of the samples [s].
    initial_error
        Error at the start (r,).
    sigma
        Relative arc length of the particles (n + 1,).
    mean_squares
        Filled: mean square of the error over the particles (samples,) [m^2], of deflection and chordwise displacement; inf from
        the sample on where the matrix became singular.

    The other parameters are those of :func:`cablepod.condensed._kernels_exact.exact_force` for the enriched model.
    """
    r, m = slopes.shape
    f, tangent, mass = np.empty(r), np.empty((r, r)), np.empty((r, r))
    work, slope, slope_rate, stretch_jacobian = (
        np.empty((CLOSURE_ROWS, m)),
        np.empty((2, m)),
        np.empty((2, m)),
        np.empty((2 * r, m)),
    )
    error, error_rate, error_acceleration, predicted, error_slope = (
        initial_error.copy(),
        np.zeros(r),
        np.zeros(r),
        np.empty(r),
        np.empty((2, m)),
    )
    quarter_step_squared = 0.25 * step * step
    for i in range(q.shape[0]):
        guess = exact_force(
            q[i], q_dot[i], boundary_data, i, slopes, None, n_in_plane, chordwise_force_patterns, weights, stiffness,
            green, load_projection, inertia, guess, stretch, work, slope, slope_rate, stretch_jacobian, f, tangent,
            mass,
        )  # fmt: skip
        for j in range(r):
            predicted[j] = (
                error[j] if i == 0 else error[j] + step * error_rate[j] + quarter_step_squared * error_acceleration[j]
            )
        for j in range(r):
            # residual, minus damping and stiffness of the predicted error
            total = f[j]
            for k in range(r):
                known_rate = q_dot[i, k] if i == 0 else q_dot[i, k] + error_rate[k] + 0.5 * step * error_acceleration[k]
                total -= mass[j, k] * (q_ddot[i, k] + damping * known_rate) + tangent[j, k] * predicted[k]
            f[j] = total
        for j in range(r):
            for k in range(r):
                if i:
                    mass[j, k] = (1.0 + 0.5 * step * damping) * mass[j, k] + quarter_step_squared * tangent[j, k]
        if not _solve(mass, f):
            mean_squares[i:] = np.inf
            return
        for j in range(r):
            if i:
                error[j] = predicted[j] + quarter_step_squared * f[j]
                error_rate[j] += 0.5 * step * (error_acceleration[j] + f[j])
            error_acceleration[j] = f[j]
        for j in range(m):
            error_slope[0, j] = 0.0
            error_slope[1, j] = 0.0
        for k in range(r):
            plane = 0 if k < n_in_plane else 1
            for j in range(m):
                error_slope[plane, j] += slopes[k, j] * error[k]
        reach = 0.0
        for j in range(m):
            reach -= weights[j] * (slope[0, j] * error_slope[0, j] + slope[1, j] * error_slope[1, j]) / stretch[j]
        normal, across, along, total = 0.0, 0.0, 0.0, 0.0
        for j in range(m):
            normal += weights[j] * error_slope[0, j]
            across += weights[j] * error_slope[1, j]
            along -= weights[j] * (slope[0, j] * error_slope[0, j] + slope[1, j] * error_slope[1, j]) / stretch[j]
            shift = along - sigma[j + 1] * reach
            total += normal * normal + across * across + shift * shift
        mean_squares[i] = total / (m + 1)
