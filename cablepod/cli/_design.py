"""Run ``cablepod design`` and format what it prints."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.cli import _arguments, _group, _page
from cablepod.cli._group import say
from cablepod.cli._mast import place
from cablepod.cli._progress import member_bar
from cablepod.conventions import direction
from cablepod.errors import SceneError, scene_error
from cablepod.examples import scene_path
from cablepod.extremes._peaks import PROBABILITY
from cablepod.scene._read import read_scene
from cablepod.study import design
from cablepod.study._design_tables import Row, case_rows, foot_rows, guy_rows, height_rows, level_rows

#: Default speeds over that of the scene.
SPEEDS = (0.6, 0.7, 0.8, 0.9, 1.0)
#: Ending of the default folder.
ENDING = "_design"


def run(
    *, scene: str, out: str | None, directions: str | None, speeds: str | None, shares: str | None, reference_range: float | None,
    page: str | None, **options: Any,
) -> None:  # fmt: skip
    """Run the study of a scene file with the options of the command, and print its tables."""
    path = scene_path(scene)
    folder = Path("out", Path(path).stem + ENDING) if out is None else _arguments.folder(out)
    dataset = read_scene(path)
    is_planar = dataset.sizes["coordinate"] == 2
    default = "0,180" if is_planar else "8"
    angles = _angles(default if directions is None else directions, is_planar=is_planar)
    if "ensemble_json" in dataset.attrs:
        _group.note("the [ensemble] table is left aside; this command varies direction, speed and seed of the wind")
    chosen = None if speeds is None else _listed("--speeds", speeds)
    if chosen is None and "wind_speed" in dataset:
        chosen = [factor * float(dataset["wind_speed"]) for factor in SPEEDS]
    target = _page.checked(page)
    window = options.pop("window", None)
    counts = len(angles), len(chosen or [0]), options["storms"]
    members = math.prod(counts)
    if members > 0 and chosen:
        words = " x ".join(map(_many, counts, ("direction", "speed", "storm")))
        _group.note(f"{words} = {_many(members, 'storm')}")
    with member_bar("mast" if "mast_height" in dataset else "condensed", members) as progress, _page.heard() as notes:
        result = design(
            dataset,
            directions=angles,
            speeds=chosen or [],
            out=folder,
            shares=None if shares is None else _listed("--shares", shares),
            reference_range=None if reference_range is None else 1e6 * reference_range,
            window=window or None,
            progress=progress,
            **options,
        )
    tables = {
        "Guys" if "guy" in result.dims else "Ends of the guy": guy_rows(result), "Displacements": level_rows(result),
        "Envelopes over the height": height_rows(result), "Forces on the foundation": foot_rows(result),
        "Directions and speeds": case_rows(result),
    }  # fmt: skip
    found = text(result)
    say(found)
    say(f"\n{folder}: {', '.join(sorted(path.name for path in folder.iterdir() if not path.name.startswith('.')))}")
    written = _page.write(target, {"scene": dataset, "design": result}, text=found, notes=notes, tables=tables)
    if written:
        say(written)


#: Maximum number of directions that is given as a number: of more, an angle is likely meant.
MOST_DIRECTIONS = 72
#: Decimals to which angles [deg] are the same.
SAME = 6
#: Heading of the envelopes.
ENVELOPES = (
    "envelopes of the mast: means of the storms' largest values, with their intervals in heights.csv; shear: the larger of both",
    "ends of an element; least: the least axial force of all storms",
)


def _angles(given: str, *, is_planar: bool) -> list[float]:
    """Return the directions of ``--directions`` [rad].

    Raises
    ------
    SceneError
        In degrees, as they are given.
    """
    if "," not in given:
        try:
            count = int(given)
        except ValueError:
            count = 0
        if not 1 <= count <= MOST_DIRECTIONS:
            remedy = f"; try: {given}, for this angle alone" if count > MOST_DIRECTIONS else ""
            allowed = f"a number of directions, 1 to {MOST_DIRECTIONS}, or angles [deg] with commas between{remedy}"
            raise scene_error("--directions", given, allowed)
        angles = [360.0 * k / count for k in range(count)]
    else:
        angles = _listed("--directions", given) if given.strip(" ,") else []
    if not angles or not np.isfinite(angles).all():
        raise scene_error("--directions", given, "finite angles [deg] with commas between")
    if np.unique(np.round(np.remainder(angles, 360.0), SAME) % 360.0).size < len(angles):
        raise scene_error("--directions", given, "angles [deg], each once in a full turn: 360 is 0")
    if is_planar and np.remainder(angles, 180.0).any():
        raise scene_error("--directions", given, "0 and 180 [deg] in a planar scene, whose wind blows along x")
    return [math.radians(angle) for angle in angles]


def _listed(key: str, given: str) -> list[float]:
    """Return numbers with commas between, one at least."""
    try:
        found = [float(part) for part in given.split(",") if part.strip()]
    except ValueError:
        found = []
    if not found:
        raise SceneError(f"{key}: given {given!r}; allowed: numbers with commas between")
    return found


def _many(count: int, noun: str) -> str:
    """Return a number of things in words."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def text(result: xr.Dataset) -> str:
    """Return the tables of a design, in kN, kN m, m and degrees."""
    level = f"{100.0 * result.attrs['level']:g} %"
    counts = [result.sizes[name] for name in ("direction", "speed", "storm")]
    words = ", ".join(map(_many, counts, ("direction", "speed", "storm")))
    lines = [
        str(result.attrs["title"]), "",
        f"{words} of each; peaks are means of the storms' largest values, "
        f"with their {level} interval;",
        "of all directions and speeds the worst; angles from +x to +z: of the wind, into which it blows, of guys, to the anchor",
    ]  # fmt: skip
    if any(str(name).endswith("_quantile") for name in result):
        lines.append(f"quantile: what a storm does not exceed with a probability of {100.0 * PROBABILITY:g} %")
    lines += ["", "tension of the guys [kN]" if "guy" in result.dims else "tension at the ends [kN]", *_guys(result)]
    if "displacement_peak" in result:
        lines += ["", "displacement of the mast [m]", *_table(level_rows(result), (
            ("level [m]", "level [m]", "g", 1.0), *_WIND, ("displacement [m]", "peak", ".4f", 1.0), *_bounds("displacement", "m"),
        ))]  # fmt: skip
        lines += ["", *ENVELOPES, *_table(_by_spans(result), (
            ("from [m]", "from [m]", "g", 1.0), ("to [m]", "to [m]", "g", 1.0),
            ("bending moment [N m]", "moment [kN m]", ".4g", 1e-3), ("shear [N]", "shear [kN]", ".4g", 1e-3),
            ("axial force [N]", "axial force [kN]", ".4g", 1e-3), ("least axial force [N]", "least [kN]", ".4g", 1e-3),
        ))]  # fmt: skip
        lines += ["", "force of the mast on its foundation [kN], moment [kN m]", *_table(foot_rows(result), (
            ("force on the foundation", "", "s", 1.0), *_WIND, ("force [N]", "peak", ".4g", 1e-3), *_bounds("force", "N"),
        ))]  # fmt: skip
    lines += ["", "directions and speeds", *_cases(result), *_slack(result)]
    return "\n".join(lines)


