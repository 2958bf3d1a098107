"""The main job on one scene: rest, chain, modes, reduced models, and their errors beside their run times.

The command ``cablepod run`` calls :func:`run`.
"""

from cablepod.study._run import run
from cablepod.study._summary import summary

__all__ = ["run", "summary"]
