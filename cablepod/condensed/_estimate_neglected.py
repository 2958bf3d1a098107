"""What models neglect, for the error estimate: waves along the cable; of orders "exact" and "inertial" the chord's rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.parameters._parameters import Parameters
from cablepod.reduced._validity import forcing_attributes

if TYPE_CHECKING:
    from cablepod.condensed._error_equation import ErrorEquation
    from cablepod.condensed._model import CondensedModel

#: Number of sines along the cable.
SINES = 8
#: Interval over which the frames of the chord are differentiated, over the shortest time scale of the ends, and at most [s].
DIFFERENCE, LONGEST_DIFFERENCE = 1e-3, 1.0
#: Maximum interval of samples times the angular frequency of an axial mode whose waves act on the deflection (the tension of
#: faster ones changes sign while the deflection hardly moves).
RESOLVED_PHASE = 0.7


@dataclass(frozen=True, eq=False)
class Neglected:
    """What a motion of order "inertial" lacks, and one of order "exact" beside the force of eta, from coordinates at samples.

    A point of the cable is at r0 + sigma c + eta e + sum w_k n_k.  The distance eta = sum eta_n sin(n pi sigma) belongs to the
    deflection at constant stretch, eta' = -w'^2 / 2 less its mean.  The model contains the accelerations of the line between the
    ends and of w_k along n_k, and that of eta as a force on the deflection.  It lacks

    - the other accelerations by the rotation of e and n_k: 2 eta_t e_t + eta e_tt + sum (2 w_k,t n_k,t + w_k n_k,tt),
    - the displacement b e of waves that eta and these excite, and the chordwise force K b' on the deflection:
      b_n,tt + alpha b_n,t + omega_n^2 b_n = -(eta_n,tt + alpha eta_n,t + a_n), where a_n is the part of these along the chord.

    Slopes count to leading order.
    """

    model: CondensedModel
    equation: ErrorEquation

    def of(self, motion: tuple[np.ndarray, np.ndarray, np.ndarray], times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return forces on the enriched coordinates (samples, R), and the mean square of b over the length (samples,) [m^2].

        Parameters
        ----------
        motion
            Coordinates, rates and accelerations (samples, r).
        times
            Equally spaced instants [s], two at least.
        """
        p, total = self.model.chain.p, self.model.chain.total_length
        eta, eta_rate, eta_acceleration = self.chordwise(*motion)
        forces, along = self.of_rotation(motion, eta, eta_rate, times)
        wave_number = np.arange(1, SINES + 1) * math.pi / total
        omega = wave_number * math.sqrt(p.stiffness / p.mass)
        step = float(times[1] - times[0])
        driving = eta_acceleration + p.damping * eta_rate + along
        waves = np.zeros_like(driving)
        waves[:-1] = oscillations(-driving, np.zeros(SINES), omega, p.damping, step).real
        # the model has the chordwise force of eta: N' lacks mu (a_n - omega_n^2 (b_n + driving_n / omega_n^2))
        gradient = p.mass * (along - omega**2 * np.where(omega * step < RESOLVED_PHASE, waves, 0.0))
        for target, rows in zip(self._enriched, self.model.sets, strict=True):
            slopes = self._products(self.equation.slopes[target], self.model.slopes[rows])
            forces[:, target] += np.einsum(
                "tn,nij,tj->ti", gradient / wave_number, slopes, motion[0][:, rows], optimize=True
            )
        return forces, 0.5 * ((waves - driving / omega**2) ** 2).sum(axis=1)

    def chordwise(
        self, q: np.ndarray, rates: np.ndarray, accelerations: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return eta_n (samples, n) [m] and its first two time derivatives."""
        n_pi = math.pi * np.arange(1, SINES + 1)[:, None, None]
        products = [self._products(self.model.slopes[rows], self.model.slopes[rows]) / n_pi for rows in self.model.sets]

        def product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
            parts = [
                np.einsum("ti,nij,tj->tn", left[:, rows], matrices, right[:, rows], optimize=True)
                for rows, matrices in zip(self.model.sets, products, strict=True)
            ]
            return -np.sum(parts, axis=0)

        return product(q, q), 2.0 * product(q, rates), 2.0 * (product(rates, rates) + product(q, accelerations))

    def of_rotation(
        self,
        motion: tuple[np.ndarray, np.ndarray, np.ndarray],
        eta: np.ndarray,
        eta_rate: np.ndarray,
        times: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return forces on the enriched coordinates (samples, R), and accelerations along the chord a_n (samples, n) [m/s^2].

        Accelerations contain the damping of the same velocities.
        """
        (q, rates, _), model, alpha = motion, self.model, self.model.chain.p.damping
        forces, along = np.zeros((len(q), len(self.equation.shapes))), np.zeros_like(eta)
        if not model.chain.p.motions:
            return forces, along
        direction, normals = self._frames(times)
        e, turned_e = direction[0], direction[2] + alpha * direction[1]
        weighted, patterns = self.equation.shapes * model.mass, 2.0 / model.chain.total_length * self._sines
        along += _dot(turned_e, e) * eta
        for k, rows in enumerate(model.sets):
            n_rate, turned_n = normals[1, :, k], normals[2, :, k] + alpha * normals[1, :, k]
            on_sines = (patterns * model.chain.tributary_length) @ model.shapes[rows].T
            along += 2.0 * _dot(n_rate, e) * (rates[:, rows] @ on_sines.T)
            along += _dot(turned_n, e) * (q[:, rows] @ on_sines.T)
            for target, normal in zip(self._enriched, normals[0].swapaxes(0, 1), strict=True):
                across = 2.0 * _dot(n_rate, normal) * rates[:, rows] + _dot(turned_n, normal) * q[:, rows]
                forces[:, target] -= across @ (weighted[target] @ model.shapes[rows].T).T
        for target, normal in zip(self._enriched, normals[0].swapaxes(0, 1), strict=True):
            across = 2.0 * _dot(direction[1], normal) * eta_rate + _dot(turned_e, normal) * eta
            forces[:, target] -= across @ (weighted[target] @ self._sines.T).T
        return forces, along

    def _frames(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return directions (3, times, dims) and normals (3, times, dims - 1, dims) of the chord, with two derivatives."""
        p = self.model.chain.p
        interval = min(DIFFERENCE * float(p.shortest_time_scale), LONGEST_DIFFERENCE, 0.25 * float(times[-1]))
        around = np.clip(times, interval, times[-1] - interval) + interval * np.array([[-1.0], [0.0], [1.0]])
        ends = p.end_positions(around.ravel())
        frame = ChordFrame.of(ends[:, 1] - ends[:, 0], self.model.reference)

        def derivatives(field: np.ndarray) -> np.ndarray:
            before, now, after = field.reshape(3, times.size, *field.shape[1:])
            return np.stack([now, (after - before) / (2.0 * interval), (after - 2.0 * now + before) / interval**2])

        return derivatives(frame.along), derivatives(frame.normals)

    @cached_property
    def _sines(self) -> np.ndarray:
        """Sines of the axial modes at the particles (n, particle)."""
        chain = self.model.chain
        return np.sin(math.pi * np.outer(np.arange(1, SINES + 1), chain.arc_length / chain.total_length))

    def _products(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return integrals of the products of slopes (i, links) and (j, links) with cos(n pi sigma) (n, i, j)."""
        chain = self.model.chain
        middles = 0.5 * (chain.arc_length[1:] + chain.arc_length[:-1]) / chain.total_length
        cosines = np.cos(math.pi * np.outer(np.arange(1, SINES + 1), middles)) * chain.length
        return np.einsum("nl,il,jl->nij", cosines, left, right, optimize=True)

    @property
    def _enriched(self) -> tuple[slice, ...]:
        """Slices of the enriched coordinates, one for each deflection."""
        in_plane = self.equation.enriched_in_plane
        return (slice(0, in_plane), slice(in_plane, None))[: len(self.model.sets)]


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the scalar products of vectors (times, dims) as a column (times, 1)."""
    return np.einsum("tc,tc->t", first, second)[:, None]


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
