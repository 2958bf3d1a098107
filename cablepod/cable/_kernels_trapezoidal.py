"""Compiled tangent stiffness and trapezoidal steps of the spectral elements.

Arrays as in :mod:`cablepod.cable._kernels_arguments`.
"""

import math

from cablepod._jit import compiled
from cablepod.cable._kernels_air import add_drag
from cablepod.cable._kernels_forces import (
    _add_forces,
    _clear,
    _extremes,
    _is_inside,
    _record_slack,
    _set_end_rates,
    _stresses,
)
from cablepod.chain._kernels_attached import attached_forces, attached_tangent
from cablepod.discretisation._kernels_laws import damping_by_tension
from cablepod.discretisation._kernels_modal_damping import damping_forces
from cablepod.integrate._kernels_assign import assign

#: Maximum number of Newton iterations.
MAX_ITERATIONS = 30
#: Iterations after which a step is predicted anew without the acceleration, and so are further steps until one takes more:
#: axial vibrations that the steps do not resolve stay in the acceleration, undamped.
MANY_ITERATIONS = 6
#: With drag: tolerance of what remains over that of the last correction.
REMAINDER = 0.1


@compiled(noalias=True, counted=False)
def _axial_tangent(elements, rate, square, s, b):
    """Fill b with weight times the coefficient of g g^T in the tangent stiffness [N]."""
    weight, stiffness = elements.weight, elements.stiffness
    for q in range(b.shape[0]):
        if elements.green:
            for e in range(b.shape[1]):
                b[q, e] = weight[q] * stiffness[e]
        else:
            for e in range(b.shape[1]):
                part = weight[q] * stiffness[e] / (square[q, e] * math.sqrt(square[q, e]))
                # further viscous terms of the exact tangent are omitted; Newton's method converges without them
                part += weight[q] * elements.viscosity * stiffness[e] * rate / square[q, e]
                b[q, e] = part if s[q, e] > 0.0 else 0.0


@compiled(noalias=True, counted=False)
def _add_tangent(elements, rate, g, s, b, coefficient, line, band):
    """Add the tangent stiffness of all elements to the band; `coefficient` (p + 1, elements) is a work array."""
    dims, count, size, damping = g.shape[0], len(elements.nodes), elements.scale.size, elements.tension_damping
    for c in range(dims):
        for k in range(c + 1):
            for q in range(count):
                for e in range(size):
                    coefficient[q, e] = b[q, e] * g[c, q, e] * g[k, q, e]
                    if c == k:
                        coefficient[q, e] += s[q, e] + damping_by_tension(s[q, e] * rate, s[q, e], damping)
            for i in range(count):
                for j in range(i + 1 if c == k else count):
                    for e in range(size):
                        total = 0.0
                        for q in range(count):
                            total += elements.pairs[i, j, q] * coefficient[q, e]
                        line[e] = total * elements.scale[e]
                    # entry of node i, coordinate c and node j, coordinate k: in the column of the lower unknown
                    node, coordinate, below = (j, k, c - k) if i >= j else (i, c, k - c)
                    for e in range(size):
                        band[dims * (e * (count - 1) + node) + coordinate, dims * abs(i - j) + below] += line[e]


@compiled(counted=False)
def _add_blocks(block, band):
    """Add symmetric blocks of the nodes to the band."""
    dims = 2 if block.shape[0] == 3 else 3
    for n in range(block.shape[1]):
        row = 0
        for c in range(dims):
            for k in range(c, dims):
                band[dims * n + c, k - c] += block[row, n]
                row += 1


@compiled(counted=False)
def _solve(first, last, band, height, right):
    """Solve a symmetric band system of some unknowns in place by L D L^T without pivoting, within the heights of the columns."""
    for j in range(first, last):
        height_j = height[j]
        inverse = 1.0 / band[j, 0]
        column = band[j]
        value = right[j] * inverse
        for k in range(1, height_j + 1):
            right[j + k] -= column[k] * value
            factor = column[k] * inverse
            tail = column[k : height_j + 1]
            target = band[j + k, : height_j + 1 - k]
            for m in range(tail.size):
                target[m] -= factor * tail[m]
        band[j, 0] = inverse
        right[j] = value
    for j in range(last - 1, first - 1, -1):
        total = 0.0
        for k in range(1, height[j] + 1):
            total += band[j, k] * right[j + k]
        right[j] -= total * band[j, 0]


@compiled(noalias=True, counted=False)
def _predict(tables, i, state, step, has_acceleration, increment, trial):
    """Predict the increments and positions of step `i` of the tables, from velocities or accelerations too; prescribes ends."""
    for c in range(trial.shape[0]):
        for j in range(trial.shape[1]):
            increment[c, j] = step * state.v[c, j]
            if has_acceleration:
                increment[c, j] += 0.5 * step * step * state.a[c, j]
            trial[c, j] = state.x[c, j] + increment[c, j]
    for q in range(tables.rows.size):
        trial[tables.rows[q], tables.columns[q]] = tables.ends[q, i]


@compiled(noalias=True, counted=False)
def _rates(v, increment, step, u):
    """Fill the velocities after a step, but for those of moving ends."""
    for c in range(u.shape[0]):
        for j in range(u.shape[1]):
            u[c, j] = 2.0 * increment[c, j] / step - v[c, j]


@compiled(counted=False)
def _residual(elements, nodes, factors, i, step, state, work, newton):
    """Fill the right side: forces, loads at step `i` of the tables, inertia and damping by mass."""
    inertia, v, dims = 4.0 / (step * step), state.v, state.v.shape[0]
    for c in range(dims):
        for j in range(elements.first, elements.last):
            total = work.force[c, j] + nodes.loads[c, j]
            for load in range(nodes.patterns.shape[0]):
                total += factors[i, load] * nodes.patterns[load, c, j]
            new = inertia * (newton.increment[c, j] - step * v[c, j]) - state.a[c, j]
            newton.right[dims * j + c] = total - nodes.mass[j] * (new + nodes.damping * work.u[c, j])


