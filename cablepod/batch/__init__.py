"""Many members of a scene in one call: threads, interruption, joined results.

.. include:: README.md
"""
