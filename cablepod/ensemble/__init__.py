"""Ensembles of scenes: design, parallel runs into a folder, continuation of interrupted runs.

.. include:: README.md
"""

from cablepod.ensemble._design import design
from cablepod.ensemble._run import batches, run

__all__ = ["batches", "design", "run"]
