"""Checks of the ranges of an ensemble: key paths, values of each, and the size of a grid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cablepod.errors import SceneError, did_you_mean, scene_error
from cablepod.parameters._checks import numbers_list
from cablepod.parameters._key_paths import flat, number_at, number_paths
from cablepod.parameters._keys import join


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
        return values
    if len(values) != 2 or values[0] >= values[1]:
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
            similar = did_you_mean(path, number_paths(tree))
            raise SceneError(f"{key}: unknown key path; allowed: the path of a number that this scene has{similar}")
        checked[path] = check_values(key, values, members=members, sampling=sampling)
    if sampling == "grid":
        points_of_grid(checked, members)
    return checked
