"""Guys of a mast as plain numbers: a cable from each anchor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cablepod.errors import SceneError, did_you_mean, scene_error
from cablepod.parameters._checks import plain
from cablepod.parameters._from_scene import Paths, cable_of, refuse_missing
from cablepod.parameters._given import cross_section
from cablepod.parameters._keys import exactly_one
from cablepod.parameters._mast_keys import GUY, GUY_CABLE, GUY_LENGTH_KEYS, GUY_LISTED
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._scene_values import listed, of_keys
from cablepod.parameters._temperature import TEMPERATURES

#: Number of links of a guy without [chain].
LINKS = 40
#: Distance from the axis below which an anchor lies on it, over the height.
ON_AXIS = 1e-9


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


def guys_of(tables: Mapping[str, Any], expansion: float) -> list[Guy]:
    """Return single guys, table by table and round the mast from the first direction.

    Their tensions hold where the mast ends at the reference temperature; their levels rise with it by `expansion`.

    Raises
    ------
    SceneError
        For anchors and levels that no guy can have, and for cables without a guy that are none, or have tables of lists.
    """
    guys: list[Guy] = []
    height, cables = float(tables["mast"]["height"]), tables.get("cables", {})
    places: dict[tuple[float, ...], str] = {}
    for number, (path, table) in enumerate(listed(tables, "guy"), start=1):
        refuse_missing(path, table, ("cable", "level"))
        exactly_one(path, table, GUY_LENGTH_KEYS)
        name, level = str(table["cable"]), float(table["level"])
        if name not in cables:
            known = ", ".join(cables) or "none is there; add a table [cables.NAME]"
            raise scene_error(f"{path}.cable", name, f"the name of a cable: {known}{did_you_mean(name, cables)}")
        check_level(f"{path}.level", level, height)
        _check_anchors(path, table, height)
        anchors = anchors_of(table)
        for anchor in anchors:
            place = (level, *(round(float(value), 9) for value in anchor))
            if place in places:
                allowed = f"another level or anchor than that of {places[place]}: two guys cannot take the same place"
                raise scene_error(f"{path}.level", level, allowed)
            places[place] = path
        breaks: list[float | None] = [None] * len(anchors)
        if (broken := _broken_guy(path, table)) is not None:
            breaks[broken] = float(table["breaks"])
        at_anchors, thing = _at_anchors(tables, path, table, anchors)
        if expansion != 1.0:
            level *= expansion
            top = np.array([0.0, level, 0.0])
            at_anchors = [replace(p, upper=top, bare=p.bare or p) for p in at_anchors]
        guys += [Guy(path, number, name, level, p, time, thing) for p, time in zip(at_anchors, breaks, strict=True)]
    if not guys and str(tables["mast"]["base"]) == "pinned":
        raise scene_error("guy", [], 'at least one [[guy]], or mast.base "clamped": a pinned mast does not stand alone')
    used = {guy.name for guy in guys}
    for name, cable in cables.items():
        if name not in used:
            _check_unused(f"cables.{name}", cable, float(tables["gravity"]))
    return guys


def _at_anchors(
    tables: Mapping[str, Any], path: str, guy: Mapping[str, Any], anchors: np.ndarray
) -> tuple[list[Parameters], str | None]:
    """Return the cable of a table [[guy]] from each of its anchors, and the key path of its first segment or attachment."""
    name = str(guy["cable"])
    cable, upper = tables["cables"][name], np.array([0.0, float(guy["level"]), 0.0])
    lists = of_keys(cable, GUY_LISTED)
    own = {
        **of_keys(tables, ("gravity", *TEMPERATURES, "time", "damping", "wind", "ice")),
        **lists,
        "chain": {"links": LINKS, **tables.get("chain", {})},
        "cable": {**of_keys(cable, GUY_CABLE), **of_keys(guy, GUY_LENGTH_KEYS)},
    }
    key = f"{path}.{'anchor' if 'anchor' in guy else 'radius'}"
    paths = Paths(f"cables.{name}", path, key, f"cables.{name}.", GUY_LENGTH_KEYS)
    first, *others = anchors
    found = [cable_of({**own, "ends": {"lower": first, "upper": upper}}, paths=paths)]
    if found[0].attachments:  # what is normal to the chord differs from guy to guy
        found += [cable_of({**own, "ends": {"lower": anchor, "upper": upper}}, paths=paths) for anchor in others]
    else:
        found += [_anchored(found[0], anchor) for anchor in others]
    return found, next((f"cables.{name}.{of_list}.1" for of_list in lists), None)


def check_level(key: str, level: float, height: float) -> None:
    if level > height:
        raise scene_error(key, level, f"a height of at most mast.height, {height:g} m")


def _check_unused(path: str, cable: Mapping[str, Any], gravity: float) -> None:
    """Refuse the table of a cable that no guy has if it is none, or if it has segments and attachments."""
    cross_section(cable, gravity, prefix=path)
    for name in GUY_LISTED:
        if name in cable:
            raise SceneError(f"{path}.{name}.1: given for a cable that no guy has; allowed: none; try: guy.1.cable")


def _check_anchors(path: str, guy: Mapping[str, Any], height: float) -> None:
    """Refuse anchors that are given in two ways or in none, and places where no anchor is."""
    if "anchor" in guy:
        for name in ("radius", "count", "direction"):
            if name in guy:
                raise scene_error(f"{path}.{name}", plain(guy[name]), f"none beside {path}.anchor, which is one guy")
        anchor = plain(guy["anchor"])
        if anchor[1] > guy["level"]:
            allowed = f"an anchor at most as high as {path}.level, {guy['level']:g} m"
            raise scene_error(f"{path}.anchor", anchor, allowed)
        if math.hypot(anchor[0], anchor[2]) <= ON_AXIS * height and anchor[1] > 0.0:
            raise scene_error(f"{path}.anchor", anchor, "an anchor beside the mast, or at its foot or below")
        return
    for name in ("radius", "direction"):
        if name not in guy:
            raise SceneError(f"{path}.{name}: missing; allowed: {GUY[name].long_name}, or {path}.anchor")
    direction = plain(guy["direction"])
    if direction[1] != 0.0 or not any(direction):
        allowed = "three numbers, a horizontal direction with 0 for y"
        raise scene_error(f"{path}.direction", direction, allowed)


def _broken_guy(prefix: str, table: Mapping[str, Any]) -> int | None:
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
