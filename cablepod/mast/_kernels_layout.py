"""Entries of the arrays that kernels of masts fill."""

from __future__ import annotations

#: Entries of extremes: least and largest value, and the steps at which they occur.
LEAST, LARGEST, LEAST_STEP, LARGEST_STEP = range(4)
#: Lanes of guys, modes of guys and nodes of masts are padded to multiples of these numbers.
LANES, MODES_TOGETHER, NODES_TOGETHER = 16, 4, 8
