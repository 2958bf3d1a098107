"""Compiled run of a mast whose guys are chains of lumped masses and elastic links, by explicit leapfrog steps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.chain._kernels_attached import DAMPER, DIRECTION, REST, SPRING, velocity_change
from cablepod.mast._kernels_mast import (
    TAPS,
    _advance_mast,
    _air_work,
    _begin_step,
    _is_finite,
    _record,
    _sample_weights,
    _save,
)

DONE, DIVERGED = range(2)
#: Rows of the links of guys with segments or attachments: axial stiffness [N], length [m]; and of their particles: inverse of the
#: mass [1/kg], place between the points of the air, drag [kg/m2] as that of a uniform guy, and that of what is attached [kg/m].
LINK_STIFFNESS, LINK_LENGTH = range(2)
PER_MASS, PLACE, DRAG, BODY = range(4)


class UnequalLinks(NamedTuple):
    """Links and particles of guys with segments or attachments; of all guys of their mast."""

    links: Any  #: (guys, 2, n)
    particles: Any  #: (guys, 4, n + 1)
    first: Any  #: first damper or spring of each guy, and their number (guys + 1,)
    attached: Any  #: their particles (attachments,)
    numbers: Any  #: (attachments, COLUMNS), see :mod:`cablepod.chain._kernels_attached`


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _link_forces(x, v, stiffness, length, viscosity, links, forces):
    """Fill the forces of the links on their lower particles (3, n) [N]; links only pull.

    Force K (strain + viscosity times strain rate), which damps the motion between neighbouring particles along slackening links.
    `links` has the stiffness and length of each, see :class:`UnequalLinks`; None for equal ones.
    """
    for j in range(forces.shape[1]):
        if links is not None:
            stiffness, length = links[LINK_STIFFNESS, j], links[LINK_LENGTH, j]
        dx, dy, dz = x[0, j + 1] - x[0, j], x[1, j + 1] - x[1, j], x[2, j + 1] - x[2, j]
        rate = dx * (v[0, j + 1] - v[0, j]) + dy * (v[1, j + 1] - v[1, j]) + dz * (v[2, j + 1] - v[2, j])
        inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        elastic = stiffness * (1.0 / length - inverse)
        secant = elastic + viscosity * stiffness / length * rate * inverse * inverse
        secant = max(secant, 0.0) if elastic > 0.0 else 0.0
        forces[0, j], forces[1, j], forces[2, j] = secant * dx, secant * dy, secant * dz


@compiled(fastmath=FAST_DIVISION, forceinline=True)
def _drag_forces(x, v, wind, place, g, drag, particles, links, forces):
    """Fill the drag on the particles (3, n + 1) [N]: c |t| |u_n| u_n over half of the links beside each.

    `wind` is (samples, guys, points, 3) [m/s], linear between samples and between equally spaced points.  `particles` has place,
    drag and that of what is attached, b |u| u, of each, see :class:`UnequalLinks`; None for equal ones.
    """
    place = min(max(place, 0.0), wind.shape[0] - 1.0)
    sample = min(int(place), wind.shape[0] - 2)
    share = place - sample
    points = wind.shape[2]
    for j in range(links + 1):
        low, high = max(j - 1, 0), min(j + 1, links)
        tx, ty, tz = x[0, high] - x[0, low], x[1, high] - x[1, low], x[2, high] - x[2, low]
        square = tx * tx + ty * ty + tz * tz
        at = j * (points - 1.0) / links if particles is None else particles[PLACE, j]
        left = min(int(at), points - 2)
        part = at - left
        u0 = u1 = u2 = 0.0
        for k in range(2):
            weight = (1.0 - share) if k == 0 else share
            row = sample + k
            u0 += weight * ((1.0 - part) * wind[row, g, left, 0] + part * wind[row, g, left + 1, 0])
            u1 += weight * ((1.0 - part) * wind[row, g, left, 1] + part * wind[row, g, left + 1, 1])
            u2 += weight * ((1.0 - part) * wind[row, g, left, 2] + part * wind[row, g, left + 1, 2])
        u0 -= v[0, j]
        u1 -= v[1, j]
        u2 -= v[2, j]
        b0 = b1 = b2 = 0.0
        if particles is not None:
            drag = particles[DRAG, j]
            body = particles[BODY, j] * math.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
            b0, b1, b2 = body * u0, body * u1, body * u2
        along = (u0 * tx + u1 * ty + u2 * tz) / square
        u0 -= along * tx
        u1 -= along * ty
        u2 -= along * tz
        size = 0.5 * drag * math.sqrt(square * (u0 * u0 + u1 * u1 + u2 * u2))
        forces[0, j], forces[1, j], forces[2, j] = size * u0 + b0, size * u1 + b1, size * u2 + b2


@compiled(forceinline=True)
def _note_attached(x, v, first, last, attached, numbers, noted):
    """Fill velocities half a step before [m/s] and pulls of the springs [N] along the attachments (attachments, 2)."""
    for m in range(first, last):
        j, before, stretch = attached[m], 0.0, 0.0
        for c in range(3):
            before += numbers[m, DIRECTION + c] * v[c, j]
            stretch += numbers[m, DIRECTION + c] * (x[c, j] - numbers[m, REST + c])
        noted[m, 0], noted[m, 1] = before, numbers[m, SPRING] * stretch


@compiled(forceinline=True)
def _apply_attached(x, v, first, last, attached, numbers, noted, impulse, per_mass, step):
    """Add dampers and springs to the velocities half a step after and to the positions of the next step."""
    for m in range(first, last):
        j, after = attached[m], 0.0
        for c in range(3):
            after += numbers[m, DIRECTION + c] * v[c, j]
        change = velocity_change(after, noted[m, 0], noted[m, 1], numbers[m, DAMPER], impulse * per_mass[j])
        for c in range(3):
            v[c, j] += numbers[m, DIRECTION + c] * change
            x[c, j] += step * (numbers[m, DIRECTION + c] * change)


@compiled(fastmath=FAST_DIVISION)
def chain_run(
    step, every, steps, hold, window, a, v, x, rates, constant, mast_stiffness, pulls, keep, gain, level_rows, level_rest,
    guy_level, stiffness, length, mass, end_mass, unequal, viscosity, gravity, mass_damping, breaks, load_vectors, factors,
    samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, guy_samples_per_step, guy_wind, guy_drag,
    saved, saved_rates, saved_force, saved_tension, saved_drag, level_extremes, level_sums, tension_extremes, tension_sums,
    monitor,
):  # fmt: skip
    """Run a mast with chains from rest; return the status, the step and the guy at which it was found.

    Parameters
    ----------
    hold
        Steps from one evaluation of the drag on guys to the next.
    x, rates
        Positions of the particles from anchor to mast and their rates half a step before (guys, 3, n + 1) [m, m/s]; changed.
    stiffness, length, mass
        Axial stiffness [N], length [m] and mass [kg] of a link of each guy (guys,), where its links are equal.
    end_mass
        Mass of the upper particle of each guy (guys,) [kg].
    unequal
        Links and particles of guys with segments or attachments, see :class:`UnequalLinks`; None without any.
    viscosity
        Damping force of a link per axial stiffness and strain rate [s].
    gravity, mass_damping
        [m/s2, 1/s]
    breaks
        Steps from which the upper links carry no force (guys,).
    step, every, steps, window, a, v, constant, mast_stiffness, pulls, keep, gain, level_rows, level_rest, guy_level, \
