"""Write the report on the paper: a Dataset of all tables, figures, and a Markdown page."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod import archive, provenance
from cablepod.archive._figure import write_figure
from cablepod.archive._folder import new_results, sole_run
from cablepod.paper.sections import FULL, SECTIONS, Section, Size, lines
from cablepod.paper.summary import HEAD, summary

DATASET, PAGE = "paper.nc", "paper.md"
TEMPLATE = Path(__file__).with_name("page.md")
FIGURES = (
    "figure4", "table2", "figure5", "figure6", "figure7", "figure8", "figure9", "routes", "validity",
)  # fmt: skip
FILES = (DATASET, PAGE, *(f"{name}.png" for name in FIGURES))


def write(
    folder: Path, *, size: Size = FULL, progress: Callable[[float], None] | None = None
) -> tuple[xr.Dataset, list[tuple[str, ...]]]:
    """Compute all sections and write :data:`FILES` into a folder; existing ones are replaced at the end.

    Parameters
    ----------
    folder
        Existing folder.
    size
        ``FULL``, or ``SMALL`` for a trial in a fraction of the time.
    progress
        Callback receiving the completed fraction, 0 to 1.

    Returns
    -------
    tuple
        The Dataset of all tables, ours and printed, and the rows of the summary.
    """
    with sole_run(folder), new_results(folder, FILES) as new:
        return _write(new, size, progress)


def _write(
    folder: Path, size: Size, progress: Callable[[float], None] | None
) -> tuple[xr.Dataset, list[tuple[str, ...]]]:
    """Compute all sections and write the files into a folder that has none of them."""
    parts: list[Section] = []
    seconds: list[float] = []
    done = 0.0
    for make, share in SECTIONS:
        begin = time.perf_counter()

        def report(fraction: float, before: float = done, share: float = share) -> None:
            if progress is not None:
                progress(before + share * fraction)

        parts.append(make(size, report))
        done += share
        report(1.0, done - share)
        for name, figure in parts[-1].figures.items():
            write_figure(figure, folder / f"{name}.png", dpi=110)
        seconds.append(time.perf_counter() - begin)
    result = xr.merge([part.data for part in parts], compat="equals", join="exact", combine_attrs="override")
    result.attrs = {"title": "The paper's tables and figures beside our own", "stage": "report"}
    inputs = [part.data for part in parts]
    provenance.record(result, function="paper.report.write", parameters={"size": size.name}, inputs=inputs)
    archive.write(result, folder / DATASET, overwrite=True)
    rows = summary(result)
    (folder / PAGE).write_text(_page(result, parts, rows, seconds, size), encoding="utf-8")
    return result, rows


def _page(
    result: xr.Dataset, parts: Sequence[Section], rows: Sequence[Sequence[str]], seconds: Sequence[float], size: Size
) -> str:
    """Fill the template of the page."""
    values: dict[str, Any] = {"summary": lines(HEAD, rows), "identifier": result.attrs["id"], "size": size.note}
    for part in parts:
        values |= part.values
    each = [f"{part.title} {time:.1f} s" for part, time in zip(parts, seconds, strict=True)]
    values["seconds"] = "; ".join(each) + f"; together {sum(seconds):.0f} s"
    return TEMPLATE.read_text(encoding="utf-8").format_map(values)
