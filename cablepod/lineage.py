"""Alias of the check that lineage scripts of users name; it lives in the archive."""

from cablepod.archive._lineage import ancestors, check, script

__all__ = ["ancestors", "check", "script"]
