"""Positions, velocities and tensions of a condensed trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.discretisation._laws import law_tension
from cablepod.integrate._output_times import OutputTimes


@dataclass
class CondensedTrajectory:
    """What one run gives."""

    instants: OutputTimes
    saved: np.ndarray  #: coordinates at the saved steps (steps, r)
    halves: np.ndarray  #: rates half a step before and after (steps, 2, r)
    extremes: tuple[np.ndarray, np.ndarray] | None  #: of the tensions (n,) [N]
    watch: np.ndarray  #: see ``kernels.condensed.leading_verlet``
    scheme: str
    tension: np.ndarray | None = (
        None  #: of the links asked for at the instants (times, links) [N], where taken on the way
    )

    @property
    def q(self) -> np.ndarray:
        """Coordinates at the instants of the output (times, r)."""
        if not self.instants.needs_interpolation:
            return self.saved[self.instants.left]
        rates = 0.5 * (self.halves[:, 0] + self.halves[:, 1])
        return self.instants.at_times(
            self.saved, rates, (self.halves[:, 1] - self.halves[:, 0]) * self.instants.steps_per_second
        )

    @property
    def rates(self) -> np.ndarray:
        """Their rates (times, r)."""
        v = 0.5 * (self.halves[:, 0] + self.halves[:, 1])
        i, s = self.instants.left, self.instants.fraction[:, None]
        after = np.minimum(i + 1, len(v) - 1)
        return np.where(s > 0, (1 - s) * v[i] + s * v[after], v[i])


def sets(model: CondensedModel) -> tuple[slice, ...]:
    """Which coordinates are deflections in the plane, and out of it."""
    return (slice(0, model.n_in_plane), slice(model.n_in_plane, None))[: model.chain.p.dims - 1]


def _closed(
    model: CondensedModel, q: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Chordwise stretch, chordwise force, slopes squared (times, n) of the links, and deflections (normals, times, particle)."""
    from cablepod.condensed import _kernels_closure as kernel

    chain, k = model.chain, model.chain.p.stiffness
    rows = model.boundary_data_at(times)
    deflection = np.stack([q[:, at] @ model.shapes[at] for at in sets(model)])
    squared = ((np.diff(deflection, axis=2) / chain.length) ** 2).sum(axis=0)
    tau = rows[:, 1 : 1 + len(model.chordwise_force_patterns)] @ model.chordwise_force_patterns
    if model.order == "leading":
        mean = (tau @ chain.length)[:, None] / chain.total_length
        h = (
            k * (rows[:, :1] / chain.total_length - 1.0 + 0.5 * (squared @ chain.length)[:, None] / chain.total_length)
            - mean
        )
        force = h + tau
        return 1.0 + force / k - 0.5 * squared, force, squared, deflection
    z, h = np.empty_like(squared), np.empty(times.size)
    z[0], h[0] = model.first_stretch(rows[0]), model.guess(rows[0], q[0])
    kernel.close_all(squared, tau, chain.length, np.ascontiguousarray(rows[:, 0]), k, model.green, h, z)
    return z, h[:, None] + tau, squared, deflection


def positions(model: CondensedModel, q: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Positions of the particles (times, particle, dims) [m] for coordinates (times, r)."""
    z, _, _, deflection = _closed(model, q, times)
    return _joined(model, z, deflection, times)


def _joined(model: CondensedModel, z: np.ndarray, deflection: np.ndarray, times: np.ndarray) -> np.ndarray:
    ends = model.chain.p.end_positions(times)
    frame = ChordFrame.of(ends[:, 1] - ends[:, 0], model.reference)
    position = frame.join(ends[:, 0], _summed(z * model.chain.length), deflection)
    position[:, -1] = ends[:, 1]  # but for rounding, and for modes that are not quite zero there
    return position


def _summed(parts: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((len(parts), 1)), np.cumsum(parts, axis=1)], axis=1)


def _rates_of_stretch(model: CondensedModel, z: np.ndarray, squared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate the chordwise stretch (times, n) by N / K, and by half the slope squared with the sign turned."""
    if model.order == "leading":
        return np.ones_like(z), np.ones_like(z)
    if model.green:
        bend = 3.0 * z * z + squared - 1.0
        return 2.0 / bend, 2.0 * z / bend
    cube = (z * z + squared) ** 1.5
    return cube / (cube - squared), z / (cube - squared)


def _velocities(
    model: CondensedModel, z: np.ndarray, deflection: np.ndarray, rates: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Velocities (times, particle, dims) [m/s], but for what loads that change in time stretch along the chord."""
    chain, p = model.chain, model.chain.p
    ends, speeds = p.end_positions(times), p.end_positions(times, 1)
    reach, speed = ends[:, 1] - ends[:, 0], speeds[:, 1] - speeds[:, 0]
    frame = ChordFrame.of(reach, model.reference)
    grow, turn, swing = frame.rates(reach, speed)
    moving = np.stack([rates[:, at] @ model.shapes[at] for at in sets(model)])
    slope, slope_rate = (np.diff(item, axis=2) / chain.length for item in (deflection, moving))
    give, lever = _rates_of_stretch(model, z, (slope * slope).sum(axis=0))
    stretching = -lever * (slope * slope_rate).sum(axis=0)
    stretching += give * ((grow - stretching @ chain.length) / (give @ chain.length))[:, None]
    along, along_rate = _summed(z * chain.length), _summed(stretching * chain.length)
    velocity = speeds[:, :1] + along_rate[:, :, None] * frame.along[:, None] + along[:, :, None] * turn[:, None]
    velocity = (
        velocity + np.einsum("ktp,tkc->tpc", moving, frame.normals) + np.einsum("ktp,tkc->tpc", deflection, swing)
    )
    velocity[:, -1] = speeds[:, 1]
    return velocity


def _tension(model: CondensedModel, z: np.ndarray, force: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """Tensions of the links (times, n) [N]."""
    if model.order == "leading":
        return force * np.sqrt(1.0 + squared)
    return law_tension(np.sqrt(z * z + squared), model.chain.p.stiffness, green=model.green)


def _tensions(model: CondensedModel, q: np.ndarray, times: np.ndarray, links: np.ndarray | None) -> np.ndarray:
    """Tensions (times, n or some links) [N] alone; to leading order a link needs no other."""
    if links is None or model.order != "leading":
        z, force, squared, _ = _closed(model, q, times)
        tension = _tension(model, z, force, squared)
        return tension if links is None else tension[:, links]
    rows = model.boundary_data_at(times)
    loads = rows[:, 1 : 1 + len(model.chordwise_force_patterns)]
    k, length = model.chain.p.stiffness, model.chain.total_length
    sag = 0.5 * (q * q) @ model.spectral_basis[1]
    force = k * ((rows[:, 0] + sag) / length - 1.0) - loads @ model.mean_chordwise_forces
    slopes = (q[:, at] @ model.slopes[at][:, links] for at in sets(model))
    return (force[:, None] + loads @ model.chordwise_force_patterns[:, links]) * np.sqrt(
        1.0 + sum(item * item for item in slopes)
    )
