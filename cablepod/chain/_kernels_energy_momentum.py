"""Compiled energy-momentum steps of the chain (Simo and Tarnow)."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled
from cablepod.chain._kernels_attached import body_drag
from cablepod.chain._kernels_drag import drag_forces, drag_tangent
from cablepod.chain._kernels_generalized_alpha import (
    MAX_ITERATIONS,
    REMAINDER,
    _add_loads,
    _correct,
    _correction,
    _is_inside,
    _remainder,
    _repeat,
    _set_ends,
    _sum,
    _update_extremes,
    _with_attached,
    _with_modal_damping,
)
from cablepod.chain._kernels_links import link_forces_conserving


@compiled
def energy_momentum(
    x, v, first, last, k, length, inverse_squares, mass, damping, loads, patterns, factors, viscosity,
    tension_damping, modal, particles, attached, wind, wind_places, drag, bodies, lower, upper, step, rotation_tolerance,
    rounding, bound, start, steps, save_steps, saved, low, high,
):  # fmt: skip
    """Advance a chain by `steps` steps of the energy-momentum method (Simo and Tarnow 1992).

    The forces of the links over a step are difference quotients of their energies.  With ends and loads at rest, the total energy
    is then conserved at any step, up to the residual of Newton's method.  Parameters and result as in ``generalized_alpha``;
    time-dependent loads are means of both ends of the step.  The drag is that of the mean position and velocity, in the wind at
    the middle of the step, `wind_places` (steps,).  The residual has a systematic sign and accumulates in the energy: iterations
    continue until a correction rotates the links by `rotation_tolerance`, or is below `rounding` and not decreasing.
    """
    dims, count = x.shape
    f, s = np.zeros(dims * count + 1), np.zeros((3 if dims == 2 else 6, count + 1))
    d, b, fixed_force = np.zeros(x.size), np.zeros((dims, count)), np.zeros(x.size)
    workspace = np.zeros((2 * dims, count))
    trial, last_displacement = x.copy(), step * v.reshape(-1)
    masses, per_length = _repeat(mass, dims), _repeat(np.append(1.0 / length, 0.0), dims)
    flat_x, flat_v, flat_trial, steady = x.reshape(-1), v.reshape(-1), trial.reshape(-1), loads.reshape(-1)
    diagonal = masses * (2.0 / (step * step) + (0.0 if damping is None else damping / step))
    solved = diagonal + modal.half_ratio * 2.0 / (step * step) * masses
    damping_force = np.zeros_like(x)
    middle, rates = np.zeros_like(x), np.zeros_like(x)
    air_force, air_damping, own = np.zeros_like(x), np.zeros(count), np.zeros((3 * dims - 3, count))
    attached_force = np.zeros_like(x)
    iterations, save = 0, 0
    for i in range(steps):
        if save < save_steps.size and save_steps[save] == start + i:
            saved[save, 0] = x
            saved[save, 1] = v
            save += 1
        if low is not None:
            _update_extremes(x, low, high, inverse_squares, k, length)
        for q in range(d.size):
            # predictor: last displacement plus twice the difference of step * velocity from it
            d[q] = 2.0 * step * flat_v[q] - last_displacement[q]
            flat_trial[q] = flat_x[q] + d[q]
            fixed_force[q] = steady[q] + 2.0 * masses[q] * flat_v[q] / step
        if patterns is not None:
            _add_loads(fixed_force, patterns, 0.5 * (factors[i] + factors[i + 1]))
        _set_ends(trial, lower, upper, i + 1)
        converged, last_rotation = False, np.inf
        for _ in range(MAX_ITERATIONS):
            iterations += 1
            link_forces_conserving(x, trial, k, length, inverse_squares, viscosity, tension_damping, 1.0 / step, f, s)
            known = fixed_force
            if wind is not None or attached is not None or modal.matrix.size > 0:
                for c in range(dims):
                    for p in range(count):
                        middle[c, p] = 0.5 * (x[c, p] + trial[c, p])
                        rates[c, p] = (trial[c, p] - x[c, p]) / step
            if modal.matrix.size > 0:
                known = _with_modal_damping(modal, rates, first, 0.5, fixed_force, damping_force, s)
            if wind is not None:
                drag_forces(middle, rates, wind, wind_places[i], drag, first, last, air_force, air_damping)
                drag_tangent(middle, first, last, 1.0 / step, air_force, air_damping, own)
                if bodies is not None:
                    body_drag(rates, wind, wind_places[i], bodies, air_force, 1.0 / step, own)
                known = _sum(air_force, known)
            if attached is not None:
                if wind is None:
                    own[:] = 0.0
                known = _with_attached(particles, attached, middle, rates, 0.5, 1.0 / step, known, attached_force, own)
            if wind is not None or attached is not None:
                rotation = _correction(f, s, known, diagonal, solved, own, d, b, workspace, first, last, per_length)
            else:
                rotation = _correction(f, s, known, diagonal, solved, None, d, b, workspace, first, last, per_length)
            _correct(d, b.reshape(-1), flat_x, flat_trial)
            _set_ends(trial, lower, upper, i + 1)
            before = last_rotation if last_rotation < np.inf else 0.0
            remainder = 0.0 if wind is None and modal.matrix.size == 0 else _remainder(rotation, before)
            small = rotation <= rotation_tolerance and remainder <= REMAINDER * rotation_tolerance
            if small or (rotation <= rounding and rotation > 0.5 * last_rotation):
                converged = True
                break
            if not rotation < 1e300:
                break
            last_rotation = rotation
        if not converged:
            return i, iterations
        for q in range(d.size):
            flat_v[q] = 2.0 * d[q] / step - flat_v[q]
            last_displacement[q] = d[q]
            flat_x[q] = flat_trial[q]
        if not _is_inside(x, bound):
            return i + 1, iterations
    return steps, iterations