#: Columns: heading of the row, printed heading, format, factor.
Column = tuple[str, str, str, float]
_WIND: tuple[Column, ...] = (("wind [deg]", "wind [deg]", "g", 1.0), ("speed [m/s]", "speed [m/s]", "g", 1.0))


def _bounds(base: str, unit: str) -> tuple[Column, ...]:
    """Return the columns of the interval and of the quantile."""
    kind, factor = (".4f", 1.0) if unit == "m" else (".4g", 1e-3)
    return tuple((f"{base} {what} [{unit}]", head, kind, factor) for what, head in (
        ("low", "from"), ("high", "to"), ("quantile", "quantile"),
    ))  # fmt: skip


def _guys(result: xr.Dataset) -> list[str]:
    """Return the table of guys, each named by its direction and anchor."""
    rows = guy_rows(result)
    for row in rows:
        if "guy" in row:
            anchor = np.array([row[f"anchor {axis} [m]"] for axis in "xyz"])
            row |= {"towards": direction(anchor[0], anchor[2]), "anchor [m]": place(anchor)}
    line = "guy" if "guy" in result.dims else "end"
    return _table(rows, (
        (line, line, "", 1.0), ("level [m]", "level [m]", "g", 1.0), ("towards", "towards", "s", 1.0),
        ("anchor [m]", "anchor [m]", "s", 1.0), *_WIND, ("peak [N]", "peak", ".2f", 1e-3),
        ("peak low [N]", "from", ".2f", 1e-3), ("peak high [N]", "to", ".2f", 1e-3),
        ("peak quantile [N]", "quantile", ".2f", 1e-3),
        ("utilisation [1]", "used [%]", ".1f", 100.0), ("force on the anchor [N]", "at anchor", ".2f", 1e-3),
        ("horizontal [N]", "horizontal", ".2f", 1e-3), ("uplift [N]", "uplift", ".2f", 1e-3),
        ("slack storms", "slack storms", "d", 1.0), ("breaks [s]", "breaks [s]", "g", 1.0),
        ("damage in a year [1]", "damage/year", ".3g", 1.0), ("life [years]", "life [years]", ".3g", 1.0),
    ))  # fmt: skip


