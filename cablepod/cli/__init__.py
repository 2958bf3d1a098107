"""Provide the command ``cablepod``: studies of one scene, ensembles, the paper, descriptions of files.

.. include:: README.md
"""

from cablepod.cli._commands import main

__all__ = ["main"]
