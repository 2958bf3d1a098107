"""Share command line, result files, page tables and timing between the studies.

A script in a folder begins with::

    if __name__ == "__main__":
        sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

so that ``python pipelines/<study>/run.py`` finds this module and its neighbours by folder
(``from prediction.scenes import Case``) from anywhere; for tests ``pythonpath`` of pytest names the folder ``pipelines``.

Tables of a page (the README.md beside a script) stand between two comments, ``<!-- begin: NAME -->`` and
``<!-- end: NAME -->``, each on a line of its own.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from unittest import mock

if TYPE_CHECKING:
    import xarray as xr

#: Environment of a study on one thread, set before numpy is imported.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

# --- command line -----------------------------------------------------------------------------------------------------


def command_line(
    doc: str | None,
    *,
    out: str | Path | None = None,
    readme: bool = False,
    quick: str = "",
    repeats: int | None = None,
) -> argparse.ArgumentParser:
    """Make the parser of a script with the common arguments that it has.

    Parameters
    ----------
    doc
        Docstring of the script, shown by ``--help``.
    out
        Default of ``--out``.
    readme
        Whether the script writes to the page beside it.
    quick
        Help of ``--quick``: what the small setting is.
    repeats
        Default of ``--repeats``.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if out is not None:
        parser.add_argument("--out", type=Path, default=Path(out), metavar="FOLDER", help="folder of the results")
    if readme:
        parser.add_argument(
            "--readme", action="store_true", help="also write tables and figure of the page beside the script"
        )
    if quick:
        parser.add_argument("--quick", action="store_true", help=quick)
    if repeats is not None:
        parser.add_argument(
            "--repeats", type=int, default=repeats, help=f"runs of which the median is taken ({repeats})"
        )
    return parser


# --- results, figures, tables -----------------------------------------------------------------------------------------


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def percent(value: float) -> str:
    """Write a fraction in per cent with two digits; "-" if it is not finite."""
    return f"{100.0 * value:.2g} %" if isfinite(value) else "-"


def show_table(name: str, table: str, page: Path | None = None) -> None:
    """Print a table, and write it to a page in a folder."""
    print(table, flush=True)
    if page is not None:
        update_tables(page / "README.md", {name: table})


def short(value: float) -> str:
    """Return a number with two digits, or its integer."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def update_tables(page: Path, tables: Mapping[str, str]) -> None:
    """Replace tables of a page by name; name those without a place in the page."""
    text = old = page.read_text(encoding="utf-8") if page.exists() else ""
    for name, table in tables.items():
        first, last = f"<!-- begin: {name} -->", f"<!-- end: {name} -->"
        head, found, rest = text.partition(first)
        _, closed, tail = rest.partition(last)
        if found and closed:
            text = f"{head}{first}\n{table.strip()}\n{last}{tail}"
        else:
            print(f"{page}: no place for table {name} between {first} and {last}")
    if text != old:
        page.write_text(text, encoding="utf-8")


def publish(
    out: Path,
    name: str,
    result: xr.Dataset | None,
    *,
    draw: Callable[[Path], Any],
    page: Path | None = None,
    tables: Mapping[str, str] | None = None,
    draw_small: Callable[[Path], Any] | None = None,
) -> None:
    """Write NAME.nc and NAME.png to `out`, and figure and tables to a page.

    Parameters
    ----------
    out
        Folder of the results.
    name
        Name of the files.
    result
        Result of the study; None for one read from a file.
    draw
        Draws the figure into a file.
    page
        Folder of the page, with ``--readme``.
    tables
        Tables of the page by name.
    draw_small
        Draws the figure of the page, where it is another one.
    """
    import cablepod as cp

    out.mkdir(parents=True, exist_ok=True)
    if result is not None:
        cp.archive.write(result, out / f"{name}.nc", overwrite=True)
    draw(out / f"{name}.png")
    if page is not None:
        (draw_small or draw)(page / f"{name}.png")
        update_tables(page / "README.md", tables or {})


# --- time -------------------------------------------------------------------------------------------------------------


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a call and its wall time [s]."""
    begin = time.perf_counter()
    result = call()
    return result, time.perf_counter() - begin


def median_time(call: Callable[[], Any], repeats: int) -> float:
    """Return the median wall time of a call [s]; warm-up runs are the caller's."""
    return statistics.median(timed(call)[1] for _ in range(repeats))


def in_turns(jobs: Sequence[Callable[[], Any]], repeats: int) -> list[list[Any]]:
    """Call all jobs in turns; return results by job.

    A busy machine then slows all of them.
    """
    results: list[list[Any]] = [[] for _ in jobs]
    for _ in range(repeats):
        for result, job in zip(results, jobs, strict=True):
            result.append(job())
    return results


def medians(rows: Iterable[Sequence[float]]) -> tuple[float, ...]:
    """Return the median of each column."""
    return tuple(statistics.median(column) for column in zip(*rows, strict=True))


@contextmanager
def wrapped(wrap: Callable[[Callable[..., Any]], Callable[..., Any]], *names: str) -> Iterator[None]:
    """Replace functions, given by dotted names, by ``wrap(function)`` within the block.

    Modules that import a function by its name see the replacement too, except kernels, which call compiled functions only.
    """
    with ExitStack() as stack:
        for name in names:
            function = pkgutil.resolve_name(name)
            replacement, importers = wrap(function), _importers(function, name.partition(".")[0])
            stack.enter_context(mock.patch(name, replacement))
            for module, alias in importers:
                stack.enter_context(mock.patch.object(module, alias, replacement))
        yield


def _importers(function: Callable[..., Any], package: str) -> list[tuple[ModuleType, str]]:
    """List the modules of a package that import a function by name, with that name, but for kernels."""
    root = getattr(importlib.import_module(package), "__path__", [])
    for found in pkgutil.walk_packages(root, f"{package}."):
        if "._kernels" not in found.name and not found.name.endswith("__main__"):
            importlib.import_module(found.name)  # one that is loaded later would keep the replacement
    modules = [
        module
        for name, module in sys.modules.items()
        if name.partition(".")[0] == package and "._kernels" not in name and module is not None
    ]
    return [(module, name) for module in modules for name, value in vars(module).items() if value is function]


@dataclass
class Stopwatch:
    """Time spent so far [s]."""

    seconds: float = 0.0


@contextmanager
def time_inside(*names: str, clock: Callable[[], float] = time.perf_counter) -> Iterator[Stopwatch]:
    """Add up the time spent inside functions, given by dotted names, within the block."""
    watch = Stopwatch()

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **options: Any) -> Any:
            begin = clock()
            result = function(*arguments, **options)
            watch.seconds += clock() - begin
            return result

        return run

    with wrapped(watched, *names):
        yield watch


def count(loops: int) -> int:
    """Add up the numbers below `loops`, in Python."""
    total = 0
    for i in range(loops):
        total += i
    return total


def two_process_gain(loops: int) -> float:
    """Return the work of two counting processes over that of one."""
    with ProcessPoolExecutor(2) as pool:
        list(pool.map(count, (loops, loops)))
        one = median_time(lambda: pool.submit(count, loops).result(), 3)
        two = median_time(lambda: list(pool.map(count, (loops, loops))), 3)
    return 2.0 * one / two
