"""Alias of :mod:`cablepod.archive._lineage` for the names that lineage scripts of users call."""

from cablepod.archive._lineage import ancestors, changed, check, script

__all__ = ["ancestors", "changed", "check", "script"]
