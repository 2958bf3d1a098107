"""Periodic responses of the condensed model, their stability and bifurcations.

.. include:: README.md
"""

from cablepod.periodic._backbone import backbone
from cablepod.periodic._frequency_response import frequency_response
from cablepod.periodic._orbit import orbit
from cablepod.periodic._stability_map import stability_map

__all__ = ["backbone", "frequency_response", "orbit", "stability_map"]
