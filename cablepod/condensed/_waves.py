"""Waves along the cable, which the condensed model neglects: their displacement, for the error estimate."""

from __future__ import annotations

import math

import numpy as np

from cablepod.parameters._parameters import Parameters
from cablepod.reduced._validity import forcing_attributes

#: Number of axial modes (jumps of the speed of an end excite them as 1/n^2, in displacement).
MODES = 6
#: Forcing frequency over the first axial one above which the motion of the ends is integrated over time; below, the axial modes
#: follow it quasi-statically, as the model says, and only the start excites them.
INTEGRATED_RATIO = 0.1
#: Instants in the shortest time scale of the ends, and their maximum number (resonance over longer times is not seen).
PER_TIME_SCALE, MAX_INSTANTS = 24.0, 4096


def waves(p: Parameters, length: float, end_time: float) -> float:
    """Return the largest rms displacement along the cable by waves that ends excite, on the quasi-static one [m].

    The cable is a bar of unstretched `length` [m] along its first chord.  With the velocities v and accelerations a of its ends
    along it, the amplitudes of the modes sin(n pi sigma) obey b_n'' + alpha b_n' + omega_n^2 b_n = -g_n(a + alpha v),
    b_n'(0) = -g_n(v(0)), where g_n(y) = 2 / (n pi) (y_lower - (-1)^n y_upper) and omega_n = n pi / L0 sqrt(K / mu).  The model
    contains b_n = -g_n(a + alpha v) / omega_n^2, which is taken off.
    """
    rates = p.initial_end_rates
    forcing = forcing_attributes(p, length)
    ratio, omega = forcing["forcing_over_axial_frequency"], forcing["first_axial_frequency"]
    if ratio <= INTEGRATED_RATIO and not rates.any():
        return 0.0
    along = chord_direction(p.initial_ends)
    if ratio <= INTEGRATED_RATIO:
        return float(waves_of_start(rates, along, np.asarray(omega), np.asarray(p.damping)))
    step = p.shortest_time_scale / PER_TIME_SCALE
    times = step * np.arange(min(int(end_time / step), MAX_INSTANTS) + 2)
    velocity, acceleration = (p.end_positions(times, derivative) @ along for derivative in (1, 2))
    forces = -_on_modes(acceleration + p.damping * velocity)
    return _largest_rms(forces, -_on_modes(rates[0] @ along), omega, p.damping, step)


def chord_direction(ends: np.ndarray) -> np.ndarray:
    """Return the unit vector from the lower to the upper end (..., dims), for positions of the ends (..., end, dims) [m]."""
    reach = ends[..., 1, :] - ends[..., 0, :]
    return reach / np.sqrt((reach * reach).sum(axis=-1, keepdims=True))


def waves_of_start(rates: np.ndarray, along: np.ndarray, omega: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Return the rms displacements by the start alone (...) [m], for ends that move slowly afterwards.

    Parameters
    ----------
    rates
        Velocities and accelerations of the ends at the start (..., derivative, end, dims) [m/s, m/s^2].
    along
        Direction of the chord (..., dims).
    omega
        First axial angular frequency (...) [rad/s].
    damping
        Damping by mass (...) [1/s].
    """
    velocity, acceleration = np.moveaxis((rates * along[..., None, None, :]).sum(axis=-1), -2, 0)
    frequencies = omega[..., None] * np.arange(1.0, MODES + 1.0)
    of_speed = _on_modes(velocity) / frequencies
    of_force = _on_modes(acceleration + damping[..., None] * velocity) / frequencies**2
    return np.sqrt(0.5 * (of_speed**2 + of_force**2).sum(axis=-1))


def _on_modes(ends: np.ndarray) -> np.ndarray:
    """Return g_n of values at the ends (..., end): (..., n)."""
    n = np.arange(1, MODES + 1)
    return 2.0 / (math.pi * n) * (ends[..., :1] - (-1.0) ** n * ends[..., 1:])


def _largest_rms(forces: np.ndarray, speeds: np.ndarray, omega: float, damping: float, step: float) -> float:
    """Return the largest rms displacement on the quasi-static one [m], see :func:`oscillations`."""
    squared_damping, frequencies = 0.25 * damping**2, omega * np.arange(1, MODES + 1)
    z = oscillations(forces, speeds, frequencies, damping, step)
    # largest within an interval: at its begin, and half of it later
    decay = -0.5 * damping + 1j * np.sqrt(frequencies**2 - squared_damping + 0j)
    middle = np.exp(0.5 * decay * step) * z
    return math.sqrt(0.5 * max(float((part.real**2).sum(axis=1).max()) for part in (z, middle)))


def oscillations(forces: np.ndarray, speeds: np.ndarray, omega: np.ndarray, damping: float, step: float) -> np.ndarray:
    """Return what modes do beyond following their forces quasi-statically: its real part is the displacement (times - 1, n) [m].

    There is no value at the last instant.

    Parameters
    ----------
    forces
        Right sides of the modes (times, n) [m/s^2], linear between the instants.
    speeds
        Their rates at the start (n,) [m/s].
    omega, damping, step
        Angular frequencies (n,) [rad/s], damping [1/s], interval of the instants [s].
    """
    squared = omega**2
    root = np.sqrt(squared - 0.25 * damping**2 + 0j)
    decay = -0.5 * damping + 1j * root
    # d = b - f / omega^2 obeys d'' + alpha d' + omega^2 d = 0 within an interval, but for the slope of f, which kicks its rate
    slopes = np.diff(forces, axis=0) / step
    kicks = -np.diff(slopes, axis=0, prepend=np.zeros((1, omega.size))) / squared
    kicks[0] += speeds
    start = -forces[0] / squared
    # d = Re(z) with z' = decay z: a displacement d and a rate r have z = d - i (r + alpha d / 2) / root
    z = -1j * kicks / root
    z[0] += start * (1.0 - 0.5j * damping / root)
    factor, shift = np.exp(decay * step), 1
    while shift < len(z):  # prefix sums of z_k + factor z_(k-1)
        z[shift:] = z[shift:] + factor * z[:-shift]
        factor, shift = factor * factor, 2 * shift
    return z
