"""Turbulence at points as a sum of harmonics, by FFT."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cablepod.batch._blas import one_blas_thread
from cablepod.errors import scene_error
from cablepod.wind._profile import mean_speed
from cablepod.wind._spectra import height_in_layer, spectra

#: Number of frequencies at which the coherence is factorised; between them factors are linear in the frequency.
FACTORISED = 48
#: Share of the variance without coherence, which keeps the factorisation from failing where points coincide.
INCOHERENT = 1e-9
#: Most random phases of a component that are kept for the next field (8 MB).
MAX_KEPT_PHASES = 500_000


def gusts(
    wind: Mapping[str, Any], turbulence: Mapping[str, Any], position: np.ndarray, count: int, interval: float, seed: int,
    *, across: Sequence[bool],
) -> np.ndarray:  # fmt: skip
    """Return components of the turbulence (components, points, count) [m/s].

    The harmonics k / (count interval) of each point have the amplitude of the spectrum and phases that the coherence couples.

    Parameters
    ----------
    wind, turbulence
        Tables [wind] and [wind.turbulence].
    position
        Points (points, dims) [m].
    count, interval
        Number of instants and their interval [s]; the turbulence is periodic with their product.
    seed
        Seed of the phases.
    across
        Of each component, whether it is that across the mean wind.
    """
    from scipy.fft import irfft

    harmonics = (count - 1) // 2
    frequency = np.arange(1, harmonics + 1) / (count * interval)
    height = height_in_layer(wind, position[:, 1] - float(wind["ground"]))
    direction = direction_of(wind)
    along = position @ direction
    kept = len(position) * harmonics <= MAX_KEPT_PHASES
    phases_of = _phases if kept else _phases.__wrapped__
    phases = [phases_of(seed, is_across, len(position), harmonics) for is_across in across]
    with one_blas_thread():  # the same order of sums on any number of threads, and faster for small matrices
        coupled = _coupled(phases, frequency, _decay_times(wind, turbulence, position, height, direction, along))
    # Taylor's hypothesis: the turbulence is carried along by one speed
    speed = max(float(mean_speed(wind, np.array(float(wind["reference_height"])))), 1e-300)
    if np.ptp(along) > 0.0:
        coupled *= _harmonic_turns(along / (-speed * count * interval), harmonics)
    amplitude = np.zeros((len(across), len(position), count // 2 + 1), dtype=complex)
    for own, part, is_across in zip(amplitude, coupled, across, strict=True):
        size = np.sqrt(2.0 * spectra(wind, turbulence, height, frequency, across=is_across) / (count * interval))
        np.multiply(part, 0.5 * count * size, out=own[:, 1 : harmonics + 1])
    return irfft(amplitude, count, axis=-1)


@lru_cache(20)
def _phases(seed: int, across: bool, points: int, harmonics: int) -> np.ndarray:
    """Return random phases exp(2 pi i u) (points, harmonics); kept, as members of an ensemble share them.

    Twenty are two components of ten storms, which a design runs together.
    """
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int(across)])))
    return _turns(generator.random((points, harmonics)))


def _turns(turns: np.ndarray) -> np.ndarray:
    """Return exp(2 pi i turns), five times as fast as the exponential of complex numbers."""
    angle = 2.0 * np.pi * (turns - np.floor(turns))
    result = np.empty(turns.shape, dtype=complex)
    np.cos(angle, out=result.real)
    np.sin(angle, out=result.imag)
    return result


def _harmonic_turns(turns: np.ndarray, harmonics: int) -> np.ndarray:
    """Return exp(2 pi i k turns) for k = 1 ... harmonics (points, harmonics), as products of two short tables."""
    inner = math.isqrt(harmonics) + 1
    low = _turns(turns[:, None] * np.arange(1, inner + 1))
    high = _turns(turns[:, None] * (inner * np.arange(-(-harmonics // inner))))
    return (high[:, :, None] * low[:, None, :]).reshape(turns.size, -1)[:, :harmonics]


def direction_of(wind: Mapping[str, Any]) -> np.ndarray:
    """Return the unit vector of the mean wind (dims,)."""
    direction = np.asarray(wind["direction"], dtype=float)
    return direction / np.sqrt((direction * direction).sum())


def across_of(wind: Mapping[str, Any]) -> np.ndarray | None:
    """Return the horizontal unit vector across the mean wind (dims,); None in the plane."""
    direction = direction_of(wind)
    return np.array([-direction[2], 0.0, direction[0]]) if direction.size == 3 else None


def _decay_times(
    wind: Mapping[str, Any],
    turbulence: Mapping[str, Any],
    position: np.ndarray,
    height: np.ndarray,
    direction: np.ndarray,
    along: np.ndarray,
) -> np.ndarray:
    """Return the decay times of Davenport's coherence between all points (points, points) [s]."""
    if np.size(turbulence["decay"]) != 2:
        raise scene_error("wind.turbulence.decay", turbulence["decay"], "two numbers")
    vertical, horizontal = (float(decay) for decay in np.asarray(turbulence["decay"]))
    speed = np.maximum(mean_speed(wind, height), 1e-6 * max(float(wind["speed"]), 1e-300))
    level = position - along[:, None] * direction
    distance = level[:, None] - level[None, :]
    up = distance[..., 1]
    aside = np.sqrt(np.maximum((distance * distance).sum(axis=-1) - up * up, 0.0))
    return np.asarray(
        np.sqrt((vertical * up) ** 2 + (horizontal * aside) ** 2) / (0.5 * (speed[:, None] + speed[None, :]))
    )


