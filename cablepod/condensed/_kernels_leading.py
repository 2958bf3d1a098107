"""Compiled forces, equilibrium and explicit steps of the condensed model to leading order."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import REORDERED_FUSED, compiled
from cablepod.condensed._kernels_closure import MAX_ITERATIONS
from cablepod.condensed._kernels_dense import _solve
from cablepod.condensed._kernels_drag import (
    AIR_ROWS,
    _add_drag_at,
    _add_tension_damping,
    _extrapolate_drag,
    _weights_of_drag,
)
from cablepod.condensed._kernels_layout import (
    LINK_FORCE,
    LINK_ROWS,
    MIN_FORCE,
    MIN_FORCE_STEP,
    SLOPE_IN_PLANE,
    SLOPE_OUT_OF_PLANE,
)
from cablepod.condensed._kernels_step import _monitor_frequency

#: Maximum number of links whose tensions are computed one by one (vectorised loops only pay for more).
SCALAR_LINK_LIMIT = 6
#: Relative tolerance of the equilibrium: last Newton correction over the deflection.
EQUILIBRIUM_RTOL = 1e-9
#: Relative Newton correction below which only rounding is left.
ROUNDING_RTOL = 1e-14


# --- forces -----------------------------------------------------------------------------------------------------------


@compiled(inline="always")
def _straight_tension(boundary_data, row, mean_chordwise_forces, stiffness, length):
    """Return H of a cable without deflection [N]."""
    chord_tension = stiffness * (boundary_data[row, 0] / length - 1.0)
    for a in range(mean_chordwise_forces.size):
        chord_tension -= boundary_data[row, 1 + a] * mean_chordwise_forces[a]
    return chord_tension


@compiled(inline="always")
def _chord_tension(q, boundary_data, row, kappa, mean_chordwise_forces, stiffness, length):
    """Return H [N] by the closure to leading order."""
    stretching = 0.0
    for i in range(q.size):
        stretching += kappa[i] * q[i] * q[i]
    straight = _straight_tension(boundary_data, row, mean_chordwise_forces, stiffness, length)
    return straight + 0.5 * stiffness / length * stretching


@compiled(inline="always")
def _leading_acceleration(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, load_projection, f):
    """Fill the undamped accelerations f (r,) for a given H."""
    patterns = geometric_stiffness.shape[0]
    for i in range(q.size):
        f[i] = -chord_tension * kappa[i] * q[i]
    for a in range(patterns):
        g = boundary_data[row, 1 + a]
        for i in range(q.size):
            total = 0.0
            for j in range(q.size):
                total += geometric_stiffness[a, i, j] * q[j]
            f[i] -= g * total
    for a in range(load_projection.shape[0]):
        g = boundary_data[row, 1 + patterns + a]
        for i in range(q.size):
            f[i] += g * load_projection[a, i]


@compiled(forceinline=True, literal=False)
def _leading_tangent(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, stiffness, length, tangent):
    """Fill the negative derivative of the accelerations by q (r, r)."""
    for i in range(q.size):
        for j in range(q.size):
            total = stiffness / length * kappa[i] * q[i] * kappa[j] * q[j]
            for a in range(geometric_stiffness.shape[0]):
                total += boundary_data[row, 1 + a] * geometric_stiffness[a, i, j]
            tangent[i, j] = total
        tangent[i, i] += chord_tension * kappa[i]


@compiled(literal=False)
def leading_force(
    q, boundary_data, row, stiffness, length, kappa, mean_chordwise_forces, geometric_stiffness, load_projection, f,
    tangent,
):  # fmt: skip
    """Fill undamped accelerations f (r,) and their tangent (r, r) for one state; return H [N]."""
    chord_tension = _chord_tension(q, boundary_data, row, kappa, mean_chordwise_forces, stiffness, length)
    _leading_acceleration(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, load_projection, f)
    _leading_tangent(q, boundary_data, row, chord_tension, kappa, geometric_stiffness, stiffness, length, tangent)
    return chord_tension


@compiled
def leading_rest(
    q, boundary_data, stiffness, length, kappa, mean_chordwise_forces, geometric_stiffness, load_projection
):  # fmt: skip
    """Change q into the equilibrium near it by Newton's method; False where it fails, or converges to another one."""
    f, tangent, first = np.empty(q.size), np.empty((q.size, q.size)), q.copy()
    scale = 0.0
    for i in range(q.size):
        scale = max(scale, abs(q[i]))
    for _ in range(2 * MAX_ITERATIONS):
        leading_force(
            q, boundary_data, 0, stiffness, length, kappa, mean_chordwise_forces, geometric_stiffness, load_projection,
            f, tangent,
        )  # fmt: skip
        if not _solve(tangent, f):
            return False
        change, largest = 0.0, 0.0
        for i in range(q.size):
            q[i] += f[i]
            change, largest = max(change, abs(f[i])), max(largest, abs(q[i]))
            if not abs(q[i]) <= 10.0 * scale:
                return False
        if change <= ROUNDING_RTOL * scale:
            break
    # an equilibrium further away than the deflection is that of the cable turned over
    furthest = 0.0
    for i in range(q.size):
        furthest = max(furthest, abs(q[i] - first[i]))
    return change <= EQUILIBRIUM_RTOL * scale and furthest <= scale


