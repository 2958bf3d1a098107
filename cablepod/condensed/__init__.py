"""The condensed model: quasi-static along the chord, modes for the deflection normal to it.

.. include:: README.md
"""

from cablepod.condensed._simulate import simulate

__all__ = ["simulate"]
