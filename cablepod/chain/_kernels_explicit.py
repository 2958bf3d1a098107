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
from typing import Any

import numpy as np
from numba import njit

# without the interpreter lock, so that runs in several threads go on side by side
_options: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True}
# Rows of the state; column j is particle j, or link j, which is between the particles j and j + 1.
X, Y, Z = range(3)  #: positions [m]
VX, VY, VZ = range(3, 6)  #: velocities half a step before [m/s]; 0 at held ends
FX, FY, FZ = range(
    6, 9
)  #: forces of the links [N]; that of link j in column j + 1, so that a particle is between its two
STIFFNESS, LENGTH, INVERSE = range(9, 12)  #: of the links [N/m], unstretched [m], and for law (21) 1/length^2 [1/m^2]
PER_MASS = (
    12  #: step over mass [s/kg], 0 at held ends; with decay (1 - decay) / (damping mass), so that damping is exact
)
DRIVE_X, DRIVE_Y, DRIVE_Z = range(13, 16)  #: what loads add to the velocity in a step [m/s]; 0 at held ends
# only with loads that vary in time, which make the drive anew in each step
STEADY_X, STEADY_Y, STEADY_Z = range(16, 19)  #: the part of the drive that is constant [m/s]
# only with viscous links
UX, UY, UZ = range(19, 22)  #: velocities predicted for the step [m/s]
BX, BY, BZ = range(22, 25)  #: velocities a whole step before VX, VY, VZ [m/s]
# only where extremes are wanted
LOW, HIGH = range(25, 27)  #: of T |T| of the links [N^2], which needs no root; with law (21) compression is negative
ROWS = 27
LINE = 8  #: numbers in a cache line


