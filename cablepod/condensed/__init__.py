"""The condensed model: quasi-static along the chord, modes for the deflection normal to it.

.. include:: README.md
"""

from cablepod.condensed._prepared import prepare, resume
from cablepod.condensed._prepared_model import PreparedModel
from cablepod.condensed._simulate import simulate
from cablepod.condensed._vibration import vibration_modes

__all__ = ["PreparedModel", "prepare", "resume", "simulate", "vibration_modes"]
