"""Compiled assignment of vectors of nodes or particles.

Numba's own assignment of whole arrays brings the text of a shape error with it, which takes two seconds to compile.
"""

from cablepod._jit import compiled


@compiled
def assign(target, source):
    """Copy the vectors `source` (dims, nodes) to `target`, of the same shape."""
    for c in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[c, j] = source[c, j]
