"""Parameters of a mast and its guys as plain numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._from_scene import (
    SceneContent,
    _check_present,
    _damping_ratios,
    _from_values,
    _is_gap,
    _time_function,
    ice_mass,
)
from cablepod.parameters._key_paths import table_at, whole_table_at
from cablepod.parameters._keys import ICE, TABLES, TURBULENCE, WIND
from cablepod.parameters._mast_keys import (
    GUY,
    GUY_CABLE,
    GUY_LENGTH_KEYS,
    GUY_LISTED,
    MAST,
    MAST_LOAD,
    MAST_SECTION,
    SHARED_TABLES,
)
from cablepod.parameters._parameters import Parameters, count_instants
from cablepod.parameters._scene_values import check_values
from cablepod.parameters._temperature import TEMPERATURES, expansion_of, temperatures_of
from cablepod.parameters._time_functions import TimeFunction

#: Quantities of a cross-section.
SECTION_KEYS = ("bending_stiffness", "mass", "drag_area")
#: Number of links of a guy without [chain].
LINKS = 40
#: Decimals of heights in m as labels, one less than those of the nodes of a beam.
LABEL_DIGITS = 8


@dataclass(frozen=True, eq=False)
class Guy:
    """One guy: a cable from its anchor to the axis of the straight mast."""

    key: str  #: key path of its table
    table: int  #: number of its table, from 1
    name: str  #: of its cable
    level: float  #: height of its upper end [m]
    p: Parameters  #: as of a scene of this cable alone
    breaks: float | None  #: time at which it breaks [s]
    #: key path of the first segment or attachment that the scene gives its cable, if only one without effect; None without
    thing: str | None = None


@dataclass(frozen=True, eq=False)
class MastLoad:
    """Horizontal force on the mast."""

    key: str  #: key path of its table
    level: float  #: [m]
    force: np.ndarray  #: (3,) [N]
    factor: TimeFunction | None  #: factor of time [1]


@dataclass(frozen=True, eq=False)
class MastParameters:
    """Parameters of a mast in SI units; its foot is at the origin and y points up.

    Heights are those at the temperature of the scene, see :attr:`expansion`.
    """

    height: float  #: [m]
    base: str  #: "pinned" or "clamped"
    gravity: float  #: [m/s2]
    damping_ratio: float
    elements: int
    modes: int  #: in each direction
    sections: np.ndarray  #: bottom, top [m], EI [N m2], mass [kg/m], drag area [m] (sections, 5), from below
    guys: tuple[Guy, ...]
    loads: tuple[MastLoad, ...]
    duration: float | None  #: [s]
    interval: float | None  #: [s]
    mass_damping: float  #: of the guys [1/s]
    guy_damping_ratios: tuple[float, ...] | None  #: of the vibrations of each guy about rest
    wind: Mapping[str, Any] | None
    turbulence: Mapping[str, Any] | None
    expansion: float  #: heights over those of the scene, which hold at its reference temperature
    temperatures: tuple[float, float] | None  #: temperature and reference temperature [degC]; None without

    def given_heights(self, heights: np.ndarray) -> np.ndarray:
        """Return heights [m] as the scene gives them, which label results."""
        return heights if self.expansion == 1.0 else np.round(heights / self.expansion, LABEL_DIGITS)

    def times(self) -> np.ndarray:
        """Return the times of the output [s]: 0, interval, ... up to the duration."""
        if self.duration is None or self.interval is None:
            raise SceneError("time: missing; allowed: a table with duration and interval [s], or the argument times")
        return self.interval * np.arange(count_instants(self.duration, self.interval))

    def late_breaks(self, end_time: float) -> list[str]:
        """Return a text for each guy that does not break before the end of a run [s], after which nothing is computed."""
        return [
            f"{guy.key}.breaks: guy {number} breaks at {guy.breaks:g} s, not before the end of the run at {end_time:g} s"
            for number, guy in enumerate(self.guys, 1)
            if guy.breaks is not None and guy.breaks >= end_time
        ]

    @property
    def levels(self) -> np.ndarray:
        """Heights of the guys, each once, and of the top [m]."""
        return np.unique([*(guy.level for guy in self.guys), self.height])


def mast_parameters(scene: xr.Dataset) -> MastParameters:
    """Return the parameters of a mast; for the same values the same object.

    Raises
    ------
    SceneError
        If `scene` has the dimension ``member``.
    """
    if "member" in scene.dims:
        raise SceneError("scene: given several members; allowed: one, scene.isel(member=0)")
    return _kept(SceneContent.of(scene))


def calm_parameters(scene: xr.Dataset) -> MastParameters:
    """Return the parameters of a mast without its turbulence: the same object for all storms of a mean wind."""
    return mast_parameters(_without_turbulence(scene))


def _without_turbulence(scene: xr.Dataset) -> xr.Dataset:
    return scene.drop_vars([name for name in scene.variables if str(name).startswith("wind_turbulence_")])


@lru_cache(16)
def _kept(content: SceneContent) -> MastParameters:
    scene, calm = content.scene, _without_turbulence(content.scene)
    if len(calm.variables) == len(scene.variables):
        return mast_from_values(_checked(scene))
    gusts = scene.drop_vars(list(calm.variables))
    return replace(_kept(SceneContent.of(calm)), turbulence=_turbulence(_checked(gusts)))


def _checked(scene: xr.Dataset) -> dict[str, Any]:
    """Return the values of scene variables by name, checked."""
    variables = scene.variables.items()
    values = {str(name): variable.values[()] for name, variable in variables if not _is_gap(variable.values)}
    check_values(values, {})
    return values


def _turbulence(values: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the table [wind.turbulence]."""
    return whole_table_at(values, "wind.turbulence", TURBULENCE, also=("decay",), unless="record") or None


