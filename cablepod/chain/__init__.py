"""Elastic chain of lumped masses, eqs. (1)-(3) of the paper with corrected signs.

.. include:: README.md
"""

from cablepod.chain._simulate import rest, simulate

__all__ = ["rest", "simulate"]
