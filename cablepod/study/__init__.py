"""The main job on one scene: rest, chain, modes, reduced models, and their errors beside their run times.

The command ``cablepod run`` calls :func:`run`, ``cablepod design`` :func:`design`: storms of all directions and speeds on a mast
or a guy.
"""

from cablepod.study._design import design
from cablepod.study._run import run
from cablepod.study._summary import summary

__all__ = ["design", "run", "summary"]
