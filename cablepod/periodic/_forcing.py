"""Periodic forcing of a scene: refusals, and the scene at unit angular frequency."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

from cablepod.errors import scene_error
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import SINES, TimeFunction

#: Kinds of motions and load factors, in words.
ALLOWED_KINDS = f'"{SINES[0]}" or "{SINES[1]}", which are periodic'


class Forcing(NamedTuple):
    """Periodic forcing of a scene."""

    parameters: Parameters  #: of the scene with the angular frequency 1 rad/s: times are phases [rad]
    omega: float  #: angular frequency given in the scene [rad/s]
    amplitude: float  #: largest amplitude of the motions [m], without motions of the load factors [1]
    units: str  #: of this amplitude


def periodic_forcing(p: Parameters) -> Forcing:
    """Return the forcing of a scene.

    Raises
    ------
    SceneError
        For a scene without forcing, and for forcing that is not of one angular frequency.
    """
    refuse_wind(p)
    functions = p.time_functions()
    if not functions:
        raise scene_error("motion", "none", f"at least one motion, or load with a factor, of kind {ALLOWED_KINDS}")
    first_key, omega = "", 0.0
    for key, function in functions.items():
        if function.kind not in SINES:
            raise scene_error(f"{key}.kind", function.kind, ALLOWED_KINDS)
        if function.ramp:
            raise scene_error(f"{key}.ramp", function.ramp, "0: a ramp is not periodic")
        given = float(function.values["angular_frequency"])
        if not given:
            raise scene_error(f"{key}.angular_frequency", given, "a number other than 0, or no such table")
        if first_key and abs(given) != omega:
            raise scene_error(
                f"{key}.angular_frequency", given, f"{omega:g} rad/s as in {first_key}: all forcing has one frequency"
            )
        first_key, omega = first_key or key, abs(given)
    motions = [abs(float(motion.values["amplitude"])) for motion in p.motions.values()]
    factors = [abs(float(function.values["amplitude"])) for function in functions.values()]
    largest = max(motions, default=0.0) or max(factors)
    return Forcing(scaled(p, 1.0), omega, largest, "m" if max(motions, default=0.0) else "1")


def refuse_wind(p: Parameters) -> None:
    """Refuse a scene with wind, whose drag neither orbits nor free vibrations have."""
    if p.wind is not None:
        raise scene_error(
            "wind.speed",
            float(p.wind["speed"]),
            "no table [wind]: periodic responses and free vibrations are those in still air",
        )


def scaled(p: Parameters, factor: float) -> Parameters:
    """Return the scene at unit angular frequency with all amplitudes of motions and load factors times `factor`."""

    def at_unit_frequency(function: TimeFunction | None) -> TimeFunction | None:
        if function is None:
            return None
        values: dict[str, Any] = dict(function.values)
        values["angular_frequency"] = math.copysign(1.0, float(values["angular_frequency"]))
        values["amplitude"] = factor * float(values["amplitude"])
        return replace(function, values=values)

    loads = tuple(replace(load, factor=at_unit_frequency(load.factor)) for load in p.point_loads)
    motions = {key: at_unit_frequency(motion) for key, motion in p.motions.items()}
    return replace(
        p,
        motions={key: motion for key, motion in motions.items() if motion is not None},
        load_factor=at_unit_frequency(p.load_factor),
        point_loads=loads,
        duration=2.0 * math.pi,
        initial={},
    )


def unforced(p: Parameters) -> Parameters:
    """Return the scene without damping, its ends and loads held as they are at time 0."""
    lower, upper = p.initial_ends
    attachments = tuple(replace(attachment, damper=0.0) for attachment in p.attachments)
    load = None if p.load is None else p.load_at(0.0) - p.weight
    points = tuple(
        load if load.factor is None else replace(load, force=load.force * float(load.factor(0.0)), factor=None)
        for load in p.point_loads
    )
    return replace(
        p, lower=lower, upper=upper, motions={}, load=load, load_factor=None, point_loads=points, mass_damping=None,
        tension_damping=None, damping_ratios=None, attachments=attachments, initial={}, duration=1.0,
    )  # fmt: skip
