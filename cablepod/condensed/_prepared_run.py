"""Runs of a prepared model with the motions of its scene: plain arrays, and the forces on the upper support."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod.condensed import _kernels_layout as layout
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._air_motion import DragOfMotion
from cablepod.condensed._fields import CondensedTrajectory, boundary_data_of
from cablepod.condensed._kernels_layout import HostCoefficients
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._output import attributes, variables
from cablepod.condensed._runs import SCHEMES, CondensedRequest, solve
from cablepod.discretisation._chord_frame import ChordFrame
from cablepod.reduced._validity import warn_condensed_out_of_range

OUTPUTS = ("position", "tension", "end_force")


class PreparedRun(NamedTuple):
    """Result of :meth:`PreparedModel.run`; None for what was not asked for."""

    time: np.ndarray  #: (time,) [s]
    amplitude: np.ndarray  #: (time, mode) [m]
    amplitude_out_of_plane: np.ndarray | None  #: the same of the second normal, in space
    end_force: np.ndarray | None  #: force of the cable on its upper support, inertia included (time, dims) [N]
    position: np.ndarray | None  #: (time, particle, dims) [m]
    tension: np.ndarray | None  #: (time, link) [N]
    smallest_chordwise_force: float  #: over all steps [N]; below zero the cable goes slack


def run(
    model: CondensedModel,
    coefficients: HostCoefficients,
    step: float,
    wind: xr.Dataset | None,
    times: Any,
    outputs: tuple[str, ...],
    links: np.ndarray | None,
) -> PreparedRun:
    """Run a model by velocity Verlet with a step [s]; see :meth:`cablepod.condensed.PreparedModel.run`.

    `wind` is a field in place of that of the scene, or None; `links` are indices, from 0, or None for all links.
    """
    request = CondensedRequest.of(times=times, scheme=SCHEMES[0], step=step, outputs=(), wind=wind)
    solution = solve(model, request)
    state = solution.state
    attrs = attributes(model, state, None)
    warn_condensed_out_of_range(attrs)
    found = {name: values for name, (_, values) in variables(model, state, outputs, links).items()}
    force, ends = None, found["end_position"]
    if "end_force" in outputs:
        force = _end_forces(coefficients, state.q, boundary_data_of(model, state, ends), ends)
        if solution.run.air is not None:
            force += _end_forces_by_drag(coefficients, solution.run.air, state, ends)
    return PreparedRun(
        solution.run.times, found["amplitude"], found.get("amplitude_out_of_plane"), force, found.get("position"),
        found.get("tension"), attrs["smallest_chordwise_force"],
    )  # fmt: skip


def _end_forces(
    coefficients: HostCoefficients, q: np.ndarray, boundary_data: np.ndarray, ends: np.ndarray
) -> np.ndarray:
    """Return the forces of the cable on its upper support in still air, inertia included (times, dims) [N].

    `q`, `boundary_data` and `ends` are coordinates (times, r), boundary data and positions of the ends [m] at the instants.
    """
    from cablepod.condensed import _kernels_host as kernel  # numba is imported only to compute

    dims = ends.shape[2]
    force, work = np.empty((len(q), dims)), (np.empty(q.shape[1]), np.empty((dims, dims)), np.empty(1))
    kernel.end_forces(coefficients, np.ascontiguousarray(q), boundary_data, ends, *work, force)
    return force


def _end_forces_by_drag(
    coefficients: HostCoefficients, air: CondensedAir, state: CondensedTrajectory, ends: np.ndarray
) -> np.ndarray:
    """Return the part of the drag in the forces on the upper support (times, dims) [N], from its moments and accelerations."""
    model, times, chord = air.model, state.instants.times, ends[:, 1] - ends[:, 0]
    stretch = np.sqrt(np.sum(chord**2, axis=1)) / model.chain.total_length
    drag = DragOfMotion.of(air, times, state.q, state.rates, stretch)
    accelerations = drag.on(air.shapes[2], model.n_in_plane) * coefficients.by_coordinate[layout.MOMENTS]
    transverse = drag.moments - np.stack([accelerations[:, which].sum(axis=1) for which in model.sets], axis=1)
    return np.einsum("tk,tkc->tc", transverse, ChordFrame.of(chord, model.reference).normals)
