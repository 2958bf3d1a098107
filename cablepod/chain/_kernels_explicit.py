"""The elastic chain: velocity Verlet in leapfrog form, and the chain at rest.

Floats and arrays only; a term that a scene lacks is None and is compiled away.  No fastmath: the loops over links vectorise
without it (nothing is summed), and a planar and a spatial run give the same bits.

The state of a run is one array with a row for each quantity.  Of rows of one array the compiler knows that they do not overlap;
with an array for each it has to test that before each of the short loops, which takes half as long as the loops themselves.
Held ends take part in the loops, with nothing that moves them, so that every loop begins at index 0: a loop that begins at an
index which is only known at run time is not vectorised.
"""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled
from cablepod.chain._kernels_layout import (
    BX,
    BY,
    BZ,
    DRIVE_X,
    DRIVE_Y,
    DRIVE_Z,
    FX,
    FY,
    FZ,
    HIGH,
    INVERSE,
    LENGTH,
    LINE,
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


def new_states(chains, links):
    """Make states of zeros (chains, ROWS, at least links + 2).

    Each row begins with a cache line: rows that begin in the middle of a vector take a tenth longer.  An odd number of lines to a
    row keeps the same column of all rows from falling on the same place in the cache.
    """
    shape = (chains, ROWS, LINE * ((links + 1 + LINE) // LINE | 1))
    room = np.zeros(math.prod(shape) + LINE)
    first = -(room.ctypes.data // room.itemsize) % LINE
    return room[first : first + math.prod(shape)].reshape(shape)


@compiled(inline="always")
def _pull(s, links, spatial):
    """Compute forces of the links [N]: k (1 - l/|R|) R where |R| > l, else 0."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
        pull = s[STIFFNESS, j] * (1.0 - s[LENGTH, j] / math.sqrt(square))
        pull = pull if pull > 0.0 else 0.0
        s[FX, j + 1] = pull * dx
        s[FY, j + 1] = pull * dy
        if spatial is not None:
            s[FZ, j + 1] = pull * dz


@compiled(inline="always")
def _pull_green(s, links, spatial):
    """Compute forces of the links by law (21) [N]: k/2 (|R|^2/l^2 - 1) R."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
        pull = 0.5 * s[STIFFNESS, j] * (square * s[INVERSE, j] - 1.0)
        s[FX, j + 1] = pull * dx
        s[FY, j + 1] = pull * dy
        if spatial is not None:
            s[FZ, j + 1] = pull * dz


@compiled(inline="always")
def _pull_viscous(s, links, viscosity, spatial):
    """Compute forces of links with viscosity from the predicted velocities.  A link that is slack carries nothing."""
    for j in range(links):
        dx = s[X, j + 1] - s[X, j]
        dy = s[Y, j + 1] - s[Y, j]
        square = dx * dx + dy * dy
        rate = dx * (s[UX, j + 1] - s[UX, j]) + dy * (s[UY, j + 1] - s[UY, j])
        if spatial is not None:
            dz = s[Z, j + 1] - s[Z, j]
            square += dz * dz
            rate += dz * (s[UZ, j + 1] - s[UZ, j])
        elastic = s[STIFFNESS, j] * (1.0 - s[LENGTH, j] / math.sqrt(square))
        total = elastic + viscosity * s[STIFFNESS, j] * rate / square
        pull = total if elastic > 0.0 and total > 0.0 else 0.0
        s[FX, j + 1] = pull * dx
        s[FY, j + 1] = pull * dy
        if spatial is not None:
            s[FZ, j + 1] = pull * dz


@compiled(inline="always")
def _predict(s, links, spatial):
    """Velocity at the step from the last two half steps: second order, so that damping does not cost the scheme its order."""
    for j in range(links + 1):
        s[UX, j] = s[VX, j] + 0.5 * (s[VX, j] - s[BX, j])
        s[UY, j] = s[VY, j] + 0.5 * (s[VY, j] - s[BY, j])
        s[BX, j] = s[VX, j]
        s[BY, j] = s[VY, j]
        if spatial is not None:
            s[UZ, j] = s[VZ, j] + 0.5 * (s[VZ, j] - s[BZ, j])
            s[BZ, j] = s[VZ, j]


@compiled(inline="always")
def _drive(s, links, patterns, factors, i, spatial):
    """Make the drive of step `i`: that of the constant loads and of those that vary in time."""
    factor = factors[0, i]
    for j in range(links + 1):
        s[DRIVE_X, j] = s[STEADY_X, j] + factor * patterns[0, 0, j]
        s[DRIVE_Y, j] = s[STEADY_Y, j] + factor * patterns[0, 1, j]
        if spatial is not None:
            s[DRIVE_Z, j] = s[STEADY_Z, j] + factor * patterns[0, 2, j]
    for load in range(1, patterns.shape[0]):
        factor = factors[load, i]
        for j in range(links + 1):
            s[DRIVE_X, j] += factor * patterns[load, 0, j]
            s[DRIVE_Y, j] += factor * patterns[load, 1, j]
            if spatial is not None:
                s[DRIVE_Z, j] += factor * patterns[load, 2, j]


@compiled(inline="always")
def _move(s, links, step, decay, spatial):
    """Kick and drift: V <- decay V + (f1 - f0) h + drive; X <- X + step V.  A decay of None means 1."""
    for j in range(links + 1):
        vx, vy = s[VX, j], s[VY, j]
        if decay is not None:
            vx, vy = decay * vx, decay * vy
        vx += (s[FX, j + 1] - s[FX, j]) * s[PER_MASS, j] + s[DRIVE_X, j]
        vy += (s[FY, j + 1] - s[FY, j]) * s[PER_MASS, j] + s[DRIVE_Y, j]
        s[VX, j] = vx
        s[VY, j] = vy
        s[X, j] += step * vx
        s[Y, j] += step * vy
        if spatial is not None:
            vz = s[VZ, j]
            if decay is not None:
                vz = decay * vz
            vz += (s[FZ, j + 1] - s[FZ, j]) * s[PER_MASS, j] + s[DRIVE_Z, j]
            s[VZ, j] = vz
            s[Z, j] += step * vz


@compiled(inline="always")
def _extremes(s, links, green, spatial):
    """Update the extremes of the tensions; by law (21) with their sign, which the size of a force does not tell."""
    for j in range(links):
        if green is None:
            size = s[FX, j + 1] * s[FX, j + 1] + s[FY, j + 1] * s[FY, j + 1]
            if spatial is not None:
                size += s[FZ, j + 1] * s[FZ, j + 1]
        else:
            dx = s[X, j + 1] - s[X, j]
            dy = s[Y, j + 1] - s[Y, j]
            square = dx * dx + dy * dy
            if spatial is not None:
                dz = s[Z, j + 1] - s[Z, j]
                square += dz * dz
            pull = 0.5 * s[STIFFNESS, j] * (square * s[INVERSE, j] - 1.0)
            size = pull * abs(pull) * square
        s[LOW, j] = min(s[LOW, j], size)
        s[HIGH, j] = max(s[HIGH, j], size)


@compiled
def _advance(
    s, links, spatial, green, step, decay, viscosity, patterns, factors, rows, columns, ends, end_rates, begin, end, extremes,
):  # fmt: skip
    """Take the steps begin ... end - 1 of the tables; apart from saving, so that the compiler sees a plain loop."""
    for i in range(begin, end):
        if viscosity is not None:
            _predict(s, links, spatial)
            for m in range(rows.size):
                s[rows[m] + UX, columns[m]] = end_rates[m, i]
            _pull_viscous(s, links, viscosity, spatial)
        elif green is not None:
            _pull_green(s, links, spatial)
        else:
            _pull(s, links, spatial)
        if extremes is not None:
            _extremes(s, links, green, spatial)
        if patterns is not None:
            _drive(s, links, patterns, factors, i, spatial)
        _move(s, links, step, decay, spatial)
        for m in range(rows.size):
            s[rows[m], columns[m]] = ends[m, i + 1]


@compiled
def _verlet(
    s, links, spatial, green, step, decay, viscosity, patterns, factors, rows, columns, ends, end_rates, extremes,
    steps, start, save_steps, saved, saved_half,
):  # fmt: skip
    """Advance one chain, as :func:`verlet` does several; arrays without their first dimension."""
    dims = saved.shape[1]
    save, i = 0, 0
    while i < steps:
        target = steps
        saving = save < save_steps.size and save_steps[save] == start + i
        if saving:
            saved[save] = s[X : X + dims, : links + 1]
            if saved_half is not None:
                saved_half[save, 0] = s[VX : VX + dims, : links + 1]
                target = i + 1
        if target == steps and save + saving < save_steps.size:
            target = save_steps[save + saving] - start
        _advance(
            s, links, spatial, green, step, decay, viscosity, patterns, factors, rows, columns, ends, end_rates, i, target,
            extremes,
        )  # fmt: skip
        i = target
        if saving:
            if saved_half is not None:
                saved_half[save, 1] = s[VX : VX + dims, : links + 1]
            save += 1


@compiled
def verlet(
    states, sound, links, spatial, green, step, decays, viscosities, patterns, factors, rows, columns, ends, end_rates, extremes,
    steps, start, save_steps, first, last, saved, saved_half,
):  # fmt: skip
    """Advance chains of equal shape by `steps` steps of velocity Verlet in leapfrog form, one after the other.

    Entering and leaving, positions are those of step `start`, velocities those half a step before it: the forces of a step
    are computed once, and saving changes nothing.

    Parameters
    ----------
    states : float array (chains, ROWS, columns)
        Their states, see the constants of this module; advanced in place.
    sound : bool array (chains,)
        Those to advance.
    links : int
        Number of links n.
    spatial, green, extremes : True or None
        Whether there is a third coordinate, whether law (21) holds, whether extremes of the tensions are kept.
    step : float
        [s].
    decays : float array (chains,) or None
        exp(-damping step), damping per mass; None without.
    viscosities : float array (chains,) or None
        Viscosity of the links over their stiffness [s]; only with the linear law.
    patterns, factors : float arrays (chains, loads, dims, n + 1), (chains, loads, steps + 1 or more) or None
        Loads that vary in time, as what they add to the velocity in a step [m/s], and their factors at the steps.
    rows, columns : int arrays (moving,)
        Where in the state the coordinates of the ends are that move.
    ends : float array (chains, moving, steps + 1 or more)
        Their values at the steps from `start` on [m].
    end_rates : float array (chains, moving, steps + 1 or more) or None
        Their rates [m/s]; only with viscosity.
    steps, start : int
        Number of steps, number of the first.
    save_steps : int array (saves,)
        Rising numbers of the steps to save; those from `first` up to `last` lie in start <= number < start + steps.
    first, last : int
        Which of them these steps meet.
    saved : float array (chains, saves, dims, n + 1)
        Filled with positions.
    saved_half : float array (chains, saves, 2, dims, n + 1) or None
        Filled with the velocities half a step before and half a step after.
    """
    for m in range(states.shape[0]):
        if sound[m]:
            _verlet(
                states[m], links, spatial, green, step,
                None if decays is None else decays[m],
                None if viscosities is None else viscosities[m],
                None if patterns is None else patterns[m],
                None if factors is None else factors[m],
                rows, columns, ends[m],
                None if end_rates is None else end_rates[m],
                extremes, steps, start, save_steps[first:last], saved[m, first:last],
                None if saved_half is None else saved_half[m, first:last],
            )  # fmt: skip


@compiled
def green_strain(load):
    """Find xi - 1 of a pulled link by law (21), xi (xi^2 - 1)/2 = load, tension over stiffness.

    In e = xi - 1 this is e (1 + e) (1 + e/2) = load, convex and rising, so Newton's method from e = load, too large, comes down
    to the solution without a jump beyond it, and no digit of a small strain is lost.
    """
    e = load
    for _ in range(60):
        e_next = e - (e * (1.0 + e) * (1.0 + 0.5 * e) - load) / (1.0 + 3.0 * e + 1.5 * e * e)
        if not e_next < e:
            break
        e = e_next
    return e


@compiled
def secant_modulus(size, stiffness, green):
    """Tension over strain [N] of a link under the tension `size` [N]: K, by law (21) K (1 + e) (1 + e/2)."""
    if not green:
        return stiffness
    e = green_strain(size / stiffness)
    return stiffness * (1.0 + e) * (1.0 + 0.5 * e)


@compiled
def secant_moduli(sizes, stiffness, green, out):
    """Fill `out` (links,) with :func:`secant_modulus` of each."""
    for j in range(sizes.size):
        out[j] = secant_modulus(sizes[j], stiffness, green)
