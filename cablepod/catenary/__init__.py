"""The continuous elastic cable at rest: the exact elastic catenary.

.. include:: README.md
"""

from cablepod.catenary._rest import rest, solve

__all__ = ["rest", "solve"]
