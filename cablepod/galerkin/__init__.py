"""The paper's reduced model, eqs. (34)-(36): Galerkin projection on Karhunen-Loeve modes.

.. include:: README.md
"""

from cablepod.galerkin._simulate import simulate

__all__ = ["simulate"]
