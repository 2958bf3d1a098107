"""A mast and its guys: rest, frequencies and motion.

.. include:: README.md
"""

from cablepod.mast._frequencies import frequencies
from cablepod.mast._rest import rest
from cablepod.mast._simulate import simulate
from cablepod.mast._summary import summary

__all__ = ["frequencies", "rest", "simulate", "summary"]
