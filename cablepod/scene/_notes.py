"""Notes on what is unusual in a scene, and the key that is likely wrong.

A note is no error: the scene runs.  Its purpose is a number in another unit, a thousand or a million times off.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.errors import SceneError
from cablepod.parameters._ice import coat_section, ice_thickness, mass_of_ice
from cablepod.parameters._key_paths import motion_path
from cablepod.parameters._keys import STIFFNESS_KEYS, WEIGHT_KEYS
from cablepod.parameters._parameters import InWind, Parameters, gust_interval, has_record
from cablepod.parameters._time_functions import TimeFunction
from cablepod.parameters._utilisation import utilisation
from cablepod.scene._note import Note, outside
from cablepod.scene._table_notes import notes_of_tables

#: Usual densities [kg/m3]: ropes of polyethylene float (970, with voids 600), tungsten has 19300.
DENSITY = (500.0, 25000.0)
#: Usual moduli [Pa]: soft rubber 1e7, nylon rope 1e9, steel 2e11, diamond 1.2e12.
MODULUS = (1e7, 2e12)
#: Usual axial stiffness over mass per length [m2/s2], of a cable without an area: soft rubber 1e4, diamond 3.4e8.
STIFFNESS_OVER_MASS = (1e4, 1e9)
#: Usual ratios of the chord to the diameter of a round cross-section: below, a bar; above, thinner than a fishing line.
SLENDERNESS = (200.0, 1e5)
#: Usual ratios of the diameter to that of a solid cross-section of the same area: ropes have gaps, some a cover.
DIAMETER_OVER_SOLID = (0.5, 20.0)
#: Usual mass per length over the area of a circle of the diameter [kg/m3]: a thin core with a wide cover, tungsten.
DENSITY_OF_DIAMETER = (100.0, 25000.0)
#: Maximum usual thickness of ice [m].
LARGEST_ICE = 0.3
#: Maximum usual area [m2], the main cable of a suspension bridge.
LARGEST_AREA = 1.0
#: Usual gravitational acceleration [m/s2]: Moon to Jupiter.
GRAVITY = (1.0, 30.0)
#: Maximum usual stress at rest [Pa] and strain: the strongest steel wire, and above the strain at break of steel and aramid.
LARGEST_STRESS, LARGEST_STRAIN = 2.5e9, 0.05
#: Usual breaking stress [Pa], breaking strength over area: natural fibre rope to the strongest fibres.
BREAKING_STRESS = (3e7, 7e9)
#: Maximum usual ratios: unstretched length over chord, motion over chord, loads over weight.
LARGEST_LENGTH, LARGEST_MOTION, LARGEST_LOAD = 2.0, 0.1, 100.0
#: Maximum usual product of first frequency and interval of gusts: beyond it, samples take more than 2 % from gusts that resonate.
LARGEST_PRODUCT = 0.2
#: Factors between units that are mistaken for each other, and the name of the unit in which a value was likely given.
UNITS: dict[str, dict[float, str]] = {
    "youngs_modulus": {1e3: "kPa", 1e6: "MPa", 1e9: "GPa", 1e-3: "", 1e-6: ""},
    "area": {1e-6: "mm2", 1e-4: "cm2", 1e-3: "", 1e3: "", 1e6: ""},
    "specific_weight": {1e3: "kN/m3", 1e6: "MN/m3", 1e-3: "", 1e-6: ""},
    "density": {1e3: "t/m3", 1e6: "", 1e-3: "", 1e-6: ""},
    "axial_stiffness": {1e3: "kN", 1e6: "MN", 1e-3: "", 1e-6: ""},
    "mass_per_length": {1.0 / 9.81: "N/m", 1e-3: "g/m", 1e3: "t/m", 1e-6: "", 1e6: ""},
    "force": {1e3: "kN", 1e6: "MN", 1e-3: "", 1e-6: ""},
    "gravity": {1e-3: "mm/s2", 1e-6: ""},
    "load": {1e-3: "", 1e-6: ""},
    "diameter": {1e-3: "mm", 1e-2: "cm", 1e3: ""},
    "ice": {1e-3: "mm", 1e-2: "cm"},
    "inclination": {math.degrees(1.0): "rad"},
    "length": {1e-3: "mm", 1e-2: "cm", 1e3: "km", 1e-6: "", 1e6: ""},
}
#: Maximum magnitude of an inclination that may be in radians: a right angle, rounded by hand.
LARGEST_RADIANS = 1.58


@dataclass(frozen=True)
class StaticNumbers:
    """Numbers of a scene at rest in still air that notes and summaries are about."""

    chord: float  #: distance of the ends [m]
    area: float  #: of the cross-section [m2]; nan where it is not given, and in what follows from it
    diameter: float  #: of a round cross-section of the same area [m]
    modulus: float  #: [Pa]
    density: float  #: [kg/m3]
    statics: np.ndarray  #: (6,) as in ``catenary._formulas.COLUMNS``
    load: float  #: largest sum of the loads beside the weight [N]
    motion: float  #: largest displacement of an end along an axis [m]
    motion_key: str  #: key path of that motion

    @property
    def length(self) -> float:
        """Unstretched length [m]."""
        return float(self.statics[0])

    @property
    def tension(self) -> float:
        """Largest tension at rest in still air [N]."""
        return float(max(self.statics[4], self.statics[5]))


def static_numbers(p: Parameters) -> StaticNumbers:
    """Compute the numbers of a scene at rest in still air.

    Raises
    ------
    SceneError
        If the scene has no equilibrium.
    """
    statics = solve_statics(p, p.length_key, p.length_value)
    end_time = p.duration or 0.0
    load = 0.0 if p.load is None else math.hypot(*p.load) * float(statics[0]) * _largest(p.load_factor, end_time)
    for point in p.point_loads:
        load += math.hypot(*point.force) * _largest(point.factor, end_time)
    motion, key = _largest_motion(p)
    area = math.nan if p.area is None else p.area
    return StaticNumbers(
        chord=math.dist(*p.initial_ends),
        area=area,
        diameter=math.sqrt(4.0 / math.pi * area),
        modulus=p.stiffness / area,
        density=p.mass / area,
        statics=statics,
        load=load,
        motion=motion,
        motion_key=key,
    )


def _largest_motion(p: Parameters) -> tuple[float, str]:
    """Return the largest displacement of an end along an axis [m], and the key path of that motion."""
    end_time = p.duration or 0.0
    motions = [(_largest(motion, end_time), motion_path(*key)) for key, motion in p.motions.items()]
    return max(motions, default=(0.0, ""))


def _largest(function: TimeFunction | None, end_time: float) -> float:
    """Return a bound of the absolute value of a time function; None is the constant 1."""
    if function is None:
        return 1.0
    values = function.values
    if function.kind in ("one_minus_cosine", "ramp"):
        return abs(float(values["amplitude"])) * (2.0 if function.kind == "one_minus_cosine" else 1.0)
    if function.kind == "harmonic":
        return abs(float(values["amplitude"])) * (1.0 + abs(math.sin(values["phase"])))
    return float(np.abs(function(function.sampling_times(end_time))).max())


# --- notes ------------------------------------------------------------------------------------------------------------


def notes_of(p: Parameters, tension: float | None = None) -> tuple[Note, ...]:
    """Return the notes on a scene: on its cable, which another unit may explain, and then on its tables; each the worst first.

    Parameters
    ----------
    p
        Parameters of the scene.
    tension
        Largest tension in the mean wind [N]; where it is not given, notes on a scene with wind are about its rest in still air.

    Raises
    ------
    SceneError
        If the scene has no equilibrium.
    """
    return *_notes_of_units(p, tension), *worst_first([*notes_of_tables(p), *notes_of_gusts(p, [p])])


def notes_of_gusts(p: InWind, cables: Iterable[Parameters]) -> Iterator[Note]:
    """Yield the note on gusts whose samples are too far apart for the highest of the first frequencies of cables [Hz]."""
    if p.turbulence is None or has_record(p):
        return
    highest = 0.0
    for cable in cables:
        with suppress(SceneError, ArithmeticError):  # rest refuses the scene
            numbers = static_numbers(cable)
            highest = max(highest, 0.5 / numbers.chord * math.sqrt(numbers.tension / cable.mass))
    interval = gust_interval(p)
    what = f"samples of gusts every {interval:g} s and a first frequency of {highest:.3g} Hz, with a product"
    asked = f"try: at most {LARGEST_PRODUCT / max(highest, 1e-300):.2g} s"
    yield from outside("wind.turbulence.interval", what, interval * highest, (0.0, LARGEST_PRODUCT), "", asked)


def worst_first(notes: Iterable[Note]) -> list[Note]:
    """Return notes in the order of their excess."""
    return sorted(notes, key=lambda note: -note.excess)


def _notes_of_units(p: Parameters, tension: float | None = None) -> list[Note]:
    """Return the notes on a cable, its rest and its motion, that one key in another unit may explain."""
    numbers = static_numbers(p)
    return worst_first([
        *_notes_of_cable(p, numbers), *_notes_of_rest(p, numbers, tension), *_notes_of_motion(p, numbers),
    ])  # fmt: skip


def _notes_of_cable(p: Parameters, numbers: StaticNumbers) -> Iterator[Note]:
    gravity = math.hypot(*p.weight) / p.mass
    if gravity > 0.0:
        yield from outside("gravity", "a gravitational acceleration", gravity, GRAVITY, "m/s2")
    mass = (p.bare or p).mass  # without ice
    if p.masses is None:
        yield from outside(f"cable.{p.weight_key}", "a density", mass / numbers.area, DENSITY, "kg/m3")
    if p.link_stiffness is None:
        yield from outside(p.stiffness_path, "a Young's modulus", numbers.modulus, MODULUS, "Pa")
    if p.area is None and not p.own_keys:
        what = "an axial stiffness over the mass per length"
        yield from outside("cable.axial_stiffness", what, p.stiffness / mass, STIFFNESS_OVER_MASS, "m2/s2")
    yield from outside("cable.area", "an area", numbers.area, (0.0, LARGEST_AREA), "m2")
    slenderness = numbers.chord / numbers.diameter
    what = f"a diameter of {numbers.diameter:.3g} m on a chord of {numbers.chord:.3g} m, with a ratio"
    yield from outside("cable.area", what, slenderness, SLENDERNESS, "")
    if p.diameter is not None:
        diameter = float((p.bare or p).diameter)  # without ice
        what = f"a diameter of {diameter:.3g} m over that of a solid cross-section of the same area, a ratio"
        yield from outside("cable.diameter", what, diameter / numbers.diameter, DIAMETER_OVER_SOLID, "")
        yield from outside("ice.thickness", "ice", ice_thickness(p), (0.0, LARGEST_ICE), "m")
        if p.area is None and p.masses is None:
            what, section = "a density of the section of the diameter", 0.25 * math.pi * diameter**2
            yield from outside(f"cable.{p.weight_key}", what, mass / section, DENSITY_OF_DIAMETER, "kg/m3")
    if p.breaking_strength is not None:
        what, stress = "a breaking strength over the area", p.breaking_strength / numbers.area
        yield from outside("cable.breaking_strength", what, stress, BREAKING_STRESS, "Pa")


def _notes_of_rest(p: Parameters, numbers: StaticNumbers, tension: float | None) -> Iterator[Note]:
    if p.free_end is not None or "points" in p.initial:
        return  # never at this equilibrium
    air = "" if p.wind is None else " in still air" if tension is None else " in the mean wind"
    tension = numbers.tension if tension is None else tension
    key, stress = f"cable.{p.length_key}", tension / numbers.area
    yield from outside(key, f"a stress at rest{air}", stress, (0.0, LARGEST_STRESS), "Pa")
    yield from outside(key, f"a strain at rest{air}", tension / p.stiffness, (0.0, LARGEST_STRAIN), "")
    what = "an unstretched length over the chord"
    yield from outside(key, what, numbers.length / numbers.chord, (0.0, LARGEST_LENGTH), "")
    if p.breaking_strength is not None:
        what, used = f"a tension at rest{air} over the breaking strength", utilisation(tension, p.breaking_strength)
        yield from outside("cable.breaking_strength", what, used, (0.0, 1.0), "")
    lower, upper = p.initial_ends
    if upper[1] < lower[1] and p.weight[1] < 0.0:
        drop = f"an upper end {lower[1] - upper[1]:.3g} m below the lower one"
        if p.inclination is None:
            yield Note("ends.upper", f"{drop} (swapped?)", 0.0)
        else:
            yield Note("ends.inclination", f"an inclination of {p.inclination:g} degrees, {drop}", 0.0)


def _notes_of_motion(p: Parameters, numbers: StaticNumbers) -> Iterator[Note]:
    what = "a displacement over the chord"
    yield from outside(numbers.motion_key, what, numbers.motion / numbers.chord, (0.0, LARGEST_MOTION), "")
    weight = math.hypot(*p.weight) * numbers.length
    if weight > 0.0 and numbers.load > LARGEST_LOAD * weight:
        largest = max((math.hypot(*point.force) for point in p.point_loads), default=0.0)
        uniform = p.load is not None and math.hypot(*p.load) * numbers.length >= largest
        key = "load.uniform" if uniform else "point_load.force"
        yield from outside(key, "loads over the weight", numbers.load / weight, (0.0, LARGEST_LOAD), "")


# --- the key that is likely wrong ---------------------------------------------------------------------------------------


def likely_keys(p: Parameters) -> list[tuple[str, str]]:
    """Return key paths and changes of up to two keys that leave nothing unusual by a factor between units; of uniform cables."""
    if p.segments or p.attachments or _is_usual(p):
        return []
    keys = [*(["area"] if p.area is not None else []), *([p.stiffness_key] if p.link_stiffness is None else [])]
    keys += [*([p.weight_key] if p.masses is None else []), p.length_key, "ends"]
    keys += ["inclination"] if p.inclination is not None and abs(p.inclination) <= LARGEST_RADIANS else []
    keys += ["ice"] if ice_thickness(p) else []
    keys += ["gravity"] if p.weight_key != "specific_weight" else []
    keys += ["motion"] if p.motions else []
    keys += ["load"] if p.load is not None else []
    keys += ["breaking_strength"] if p.breaking_strength is not None else []
    keys += ["diameter"] if p.diameter is not None else []
    found = []
    for key in keys:
        of_length = key in ("ends", "motion", "unstretched_length", "sag")
        for factor, unit in UNITS.get(key, UNITS["length" if of_length else "force"]).items():
            if _is_usual(scaled := _scaled(p, key, factor)):
                found.append((abs(math.log10(factor)), *_change(scaled, key, factor, unit)))
                break
    return [(path, text) for _, path, text in sorted(found)[:2]]


def _scaled(p: Parameters, key: str, factor: float) -> Parameters:
    """Return the parameters with one key, both ends or all motions times a factor."""
    changes: dict[str, Any]
    if key == "area":
        names = ["area", *(["stiffness"] if p.stiffness_key == "youngs_modulus" else [])]
        names += ["mass", "weight"] if p.weight_key != "mass_per_length" else []
        changes = {name: getattr(p, name) * factor for name in names}
    elif key in WEIGHT_KEYS:
        changes = {"mass": p.mass * factor, "weight": p.weight * factor}
    elif key in ("diameter", "ice"):
        given, ice = (p.bare or p).diameter, float(ice_thickness(p))
        scaled = {"diameter": given, "ice": ice} | {key: factor * (given if key == "diameter" else ice)}
        mass = p.mass
        if ice:  # a coat has the mass of its section
            growth = coat_section(scaled["ice"], scaled["diameter"]) / coat_section(ice, given)
            mass += mass_of_ice(p) * (growth - 1.0)
        diameter = scaled["diameter"] + 2.0 * scaled["ice"]
        changes = {"diameter": diameter, "mass": mass, "weight": p.weight * (mass / p.mass)}
    elif key == "ends" and p.inclination is None:
        changes = {"lower": p.lower * factor, "upper": p.upper * factor}
    elif key == "ends":
        changes = {"upper": p.lower + factor * (p.upper - p.lower)}
    elif key == "inclination":
        angle, chord = math.radians(factor * p.inclination), math.dist(p.lower, p.upper)
        upper = p.lower + chord * np.array([math.cos(angle), math.sin(angle)])
        changes = {"upper": upper, "inclination": factor * p.inclination}
    elif key == "motion":
        changes = {"motions": {name: _scaled_function(motion, factor) for name, motion in p.motions.items()}}
    else:
        name = {**dict.fromkeys(STIFFNESS_KEYS, "stiffness"), "gravity": "weight"}.get(key, key)
        name = name if name in ("stiffness", "weight", "load", "breaking_strength") else "length_value"
        changes = {name: getattr(p, name) * factor}
    if p.bare is not None:
        changes["bare"] = p.bare if key == "ice" else _scaled(p.bare, key, factor)
    return replace(p, **changes)


def _scaled_function(function: TimeFunction, factor: float) -> TimeFunction:
    """Return a time function times a factor."""
    names = ("amplitude", "coefficients", "value")
    scaled = {name: factor * np.asarray(function.values[name]) for name in names if name in function.values}
    return TimeFunction(function.kind, {**function.values, **scaled})


def _is_usual(p: Parameters) -> bool:
    """Tell whether a scene has an equilibrium and nothing unusual that another unit of a key of its cable may explain."""
    try:
        with np.errstate(all="ignore"):
            return not _notes_of_units(p)
    except (SceneError, ArithmeticError):
        return False


def _change(scaled: Parameters, key: str, factor: float, unit: str) -> tuple[str, str]:
    """Return key path and text of the change of a key."""
    given = f"given in {unit}?" if unit else f"{factor:g} times what was given"
    area = math.nan if scaled.area is None else scaled.area
    bare = scaled.bare or scaled  # without ice, as it is given
    values = {
        "area": area,
        "youngs_modulus": scaled.stiffness / area,
        "axial_stiffness": scaled.stiffness,
        "density": bare.mass / area,
        "mass_per_length": bare.mass,
        "specific_weight": math.hypot(*bare.weight) / area,
        "breaking_strength": scaled.breaking_strength,
        "diameter": bare.diameter,
        "gravity": math.hypot(*scaled.weight) / scaled.mass,
        "ice": float(ice_thickness(scaled)),
        "inclination": scaled.inclination,
    }
    if key == "ends" and scaled.inclination is not None:
        return "ends.chord", f"ends.chord = {math.dist(scaled.lower, scaled.upper):.6g} ({given})"
    vectors = {"ends": "ends.lower and ends.upper", "load": "load.uniform", "motion": "the displacements of motion"}
    if key in vectors:
        path = {"ends": "ends.upper", "load": "load.uniform", "motion": _largest_motion(scaled)[1]}[key]
        return path, f"{vectors[key]} times {factor:g} ({given})"
    of_tables = {"gravity": "gravity", "ice": "ice.thickness", "inclination": "ends.inclination"}
    path = of_tables.get(key, f"cable.{key}")
    return path, f"{path} = {values.get(key, scaled.length_value):.6g} ({given})"


def remedy(changes: list[tuple[str, str]]) -> str:
    """Return the end of a message, "; try: ...", with the changes of :func:`likely_keys`; empty without any."""
    return f"; try: {' or '.join(text for _, text in changes)}" if changes else ""
