"""Compiled velocity Verlet in leapfrog form for the elastic chain, and the moduli of its links.

Floats and arrays only; a term that a scene lacks is None and is compiled away.  No fastmath: the loops over links vectorise
without it (they have no sums), and a planar and a spatial run give the same bits.

The state of a run is one array with a row for each quantity.  The compiler knows that rows of one array do not overlap; for
separate arrays it would test this before each short loop, which takes half as long as the loops themselves.  Held ends take part
in the loops with zero increments, so that every loop begins at index 0: a loop from an index known only at run time is not
vectorised.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.chain._kernels_attached import apply_attached, note_attached
from cablepod.chain._kernels_drag import apply_drag
from cablepod.chain._kernels_layout import (
    BX,
    BY,
    BZ,
    FX,
    FY,
    FZ,
    HIGH,
    INVERSE,
    LENGTH,
    LINE,
    LOAD_X,
    LOAD_Y,
    LOAD_Z,
    LOW,
    PER_MASS,
    ROWS,
    STEADY_X,
    STEADY_Y,
    STEADY_Z,
    STIFFNESS,
    UX,
    UY,
    UZ,
    VX,
    VY,
    VZ,
    X,
    Y,
    Z,
)
from cablepod.integrate._kernels_assign import assign


def new_states(chains, links):
    """Allocate states of zeros (chains, ROWS, at least links + 3).

    Rows are aligned to cache lines, which saves a tenth of the time.  An odd number of lines per row keeps equal columns of
    different rows out of the same cache set.
    """
    shape = (chains, ROWS, LINE * ((links + 2 + LINE) // LINE | 1))
    memory = np.zeros(math.prod(shape) + LINE)
    first = -(memory.ctypes.data // memory.itemsize) % LINE
    return memory[first : first + math.prod(shape)].reshape(shape)


@compiled(inline="always")
def _elastic_forces(s, links, spatial):
    """Compute forces of the links [N]: k (1 - l/|R|) R where |R| > l, else 0."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
        secant = s[STIFFNESS, j] * (1.0 - s[LENGTH, j] / math.sqrt(square))
        secant = secant if secant > 0.0 else 0.0
        s[FX, j + 1] = secant * dx
        s[FY, j + 1] = secant * dy
        if spatial is not None:
            s[FZ, j + 1] = secant * dz


@compiled(inline="always")
def _green_forces(s, links, spatial):
    """Compute forces of the links by law (21) [N]: k/2 (|R|^2/l^2 - 1) R."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
        secant = 0.5 * s[STIFFNESS, j] * (square * s[INVERSE, j] - 1.0)
        s[FX, j + 1] = secant * dx
        s[FY, j + 1] = secant * dy
        if spatial is not None:
            s[FZ, j + 1] = secant * dz


@compiled(inline="always")
def _viscous_forces(s, links, viscosity, spatial):
    """Compute forces of viscous links from the predicted velocities [N]; 0 for slack links."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        stretching = dx * (s[UX, j + 1] - s[UX, j]) + dy * (s[UY, j + 1] - s[UY, j])
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
            stretching += dz * (s[UZ, j + 1] - s[UZ, j])
        elastic = s[STIFFNESS, j] * (1.0 - s[LENGTH, j] / math.sqrt(square))
        total = elastic + viscosity * s[STIFFNESS, j] * stretching / square
        secant = total if elastic > 0.0 and total > 0.0 else 0.0
        s[FX, j + 1] = secant * dx
        s[FY, j + 1] = secant * dy
        if spatial is not None:
            s[FZ, j + 1] = secant * dz


