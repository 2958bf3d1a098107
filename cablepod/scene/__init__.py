"""Make scene Datasets from TOML files or Python values, with all checks of user input.

.. include:: README.md
"""

from cablepod.scene._make import make_scene
from cablepod.scene._read import read_scene

__all__ = ["make_scene", "read_scene"]
