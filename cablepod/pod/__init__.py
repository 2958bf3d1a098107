"""Karhunen-Loeve decomposition (POD): snapshots -> modes; projection and reconstruction.

.. include:: README.md
"""

from cablepod.pod._decompose import decompose
from cablepod.pod._project import at_times, project, reconstruct
from cablepod.pod._stream import Stream

__all__ = ["Stream", "at_times", "decompose", "project", "reconstruct"]
