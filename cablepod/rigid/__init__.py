"""Chain of rigid links, a system of differential and algebraic equations.

.. include:: README.md
"""

from cablepod.rigid._simulate import rest, simulate

__all__ = ["rest", "simulate"]
