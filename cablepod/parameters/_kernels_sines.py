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
def end_positions_of_members(times, omega, phase, amplitude, ramp, row, positions):
    """Add the harmonic motion of one coordinate to the ends of all members (members, times, 2 dims) [m].

    Parameters
    ----------
    times
        Instants (times,) [s].
    omega, phase, amplitude
        As in :func:`harmonic`, of each member (members,); without phases the motion is amplitude (1 - cos(omega t)).
    ramp
        Duration of the smooth start (members,) [s], 0 without; None if no member has one.
    row
        Index of the coordinate.
    positions
        Changed.
    """
    for m in range(omega.size):
        for i in range(times.size):
            if phase is None:
                change = 1.0 - math.cos(omega[m] * times[i])
            else:
                change = math.sin(omega[m] * times[i] + phase[m]) - math.sin(phase[m])
            if ramp is not None and times[i] < ramp[m]:
                s = times[i] / ramp[m]
                change *= s * s * s * (10.0 - s * (15.0 - 6.0 * s))
            positions[m, i, row] += amplitude[m] * change


# --- lanes: members side by side, in the last dimension of all arrays ---------------------------------------------------

# Rows of a motion as given: angular frequency [rad/s], phase [rad], amplitude [m], initial coordinate of the end [m],
# mass-proportional damping [1/s], duration of the smooth start [s], 0 without.
OMEGA, PHASE, AMPLITUDE, ORIGIN, DAMPING, RAMP = range(6)
MOTION_ROWS = 6
# Rows of a turn: coordinate where the sine is zero [m], cosine and sine of the angle of four steps, factors of cosine and sine
# in the acceleration [1/s^2].
CENTRE, COSINE, SINE, COSINE_FACTOR, SINE_FACTOR = range(5)
TURN_ROWS = 5


@compiled
def start_rotations(step, steps_per_second, motions, turns, waves):
    """Fill the rotations of motions from a step on.

    Parameters
    ----------
    step, steps_per_second
        Number of the first step, a multiple of 4; steps per second [1/s].
    motions
        As given (motions, MOTION_ROWS, lanes).
    turns, waves
        Filled: (motions, TURN_ROWS, lanes), and amplitude times cosine and sine of four steps (motions, 2, 4, lanes) [m].
    """
    for k in range(motions.shape[0]):
        for m in range(motions.shape[2]):
            omega, amplitude = motions[k, OMEGA, m], motions[k, AMPLITUDE, m]
            angle_of_step = omega / steps_per_second
            turns[k, CENTRE, m] = motions[k, ORIGIN, m] - amplitude * math.sin(motions[k, PHASE, m])
            turns[k, COSINE, m], turns[k, SINE, m] = math.cos(4.0 * angle_of_step), math.sin(4.0 * angle_of_step)
            turns[k, COSINE_FACTOR, m], turns[k, SINE_FACTOR, m] = motions[k, DAMPING, m] * omega, -omega * omega
            for i in range(4):
                angle = angle_of_step * (step + i) + motions[k, PHASE, m]
                waves[k, 0, i, m], waves[k, 1, i, m] = amplitude * math.cos(angle), amplitude * math.sin(angle)


@compiled(noalias=True, forceinline=True)
def rotate(step, rows, turns, waves, ends, accelerations):
    """Write the coordinates of the ends at a step, and turn the rotations by four steps, as :func:`sines` does.

    Parameters
    ----------
    step
        Number of the step.
    rows
        Row of `ends` that each motion moves (motions,).
    turns, waves
        As :func:`start_rotations` fills them; `waves` is changed.
    ends, accelerations
        Rows `rows` filled: coordinates [m]; their second derivatives plus damping times the first ones [m/s^2].
    """
    i = step % 4
    for k in range(rows.size):
        for m in range(ends.shape[1]):
            x, y, c, s = waves[k, 0, i, m], waves[k, 1, i, m], turns[k, COSINE, m], turns[k, SINE, m]
            ends[rows[k], m] = y + turns[k, CENTRE, m]
            accelerations[rows[k], m] = turns[k, COSINE_FACTOR, m] * x + turns[k, SINE_FACTOR, m] * y
            waves[k, 0, i, m], waves[k, 1, i, m] = c * x - s * y, s * x + c * y


@compiled
def steps_of_ramps(motions, steps_per_second):
    """Return the number of steps within the longest smooth start of motions (motions, MOTION_ROWS, lanes)."""
    longest = 0.0
    for k in range(motions.shape[0]):
        for m in range(motions.shape[2]):
            longest = max(longest, motions[k, RAMP, m])
    return math.ceil(longest * steps_per_second)


@compiled(noalias=True, forceinline=True)
def ramp_ends(step, steps_per_second, rows, motions, turns, waves, ends, accelerations):
    """Multiply motions by their smooth starts, after :func:`rotate` wrote the step.

    With s the quintic step from 0 to 1, a displacement g becomes s g, and its second derivative s g'' + 2 s' g' + s'' g.

    Parameters
    ----------
    step, steps_per_second
        Number of the step; steps per second [1/s].
    rows, turns, waves
        As for :func:`rotate`; the rotations have turned by four steps, and are turned back here.
    motions
        As given (motions, MOTION_ROWS, lanes).
    ends, accelerations
        Rows `rows` changed.
    """
    i, time = step % 4, step / steps_per_second
    for k in range(rows.size):
        for m in range(ends.shape[1]):
            ramp, omega = motions[k, RAMP, m], motions[k, OMEGA, m]
            x, y, cosine, sine = waves[k, 0, i, m], waves[k, 1, i, m], turns[k, COSINE, m], turns[k, SINE, m]
            x, y = cosine * x + sine * y, cosine * y - sine * x
            displacement, rate = y + turns[k, CENTRE, m] - motions[k, ORIGIN, m], omega * x
            inverse = 1.0 / ramp if ramp > time else 0.0
            s = time * inverse if ramp > time else 1.0
            value = s * s * s * (10.0 - s * (15.0 - 6.0 * s))
            first = 30.0 * s * s * (1.0 - s) * (1.0 - s) * inverse
            second = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) * inverse * inverse
            ends[rows[k], m] = motions[k, ORIGIN, m] + value * displacement
            accelerations[rows[k], m] = (
                value * -omega * omega * y
                + 2.0 * first * rate
                + second * displacement
                + motions[k, DAMPING, m] * (value * rate + first * displacement)
            )