def new_states(chains, links):
    """Make states of zeros (chains, ROWS, at least links + 2).

    Each row begins with a cache line: rows that begin in the middle of a vector take a tenth longer.  An odd number of lines to a
    row keeps the same column of all rows from falling on the same place in the cache.
    """
    shape = (chains, ROWS, LINE * ((links + 1 + LINE) // LINE | 1))
    room = np.zeros(math.prod(shape) + LINE)
    first = -(room.ctypes.data // room.itemsize) % LINE
    return room[first : first + math.prod(shape)].reshape(shape)


@njit(inline="always", **_options)
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


@njit(inline="always", **_options)
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


@njit(inline="always", **_options)
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


@njit(inline="always", **_options)
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


@njit(inline="always", **_options)
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


@njit(inline="always", **_options)
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


@njit(inline="always", **_options)
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


@njit(**_options)
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


@njit(**_options)
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


@njit(**_options)
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


@njit(**_options)
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


@njit(**_options)
def secant_modulus(size, stiffness, green):
    """Tension over strain [N] of a link under the tension `size` [N]: K, by law (21) K (1 + e) (1 + e/2)."""
    if not green:
        return stiffness
    e = green_strain(size / stiffness)
    return stiffness * (1.0 + e) * (1.0 + 0.5 * e)


@njit(**_options)
def secant_moduli(sizes, stiffness, green, out):
    """Fill `out` (links,) with :func:`secant_modulus` of each."""
    for j in range(sizes.size):
        out[j] = secant_modulus(sizes[j], stiffness, green)


@njit(**_options)
def _stretch(force, loads, length, stiffness, green, gap, hessian):
    """Gap between the end of a chain of given first link force and `gap`'s target (added in place); also its Jacobian.

    Returns the complementary energy's part that depends on the force, sum l c(|F|): by the linear law c = T + T^2 / (2 K), by law
    (21) c = T xi - K (xi^2 - 1)^2 / 8.
    """
    dims = force.size
    f = force.copy()
    hessian[:] = 0.0
    energy = 0.0
    for j in range(length.size):
        if j > 0:
            for c in range(dims):
                f[c] -= loads[j - 1, c]
        square = 0.0
        for c in range(dims):
            square += f[c] * f[c]
        size = math.sqrt(square)
        if green:
            e = green_strain(size / stiffness)
            strain = e * (1.0 + 0.5 * e)
            energy += length[j] * (size * (1.0 + e) - 0.5 * stiffness * strain * strain)
        else:
            energy += length[j] * size * (1.0 + 0.5 * size / stiffness)
        if size == 0.0:
            continue
        secant = secant_modulus(size, stiffness, green)
        for c in range(dims):
            gap[c] += length[j] * (f[c] / size + f[c] / secant)
            for d in range(dims):
                hessian[c, d] -= length[j] * (f[c] / size) * (f[d] / size) / size
            hessian[c, c] += length[j] * (1.0 / size + 1.0 / secant)
        if green:
            # along the link the tangent counts: d xi / dT = 1 / (K (3 xi^2 - 1) / 2)
            excess = 1.0 / (stiffness * (1.0 + 3.0 * e + 1.5 * e * e)) - 1.0 / secant
            for c in range(dims):
                for d in range(dims):
                    hessian[c, d] += length[j] * (f[c] / size) * (f[d] / size) * excess
    return energy


@njit(**_options)
def _solve_small(matrix, right):
    """Solve a positive definite system of 2 or 3 unknowns in place; elementary order, so that dimensions agree bit for bit."""
    n = right.size
    for i in range(n):
        for j in range(i):
            factor = matrix[i, j] / matrix[j, j]
            for m in range(j, n):
                matrix[i, m] -= factor * matrix[j, m]
            right[i] -= factor * right[j]
    for i in range(n - 1, -1, -1):
        for m in range(i + 1, n):
            right[i] -= matrix[i, m] * right[m]
        right[i] /= matrix[i, i]


@njit(**_options)
def equilibrium(chord, loads, length, stiffness, green, force):
    """Find the force in the first link of a chain at rest between two points, by Newton's method.

    The force minimises the complementary energy, sum l c(|F|) - F . chord with c(T) = T + T^2 / 2K or its like by law (21), which
    is strictly convex: the steps, shortened until the energy falls, converge from anywhere where no link ends up without force.

    Parameters
    ----------
    chord : float array (dims,)
        From the lower to the upper end [m].
    loads : float array (n - 1, dims)
        Forces on the inner particles [N].
    length : float array (n,)
        Unstretched lengths of the links [m].
    stiffness : float
        Axial stiffness [N].
    green : bool
        Whether law (21) holds instead of the linear one.
    force : float array (dims,)
        A guess of the force in the first link, pointing up the chain; overwritten by the solution [N].

    Returns
    -------
    float
        Largest component of the closing gap that is left [m].
    """
    dims = chord.size
    gap, trial_gap = -chord, np.empty(dims)
    hessian, trial_hessian = np.empty((dims, dims)), np.empty((dims, dims))
    energy = _stretch(force, loads, length, stiffness, green, gap, hessian)
    energy -= _dot(force, chord)
    for _ in range(200):
        move = -gap
        _solve_small(hessian.copy(), move)
        slope = _dot(gap, move)
        part = 1.0
        size = _size(gap)
        for _ in range(60):
            trial = force + part * move
            trial_gap[:] = -chord
            trial_energy = _stretch(trial, loads, length, stiffness, green, trial_gap, trial_hessian)
            trial_energy -= _dot(trial, chord)
            if trial_energy <= energy + 1e-4 * part * slope or _size(trial_gap) < 0.5 * size:
                break
            part *= 0.5
        if not _size(trial_gap) < size and _size(move) <= 1e-9 * _size(force):
            break  # rounding: no step makes the gap smaller
        force[:] = trial
        gap[:] = trial_gap
        hessian[:] = trial_hessian
        energy = trial_energy
        if _size(gap) == 0.0:
            break
    return _size(gap)


@njit(**_options)
def _size(vector):
    largest = 0.0
    for c in range(vector.size):
        if not abs(vector[c]) <= largest:
            largest = abs(vector[c])
    return largest


@njit(**_options)
def _dot(a, b):
    total = 0.0
    for c in range(a.size):
        total += a[c] * b[c]
    return total
