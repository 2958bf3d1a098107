"""Parameters of a mast and its guys as plain numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import plain
from cablepod.parameters._from_scene import (
    SceneContent,
    damping_ratios,
    is_gap,
    refuse_missing,
    time_function,
)
from cablepod.parameters._guys import Guy, check_level, guys_of
from cablepod.parameters._ice import coat_section
from cablepod.parameters._keys import ICE
from cablepod.parameters._mast_keys import MAST, MAST_LOAD
from cablepod.parameters._parameters import output_times
from cablepod.parameters._scene_values import check_values, listed, tables_of, whole
from cablepod.parameters._temperature import expansion_of, temperatures_of
from cablepod.parameters._time_functions import TimeFunction
from cablepod.parameters._wind import turbulence_of, wind_of

#: Distance over the height up to which places of the mast share a node.  The stiffness of an element grows as the inverse cube of
#: its length: on a mast of 87 m and 1.6e9 N m2 rounding in elements of 3e-4 leaves 1e-6 of the forces, in those of 2e-5 no digit.
CLOSE = 3e-4
#: Quantities of a cross-section.
SECTION_KEYS = ("bending_stiffness", "mass", "drag_area")
#: Decimals of heights in m as labels, one less than those of the nodes of a beam.
LABEL_DIGITS = 8
#: Keys of [damping], and lists of [chain], that guys lack.
DAMPING_OF_CABLES = ("link_viscosity", "tension_proportional")
LISTS_OF_LINKS = ("link_lengths", "masses", "stiffness")


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
    bare: np.ndarray  #: the same without ice
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
        return output_times(self.duration, self.interval)

    def time_functions(self) -> dict[str, TimeFunction]:
        """Return the factors of the loads by the key paths of their tables."""
        return {load.key: load.factor for load in self.loads if load.factor is not None}

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
        return mast_of(_tables(scene))
    gusts = scene.drop_vars(list(calm.variables))
    p = _kept(SceneContent.of(calm))
    return replace(p, turbulence=turbulence_of(_tables(gusts), p.wind))


def _tables(scene: xr.Dataset) -> dict[str, Any]:
    """Return the tables of a scene, their values checked."""
    variables = scene.variables.items()
    values = {str(name): variable.values[()] for name, variable in variables if not is_gap(variable.values)}
    check_values(values, {})
    return tables_of(values)


def mast_of(tables: Mapping[str, Any]) -> MastParameters:
    """Make the parameters of a mast from the tables of its scene.

    Raises
    ------
    SceneError
        For keys that are missing or do not go together, and for guys that no mast can have; the message names the key.
    """
    refuse_missing("", tables, ("gravity",))
    table = whole("mast", tables["mast"], MAST)
    damping, chain, time = (tables.get(name, {}) for name in ("damping", "chain", "time"))
    for name in DAMPING_OF_CABLES:
        if name in damping:
            allowed = "none for guys of a mast; try: damping.mass_proportional"
            raise scene_error(f"damping.{name}", damping[name], allowed)
    for name in LISTS_OF_LINKS:
        if name in chain:
            raise scene_error(f"chain.{name}", plain(chain[name]), "chain.links, equal links")
    ratios, wind = damping_ratios(damping), wind_of(tables)
    expansion = expansion_of(tables, table, "mast") or 1.0
    ice, scales = whole("ice", tables.get("ice", {}), ICE), [expansion, expansion, 1.0, 1.0, 1.0]
    loads = tuple(_loads(tables["mast"], float(table["height"]), expansion))
    return MastParameters(
        height=float(table["height"]) * expansion,
        base=str(table["base"]),
        gravity=float(tables["gravity"]),
        damping_ratio=float(table["damping_ratio"]),
        elements=int(table["elements"]),
        modes=int(table["modes"]),
        sections=_sections(tables, table, ice, expansion) * scales,
        bare=_sections(tables, table, {}, expansion) * scales,
        guys=tuple(guys_of(tables, expansion)),
        loads=loads,
        duration=float(time["duration"]) if "duration" in time else None,
        interval=float(time["interval"]) if "interval" in time else None,
        mass_damping=float(damping.get("mass_proportional", 0.0)),
        guy_damping_ratios=ratios,
        wind=wind,
        turbulence=turbulence_of(tables, wind),
        expansion=expansion,
        temperatures=temperatures_of(tables),
    )


def _loads(mast: Mapping[str, Any], height: float, expansion: float) -> Iterator[MastLoad]:
    """Yield the forces on the mast, of a `height` [m] at the reference temperature."""
    for path, table in listed(mast, "load", "mast."):
        refuse_missing(path, table, MAST_LOAD)
        check_level(f"{path}.level", table["level"], height)
        force = np.asarray(table["force"], dtype=float)
        if force[1] != 0.0:
            raise scene_error(f"{path}.force", plain(force), "three numbers [N], the vertical one, y, 0")
        factor = time_function(table, path, keeps_start=True)
        yield MastLoad(path, float(table["level"]) * expansion, force, factor)


def _sections(
    tables: Mapping[str, Any], table: Mapping[str, Any], ice: Mapping[str, Any], expansion: float
) -> np.ndarray:
    """Return the sections of the mast from below, see :class:`MastParameters`; heights as the scene gives them."""
    height, given = float(table["height"]), list[list[float]]()
    for path, own in listed(tables["mast"], "section", "mast."):
        refuse_missing(path, own, ("from", "to"))
        low, high = float(own["from"]), float(own["to"])
        if not low < high <= height:
            allowed = f"a height above {path}.from, {low:g} m, and at most mast.height, {height:g} m"
            raise scene_error(f"{path}.to", high, allowed)
        if not high - low > CLOSE * height:  # which no element would have
            raise scene_error(f"{path}.to", high, f"more than {CLOSE:g} of mast.height above {path}.from, {low:g} m")
        for number, (bottom, top, *_) in enumerate(given, start=1):
            if low < top and bottom < high:
                allowed = f"sections that do not overlap (mast.section.{number} does)"
                raise scene_error(f"{path}.from", low, allowed)
        given.append([low, high, *_section({**table, **own}, ice, expansion)])
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
    mass += float(table.get("member_length", 1.0)) * float(ice["density"]) * coat_section(thickness, diameter)
    return [stiffness, mass, drag_area * (1.0 + 2.0 * thickness / diameter)]
