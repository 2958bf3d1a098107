"""Compiled parts of an implicit step that all schemes share: forces on particles, Newton's method, what is kept of a run.

Arrays as in :mod:`cablepod.chain._kernels_arguments`.
"""

import math

from cablepod._jit import REORDERED, compiled
from cablepod.chain._kernels_attached import add_bodies, attached_forces, attached_tangent
from cablepod.chain._kernels_banded import solve_planar, solve_spatial
from cablepod.chain._kernels_drag import drag_forces, drag_tangent
from cablepod.chain._kernels_links import _add_tension_damping, _add_viscosity, _update_extremes, assemble_links
from cablepod.discretisation._kernels_modal_damping import damping_forces

#: Maximum number of Newton iterations per step.
MAX_ITERATIONS = 30

# --- forces -----------------------------------------------------------------------------------------------------------


@compiled(counted=False)
def _has_rates(chain, terms):
    """Return whether forces depend on velocities, beside damping by mass."""
    if terms is not None:
        return True
    return chain.viscosity.size + chain.tension_damping.size > 0


@compiled(counted=False)
def _forces_and_tangent(sizes, chain, terms, place, position, part, rate, newton):
    """Complete forces and tangents, from vectors, tensions and slopes of the links and the velocities.

    Parameters
    ----------
    place
        Place between the samples of the wind.
    position
        Where forces on particles act (dims (n + 1) lanes) [m].
    part, rate
        Derivatives of this position and of the velocities by the unknowns [1, 1/s].

    Returns
    -------
    bool
        Whether there are forces on particles, so that `newton.known` holds in place of `newton.fixed`.
    """
    if chain.viscosity.size:
        _add_viscosity(sizes, chain, newton.rates, rate, newton.reach, newton.t, newton.g)
    assemble_links(sizes, part, newton.reach, newton.t, newton.g, newton.f, newton.s)
    if chain.tension_damping.size:
        _add_tension_damping(sizes, chain, newton.rates, rate, newton.t, newton.f, newton.s)
    if terms is not None:  # an if that the compiler can prune
        _forces_on_particles(sizes, chain, terms, place, position, part, rate, newton)
        return True
    return False


@compiled(counted=False)
def _forces_on_particles(sizes, chain, terms, place, position, part, rate, newton):
    """Add forces on particles to those that do not change in a step, and their tangent to the blocks; of one lane."""
    dims = len(sizes.dims)
    count = position.size // dims
    x, v = position.reshape((dims, count)), newton.rates.reshape((dims, count))
    force, damping = newton.force.reshape((dims, count)), newton.air_damping
    known, block = newton.known, newton.block.reshape((3 * dims - 3, count))
    for q in range(known.size):
        known[q] = newton.fixed[q]
    _clear(newton.force)
    if terms.modal.matrix.size:
        damping_forces(terms.modal, v, chain.first, newton.b, force)
        _add(newton.force, 1.0, known)
        _add(terms.modal.stiffness.reshape(-1), part, newton.s)
    if terms.wind.size + terms.particles.size == 0:
        return
    for q in range(newton.block.size):
        newton.block[q] = 0.0
    if terms.wind.size:
        drag_forces(x, v, terms.wind, place, terms.drag, chain.first, chain.last, force, damping)
        drag_tangent(x, chain.first, chain.last, rate, force, damping, block)
        if terms.bodies.size:
            add_bodies(v, terms.wind, place, terms.bodies, force, rate, block)
        _add(newton.force, 1.0, known)
    if terms.particles.size:
        _clear(newton.force)
        attached_forces(x, v, terms.particles, terms.attached, force)
        attached_tangent(terms.particles, terms.attached, part, rate, block)
        _add(newton.force, 1.0, known)
    _add_diagonal(sizes, newton.solved, newton.block)


@compiled(noalias=True, counted=False)
def _add(values, factor, result):
    """Add an array times a factor to another one."""
    for q in range(result.size):
        result[q] += factor * values[q]


@compiled(noalias=True, counted=False)
def _clear(values):
    """Fill an array with zeros."""
    for q in range(values.size):
        values[q] = 0.0


