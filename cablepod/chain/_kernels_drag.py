"""Compiled drag of the wind on the particles of a chain, with relative velocity."""

from cablepod._jit import compiled
from cablepod.chain._kernels_attached import add_body_drag
from cablepod.chain._kernels_layout import BASE_X, DRAG_PER_MASS, DRAG_X, LINE, PER_MASS, VX, X
from cablepod.wind._kernels_drag import relative_velocity, sample_at, straight_drag

#: Weights of Adams and Bashforth for the last three evaluations of the drag.
NOW, BEFORE, OLD = 23.0 / 12.0, -16.0 / 12.0, 5.0 / 12.0


@compiled
def drag_forces(x, v, wind, place, drag, first, last, force, damping):
    """Compute the drag on particles: drag l |u_n| u_n, u_n the part normal to the cable of wind less velocity.

    The neighbours of a particle give direction and present length l of the cable at it (half of their distance).

    Parameters
    ----------
    x, v : float arrays (dims, n + 1)
        Positions [m] and velocities [m/s].
    wind, place : float array (samples, dims, n + 1), float
        Velocity of the air at the particles [m/s], linear between the samples; place between these.
    drag : float array (n + 1,)
        Half the density of the air times drag coefficient and diameter at the particles [kg/m2].
    first, last : int
        The free particles, first ... last - 1.
    force, damping : float arrays (dims, n + 1), (n + 1,)
        Filled: drag [N], and its size over that of u_n [kg/s]; 0 at held particles.
    """
    dims, particles = x.shape
    sample, share = sample_at(place, wind.shape[0])
    force[:] = 0.0
    damping[:] = 0.0
    for p in range(first, last):
        below, above = max(p - 1, 0), min(p + 1, particles - 1)
        tz = x[2, above] - x[2, below] if dims == 3 else 0.0
        ux, uy, uz = relative_velocity(wind[sample], wind[sample + 1], share, v, p)
        size, ux, uy, uz = straight_drag(x[0, above] - x[0, below], x[1, above] - x[1, below], tz, ux, uy, uz)
        damping[p] = 0.5 * drag[p] * size
        force[0, p], force[1, p] = damping[p] * ux, damping[p] * uy
        if dims == 3:
            force[2, p] = damping[p] * uz


@compiled
def drag_tangent(x, first, last, scale, force, damping, own):
    """Compute the derivative of the drag by the velocities: damping (I - t t + n n), t along the cable, n along the drag.

    The change of direction and length of the cable is left out: it is small of first order in the sag of a link.

    Parameters
    ----------
    x : float array (dims, n + 1)
        Positions [m].
    first, last : int
        The free particles, first ... last - 1.
    scale : float
        Derivative of the velocities by the unknowns of a step [1/s].
    force, damping : float arrays (dims, n + 1), (n + 1,)
        Results of :func:`drag_forces`.
    own : float array (3 or 6, n + 1)
        Filled: `scale` times xx, xy, yy, in space xx, xy, xz, yy, yz, zz of the symmetric blocks [N/m].
    """
    dims, particles = x.shape
    for p in range(first, last):
        below, above = max(p - 1, 0), min(p + 1, particles - 1)
        along, across = 0.0, 0.0
        for c in range(dims):
            along += (x[c, above] - x[c, below]) ** 2
            across += force[c, p] * force[c, p]
        along, across = 1.0 / along, 1.0 / across if across > 0.0 else 0.0
        factor, row = scale * damping[p], 0
        for c in range(dims):
            for e in range(c, dims):
                value = across * force[c, p] * force[e, p]
                value -= along * (x[c, above] - x[c, below]) * (x[e, above] - x[e, below])
                own[row, p] = factor * (value + (1.0 if e == c else 0.0))
                row += 1


# --- explicit steps -----------------------------------------------------------------------------------------------------


@compiled(noalias=True, counted=False, literal=False, forceinline=True)
def _trace_back(count, back, x, v, earlier):
    """Fill earlier[j + 1] with the coordinate x - back v of particle j half a step `back` [s] before, at the time of v [m]."""
    for j in range(count):
        earlier[j + 1] = x[j] - back * v[j]


@compiled(noalias=True, counted=False, literal=False, forceinline=True)
def _subtract(count, share, before, after, v, u):
    """Fill u with the air's velocity, at a place between two samples, less that of the particles [m/s]."""
    for j in range(count):
        u[j] = before[j] + share * (after[j] - before[j]) - v[j]


