"""Compiled velocity Verlet steps of the spectral elements.

Arrays as in :mod:`cablepod.cable._kernels_arguments`.
"""

from cablepod._jit import compiled
from cablepod.cable._kernels_air import add_drag
from cablepod.cable._kernels_forces import (
    _add_forces,
    _clear,
    _extremes,
    _gradient,
    _record_slack,
    _set_end_rates,
    _stresses,
)
from cablepod.chain._kernels_attached import apply_along, note_along
from cablepod.integrate._kernels_assign import assign


@compiled(noalias=True, counted=False)
def _advance(nodes, increments, factors, i, step, force, x, v):
    """Advance velocities and positions by forces, constant increments, and time-dependent loads at step `i` of the tables."""
    for c in range(x.shape[0]):
        for j in range(x.shape[1]):
            v[c, j] = nodes.damping_factor * v[c, j] + force[c, j] * nodes.per_mass[j] + increments[c, j]
        for load in range(nodes.patterns.shape[0]):
            for j in range(x.shape[1]):
                v[c, j] += nodes.per_mass[j] * factors[i, load] * nodes.patterns[load, c, j]
        for j in range(x.shape[1]):
            x[c, j] += step * v[c, j]


@compiled(noalias=True, counted=False)
def _predict_rates(v, v_before, u):
    """Fill the velocities of a step, from those half a step and one and a half steps before, which move on."""
    for c in range(v_before.shape[0]):
        for j in range(v_before.shape[1]):
            u[c, j] = 1.5 * v[c, j] - 0.5 * v_before[c, j]
            v_before[c, j] = v[c, j]


@compiled(noalias=True, counted=False)
def _move_back(x, u, step, before):
    """Fill the positions half a step before."""
    for c in range(x.shape[0]):
        for j in range(x.shape[1]):
            before[c, j] = x[c, j] - 0.5 * step * u[c, j]


@compiled(noalias=True, counted=False)
def _hold_drag(nodes, force, is_first, before, increments):
    """Fill the velocity increments by loads and drag until the next evaluation, from the last two evaluations.

    These are half a step before, and extrapolated by 3/2 and -1/2 to the middle of the steps until the next one.
    """
    for c in range(increments.shape[0]):
        for j in range(increments.shape[1]):
            now = nodes.per_mass[j] * force[c, j]
            if is_first:
                before[c, j] = now
            increments[c, j] = nodes.load_increment[c, j] + 1.5 * now - 0.5 * before[c, j]
            before[c, j] = now


@compiled(counted=False)
def verlet(elements, nodes, air, attached, tables, step, state, record, work):
    """Advance a cable by the steps of the tables, each `step` [s], of velocity Verlet in leapfrog form.

    On entry positions are those of the first step and velocities those half a step before; on exit the same holds for the next
    step.
    """
    x, v, u, force, saved = state.x, state.v, work.u, work.force, 0
    increments = nodes.load_increment if air is None else state.drag_increment
    for i in range(tables.ends.shape[1] - 1):
        number = record.start + i
        if air is not None and number % air.hold == 0:
            assign(u, v)
            _set_end_rates(elements, tables.end_rates, i, u)
            _move_back(x, u, step, work.position)
            for c in range(x.shape[0]):
                _gradient(elements, work.position[c], work.nodal, work.g[c])
            _clear(force)
            add_drag(elements, air, tables.places[i], u, work.g, force, 0.0, None)
            _hold_drag(nodes, force, number == 0, state.drag_before, increments)
        if state.v_before.size:
            _predict_rates(v, state.v_before, u)
            _set_end_rates(elements, tables.end_rates, i, u)
        if _stresses(elements, x, work):
            _record_slack(work.square, number, record.slack)
        _clear(force)
        _add_forces(elements, work)
        _extremes(elements, record, work)
        if attached is not None:
            note_along(x, v, attached.particles, attached.numbers)
        saving = saved < record.steps.size and record.steps[saved] == number
        if saving:
            assign(record.saved[saved, 0], x)
            if record.saved.shape[1] > 1:
                assign(record.saved[saved, 1], v)
        _advance(nodes, increments, tables.factors, i, step, force, x, v)
        if attached is not None:
            apply_along(x, v, attached.particles, attached.numbers, nodes.per_mass, 1.0, step)
        for k in range(tables.rows.size):
            x[tables.rows[k], tables.columns[k]] = tables.ends[k, i + 1]
        if saving:
            if record.saved.shape[1] > 1:
                assign(record.saved[saved, 2], v)
            saved += 1
