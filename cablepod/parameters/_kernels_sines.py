"""Compiled tables of harmonic motion at equidistant steps."""

from __future__ import annotations

import math

import numpy as np

from cablepod._jit import compiled

#: A rotation is begun anew after so many steps, so that rounding grows to some ten times that of one number at most.
ANEW = 64


@compiled
def sines(start, rate, omega, phase, size, constant, table):
    """Fill `table` (steps,) with size sin(omega i / rate + phase) + constant, i = start, start + 1, ...

    Four rotations of the angle by four steps go on side by side; a sine for each step would cost ten times as much.

    Parameters
    ----------
    start, rate
        Number of the first step, steps per second [1/s].
    omega, phase
        Angular frequency [rad/s] and phase [rad].
    size, constant
        Of the table's own unit.
    table
        Filled.
    """
    turn = omega / rate
    c, s = math.cos(4.0 * turn), math.sin(4.0 * turn)
    x, y = np.empty(4), np.empty(4)
    steps = table.size
    for block in range(0, steps, 4 * ANEW):
        for lane in range(4):
            angle = turn * (start + block + lane) + phase
            x[lane], y[lane] = size * math.cos(angle), size * math.sin(angle)
        end = min(steps, block + 4 * ANEW)
        full = block + (end - block) // 4 * 4
        for i in range(block, full, 4):
            for lane in range(4):
                table[i + lane] = y[lane] + constant
                x[lane], y[lane] = c * x[lane] - s * y[lane], s * x[lane] + c * y[lane]
        for i in range(full, end):
            table[i] = y[i - full] + constant


@compiled
def harmonic(start, rate, omega, phase, amplitude, origin, derivatives, tables):
    """Fill `tables` (derivatives, steps) with derivatives of amplitude (sin(omega t + phase) - sin(phase)) + origin.

    Parameters
    ----------
    start, rate, omega, phase
        As in :func:`sines`.
    amplitude, origin
        [m], or the unit of a load.
    derivatives
        A tuple of their orders, 0 for the values; `origin` counts for those alone.
    tables
        Filled; one call for all, as calls cost more than a hundred steps.
    """
    for k in range(len(derivatives)):
        size, constant = amplitude, 0.0
        for _ in range(derivatives[k]):
            size *= omega
        if derivatives[k] == 0:
            constant = origin - size * math.sin(phase)
        sines(start, rate, omega, phase + 0.5 * math.pi * derivatives[k], size, constant, tables[k])


@compiled
def harmonic_of_members(start, rate, omega, phase, amplitude, origin, derivative, row, tables):
    """Fill one row of the tables of many scenes, (members, rows, steps), as :func:`harmonic` does one table.

    Parameters
    ----------
    start, rate
        As in :func:`sines`.
    omega, phase, amplitude, origin
        As in :func:`harmonic`, of each scene (members,).
    derivative
        Its order.
    row
        Number of the row.
    tables
        Filled.
    """
    for m in range(omega.size):
        harmonic(start, rate, omega[m], phase[m], amplitude[m], origin[m], (derivative,), tables[m, row : row + 1])


@compiled
def ends_of_members(start, rate, omega, phase, amplitude, origin, damping, row, ends, second):
    """Fill one coordinate of the ends of many scenes, (members, coordinates, steps), from their harmonic motions.

    Parameters
    ----------
    start, rate
        As in :func:`sines`.
    omega, phase, amplitude, origin
        As in :func:`harmonic`, of each scene (members,).
    damping
        By mass (members,) [1/s], or None.
    row
        Number of the coordinate.
    ends, second
        Filled: its place [m]; its second rate, with damping that times the first added [m/s^2].
    """
    rates = np.empty(ends.shape[2])
    for m in range(omega.size):
        size = amplitude[m]
        sines(start, rate, omega[m], phase[m], size, origin[m] - size * math.sin(phase[m]), ends[m, row])
        size *= omega[m]
        if damping is not None:
            sines(start, rate, omega[m], phase[m] + 0.5 * math.pi, size, 0.0, rates)
        sines(start, rate, omega[m], phase[m] + math.pi, size * omega[m], 0.0, second[m, row])
        if damping is not None:
            for i in range(rates.size):
                second[m, row, i] += damping[m] * rates[i]
