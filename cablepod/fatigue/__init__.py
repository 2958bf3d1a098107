"""Rainflow cycles of a series and its equivalent range.

.. include:: README.md
"""

from cablepod.fatigue._cycles import equivalent, ranges

__all__ = ["equivalent", "ranges"]
