"""Compiled loops: one self-contained file for each system, floats and arrays only.

Nothing here is imported before a function that computes is called, because importing numba takes longer than all else.
"""
