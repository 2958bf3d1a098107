"""The continuous extensible cable, eqs. (17)-(23) of the paper, by spectral elements.

.. include:: README.md
"""

from cablepod.cable._frequencies import frequencies
from cablepod.cable._simulate import rest, simulate
from cablepod.cable._summary import summary

__all__ = ["frequencies", "rest", "simulate", "summary"]