def _by_spans(result: xr.Dataset) -> list[Row]:
    """Return the envelopes between the levels of guys, the top and the foot, each the largest of its elements."""
    rows, spans = height_rows(result), []
    ends = [0.0, *(float(level) for level in result["level"].values)]
    for bottom, top in itertools.pairwise(ends):
        own = [row for row in rows if bottom <= row["from [m]"] < top]
        span: Row = {"from [m]": bottom, "to [m]": top}
        pick: Callable[[Sequence[float]], float]
        for name in own[0]:
            if name not in span:
                pick = min if name.startswith("least") else max
                span[name] = pick([row[name] for row in own])
        spans.append(span)
    return spans


def _cases(result: xr.Dataset) -> list[str]:
    """Return the table of directions and speeds, with the slack guys by name."""
    rows = case_rows(result)
    line = "guy" if "guy" in result.dims else "end"
    return _table(rows, (
        *_WIND, (line, line, "", 1.0), ("peak [N]", "peak [kN]", ".2f", 1e-3), ("displacement [m]", "displ. [m]", ".3f", 1.0),
        ("bending moment [N m]", "moment [kN m]", ".4g", 1e-3), ("buckling factor", "buckling", ".3g", 1.0),
        ("buckling factor after break", "after break", ".3g", 1.0),
        ("failed storms", "failed", "d", 1), ("slack", "slack guys (storms)" if line == "guy" else "slack (storms)", "s", 1.0),
    ))  # fmt: skip


def _slack(result: xr.Dataset) -> list[str]:
    """Return the slack guys by name, with the number of their storms."""
    if "guy" not in result.dims or "slack_storms" not in result:
        return []
    counts = result["slack_storms"].sum(("direction", "speed")).values.tolist()
    storms = int(np.prod([result.sizes[name] for name in ("direction", "speed", "storm")]))
    names = [f"{_name(result, g)} ({count} of {storms} storms)" for g, count in enumerate(counts) if count]
    return ["", "slack guys: " + ("; ".join(names) or "none"), *_broken(result)]


def _broken(result: xr.Dataset) -> list[str]:
    """Return the guys that break by name, with the time."""
    if "guy_breaks" not in result.coords:
        return []
    times = result["guy_breaks"].values.tolist()
    names = [f"{_name(result, g)} at {time:g} s" for g, time in enumerate(times) if math.isfinite(time)]
    return [
        f"broken guys: {'; '.join(names)}; they count as slack only before",
        "buckling: of the mast with all guys; after break: without the broken ones, - where it then has no rest or falls",
    ]


def _name(result: xr.Dataset, guy: int) -> str:
    """Return a guy by number, level and direction from the mast to its anchor."""
    x, _, z = result["anchor"][guy].values
    return f"guy {result['guy'].values[guy]} at {float(result['guy_level'][guy]):g} m towards {direction(x, z)}"


def _table(rows: Sequence[Row], columns: Sequence[Column]) -> list[str]:
    """Return rows as aligned lines, with the columns that they have; numbers to the right, a last text to the left."""
    used = [column for column in columns if any(column[0] in row for row in rows)]
    used = [column for column in used if column[0] != "failed storms" or any(row[column[0]] for row in rows)]
    cells = [[head for _, head, _, _ in used]]
    for row in rows:
        cells.append([_cell(row[key], form, factor) if key in row else "" for key, _, form, factor in used])
    widths = [max(len(line[k]) for line in cells) for k in range(len(used))]
    last = len(used) - 1
    return [
        ("  " + "  ".join(
            cell if k == last and used[k][2] == "s" else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        )).rstrip()
        for line in cells
    ]  # fmt: skip


def _cell(value: Any, form: str, factor: float) -> str:
    """Return one value as text; numbers that are not there as a dash."""
    if isinstance(value, str) or form in ("", "s"):
        return str(value)
    if form != "d" and not math.isfinite(value):
        return "-" if math.isnan(value) else "inf"
    return format(round(value) if form == "d" else factor * value + 0.0, form)