@compiled(inline="always")
def _forces_and_tangent(elements, nodes, air, attached, tables, i, step, state, work, newton):
    """Fill right side and tangent of an iteration for step `i` of the tables; return whether the stretch is below 1 anywhere."""
    rate, u, force, block = 2.0 / step, work.u, work.force, newton.block
    _rates(state.v, newton.increment, step, u)
    _set_end_rates(elements, tables.end_rates, i, u)
    below = _stresses(elements, work.position, work)
    _clear(force)
    _clear(block)
    assign(newton.band, newton.base)
    if nodes.modal.matrix.size:
        damping_forces(nodes.modal, u, elements.first, newton.right, force)
    if air is not None:
        add_drag(elements, air, tables.places[i], u, work.g, force, rate, block)
    if attached is not None:
        attached_forces(work.position, u, attached.particles, attached.numbers, force)
        attached_tangent(attached.particles, attached.numbers, 1.0, rate, block)
    if air is not None or attached is not None:
        _add_blocks(block, newton.band)
    _axial_tangent(elements, rate, work.square, work.s, newton.b)
    _add_tangent(elements, rate, work.g, work.s, newton.b, work.nodal, newton.line, newton.band)
    _add_forces(elements, work)
    _residual(elements, nodes, tables.factors, i, step, state, work, newton)
    return below


@compiled(counted=False)
def _correct(elements, x, newton, trial):
    """Correct the increments and the positions after a step; return the largest correction [m], nan for a nan."""
    dims, largest = x.shape[0], 0.0
    for c in range(dims):
        for j in range(elements.first, elements.last):
            correction = newton.right[dims * j + c]
            newton.increment[c, j] += correction
            trial[c, j] = x[c, j] + newton.increment[c, j]
            if not abs(correction) <= largest:  # also for nan
                largest = abs(correction)
    return largest


@compiled(noalias=True, counted=False)
def _accept(state, step, increment, trial):
    """Go on to the end of a step."""
    v, a, inertia = state.v, state.a, 4.0 / (step * step)
    for c in range(v.shape[0]):
        for j in range(v.shape[1]):
            new = inertia * (increment[c, j] - step * v[c, j]) - a[c, j]
            v[c, j] = 2.0 * increment[c, j] / step - v[c, j]
            a[c, j] = new
    assign(state.x, trial)


@compiled(inline="always")
def _note(elements, tables, i, state, record, saved, work):
    """Keep what is wanted of the state at the beginning of step `i`; returns how many steps are saved by then."""
    if record.low.size:
        assign(work.u, state.v)
        _set_end_rates(elements, tables.end_rates, i, work.u)
        _stresses(elements, state.x, work)
        _extremes(elements, record, work)
    if saved == record.steps.size or record.steps[saved] != record.start + i:
        return saved
    assign(record.saved[saved, 0], state.x)
    assign(record.saved[saved, 1], state.v)
    assign(record.saved[saved, 2], state.a)
    return saved + 1


@compiled(counted=False)
def trapezoidal(elements, nodes, air, attached, tables, step, tolerance, bound, state, record, work, newton):
    """Advance a cable by the steps of the tables, by the trapezoidal rule (average acceleration) and Newton's method.

    Parameters
    ----------
    elements, nodes, air, attached, tables, state, record, work, newton
        See :mod:`cablepod.cable._kernels_arguments`; `work.position` is that of the state.
    step : float
        Time step [s].
    tolerance : float
        Tolerance of the last Newton correction [m].
    bound : float
        Coordinate above which the cable is considered divergent [m].

    Returns
    -------
    tuple of int
        Number of completed steps, fewer than those of the tables if Newton's method did not converge (the state is then that
        before the failed step) or the last of them left the bound, and number of iterations.
    """
    trial, dims, steps = work.position, state.x.shape[0], tables.ends.shape[1] - 1
    is_linear = air is not None or nodes.modal.matrix.size > 0
    iterations, saved, has_acceleration = 0, 0, True
    for i in range(steps):
        saved = _note(elements, tables, i, state, record, saved, work)
        below, before, started = False, 0.0, has_acceleration
        for k in range(MAX_ITERATIONS):
            iterations += 1
            has_acceleration = has_acceleration and k < MANY_ITERATIONS
            if k == 0 or (k == MANY_ITERATIONS and started):
                _predict(tables, i + 1, state, step, has_acceleration, newton.increment, trial)
            below = _forces_and_tangent(elements, nodes, air, attached, tables, i + 1, step, state, work, newton)
            _solve(dims * elements.first, dims * elements.last, newton.band, newton.height, newton.right)
            largest = _correct(elements, state.x, newton, trial)
            # the tangent leaves out that the drag turns with the cable, and approximates the damping by ratios: what remains is
            # largest^2 / before, not the square of largest
            remainder = (largest * largest / before if before > largest else largest) if is_linear else 0.0
            if largest <= tolerance and remainder <= REMAINDER * tolerance:
                break
            if not largest < 1e300 and not has_acceleration:
                return i, iterations
            before = largest
        else:
            return i, iterations
        has_acceleration = has_acceleration or (not started and k >= MANY_ITERATIONS)
        if below:
            _record_slack(work.square, record.start + i + 1, record.slack)
        _accept(state, step, newton.increment, trial)
        if not _is_inside(state.x, bound):
            return i + 1, iterations
    return steps, iterations