# --- monitor and tensions ---------------------------------------------------------------------------------------------


@compiled(inline="always")
def _monitor_step(
    step_number, q, boundary_data, row, chord_tension, kappa, geometric_stiffness_norms,
    chordwise_forces_at_candidates, stiffness, length, monitor,
):  # fmt: skip
    """Update the monitor: least chordwise force with its step, largest frequency, first step where that is too large."""
    least = np.inf
    for k in range(chordwise_forces_at_candidates.shape[1]):
        tau = 0.0
        for a in range(chordwise_forces_at_candidates.shape[0]):
            tau += boundary_data[row, 1 + a] * chordwise_forces_at_candidates[a, k]
        least = min(least, tau)
    if chord_tension + least < monitor[MIN_FORCE]:
        monitor[MIN_FORCE], monitor[MIN_FORCE_STEP] = chord_tension + least, step_number
    _monitor_frequency(
        step_number, q, boundary_data, row, chord_tension, kappa, geometric_stiffness_norms, stiffness, length, monitor
    )


@compiled(inline="always")
def _link_tension(j, q, boundary_data, row, chord_tension, slopes, n_in_plane, chordwise_force_patterns):
    """Return the tension of one link to leading order [N]."""
    x, y, force = 0.0, 0.0, chord_tension
    for i in range(n_in_plane):
        x += slopes[i, j] * q[i]
    for i in range(n_in_plane, q.size):
        y += slopes[i, j] * q[i]
    for a in range(chordwise_force_patterns.shape[0]):
        force += boundary_data[row, 1 + a] * chordwise_force_patterns[a, j]
    return force * math.sqrt(1.0 + x * x + y * y)


@compiled(fastmath=REORDERED_FUSED)
def _link_tensions(
    q, boundary_data, row, chord_tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high,
):  # fmt: skip
    """Update the extremes `low` and `high` (n,) by the tensions of all links to leading order."""
    links = low.size
    for j in range(links):
        work[SLOPE_IN_PLANE, j] = 0.0
        work[SLOPE_OUT_OF_PLANE, j] = 0.0
        work[LINK_FORCE, j] = chord_tension
    for i in range(q.size):
        k = SLOPE_IN_PLANE if i < n_in_plane else SLOPE_OUT_OF_PLANE
        for j in range(links):
            work[k, j] += slopes[i, j] * q[i]
    for a in range(chordwise_force_patterns.shape[0]):
        for j in range(links):
            work[LINK_FORCE, j] += boundary_data[row, 1 + a] * chordwise_force_patterns[a, j]
    for j in range(links):
        tension = work[LINK_FORCE, j] * math.sqrt(
            1.0
            + work[SLOPE_IN_PLANE, j] * work[SLOPE_IN_PLANE, j]
            + work[SLOPE_OUT_OF_PLANE, j] * work[SLOPE_OUT_OF_PLANE, j]
        )
        low[j] = min(low[j], tension)
        high[j] = max(high[j], tension)


# --- steps ------------------------------------------------------------------------------------------------------------


