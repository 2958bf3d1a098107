"""Rainflow cycles of a series, its equivalent range and its damage.

.. include:: README.md
"""

from cablepod.fatigue._cycles import damage, equivalent, ranges

__all__ = ["damage", "equivalent", "ranges"]
