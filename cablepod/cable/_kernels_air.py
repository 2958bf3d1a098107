"""Compiled drag of the wind on the nodes of the spectral elements, with relative velocity."""

from cablepod._jit import compiled
from cablepod.chain._kernels_attached import add_bodies
from cablepod.wind._kernels_drag import relative_velocity, sample_at, straight_drag


@compiled(counted=False)
def add_drag(elements, air, place, u, g, force, rate, block):
    """Add the drag at the nodes: drag w |g| |u_n| u_n, u_n the part of wind less velocity normal to the cable; and of bodies.

    Parameters
    ----------
    elements, air
        See :mod:`cablepod.cable._kernels_arguments`.
    place : float
        Place between the samples of the wind.
    u : float array (dims, N)
        Velocities of the nodes [m/s].
    g : float array (dims, p + 1, elements)
        Derivative of the position by arc length at the quadrature points, which are the nodes of the elements.
    force : float array (dims, N)
        Added to [N].
    rate : float
        Derivative of the velocities by the unknowns of a step [1/s].
    block : float array (3 or 6, N) or None
        Added to: `rate` times the negative derivative of the drag by the velocities in symmetric blocks,
        drag w |g| |u_n| (I - t t + n n) with t along the cable and n along u_n [N/m].
    """
    dims, order, wind = u.shape[0], elements.weight.size - 1, air.velocity
    sample, share = sample_at(place, wind.shape[0])
    for e in range(elements.scale.size):
        length = 1.0 / elements.scale[e]
        for q in range(order + 1):
            j, row = e * order + q, 0
            t = g[0, q, e], g[1, q, e], g[2, q, e] if dims == 3 else 0.0
            found = straight_drag(*t, *relative_velocity(wind[sample], wind[sample + 1], share, u, j))
            factor, normal = air.drag[e] * elements.weight[q] * length * found[0], found[1:]
            for c in range(dims):
                force[c, j] += factor * normal[c]
            if block is not None:
                square = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
                speed_squared = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
                of_speed = factor / speed_squared if speed_squared > 0.0 else 0.0
                for c in range(dims):
                    for k in range(c, dims):
                        part = of_speed * normal[c] * normal[k] - factor * t[c] * t[k] / square
                        block[row, j] += rate * (part + factor if k == c else part)
                        row += 1
    add_bodies(u, wind, place, air.bodies, force, rate, block)
