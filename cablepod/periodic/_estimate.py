"""Estimate of the error of orbits and bifurcations: the same in a model of order "exact" with more modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from cablepod.condensed._vibration import vibration_modes
from cablepod.errors import RunStopped, SceneError
from cablepod.parameters._nonuniform import refuse_nonuniform
from cablepod.periodic import _fields as fields
from cablepod.periodic._continuation import Branch, Limits, adapted_at, trace
from cablepod.periodic._events import Event, entering
from cablepod.periodic._general import solver_of
from cablepod.periodic._members import model_of
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import Solver, State

#: Number of modes of each deflection that the richer model has more.
MORE_MODES = 2
#: Number of points in each direction within which a bifurcation is looked for.
POINTS = 30
#: Number of phases of a forcing period at which orbits are compared.
PHASES = 128
FOUND = "found"


def refuse_things(model: PeriodicModel) -> None:
    """Refuse cables of several parts or with attachments, which order "exact" lacks.

    Raises
    ------
    SceneError
        The message names the table.
    """
    refuse_nonuniform(
        model.condensed.chain.p, 'more modes, without the output "error_estimate", which is by a model of order "exact"'
    )


def richer_solver(scene: xr.Dataset, modes: xr.Dataset, rank: int | None, out_of_plane: bool) -> tuple[Solver, str]:
    """Return the solver of the richer model, and in what it is richer.

    Modes beyond `rank` are taken from `modes` or, for vibration modes, computed; without either only the order rises.
    """
    known = modes.sizes["mode"]
    used = known if rank is None else int(rank)
    if used < known:
        rich, more = modes, min(used + MORE_MODES, known)
    else:
        rich, more = _more_vibrations(scene, modes, used)
    model, _ = model_of(scene, rich, rank=more, order="exact", out_of_plane=out_of_plane)
    gained = [f"{more - used} more modes"] * (more > used) + ["order exact"]
    return solver_of(model), ", ".join(gained)


def _more_vibrations(scene: xr.Dataset, modes: xr.Dataset, used: int) -> tuple[xr.Dataset, int]:
    """Return vibration modes that go on where the given ones end, and their number; those given where there are none."""
    if modes.attrs.get("method") == "vibration":
        for static in (False, True):
            try:
                rich = vibration_modes(
                    scene, rank=used + MORE_MODES, links=modes.sizes["particle"] - 1, static_modes=static
                )
            except SceneError:  # fewer links than modes
                break
            first = rich["mode_shape"].values[:used]
            if np.allclose(first, modes["mode_shape"].values[:used], rtol=0.0, atol=1e-9 * np.abs(first).max()):
                return rich, used + MORE_MODES
    return modes, used


def transferred(state: State, model: PeriodicModel, rich: PeriodicModel, vector: np.ndarray | None = None) -> State:
    """Return a state, or a `vector` of its shape, in the coordinates of a model with more modes."""
    source = state if vector is None else replace(state, z=vector)
    parts, begin = [], 0
    for turn, target in zip(model.turns, rich.turns, strict=True):
        if begin >= state.size:
            break
        coordinates = source.coefficients[:, begin : begin + turn.shape[1]]
        amplitudes = np.zeros((len(coordinates), target.shape[0]))
        amplitudes[:, : turn.shape[0]] = coordinates @ turn.T * model.scales[1]
        parts.append(np.linalg.solve(target, amplitudes.T).T / rich.scales[1])
        begin += turn.shape[1]
    coefficients = np.concatenate(parts, axis=1)
    z = np.append(coefficients.ravel(), source.z[-1] * model.scales[0] / rich.scales[0])
    return State(z, state.planar, coefficients.shape[1], state.periods)


def orbit_error(solver: Solver, state: State, rich: Solver) -> float:
    """Return the largest rms distance of an orbit from that of the richer model over a period, over its largest rms motion.

    It is nan where the richer model has no orbit nearby.
    """
    guess = transferred(state, solver.model, rich.model)
    try:
        found, _, iterations = adapted_at(rich, guess)
    except RunStopped:
        return np.nan
    if iterations < 0:
        return np.nan
    count = PHASES * state.periods
    first, second = (
        fields.deflections(each.model, fields.coordinates(each.model, one, count))
        for each, one in ((solver, state), (rich, found))
    )
    motion = second - second.mean(axis=1, keepdims=True)

    def size(field: np.ndarray) -> float:
        return float(np.sqrt((field**2).sum(axis=0).mean(axis=1)).max())

    return size(first - second) / max(size(motion), 1e-300)


def bifurcation_errors(solver: Solver, events: list[Event], rich: Solver) -> np.ndarray:
    """Return the relative distances of the frequencies of bifurcations from those of the richer model; nan for none nearby."""
    return np.array([_error(solver, event, rich) for event in events])


def _error(solver: Solver, event: Event, rich: Solver) -> float:
    """Follow the branch of the richer model from a bifurcation both ways, to the nearest one of its kind."""
    if event.direction is None:
        return np.nan
    start = transferred(event.state, solver.model, rich.model)
    heading = transferred(event.state, solver.model, rich.model, event.direction).z
    heading /= np.linalg.norm(heading)
    found: list[float] = []
    for sign in (1.0, -1.0):
        near = _nearest(rich, event, start, sign * heading)
        if near is not None:
            found.append(near)
    return min((abs(omega / start.omega - 1.0) for omega in found), default=np.nan)


def _nearest(rich: Solver, event: Event, start: State, heading: np.ndarray) -> float | None:
    """Return the frequency of the first bifurcation of the same kind along a branch; None for none."""
    try:
        state, direction, iterations = rich.correct(start, heading)
        if iterations < 0:
            return None
        if direction @ heading < 0.0:
            direction = -direction
        events: list[Event] = []

        def nearest() -> Event | None:
            return next((one for one in events if (one.kind, one.which) == (event.kind, event.which)), None)

        limits = Limits(0.5 * start.omega, 2.0 * start.omega, POINTS, lambda point: FOUND if nearest() else "")
        trace(rich, Branch(0), state, direction, limits, entering(rich, events))
    except RunStopped:
        return None
    found = nearest()
    return found.state.omega if found else None
