"""Mean and quantile of peaks, with their intervals.

.. include:: README.md
"""

from cablepod.extremes._peaks import peaks

__all__ = ["peaks"]
