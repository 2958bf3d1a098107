"""Compiled forces of the condensed model that depend on rates, in a run alone: damping, and drag that is held over steps."""

from cablepod._jit import FUSED, compiled
from cablepod.condensed._kernels_closure import _chord_tensions, _geometric_forces
from cablepod.condensed._kernels_drag import _add_body_drag, _add_drag_at, _extrapolate_drag
from cablepod.condensed._kernels_layout import Sizes
from cablepod.discretisation._kernels_laws import damping_by_tension


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _add_rate_forces(sizes, terms, rate_terms, row, tension, u, work, f):
    """Subtract the damping of rates u from the accelerations f (r) of one lane; `work` (r) is overwritten.

    Damping by the tension is beta times the geometric stiffness, and none where the cable is slack.
    """
    if rate_terms.tension_damping > 0.0:
        _geometric_forces(sizes, terms, row, tension, u, work)
        for j in range(len(sizes.modes)):
            f[j] -= damping_by_tension(work[j], tension[0], rate_terms.tension_damping)
    _subtract_modal_damping(rate_terms.modal_damping, u, f)


@compiled(fastmath=FUSED, counted=False)
def _subtract_modal_damping(matrix, u, f):
    """Subtract a damping matrix (r r,) times rates u from forces f (r,); nothing for a matrix without entries."""
    r = u.size
    for j in range(matrix.size // r):
        for k in range(r):
            f[j] -= matrix[j * r + k] * u[k]


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _apply_dampers(matrix, v, u, work):
    """Take the effect of attached dampers off the rates v (r,) half a step after; u and `work` (r,) are overwritten.

    With C acting on the mean of the rates before and after, (1 + h C / 2) v = (1 - h C / 2) u + what other forces add.  So a
    damper has no limit of the step: v loses W (v + u), W = (1 + h C / 2)^-1 h C / 2.

    Parameters
    ----------
    matrix
        W (r r,), see :class:`cablepod.condensed._kernels_layout.RateTerms`.
    v, u
        Rates after the step without dampers, and before it.
    """
    r = v.size
    for j in range(r):
        u[j] += v[j]
    for j in range(r):
        work[j] = 0.0
        for k in range(r):
            work[j] += matrix[j * r + k] * u[k]
    for j in range(r):
        v[j] -= work[j]


@compiled(forceinline=True, counted=False)
def _add_held_drag(air, q, u, stretch, exact, number, step, f):
    """Add the drag of the wind to the accelerations f (r,) in a step, evaluated or held; nothing in still air.

    `stretch` and `exact` as in :func:`cablepod.condensed._kernels_drag._add_drag`; `number` is that of the step.
    """
    if air is None:
        return
    place = number * step * air.samples_per_second
    if air.hold == 1:
        _add_drag_at(q, u, stretch, exact, air.velocity, place, air.drag, air.shapes, air.in_plane, air.work, f)
        _add_body_drag(air.bodies, u, air.velocity, place, air.drag.size, air.shapes[0], air.in_plane, f)
        return
    held, now, before, old = air.held[0], air.held[1], air.held[2], air.held[3]
    if number % air.hold == 0:
        for j in range(now.size):
            now[j] = 0.0
        _add_drag_at(q, u, stretch, exact, air.velocity, place, air.drag, air.shapes, air.in_plane, air.work, now)
        _add_body_drag(air.bodies, u, air.velocity, place, air.drag.size, air.shapes[0], air.in_plane, now)
        _extrapolate_drag(air.hold, number == 0, now, before, old, held)
    for j in range(held.size):
        f[j] += held[j]


@compiled(counted=False)
def rate_forces(terms, rate_terms, rows, q, u, work, f, tension):
    """Fill the damping f (times, r) of rates u at coordinates q (times, r), and H (times,) [N].

    `rows` are the boundary data (times, columns); `work` (r,) is overwritten.
    """
    mean = terms.mean_chordwise_forces
    for t in range(q.shape[0]):
        row, of_time = rows[t], tension[t : t + 1]
        sizes = Sizes((0,), q[t], mean, row[1 + mean.size :])
        _chord_tensions(sizes, terms, row, q[t], of_time)
        for j in range(q.shape[1]):
            f[t, j] = 0.0
        _add_rate_forces(sizes, terms, rate_terms, row, of_time, u[t], work, f[t])
