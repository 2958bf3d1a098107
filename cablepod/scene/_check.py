"""Checks of a scene as the user gives it: unknown or missing keys, values, ends, cable, loads, ensemble."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError, closest, did_you_mean, named, scene_error
from cablepod.parameters._checks import choice
from cablepod.parameters._given import cross_section, upper_end
from cablepod.parameters._key_paths import listed_path, motion_path, nested
from cablepod.parameters._keys import (
    ATTACHED_KEYS,
    ATTACHMENT,
    ENSEMBLE,
    INITIAL,
    LENGTH_KEYS,
    OTHER_TABLES,
    PLACE_KEYS,
    POINT_LOAD,
    SEGMENT,
    TABLES,
    TOP,
    Key,
    check_damping,
    check_table,
    exactly_one,
    join,
    meant,
    time_function_keys,
)
from cablepod.parameters._nonuniform import ALTERNATIVES, check_direction_given, of_segment, segment_bounds
from cablepod.parameters._particles import check_own, number_of_links, with_means
from cablepod.scene._files import read_record
from cablepod.scene._limits import LONGEST, SHORTEST
from cablepod.scene._ranges import check_ranges, with_counts_expanded
from cablepod.scene._strands import with_strand
from cablepod.scene._wind import check_wind

#: Path of the table that has the length of the cable, and the keys of which it has one.
LENGTHS = ("cable", LENGTH_KEYS)


def check_mapping(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check all tables; return them with defaults filled in and records read."""
    if not isinstance(mapping, Mapping):
        raise scene_error("scene", mapping, "a mapping with the tables of a scene; read_scene reads a file")
    mapping = nested(mapping)
    _check_names(mapping)
    tree = check_table("", {key: mapping[key] for key in mapping if key in TOP}, TOP)
    for name, keys in TABLES.items():
        if name.startswith("wind"):
            continue
        if name == "load" and name in mapping:
            tree[name] = check_with_factor(name, mapping[name], keys, folder)
        elif name in mapping:
            table = with_strand(mapping[name], folder) if name == "cable" else mapping[name]
            tree[name] = check_table(name, table, keys)
    dims = _check_ends(tree)
    check_chain(tree)
    check_cable(tree)
    check_damping(tree.get("damping", {}))
    _check_initial(tree, dims)
    check_time(tree)
    if "wind" in mapping:
        tree["wind"] = check_wind(mapping["wind"], tree["cable"], dims, folder)
    if "ice" in tree and "diameter" not in tree["cable"]:
        raise SceneError("cable.diameter: missing; allowed: a diameter [m], on which the ice grows")
    if "load" in tree:
        _check_vector("load.uniform", tree["load"]["uniform"], dims)
    if "motion" in mapping:
        tree["motion"] = _check_motion(mapping["motion"], dims, tree["ends"].get("free"), folder)
    _check_lists(mapping, tree, dims, folder)
    if "ensemble" in mapping:
        tree["ensemble"] = check_ensemble(mapping["ensemble"], tree, folder)
    return tree


def _check_names(mapping: Mapping[str, Any]) -> None:
    allowed = [*TOP, *(name for name in TABLES if "." not in name), *OTHER_TABLES]
    for name in mapping:
        if name not in allowed:
            raise SceneError(
                f"{named(name)}: unknown key or table; allowed: {', '.join(allowed)}{meant('', name, allowed)}"
            )
    for name in ("cable", "ends"):
        if name not in mapping:
            raise SceneError(f"{name}: missing; allowed: a table with the keys {', '.join(TABLES[name])}")


def _check_vector(key: str, value: list[float], dims: int) -> None:
    if len(value) != dims:
        raise scene_error(key, value, f"{dims} numbers, as many as ends.lower has")


def _check_ends(tree: dict[str, Any]) -> int:
    lower, upper = tree["ends"]["lower"], [float(number) for number in upper_end(tree["ends"])]
    if "chord" in tree["ends"]:
        _check_chord("ends.chord", tree["ends"]["chord"], tree["ends"]["chord"])
        return len(lower)
    if len(lower) != len(upper):
        raise scene_error("ends.upper", upper, f"{len(lower)} numbers, as many as ends.lower has")
    if lower == upper:
        raise scene_error(
            "ends.upper", upper, "a point other than ends.lower, because ends that coincide span no cable"
        )
    _check_chord("ends.upper", upper, math.dist(lower, upper))
    return len(lower)


def _check_chord(key: str, given: Any, chord: float) -> None:
    if not SHORTEST <= chord <= LONGEST:
        raise scene_error(key, given, f"a chord from {SHORTEST:g} m to {LONGEST:g} m (it is {chord:g} m)")


