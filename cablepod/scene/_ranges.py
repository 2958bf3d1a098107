"""Checks of the ranges of an ensemble: key paths, values of each, counts and the size of a grid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.conventions import COORDINATES
from cablepod.errors import SceneError, did_you_mean, scene_error
from cablepod.parameters._checks import numbers_list
from cablepod.parameters._key_paths import flat, number_at, number_paths
from cablepod.parameters._keys import ENSEMBLE, join


def with_counts_expanded(ranges: Any, options: Mapping[str, Any], *, prefix: str = "") -> tuple[Any, dict[str, Any]]:
    """Expand ranges [low, high, count] to the values of a grid, and count its members.

    Parameters
    ----------
    ranges
        Key path -> range, in any form.  Three numbers are low, high and count, unless sampling "grid" or "list" is given: there
        they are three values.
    options
        Given ``members`` and ``sampling``; missing or None for those not given.
    prefix
        Key path of the table of options, for messages.

    Returns
    -------
    tuple
        Key path -> equally spaced values, and the options with sampling "grid" and the number of members; both as they are if
        no range has a count.

    Raises
    ------
    SceneError
        For counts below 2, reversed ranges, ranges without a count beside them, and another number of members or sampling.
    """
    options, given = dict(options), flat(ranges)
    sampling, table = options.get("sampling"), join(prefix, "ranges") if prefix else "ranges"
    if not isinstance(given, Mapping) or sampling not in (None, "latin_hypercube", "sobol"):
        return ranges, options
    counted = {join(table, path): values for path, values in given.items() if _has_count(values)}
    if not counted:
        return ranges, options
    if sampling is not None:
        key, values = next(iter(counted.items()))
        allowed = f'[low, high] for sampling "{sampling}"; [low, high, count] makes a grid, without sampling'
        raise scene_error(key, values, allowed)
    axes: dict[Any, tuple[float, float, int]] = {}
    for path, values in given.items():
        key = join(table, path)
        if key not in counted:
            raise scene_error(key, values, f"[low, high, count], as {next(iter(counted))} has a count")
        low, high, count = numbers_list()(key, values)
        if not count.is_integer() or count < 2 or low >= high:
            raise scene_error(key, values, "[low, high, count] with low < high and a whole count of at least 2")
        axes[path] = low, high, int(count)
    counts, key = [count for _, _, count in axes.values()], join(prefix, "members") if prefix else "members"
    product = ENSEMBLE["members"].check(key, math.prod(counts))
    given_members = options.get("members")
    if given_members is not None and ENSEMBLE["members"].check(key, given_members) != product:
        factors = " x ".join(map(str, counts))
        raise scene_error(key, given_members, f"{product}, the product of the counts {factors}, or none given")
    options |= {"members": product, "sampling": "grid"}
    return {path: np.linspace(low, high, count).tolist() for path, (low, high, count) in axes.items()}, options


def _has_count(values: Any) -> bool:
    """Tell whether a range has three entries."""
    return (isinstance(values, list | tuple) or (isinstance(values, np.ndarray) and values.ndim == 1)) and len(
        values
    ) == 3


def check_values(key: str, given: Any, *, members: int, sampling: str) -> list[float]:
    """Check the values of a range: [low, high], values of a grid, or one for each member.

    Raises
    ------
    SceneError
        For values that `sampling` does not allow.
    """
    if sampling == "list":
        values = numbers_list()(key, given)
        if len(values) != members:
            raise scene_error(
                key, given, f'{members} values for sampling "list", as many as members (they are {len(values)})'
            )
        return values
    values = numbers_list(least_length=2)(key, given)
    if sampling == "grid" and len(values) > 2:
        if len(set(values)) < len(values):
            raise scene_error(key, given, "different values, or [low, high] with low < high")
        if len(values) == 3 and values[2].is_integer() and 2 <= values[2] < values[1] and values[0] < values[1]:
            raise scene_error(key, given, "rising values; [low, high, count] without sampling makes a grid too")
        return values
    if len(values) > 2:
        raise scene_error(key, given, '[low, high] with low < high; lists of values need sampling "grid" or "list"')
    if values[0] >= values[1]:
        raise scene_error(key, given, "[low, high] with low < high")
    return values


def points_of_grid(ranges: Mapping[str, list[float]], members: int, *, key: str = "ensemble.members") -> int:
    """Return the number of grid points of each [low, high] in a full factorial design of `members`.

    Lists of more than two values keep their own; 0 if there are only lists.

    Raises
    ------
    SceneError
        If no number of points gives that many members; the message names the nearest possible numbers.
    """
    lists = [len(values) for values in ranges.values() if len(values) > 2]
    axes = len(ranges) - len(lists)
    fixed = math.prod(lists)
    if not axes:
        if fixed != members:
            raise scene_error(key, members, f"{fixed}, the product of the lengths of the lists of this grid")
        return 0
    least = max(2, round((members / fixed) ** (1.0 / axes)))
    below, above = (max(2, least - 1), least + 1) if least**axes * fixed != members else (least, least)
    if below == above:
        return least
    near = sorted({fixed * points**axes for points in (below, least, above)}, key=lambda count: abs(count - members))
    raise scene_error(
        key,
        members,
        f"{near[0]} (or {near[1]}), because a grid has equally many points, two at least, on each of its {axes} ranges"
        + (f", times {fixed} of its lists" if lists else ""),
    )


def check_ranges(
    given: Any, tree: Any, *, members: int, sampling: str, prefix: str = "ensemble.ranges"
) -> dict[str, list[float]]:
    """Check the ranges of an ensemble against its scene.

    Parameters
    ----------
    given
        Key path -> values as :func:`check_values` takes them.
    tree
        Checked scene as nested tables.
    members, sampling
        Number of members, kind of sampling.
    prefix
        Key path of the table, for messages.

    Raises
    ------
    SceneError
        For an empty table, unknown key paths, values that are not allowed, and a grid of another number of members.
    """
    given = flat(given)
    if not isinstance(given, Mapping) or not given:
        raise scene_error(prefix, given, "a table from key paths to [low, high]")
    checked: dict[str, list[float]] = {}
    for path, values in given.items():
        key = join(prefix, path)
        if number_at(tree, path) is None:
            similar = axis_hint(number_at(tree, f"{path}.x") is not None, path) or did_you_mean(
                path, number_paths(tree)
            )
            raise SceneError(f"{key}: unknown key path; allowed: the path of a number that this scene has{similar}")
        checked[path] = check_values(key, values, members=members, sampling=sampling)
    if sampling == "grid":
        points_of_grid(checked, members)
    return checked


def axis_hint(is_vector: bool, path: Any) -> str:
    """Return the remedy for the key path of a vector, whose numbers are named by their axis; else empty."""
    return f"; try: {path}.{COORDINATES[0]} or {path}.{COORDINATES[1]}" if is_vector else ""
