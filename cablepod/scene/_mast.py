"""Checks of a scene with a mast and its guys, and its Dataset."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import SCENE, Kind
from cablepod.catenary._statics import length_and_strain
from cablepod.errors import SceneError, did_you_mean, named, scene_error
from cablepod.parameters._keys import TABLES, TOP, check_damping, check_table, exactly_one
from cablepod.parameters._mast import MastParameters, anchors_of, broken_guy
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
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.scene._check import (
    check_attachments,
    check_cable,
    check_chain,
    check_ensemble,
    check_segments,
    check_time,
    check_with_factor,
)
from cablepod.scene._limits import MAX_STRAIN
from cablepod.scene._mast_notes import guy_hint
from cablepod.scene._strands import with_strand
from cablepod.scene._wind import check_wind

#: A scene with a mast, as an argument.
MAST_SCENE = Kind(
    "what make_scene gives for a mast and its guys",
    tuple((name, ()) for name in ("gravity", "mast_height", "mast_bending_stiffness", "mast_mass", "mast_base")),
    stages=("scene", "scenes"),
    further=("member",),
    is_scene=True,
    instead=("ends_lower", "cable: given a scene of one cable; allowed: one with [mast], [[guy]]; try: chain.simulate"),
)
#: Tables that only scenes with a mast have.
MAST_TABLES = ("mast", "cables", "guy")
ALLOWED = (*TOP, *MAST_TABLES, *(name for name in SHARED_TABLES if "." not in name), "ensemble")
#: Keys of [damping] that guys lack.
DAMPING_OF_CABLES = ("link_viscosity", "tension_proportional")
#: Keys of chains whose links or particles differ from each other.
LISTS_OF_LINKS = ("link_lengths", "masses", "stiffness")
#: Names that a cable cannot have: variables of its keys would be those of a segment or attachment of another cable.
TAKEN_NAMES = re.compile(rf"\w+_({'|'.join(GUY_LISTED)})_\d+")
#: Distance from the axis below which an anchor lies on it, over the height.
ON_AXIS = 1e-9


def scene_kind(given: Any) -> Kind:
    """Return the kind of a scene Dataset: of a mast, or of one cable."""
    return MAST_SCENE if isinstance(given, xr.Dataset) and "mast_height" in given.variables else SCENE


def is_mast(mapping: Any) -> bool:
    """Tell whether nested tables are those of a mast, and not of a cable with a mistake in a name."""
    return isinstance(mapping, Mapping) and ("mast" in mapping or ("guy" in mapping and "cable" not in mapping))


def check_mast(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check all tables of a scene with a mast; return them with defaults filled in.

    Raises
    ------
    SceneError
        For unknown and missing keys, values that are not allowed, and guys that no mast can have.
    """
    for name in mapping:
        if name not in ALLOWED:
            remedy = f"; try: cables.NAME.{name}" if name in GUY_LISTED else did_you_mean(name, ALLOWED)
            raise SceneError(f"{named(name)}: unknown key or table of a mast; allowed: {', '.join(ALLOWED)}{remedy}")
    if "mast" not in mapping:
        raise SceneError("mast: missing; allowed: a table with the keys " + ", ".join(MAST))
    tree = check_table("", {key: mapping[key] for key in mapping if key in TOP}, TOP)
    tree["mast"] = _check_mast_table(mapping["mast"], folder)
    for name in SHARED_TABLES:
        if name in mapping and not name.startswith("wind"):
            tree[name] = check_table(name, mapping[name], TABLES[name])
    for name in DAMPING_OF_CABLES:
        if name in tree.get("damping", {}):
            raise scene_error(
                f"damping.{name}", tree["damping"][name], "none for guys of a mast; try: damping.mass_proportional"
            )
    check_damping(tree.get("damping", {}))
    for name in LISTS_OF_LINKS:
        if name in tree.get("chain", {}):
            raise scene_error(f"chain.{name}", tree["chain"][name], "chain.links, equal links")
    check_chain(tree)
    check_time(tree)
    tree["cables"] = _check_cables(mapping.get("cables", {}), tree, folder)
    tree["guy"] = _check_guys(mapping.get("guy", []), tree)
    _check_used(tree)
    _check_air(mapping, tree, folder)
    if "ensemble" in mapping:
        tree["ensemble"] = check_ensemble(mapping["ensemble"], tree, folder)
    return tree


