"""Compiled harmonic motions of the ends at equidistant steps, members in lanes: the last dimension of all arrays."""

import math

from cablepod._jit import compiled

#: Rotations between two evaluations of sines and cosines (the rounding error is at most about ten times that of one sine).
ROTATIONS = 64

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
    """Write the coordinates of the ends at a step, and turn the rotations by four steps.

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
