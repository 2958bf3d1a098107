"""Time integration shared by the models: request, output times, step control, checks of a run.

.. include:: README.md
"""