load_vectors, factors, samples_per_step, table, mast_wind, node_columns, node_rows, node_drag, saved, saved_rates, saved_force, \
saved_tension, saved_drag, level_extremes, level_sums, tension_extremes, tension_sums
        As in :func:`cablepod.mast._kernels_condensed.condensed_run`.
    guy_samples_per_step, guy_wind, guy_drag
        Samples in a step; air along the guys, see :func:`_drag_forces`; half the density of the air times drag coefficient and
        diameter [kg/m2].
    monitor
        Least tension of a link of each guy at the outputs before it breaks [N] and its step (guys, 2).
    """
    count, n, levels = x.shape[0], x.shape[2] - 1, level_rest.shape[0]
    force, before, mean_rate = np.empty(a.size), v.copy(), np.empty(a.size)
    upper, upper_rate, level_force = np.empty((levels, 2)), np.empty((levels, 2)), np.empty((levels, 3))
    acceleration = np.empty((levels, 2))
    forces, drags = np.empty((3, n)), np.zeros((count, 3, n + 1))
    guy_force, tension = np.empty((count, 3)), np.empty(count)
    factor = (1.0 - 0.5 * mass_damping * step) / (1.0 + 0.5 * mass_damping * step)
    impulse = step / (1.0 + 0.5 * mass_damping * step)
    work, weights, left = _air_work(node_drag), np.empty(TAPS), 0
    heights = x[:, 1, n].copy()
    noted = np.empty((0 if unequal is None else unequal.attached.size, 2))
    for k in range(steps + 1):
        if mast_wind is not None:
            left = _sample_weights(k * samples_per_step, mast_wind.shape[0], table, weights)
        _begin_step(
            k, a, v, before, constant, load_vectors, factors, left, weights, mast_wind, node_columns, node_rows, node_drag, work,
            level_rows, level_rest, pulls, mean_rate, force, upper, upper_rate, level_force,
        )  # fmt: skip
        for g in range(count):
            m = guy_level[g]
            held = k < breaks[g]
            if held:
                x[g, 0, n], x[g, 1, n], x[g, 2, n] = upper[m, 0], heights[g] + pulls[3][m], upper[m, 1]
                rates[g, 0, n], rates[g, 2, n] = upper_rate[m, 0], upper_rate[m, 1]
            if unequal is None:
                _link_forces(x[g], rates[g], stiffness[g], length[g], viscosity, None, forces)
            else:
                _link_forces(x[g], rates[g], stiffness[g], length[g], viscosity, unequal.links[g], forces)
                here, beyond = unequal.first[g], unequal.first[g + 1]
                _note_attached(x[g], rates[g], here, beyond, unequal.attached, unequal.numbers, noted)
            if not held:
                forces[0, n - 1] = forces[1, n - 1] = forces[2, n - 1] = 0.0
            if guy_wind is not None and k % hold == 0:
                place = k * guy_samples_per_step
                if unequal is None:
                    _drag_forces(x[g], rates[g], guy_wind, place, g, guy_drag[g], None, n, drags[g])
                else:
                    _drag_forces(x[g], rates[g], guy_wind, place, g, guy_drag[g], unequal.particles[g], n, drags[g])
            if held and k % every == 0:
                for j in range(n):
                    pull = math.sqrt(forces[0, j] ** 2 + forces[1, j] ** 2 + forces[2, j] ** 2)
                    if not pull >= monitor[g, 0]:
                        monitor[g, 0], monitor[g, 1] = pull, k
            inverse = 1.0 / mass[g]
            for d in range(3):
                weight = -gravity if d == 1 else 0.0
                for j in range(1, n):
                    if unequal is not None:
                        inverse = unequal.particles[g, PER_MASS, j]
                    push = (forces[d, j] - forces[d, j - 1] + drags[g, d, j]) * inverse + weight
                    if k == 0:
                        rates[g, d, j] = 0.5 * step * push
                    else:
                        rates[g, d, j] = factor * rates[g, d, j] + impulse * push
                for j in range(1, n):
                    x[g, d, j] += step * rates[g, d, j]
                # on the mast: the upper link, and weight and drag of half a link
                guy_force[g, d] = 0.0
                if held:
                    guy_force[g, d] = -forces[d, n - 1] + drags[g, d, n] + end_mass[g] * weight
            if unequal is not None and k > 0:  # at the start nothing moves
                here, beyond, per_mass = unequal.first[g], unequal.first[g + 1], unequal.particles[g, PER_MASS]
                _apply_attached(
                    x[g], rates[g], here, beyond, unequal.attached, unequal.numbers, noted, impulse, per_mass, step
                )
            level_force[m, 0] += guy_force[g, 0]
            level_force[m, 1] += guy_force[g, 2]
            level_force[m, 2] += guy_force[g, 1]
        _advance_mast(
            k == 0,
            step,
            a,
            v,
            before,
            force,
            mast_stiffness,
            pulls[2],
            pulls[4],
            keep,
            gain,
            level_rows,
            level_force,
            acceleration,
        )
        for g in range(count):
            m = guy_level[g]
            if k < breaks[g]:
                guy_force[g, 0] -= end_mass[g] * acceleration[m, 0]
                guy_force[g, 2] -= end_mass[g] * acceleration[m, 1]
            tension[g] = math.sqrt(guy_force[g, 0] ** 2 + guy_force[g, 1] ** 2 + guy_force[g, 2] ** 2)
        _record(k, window, upper, tension, level_extremes, level_sums, tension_extremes, tension_sums)
        _save(
            k, every, a, v, before, guy_force, tension, work, saved, saved_rates, saved_force, saved_tension, saved_drag
        )  # fmt: skip
        if not _is_finite(v):
            return DIVERGED, k, 0
        if k % every == 0:
            for g in range(count):
                if not _is_finite(x[g].ravel()):
                    return DIVERGED, k, g
        for i in range(a.size):
            a[i] += step * v[i]
    return DONE, steps, 0
