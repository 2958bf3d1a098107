"""The paper reproduced: its tables and figures beside our own, a module for each piece.

.. include:: README.md
"""
