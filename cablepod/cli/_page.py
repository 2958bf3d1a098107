"""Write the results of a command as a page, with the notes that it gave."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from cablepod.cli import _arguments
from cablepod.errors import SceneError

#: The option of every command that ends with results.
OPTION = click.option(
    "--report", "page", metavar="FILE.html", shell_complete=_arguments.complete_file,
    help="also write all of it as one page, to be read, printed or attached; its folder is made if missing",
)  # fmt: skip


@contextmanager
def heard() -> Iterator[list[str]]:
    """Collect the texts of the warnings in the block, which are printed as before."""
    texts: list[str] = []
    before = warnings.showwarning

    def show(message: Warning | str, *arguments: Any, **options: Any) -> None:
        texts.append(str(message))
        before(message, *arguments, **options)

    warnings.showwarning = show
    try:
        yield texts
    finally:
        warnings.showwarning = before


def checked(page: str | None) -> Path | None:
    """Return the path of ``--report`` with its folder made, or refuse it before anything runs; None without the option."""
    if page is None:
        return None
    from cablepod.plots._page import checked_path

    try:
        if page.strip() and not Path(page).parent.exists():
            Path(page).parent.mkdir(parents=True)
        return checked_path(page)
    except SceneError as error:
        error.args = (str(error).replace("path: given", "--report: given", 1),)
        raise


def write(page: Path | None, results: Any, *, text: str, notes: list[str], **options: Any) -> str:
    """Write results as a page; return a line that says so, empty without a path.

    Parameters
    ----------
    page
        What :func:`checked` gave.
    results, options
        As for :func:`cablepod.plots.report`.
    text
        What the command prints.
    notes
        What :func:`heard` gave.
    """
    if page is None:
        return ""
    from cablepod import plots  # slow to import

    plots.report(results, page, text=text, warnings=notes, **options)
    return f"report    {page}"