def mast_from_values(values: Mapping[str, Any]) -> MastParameters:
    """Make the parameters of a mast from the values of scene variables by name.

    Raises
    ------
    SceneError
        For a table that lacks keys.
    """
    try:
        found = _mast_from_values(values)
    except KeyError as error:
        raise SceneError(
            f"scene: given a mast without the key {error.args[0]}; allowed: all that make_scene gives"
        ) from error
    for guy in found.guys:
        if found.wind is not None and guy.p.diameter is None:
            raise SceneError(f"cables.{guy.name}.diameter: missing; allowed: a diameter [m], on which the wind acts")
    return found


def _mast_from_values(values: Mapping[str, Any]) -> MastParameters:
    """Make the parameters of a mast; raises KeyError for missing keys."""
    table = table_at(values, "mast", MAST)
    expansion = expansion_of(values, table, "mast") or 1.0
    time = table_at(values, "time", TABLES["time"])
    damping = table_at(values, "damping", TABLES["damping"])
    loads, number = [], 1
    while "level" in (load := table_at(values, path := f"mast.load.{number}", MAST_LOAD)):
        factor = _time_function(values, path, keeps_start=True)
        loads.append(MastLoad(path, float(load["level"]) * expansion, np.asarray(load["force"], dtype=float), factor))
        number += 1
    if load:
        _check_present(path, load, ("level",))
    return MastParameters(
        height=float(table["height"]) * expansion,
        base=str(table["base"]),
        gravity=float(values["gravity"]),
        damping_ratio=float(table["damping_ratio"]),
        elements=int(table["elements"]),
        modes=int(table["modes"]),
        sections=_sections(values, table, expansion) * [expansion, expansion, 1.0, 1.0, 1.0],
        guys=tuple(_guys(values, expansion)),
        loads=tuple(loads),
        duration=float(time["duration"]) if "duration" in time else None,
        interval=float(time["interval"]) if "interval" in time else None,
        mass_damping=float(damping.get("mass_proportional", 0.0)),
        guy_damping_ratios=_damping_ratios(damping),
        wind=whole_table_at(values, "wind", WIND) or None,
        turbulence=_turbulence(values),
        expansion=expansion,
        temperatures=temperatures_of(values),
    )


def _sections(values: Mapping[str, Any], table: Mapping[str, Any], expansion: float) -> np.ndarray:
    """Return the sections of the mast from below, see :class:`MastParameters`; heights as the scene gives them."""
    height, given, number = float(table["height"]), [], 1
    ice = whole_table_at(values, "ice", ICE)
    while "to" in (section := table_at(values, f"mast.section.{number}", MAST_SECTION)):
        given.append([float(section["from"]), float(section["to"]), *_section({**table, **section}, ice, expansion)])
        number += 1
    if section:
        _check_present(f"mast.section.{number}", section, ("to",))
    rows, bottom = [], 0.0
    for row in sorted(given):
        if row[0] > bottom:
            rows.append([bottom, row[0], *_section(table, ice, expansion)])
        rows.append(row)
        bottom = row[1]
    if bottom < height:
        rows.append([bottom, height, *_section(table, ice, expansion)])
    return np.array(rows)


def _section(table: Mapping[str, Any], ice: Mapping[str, Any], expansion: float) -> list[float]:
    """Return bending stiffness, mass and drag area of a cross-section with its ice, which widens all members alike.

    The mast keeps its mass as it expands; the ice grows on it at its temperature.

    Raises
    ------
    SceneError
        For ice on a mast without a diameter.
    """
    stiffness, mass, drag_area = (float(table[name]) for name in SECTION_KEYS)
    mass, thickness = mass / expansion, float(ice.get("thickness", 0.0))
    if not thickness:
        return [stiffness, mass, drag_area]
    if "diameter" not in table:
        raise SceneError(
            "mast.diameter: missing; allowed: a diameter [m] of the mast, or of the members of its lattice, on which ice grows"
        )
    diameter = float(table["diameter"])
    mass += float(table.get("member_length", 1.0)) * ice_mass(float(ice["density"]), thickness, diameter)
    return [stiffness, mass, drag_area * (1.0 + 2.0 * thickness / diameter)]


