"""Define the command of stringing tables: tension, sag and first frequencies over temperature."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive
from cablepod.archive._figure import write_figure
from cablepod.archive._folder import check_folder, new_results
from cablepod.cli import _arguments, _group, _page
from cablepod.cli._group import say
from cablepod.conventions import STILL_AIR
from cablepod.errors import SceneError, named
from cablepod.examples import scene_path
from cablepod.parameters._keys import TOP
from cablepod.scene._files import LARGEST_SCENE, read_text
from cablepod.scene._read import read_scene

#: Files of the command.
TABLE, FIGURES = "stringing.nc", ("tension.png", "sag.png")
#: Variable, head of its column, factor, digits after the point.
COLUMNS = (
    ("tension_upper", "upper kN", 1e-3, 3),
    ("tension_lower", "lower kN", 1e-3, 3),
    ("horizontal_force", "horizontal kN", 1e-3, 3),
    ("sag", "sag m", 1.0, 3),
    ("unstretched_length", "length m", 1.0, 3),
    ("utilisation", "used %", 100.0, 1),
)
#: Head of the horizontal force in wind, where the load is not vertical.
ACROSS = "across load kN"


def stringing(
    scene: str, temperatures: tuple[float, float, float], cases: str | None, out: str | None, page: str | None,
    overwrite: bool
) -> None:  # fmt: skip
    """Print the table of a scene; with a folder write it and its figures, with the path of a page this."""
    _group.import_matplotlib()
    values = _temperatures(temperatures)
    named_cases = None if cases is None else _cases(Path(cases))
    dataset = read_scene(scene_path(scene))
    target, folder = _page.checked(page), None
    if out is not None:
        folder = _arguments.folder(out)
        check_folder(folder, (TABLE, *FIGURES), overwrite=overwrite, key="--out")
    from cablepod import catenary  # its imports take a second

    with _page.heard() as notes:
        table = catenary.stringing(dataset, values, cases=named_cases)
    text = "\n".join(_lines(table))
    say(text)
    if folder is not None:
        _write(table, folder)
    written = _page.write(target, {"scene": dataset, "stringing": table}, text=text, notes=notes)
    if written:
        say(written)


def _write(table: xr.Dataset, folder: Path) -> None:
    """Write a table and its figures into a folder, and say so."""
    from cablepod import plots

    with new_results(folder, (TABLE, *FIGURES)) as new:
        archive.write(table, new / TABLE)
        for name, variable in zip(FIGURES, ("tension_upper", "sag"), strict=True):
            figure: Any = plots.stringing(table, variable=variable).figure
            write_figure(figure, new / name)
    say(f"\n{folder}: {TABLE}, {', '.join(FIGURES)}")


def _temperatures(given: tuple[float, float, float]) -> list[float]:
    """Return the temperatures of the option [degC]."""
    low, high, count = given
    for value in (low, high):
        TOP["temperature"].check("--temperatures", value)
    if not low < high or not float(count).is_integer() or not 2 <= count <= 10**6:
        shown = " ".join(f"{value:g}" for value in given)
        raise SceneError(f"--temperatures: given {shown}; allowed: LOW below HIGH, and a whole COUNT of at least 2")
    return [float(value) for value in np.linspace(low, high, int(count))]


def _cases(path: Path) -> dict[str, Any]:
    """Read the cases of a TOML file."""
    name = named(str(path))
    text = read_text(path, "TOML file of cases, tables [NAME.ice], [NAME.wind]", LARGEST_SCENE, key="--cases")
    try:
        found = tomllib.loads(text)
    except ValueError as error:
        raise SceneError(
            f"--cases: {name}: not a TOML file: {error}; allowed: tables [NAME.ice], [NAME.wind]"
        ) from None
    if not found:
        raise SceneError(f"--cases: {name}: has no tables; allowed: tables [NAME.ice], [NAME.wind], or [NAME]")
    return found


def _lines(table: xr.Dataset) -> Iterator[str]:
    """Yield the lines of the printed table, in kN, m and Hz."""
    is_of_cases = "case" in table.dims
    yield table.attrs["title"] + ("" if is_of_cases else f", at rest in {table.attrs['air']}")
    in_wind = table.attrs["air"] != STILL_AIR
    columns = [
        (name, ACROSS if in_wind and name == "horizontal_force" else head, factor, digits)
        for name, head, factor, digits in COLUMNS if name in table
    ]  # fmt: skip
    names = [str(name) for name in table["case"].values] if is_of_cases else [""]
    width = max(map(len, (*names, "case"))) + 2 if is_of_cases else 0
    heads = "".join(f"{head:>{len(head) + 3}}" for _, head, _, _ in columns)
    yield f"  {'case' if is_of_cases else '':<{width}}{'degC':>7}{heads}   first frequencies Hz"
    for name in names:
        rows = table.sel(case=name) if is_of_cases else table
        for k, temperature in enumerate(rows["temperature"].values):
            row = rows.isel(temperature=k)
            cells = [
                f"{factor * float(row[variable]):>{len(head) + 3}.{digits}f}"
                for variable, head, factor, digits in columns
            ]
            hertz = "".join(f"{value:<9.4g}" for value in row["frequency"].values if not np.isnan(value)) or "not taut"
            yield f"  {name:<{width}}{temperature:>7g}{''.join(cells)}   {hertz}".rstrip()
    if in_wind:
        yield "  load: the sum of weight and drag; the sag is along it"
