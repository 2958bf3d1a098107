"""Condensed models of many members: coefficients scaled from the first, runs in one compiled call."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod._resources import check_memory
from cablepod.batch._members import RunChunk, run_members
from cablepod.batch._stack import Variables, to_dataset
from cablepod.catenary._statics import member_statics, solve_statics
from cablepod.condensed._fields import sets
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import attributes_of, coordinates_of, padded, shared_attributes, title_of, variables
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.conventions import COORDINATES, ENDS
from cablepod.discretisation._chain import LumpedChain
from cablepod.discretisation._chord_frame import ALIGNED
from cablepod.integrate._output_times import OutputTimes
from cablepod.parameters._from_scene import Members
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters
from cablepod.pod import _normal as pod_normal
from cablepod.reduced._training_distance import member_distances_outside_training
from cablepod.reduced._validity import forcing_attributes, warn_condensed_members


def run(
    scene: xr.Dataset,
    modes: xr.Dataset,
    model: CondensedModel,
    members: Members,
    request: CondensedRequest,
    make: Callable[[Parameters], CondensedModel],
    progress: Callable[[float], None] | None,
) -> xr.Dataset:
    """Run all members of a scene.

    Parameters
    ----------
    scene, modes
        As given.
    model
        Of the first member.
    members
        Their parameters.
    request
        What each run is asked for.
    make
        Makes the model of a member that differs from the first in more than numbers.
    progress
        Called with the part that is done.
    """
    many = plan(modes, model, members, request)

    def one(i: int) -> tuple[Variables, Mapping[str, Any]]:
        p = members[i]
        own = rescaled_model(model, p) if same_structure(p, model.chain.p) else make(p)
        solution = solve(own, request)
        made = variables(own, solution.state, request.outputs, request.links)
        made["arc_length"] = (("particle",), own.chain.arc_length)
        return made, attributes_of(solution, modes, request)

    stack = run_members(one, len(members), progress, many)
    title = title_of(model, str(scene.attrs.get("title", "scene")))
    times = members[0].times() if request.times is None else request.times
    coords = coordinates_of(model, times, request.links)
    result = to_dataset(stack, scene, coords).set_coords("arc_length")
    result.attrs = {"title": title, **result.attrs}
    warn_condensed_members(stack.attrs)
    return result


def rescaled_model(model: CondensedModel, p: Parameters) -> CondensedModel:
    """Make the model of a scene that differs from another in numbers only, by scaling the coefficients of the other."""
    statics = solve_statics(p, p.length_key, p.length_value)
    total = float(statics[0])
    stretch = total / model.chain.total_length
    chain = LumpedChain(p, model.chain.length * stretch, model.chain.arc_length * stretch, model.chain.law)
    made = CondensedModel(chain, model.order, model.modes, model.quadrature, model.tests)
    scaled = rescale_coefficients(model, np.array([p.mass]), np.array([total]))
    turns = [item[0] for item in scaled.turns]
    made.__dict__.update(
        {name: item[0] for name, item in scaled.named.items()}, spectral_basis=(turns, scaled.slope_norms_squared[0])
    )
    made.__dict__["rest_tension"] = 0.5 * float(statics[4] + statics[5])
    return made


def same_structure(p: Parameters, other: Parameters) -> bool:
    """Tell whether two scenes differ in numbers only, as :func:`sibling` needs it."""
    return (
        p.dims == other.dims
        and p.free_end == other.free_end
        and p.link_viscosity == other.link_viscosity
        and list(p.motions) == list(other.motions)
        and [load.fraction for load in p.point_loads] == [load.fraction for load in other.point_loads]
    )


#: Steps in a block, whose tables of many members fit in the cache; a divisor of those after which single runs look at the state,
#: and a multiple of those after which the tables of sines begin anew.
BLOCK = 512


class RescaledCoefficients(NamedTuple):
    """Coefficients of a model for many scenes, a row for each."""

    stretch: np.ndarray  #: length over that of the model
    heavier: np.ndarray  #: what coordinates of mass one are multiplied by
    named: dict[str, np.ndarray]  #: under the names that they have in the model
    turns: list[np.ndarray]
    slope_norms_squared: np.ndarray


def rescale_coefficients(model: CondensedModel, mass: np.ndarray, total: np.ndarray) -> RescaledCoefficients:
    """Scale the coefficients of a model to scenes that differ in numbers only.

    Modes live on sigma = S / L0: with length `total` [m] and mass per length [kg/m], both (members,), all change by powers.
    """
    own = model.chain.p
    stretch = total / model.chain.total_length
    heavier = 1.0 / np.sqrt(mass / own.mass * stretch)
    bent = heavier**2 / stretch
    # uniform and linearly growing loads grow with the length, point loads do not
    grown = np.ones((total.size, len(model.load_patterns)))
    grown[:, : 2 if own.motions else 1] = stretch[:, None]
    pushed = np.tile(grown, own.dims - 1) * heavier[:, None]

    def times(factor: np.ndarray, coefficient: np.ndarray) -> np.ndarray:
        return factor.reshape(factor.shape + (1,) * (coefficient.ndim + 1 - factor.ndim)) * coefficient

    named = {
        "shapes": times(heavier, model.shapes),
        "slopes": times(heavier / stretch, model.slopes),
        "patterns": times(grown, model.load_patterns),
        "chordwise_force_patterns": times(grown, model.chordwise_force_patterns),
        "mean_chordwise_forces": times(grown, model.mean_chordwise_forces),
        "chordwise_forces_at_candidates": times(grown, model.chordwise_forces_at_candidates),
        "geometric_stiffness": times(grown * bent[:, None], model.geometric_stiffness),
        "geometric_stiffness_norms": times(grown * bent[:, None], model.geometric_stiffness_norms),
        "load_projection": times(pushed, model.load_projection),
    }
    turns, squares = model.spectral_basis
    return RescaledCoefficients(stretch, heavier, named, [times(heavier, turn) for turn in turns], times(bent, squares))


def plan(modes: xr.Dataset, model: CondensedModel, members: Members, request: CondensedRequest) -> RunChunk | None:
    """Tell how to run many members at once; None where the compiled loops over members do not cover what is asked for."""
    step, outputs = request.step, set(request.outputs)
    allowed = {"tension_extremes"} if request.links is None else {"tension", "tension_extremes"}
    if (
        model.tests is not None
        or step is None
        or model.order != "leading"
        or request.scheme not in (None, SCHEMES[0])
        or outputs - allowed
    ):
        return None
    if request.times is None and {"time_duration", "time_interval"} & set(members.varied):
        return None
    columns = MemberParameters.of(members)
    if columns is None:
        return None
    times = members[0].times() if request.times is None else request.times
    check_memory(times.size, model.chain.links, model.chain.p.dims, key="times", variables=3)
    instants = OutputTimes.of(times, 1.0 / step)
    if instants.needs_interpolation or instants.steps.size != times.size:
        return None
    shared = shared_attributes(model, instants, SCHEMES[0], modes)
    return CondensedBatchPlan(modes, model, columns, instants, outputs, request.links, shared)


@dataclass(frozen=True)
class CondensedBatchPlan:
    """What all members have in common."""

    modes: xr.Dataset
    model: CondensedModel  #: of the first member
    columns: MemberParameters
    instants: OutputTimes
    outputs: set[str]
    links: np.ndarray | None  #: links whose tensions count, from 0; all by default
    shared: dict[str, Any]  #: attributes

    def __call__(self, first: int, last: int) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Run the members `first` ... `last - 1`."""
        # members without a cable, or with numbers that cannot be, go on as nan: single runs say what is wrong with them
        with np.errstate(all="ignore"):
            return CondensedBatch(self, self.columns.part(first, last)).run()


