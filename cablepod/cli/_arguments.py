"""Convert arguments and options of the commands to values; complete them in the shell."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from cablepod._models import MODELS
from cablepod.errors import ArchiveError, SceneError
from cablepod.examples import scenes


def folder(text: str) -> Path:
    """Return the folder of ``--out``."""
    if not text.strip():
        raise ArchiveError("--out: given nothing; allowed: a folder, . for this one")
    return Path(text)


def ranks(text: str) -> list[int]:
    """Return the numbers of modes of ``--ranks``, in rising order."""
    try:
        ranks = sorted({int(rank) for rank in text.split(",")})
    except ValueError:
        ranks = []
    if not ranks or ranks[0] < 1:
        raise SceneError(f"--ranks: given {text!r}; allowed: whole numbers of at least 1 with commas between")
    return ranks


def model_options(texts: Iterable[str]) -> dict[str, Any]:
    """Return the values of all ``--option`` by name; the last one of a name counts."""
    found: dict[str, Any] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise SceneError(f"--option: given {text!r}; allowed: NAME=VALUE, such as step=1e-3")
        try:
            found[name] = tomllib.loads(f"value = {value}")["value"]
        except ValueError:
            found[name] = value  # unquoted text
    return found


@contextmanager
def as_options() -> Iterator[None]:
    """Rewrite errors on arguments of :func:`cablepod.study.run` as errors on options of the command."""
    try:
        yield
    except (ArchiveError, SceneError) as error:
        text = str(error)
        if text.startswith(("out: given", "ranks: given")):
            error.args = ("--" + text,)
        raise


# --- options ----------------------------------------------------------------------------------------------------------

F = TypeVar("F", bound=Callable[..., Any])


def file_option(name: str, text: str, *, metavar: str = "FILE", **options: Any) -> Callable[[F], F]:
    """Make an option of a file."""
    return click.option(name, metavar=metavar, shell_complete=complete_file, help=text, **options)


def folder_option(text: str, *, required: bool = False) -> Callable[[F], F]:
    """Make the option ``--out`` of a folder."""
    return click.option("--out", required=required, metavar="DIR", shell_complete=complete_folder, help=text)


def overwrite_option(text: str) -> Callable[[F], F]:
    """Make the option ``--overwrite``."""
    return click.option("--overwrite", is_flag=True, help=text)


# --- completion -------------------------------------------------------------------------------------------------------


def complete_example(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a shipped scene."""
    return [CompletionItem(name) for name in scenes() if name.startswith(incomplete)]


def complete_scene(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete a scene file, or the name of a shipped scene."""
    # files first: click's function for bash drops names before them
    return [CompletionItem(incomplete, type="file"), *complete_example(context, parameter, incomplete)]


def complete_file(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the path of a file."""
    return [CompletionItem(incomplete, type="file")]


def complete_folder(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the path of a folder."""
    return [CompletionItem(incomplete, type="dir")]


def complete_model(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a model of ``cablepod ensemble``."""
    return [CompletionItem(name) for name in MODELS if name.startswith(incomplete)]
