"""Compiled terms of the explicit chain: forces of links, loads, predicted velocities and extremes of a state.

The state of a run is one array with a row for each quantity, see :mod:`cablepod.chain._kernels_layout`; `spatial` is True with a
third coordinate, None without.
"""

import math

from cablepod._jit import compiled
from cablepod.chain import _kernels_layout as at
from cablepod.discretisation._kernels_laws import (
    damping_by_tension,
    green_secant,
    linear_secant,
    taut_secant,
    viscous_secant,
)


@compiled(inline="always")
def _link(s, j, spatial):
    """Return the vector of a link, 0 along z in the plane, and its squared length."""
    dx, dy, dz = s[at.X, j + 1] - s[at.X, j], s[at.Y, j + 1] - s[at.Y, j], 0.0
    square = dx * dx + dy * dy
    if spatial is not None:
        dz = s[at.Z, j + 1] - s[at.Z, j]
        square += dz * dz
    return dx, dy, dz, square


@compiled(inline="always")
def _link_forces(s, links, green, spatial):
    """Compute forces of the links [N]: by law (21), or by the linear law, 0 for slack links."""
    for j in range(links):
        dx, dy, dz, square = _link(s, j, spatial)
        if green:
            secant = green_secant(square * s[at.INVERSE, j], s[at.STIFFNESS, j])
        else:
            elastic = linear_secant(s[at.LENGTH, j] / math.sqrt(square), s[at.STIFFNESS, j])
            secant = taut_secant(elastic, elastic)
        s[at.FX, j + 1], s[at.FY, j + 1] = secant * dx, secant * dy
        if spatial is not None:
            s[at.FZ, j + 1] = secant * dz


@compiled(inline="always")
def _viscous_forces(s, links, viscosity, spatial):
    """Compute forces of viscous links from the predicted velocities [N]; 0 for slack links."""
    for j in range(links):
        dx, dy, dz, square = _link(s, j, spatial)
        rate = dx * (s[at.UX, j + 1] - s[at.UX, j]) + dy * (s[at.UY, j + 1] - s[at.UY, j])
        if spatial is not None:
            rate += dz * (s[at.UZ, j + 1] - s[at.UZ, j])
        elastic = linear_secant(s[at.LENGTH, j] / math.sqrt(square), s[at.STIFFNESS, j])
        secant = taut_secant(elastic, viscous_secant(elastic, rate, square, viscosity * s[at.STIFFNESS, j]))
        s[at.FX, j + 1], s[at.FY, j + 1] = secant * dx, secant * dy
        if spatial is not None:
            s[at.FZ, j + 1] = secant * dz


@compiled(inline="always")
def _add_tension_damping(s, links, tension_damping, spatial):
    """Add the damping forces by the tension T [N], tension_damping T / |R| times the difference of the predicted velocities."""
    for j in range(links):
        dx, dy, dz, square = _link(s, j, spatial)
        along = s[at.FX, j + 1] * dx + s[at.FY, j + 1] * dy
        if spatial is not None:
            along += s[at.FZ, j + 1] * dz
        damping = damping_by_tension(along / square, along, tension_damping)
        s[at.FX, j + 1] += damping * (s[at.UX, j + 1] - s[at.UX, j])
        s[at.FY, j + 1] += damping * (s[at.UY, j + 1] - s[at.UY, j])
        if spatial is not None:
            s[at.FZ, j + 1] += damping * (s[at.UZ, j + 1] - s[at.UZ, j])


@compiled(inline="always")
def _predict_velocities(s, links, spatial):
    """Extrapolate the velocity at the step from the last two half steps, which preserves second order."""
    for j in range(links + 1):
        s[at.UX, j] = s[at.VX, j] + 0.5 * (s[at.VX, j] - s[at.BX, j])
        s[at.UY, j] = s[at.VY, j] + 0.5 * (s[at.VY, j] - s[at.BY, j])
        s[at.BX, j] = s[at.VX, j]
        s[at.BY, j] = s[at.VY, j]
        if spatial is not None:
            s[at.UZ, j] = s[at.VZ, j] + 0.5 * (s[at.VZ, j] - s[at.BZ, j])
            s[at.BZ, j] = s[at.VZ, j]


@compiled(inline="always")
def _load_increments(s, links, patterns, factors, i, spatial):
    """Compute the velocity increments of step `i` by constant and time-dependent loads."""
    factor = factors[0, i]
    for j in range(links + 1):
        s[at.LOAD_X, j] = s[at.STEADY_X, j] + factor * patterns[0, 0, j]
        s[at.LOAD_Y, j] = s[at.STEADY_Y, j] + factor * patterns[0, 1, j]
        if spatial is not None:
            s[at.LOAD_Z, j] = s[at.STEADY_Z, j] + factor * patterns[0, 2, j]
    for load in range(1, patterns.shape[0]):
        factor = factors[load, i]
        for j in range(links + 1):
            s[at.LOAD_X, j] += factor * patterns[load, 0, j]
            s[at.LOAD_Y, j] += factor * patterns[load, 1, j]
            if spatial is not None:
                s[at.LOAD_Z, j] += factor * patterns[load, 2, j]


@compiled(inline="always")
def _extremes(s, links, spatial):
    """Update the extremes of T |T| by the linear law, whose forces have no compression."""
    for j in range(links):
        signed_tension_square = s[at.FX, j + 1] * s[at.FX, j + 1] + s[at.FY, j + 1] * s[at.FY, j + 1]
        if spatial is not None:
            signed_tension_square += s[at.FZ, j + 1] * s[at.FZ, j + 1]
        s[at.LOW, j] = min(s[at.LOW, j], signed_tension_square)
        s[at.HIGH, j] = max(s[at.HIGH, j], signed_tension_square)


@compiled(inline="always")
def _green_extremes(s, links, spatial):
    """Update the extremes of T |T| by law (21), from the stretch, as the norm of a force has no sign."""
    for j in range(links):
        _, _, _, square = _link(s, j, spatial)
        secant = green_secant(square * s[at.INVERSE, j], s[at.STIFFNESS, j])
        signed_tension_square = secant * abs(secant) * square
        s[at.LOW, j] = min(s[at.LOW, j], signed_tension_square)
        s[at.HIGH, j] = max(s[at.HIGH, j], signed_tension_square)
