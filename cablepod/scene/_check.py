"""Check a scene of one cable as the user gives it, key by key: names, values, defaults, records, ensemble.

Which keys go together is checked with the parameters of the Dataset, see :mod:`cablepod.parameters`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError, closest, did_you_mean, scene_error
from cablepod.parameters._check_tables import check_names, check_table, meant, unknown_key
from cablepod.parameters._checks import choice
from cablepod.parameters._key_paths import listed_path, motion_path
from cablepod.parameters._keys import (
    ATTACHMENT,
    ENSEMBLE,
    FUNCTION_KEYS,
    LENGTH_KEYS,
    OTHER_TABLES,
    POINT_LOAD,
    SEGMENT,
    TABLES,
    TOP,
    Key,
    join,
    time_function_keys,
)
from cablepod.parameters._particles import number_of_links
from cablepod.scene._files import read_record
from cablepod.scene._ranges import with_counts_expanded
from cablepod.scene._strands import with_strand
from cablepod.scene._wind import check_wind


def check_mapping(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check all tables; return them with defaults filled in and records read."""
    _check_names(mapping)
    tree = check_table("", {key: mapping[key] for key in mapping if key in TOP}, TOP)
    for name, keys in TABLES.items():
        if name.startswith("wind") or name not in mapping:
            continue
        if name == "load":
            tree[name] = check_with_factor(name, mapping[name], keys, folder)
        elif name == "chain":
            tree[name] = check_chain(mapping[name])
        else:
            tree[name] = check_table(
                name, with_strand(mapping[name], folder) if name == "cable" else mapping[name], keys
            )
    if "wind" in mapping:
        tree["wind"] = check_wind(mapping["wind"], folder)
    if "motion" in mapping:
        tree["motion"] = _check_motion(mapping["motion"], folder)
    if "point_load" in mapping:
        loads = listed("point_load", mapping["point_load"])
        tree["point_load"] = [check_with_factor(path, table, POINT_LOAD, folder) for path, table in loads]
    if "segment" in mapping:
        tree["segment"] = check_segments(mapping["segment"], folder)
    if "attachment" in mapping:
        tree["attachment"] = check_attachments(mapping["attachment"])
    if "ensemble" in mapping:
        tree["ensemble"] = check_ensemble(mapping["ensemble"])
    return tree


def _check_names(mapping: Mapping[str, Any]) -> None:
    allowed = [*TOP, *(name for name in TABLES if "." not in name), *OTHER_TABLES]
    for name in mapping:
        if name not in allowed:
            raise unknown_key("", name, allowed, kind="key or table")
    for name in ("cable", "ends"):
        if name not in mapping:
            raise SceneError(f"{name}: missing; allowed: a table with the keys {', '.join(TABLES[name])}")


def check_chain(table: Any) -> dict[str, Any]:
    """Check the table [chain]; the number of links is that of its lists by default."""
    chain = check_names("chain", table, TABLES["chain"])
    links = chain.get("links", number_of_links(chain))
    if links is None:
        raise SceneError("chain.links: missing; allowed: a whole number of at least 2, or chain.link_lengths")
    return {**chain, "links": links}


def check_with_factor(prefix: str, table: Any, keys: Mapping[str, Key], folder: Path) -> dict[str, Any]:
    """Check the table of a load, with the keys of its time factor if it has one."""
    if not isinstance(table, Mapping):
        raise scene_error(prefix, table, "a table with the keys " + ", ".join(keys))
    load = {name: value for name, value in table.items() if name in keys}
    factor = {name: value for name, value in table.items() if name not in keys}
    factor_keys = {"kind", *FUNCTION_KEYS}
    for name in factor:
        if name not in factor_keys:
            similar = meant(prefix, name, {*keys, *factor_keys})
            raise unknown_key(prefix, name, [*keys, "kind (of a time factor)"], similar)
    checked = check_table(prefix, load, keys)
    return checked | _check_time_function(prefix, factor, "1", folder) if factor else checked


