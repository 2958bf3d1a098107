"""Alias of what lineage scripts in users' files name; it lives in :mod:`cablepod.archive`."""

from cablepod.archive._lineage import ancestors, changed, check, script

__all__ = ["ancestors", "changed", "check", "script"]
