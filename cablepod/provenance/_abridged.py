"""Long texts of attributes, of which the reprs of xarray show an abstract."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

#: Attributes of which the reprs of xarray show an abstract.
ABRIDGED = ("history", "history_json", "ensemble_json")
#: Modules that make text and HTML of a Dataset, and the maximum length of a text that they show as it is.
XARRAY_REPRS, MAX_SHOWN = ("xarray.core.formatting", "xarray.core.formatting_html"), 120


class Abridged(str):
    """Text of an attribute, of which the reprs of xarray show an abstract in place of a page.

    For all others it is the whole text: ``str``, ``repr``, ``json.loads``, files, copies, comparisons and hashes are those of a
    plain ``str``.  If a version of xarray calls ``str`` from another module, its reprs show the text.
    """

    __slots__ = ()

    def __str__(self) -> str:
        """Return the whole text, but to the reprs of xarray the abstract."""
        caller = sys._getframe(1).f_globals.get("__name__")
        return self.abstract if caller in XARRAY_REPRS else str.__str__(self)

    @property
    def abstract(self) -> str:
        """One line: number and last of the stages of a history, or the keys of a table; a short text as it is."""
        if len(self) <= MAX_SHOWN:
            return str.__str__(self)
        try:
            content = json.loads(self)
            if isinstance(content, dict):
                return f"<table of {', '.join(content)}>"
            count = f"{len(content)} stage{'s' * (len(content) > 1)}"
            return f"<{count} up to {content[-1]['function']}, see archive.describe>"
        except (ValueError, TypeError, KeyError, IndexError):  # not JSON, or not of this package
            return f"<{len(self.splitlines())} lines, see archive.describe>"


def abridged(attrs: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return attributes, as read from a file, with long texts as :class:`Abridged`."""
    return {
        name: Abridged(value) if name in ABRIDGED and isinstance(value, str) else value for name, value in attrs.items()
    }
