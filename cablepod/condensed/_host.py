"""Arrays of a prepared model for the compiled steps of a host."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr

from cablepod.condensed import _kernels_layout as layout
from cablepod.condensed._air import CondensedAir
from cablepod.condensed._kernels_layout import (
    MAX_OMEGA_SQUARED,
    MONITOR_ROWS,
    HostAir,
    HostCoefficients,
    initial_monitor,
)
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._stepper import DIVERGENCE_FACTOR
from cablepod.discretisation._chord_frame import MAX_COSINE
from cablepod.discretisation._step_limit import verlet_step_limit
from cablepod.errors import RunStopped, SceneError, scene_error
from cablepod.wind._air import air_of

#: Minimum and maximum chord over the unstretched length.  Below, the sag is so deep that the deflection normal to the chord no
#: longer describes the cable; above, the strain exceeds the limit of scenes.
CHORD_RANGE = (0.5, 11.0)
CHORD_TURN_TEXT = "a chord that turns by at most a right angle in a step: the ends do not pass each other"
#: Doubles in the order of bytes of this machine.
DOUBLE = np.dtype(float)


def vector(values: Any) -> np.ndarray:
    """Return a copy of real numbers as an array of doubles.

    Raises
    ------
    OverflowError, TypeError, ValueError
        For anything else; texts, instants and complex numbers, which numpy would convert, among it.
    """
    result = np.array(values)
    if result.dtype is DOUBLE:
        return result
    kind = result.dtype.kind
    if kind not in "fiu" and not (kind == "O" and all(isinstance(entry, Real) for entry in result.flat)):
        raise TypeError(f"values: given {result.dtype}; allowed: real numbers")
    return result.astype(float)


def host_coefficients(model: CondensedModel, air: CondensedAir | None = None) -> HostCoefficients:
    """Collect the coefficients of a model for the kernels, as :class:`HostCoefficients` describes them.

    `air` is that along the cable; None for still air.
    """
    chain, p, terms, bounds = model.chain, model.chain.p, model.terms, model.bounds()
    patterns, length, total = model.chordwise_force_patterns, chain.length, chain.total_length
    arms = total - chain.tributary_length[0] - patterns[0]
    moments = p.mass * model.load_projection[1 :: layout.PATTERNS].sum(axis=0)
    second_moment = float(model.load_patterns[1] @ chain.arc_length) / total
    numbers = np.zeros(layout.NUMBERS)
    numbers[[layout.STIFFNESS, layout.LENGTH, layout.MASS]] = p.stiffness, total, p.mass
    numbers[layout.DAMPING] = p.mass_damping or 0.0
    numbers[[layout.INVERSE_LENGTH, layout.SAG_STIFFNESS]] = terms.inverse_length[0], terms.sag_stiffness[0]
    numbers[layout.FIRST_TRIBUTARY], numbers[layout.SECOND_MOMENT] = chain.tributary_length[0], second_moment
    numbers[layout.REACH_MOMENT] = length @ arms
    numbers[[layout.SHORTEST, layout.LONGEST]] = np.multiply(CHORD_RANGE, total)
    numbers[layout.ALONG_AXIS] = MAX_COSINE
    numbers[layout.DIVERGED_ABOVE] = DIVERGENCE_FACTOR * np.sqrt(model.mass.sum()) * total
    numbers[layout.LOWER : layout.LOWER + p.dims] = p.lower
    numbers[layout.STEADY_LOAD : layout.STEADY_LOAD + p.dims] = p.load_at(0.0)
    numbers[layout.FIRST_NORMAL : layout.FIRST_NORMAL + p.dims] = model.reference
    at_end = model.load_patterns[:, 1:].sum(axis=1)
    numbers[layout.END_MASS] = p.mass * (at_end[1] - model.mean_chordwise_forces[1])
    for k, which in enumerate(model.sets):
        numbers[layout.END_MASS + 1 + k] = p.mass * second_moment - (moments[which] ** 2).sum()
    slope_moments = np.einsum("an,n,in->ai", patterns, length, model.slopes)
    of_air = None
    if air is not None:
        velocity, rate = air.at_samples
        velocity = np.ascontiguousarray(velocity.transpose(0, 2, 1))
        of_air = HostAir(velocity, rate, air.drag, air.rule[0], air.shapes)
    by_pattern = terms.mean_chordwise_forces, bounds.norms, at_end, patterns @ (length * arms), bounds.candidates
    return HostCoefficients(
        np.array([len(model.shapes), p.dims, model.n_in_plane]),
        numbers,
        terms.geometric_stiffness,
        terms.load_projection,
        np.vstack([terms.kappa, moments, slope_moments]),
        np.vstack(by_pattern),
        of_air,
    )


def air_of_host(model: CondensedModel, wind: xr.Dataset | None) -> CondensedAir | None:
    """Return the air along the cable until the end of the scene, or of a given field; None for still air.

    Raises
    ------
    SceneError
        As :func:`cablepod.wind._air.air_of`, and for turbulence without a duration.
    """
    p = model.chain.p
    if wind is None and p.turbulence is not None and p.duration is None:
        raise SceneError("time.duration: missing; allowed: a duration [s], over which the turbulence is made")
    end_time = (p.duration or 0.0) if wind is None else 0.0
    air = air_of(p, end_time, wind)
    return None if air is None else CondensedAir(model, air, end_time)


def end_of_wind(air: CondensedAir) -> float:
    """Return the last instant of the wind [s]; infinite for a wind that is steady, from its ramp on."""
    velocity = air.air.velocity
    if np.array_equal(velocity[-1], velocity[-2]):
        return math.inf
    return (len(velocity) - 1) / air.air.samples_per_second * (1.0 + 1e-9)


def initial_state(model: CondensedModel, coefficients: HostCoefficients, air: CondensedAir | None = None) -> np.ndarray:
    """Return the state (rows, columns) of a cable at rest between the ends of the scene, in the mean wind of the start.

    Raises
    ------
    SceneError
        For ends too near to each other, or a model without equilibrium.
    """
    from cablepod.condensed import _kernels_host as kernel  # numba is imported only to compute

    p, r, rows = model.chain.p, len(model.shapes), layout.ROWS
    columns = max(layout.LEAST_FORCE + 1, 1 + layout.PATTERNS * p.dims, r)
    if coefficients.air is not None:
        columns = max(columns, coefficients.air.sigma.size)
        rows = layout.AIR_VELOCITY + 2 * p.dims
    state = np.zeros((rows, columns))
    q, _ = model.initial() if air is None else air.initial()
    upper = np.ascontiguousarray(p.end_positions(np.zeros(1))[0, 1])
    state[layout.Q, :r], state[layout.END, : p.dims] = q, upper
    state[layout.MONITOR, :MONITOR_ROWS] = initial_monitor(np.inf, 0.0)
    result = state.copy()
    status = kernel.leading_trial(coefficients, state, result, upper, np.zeros(p.dims), np.empty(0), 0.0)
    if status == layout.CHORD_OUT_OF_RANGE:
        chord, length = float(np.linalg.norm(upper - p.lower)), model.chain.total_length
        raise scene_error("ends", chord, chord_range_text(length))
    if status != layout.DONE:
        raise SceneError(
            "scene: given one without equilibrium of the model; allowed: a taut cable; try: chain.simulate"
        )
    result[layout.CLOCK] = 0.0
    return result


def chord_range_text(length: float) -> str:
    """Return the allowed distances of the ends, for messages."""
    low, high = (factor * length for factor in CHORD_RANGE)
    return f"a distance of the ends from {low:.6g} to {high:.6g} m, {CHORD_RANGE[0]:g} to {CHORD_RANGE[1]:g} unstretched lengths"


def refusal(
    status: int,
    coefficients: HostCoefficients,
    accepted: np.ndarray,
    end: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    step: float,
) -> SceneError | RunStopped:
    """Return the error of a step that a kernel refused or could not finish."""
    time = accepted[layout.CLOCK, layout.TIME] + step
    if status == layout.INVALID_NUMBER:
        for key, value in (("end_velocity", velocity), ("end_acceleration", acceleration)):
            if not np.abs(value).sum() < np.inf:
                return scene_error(key, value.tolist(), "finite numbers")
        if not np.isfinite(end).all():
            return scene_error("end_position", end.tolist(), "finite numbers")
        status = layout.CHORD_OUT_OF_RANGE  # so far away that the square of the distance is not finite
    if status == layout.INVALID_STEP:
        return scene_error("step", step, "a finite number above 0 [s]")
    if status == layout.CHORD_OUT_OF_RANGE:
        return scene_error("end_position", end.tolist(), chord_range_text(coefficients.numbers[layout.LENGTH]))
    if status == layout.CHORD_REVERSED:
        return scene_error("end_position", end.tolist(), CHORD_TURN_TEXT)
    if status == layout.CHORD_ALONG_AXIS:
        normal = coefficients.numbers[layout.FIRST_NORMAL :][: end.size].round(3) + 0.0
        allowed = f"a chord away from the direction {normal.tolist()}, which its normals refer to"
        return scene_error("end_position", end.tolist(), allowed)
    if status == layout.STEP_ABOVE_LIMIT:
        limit = verlet_step_limit(np.sqrt(accepted[layout.MONITOR, MAX_OMEGA_SQUARED]))
        return scene_error("step", step, f"below the stability limit of the present state, {limit:.6g} s")
    reason = {
        layout.NO_EQUILIBRIUM: "found no equilibrium along the chord",
        layout.STIFFENED: f"stiffened until its stability limit fell below the step {step:.6g} s",
        layout.DIVERGED: "left the finite numbers",
    }[status]
    return RunStopped(
        f"the prepared model {reason} at {time:.9g} s; it keeps its last accepted state, of "
        f"{accepted[layout.CLOCK, layout.TIME]:.9g} s; try a shorter step or, where the cable goes slack, chain.simulate"
    )