def check_cable(tree: dict[str, Any], prefix: str = "cable", length_keys: tuple[str, ...] = LENGTH_KEYS) -> None:
    """Check the table of a cable, with the masses and stiffnesses of its own that a table ``[chain]`` has.

    `length_keys` are those of which it must have exactly one.
    """
    chain = tree.get("chain", {})
    check_own(tree["cable"], chain, tree.get("initial", {}))
    if length_keys:
        exactly_one(prefix, tree["cable"], length_keys)
    cable = with_means(tree["cable"], chain, tree.get("ends", {}).get("free"))
    section = cross_section(cable, tree["gravity"], prefix=prefix)
    if not 1e-6 <= section.stiffness <= 1e18:
        allowed = f"an axial stiffness of 1e-6 to 1e18 N (it is {section.stiffness:g} N)"
        own = "stiffness" in chain
        key, given = f"{prefix}.{section.stiffness_key}", cable[section.stiffness_key]
        raise scene_error("chain.stiffness" if own else key, chain["stiffness"] if own else given, allowed)
    if not 1e-15 <= section.mass <= 1e15 or not section.weight <= 1e15:
        allowed = f"1e-15 to 1e15 kg/m and at most 1e15 N/m (it is {section.mass:g} kg/m)"
        own = "masses" in chain
        key, given = f"{prefix}.{section.weight_key}", cable[section.weight_key]
        raise scene_error("chain.masses" if own else key, chain["masses"] if own else given, allowed)


def check_chain(tree: dict[str, Any]) -> None:
    if "chain" not in tree:
        return
    chain = tree["chain"]
    if "links" not in chain and (links := number_of_links(chain)) is not None:
        chain["links"] = links
    if "links" not in chain:
        raise SceneError("chain.links: missing; allowed: a whole number of at least 2, or chain.link_lengths")
    lengths = chain.get("link_lengths")
    if lengths is not None:
        if chain["links"] != len(lengths):
            raise scene_error("chain.link_lengths", lengths, f"{chain['links']} numbers, as many as chain.links says")
        if max(lengths) / min(lengths) > 1e6:
            raise scene_error("chain.link_lengths", lengths, "lengths that differ by a factor of at most 1e6")


def _check_initial(tree: dict[str, Any], dims: int) -> None:
    if "initial" not in tree:
        return
    initial = tree["initial"]
    if exactly_one("initial", initial, tuple(INITIAL)) != "points":
        return
    line = initial["points"]
    for index, place in enumerate(line):
        _check_vector(f"initial.points[{index}]", place, dims)
    lower, upper = tree["ends"]["lower"], [float(number) for number in upper_end(tree["ends"])]
    chord = math.dist(lower, upper)
    for end, place, held in zip(ENDS, (line[0], line[-1]), (lower, upper), strict=True):
        if end != tree["ends"].get("free") and math.dist(place, held) > 1e-9 * chord:
            raise scene_error(
                "initial.points", place, f"a line that begins and ends at the held ends (ends.{end} is {held})"
            )
    if not sum(math.dist(a, b) for a, b in pairwise(line)) > 1e-9 * chord:
        raise scene_error("initial.points", line, "a line of some length")


def check_time(tree: dict[str, Any]) -> None:
    if "time" not in tree:
        return
    duration, interval = tree["time"]["duration"], tree["time"]["interval"]
    if interval > duration:
        raise scene_error("time.interval", interval, f"at most time.duration, {duration:g} s")
    if duration / interval > 1e12:
        raise scene_error("time.interval", interval, f"an interval that {duration:g} s holds at most 1e12 times")


def check_with_factor(prefix: str, table: Any, keys: Mapping[str, Key], folder: Path) -> dict[str, Any]:
    """Check the table of a load, with the keys of its time factor if it has one."""
    if not isinstance(table, Mapping):
        raise scene_error(prefix, table, "a table with the keys " + ", ".join(keys))
    load = {name: value for name, value in table.items() if name in keys}
    factor = {name: value for name, value in table.items() if name not in keys}
    factor_keys = {"kind", *(name for kind in time_function_keys("1").values() for name in kind)}
    for name in factor:
        if name not in factor_keys:
            allowed = ", ".join([*keys, "kind (of a time factor)"])
            similar = meant(prefix, name, {*keys, *factor_keys})
            raise SceneError(f"{join(prefix, name)}: unknown key; allowed: {allowed}{similar}")
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


