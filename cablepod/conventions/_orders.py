"""Orders of labels, instants and places, found once: what is known to be in order needs no second look."""

from __future__ import annotations

import math
import weakref
from typing import TYPE_CHECKING, Any

from cablepod.conventions._vocabulary import LABELS

if TYPE_CHECKING:
    import numpy as np

#: Indexes whose labels or instants are in order, by name of the dimension and identity.  An index cannot be changed, and an entry
#: is removed as the index goes, before another object can have its identity.
IN_ORDER: dict[Any, dict[int, weakref.ref[Any]]] = {name: {} for name in (*LABELS, "time")}


def note_in_order(name: str, index: Any) -> None:
    """Keep that an index is in order, as long as it exists."""
    known, number = IN_ORDER[name], id(index)
    known[number] = weakref.ref(index, lambda _: known.pop(number, None))


def is_in_order(name: str, labels: Any) -> bool:
    """Tell whether labels of a dimension are those of the package in their order, or instants finite and rising.

    Labels are an array, or an index of pandas.
    """
    own = LABELS.get(name)
    if own is not None:
        return labels.size > 1 and labels.tolist() == own[: labels.size]
    numbers = "fiu" if name == "time" else "iu"
    if labels.dtype.kind not in numbers or not labels.size or labels.ndim > 1:
        return False
    return math.isfinite(labels[0]) and math.isfinite(labels[-1]) and is_rising(labels)


def is_rising(values: np.ndarray) -> bool:
    """Tell whether each number of an array exceeds the one before."""
    return 0 not in (values[1:] > values[:-1]).tobytes()  # the method ``all`` takes five times as long


#: Arc lengths of particles, each followed by the unstretched length, that are in order: bytes of these numbers.
PLACES_IN_ORDER: dict[bytes, None] = {}
#: Maximum number of them, and maximum length of one [bytes].
MAX_PLACES, MAX_PLACES_BYTES = 256, 1 << 14


def keep_places(content: bytes) -> None:
    """Keep that arc lengths and the unstretched length are in order."""
    if 0 < len(content) <= MAX_PLACES_BYTES:
        if len(PLACES_IN_ORDER) >= MAX_PLACES:
            PLACES_IN_ORDER.clear()
        PLACES_IN_ORDER[content] = None


def note_places(arc_length: np.ndarray) -> None:
    """Keep arc lengths (particle,) of a result [m] if they rise from 0; the last is the unstretched length."""
    dtype, size = arc_length.dtype, arc_length.size
    if dtype.char != "d" or not dtype.isnative or arc_length.ndim != 1 or not 1 < size < MAX_PLACES_BYTES // 8:
        return
    content = arc_length.tobytes()
    content += content[-8:]
    if content in PLACES_IN_ORDER or arc_length[0] != 0.0 or not math.isfinite(arc_length[-1]):
        return
    if is_rising(arc_length):
        keep_places(content)