def _guys(values: Mapping[str, Any], expansion: float) -> list[Guy]:
    """Return single guys, table by table and round the mast from the first direction.

    Their tensions hold where the mast ends at the reference temperature; their levels rise with it by `expansion`.
    """
    guys, number = [], 1
    while "level" in (table := table_at(values, path := f"guy.{number}", GUY)):
        cable, level = str(table["cable"]), float(table["level"])
        of_cable = table_at(values, f"cables.{cable}", GUY_CABLE)
        tension = {name: table[name] for name in GUY_LENGTH_KEYS if name in table}
        shared = {
            name: value
            for name, value in values.items()
            if name.startswith(tuple(f"{shared.replace('.', '_')}_" for shared in SHARED_TABLES))
            or name in ("gravity", *TEMPERATURES)
        }
        expansion_of(values, of_cable, f"cables.{cable}")
        anchors = anchors_of(table)
        breaks: list[float | None] = [None] * len(anchors)
        if (broken := broken_guy(path, table)) is not None:
            breaks[broken] = float(table["breaks"])
        things = _things(values, cable)
        thing = next((f"cables.{cable}.{name.split('_')[0]}.1" for name in things), None)
        own = {f"cable_{name}": value for name, value in {**of_cable, **tension}.items()} | things
        common, above = {"chain_links": LINKS, **shared, **own}, f"cables.{cable}."
        ends = {"ends_lower": anchors[0], "ends_upper": np.array([0.0, level, 0.0])}
        of_anchors = [_from_values({**common, **ends}, above=above)]
        if of_anchors[0].attachments:  # what is normal to the chord differs from guy to guy
            others = ({**common, **ends, "ends_lower": anchor} for anchor in anchors[1:])
            of_anchors += [_from_values(of_guy, above=above) for of_guy in others]
        else:
            of_anchors += [_anchored(of_anchors[0], anchor) for anchor in anchors[1:]]
        if expansion != 1.0:
            level *= expansion
            upper = np.array([0.0, level, 0.0])
            of_anchors = [replace(p, upper=upper, bare=p.bare or p) for p in of_anchors]
        guys += [Guy(path, number, cable, level, p, time, thing) for p, time in zip(of_anchors, breaks, strict=True)]
        number += 1
    if table:
        _check_present(path, table, ("level",))
    return guys


def _things(values: Mapping[str, Any], cable: str) -> dict[str, Any]:
    """Return the values of the segments and attachments of a cable by the names that a scene of this cable alone has."""
    above = f"cables_{cable}_"
    own = re.compile(rf"{above}({'|'.join(GUY_LISTED)})_\d+_\w+")
    return {name.removeprefix(above): value for name, value in values.items() if own.fullmatch(name)}


def broken_guy(prefix: str, table: Mapping[str, Any]) -> int | None:
    """Return which guy of a table [[guy]] breaks, from 0; None for none.

    Raises
    ------
    SceneError
        Where the table does not say which of several guys breaks.
    """
    count, key = int(table.get("count", 1)), f"{prefix}.breaks_number"
    number = int(table.get("breaks_number", 1))
    if "breaks" not in table:
        if "breaks_number" in table:
            raise scene_error(key, number, f"none without {prefix}.breaks, the time [s]")
        return None
    if count > 1 and "breaks_number" not in table:
        raise SceneError(f"{key}: missing; allowed: 1 to {count}, the guy of the table that breaks")
    if number > count:
        raise scene_error(key, number, f"1 to {count}, the guys of the table")
    return number - 1


def _anchored(p: Parameters, anchor: np.ndarray) -> Parameters:
    """Return the parameters of a guy with another anchor [m]."""
    bare = None if p.bare is None else replace(p.bare, lower=anchor)
    return replace(p, lower=anchor, bare=bare)


def anchors_of(table: Mapping[str, Any]) -> np.ndarray:
    """Return the anchors of a table [[guy]] (guys, 3) [m]."""
    if "anchor" in table:
        return np.array([table["anchor"]], dtype=float)
    count = int(table.get("count", 1))
    x, _, z = (float(component) for component in table["direction"])
    angle = np.arctan2(z, x) + 2.0 * np.pi * np.arange(count) / count
    # sine and cosine of quarter turns are exact, so that guys opposite to each other are
    unit = np.round(np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=1), 15)
    return float(table["radius"]) * unit + 0.0