@compiled(noalias=True, counted=False, literal=False, forceinline=True)
def _resist(count, half_drag, per_mass, x, ux, y, uy, z, uz):
    """Replace relative velocities u of `count` particles by their increments in a step by the drag, of half of the line t.

    t is the vector between the neighbours; x, y, z begin with the particle before the first one, and z is None in
    the plane; `half_drag` is half of c [kg/m2], `per_mass` the step over the mass [s/kg].
    """
    for j in range(count):
        tz, wz = 0.0, 0.0
        if z is not None:
            tz, wz = z[j + 2] - z[j], uz[j]
        size, wx, wy, wz = straight_drag(x[j + 2] - x[j], y[j + 2] - y[j], tz, ux[j], uy[j], wz)
        factor = half_drag * per_mass[j] * size
        ux[j] = factor * wx
        uy[j] = factor * wy
        if z is not None:
            uz[j] = factor * wz


@compiled(counted=False, literal=False, forceinline=True)
def _drag_on(s, scratch, row, first, count, share, half_drag, before, after, spatial):
    """Fill the rows from `row` on with the drag on `count` particles from `first` on; their coordinates are in `scratch`."""
    for c in range(2 if spatial is None else 3):
        _subtract(count, share, before[c, first:], after[c, first:], s[VX + c, first:], s[row + c, first:])
    _resist(
        count, half_drag, s[DRAG_PER_MASS, first:], s[scratch, first:], s[row, first:], s[scratch + 1, first:],
        s[row + 1, first:], None if spatial is None else s[scratch + 2, first:], None if spatial is None else s[row + 2, first:],
    )  # fmt: skip


@compiled(noalias=True, counted=False, forceinline=True)
def _extrapolate_drag(count, now, before, old, base, increments):
    """Fill the velocity increments by loads and drag until the next evaluation: base + 23/12 now - 16/12 before + 5/12 old."""
    for j in range(count):
        increments[j] = base[j] + NOW * now[j] + BEFORE * before[j] + OLD * old[j]


@compiled(counted=False)
def apply_drag(s, links, wind, place, drag, bodies, step, target, evaluation, spatial):
    """Compute the drag half a step before from the wind (samples, dims, n + 1) [m/s] at a place between its samples.

    The increments of this evaluation and the two before are extrapolated to their mean over the steps until the next one, in the
    rows from `target` on.  Evaluations are numbered from 0; each replaces that three before, and those before the start are that
    of the start.  Loops take whole vectors of LINE particles, as scalar roots and divisions of a remainder would take as long as
    the rest: the last vector computes some particles of the one before again.  `bodies` (n + 1,) have drag of their own [kg/m].
    """
    sample, share = sample_at(place, wind.shape[0])
    half_drag = 0.5 * drag
    before, after = wind[sample], wind[sample + 1]
    now = DRAG_X + 3 * (evaluation % 3)
    earlier, oldest = DRAG_X + 3 * (max(evaluation - 1, 0) % 3), DRAG_X + 3 * (max(evaluation - 2, 0) % 3)
    for c in range(2 if spatial is None else 3):  # at the ends the direction is that of their links
        _trace_back(links + 1, 0.5 * step, s[X + c], s[VX + c], s[target + c])
        s[target + c, 0], s[target + c, links + 2] = s[target + c, 1], s[target + c, links + 1]
    first = 1 if s[PER_MASS, 0] == 0.0 else 0  # of the free particles
    count = (links if s[PER_MASS, links] == 0.0 else links + 1) - first
    whole, last = count // LINE * LINE, first + count - LINE  # a multiple of LINE, as the compiler sees
    _drag_on(s, target, now, first, whole, share, half_drag, before, after, spatial)
    if whole == 0:
        _drag_on(s, target, now, first, count, share, half_drag, before, after, spatial)
    elif whole < count:
        _drag_on(s, target, now, last, LINE, share, half_drag, before, after, spatial)
    if bodies is not None:
        add_body_drag(s, links, before, after, share, bodies, now, 2 if spatial is None else 3)
    columns = (links + LINE) // LINE * LINE
    for c in range(2 if spatial is None else 3):
        _extrapolate_drag(columns, s[now + c], s[earlier + c], s[oldest + c], s[BASE_X + c], s[target + c])
