"""Notes on what is unusual in the tables of a scene beside its cable: wind, ice, damping, phases, temperatures, gravity."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from cablepod.parameters._ice import coat_section, ice_thickness, mass_of_ice
from cablepod.parameters._key_paths import listed_path, motion_path
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._temperature import TEMPERATURES
from cablepod.parameters._time_functions import TimeFunction
from cablepod.scene._note import Note, outside

#: Maximum usual temperature [degC], of conductors, and difference from that of reference [K]; kelvins are beyond both.
HIGHEST_TEMPERATURE, LARGEST_DIFFERENCE, ZERO_CELSIUS = 150.0, 100.0, 273.15
#: Maximum usual mean wind speed [m/s]: above that of the strongest hurricanes at 10 m, as most speeds in km/h are.
HIGHEST_SPEED, KILOMETRES_AN_HOUR = 60.0, 3.6
#: Usual density of air [kg/m3]: at a height of 8 km, and at -70 degC with a margin.
AIR_DENSITY = (0.5, 2.0)
#: Usual density of ice [kg/m3]: fresh snow, above glaze (917).
ICE_DENSITY = (100.0, 1000.0)
#: Maximum usual drag coefficient, and damping ratio; percents are beyond it.
LARGEST_DRAG_COEFFICIENT, LARGEST_DAMPING_RATIO = 3.0, 0.1
IN_PERCENT = "given in %?"


def notes_of_tables(p: Parameters) -> Iterator[Note]:
    """Yield the notes on the tables of a scene beside its cable."""
    yield from notes_of_temperatures(p.temperatures)
    yield from notes_of_gravity(math.hypot(*p.weight) / p.mass)
    yield from notes_of_wind(p.wind, p.duration)
    yield from notes_of_damping(p.damping_ratios, has_list=p.has_list_of_ratios)
    yield from outside(
        "cable.drag_coefficient", "a drag coefficient", p.drag_coefficient, (0.0, LARGEST_DRAG_COEFFICIENT), ""
    )
    if p.bare is not None and (thickness := ice_thickness(p)):
        density = mass_of_ice(p) / coat_section(thickness, p.bare.diameter)
        yield from outside("ice.density", "a density of the ice", density, ICE_DENSITY, "kg/m3")
    functions = {motion_path(*key): motion for key, motion in p.motions.items()}
    loads = {"load": p.load_factor} | {
        listed_path("point_load", number): load.factor for number, load in enumerate(p.point_loads, 1)
    }
    for path, function in (functions | loads).items():
        yield from notes_of_phase(path, function)


def notes_of_gravity(gravity: float) -> Iterator[Note]:
    """Yield the note of a scene without gravity [m/s2]."""
    if gravity == 0.0:
        yield Note("gravity", "a gravitational acceleration of 0: it has no weight", 0.0)


def notes_of_wind(wind: Mapping[str, Any] | None, duration: float | None) -> Iterator[Note]:
    """Yield the notes on the table [wind] of a run of a duration [s]."""
    if wind is None:
        return
    speed, ramp = float(wind["speed"]), float(wind["ramp"])
    asked = f"given in km/h? {speed:g} km/h are {speed / KILOMETRES_AN_HOUR:.4g} m/s"
    yield from outside("wind.speed", "a mean wind speed", speed, (0.0, HIGHEST_SPEED), "m/s", asked)
    yield from outside("wind.air_density", "a density of the air", float(wind["air_density"]), AIR_DENSITY, "kg/m3")
    if duration is not None and ramp > duration:
        text = f"a ramp of {ramp:g} s, longer than the run of {duration:g} s, which does not reach the full wind"
        yield Note("wind.ramp", text, math.log10(ramp / duration))


def notes_of_damping(ratios: tuple[float, ...] | None, *, has_list: bool = False) -> Iterator[Note]:
    """Yield the note of the largest damping ratio; `has_list` tells whether the scene gives a list."""
    key = "damping.ratios" if has_list else "damping.ratio"
    yield from outside(key, "a damping ratio", max(ratios or (0.0,)), (0.0, LARGEST_DAMPING_RATIO), "", IN_PERCENT)


def notes_of_phase(path: str, function: TimeFunction | None) -> Iterator[Note]:
    """Yield the note of a phase [rad] of a time function that is likely in degrees."""
    phase = 0.0 if function is None else float(function.values.get("phase", 0.0))
    if abs(phase) > 2.0 * math.pi * (1.0 + 1e-3):  # rounded by hand
        asked = f"usual: up to 2 pi; given in degrees? {phase:g} degrees are {math.radians(phase):.4g} rad"
        yield Note(f"{path}.phase", f"a phase of {phase:g} rad ({asked})", math.log10(abs(phase) / (2.0 * math.pi)))


def notes_of_temperatures(temperatures: tuple[float, float] | None) -> Iterator[Note]:
    """Yield the note of a temperature or reference temperature [degC] that is likely in kelvins, or far from the other."""
    if temperatures is None:
        return
    given, reference = temperatures
    for key, value in zip(TEMPERATURES, temperatures, strict=True):
        if value > HIGHEST_TEMPERATURE:
            usual = (
                f"usual: up to {HIGHEST_TEMPERATURE:g} degC; kelvins? {value:g} K are {value - ZERO_CELSIUS:.6g} degC"
            )
            yield Note(key, f"a temperature of {value:g} degC ({usual})", math.log10(value / HIGHEST_TEMPERATURE))
            return
    difference = abs(given - reference)
    if difference > LARGEST_DIFFERENCE:
        what = f"a temperature of {given:g} degC, {difference:g} K from the reference temperature of {reference:g} degC"
        usual = f"usual: up to {LARGEST_DIFFERENCE:g} K; is one of them in another unit, kelvins?"
        yield Note("temperature", f"{what} ({usual})", math.log10(difference / LARGEST_DIFFERENCE))
