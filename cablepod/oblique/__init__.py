"""Test functions of the condensed model, trained over trajectories (oblique projection).

.. include:: README.md
"""

from cablepod.oblique._train import train

__all__ = ["train"]