def _check_mast_table(table: Any, folder: Path) -> dict[str, Any]:
    """Check the table [mast] with its sections and loads."""
    if not isinstance(table, Mapping):
        raise scene_error("mast", table, "a table with the keys " + ", ".join(MAST))
    own, lists = _without_lists("mast", table, MAST, ("section", "load"))
    checked = check_table("mast", own, MAST)
    height = checked["height"]
    for name, value in lists.items():
        if not isinstance(value, list | tuple):
            raise scene_error(f"mast.{name}", value, f"an array of tables, [[mast.{name}]]")
    sections = [
        check_table(f"mast.section.{number}", section, MAST_SECTION)
        for number, section in enumerate(lists.get("section", []), start=1)
    ]
    for number, section in enumerate(sections, start=1):
        if not section["from"] < section["to"] <= height:
            allowed = f"a height above mast.section.{number}.from, {section['from']:g} m, and at most mast.height, {height:g} m"
            raise scene_error(f"mast.section.{number}.to", section["to"], allowed)
        for other, before in enumerate(sections[: number - 1], start=1):
            if section["from"] < before["to"] and before["from"] < section["to"]:
                raise scene_error(
                    f"mast.section.{number}.from",
                    section["from"],
                    f"sections that do not overlap (mast.section.{other} does)",
                )
    loads = []
    for number, load in enumerate(lists.get("load", []), start=1):
        prefix = f"mast.load.{number}"
        loads.append(check_with_factor(prefix, load, MAST_LOAD, folder))
        _check_level(f"{prefix}.level", loads[-1]["level"], height)
        force = loads[-1]["force"]
        if len(force) != 3 or force[1] != 0.0:
            raise scene_error(f"{prefix}.force", force, "three numbers [N], the vertical one, y, 0")
    return checked | ({"section": sections} if sections else {}) | ({"load": loads} if loads else {})