@compiled(noalias=True, counted=False)
def _add_diagonal(sizes, solved, block):
    """Add numbers (n + 1, lanes) to the diagonals of blocks (3 or 6, n + 1, lanes)."""
    dims, row = len(sizes.dims), 0
    for c in range(dims):
        for q in range(solved.size):
            block[row * solved.size + q] += solved[q]
        row += dims - c


@compiled(noalias=True, counted=False)
def _add_loads(sizes, patterns, factors, i, part, fixed):
    """Add `part` of the time-dependent loads at step `i` of the tables."""
    lanes = len(sizes.lanes)
    for load in range(patterns.shape[0]):
        for row in range(fixed.size // lanes):
            for m in range(lanes):
                fixed[row * lanes + m] += part * factors[i, load, m] * patterns[load, row * lanes + m]


@compiled(noalias=True, counted=False)
def _set_ends(sizes, tables, i, trial):
    """Put the moving ends at their positions at step `i` of the tables."""
    lanes, dims = len(sizes.lanes), len(sizes.dims)
    size = trial.size // dims
    for c in range(dims):
        for m in range(lanes):
            if tables.lower.size:
                trial[c * size + m] = tables.lower[i, c, m]
            if tables.upper.size:
                trial[(c + 1) * size - lanes + m] = tables.upper[i, c, m]


@compiled(noalias=True, counted=False)
def _set_end_rates(sizes, chain, end_rates, i, rates):
    """Give the held ends their velocities at step `i` of the tables."""
    lanes, dims = len(sizes.lanes), len(sizes.dims)
    size = rates.size // dims
    for c in range(dims):
        for m in range(lanes):
            if chain.first == 1:
                rates[c * size + m] = end_rates[i, 0, c, m]
            if (chain.last + 1) * lanes == size:
                rates[(c + 1) * size - lanes + m] = end_rates[i, 1, c, m]


# --- Newton's method --------------------------------------------------------------------------------------------------


@compiled(counted=False)
def _correct(sizes, chain, on_particles, x, newton):
    """Correct the displacements of active lanes and the trial positions; fills the rotations of the links by it."""
    lanes, dims = len(sizes.lanes), len(sizes.dims)
    b, carry = newton.b, newton.carry
    size, half = b.size // dims, carry.size // 2
    _residual(sizes, chain, newton.f, newton.known if on_particles else newton.fixed, newton.diagonal, newton.d, b)
    if dims == 2:
        solve_planar(
            sizes.lanes, newton.block, newton.s, b[:size], b[size:], newton.matrix, carry[:half], carry[half:],
            chain.first, chain.last,
        )  # fmt: skip
    else:
        solve_spatial(
            sizes.lanes, newton.block, newton.s, b[:size], b[size : 2 * size], b[2 * size :], newton.matrix,
            carry[:half], carry[half:], chain.first, chain.last,
        )  # fmt: skip
    _rotations(sizes, b, chain.per_length, newton.known, newton.rotation)
    for row in range(b.size // lanes):
        for m in range(lanes):
            q = row * lanes + m
            new = newton.d[q] + (b[q] if newton.active[m] > 0.0 else 0.0)
            newton.d[q] = new
            newton.trial[q] = x[q] + new


@compiled(noalias=True, counted=False)
def _residual(sizes, chain, f, known, diagonal, d, b):
    """Fill the right side: link forces and known forces less inertia; 0 at held particles."""
    lanes, dims = len(sizes.lanes), len(sizes.dims)
    # one loop for all coordinates: the places after the last link of one and before the first of the next are the same
    for q in range(b.size):
        b[q] = f[q + lanes] - f[q] + (known[q] - diagonal[q] * d[q])
    size = b.size // dims
    for c in range(dims):
        for m in range(lanes):
            if chain.first == 1:
                b[c * size + m] = 0.0
            if (chain.last + 1) * lanes == size:
                b[(c + 1) * size - lanes + m] = 0.0


@compiled(fastmath=REORDERED, noalias=True, counted=False)
def _rotations(sizes, b, per_length, squares, rotation):
    """Fill the root mean square rotation and stretch of the links by a correction, summed in any order; moves the last one.

    It is NaN for a NaN correction: the fast-math options do not assume finite numbers.
    """
    lanes = len(sizes.lanes)
    rows = b.size // lanes
    for q in range((rows - 1) * lanes):
        turn = (b[q + lanes] - b[q]) * per_length[q]
        squares[q] = turn * turn
    for m in range(lanes):
        rotation[lanes + m] = rotation[m]
        total = 0.0
        for row in range(rows - 1):
            total += squares[row * lanes + m]
        rotation[m] = math.sqrt(total / rows)


@compiled(noalias=True, counted=False)
def _begin_step(lanes, before, newton):
    """Prepare the marks of the lanes for a step; `before` counts as the rotation by a correction before the first."""
    for m in range(newton.active.size):
        newton.active[m] = 1.0 if lanes.is_running[m] else 0.0
        lanes.failed[m] = False
        newton.rotation[m] = before


@compiled(noalias=True, counted=False)
def _count_active(lanes, newton):
    """Mark the lanes that have converged, or diverged, in an iteration; returns how many are left."""
    left, width = 0, newton.active.size
    for m in range(width):
        if newton.active[m] > 0.0:
            lanes.iterations[m] += 1
            rotation, before = newton.rotation[m], newton.rotation[width + m]
            small = rotation <= lanes.tolerance[m]
            if lanes.remainder > 0.0:  # of what a linear iteration leaves
                rest = rotation * rotation / before if rotation < before < math.inf else rotation
                small = small and rest <= lanes.remainder * lanes.tolerance[m]
            small = small or (rotation <= lanes.rounding[m] and rotation > 0.5 * before)
            lanes.failed[m] = not small and not rotation < 1e300
            newton.active[m] = 0.0 if small or lanes.failed[m] else 1.0
            left += 0 if small or lanes.failed[m] else 1
    return left


@compiled(counted=False)
def _any_failed(lanes, newton):
    """Mark the lanes that have not converged as failed; returns whether any has."""
    result = False
    for m in range(newton.active.size):
        lanes.failed[m] = lanes.failed[m] or newton.active[m] > 0.0
        result = result or lanes.failed[m]
    return result


@compiled(counted=False)
def _keep(state, before):
    """Keep a state in rows of `before`."""
    at = 0
    for values in state:
        for q in range(values.size):
            before[at + q] = values[q]
        at += values.size


@compiled(counted=False)
def _restore(failed, before, state):
    """Set failed lanes back to the state in `before`."""
    at = 0
    for values in state:
        for q in range(values.size):
            if failed[q % failed.size]:
                values[q] = before[at + q]
        at += values.size


@compiled(counted=False)
def _all_inside(lanes, x):
    """Take lanes with coordinates that are not finite and below their bound out of the run; returns whether there are none."""
    least, outside, result = math.inf, 0, True
    for m in range(lanes.bound.size):
        least = min(least, lanes.bound[m])
    for q in range(x.size):  # counts, because a loop with an exit is not vectorised
        outside += 0 if abs(x[q]) < least else 1
    if outside > 0:
        for q in range(x.size):
            m = q % lanes.bound.size
            if lanes.is_running[m] and not abs(x[q]) < lanes.bound[m]:
                lanes.is_running[m], result = False, False
    return result


# --- record -----------------------------------------------------------------------------------------------------------


@compiled(counted=False)
def _note(sizes, chain, record, saved, number, state):
    """Keep what is wanted of the state at the beginning of step `number`; returns how many steps are saved by then."""
    if record.low.size:
        _update_extremes(sizes, chain, state.x, record.low, record.high)
    if saved == record.steps.size or record.steps[saved] != number:
        return saved
    _save(sizes, state.x, record.saved, record.at + saved, 0)
    if record.saved.shape[2] > 1:
        _save(sizes, state.v, record.saved, record.at + saved, 1)
        _save(sizes, state.a, record.saved, record.at + saved, 2)
    return saved + 1


@compiled(noalias=True, counted=False)
def _save(sizes, values, saved, at, variable):
    """Save an array of all members as a variable."""
    lanes = len(sizes.lanes)
    for m in range(saved.shape[0]):
        for row in range(saved.shape[3]):
            saved[m, at, variable, row] = values[row * lanes + m]
