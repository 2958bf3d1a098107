"""Compiled drag of the wind on the nodes of the spectral elements, with relative velocity."""

from __future__ import annotations

from cablepod._jit import compiled
from cablepod.cable._kernels_forces import _gradient
from cablepod.chain._kernels_attached import add_bodies
from cablepod.wind._kernels_drag import relative_velocity, sample_at, straight_drag


@compiled
def _nodal_drag(u, g, wind, place, drag, ratios, weight, scale, force, tangent):
    """Fill the drag at the nodes: drag w |g| |u_n| u_n, u_n the part of wind less velocity normal to the cable.

    Parameters
    ----------
    u : float array (dims, N)
        Velocities of the nodes [m/s].
    g : float array (dims, p + 1, elements)
        Derivative of the position by arc length at the quadrature points, which are the nodes of the elements.
    wind : float array (samples, dims, N)
        Velocity of the air at the nodes [m/s], linear between the samples.
    place, drag : float
        Place between the samples; half the density of the air times drag coefficient and diameter [kg/m2].
    ratios : float array (2, elements) or None
        Axial stiffness and drag of the elements over those of the cable; None for a uniform cable.
    weight, scale : float arrays (p + 1,), (elements,)
        Quadrature weights, with sum 2; 2 over the unstretched lengths of the elements [1/m].
    force : float array (dims, N)
        Filled: drag [N].
    tangent : float array (dims, dims, N) or None
        Filled: negative derivative of the drag by the velocities, drag w |g| |u_n| (I - t t + n n) with t along the cable and n
        along u_n [kg/s].
    """
    dims, order, elements = u.shape[0], weight.size - 1, scale.size
    sample, share = sample_at(place, wind.shape[0])
    if tangent is not None:
        for c in range(dims):
            for k in range(dims):
                for j in range(u.shape[1]):
                    tangent[c, k, j] = 0.0
    for j in range(u.shape[1]):
        for c in range(dims):
            force[c, j] = 0.0
    for e in range(elements):
        length = 1.0 / scale[e]
        for q in range(order + 1):
            j = e * order + q
            t = g[0, q, e], g[1, q, e], g[2, q, e] if dims == 3 else 0.0
            found = straight_drag(*t, *relative_velocity(wind[sample], wind[sample + 1], share, u, j))
            factor, normal = drag * weight[q] * length * found[0], found[1:]
            if ratios is not None:
                factor *= ratios[1, e]
            for c in range(dims):
                force[c, j] += factor * normal[c]
            if tangent is not None:
                square = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
                speed_squared = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
                of_speed = factor / speed_squared if speed_squared > 0.0 else 0.0
                for c in range(dims):
                    for k in range(dims):
                        tangent[c, k, j] += of_speed * normal[c] * normal[k] - factor * t[c] * t[k] / square
                    tangent[c, c, j] += factor


@compiled
def drag_forces(x, u, wind, place, drag, ratios, bodies, d, weight, scale, unrolled, nodal, g, force):
    """Fill the drag at the nodes for positions x and velocities u (dims, N); others as in :func:`_nodal_drag`.

    Parameters
    ----------
    bodies : float array (N,) or None
        See :func:`cablepod.chain._kernels_attached.add_bodies`.
    d, unrolled
        As in :func:`cablepod.cable._kernels_explicit.verlet`.
    nodal, g : float arrays (p + 1, elements), (dims, p + 1, elements)
        Work arrays.
    """
    for c in range(x.shape[0]):
        _gradient(x[c], d, scale, unrolled, nodal, g[c])
    _nodal_drag(u, g, wind, place, drag, ratios, weight, scale, force, None)
    if bodies is not None:
        add_bodies(u, wind, place, bodies, force, 0.0, None)
