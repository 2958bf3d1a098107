"""A scene as plain numbers: keys and their checks, parameters, time functions.

.. include:: README.md
"""
