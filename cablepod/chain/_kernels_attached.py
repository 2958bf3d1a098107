"""Compiled forces of dampers, springs and drag at attachments of a chain.

A damper acts at the middle of two half steps of the explicit scheme and is solved for at its particle, so that it has no limit of
the step.
"""

import math

from cablepod._jit import compiled
from cablepod.chain._kernels_layout import PER_MASS, VX, X
from cablepod.wind._kernels_drag import body_drag, relative_velocity, sample_at

#: Columns of the numbers of an attachment: unit vector, place without force, damper [N s/m], spring [N/m], two for a step.
DIRECTION, REST, DAMPER, SPRING, BEFORE, STRETCH = 0, 3, 6, 7, 8, 9
COLUMNS = 10


@compiled(inline="always")
def note_along(x, v, particles, numbers):
    """Keep velocity half a step before and displacement along each direction, before a step; x and v are (dims, n + 1)."""
    for m in range(particles.size):
        j, before, stretch = particles[m], 0.0, 0.0
        for c in range(x.shape[0]):
            before += numbers[m, DIRECTION + c] * v[c, j]
            stretch += numbers[m, DIRECTION + c] * (x[c, j] - numbers[m, REST + c])
        numbers[m, BEFORE], numbers[m, STRETCH] = before, stretch


@compiled(inline="always")
def note_attached(s, particles, numbers):
    """Keep velocity half a step before and displacement along each direction, before a step, in the state of a chain.

    Rows of one array, whose loops are faster than those of :func:`note_along`, as of :func:`apply_attached`.
    """
    for m in range(particles.size):
        j, before, stretch = particles[m], 0.0, 0.0
        for c in range(3):
            before += numbers[m, DIRECTION + c] * s[VX + c, j]
            stretch += numbers[m, DIRECTION + c] * (s[X + c, j] - numbers[m, REST + c])
        numbers[m, BEFORE], numbers[m, STRETCH] = before, stretch


@compiled(inline="always")
def _velocity_change(after, before, pull, damper, per_mass):
    """Return the change of a velocity along an attachment in a step, by the pull of its spring and by its damper.

    A damper c on a mass m changes the velocity by a = c step / 2 m times minus the sum of the velocities before and after.

    Parameters
    ----------
    after, before : float
        Velocities half a step after, without the attachment, and before [m/s].
    pull, damper, per_mass : float
        Force of the spring against the direction [N]; damper [N s/m]; step over mass [s/kg].
    """
    a = 0.5 * damper * per_mass
    return (after - pull * per_mass - a * before) / (1.0 + a) - after


@compiled(inline="always")
def apply_along(x, v, particles, numbers, per_mass, impulse, step):
    """Add dampers and springs to the velocities half a step after, and to the positions of the next step.

    Step over mass is `per_mass` times `impulse`.
    """
    for m in range(particles.size):
        j, after = particles[m], 0.0
        for c in range(x.shape[0]):
            after += numbers[m, DIRECTION + c] * v[c, j]
        pull = numbers[m, SPRING] * numbers[m, STRETCH]
        change = _velocity_change(after, numbers[m, BEFORE], pull, numbers[m, DAMPER], impulse * per_mass[j])
        for c in range(x.shape[0]):
            v[c, j] += numbers[m, DIRECTION + c] * change
            x[c, j] += step * (numbers[m, DIRECTION + c] * change)


@compiled(inline="always")
def apply_attached(s, particles, numbers, step):
    """Do :func:`apply_along` in the state of a chain."""
    for m in range(particles.size):
        j, after = particles[m], 0.0
        for c in range(3):
            after += numbers[m, DIRECTION + c] * s[VX + c, j]
        pull = numbers[m, SPRING] * numbers[m, STRETCH]
        change = _velocity_change(after, numbers[m, BEFORE], pull, numbers[m, DAMPER], s[PER_MASS, j])
        for c in range(3):
            s[VX + c, j] += numbers[m, DIRECTION + c] * change
            s[X + c, j] += step * (numbers[m, DIRECTION + c] * change)


@compiled
def attached_forces(x, v, particles, numbers, force):
    """Add the forces of dampers and springs [N] at positions and velocities (dims, n + 1) to `force` (dims, n + 1)."""
    for m in range(particles.size):
        j, along = particles[m], 0.0
        for c in range(x.shape[0]):
            direction = numbers[m, DIRECTION + c]
            along -= direction * numbers[m, DAMPER] * v[c, j]
            along -= direction * numbers[m, SPRING] * (x[c, j] - numbers[m, REST + c])
        for c in range(x.shape[0]):
            force[c, j] += along * numbers[m, DIRECTION + c]


@compiled
def attached_tangent(particles, numbers, part, rate, own):
    """Add the negative derivative of these forces by the unknowns of a step to the symmetric blocks `own` (3 or 6, n + 1) [N/m].

    `part` is the derivative of the position, `rate` that of the velocity by the unknowns [1, 1/s].
    """
    dims = 2 if own.shape[0] == 3 else 3
    for m in range(particles.size):
        stiffness, row = numbers[m, SPRING] * part + numbers[m, DAMPER] * rate, 0
        for c in range(dims):
            for e in range(c, dims):
                own[row, particles[m]] += stiffness * numbers[m, DIRECTION + c] * numbers[m, DIRECTION + e]
                row += 1


@compiled
def add_bodies(v, wind, place, bodies, force, scale, own):
    """Add the drag of bodies, b |u| u with the relative velocity u of the air, to `force` (dims, n + 1) [N].

    Parameters
    ----------
    v, wind, place
        As in :func:`cablepod.chain._kernels_drag.drag_forces`.
    bodies : float array (n + 1,)
        Half the density of the air times drag area b [kg/m]; 0 at held particles.
    force : float array (dims, n + 1)
        Added to.
    scale : float
        Derivative of the velocities by the unknowns of a step [1/s].
    own : float array (3 or 6, n + 1) or None
        Added to: `scale` times the negative derivative of the force by the velocities, b (|u| + u u / |u|), in symmetric blocks.
    """
    dims = v.shape[0]
    sample, share = sample_at(place, wind.shape[0])
    for j in range(bodies.size):
        u = relative_velocity(wind[sample], wind[sample + 1], share, v, j)
        drag, row = body_drag(bodies[j], *u), 0
        speed = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        if bodies[j] == 0.0 or speed == 0.0:
            continue
        for c in range(dims):
            force[c, j] += drag[c]
            if own is not None:
                for e in range(c, dims):
                    own[row, j] += scale * (drag[c] * u[e] / (speed * speed) + (bodies[j] * speed if e == c else 0.0))
                    row += 1


@compiled
def add_body_drag(s, links, before, after, share, bodies, row, dims):
    """Add the velocity increments in a step by the drag of bodies to the rows from `row` on, see :func:`add_bodies`."""
    for j in range(links + 1):
        if bodies[j] == 0.0:
            continue
        drag = body_drag(bodies[j] * s[PER_MASS, j], *relative_velocity(before, after, share, s[VX : VX + dims], j))
        for c in range(dims):
            s[row + c, j] += drag[c]
