"""Loops over the samples of the error equation at one point of the cable, see :mod:`cablepod.condensed._kernels_error`.

Arrays are those of all samples of a block (samples,) and share no memory, so that every loop is vectorised.
"""

from __future__ import annotations

import math

from cablepod._jit import FAST_DIVISION, compiled


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _add(factor, source, total):
    """Add a multiple of `source` to `total` (samples,)."""
    for t in range(total.size):
        total[t] += factor * source[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _add_three(factor, first, second, third, of_first, of_second, of_third):
    """Add a multiple of three arrays to three others (samples,)."""
    for t in range(first.size):
        of_first[t] += factor * first[t]
        of_second[t] += factor * second[t]
        of_third[t] += factor * third[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _add_product(factor, first, second, total):
    """Add a multiple of the product of two arrays to `total` (samples,)."""
    for t in range(total.size):
        total[t] += factor * first[t] * second[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _start_stretch(green, weight, flexibility, x, y, force, stretch, chord, largest_force):
    """Fill the stretch for slopes x, y and chordwise force; add that to leading order to the chord (samples,)."""
    for t in range(force.size):
        squared, strain = x[t] * x[t] + y[t] * y[t], force[t] * flexibility
        leading = 1.0 + strain - 0.5 * squared
        chord[t] += weight * leading
        largest_force[t] = force[t] if force[t] > largest_force[t] else largest_force[t]
        inner = 1.0 - squared + 2.0 * strain / leading if green else (1.0 + strain) * (1.0 + strain) - squared
        stretch[t] = math.sqrt(inner)


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _correct_green(
    weight, flexibility, x, y, force, tension_change, stretch, compliance, correction, reach, of_tension
):
    """Fill the Newton correction of the stretch by law (21), and its derivative by N; add both to their integrals (samples,)."""
    for t in range(force.size):
        squared, strain = x[t] * x[t] + y[t] * y[t], (force[t] + tension_change[t]) * flexibility
        total = stretch[t] * stretch[t] + squared - 1.0
        derivative = 2.0 / (2.0 * stretch[t] * stretch[t] + total)
        correction[t] = (strain - 0.5 * stretch[t] * total) * derivative
        compliance[t] = derivative * flexibility
        reach[t] += weight * (stretch[t] + correction[t])
        of_tension[t] += weight * compliance[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _correct_linear(
    weight, flexibility, x, y, force, tension_change, stretch, compliance, correction, reach, of_tension
):
    """Do :func:`_correct_green` by the linear law (1 - 1 / xi) zeta' = N / K with xi^2 = zeta'^2 + w'^2, with one division."""
    for t in range(force.size):
        squared, strain = x[t] * x[t] + y[t] * y[t], (force[t] + tension_change[t]) * flexibility
        square = stretch[t] * stretch[t] + squared
        xi = math.sqrt(square)
        factor = square / (square * xi - squared)
        correction[t] = ((strain - stretch[t]) * xi + stretch[t]) * factor
        compliance[t] = xi * factor * flexibility
        reach[t] += weight * (stretch[t] + correction[t])
        of_tension[t] += weight * compliance[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _apply_correction(shift, correction, compliance, change, stretch):
    """Add the Newton correction and that by the change of H to the stretch (samples,)."""
    for t in range(stretch.size):
        stretch[t] += correction[t] + shift * compliance[t] * change[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _add_second_rate(
    weight, share, stretch, x, y, x_rate, y_rate, x_acceleration, y_acceleration, reach, inverse, displacement
):
    """Fill 1 / zeta' and the second rate of the displacement of a point; add that of its stretch to the reach (samples,)."""
    for t in range(stretch.size):
        own = 1.0 / stretch[t]
        stretch_rate = (x[t] * x_rate[t] + y[t] * y_rate[t]) * own
        second_rate = x[t] * x_acceleration[t] + y[t] * y_acceleration[t]
        second_rate += x_rate[t] * x_rate[t] + y_rate[t] * y_rate[t] + stretch_rate * stretch_rate
        second_rate *= -own * weight
        inverse[t] = own
        displacement[t] = reach[t] + share * second_rate
        reach[t] += second_rate


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _add_inertia(mass, sigma, reach, displacement, above):
    """Replace the second rate of the displacement of a point by its inertia; add what the ends bear of it (samples,)."""
    for t in range(reach.size):
        displacement[t] = mass * (displacement[t] - sigma * reach[t])
        above[t] -= sigma * displacement[t]


@compiled(fastmath=FAST_DIVISION, noalias=True, forceinline=True)
def _take_difference(weight, share, shift, force, tension_change, inverse, inertia, above, x, y):
    """Replace the slopes of a point by their forces less those to leading order, times the weight (samples,)."""
    for t in range(force.size):
        of_inertia = above[t] + share * inertia[t]
        above[t] += inertia[t]
        exact = (force[t] + shift * tension_change[t] - of_inertia) * inverse[t]
        difference = (exact - force[t]) * weight
        x[t] *= difference
        y[t] *= difference
