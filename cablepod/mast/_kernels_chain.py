"""Compiled term of guys that are chains of lumped masses and elastic links, by explicit leapfrog steps."""

import math

import numpy as np

from cablepod._jit import FAST_DIVISION, compiled
from cablepod.chain._kernels_attached import apply_along, note_along
from cablepod.discretisation._kernels_laws import linear_secant, taut_secant, viscous_secant
from cablepod.mast._kernels_layout import BODY, DIVERGED, DONE, DRAG, LINK_LENGTH, LINK_STIFFNESS, PER_MASS, PLACE
from cablepod.wind._kernels_drag import body_drag, sample_at, straight_drag


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _link_forces(x, v, links, viscosity, forces):
    """Fill the forces of the links on their lower particles (3, n) [N]; links only pull.

    Force K (strain + viscosity times strain rate), which damps the motion between neighbouring particles along slackening links.
    """
    for j in range(forces.shape[1]):
        stiffness, length = links[LINK_STIFFNESS, j], links[LINK_LENGTH, j]
        dx, dy, dz = x[0, j + 1] - x[0, j], x[1, j + 1] - x[1, j], x[2, j + 1] - x[2, j]
        rate = dx * (v[0, j + 1] - v[0, j]) + dy * (v[1, j + 1] - v[1, j]) + dz * (v[2, j + 1] - v[2, j])
        square = dx * dx + dy * dy + dz * dz
        elastic = linear_secant(length / math.sqrt(square), stiffness)
        secant = taut_secant(elastic, viscous_secant(elastic, rate, square, viscosity * stiffness))
        forces[0, j] = secant * dx
        forces[1, j] = secant * dy
        forces[2, j] = secant * dz


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _fill_drag(x, v, particles, wind, place, g, drags):
    """Fill the drag on the particles of guy `g` (3, n + 1) [N], with the air at a place in samples.

    It is c |t| |u_n| u_n over half of the links beside each, and b |u| u of what is attached.
    """
    velocity = wind.velocity
    sample, share = sample_at(place, velocity.shape[0])
    last, points = x.shape[1] - 1, velocity.shape[2]
    for j in range(last + 1):
        low, high = max(j - 1, 0), min(j + 1, last)
        left = min(int(particles[PLACE, j]), points - 2)
        part = particles[PLACE, j] - left
        u0 = u1 = u2 = 0.0
        for k in range(2):
            weight = (1.0 - share) if k == 0 else share
            row = sample + k
            u0 += weight * ((1.0 - part) * velocity[row, g, left, 0] + part * velocity[row, g, left + 1, 0])
            u1 += weight * ((1.0 - part) * velocity[row, g, left, 1] + part * velocity[row, g, left + 1, 1])
            u2 += weight * ((1.0 - part) * velocity[row, g, left, 2] + part * velocity[row, g, left + 1, 2])
        u0 -= v[0, j]
        u1 -= v[1, j]
        u2 -= v[2, j]
        b0, b1, b2 = body_drag(particles[BODY, j], u0, u1, u2)
        size, u0, u1, u2 = straight_drag(
            x[0, high] - x[0, low], x[1, high] - x[1, low], x[2, high] - x[2, low], u0, u1, u2
        )
        size *= 0.5 * particles[DRAG, j]
        drags[0, j] = size * u0 + b0
        drags[1, j] = size * u1 + b1
        drags[2, j] = size * u2 + b2


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _note_attached(x, v, particles, numbers):
    """Do :func:`note_along` in a kernel of its own: the loops over links remain vectorised."""
    note_along(x, v, particles, numbers)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _apply_attached(x, v, particles, numbers, per_mass, impulse, step):
    """Do :func:`apply_along` in a kernel of its own, as well."""
    apply_along(x, v, particles, numbers, per_mass, impulse, step)


@compiled(noalias=True, counted=False, forceinline=True, fastmath=FAST_DIVISION)
def _advance_chains(k, pace, chains, guys, mast, wind):
    """Fill the forces on the mast, advance the chains by a step; return status and guy."""
    step, forces, n = pace.step, chains.forces, chains.forces.shape[1]
    half = 0.5 * chains.mass_damping * step
    factor, impulse = (1.0 - half) / (1.0 + half), step / (1.0 + half)
    for g in range(guys.level.size):
        m, held = guys.level[g], k < guys.breaks[g]
        x, v, drags, particles = chains.x[g], chains.rates[g], chains.drags[g], chains.particles[g]
        first, last = chains.first[g], chains.first[g + 1]
        if held:
            x[0, n], x[1, n], x[2, n] = mast.upper[2 * m], chains.heights[g] + mast.lowered[m], mast.upper[2 * m + 1]
            v[0, n], v[2, n] = mast.upper_rate[m, 0], mast.upper_rate[m, 1]
        _link_forces(x, v, chains.links[g], chains.viscosity, forces)
        if last > first:
            _note_attached(x, v, chains.attached[first:last], chains.numbers[first:last])
        if not held:
            forces[0, n - 1] = forces[1, n - 1] = forces[2, n - 1] = 0.0
        if wind is not None and k % wind.hold == 0:
            _fill_drag(x, v, particles, wind, k * wind.samples_per_step, g, drags)
        if held and k % pace.every == 0:
            for j in range(n):
                pull = math.sqrt(forces[0, j] ** 2 + forces[1, j] ** 2 + forces[2, j] ** 2)
                if not pull >= guys.least[g]:
                    guys.least[g], guys.least_step[g] = pull, k
        total = 0.0
        for d in range(3):
            weight = -chains.gravity if d == 1 else 0.0
            for j in range(1, n):
                push = (forces[d, j] - forces[d, j - 1] + drags[d, j]) * particles[PER_MASS, j] + weight
                if k == 0:
                    v[d, j] = 0.5 * step * push
                else:
                    v[d, j] = factor * v[d, j] + impulse * push
            for j in range(1, n):
                x[d, j] += step * v[d, j]
                total += abs(x[d, j])
            # on the mast: the upper link, and weight and drag of half a link
            guys.force[d, g] = -forces[d, n - 1] + drags[d, n] + chains.end_mass[g] * weight
        if k > 0 and last > first:  # at the start nothing moves
            _apply_attached(
                x, v, chains.attached[first:last], chains.numbers[first:last], particles[PER_MASS], impulse, step
            )
        if not total < np.inf:
            return DIVERGED, g
    return DONE, 0