class CondensedBatch:
    """Some members, set up."""

    def __init__(self, plan: CondensedBatchPlan, columns: MemberParameters) -> None:
        self.plan, self.columns = plan, columns
        solutions, self.good = member_statics(columns)
        self.total, self.rest_tension = solutions[:, 0].copy(), 0.5 * (solutions[:, 4] + solutions[:, 5])
        self.scaled = rescale_coefficients(plan.model, columns.mass, self.total)
        named, links = self.scaled.named, plan.links
        slopes, taus = (
            item if links is None else np.take(item, links, axis=2)
            for item in (named["slopes"], named["chordwise_force_patterns"])
        )
        self.links = slopes, plan.model.n_in_plane, taus
        self.about = (
            columns.mass, columns.stiffness, self.total, self.scaled.slope_norms_squared, named["mean_chordwise_forces"], named["geometric_stiffness"],
            named["load_projection"], named["geometric_stiffness_norms"],
        )  # fmt: skip
        self.load = np.ascontiguousarray(columns.load[:, :, None])
        self.reference = _references(columns.chord)

    def run(self) -> tuple[np.ndarray, Variables, dict[str, list[Any]]]:
        """Tell which members ran to the end, their variables and attributes."""
        instants, links = self.plan.instants, self.links[0].shape[2]
        count, r = self.scaled.slope_norms_squared.shape
        q, v, limit = self._start()
        self.good &= 1.0 / instants.steps_per_second < limit
        saved = np.empty((count, instants.steps.size, r))
        series = np.empty((count, instants.steps.size, links if "tension" in self.plan.outputs else 0))
        wanted = links if "tension_extremes" in self.plan.outputs else 0
        low, high = np.full((count, wanted), np.inf), np.full((count, wanted), -np.inf)
        watch = np.tile([np.inf, 0.0, 0.0, 4.0 * instants.steps_per_second**2, np.inf, 0.0], (count, 1))
        self._march(q, v, saved, series, low, high, watch)
        self.good &= watch[:, 4] == np.inf
        made = self._amplitudes(saved)
        made["end_position"] = ("time", "end", "coordinate"), self.columns.end_positions(instants.times)
        made["unstretched_length"] = (), self.total
        if "tension" in self.plan.outputs:
            made["tension"] = ("time", "link"), series
        if wanted:
            made["tension_minimum"], made["tension_maximum"] = (("link",), low), (("link",), high)
        made["arc_length"] = ("particle",), self.scaled.stretch[:, None] * self.plan.model.chain.arc_length
        return self.good, made, self._attributes(watch, limit)

    def _start(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates, rates half a step before the start, limits of the step [s]."""
        from cablepod.condensed import _kernels_leading_batch as kernel  # numba is imported only to compute

        columns, model, none = self.columns, self.plan.model, np.zeros(1)
        count, _, dims = columns.ends.shape
        chain, s = model.chain, self.scaled
        ends, rates, second = (
            np.ascontiguousarray(columns.end_positions(none, k).reshape(count, 2 * dims, 1)) for k in (0, 1, 2)
        )
        # damping acts on the motion of the frame as on that of the deflection
        second += columns.damping[:, None, None] * rates
        if not columns.motions:
            rates = second = np.zeros((count, 2 * dims, 0))
        # the parabola whose tension is that at rest
        sigma = chain.arc_length / chain.total_length
        heavy = columns.mass * s.stretch * s.heavier * 0.5 * self.total**2 / self.rest_tension
        bow = heavy[:, None] * (model.shapes @ (chain.tributary_length * sigma * (1.0 - sigma)))
        q, v, limit = np.empty_like(bow), np.empty_like(bow), np.empty(count)
        kernel.leading_starts(
            ends, rates, second, self.load, self.reference, 1.0 / self.plan.instants.steps_per_second, columns.damping, *self.about,
            model.n_in_plane, bow, q, v, limit,
        )  # fmt: skip
        return q, v, limit

    def _march(
        self,
        q: np.ndarray,
        v: np.ndarray,
        saved: np.ndarray,
        series: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        watch: np.ndarray,
    ) -> None:
        """Step all members, block by block."""
        from cablepod.condensed import _kernels_leading_batch as kernel

        instants, columns, damping = self.plan.instants, self.columns, self.columns.damping
        step, total = 1.0 / instants.steps_per_second, int(instants.steps[-1]) + 1
        decay, damped = np.exp(-damping * step), damping != 0.0
        kick = np.where(damped, -np.expm1(-damping * step) / np.where(damped, damping, 1.0), step)
        model = self.plan.model
        bound = 1e6 * np.sqrt(columns.mass * self.scaled.stretch * model.chain.tributary_length.sum()) * self.total
        fill, ends, second = self._tables()
        blocks = range(0, total, BLOCK)
        bounds = np.searchsorted(instants.steps, [*blocks, total]).tolist()
        for begin, first, last in zip(blocks, bounds[:-1], bounds[1:], strict=True):
            fill(begin)
            kernel.leading_members(
                q, v, step, decay, kick, ends, second, self.load, self.reference, *self.about, self.scaled.named["chordwise_forces_at_candidates"],
                *self.links, begin, min(BLOCK, total - begin), instants.steps, first, last, saved, low, high, watch, series,
                bound, self.good,
            )  # fmt: skip

    def _tables(self) -> tuple[Callable[[int], None], np.ndarray, np.ndarray]:
        """Make tables of places and second rates of the ends (members, 2 dims, BLOCK); what fills them from a step on."""
        from cablepod.parameters import _kernels_sines as kernel

        columns, rate = self.columns, self.plan.instants.steps_per_second
        count, _, dims = columns.ends.shape
        still = columns.ends.reshape(count, 2 * dims)
        ends = np.repeat(still[:, :, None], BLOCK, axis=2)
        second = np.zeros((count, 2 * dims, BLOCK if columns.motions else 0))
        damping = columns.damping if columns.damping.any() else None
        moving = []
        for (end, axis), motion in columns.motions.items():
            row = dims * ENDS.index(end) + COORDINATES.index(axis)
            values = {name: np.ascontiguousarray(value[:, 0]) for name, value in motion.values.items()}
            phase = values.get("phase", np.full(count, -0.5 * math.pi))  # of one minus a cosine
            origin = np.ascontiguousarray(still[:, row])
            moving.append((values["angular_frequency"], phase, values["amplitude"], origin, damping, row))

        def fill(begin: int) -> None:
            for motion in moving:
                kernel.ends_of_members(begin, rate, *motion, ends, second)

        return fill, ends, second

    def _amplitudes(self, saved: np.ndarray) -> Variables:
        model = self.plan.model
        return {
            f"amplitude{suffix}": (
                ("time", "mode"),
                padded(saved[:, :, at] @ turn.transpose(0, 2, 1), model.rank),
            )
            for suffix, at, turn in zip(pod_normal.SETS, sets(model), self.scaled.turns, strict=False)
        }

    def _attributes(self, watch: np.ndarray, limit: np.ndarray) -> dict[str, list[Any]]:
        """Attributes that differ from member to member, and those that do not, a list for each."""
        columns, instants = self.columns, self.plan.instants
        own = {
            "smallest_chordwise_force": watch[:, 0],
            "time_of_smallest_force": watch[:, 1] / instants.steps_per_second,
            **forcing_attributes(columns, self.total),
            "step_limit": limit,
        }
        return (
            {name: [value] * limit.size for name, value in self.plan.shared.items()}
            | {name: values.tolist() for name, values in own.items()}
            | member_distances_outside_training(
                self.plan.modes, columns, self.total, float(instants.times[-1]), self.rest_tension
            )
        )


def _references(chord: np.ndarray) -> np.ndarray:
    """Axes that tell the normals apart (members,), as :attr:`Model.reference`."""
    if chord.shape[1] == 2:
        return np.ones(len(chord), dtype=np.int64)
    along = np.abs(chord) / np.sqrt((chord * chord).sum(axis=1, keepdims=True))
    return np.where(along[:, 1] < ALIGNED, 1, np.argmin(along, axis=1))
