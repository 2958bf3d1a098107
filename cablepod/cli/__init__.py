"""The command ``cablepod``, by click: the main job on one scene, ensembles, the paper, and what a file is.

.. include:: README.md
"""

from cablepod.cli._commands import main

__all__ = ["main"]
