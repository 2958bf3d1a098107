"""Range of validity of the reduced models.

.. include:: README.md
"""