def _without_lists(
    prefix: str, table: Mapping[str, Any], keys: Mapping[str, Any], lists: Iterable[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the keys of a table, and the lists of tables in it; refuse all other names."""
    for name in table:
        if name not in keys and name not in lists:
            allowed, similar = ", ".join([*keys, *lists]), did_you_mean(name, [*keys, *lists], f"{prefix}.")
            raise SceneError(f"{prefix}.{named(name)}: unknown key; allowed: {allowed}{similar}")
    own = {name: value for name, value in table.items() if name not in lists}
    return own, {name: table[name] for name in lists if name in table}


def _check_level(key: str, level: float, height: float) -> None:
    if level > height:
        raise scene_error(key, level, f"a height of at most mast.height, {height:g} m")


def _check_cables(tables: Any, tree: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check the tables [cables.NAME]."""
    if not isinstance(tables, Mapping):
        raise scene_error("cables", tables, "tables [cables.NAME]")
    checked = {}
    for name, table in tables.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise SceneError(f"cables.{named(name)}: given another name; allowed: letters, digits and _")
        if TAKEN_NAMES.fullmatch(name):
            raise SceneError(
                f"cables.{name}: given the name of a table in a list; allowed: a name without _segment_1, _attachment_1"
            )
        prefix = f"cables.{name}"
        lists: dict[str, Any] = {}
        if isinstance(table, Mapping):
            for key in table:
                if key in GUY_LENGTH_KEYS:
                    raise SceneError(f"{prefix}.{key}: given beside [[guy]]; allowed: none; try: guy.1.{key}")
            table, lists = _without_lists(prefix, table, GUY_CABLE, GUY_LISTED)
        own = check_table(prefix, with_strand(table, folder, prefix), GUY_CABLE)
        of_cable = {"cable": own, "gravity": tree["gravity"]}
        check_cable(of_cable, prefix, ())
        if "segment" in lists:
            lengths = ("guy.1", GUY_LENGTH_KEYS)
            lists["segment"] = check_segments(lists["segment"], of_cable, folder, f"{prefix}.segment", lengths)
        if "attachment" in lists:
            lists["attachment"] = check_attachments(lists["attachment"], 3, f"{prefix}.attachment")
        checked[name] = own | lists
    return checked


def _check_used(tree: Mapping[str, Any]) -> None:
    """Refuse segments and attachments of a cable that no guy has."""
    used = {guy["cable"] for guy in tree["guy"]}
    for name, cable in tree["cables"].items():
        for table in GUY_LISTED:
            if cable.get(table) and name not in used:
                raise SceneError(
                    f"cables.{name}.{table}.1: given for a cable that no guy has; allowed: none; try: guy.1.cable"
                )


def _check_guys(tables: Any, tree: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Check the tables [[guy]]."""
    if not isinstance(tables, list | tuple):
        raise scene_error("guy", tables, "an array of tables, [[guy]]")
    height, checked = tree["mast"]["height"], []
    places: dict[tuple[float, ...], int] = {}
    for number, table in enumerate(tables, start=1):
        prefix = f"guy.{number}"
        guy = check_table(prefix, table, GUY)
        exactly_one(prefix, guy, GUY_LENGTH_KEYS)
        if guy["cable"] not in tree["cables"]:
            known = ", ".join(tree["cables"]) or "none is there; add a table [cables.NAME]"
            remedy = did_you_mean(guy["cable"], tree["cables"])
            raise scene_error(f"{prefix}.cable", guy["cable"], f"the name of a cable: {known}{remedy}")
        _check_level(f"{prefix}.level", guy["level"], height)
        _check_anchors(prefix, guy, height)
        for anchor in anchors_of(guy):
            place = (guy["level"], *(round(float(value), 9) for value in anchor))
            if place in places:
                raise scene_error(
                    f"{prefix}.level", guy["level"],
                    f"another level or anchor than that of guy.{places[place]}: two guys cannot take the same place",
                )  # fmt: skip
            places[place] = number
        broken_guy(prefix, guy)
        checked.append(guy)
    if not checked and tree["mast"]["base"] == "pinned":
        raise scene_error("guy", [], 'at least one [[guy]], or mast.base "clamped": a pinned mast does not stand alone')
    return checked


def _check_anchors(prefix: str, guy: dict[str, Any], height: float) -> None:
    """Check how the anchors of a table are given, and where they are."""
    if "anchor" in guy:
        for name in ("radius", "count", "direction"):
            if name in guy:
                raise scene_error(f"{prefix}.{name}", guy[name], f"none beside {prefix}.anchor, which is one guy")
        anchor = guy["anchor"]
        if len(anchor) != 3:
            raise scene_error(f"{prefix}.anchor", anchor, "three numbers [m]")
        if anchor[1] > guy["level"]:
            raise scene_error(
                f"{prefix}.anchor", anchor, f"an anchor at most as high as {prefix}.level, {guy['level']:g} m"
            )
        if math.hypot(anchor[0], anchor[2]) <= ON_AXIS * height and anchor[1] > 0.0:
            raise scene_error(f"{prefix}.anchor", anchor, "an anchor beside the mast, or at its foot or below")
        return
    for name in ("radius", "direction"):
        if name not in guy:
            raise SceneError(f"{prefix}.{name}: missing; allowed: {GUY[name].long_name}, or {prefix}.anchor")
    direction = guy["direction"]
    if len(direction) != 3 or direction[1] != 0.0 or not any(direction):
        raise scene_error(f"{prefix}.direction", direction, "three numbers, a horizontal direction with 0 for y")
    guy.setdefault("count", 1)


def _check_air(mapping: Mapping[str, Any], tree: dict[str, Any], folder: Path) -> None:
    """Check wind and ice, which need the diameters of all cables in use."""
    used = dict.fromkeys(guy["cable"] for guy in tree["guy"])
    for name in used:
        if ("wind" in mapping or "ice" in tree) and "diameter" not in tree["cables"][name]:
            raise SceneError(f"cables.{name}.diameter: missing; allowed: a diameter [m], on which wind and ice act")
    if "wind" in mapping:
        tree["wind"] = check_wind(mapping["wind"], {"diameter": 1.0}, 3, folder)


def check_mast_numbers(p: MastParameters) -> None:
    """Check the numbers of a mast together: loads, lengths and tensions of the guys.

    Raises
    ------
    SceneError
        For a tension that no cable of this level and anchor has, and strains above the limit; the key is named.
    """
    end_time = p.duration or 0.0
    for load in p.loads:
        if load.factor is not None and not np.isfinite(load.factor(load.factor.sampling_times(end_time))).all():
            raise SceneError(f"{load.key}: given a {load.factor.kind} that leaves the finite numbers by {end_time:g} s; "
                             "allowed: one that is finite during the run")  # fmt: skip
    for guy in p.guys:
        bare = guy.p if guy.p.bare is None else guy.p.bare
        try:
            length, strain = length_and_strain(bare, bare.length_key, bare.length_value, prefix=guy.key)
        except SceneError as error:
            error.args = (f"{error}{guy_hint(guy)}",)
            raise
        attachment_fractions(bare, length)
        if strain > MAX_STRAIN:
            raise scene_error(
                f"{guy.key}.{bare.length_key}",
                bare.length_value,
                f"a strain of at most {MAX_STRAIN:g} at rest (it is {strain:.3g}){guy_hint(guy)}",
            )
