"""Deflections, positions and tensions of periodic solutions."""

from __future__ import annotations

import numpy as np

from cablepod.condensed._fields import close, link_tensions, positions_of
from cablepod.periodic._model import PeriodicModel, harmonics_at
from cablepod.periodic._solve import State

#: Number of phases of a period of the forcing at which extremes are looked for; a parabola refines them.
PHASES = 64


def coordinates(model: PeriodicModel, state: State, phases: int) -> np.ndarray:
    """Return all coordinates at equidistant phases of the motion (phases, r) [kg^1/2 m]."""
    values = harmonics_at(phases, state.harmonics) @ state.full(model).coefficients
    return values * model.scales[1]


def sets(model: PeriodicModel, q: np.ndarray) -> list[np.ndarray]:
    """Split coordinates (..., r) into those of each set."""
    n = model.n_in_plane
    return [q[..., :n], q[..., n:]][: len(model.sets)]


def mode_amplitudes(model: PeriodicModel, q: np.ndarray) -> list[np.ndarray]:
    """Return the amplitudes of the modes of each set (..., mode) [m]."""
    return [part @ turn.T for part, turn in zip(sets(model, q), model.turns, strict=True)]


def deflections(model: PeriodicModel, q: np.ndarray) -> np.ndarray:
    """Return deflections normal to the chord (sets, phases, particle) [m]."""
    return np.stack([part @ shapes for part, shapes in zip(sets(model, q), model.sets, strict=True)])


def maximum(values: np.ndarray) -> np.ndarray:
    """Return the largest values over a period (phases, ...), refined by a parabola through three phases."""
    count, flat = len(values), values.reshape(len(values), -1)
    best, each = flat.argmax(axis=0), np.arange(flat.shape[1])
    before, middle, after = (flat[(best + shift) % count, each] for shift in (-1, 0, 1))
    bend = 2.0 * middle - before - after
    rise = np.divide((after - before) ** 2, 8.0 * bend, out=np.zeros_like(middle), where=bend > 0.0)
    return (middle + rise).reshape(values.shape[1:])


def half_range(values: np.ndarray) -> np.ndarray:
    """Return half of the range of values over a period (phases, ...)."""
    return 0.5 * (maximum(values) + maximum(-values))


def largest_deflection(model: PeriodicModel, q: np.ndarray) -> float:
    """Return the largest deflection from its mean over a period, of all particles [m]."""
    deflection = deflections(model, q)
    deflection = deflection - deflection.mean(axis=1, keepdims=True)
    return float(np.sqrt(maximum((deflection**2).sum(axis=0)).max()))


def boundary_data(model: PeriodicModel, omega: float, phase: np.ndarray) -> np.ndarray:
    """Return the boundary data of the condensed model at phases [rad], for an angular frequency [rad/s]."""
    parts = model.boundary_data(phase)
    return parts[0] + omega * parts[1] + omega**2 * parts[2]


def close_chord(
    model: PeriodicModel, q: np.ndarray, omega: float, phase: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return chordwise stretch, chordwise force [N] and squared slopes (phases, n)."""
    condensed, chain = model.condensed, model.condensed.chain
    data = boundary_data(model, omega, phase)
    slopes = np.diff(deflections(model, q), axis=2) / chain.length
    squared = (slopes**2).sum(axis=0)
    stretch, force = close(condensed, squared, q[0, : condensed.slope_norms_squared.size], data)
    return stretch, force, squared


def positions(model: PeriodicModel, q: np.ndarray, stretch: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Return positions (phases, particle, coordinate) [m]; of a planar scene with three coordinates if it leaves the plane."""
    condensed, chain = model.condensed, model.condensed.chain
    ends = chain.p.end_positions(phase)
    deflection = deflections(model, q)
    result = positions_of(condensed, stretch, deflection[: chain.p.dims - 1], ends)
    if chain.p.dims == 2 and len(deflection) > 1 and deflection[1].any():
        result = np.concatenate([result, deflection[1][:, :, None]], axis=2)
    return result


def tensions(model: PeriodicModel, stretch: np.ndarray, force: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """Return tensions (phases, link) [N]."""
    return link_tensions(model.condensed, stretch, force, squared)
