"""netCDF files with provenance: write, read, describe, open ensembles.

.. include:: README.md
"""

from cablepod.archive._describe import describe
from cablepod.archive._open_ensemble import open_ensemble
from cablepod.archive._read import read
from cablepod.archive._write import write
from cablepod.errors import ArchiveError

__all__ = ["ArchiveError", "describe", "open_ensemble", "read", "write"]
