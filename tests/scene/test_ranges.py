"""Ranges of an ensemble: a file and ensemble.design refuse and take the same, and members are checked as scenes are."""

from __future__ import annotations

from typing import Any

import pytest
from mast_scenes import SMALL
from scenes import SOFT

import cablepod as cp

LISTED = {"members": 2, "sampling": "list"}


def test_listed_members_are_checked_as_they_are():
    ranges = {"time.duration": [8.0, 20.0], "time.interval": [5.0, 10.0]}  # 10 s is longer than the run of the scene
    made = cp.ensemble.design(cp.make_scene(SOFT), ranges, **LISTED)
    assert made["time_interval"].values.tolist() == [5.0, 10.0]
    assert cp.ensemble.design(cp.make_scene({**SOFT, "ensemble": {**LISTED, "ranges": ranges}})).equals(made)
    swapped = {"time.duration": [20.0, 8.0], "time.interval": [5.0, 10.0]}
    with pytest.raises(cp.SceneError, match=r"at \d+ no scene: time\.interval: given 10\.0; allowed: at most .*, 8 s$"):
        cp.ensemble.design(cp.make_scene(SOFT), swapped, **LISTED)


REFUSED: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    (SOFT, {"load.uniform": [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]}, r"load\.uniform: given 3 numbers; allowed: 2 numbers, for x, y"),
    (SOFT, {"cable.sag": [0.1, 0.2]}, r"cable: given top_tension = 200\.0 and sag = 0\.\d; allowed: exactly one"),
    (SOFT, {"ends.free": ["upper", "lower"]}, r"motion\.upper: given one along x; allowed: no motion"),
    (SOFT, {"wind.speed": [5.0, 6.0]}, r"wind\.direction: missing; allowed: direction into which the wind blows"),
    (SOFT, {"chain.masses.x": [1.0, 2.0]}, r"chain\.masses\.x: unknown key path"),
    (SOFT, {"motion.upper.x.amplitud": [0.1, 0.2]}, r"unknown key path; .*; try: motion\.upper\.x\.amplitude$"),
    (SMALL, {"guy.1.level": [28.0, 31.0]}, r"guy\.1\.level: given 31\.0; allowed: a height of at most mast\.height, 30 m"),
    (SMALL, {"guy.1.direction.y": [0.0, 0.1]}, r"guy\.1\.direction: given .*; allowed: three numbers, a horizontal"),
    (SMALL, {"mast.load.1.level": [28.0, 31.0]}, r"mast\.load\.1\.level: given 31\.0; allowed: a height"),
    (SMALL, {"guy.1.anchor": [[9.0, 0.0], [8.0, 0.0]]}, r"guy\.1\.anchor: given 2 numbers; allowed: 3 numbers, for x, y, z"),
    (SMALL, {"cable.area": [1e-5, 2e-5]}, r"cable\.area: given .*; allowed: no such key in a scene of a mast"),
]  # fmt: skip


@pytest.mark.parametrize(("tree", "ranges", "message"), REFUSED)
def test_a_file_and_design_refuse_the_same_ranges(tree, ranges, message):
    with pytest.raises(cp.SceneError, match=message):
        cp.ensemble.design(cp.make_scene(tree), ranges, **LISTED)
    with pytest.raises(cp.SceneError, match=rf"^ensemble\.ranges.*{message}"):
        cp.make_scene({**tree, "ensemble": {**LISTED, "ranges": ranges}})
