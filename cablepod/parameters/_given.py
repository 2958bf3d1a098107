"""What a scene may give in several ways: axial stiffness, mass and weight per length of a cable, and its upper end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from cablepod.errors import SceneError, scene_error, shown
from cablepod.parameters._keys import CABLE, ENDS, STIFFNESS_KEYS, WEIGHT_KEYS, describe, exactly_one

#: Keys that go with an area -> keys of the same quantity that need none.
WITHOUT_AREA = {
    "youngs_modulus": "axial_stiffness",
    "specific_weight": "mass_per_length",
    "density": "mass_per_length",
}


class CrossSection(NamedTuple):
    """Stiffness and mass of a cable; numbers, or arrays of stacked members."""

    stiffness_key: str  #: the given one of STIFFNESS_KEYS
    weight_key: str  #: the given one of WEIGHT_KEYS
    stiffness: Any  #: axial stiffness [N]
    area: Any  #: area of the unstrained cross-section [m2]; None where it is not given
    mass: Any  #: mass per unstretched length [kg/m]
    weight: Any  #: weight per unstretched length [N/m]


def cross_section(
    cable: Mapping[str, Any], gravity: Any, *, prefix: str = "cable", number: Callable[[Any], Any] = float
) -> CrossSection:
    """Return stiffness and mass of a cable from the keys of its table.

    Parameters
    ----------
    cable
        Table ``[cable]``.
    gravity
        Gravitational acceleration [m/s2].
    prefix
        Key path of the table, for messages.
    number
        Converts the values.

    Raises
    ------
    SceneError
        For two ways to give one quantity, for none, and for an area that is missing; the message names the key.
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
        return CrossSection(stiffness_key, weight_key, stiffness, area, weight / gravity, weight)
    mass = given * area if weight_key == "density" else given
    return CrossSection(stiffness_key, weight_key, stiffness, area, mass, mass * gravity)


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
        both = " and ".join(f"{name} = {shown(ends[name])}" for name in given)
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
