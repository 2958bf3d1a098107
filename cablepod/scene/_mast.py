"""Check a scene with a mast and its guys as the user gives it, key by key, and its numbers together."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod._inputs import SCENE, Kind
from cablepod.catenary._statics import length_and_strain
from cablepod.errors import SceneError, did_you_mean, named, scene_error
from cablepod.parameters._check_tables import check_table, unknown_key
from cablepod.parameters._keys import TABLES, TOP
from cablepod.parameters._mast import MastParameters
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
from cablepod.parameters._parameters import has_record
from cablepod.scene._check import (
    check_attachments,
    check_chain,
    check_ensemble,
    check_segments,
    check_with_factor,
    listed,
)
from cablepod.scene._limits import MAX_STRAIN, check_functions
from cablepod.scene._mast_field import at_mast_points
from cablepod.scene._mast_notes import guy_hint
from cablepod.scene._strands import with_strand
from cablepod.scene._wind import check_wind
from cablepod.scene._wind_field import field_of_record, key_of_record

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
#: Names that a cable cannot have: variables of its keys would be those of a segment or attachment of another cable.
TAKEN_NAMES = re.compile(rf"\w+_({'|'.join(GUY_LISTED)})_\d+")


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
        For unknown and missing keys, and values that are not allowed.
    """
    for name in mapping:
        if name not in ALLOWED:
            remedy = f"; try: cables.NAME.{name}" if name in GUY_LISTED else did_you_mean(name, ALLOWED)
            raise unknown_key("", name, ALLOWED, remedy, "key or table of a mast")
    if "mast" not in mapping:
        raise SceneError("mast: missing; allowed: a table with the keys " + ", ".join(MAST))
    tree = check_table("", {key: mapping[key] for key in mapping if key in TOP}, TOP)
    tree["mast"] = _check_mast_table(mapping["mast"], folder)
    for name in SHARED_TABLES:
        if name in mapping and not name.startswith("wind"):
            table = mapping[name]
            tree[name] = check_chain(table) if name == "chain" else check_table(name, table, TABLES[name])
    tree["cables"] = _check_cables(mapping.get("cables", {}), folder)
    tree["guy"] = [check_table(path, table, GUY) for path, table in listed("guy", mapping.get("guy", []))]
    for guy in tree["guy"]:
        if "anchor" not in guy:
            guy.setdefault("count", 1)
    if "wind" in mapping:
        tree["wind"] = check_wind(mapping["wind"], folder)
    if "ensemble" in mapping:
        tree["ensemble"] = check_ensemble(mapping["ensemble"])
    return tree


def _check_mast_table(table: Any, folder: Path) -> dict[str, Any]:
    """Check the table [mast] with its sections and loads."""
    if not isinstance(table, Mapping):
        raise scene_error("mast", table, "a table with the keys " + ", ".join(MAST))
    own, lists = _without_lists("mast", table, MAST, ("section", "load"))
    checked = check_table("mast", own, MAST)
    sections = listed("mast.section", lists.get("section", []))
    found = {"section": [check_table(path, section, MAST_SECTION) for path, section in sections]}
    loads = listed("mast.load", lists.get("load", []))
    found["load"] = [check_with_factor(path, load, MAST_LOAD, folder) for path, load in loads]
    return checked | {name: tables for name, tables in found.items() if tables}


def _without_lists(
    prefix: str, table: Mapping[str, Any], keys: Mapping[str, Any], lists: Iterable[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the keys of a table, and the lists of tables in it; refuse all other names."""
    for name in table:
        if name not in keys and name not in lists:
            allowed = [*keys, *lists]
            raise unknown_key(prefix, name, allowed, did_you_mean(name, allowed, f"{prefix}."))
    own = {name: value for name, value in table.items() if name not in lists}
    return own, {name: table[name] for name in lists if name in table}


def _check_cables(tables: Any, folder: Path) -> dict[str, Any]:
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
        if "segment" in lists:
            path = f"{prefix}.segment"
            lists["segment"] = check_segments(lists["segment"], folder, path, "guy.1", GUY_LENGTH_KEYS)
        if "attachment" in lists:
            lists["attachment"] = check_attachments(lists["attachment"], f"{prefix}.attachment")
        checked[name] = own | lists
    return checked


def check_mast_numbers(p: MastParameters) -> None:
    """Check the numbers of a mast together: loads, lengths and tensions of the guys, the record of the wind.

    Raises
    ------
    SceneError
        For load factors as of :func:`cablepod.scene._limits.check_functions`, a tension that no cable of this level and anchor
        has, and strains above the limit; the key is named.
    """
    check_functions(p.time_functions(), p.duration or 0.0)
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
    if has_record(p):
        at_mast_points(p, p.duration or 0.0, field_of_record(p), key_of_record(p))