def _check_time_function(prefix: str, table: Any, units: str, folder: Path) -> dict[str, Any]:
    kinds = time_function_keys(units)
    if not isinstance(table, Mapping):
        raise scene_error(prefix, table, "a table with the key kind")
    if "kind" not in table:
        wrong = [name for name in table if closest(name, ["kind"])]
        remedy = f"; try: {prefix}.kind in place of {join(prefix, wrong[0])}" if wrong else ""
        raise SceneError(f"{prefix}.kind: missing; allowed: one of {', '.join(kinds)}{remedy}")
    kind = choice(*kinds)(f"{prefix}.kind", table["kind"])
    values = {name: value for name, value in table.items() if name != "kind"}
    checked = check_table(prefix, values, kinds[kind])
    if kind == "file":
        checked.update(read_record(f"{prefix}.path", folder / checked["path"]))
    return {"kind": kind, **checked}


def _check_motion(table: Any, folder: Path) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise scene_error("motion", table, "tables motion.lower.x, motion.upper.y and so on")
    checked: dict[str, Any] = {}
    for end, motions in table.items():
        if end not in ENDS:
            raise unknown_key("motion", end, ENDS, did_you_mean(end, ENDS, "motion."))
        if not isinstance(motions, Mapping):
            raise scene_error(f"motion.{end}", motions, f"tables motion.{end}.x and so on")
        checked[end] = {}
        for axis, function in motions.items():
            if axis not in COORDINATES:
                raise unknown_key(f"motion.{end}", axis, COORDINATES, "", "axis")
            checked[end][axis] = _check_time_function(motion_path(end, axis), function, "m", folder)
    return checked


def check_segments(
    tables: Any, folder: Path, name: str = "segment", length_table: str = "cable", lengths: Iterable[str] = LENGTH_KEYS
) -> list[dict[str, Any]]:
    """Check the tables [[segment]]; the last one ends at 1 by default.

    Parameters
    ----------
    tables, folder
        Given tables; folder of the paths in them.
    name
        Path of the list, for messages.
    length_table, lengths
        Path of the table that has the length of the cable, and its keys.
    """
    checked = []
    for path, table in listed(name, tables):
        for key in lengths if isinstance(table, Mapping) else ():
            if key in table:
                allowed = f"none for a part of the cable; try: {length_table}.{key}"
                raise SceneError(f"{path}.{key}: given; allowed: {allowed}")
        checked.append(check_table(path, with_strand(table, folder, path), SEGMENT))
    if checked:
        checked[-1].setdefault("to", 1.0)
    return checked


def check_attachments(tables: Any, name: str = "attachment") -> list[dict[str, Any]]:
    """Check the tables [[attachment]]; `name` is the path of the list, for messages."""
    return [check_table(path, table, ATTACHMENT) for path, table in listed(name, tables)]


def listed(name: str, tables: Any) -> Iterator[tuple[str, Any]]:
    """Yield the key path and the table of each entry of a list."""
    if not isinstance(tables, list | tuple):
        raise scene_error(name, tables, f"an array of tables, [[{name}]]")
    for number, table in enumerate(tables, start=1):
        yield listed_path(name, number), table


def check_ensemble(table: Any) -> dict[str, Any]:
    """Check the options of the table [ensemble]; its ranges are checked with the Dataset of the scene."""
    if not isinstance(table, Mapping):
        raise scene_error("ensemble", table, "a table with the keys " + ", ".join([*ENSEMBLE, "ranges"]))
    for name in table:
        if name not in (keys := [*ENSEMBLE, "ranges"]):
            raise unknown_key("ensemble", name, keys)
    options = {key: value for key, value in table.items() if key != "ranges"}
    ranges, options = with_counts_expanded(table.get("ranges"), options, prefix="ensemble")
    return {**check_table("ensemble", options, ENSEMBLE), "ranges": ranges}