def _check_motion(table: Any, dims: int, free: str | None, folder: Path) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise scene_error("motion", table, "tables motion.lower.x, motion.upper.y and so on")
    axes = COORDINATES[:dims]
    checked: dict[str, Any] = {}
    for end, motions in table.items():
        if end not in ENDS:
            raise SceneError(
                f"motion.{named(end)}: unknown key; allowed: {', '.join(ENDS)}{did_you_mean(end, ENDS, 'motion.')}"
            )
        if not isinstance(motions, Mapping):
            raise scene_error(f"motion.{end}", motions, f"tables motion.{end}.x and so on")
        if end == free and motions:
            raise scene_error(f"motion.{end}", dict(motions), f"no motion of the end that ends.free names ({free})")
        checked[end] = {}
        for axis, function in motions.items():
            if axis not in axes:
                raise SceneError(f"motion.{end}.{named(axis)}: unknown axis; allowed: {', '.join(axes)}")
            checked[end][axis] = _check_time_function(motion_path(end, axis), function, "m", folder)
    return checked


def _check_lists(mapping: Mapping[str, Any], tree: dict[str, Any], dims: int, folder: Path) -> None:
    """Check the lists of tables."""
    if "point_load" in mapping:
        tree["point_load"] = _check_point_loads(mapping["point_load"], dims, folder)
    if "segment" in mapping:
        tree["segment"] = check_segments(mapping["segment"], tree, folder)
    if "attachment" in mapping:
        tree["attachment"] = check_attachments(mapping["attachment"], dims)


def _check_point_loads(loads: Any, dims: int, folder: Path) -> list[dict[str, Any]]:
    checked = []
    for prefix, table in _listed("point_load", loads):
        load = check_with_factor(prefix, table, POINT_LOAD, folder)
        _check_vector(f"{prefix}.force", load["force"], dims)
        checked.append(load)
    return checked


def check_segments(
    tables: Any,
    tree: dict[str, Any],
    folder: Path,
    name: str = "segment",
    lengths: tuple[str, tuple[str, ...]] = LENGTHS,
) -> list[dict[str, Any]]:
    """Check the tables [[segment]]: their keys, the cable that each makes, their bounds.

    Parameters
    ----------
    tables, folder
        Given tables; folder of the paths in them.
    tree
        Checked scene with the table of the cable.
    name
        Path of the list, for messages.
    lengths
        Path of the table that has the length of the cable, and its keys.
    """
    checked = []
    for path, table in _listed(name, tables):
        if isinstance(table, Mapping):
            for key in lengths[1]:
                if key in table:
                    where = f"{lengths[0]}.{key}"
                    raise SceneError(f"{path}.{key}: given; allowed: none for a part of the cable; try: {where}")
        own = check_table(path, with_strand(table, folder, path), SEGMENT)
        for names in ALTERNATIVES:
            if any(name in own for name in names):
                exactly_one(path, own, names)
        check_cable({**tree, "cable": of_segment(tree["cable"], own)}, path, ())
        checked.append(own)
    if checked:
        checked[-1].setdefault("to", 1.0)
    segment_bounds(checked, name)
    return checked


def check_attachments(tables: Any, dims: int, name: str = "attachment") -> list[dict[str, Any]]:
    """Check the tables [[attachment]], but for their places along the cable, see :func:`attachment_fractions`.

    `name` is the path of the list, for messages.
    """
    checked = []
    for path, table in _listed(name, tables):
        own = check_table(path, table, ATTACHMENT)
        exactly_one(path, own, PLACE_KEYS)
        if not any(name in own for name in ATTACHED_KEYS):
            raise SceneError(f"{path}: given none of {', '.join(ATTACHED_KEYS)}; allowed: at least one")
        if not isinstance(own.get("direction", ""), str):
            _check_vector(f"{path}.direction", own["direction"], dims)
        check_direction_given(path, own)
        checked.append(own)
    return checked


def _listed(name: str, tables: Any) -> Iterator[tuple[str, Any]]:
    """Yield the key path and the table of each entry of a list."""
    if not isinstance(tables, list | tuple):
        raise scene_error(name, tables, f"an array of tables, [[{name}]]")
    for number, table in enumerate(tables, start=1):
        yield listed_path(name, number), table


def check_ensemble(table: Any, tree: dict[str, Any], folder: Path) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise scene_error("ensemble", table, "a table with the keys " + ", ".join([*ENSEMBLE, "ranges"]))
    for name in table:
        if name not in (keys := [*ENSEMBLE, "ranges"]):
            similar = meant("ensemble", name, keys)
            raise SceneError(f"{join('ensemble', name)}: unknown key; allowed: {', '.join(keys)}{similar}")
    options = {key: value for key, value in table.items() if key != "ranges"}
    ranges, options = with_counts_expanded(table.get("ranges"), options, prefix="ensemble")
    checked = check_table("ensemble", options, ENSEMBLE)
    count, sampling = checked["members"], checked["sampling"]
    checked["ranges"] = check_ranges(ranges, tree, members=count, sampling=sampling, folder=folder)
    return checked