def _coupled(phases: Sequence[np.ndarray], frequency: np.ndarray, decay: np.ndarray) -> np.ndarray:
    """Return phases (components, points, frequencies) whose coherence is exp(-frequency decay), for independent ones."""
    points, components = len(decay), len(phases)
    knots, factors = _factors_at_knots(frequency.tobytes(), np.ascontiguousarray(decay).tobytes(), points)
    result = np.empty((components, points, frequency.size), dtype=complex)
    for own, phase in zip(result, phases, strict=True):
        own[:, :1] = factors[0] @ phase[:, :1]
    for k in range(knots.size - 1):
        first, last = knots[k], knots[k + 1]
        share = (np.arange(first + 1, last + 1) - first) / (last - first)
        # rows of the interpolated factors have the norm of one again
        product = (factors[k] * factors[k + 1]).sum(axis=1)[:, None]
        norm = np.sqrt((1.0 - share) ** 2 + share**2 + 2.0 * share * (1.0 - share) * product)
        own = np.concatenate([phase[:, first:last] for phase in phases], axis=1).view(float)
        # real and imaginary parts in turn
        lower, upper = (_triangular(factor, own).reshape(points, components, -1) for factor in factors[k : k + 2])
        lower *= np.repeat((1.0 - share) / norm, 2, axis=1)[:, None]
        upper *= np.repeat(share / norm, 2, axis=1)[:, None]
        lower += upper
        result[:, :, first:last] = np.swapaxes(lower.view(complex), 0, 1)
    return result


def _triangular(factor: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the product of a lower triangular matrix and values, at half the work of a full matrix."""
    from scipy.linalg.blas import dtrmm

    return dtrmm(
        1.0, factor.T, values.T, side=1, lower=0
    ).T  # BLAS takes columns: the product is that of the transposes


@lru_cache(4)
def _factors_at_knots(frequency: bytes, decay: bytes, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the harmonics at which the coherence is factorised, from 1, and the factors (knots, points, points).

    Kept, as both components of the turbulence have them, and storms that differ in their seeds.
    """
    harmonics, decays = np.frombuffer(frequency), np.frombuffer(decay).reshape(points, points)
    count = harmonics.size
    knots = (
        np.unique(np.geomspace(1, count, min(FACTORISED, count)).round().astype(int)) if count > 1 else np.array([1])
    )
    coherence = (1.0 - INCOHERENT) * np.exp(-harmonics[knots - 1, None, None] * decays)
    coherence[:, np.arange(points), np.arange(points)] = 1.0
    return knots, _factors(coherence)


def _factors(coherence: np.ndarray) -> np.ndarray:
    """Return lower factors L L^T of matrices (matrices, points, points); a share without coherence is added where they fail."""
    share, points = 0.0, coherence.shape[-1]
    for _ in range(8):
        try:
            return np.linalg.cholesky((1.0 - share) * coherence + share * np.eye(points))
        except np.linalg.LinAlgError:
            share = max(10.0 * share, 1e-8)
    return np.linalg.cholesky((1.0 - share) * coherence + share * np.eye(points))
