"""Names that lineage scripts of users call, of :mod:`cablepod.archive._lineage` and :mod:`cablepod.archive._repeated`."""

from cablepod.archive._lineage import ancestors, script
from cablepod.archive._repeated import RepeatedWarning, changed, check, selected

__all__ = ["RepeatedWarning", "ancestors", "changed", "check", "script", "selected"]
