"""Wind on a cable: mean profile, turbulence at given points, velocity of the air for the models.

.. include:: README.md
"""

from cablepod.wind._field import field

__all__ = ["field"]
