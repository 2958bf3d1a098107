"""Many scenes: designed, run in parallel, archived so that an interrupted run goes on.

.. include:: README.md
"""

from cablepod.ensemble._design import design
from cablepod.ensemble._run import batches, run

__all__ = ["batches", "design", "run"]
