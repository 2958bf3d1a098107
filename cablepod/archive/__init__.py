"""Datasets as netCDF files that tell where they come from: write, read, describe.

.. include:: README.md
"""

from cablepod.archive._ensemble import open_ensemble
from cablepod.archive._read import ArchiveError
from cablepod.archive._write import describe, read, write

__all__ = ["ArchiveError", "describe", "open_ensemble", "read", "write"]