@compiled(noalias=True)
def leading_verlet(
    q, v, step, damping_factor, impulse, v_before, tension_damping, wind, samples_per_second, drag, drag_shapes, hold, held,
    boundary_data, stiffness, length, kappa, mean_chordwise_forces, geometric_stiffness, load_projection,
    geometric_stiffness_norms, chordwise_forces_at_candidates, slopes, n_in_plane, chordwise_force_patterns, begin,
    output_steps, saved, half_step_rates, low, high, monitor, tension_series,
):  # fmt: skip
    """Advance by velocity Verlet to leading order, one step for each row of the boundary data.

    Parameters
    ----------
    q, v
        Coordinates, and their rates half a step before (r,); changed.
    step, damping_factor, impulse
        Step [s]; factor of the rates by damping over a step; rate gained in a step for unit acceleration [s].
    v_before
        Rates one and a half steps before (r,), changed; None without the forces that depend on velocities.
    tension_damping
        Damping by the tension [s]; None without.
    wind, samples_per_second, drag, drag_shapes
        Wind with its sampling from the start of the run on [1/s], weights, shapes and slopes (2, r, points) of
        :func:`cablepod.condensed._kernels_drag._add_drag_at`; None without.
    hold, held
        Number of steps from one evaluation of the drag to the next; accelerations by it until then, and at the last three
        evaluations (4, r), changed; None without wind.
    boundary_data
        See :func:`cablepod.condensed._kernels_frame.frames`; one row for each step.
    stiffness, length
        K [N] and L0 [m].
    kappa, mean_chordwise_forces, geometric_stiffness, load_projection
        Coefficients: squared slope norms (r,), then (patterns,), (patterns, r, r), (normals times patterns, r).
    geometric_stiffness_norms, chordwise_forces_at_candidates
        Norms of `geometric_stiffness` (patterns,); chordwise force patterns where the sum may be least (patterns, candidates).
    slopes, n_in_plane, chordwise_force_patterns
        For link tensions: slopes of the modes (r, n), number of in-plane coordinates, patterns (patterns, n).
    begin, output_steps, saved, half_step_rates
        Number of the first step; steps to save (outputs,); filled: q there (outputs, r), rates half a step before and after
        (outputs, 2, r).
    low, high
        Extremes of the link tensions over all steps (n,) [N], or without entries; changed.
    monitor
        Extremes of the run, see :mod:`cablepod.condensed._kernels_layout`; changed.
    tension_series
        Filled: link tensions at the steps to save (outputs, n) [N], or without columns.
    """
    f, work = np.empty(q.size), np.empty((LINK_ROWS, low.size))
    u = f if v_before is None else np.empty(q.size)
    if wind is not None:
        air, steps_held, weights = np.empty(AIR_ROWS * drag.size), begin % hold, _weights_of_drag(hold)
        held_drag, now, before, old = held[0], held[1], held[2], held[3]
    next_output = 0
    for i in range(boundary_data.shape[0]):
        chord_tension = _chord_tension(q, boundary_data, i, kappa, mean_chordwise_forces, stiffness, length)
        _leading_acceleration(q, boundary_data, i, chord_tension, kappa, geometric_stiffness, load_projection, f)
        if v_before is not None and (wind is None or tension_damping is not None or steps_held == 0):
            for j in range(q.size):
                u[j] = 1.5 * v[j] - 0.5 * v_before[j]
        if tension_damping is not None:
            _add_tension_damping(u, boundary_data, i, chord_tension, kappa, geometric_stiffness, tension_damping, f)
        if wind is not None:
            if steps_held == 0:
                if hold > 1:
                    now[:] = 0.0
                _add_drag_at(
                    q, u, boundary_data[i, 0] / length, None, wind, (begin + i) * step * samples_per_second, drag,
                    drag_shapes, n_in_plane, air, now if hold > 1 else f,
                )  # fmt: skip
                if hold > 1:
                    _extrapolate_drag(weights, begin + i == 0, now, before, old, held_drag)
            steps_held = steps_held + 1 if steps_held + 1 < hold else 0
            if hold > 1:
                for j in range(q.size):
                    f[j] += held_drag[j]
        _monitor_step(
            begin + i, q, boundary_data, i, chord_tension, kappa, geometric_stiffness_norms,
            chordwise_forces_at_candidates, stiffness, length, monitor,
        )  # fmt: skip
        if low.size < SCALAR_LINK_LIMIT:
            for j in range(low.size):
                tension = _link_tension(
                    j, q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns
                )
                if tension < low[j]:
                    low[j] = tension
                if tension > high[j]:
                    high[j] = tension
        else:
            _link_tensions(
                q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns, work, low, high
            )
        is_output = next_output < output_steps.size and output_steps[next_output] == begin + i
        if is_output:
            for j in range(q.size):
                saved[next_output, j] = q[j]
                half_step_rates[next_output, 0, j] = v[j]
            for j in range(tension_series.shape[1]):
                tension_series[next_output, j] = _link_tension(
                    j, q, boundary_data, i, chord_tension, slopes, n_in_plane, chordwise_force_patterns
                )
        for j in range(q.size):
            if v_before is not None:
                v_before[j] = v[j]
            v[j] = damping_factor * v[j] + impulse * f[j]
        if is_output:
            for j in range(q.size):
                half_step_rates[next_output, 1, j] = v[j]
            next_output += 1
        for j in range(q.size):
            q[j] += step * v[j]
