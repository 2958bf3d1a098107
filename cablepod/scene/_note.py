"""A note on something unusual in a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple


class Note(NamedTuple):
    """Something unusual in a scene."""

    key: str  #: key path that is likely wrong
    text: str  #: the value and what is usual
    excess: float  #: distance from what is usual, in powers of ten


def outside(
    key: str, what: str, value: float, usual: tuple[float, float], unit: str, question: str = ""
) -> Iterator[Note]:
    """Yield the note of a value outside the usual range, with a question; none of nan."""
    low, high = usual
    if low <= value <= high or not value > 0.0:
        return
    excess = math.log10(low / value if value < low else value / high)
    within = f"up to {high:g}" if low == 0.0 else f"{low:g} to {high:g}"
    unit = f" {unit}" if unit else ""
    question = f"; {question}" if question else ""
    yield Note(key, f"{what} of {value:.3g}{unit} (usual: {within}{unit}{question})", excess)
