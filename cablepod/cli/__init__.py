"""Provide the command ``cablepod``: studies of one scene, ensembles, the paper, descriptions of files.

.. include:: README.md
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status: 0, or not 0 with one line on stderr."""
    from cablepod.cli._commands import commands  # imports the package; :mod:`cablepod.cli._process` is ready before

    return commands.status(None if arguments is None else list(arguments))
