"""Members abreast in lanes: arrays of their numbers, laid out for the kernel that advances them, and its results."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cablepod.condensed._stepper import DIVERGENCE_FACTOR
from cablepod.conventions import COORDINATES, ENDS
from cablepod.integrate._window import steps_within
from cablepod.parameters._parameters import Parameters

if TYPE_CHECKING:
    from cablepod.condensed._batch import CondensedBatch, MemberCoefficients
    from cablepod.condensed._model import CondensedModel

#: Largest number of lanes: the numbers of so many members fit in the first cache.
LANES = 32
#: The number of lanes is a multiple of that of double-precision numbers in the longest vector registers.
VECTOR = 8


class LaneResults(NamedTuple):
    """Results of the members of a batch, beside the series."""

    low: np.ndarray  #: least tensions (members, links or 0) [N]
    high: np.ndarray  #: largest tensions (members, links or 0) [N]
    least_force: np.ndarray  #: least chordwise forces (members,) [N]
    least_force_step: np.ndarray  #: numbers of their steps (members,)
    completed: np.ndarray  #: whether a member remained stable and bounded (members,)


class LaneGroups:
    """Arrays of members, (members, ...), as groups of lanes, (groups, ..., lanes).

    Parameters
    ----------
    count
        Number of members.  Groups are of equal size; the last lanes repeat the last member.
    """

    def __init__(self, count: int) -> None:
        self.count, self.groups = count, -(-count // LANES)
        self.lanes = -(-count // (self.groups * VECTOR)) * VECTOR

    def split(self, values: np.ndarray) -> np.ndarray:
        """Lay out the rows of an array (members, ...)."""
        missing = self.groups * self.lanes - self.count
        padded = np.concatenate([values, np.repeat(values[-1:], missing, axis=0)], dtype=float)
        groups = padded.reshape(self.groups, self.lanes, *values.shape[1:])
        return np.ascontiguousarray(np.moveaxis(groups, 1, -1))

    def full(self, rows: int, value: float) -> np.ndarray:
        """Make an array (groups, rows, lanes) of one value."""
        return np.full((self.groups, rows, self.lanes), value)

    def join(self, values: np.ndarray) -> np.ndarray:
        """Return the rows (members, ...) of an array that :meth:`split` made."""
        rows = np.moveaxis(values, -1, 1).reshape(self.groups * self.lanes, *values.shape[1:-1])
        return rows[: self.count]


def advance(
    batch: CondensedBatch,
    q: np.ndarray,
    v: np.ndarray,
    amplitudes: tuple[np.ndarray, ...],
    tension: np.ndarray,
    position: np.ndarray,
) -> LaneResults:
    """Advance all members of a batch from coordinates and rates half a step before the start (members, r).

    Fills the amplitudes of the modes as given (members, times, modes) [m], set by set, and, where there is room for them, the
    tensions of links (members, times, links) [N] and positions (members, times, particles, dims) [m].
    """
    from cablepod.condensed import _kernels_leading_lanes as kernel  # numba is imported only to compute

    plan, unit, instants, count = batch.plan, batch.plan.unit, batch.plan.instants, len(q)
    groups = LaneGroups(count)
    shapes, of_links = np.concatenate(unit.modes[: len(unit.sets)]).T.copy(), link_coefficients(unit, None)
    slopes, force_patterns = link_coefficients(unit, plan.links)
    extremes = len(slopes) if "tension_extremes" in plan.outputs else 0
    low, high = groups.full(extremes, np.inf), groups.full(extremes, -np.inf)
    least_force, least_force_step, largest_omega_squared = (
        np.full((groups.groups, groups.lanes), value) for value in (np.inf, 0.0, 0.0)
    )
    rows, motions = member_motions(batch.parameters)
    parameters, state = batch.parameters, (groups.split(q), groups.split(v))
    stiffness, norms, projection, bases = matrices(batch)
    kernel.leading_lanes(
        count, *((0,) * number for number in (*unit.ranks, 0)[:2]), (0,) * len(unit.load_patterns),
        int(instants.steps[-1]) + 1, instants.steps_per_second, instants.steps, rows, groups.split(motions),
        groups.split(parameters.ends.reshape(count, -1)), groups.split(batch.load[:, :, 0]),
        None if unit.chain.p.dims == 2 else groups.split(np.eye(3)[batch.reference]), *state,
        groups.split(batch.scaled.slope_norms_squared), groups.split(member_numbers(batch, instants.steps_per_second)),
        unit.mean_chordwise_forces, groups.split(stiffness), groups.split(projection), groups.split(norms),
        np.ascontiguousarray(unit.chordwise_forces_at_candidates[:, [0, -1]]), slopes, force_patterns,
        groups.split(bases), shapes, unit.chain.length, rest_profile(unit), *of_links,
        watched_steps(plan.window, instants.steps_per_second), low, high, least_force, least_force_step,
        largest_omega_squared, amplitudes[0], amplitudes[-1], tension, position,
    )  # fmt: skip
    limit = 4.0 * instants.steps_per_second**2
    bound = DIVERGENCE_FACTOR * np.sqrt(_masses(batch)) * batch.total
    completed = (np.abs(groups.join(state[0])) < bound[:, None]).all(axis=1)
    completed &= largest_omega_squared.ravel()[:count] < limit
    low, high = (np.copysign(np.sqrt(np.abs(square)), square) for square in (groups.join(low), groups.join(high)))
    return LaneResults(low, high, least_force.ravel()[:count], least_force_step.ravel()[:count], completed)


def _masses(batch: CondensedBatch) -> np.ndarray:
    """Return the masses of the cables (members,) [kg]."""
    return batch.parameters.mass * batch.total * batch.plan.unit.chain.tributary_length.sum()


def link_coefficients(unit: CondensedModel, links: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return slopes of the modes as given (links, r) and chordwise force patterns (links, patterns); of all links for None."""
    chosen = slice(None) if links is None else links
    slopes = np.diff(np.concatenate(unit.modes[: len(unit.sets)]), axis=1) / unit.chain.length
    return slopes.T[chosen].copy(), unit.chordwise_force_patterns.T[chosen].copy()


