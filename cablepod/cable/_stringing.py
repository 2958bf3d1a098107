"""Stringing tables: tension, sag and frequencies of one cable over temperature, with ice and in the mean wind.

The public name is ``cablepod.catenary.stringing``; the file stands here for the vibrations and the rest in wind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from cablepod import provenance
from cablepod._inputs import SCENE, numbers_in, taken
from cablepod.cable._frequencies import converged_vibrations
from cablepod.cable._summary import largest_tensions, largest_utilisation, rest_in_wind
from cablepod.catenary._statics import load_plane, sag_of_scene, solve_statics
from cablepod.conventions import STILL_AIR, label
from cablepod.errors import SceneError, UnusualSceneWarning, named, scene_error, warn
from cablepod.parameters._check_tables import check_table
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._keys import ICE, TOP
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._particles import refuse_own
from cablepod.parameters._temperature import REFERENCE
from cablepod.scene._limits import check_numbers
from cablepod.scene._notes import worst_first
from cablepod.scene._ranges import HERE
from cablepod.scene._table_notes import notes_of_temperatures
from cablepod.scene._varied import completed
from cablepod.scene._wind import check_wind
from cablepod.wind._profile import air_at_rest

#: Number of frequencies.
FREQUENCIES = 3
#: Tables that a case may have.
CASE = ("ice", "wind")
#: Name -> (units, long name).
NUMBERS = {
    "tension_lower": ("N", "tension at the lower end"),
    "tension_upper": ("N", "tension at the upper end"),
    "horizontal_force": ("N", "component of the tension normal to the total load"),
    "sag": ("m", "largest distance of the cable below the chord, along the total load"),
    "unstretched_length": ("m", "unstretched length of the cable"),
    "utilisation": ("1", "largest tension over the breaking strength"),
    "angular_frequency": ("rad s-1", "angular frequency of small vibrations about rest"),
    "frequency": ("Hz", "frequency of small vibrations about rest"),
}


def stringing(
    scene: xr.Dataset, temperatures: ArrayLike, *, cases: Mapping[str, Mapping[str, Any]] | None = None
) -> xr.Dataset:
    """Tabulate tension, sag and first frequencies of a cable over temperature, with ice and in the mean wind.

    Parameters
    ----------
    scene
        A scene of one cable with ``cable.thermal_expansion``, both ends held.  What it gives for the length holds at its
        reference temperature, without ice and wind; its own temperature is left aside.
    temperatures
        Different temperatures [degC].
    cases
        Name -> tables ``ice`` and ``wind`` with the keys of the scene file, in place of those of the scene: a case without a
        table is without ice, or in still air.  By default the ice and wind of the scene.

    Returns
    -------
    xarray.Dataset
        Over ``temperature``, with `cases` over ``case`` too: ``tension_lower``, ``tension_upper``, ``horizontal_force`` [N],
        ``sag`` [m], ``unstretched_length`` [m], ``angular_frequency`` [rad/s] and ``frequency`` [Hz] over ``mode`` too, nan for
        a cable that is not taut, and with a breaking strength ``utilisation``.

    Raises
    ------
    SceneError
        For a scene without thermal expansion, with members, a free end or point loads, temperatures that are no different
        numbers, cases that are no such tables, and a cable without rest.

    Warns
    -----
    UnusualSceneWarning
        For a temperature that is likely in kelvins, or far from that of reference.

    Notes
    -----
    Rest in still air is the exact elastic catenary, see :func:`rest`.  In wind it is that of :func:`cablepod.cable.rest` in the
    mean wind at full speed (``wind.ramp`` belongs to runs), by the linear law; force and sag are then across and along the sum
    of load and drag.  The frequencies are those of :func:`cablepod.cable.frequencies` by the linear law: in the plane of a planar
    scene, all of a spatial one.

    Examples
    --------
    >>> import cablepod as cp
    >>> cable = {"axial_stiffness": 2e7, "mass_per_length": 1.0, "top_tension": 15000.0, "thermal_expansion": 1.15e-5}
    >>> scene = cp.make_scene({"cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [20.0, 50.0]}})
    >>> table = cp.catenary.stringing(scene, [-20.0, 20.0])
    >>> table.tension_upper.values.round().tolist(), table.sag.values.round(3).tolist()
    ([24120.0, 15000.0], [0.149, 0.241])
    """
    scene = taken("scene", scene, SCENE)
    p = parameters(scene)
    refuse_own(p, "chain.rest")
    if p.free_end is not None:
        raise scene_error("ends.free", p.free_end, "ends that are held, between which the cable is at rest")
    if p.point_loads:
        raise scene_error(
            p.point_loads[0].key, "a point load", "none; chain.rest has them, at the temperature of a scene"
        )
    values = _temperatures(temperatures)
    _warn_of_unusual(values, p)
    chosen = [scene] if cases is None else [_of_case(scene, name, tables) for name, tables in _named(cases).items()]
    rows = [[_numbers(parameters(each.assign(temperature=value))) for value in values] for each in chosen]
    dims = (*(() if cases is None else ("case",)), "temperature")
    variables = {}
    for name in rows[0][0]:
        array = np.array([[row[name] for row in of_case] for of_case in rows])
        own = (*dims, "mode") if "frequency" in name else dims
        variables[name] = (own, array[0] if cases is None else array)
    coords: dict[str, Any] = {"temperature": values, "mode": np.arange(1, FREQUENCIES + 1)}
    if cases is not None:
        coords["case"] = list(map(str, cases))
    result = xr.Dataset(variables, coords=coords)
    others = {"temperature": (str(TOP["temperature"].units), "temperature of the cable")}
    others["mode"] = ("1", "number of the mode, from 1, by rising frequency")
    others |= {} if cases is None else {"case": ("1", "ice and wind")}
    label(result, **{name: text for name, text in NUMBERS.items() if name in result}, **others)
    airs = {_air(parameters(each.assign(temperature=values[0]))) for each in chosen}
    air = airs.pop() if len(airs) == 1 else "that of each case"
    result.attrs.update(title=f"{scene.attrs.get('title', 'scene')}: stringing", stage="stringing", air=air)
    record = {"temperatures": values, "cases": cases}
    return provenance.record(result, function="catenary.stringing", parameters=record, inputs=[scene])


def _temperatures(given: Any) -> list[float]:
    """Return temperatures [degC]: different numbers that a scene may have."""
    values = numbers_in("temperatures", given, "degC", "a finite number or a list of them [degC]").tolist()
    checked = [TOP["temperature"].check(f"temperatures[{k}]", value) for k, value in enumerate(values)]
    if len(set(checked)) < len(checked):
        raise scene_error("temperatures", given, "different temperatures [degC]")
    return checked


def _warn_of_unusual(temperatures: list[float], p: Parameters) -> None:
    """Warn of temperatures [degC] that are likely in kelvins, or far from that of reference."""
    reference = REFERENCE if p.temperatures is None else float(p.temperatures[1])
    notes = worst_first(note for value in temperatures for note in notes_of_temperatures((value, reference)))
    if notes:
        warn(f"temperatures: given {notes[0].text}; try: degrees Celsius", UnusualSceneWarning)


def _named(cases: Any) -> Mapping[str, Any]:
    """Return cases by name; refuse what is no mapping of tables."""
    if not isinstance(cases, Mapping) or not cases or not all(isinstance(name, str) and name for name in cases):
        raise scene_error("cases", cases, "a mapping from names to tables with ice and wind")
    return cases


def _of_case(scene: xr.Dataset, name: str, tables: Any) -> xr.Dataset:
    """Return the scene with the ice and wind of a case in place of its own."""
    key = f"cases.{named(name)}"
    if not isinstance(tables, Mapping):
        raise scene_error(key, tables, "a mapping with the tables ice and wind, or an empty one")
    for table in tables:
        if table not in CASE:
            raise SceneError(f"{key}.{named(table)}: unknown table; allowed: {', '.join(CASE)}")
    own = [variable for variable in scene.data_vars if str(variable).startswith(("ice_", "wind_"))]
    bare = scene.drop_vars(own)
    values: dict[str, Any] = {}
    try:
        if "ice" in tables:
            values |= {f"ice.{name}": value for name, value in check_table("ice", tables["ice"], ICE).items()}
        if "wind" in tables:
            wind = check_wind(tables["wind"], HERE)
            values |= {f"wind.turbulence.{name}": value for name, value in wind.pop("turbulence", {}).items()}
            values |= {f"wind.{name}": value for name, value in wind.items()}
        changed = completed(bare, values)
        parameters(changed)  # refuses keys that do not go together
    except SceneError as error:
        if str(error).startswith(CASE):
            error.args = (f"{key}.{error}",)
        raise
    return changed


def _air(p: Parameters) -> str:
    """Return in words in which air a cable is at rest, the wind at full speed."""
    return air_at_rest(p if p.wind is None else replace(p, wind={**p.wind, "ramp": 0.0}))


def _numbers(p: Parameters) -> dict[str, Any]:
    """Return the numbers of one cable by name."""
    check_numbers(p)
    p = p if p.wind is None else replace(p, wind={**p.wind, "ramp": 0.0})
    statics, plane = solve_statics(p, p.length_key, p.length_value), load_plane(p)
    length, _, force, middle, lower, upper = (float(number) for number in statics)
    sag = sag_of_scene(p, statics)
    found = {"tension_lower": lower, "tension_upper": upper, "horizontal_force": force, "sag": sag}
    if p.breaking_strength is not None:
        used = largest_utilisation(p, largest_tensions(p, max(lower, upper)))
    if air_at_rest(p) != STILL_AIR:
        rest = rest_in_wind(p, length, sag * float(plane.span / plane.chord))
        found = {name: rest[name if name != "sag" else "sag_below_chord"] for name in found}
        used = rest.get("utilisation", math.nan)
    found["unstretched_length"] = length
    if p.breaking_strength is not None:
        found["utilisation"] = used
    omega = np.full(FREQUENCIES, math.nan)
    if force > 0.0 or abs(middle) > 0.5 * plane.load * length:  # not folded along the load
        with suppress(SceneError):  # not taut
            omega = np.abs(converged_vibrations(p, FREQUENCIES, law="linear")[1])
    return {**found, "angular_frequency": omega, "frequency": omega / (2.0 * math.pi)}
