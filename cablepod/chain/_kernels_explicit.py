"""Compiled velocity Verlet in leapfrog form for the elastic chain.

A group of terms that a scene lacks is None and is compiled away.  No fastmath: the loops over links vectorise
without it (they have no sums), and a planar and a spatial run give the same bits.

The state of a run is one array with a row for each quantity.  The compiler knows that rows of one array do not overlap; for
separate arrays it would test this before each short loop, which takes half as long as the loops themselves.  Held ends take part
in the loops with zero increments, so that every loop begins at index 0: a loop from an index known only at run time is not
vectorised.
"""

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.chain import _kernels_layout as at
from cablepod.chain._kernels_attached import apply_attached, note_attached
from cablepod.chain._kernels_drag import apply_drag
from cablepod.chain._kernels_layout import Record
from cablepod.chain._kernels_terms import (
    _add_tension_damping,
    _extremes,
    _green_extremes,
    _link_forces,
    _load_increments,
    _predict_velocities,
    _viscous_forces,
)
from cablepod.integrate._kernels_assign import assign


def new_states(chains, links):
    """Allocate states of zeros (chains, ROWS, at least links + 3).

    Rows are aligned to cache lines, which saves a tenth of the time.  An odd number of lines per row keeps equal columns of
    different rows out of the same cache set.
    """
    shape = (chains, at.ROWS, at.LINE * ((links + 2 + at.LINE) // at.LINE | 1))
    memory = np.zeros(math.prod(shape) + at.LINE)
    first = -(memory.ctypes.data // memory.itemsize) % at.LINE
    return memory[first : first + math.prod(shape)].reshape(shape)


@compiled(inline="always")
def _kick_and_drift(s, links, step, damping_factor, spatial):
    """Update velocities and positions: V <- damping_factor V + (F1 - F0) PER_MASS + LOAD, then X <- X + step V."""
    for j in range(links + 1):
        vx, vy = damping_factor * s[at.VX, j], damping_factor * s[at.VY, j]
        vx += (s[at.FX, j + 1] - s[at.FX, j]) * s[at.PER_MASS, j] + s[at.LOAD_X, j]
        vy += (s[at.FY, j + 1] - s[at.FY, j]) * s[at.PER_MASS, j] + s[at.LOAD_Y, j]
        s[at.VX, j] = vx
        s[at.VY, j] = vy
        s[at.X, j] += step * vx
        s[at.Y, j] += step * vy
        if spatial is not None:
            vz = damping_factor * s[at.VZ, j]
            vz += (s[at.FZ, j + 1] - s[at.FZ, j]) * s[at.PER_MASS, j] + s[at.LOAD_Z, j]
            s[at.VZ, j] = vz
            s[at.Z, j] += step * vz


@compiled(inline="always")
def _steps(s, chain, spatial, shared, damping_factor, rates, attached, loads, ends, first, last):
    """Take the steps first ... last - 1 of the tables, of number `chain` among the chains."""
    links, step = shared.links, shared.step
    for i in range(first, last):
        if rates is not None:
            _predict_velocities(s, links, spatial)
            for m in range(ends.rows.size):
                s[ends.rows[m] + at.UX, ends.columns[m]] = rates.ends[chain, m, i]
        if rates is not None and rates.viscosity[chain] > 0.0:
            _viscous_forces(s, links, rates.viscosity[chain], spatial)
        else:
            _link_forces(s, links, shared.green, spatial)
        if shared.extremes and shared.green:
            _green_extremes(s, links, spatial)
        elif shared.extremes:
            _extremes(s, links, spatial)
        if rates is not None and rates.tension_damping[chain] > 0.0:
            _add_tension_damping(s, links, rates.tension_damping[chain], spatial)
        if loads is not None:
            _load_increments(s, links, loads.patterns[chain], loads.factors[chain], i, spatial)
        if attached is not None:
            note_attached(s, attached.particles[chain], attached.numbers[chain])
        _kick_and_drift(s, links, step, damping_factor, spatial)
        if attached is not None:
            apply_attached(s, attached.particles[chain], attached.numbers[chain], step)
        for m in range(ends.rows.size):
            s[ends.rows[m], ends.columns[m]] = ends.positions[chain, m, i + 1]


@compiled
def _advance(s, chain, spatial, shared, damping_factor, rates, attached, air, loads, ends, start, first, last):
    """Take the steps first ... last - 1 of the tables, without saving, so that the compiler sees a plain loop."""
    i = first
    while i < last:
        end = last
        if air is not None:
            evaluation = (start + i + air.hold - 1) // air.hold  # number of the next evaluation of the drag
            if start + i == evaluation * air.hold:
                place = (start + i - 0.5) * shared.step * air.samples_per_second
                target = at.LOAD_X if loads is None else at.STEADY_X
                apply_drag(
                    s, shared.links, air.velocity, place, air.drag, air.bodies, shared.step, target, evaluation, spatial
                )
                evaluation += 1
            end = min(evaluation * air.hold - start, last)
        _steps(s, chain, spatial, shared, damping_factor, rates, attached, loads, ends, i, end)
        i = end


@compiled(inline="always")
def _run(s, chain, spatial, shared, damping_factor, rates, attached, air, loads, ends, block, record):
    """Advance one chain, of number `chain` among all, as :func:`verlet` does; `s` and `record` are its own."""
    links, dims = shared.links, record.positions.shape[1]
    save, i = 0, np.int64(0)  # a literal 0 would compile the loops twice
    while i < block.steps:
        target = block.steps
        saving = save < record.steps.size and record.steps[save] == block.start + i
        if saving:
            assign(record.positions[record.at + save], s[at.X : at.X + dims, : links + 1])
            if record.half_velocities.shape[0]:
                assign(record.half_velocities[record.at + save, 0], s[at.VX : at.VX + dims, : links + 1])
                target = i + 1
        if target == block.steps and save + saving < record.steps.size:
            target = record.steps[save + saving] - block.start
        _advance(s, chain, spatial, shared, damping_factor, rates, attached, air, loads, ends, block.start, i, target)
        i = target
        if saving:
            if record.half_velocities.shape[0]:
                assign(record.half_velocities[record.at + save, 1], s[at.VX : at.VX + dims, : links + 1])
            save += 1


@compiled
def verlet(states, is_active, spatial, shared, damping_factors, rates, attached, air, loads, ends, block, record):
    """Advance chains of equal shape by the steps of a block with velocity Verlet in leapfrog form.

    On entry and on return, positions are those of a step and velocities those half a step before it.  The forces of a step are
    computed once, and saving does not change the motion.

    Parameters
    ----------
    states : float array (chains, ROWS, columns)
        States, see :mod:`cablepod.chain._kernels_layout`; advanced in place.
    is_active : bool array (chains,)
        Whether to advance a chain.
    spatial : True or None
        Third coordinate; None without.
    shared : Shared
        Numbers that all chains share.
    damping_factors : float array (chains,)
        exp(-damping step) with the damping by mass; 1 without.
    rates, attached, air, loads : Rates, Attached, Air, Loads or None
        Damping by rates of the links, dampers and springs, wind, time-dependent loads, see :mod:`cablepod.chain._kernels_layout`;
        None without.  With wind there is one chain.
    ends : Ends
        Places and positions of the moving ends.
    block, record : Block, Record
        The steps to take, and the arrays to fill.
    """
    for m in range(states.shape[0]):
        if is_active[m]:
            _run(
                states[m], m, spatial, shared, damping_factors[m], rates, attached, air, loads, ends, block,
                Record(record.steps, record.at, record.positions[m], record.half_velocities[m]),
            )  # fmt: skip
