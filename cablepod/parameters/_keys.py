"""Keys of a scene: names, units, allowed values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from cablepod.errors import SceneError, named, scene_error, shown
from cablepod.parameters._checks import (
    Check,
    choice,
    direction,
    integer,
    number,
    numbers_list,
    plain,
    point,
    points,
    text,
    truth,
)


@dataclass(frozen=True)
class Key:
    """Key of a scene: check of its values, units (None for a text), long name."""

    check: Check
    units: str | None
    long_name: str
    required: bool = False
    default: Any = None

    @property
    def is_number(self) -> bool:
        """Whether it is a number, not a text or a list."""
        return self.is_whole or self.check.__qualname__.startswith(f"{number.__name__}.")

    @property
    def is_list(self) -> bool:
        """Whether it is a list of numbers."""
        return self.check.__qualname__.startswith(f"{numbers_list.__name__}.")

    @property
    def is_choice(self) -> bool:
        """Whether it is one of some words."""
        return self.check.__qualname__.startswith(f"{choice.__name__}.")

    @property
    def is_truth(self) -> bool:
        """Whether it is true or false."""
        return self.check is truth

    @property
    def is_whole(self) -> bool:
        """Whether it is a whole number."""
        return self.check.__qualname__.startswith(f"{integer.__name__}.")


def _force(long_name: str) -> Key:
    return Key(number(above=0.0), "N", long_name)


#: Maximum diameter of a cable [m], above the main cables of suspension bridges (1.3), and thickness of ice [m], above the rime on
#: masts in mountains; and a unit in which both are given by mistake: factor and name.
MAX_DIAMETER, MAX_ICE, MM = 3.0, 2.0, (1e-3, "mm")
#: Drag coefficient of a cable whose scene gives none: a round cylinder below its critical Reynolds number.
DRAG_COEFFICIENT = 1.2
#: Temperatures [degC], and coefficients of thermal expansion [1/K]: polyethylene 2e-4, aramid -2e-6.
_TEMPERATURE = number(least=-273.15, most=1000.0)
EXPANSION = Key(number(least=-5e-4, most=5e-4), "K-1", "coefficient of thermal expansion")
TOP = {
    "title": Key(text, None, "title"),
    "gravity": Key(number(least=0.0), "m s-2", "gravitational acceleration, along -y", default=9.81),
    "temperature": Key(_TEMPERATURE, "degC", "temperature of cables and mast, that of reference by default"),
    "reference_temperature": Key(
        _TEMPERATURE, "degC", "temperature at which given tensions, sags and lengths hold, 20 by default"
    ),
}
CABLE = {
    "youngs_modulus": Key(number(above=0.0), "Pa", "Young's modulus"),
    "axial_stiffness": _force("axial stiffness EA"),
    "area": Key(number(above=0.0), "m2", "area of the unstrained cross-section"),
    "specific_weight": Key(number(above=0.0), "N m-3", "weight per volume of the unstrained cable"),
    "density": Key(number(above=0.0), "kg m-3", "mass per volume of the unstrained cable"),
    "mass_per_length": Key(number(above=0.0), "kg m-1", "mass per unstretched length"),
    "top_tension": _force("tension at the upper end of the continuous cable at rest"),
    "bottom_tension": _force("tension at the lower end of the continuous cable at rest"),
    "horizontal_force": _force("component of the tension normal to the total load at rest"),
    "unstretched_length": Key(number(above=0.0), "m", "unstretched length of the cable"),
    "sag": Key(number(above=0.0), "m", "largest distance below the chord at rest, along the total load"),
    "strand": Key(text, None, "strand of a table, which gives the keys that are missing"),
    "strand_table": Key(text, None, "CSV file of strands, in place of the shipped table"),
    "breaking_strength": _force("breaking strength of the cable"),
    "thermal_expansion": EXPANSION,
    "diameter": Key(
        number(above=0.0, most=MAX_DIAMETER, mistaken=MM), "m", "diameter of the cable, on which the wind acts"
    ),
    "drag_coefficient": Key(number(least=0.0), "1", f"drag coefficient of the cable, {DRAG_COEFFICIENT:g} by default"),
}
#: Quantities from which the kernels of the catenary find the length, in their order.
CATENARY_KEYS = ("top_tension", "bottom_tension", "horizontal_force", "unstretched_length")
LENGTH_KEYS = (*CATENARY_KEYS, "sag")
STIFFNESS_KEYS = ("youngs_modulus", "axial_stiffness")
WEIGHT_KEYS = ("specific_weight", "density", "mass_per_length")
ENDS = {
    "lower": Key(point, "m", "position of the lower end at rest", required=True),
    "upper": Key(point, "m", "position of the upper end at rest"),
    "chord": Key(number(above=0.0), "m", "distance of the upper end from the lower one"),
    "inclination": Key(
        number(least=-90.0, most=90.0), "degree", "angle of the chord above the horizontal, the upper end towards +x"
    ),
    "free": Key(choice("lower", "upper"), None, "end that moves freely"),
}
LOAD = {"uniform": Key(point, "N m-1", "load per unstretched length, beside the weight", required=True)}
POINT_LOAD = {
    "arc_length": Key(number(least=0.0, most=1.0), "1", "place of the load as a fraction of the length", required=True),
    "force": Key(point, "N", "force", required=True),
}
#: Keys of a segment, without bounds of which the cable is uniform.
SEGMENT = {
    "from": Key(number(least=0.0, most=1.0), "1", "lower end of the segment as a fraction of the length"),
    "to": Key(number(above=0.0, most=1.0), "1", "upper end of the segment as a fraction of the length"),
    **{name: replace(key, required=False) for name, key in CABLE.items() if name not in LENGTH_KEYS},
}
#: Keys of the place of an attachment, one of which is given.
PLACE_KEYS = ("arc_length", "distance_from_lower", "distance_from_upper")
#: Keys of what an attachment does, at least one of which is given.
ATTACHED_KEYS = ("mass", "drag_area", "damper", "spring")
ATTACHMENT = {
    "arc_length": Key(number(least=0.0, most=1.0), "1", "place of the attachment as a fraction of the length"),
    "distance_from_lower": Key(number(least=0.0), "m", "unstretched length from the lower end to the attachment"),
    "distance_from_upper": Key(number(least=0.0), "m", "unstretched length from the upper end to the attachment"),
    "mass": Key(number(least=0.0), "kg", "attached mass"),
    "drag_area": Key(number(least=0.0), "m2", "drag coefficient times area of what is attached"),
    "damper": Key(number(least=0.0), "N s m-1", "viscous damper to the ground"),
    "spring": Key(number(least=0.0), "N m-1", "spring to the ground, without force at rest"),
    "direction": Key(direction, "1", "direction of damper and spring"),
}
#: Lists of tables of a scene of one cable.
LISTED: Mapping[str, Mapping[str, Key]] = {"point_load": POINT_LOAD, "segment": SEGMENT, "attachment": ATTACHMENT}
TIME = {
    "duration": Key(number(above=0.0), "s", "time at the end of the run", required=True),
    "interval": Key(number(above=0.0), "s", "time between snapshots", required=True),
}
CHAIN = {
    "links": Key(integer(least=2), "1", "number of links"),
    "link_lengths": Key(numbers_list(least_length=2, above=0.0), "1", "relative unstretched lengths of the links"),
    "masses": Key(numbers_list(least_length=3, above=0.0), "kg", "masses of the particles, both ends included"),
    "stiffness": Key(numbers_list(least_length=2, above=0.0), "N m-1", "stiffness of the links"),
}
INITIAL = {
    "top_tension": _force("top tension of the rest shape from which the run starts"),
    "unstretched_length": Key(number(above=0.0), "m", "unstretched length of the rest shape from which the run starts"),
    "points": Key(points, "m", "line from which the run starts, at rest"),
}
DAMPING = {
    "mass_proportional": Key(number(least=0.0), "s-1", "damping force per mass and velocity"),
    "link_viscosity": Key(number(least=0.0), "s", "damping force per axial stiffness and strain rate"),
    "tension_proportional": Key(number(least=0.0), "s", "damping force per tension and rate of slope"),
    "ratio": Key(number(least=0.0, most=1.0), "1", "damping ratio of all vibrations about rest"),
    "ratios": Key(
        numbers_list(least=0.0, most=1.0),
        "1",
        "damping ratios of the first vibrations about rest, the last of all others",
    ),
}
ENSEMBLE = {
    "members": Key(integer(least=1, most=10**7), "1", "number of members", required=True),
    "seed": Key(integer(least=0), "1", "seed of the sampling", default=0),
    "sampling": Key(choice("latin_hypercube", "list", "sobol", "grid"), None, "sampling", default="latin_hypercube"),
}
PROFILES = ("logarithmic", "power", "uniform")
SPECTRA = ("kaimal", "von_karman", "davenport")
WIND = {
    "speed": Key(number(least=0.0), "m s-1", "mean wind speed at the reference height", required=True),
    "direction": Key(point, "1", "direction into which the wind blows, horizontal", required=True),
    "profile": Key(choice(*PROFILES), None, "profile of the mean wind speed", default=PROFILES[0]),
    "exponent": Key(number(least=0.0, most=1.0), "1", "exponent of the power profile"),
    "roughness_length": Key(number(above=0.0), "m", "roughness length of the ground", default=0.03),
    "reference_height": Key(
        number(above=0.0), "m", "height above the ground at which the speed is given", default=10.0
    ),
    "ground": Key(number(), "m", "height of the ground", default=0.0),
    "air_density": Key(number(above=0.0), "kg m-3", "density of the air", default=1.25),
    "ramp": Key(number(least=0.0), "s", "time from still air to the full wind", default=0.0),
}
#: Default interval of the samples of the turbulence, and the longest one [s].
GUST_INTERVAL = 0.1
#: Keys of turbulence from a file.
WIND_RECORD = {
    "record": Key(text, None, "netCDF file of the wind, with wind (time, point, component)"),
    "record_sha256": Key(text, None, "SHA-256 of the content of the record"),
}
TURBULENCE = {
    "spectrum": Key(choice(*SPECTRA), None, "spectrum of the turbulence", required=True),
    "intensity": Key(number(above=0.0, most=1.0), "1", "standard deviation over mean speed at the reference height"),
    "length_scale": Key(number(above=0.0), "m", "length scale of the turbulence along the wind"),
    "decay": Key(
        numbers_list(least_length=2, above=0.0),
        "1",
        "decay of the coherence, vertical and across the wind",
        default=(10.0, 16.0),
    ),
    "seed": Key(integer(least=0), "1", "seed of the turbulence", default=0),
    "interval": Key(
        number(least=0.001, most=GUST_INTERVAL), "s", f"interval of the samples, {GUST_INTERVAL} s by default"
    ),
    "exact_mean": Key(truth, None, "whether the mean over the run is exactly that of the profile, false by default"),
    **WIND_RECORD,
}
ICE = {
    "thickness": Key(
        number(least=0.0, most=MAX_ICE, mistaken=MM), "m", "thickness of the ice, grown after tensioning", required=True
    ),
    "density": Key(number(above=0.0), "kg m-3", "density of the ice", default=700.0),
}
TABLES: Mapping[str, Mapping[str, Key]] = {
    "cable": CABLE,
    "ends": ENDS,
    "load": LOAD,
    "time": TIME,
    "chain": CHAIN,
    "initial": INITIAL,
    "damping": DAMPING,
    "wind": WIND,
    "wind.turbulence": TURBULENCE,
    "ice": ICE,
}
OTHER_TABLES = ("motion", *LISTED, "ensemble")
#: Frequency of a sine [Hz], which may be given in place of its angular frequency.
FREQUENCY = "frequency"


@lru_cache
def time_function_keys(units: str) -> dict[str, dict[str, Key]]:
    """Return the keys of each kind of time function whose values have `units`."""
    amplitude = Key(number(), units, "amplitude", required=True)
    omega = Key(number(least=0.0), "rad s-1", "angular frequency", required=True)
    ramp = {"ramp": Key(number(least=0.0), "s", "duration of the smooth start")}
    return {
        "one_minus_cosine": {"amplitude": amplitude, "angular_frequency": omega, **ramp},
        "harmonic": {
            "amplitude": amplitude,
            "angular_frequency": omega,
            "phase": Key(number(), "rad", "phase", default=0.0),
            **ramp,
        },
        "ramp": {
            "amplitude": amplitude,
            "duration": Key(number(above=0.0), "s", "time in which the full amplitude is reached", required=True),
        },
        # no units attribute: coefficient k has the unit units / s^k, which CF cannot express for one variable
        "polynomial": {
            "coefficients": Key(numbers_list(), "1", f"coefficients of t, t2, ... [{units}, s]", required=True),
            **ramp,
        },
        "file": {"path": Key(text, None, "CSV file of the record", required=True), **ramp},
    }


#: Keys of the time functions of all kinds.
FUNCTION_KEYS = frozenset(name for keys in time_function_keys("1").values() for name in keys)


def check_damping(damping: Mapping[str, Any]) -> None:
    """Refuse damping ratios beside other keys of the table but the viscosity of the links.

    Raises
    ------
    SceneError
        The message names the key of the ratios.
    """
    for name in ("ratio", "ratios"):
        others = [f"damping.{other}" for other in damping if other not in (name, "link_viscosity")]
        if name in damping and others:
            raise scene_error(f"damping.{name}", damping[name], f"none beside {' and '.join(others)}")


def describe(key: Key) -> str:
    """Return long name and units of a key, for messages."""
    return key.long_name + (f" [{key.units}]" if key.units else "")


def join(prefix: str, name: Any) -> str:
    """Join a table's key path and a name, for messages."""
    return f"{prefix}.{named(name)}" if prefix else named(name)


def exactly_one(prefix: str, table: Mapping[str, Any], names: tuple[str, ...]) -> str:
    """Return the only one of `names` that `table` has.

    Raises
    ------
    SceneError
        If it has none or several.
    """
    present = [name for name in names if name in table]
    if len(present) != 1:
        given = "none" if not present else " and ".join(f"{name} = {shown(plain(table[name]))}" for name in present)
        raise SceneError(f"{prefix}: given {given}; allowed: exactly one of {', '.join(names)}")
    return present[0]
