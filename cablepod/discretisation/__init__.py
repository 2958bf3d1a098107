"""Discretisation in space shared by the models: lumped chain, chord frame, similarity numbers.

.. include:: README.md
"""