@compiled(inline="always")
def _add_tension_damping(s, links, tension_damping, spatial):
    """Add the damping forces by the tension T [N], tension_damping T / |R| times the difference of the predicted velocities."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        along = s[FX, j + 1] * dx + s[FY, j + 1] * dy
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
            along += s[FZ, j + 1] * dz
        damping = tension_damping * along / square if along > 0.0 else 0.0
        s[FX, j + 1] += damping * (s[UX, j + 1] - s[UX, j])
        s[FY, j + 1] += damping * (s[UY, j + 1] - s[UY, j])
        if spatial is not None:
            s[FZ, j + 1] += damping * (s[UZ, j + 1] - s[UZ, j])


@compiled(inline="always")
def _predict_velocities(s, links, spatial):
    """Extrapolate the velocity at the step from the last two half steps, which preserves second order."""
    for j in range(links + 1):
        s[UX, j] = s[VX, j] + 0.5 * (s[VX, j] - s[BX, j])
        s[UY, j] = s[VY, j] + 0.5 * (s[VY, j] - s[BY, j])
        s[BX, j] = s[VX, j]
        s[BY, j] = s[VY, j]
        if spatial is not None:
            s[UZ, j] = s[VZ, j] + 0.5 * (s[VZ, j] - s[BZ, j])
            s[BZ, j] = s[VZ, j]


@compiled(inline="always")
def _load_increments(s, links, patterns, factors, i, spatial):
    """Compute the velocity increments of step `i` by constant and time-dependent loads."""
    factor = factors[0, i]
    for j in range(links + 1):
        s[LOAD_X, j] = s[STEADY_X, j] + factor * patterns[0, 0, j]
        s[LOAD_Y, j] = s[STEADY_Y, j] + factor * patterns[0, 1, j]
        if spatial is not None:
            s[LOAD_Z, j] = s[STEADY_Z, j] + factor * patterns[0, 2, j]
    for load in range(1, patterns.shape[0]):
        factor = factors[load, i]
        for j in range(links + 1):
            s[LOAD_X, j] += factor * patterns[load, 0, j]
            s[LOAD_Y, j] += factor * patterns[load, 1, j]
            if spatial is not None:
                s[LOAD_Z, j] += factor * patterns[load, 2, j]


@compiled(inline="always")
def _kick_and_drift(s, links, step, damping_factor, spatial):
    """Update velocities and positions: V <- damping_factor V + (F1 - F0) PER_MASS + LOAD, then X <- X + step V."""
    for j in range(links + 1):
        vx, vy = s[VX, j], s[VY, j]
        if damping_factor is not None:
            vx, vy = damping_factor * vx, damping_factor * vy
        vx += (s[FX, j + 1] - s[FX, j]) * s[PER_MASS, j] + s[LOAD_X, j]
        vy += (s[FY, j + 1] - s[FY, j]) * s[PER_MASS, j] + s[LOAD_Y, j]
        s[VX, j] = vx
        s[VY, j] = vy
        s[X, j] += step * vx
        s[Y, j] += step * vy
        if spatial is not None:
            vz = s[VZ, j]
            if damping_factor is not None:
                vz = damping_factor * vz
            vz += (s[FZ, j + 1] - s[FZ, j]) * s[PER_MASS, j] + s[LOAD_Z, j]
            s[VZ, j] = vz
            s[Z, j] += step * vz


@compiled(inline="always")
def _extremes(s, links, green, spatial):
    """Update the extremes of T |T|; by law (21) from the stretch, as the norm of a force has no sign."""
    for j in range(links):
        if green is None:
            signed_tension_square = s[FX, j + 1] * s[FX, j + 1] + s[FY, j + 1] * s[FY, j + 1]
            if spatial is not None:
                signed_tension_square += s[FZ, j + 1] * s[FZ, j + 1]
        else:
            dx = s[X, j + 1] - s[X, j]
            dy = s[Y, j + 1] - s[Y, j]
            square = dx * dx + dy * dy
            if spatial is not None:
                dz = s[Z, j + 1] - s[Z, j]
                square += dz * dz
            secant = 0.5 * s[STIFFNESS, j] * (square * s[INVERSE, j] - 1.0)
            signed_tension_square = secant * abs(secant) * square
        s[LOW, j] = min(s[LOW, j], signed_tension_square)
        s[HIGH, j] = max(s[HIGH, j], signed_tension_square)


@compiled(inline="always")
def _steps(
    s, links, spatial, green, step, damping_factor, viscosity, tension_damping, particles, attached, patterns, factors, rows,
    columns, ends, end_rates, begin, end, extremes,
):  # fmt: skip
    """Take the steps begin ... end - 1 of the tables."""
    for i in range(begin, end):
        if end_rates is not None:
            _predict_velocities(s, links, spatial)
            for m in range(rows.size):
                s[rows[m] + UX, columns[m]] = end_rates[m, i]
        if viscosity is not None:
            _viscous_forces(s, links, viscosity, spatial)
        elif green is not None:
            _green_forces(s, links, spatial)
        else:
            _elastic_forces(s, links, spatial)
        if extremes:
            _extremes(s, links, green, spatial)
        if tension_damping is not None:
            _add_tension_damping(s, links, tension_damping, spatial)
        if patterns is not None:
            _load_increments(s, links, patterns, factors, i, spatial)
        if attached is not None:
            note_attached(s, particles, attached)
        _kick_and_drift(s, links, step, damping_factor, spatial)
        if attached is not None:
            apply_attached(s, particles, attached, step)
        for m in range(rows.size):
            s[rows[m], columns[m]] = ends[m, i + 1]


@compiled
def _advance(
    s, links, spatial, green, step, damping_factor, viscosity, tension_damping, particles, attached, wind, drag, bodies,
    samples_per_second, hold, patterns, factors, rows, columns, ends, end_rates, start, begin, end, extremes,
):  # fmt: skip
    """Take the steps begin ... end - 1 of the tables, without saving, so that the compiler sees a plain loop."""
    i = begin
    evaluation = 0 if wind is None else (start + begin + hold - 1) // hold  # number of the next one
    while i < end:
        last = end
        if wind is not None:
            if start + i == evaluation * hold:
                place = (start + i - 0.5) * step * samples_per_second
                target = LOAD_X if patterns is None else STEADY_X
                apply_drag(s, links, wind, place, drag, bodies, step, target, evaluation, spatial)
                evaluation += 1
            last = min(evaluation * hold - start, end)
        _steps(
            s, links, spatial, green, step, damping_factor, viscosity, tension_damping, particles, attached, patterns,
            factors, rows, columns, ends, end_rates, i, last, extremes,
        )  # fmt: skip
        i = last


@compiled(inline="always")
def _verlet(
    s, links, spatial, green, step, damping_factor, viscosity, tension_damping, particles, attached, wind, drag, bodies,
    samples_per_second, hold, patterns, factors, rows, columns, ends, end_rates, extremes, steps, start, save_steps, saved,
    saved_half,
):  # fmt: skip
    """Advance one chain as :func:`verlet` does, with arrays without their first dimension."""
    dims = saved.shape[1]
    save, i = 0, np.int64(0)  # a literal 0 would compile the loops twice
    while i < steps:
        target = steps
        saving = save < save_steps.size and save_steps[save] == start + i
        if saving:
            assign(saved[save], s[X : X + dims, : links + 1])
            if save < saved_half.shape[0]:
                assign(saved_half[save, 0], s[VX : VX + dims, : links + 1])
                target = i + 1
        if target == steps and save + saving < save_steps.size:
            target = save_steps[save + saving] - start
        _advance(
            s, links, spatial, green, step, damping_factor, viscosity, tension_damping, particles, attached, wind, drag,
            bodies, samples_per_second, hold, patterns, factors, rows, columns, ends, end_rates, start, i, target, extremes,
        )  # fmt: skip
        i = target
        if saving:
            if save < saved_half.shape[0]:
                assign(saved_half[save, 1], s[VX : VX + dims, : links + 1])
            save += 1


@compiled
def verlet(
    states, is_active, links, spatial, green, step, damping_factors, viscosities, tension_dampings, particles, attached, winds,
    drags, bodies, samples_per_second, hold, patterns, factors, rows, columns, ends, end_rates, extremes, steps, start,
    save_steps, first, last, saved, saved_half,
):  # fmt: skip
    """Advance chains of equal shape by `steps` steps of velocity Verlet in leapfrog form.

    On entry and on return, positions are those of a step and velocities those half a step before it.  The forces of a step are
    computed once, and saving does not change the motion.

    Parameters
    ----------
    states : float array (chains, ROWS, columns)
        States, see :mod:`cablepod.chain._kernels_layout`; advanced in place.
    is_active : bool array (chains,)
        Whether to advance a chain.
    links : int
        Number of links n.
    spatial, green : True or None
        Third coordinate, law (21); None without.
    step : float
        [s].
    damping_factors : float array (chains,) or None
        exp(-damping step) with the damping per mass; None without.
    viscosities : float array (chains,) or None
        Viscosity of the links over their stiffness [s]; only with the linear law.
    tension_dampings : float array (chains,) or None
        Damping by the tension [s], see :func:`_add_tension_damping`.
    particles, attached : int array (chains, attachments), float array (chains, attachments, COLUMNS) or None
        Particles with dampers or springs, and their numbers, see :mod:`cablepod.chain._kernels_attached`; None without.
    winds : float array (chains, samples, dims, n + 1) or None
        Velocity of the air at the particles [m/s], linear between the samples, from the start of the run on.
    drags : float array (chains,)
        Half the density of the air times drag coefficient and diameter [kg/m2], mean of the cable; only with winds.
    bodies : float array (chains, n + 1) or None
        Half the density of the air times drag area at the particles [kg/m]; only with winds.
    samples_per_second, hold : float, int
        Of the winds [1/s]; number of steps from one evaluation of the drag to the next.
    patterns, factors : float arrays (chains, loads, dims, n + 1), (chains, loads, steps + 1 or more) or None
        Velocity increments in a step by time-dependent loads at factor 1 [m/s], and the factors at the steps.
    rows, columns : int arrays (moving,)
        Places of the moving end coordinates in the state.
    ends : float array (chains, moving, steps + 1 or more)
        Their values at the steps from `start` on [m].
    end_rates : float array (chains, moving, steps + 1 or more) or None
        Their velocities [m/s]; only with viscosity or tension damping.
    extremes : bool
        Whether to update the extremes of the tensions.
    steps, start : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save; those from `first` up to `last` lie in start <= number < start + steps.
    first, last : int
        Range of `save_steps` within these steps.
    saved : float array (chains, saves, dims, n + 1)
        Filled with positions.
    saved_half : float array (chains, saves or 0, 2, dims, n + 1)
        Filled with the velocities half a step before and half a step after, unless it has no room for any.
    """
    for m in range(states.shape[0]):
        if is_active[m]:
            _verlet(
                states[m], links, spatial, green, step,
                None if damping_factors is None else damping_factors[m],
                None if viscosities is None else viscosities[m],
                None if tension_dampings is None else tension_dampings[m],
                None if attached is None else particles[m],
                None if attached is None else attached[m],
                None if winds is None else winds[m],
                None if winds is None else drags[m],
                None if bodies is None else bodies[m],
                samples_per_second, hold,
                None if patterns is None else patterns[m],
                None if factors is None else factors[m],
                rows, columns, ends[m],
                None if end_rates is None else end_rates[m],
                extremes, steps, start, save_steps[first:last], saved[m, first:last],
                saved_half[m, first:last],
            )  # fmt: skip


@compiled
def green_strain(load):
    """Solve xi (xi^2 - 1)/2 = load for the strain xi - 1 of law (21); `load` is tension over stiffness.

    With e = xi - 1 the equation reads e (1 + e) (1 + e/2) = load.  The left side is convex and increasing, so that Newton's
    method from e = load decreases monotonically to the solution, without cancellation for small strains.
    """
    e = load
    for _ in range(60):
        e_next = e - (e * (1.0 + e) * (1.0 + 0.5 * e) - load) / (1.0 + 3.0 * e + 1.5 * e * e)
        if not e_next < e:
            break
        e = e_next
    return e


@compiled
def secant_modulus(tension, stiffness, green):
    """Return tension over strain of a link [N]: K, by law (21) K (1 + e) (1 + e/2)."""
    if not green:
        return stiffness
    e = green_strain(tension / stiffness)
    return stiffness * (1.0 + e) * (1.0 + 0.5 * e)


@compiled
def secant_moduli(tensions, stiffness, green, out):
    """Fill `out` (links,) with the :func:`secant_modulus` of each link, of an axial stiffness (links,) [N]."""
    for j in range(tensions.size):
        out[j] = secant_modulus(tensions[j], stiffness[j], green)
