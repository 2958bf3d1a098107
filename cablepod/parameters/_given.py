"""What a scene may give in several ways: axial stiffness, mass and weight per length of a cable, and its upper end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cablepod.conventions import ENDS as ENDS_OF_CABLE
from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._checks import plain
from cablepod.parameters._keys import CABLE, ENDS, INITIAL, STIFFNESS_KEYS, WEIGHT_KEYS, describe, exactly_one

#: Minimum and maximum axial stiffness [N], mass per length [kg/m] (the latter of the weight in N/m too), and chord [m].
STIFFNESSES, MASSES = (1e-6, 1e18), (1e-15, 1e15)
SHORTEST, LONGEST = 1e-6, 1e9
#: Distance of points that count as one, over the chord.
SAME = 1e-9

#: Keys that go with an area -> keys of the same quantity that need none.
WITHOUT_AREA = {"youngs_modulus": "axial_stiffness", "specific_weight": "mass_per_length", "density": "mass_per_length"}


class CrossSection(NamedTuple):
    """Stiffness and mass of a cable; numbers, or arrays of stacked members."""

    stiffness_key: str  #: the given one of STIFFNESS_KEYS
    weight_key: str  #: the given one of WEIGHT_KEYS
    stiffness: Any  #: axial stiffness [N]
    area: Any  #: area of the unstrained cross-section [m2]; None where it is not given
    mass: Any  #: mass per unstretched length [kg/m]
    weight: Any  #: weight per unstretched length [N/m]


def cross_section(
    cable: Mapping[str, Any],
    gravity: Any,
    *,
    own: Mapping[str, Any] = MappingProxyType({}),
    prefix: str = "cable",
    number: Callable[[Any], Any] = float,
) -> CrossSection:
    """Return stiffness and mass of a cable from the keys of its table.

    Parameters
    ----------
    cable
        Table ``[cable]``, with the means of what its chain has of its own.
    own
        Table ``[chain]``, whose masses and stiffnesses stand in place of those of the cable; for messages.
    gravity
        Gravitational acceleration [m/s2].
    prefix
        Key path of the table, for messages.
    number
        Converts the values.

    Raises
    ------
    SceneError
        For two ways to give one quantity, for none, for an area that is missing, and for a stiffness, mass or weight that no
        cable has; the message names the key.
    """
    if not any(name in cable for name in STIFFNESS_KEYS):
        ways = f"{describe(CABLE['youngs_modulus'])}, or {prefix}.axial_stiffness [N]"
        raise SceneError(f"{prefix}.youngs_modulus: missing; allowed: {ways}")
    stiffness_key, weight_key = exactly_one(prefix, cable, STIFFNESS_KEYS), exactly_one(prefix, cable, WEIGHT_KEYS)
    per_area = [name for name in (stiffness_key, weight_key) if name in WITHOUT_AREA]
    if per_area and "area" not in cable:
        ways = " and ".join(f"{prefix}.{WITHOUT_AREA[name]} in place of {name}" for name in per_area)
        raise SceneError(f"{prefix}.area: missing; allowed: {describe(CABLE['area'])}, or {ways}")
    area = number(cable["area"]) if "area" in cable else None
    stiffness, given = number(cable[stiffness_key]), number(cable[weight_key])
    if stiffness_key == "youngs_modulus":
        stiffness = stiffness * area
    if weight_key == "specific_weight":
        if not np.all(gravity):
            allowed = f"{prefix}.density or {prefix}.mass_per_length instead, as without gravity it gives no mass"
            raise scene_error(f"{prefix}.specific_weight", cable[weight_key], allowed)
        weight = given * area
        mass = weight / gravity
    else:
        mass = given * area if weight_key == "density" else given
        weight = mass * gravity
    if not _is_within(stiffness, *STIFFNESSES):
        key = "chain.stiffness" if "stiffness" in own else f"{prefix}.{stiffness_key}"
        allowed = f"an axial stiffness of 1e-6 to 1e18 N (it is {_first(stiffness):g} N)"
        raise scene_error(key, plain(own.get("stiffness", cable[stiffness_key])), allowed)
    if not _is_within(mass, *MASSES) or not _is_within(weight, 0.0, MASSES[1]):
        key = "chain.masses" if "masses" in own else f"{prefix}.{weight_key}"
        allowed = f"1e-15 to 1e15 kg/m and at most 1e15 N/m (it is {_first(mass):g} kg/m)"
        raise scene_error(key, plain(own.get("masses", cable[weight_key])), allowed)
    return CrossSection(stiffness_key, weight_key, stiffness, area, mass, weight)


def _is_within(value: Any, low: float, high: float) -> bool:
    """Tell whether a number, or all of an array, is from `low` to `high`."""
    if isinstance(value, float):
        return low <= value <= high
    return bool(np.all((low <= value) & (value <= high)))


def _first(value: Any) -> float:
    return float(np.asarray(value).flat[0])


def both_ends(ends: Mapping[str, Any], anchor: str = "") -> tuple[Any, Any]:
    """Return the lower and the upper end [m] from the keys of the table ``[ends]``; of a guy `anchor` is the key of the lower.

    Raises
    ------
    SceneError
        As :func:`upper_end`, for ends that coincide, and for a chord out of bounds.
    """
    lower, upper = ends["lower"], upper_end(ends)
    chord = np.sqrt(np.square(np.subtract(upper, lower)).sum(axis=-1))
    if _is_within(chord, SHORTEST, LONGEST):
        return lower, upper
    allowed = f"a chord from {SHORTEST:g} m to {LONGEST:g} m (it is {_first(chord):g} m)"
    if anchor:
        raise scene_error(anchor, plain(lower), allowed)
    if "chord" in ends:
        raise scene_error("ends.chord", plain(ends["chord"]), allowed)
    if not chord.all():
        allowed = "a point other than ends.lower, because ends that coincide span no cable"
    raise scene_error("ends.upper", plain(upper), allowed)


def check_start(initial: Mapping[str, Any], lower: Any, upper: Any, free: str | None) -> None:
    """Refuse a table ``[initial]`` with several starts, and points that do not begin and end at held ends.

    Raises
    ------
    SceneError
        The message names the key.
    """
    if not initial or exactly_one("initial", initial, tuple(INITIAL)) != "points":
        return
    line = np.asarray(initial["points"], dtype=float)
    chord = math.dist(lower, upper)
    for end, place, held in zip(ENDS_OF_CABLE, (line[0], line[-1]), (lower, upper), strict=True):
        if end != free and math.dist(place, held) > SAME * chord:
            allowed = f"a line that begins and ends at the held ends (ends.{end} is {plain(held)})"
            raise scene_error("initial.points", plain(place), allowed)
    if not np.hypot.reduce(np.diff(line, axis=0), axis=1).sum() > SAME * chord:
        raise scene_error("initial.points", plain(line), "a line of some length")


def upper_end(ends: Mapping[str, Any]) -> Any:
    """Return the upper end [m] from the keys of the table ``[ends]``: as given, or from chord and inclination.

    Raises
    ------
    SceneError
        For two ways to give it, for none, and for an inclination in a spatial scene; the message names the key.
    """
    given = [name for name in ("upper", "chord", "inclination") if name in ends]
    if given == ["upper"]:
        return ends["upper"]
    if not given:
        ways = "ends.chord [m] with ends.inclination [deg]"
        raise SceneError(f"ends.upper: missing; allowed: {describe(ENDS['upper'])}, or {ways}")
    if "upper" in given:
        both = " and ".join(f"{name} = {shown(plain(ends[name]))}" for name in given)
        raise SceneError(f"ends: given {both}; allowed: upper, or chord with inclination")
    for name in ("chord", "inclination"):
        if name not in given:
            raise SceneError(
                f"ends.{name}: missing; allowed: {describe(ENDS[name])}, or ends.upper without ends.{given[0]}"
            )
    lower = np.asarray(ends["lower"], dtype=float)
    if lower.shape[-1] != 2:
        raise scene_error("ends.chord", ends["chord"], "a planar scene, two numbers of ends.lower; try: ends.upper")
    angle = np.asarray(ends["inclination"], dtype=float)
    # the cosine by a sine, which is exactly 0 for an upright chord
    unit = np.stack([np.sin(np.radians(90.0 - np.abs(angle))), np.sin(np.radians(angle))], axis=-1)
    return lower + np.asarray(ends["chord"], dtype=float)[..., None] * unit