def matrices(batch: MemberCoefficients) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return geometric stiffness, its norms and load projections for loads times the length, and matrices to amplitudes."""
    unit, named, total = batch.plan.unit, batch.scaled.named, batch.total
    bases = np.zeros((total.size, sum(unit.ranks), max(unit.ranks)))
    for which, basis in zip(unit.sets, batch.scaled.bases, strict=False):
        bases[:, which, : basis.shape[2]] = basis
    return (
        named["geometric_stiffness"] / total[:, None, None, None],
        named["geometric_stiffness_norms"] / total[:, None],
        named["load_projection"] / total[:, None, None],
        bases,
    )


def watched_steps(window: tuple[float, float] | None, steps_per_second: float) -> np.ndarray:
    """Return the first and the last step that extremes count (2,); all for None."""
    if window is None:
        return np.array([0, np.iinfo(np.int64).max])
    return np.array(steps_within(window, steps_per_second))


def rest_profile(unit: CondensedModel) -> np.ndarray:
    """Return the squared slopes at rest over their mean square (n,), those of a uniform load."""
    shear = unit.chordwise_force_patterns[0] - unit.mean_chordwise_forces[0]
    return shear * shear / (shear * shear @ unit.chain.length)


def member_numbers(batch: MemberCoefficients, steps_per_second: float) -> np.ndarray:
    """Return the numbers of the members (members, MEMBER_ROWS), columns as in ``_kernels_layout``."""
    p, total, damping = batch.parameters, batch.total, batch.parameters.damping
    step, damped = 1.0 / steps_per_second, damping != 0.0
    impulse = np.where(damped, -np.expm1(-damping * step) / np.where(damped, damping, 1.0), step)
    return np.stack(
        [
            p.stiffness, total, p.mass, 0.5 * p.stiffness / total, batch.scaled.slope_norms_squared.max(axis=1),
            1.0 / total, batch.states.uniform, batch.states.sag, np.exp(-damping * step), impulse,
        ],
        axis=1,
    )  # fmt: skip


def member_motions(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinate that each motion moves (motions,), and the motions (members, motions, MOTION_ROWS)."""
    columns, rows = [], []
    count, _, dims = p.ends.shape
    initial = p.ends.reshape(count, 2 * dims)
    for (end, axis), motion in p.motions.items():
        rows.append(dims * ENDS.index(end) + COORDINATES.index(axis))
        values = {name: value[:, 0] for name, value in motion.values.items()}
        phase = values.get("phase", np.full(count, -0.5 * math.pi))  # that of one_minus_cosine
        ramp, origin = values.get("ramp", np.zeros(count)), initial[:, rows[-1]]
        columns.append(
            np.stack([values["angular_frequency"], phase, values["amplitude"], origin, p.damping, ramp], axis=1)
        )
    motions = np.stack(columns, axis=1) if columns else np.empty((count, 0, 6))
    return np.array(rows, dtype=np.int64), motions
