"""Compiled tables of harmonic time functions at equidistant steps."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled

#: Rotations between two evaluations of sine and cosine (bounds the rounding error to about ten times that of one sine).
ROTATIONS = 64


@compiled
def sines(start, steps_per_second, omega, phase, amplitude, constant, table):
    """Fill `table` (steps,) with amplitude sin(omega t_i + phase) + constant, t_i = (start + i) / steps_per_second.

    Four interleaved rotations, each by the angle of four steps; a sine for each step would cost ten times as much.

    Parameters
    ----------
    start, steps_per_second
        Number of the first step; steps per second [1/s].
    omega, phase
        Angular frequency [rad/s] and phase [rad].
    amplitude, constant
        In the unit of the table.
    table
        Filled.
    """
    angle_of_step = omega / steps_per_second
    c, s = math.cos(4.0 * angle_of_step), math.sin(4.0 * angle_of_step)
    x, y = np.empty(4), np.empty(4)
    steps = table.size
    for block in range(0, steps, 4 * ROTATIONS):
        for lane in range(4):
            angle = angle_of_step * (start + block + lane) + phase
            x[lane], y[lane] = amplitude * math.cos(angle), amplitude * math.sin(angle)
        end = min(steps, block + 4 * ROTATIONS)
        full = block + (end - block) // 4 * 4
        for i in range(block, full, 4):
            for lane in range(4):
                table[i + lane] = y[lane] + constant
                x[lane], y[lane] = c * x[lane] - s * y[lane], s * x[lane] + c * y[lane]
        for i in range(full, end):
            table[i] = y[i - full] + constant


@compiled
def harmonic(start, steps_per_second, omega, phase, amplitude, origin, derivatives, tables):
    """Fill `tables` (derivatives, steps) with derivatives of amplitude (sin(omega t + phase) - sin(phase)) + origin.

    Parameters
    ----------
    start, steps_per_second, omega, phase
        As in :func:`sines`.
    amplitude, origin
        [m], or 1 for the factor of a load.
    derivatives
        Tuple of the orders of the derivatives, 0 for values; `origin` is added to values only.
    tables
        Filled in one call, because a call costs more than a hundred steps.
    """
    for k in range(len(derivatives)):
        factor, constant = amplitude, 0.0
        for _ in range(derivatives[k]):
            factor *= omega
        if derivatives[k] == 0:
            constant = origin - factor * math.sin(phase)
        sines(start, steps_per_second, omega, phase + 0.5 * math.pi * derivatives[k], factor, constant, tables[k])


@compiled
def harmonic_of_members(start, steps_per_second, omega, phase, amplitude, origin, derivative, row, tables):
    """Fill one row of the tables of all members, (members, rows, steps), as :func:`harmonic` does.

    Parameters
    ----------
    start, steps_per_second
        As in :func:`sines`.
    omega, phase, amplitude, origin
        As in :func:`harmonic`, of each member (members,).
    derivative
        Order of the derivative.
    row
        Index of the row.
    tables
        Filled.
    """
    for m in range(omega.size):
        harmonic(
            start,
            steps_per_second,
            omega[m],
            phase[m],
            amplitude[m],
            origin[m],
            (derivative,),
            tables[m, row : row + 1],
        )


@compiled
def ends_of_members(start, steps_per_second, omega, phase, amplitude, origin, damping, row, ends, accelerations):
    """Fill one coordinate of the ends of all members, (members, coordinates, steps), from their harmonic motions.

    Parameters
    ----------
    start, steps_per_second
        As in :func:`sines`.
    omega, phase, amplitude, origin
        As in :func:`harmonic`, of each member (members,).
    damping
        Mass-proportional damping (members,) [1/s], or None.
    row
        Index of the coordinate.
    ends, accelerations
        Filled: coordinate [m]; its second derivative plus damping times its first one [m/s^2].
    """
    velocity = np.empty(ends.shape[2])
    for m in range(omega.size):
        factor = amplitude[m]
        sines(
            start, steps_per_second, omega[m], phase[m], factor, origin[m] - factor * math.sin(phase[m]), ends[m, row]
        )
        factor *= omega[m]
        if damping is not None:
            sines(start, steps_per_second, omega[m], phase[m] + 0.5 * math.pi, factor, 0.0, velocity)
        sines(start, steps_per_second, omega[m], phase[m] + math.pi, factor * omega[m], 0.0, accelerations[m, row])
        if damping is not None:
            for i in range(velocity.size):
                accelerations[m, row, i] += damping[m] * velocity[i]
