"""Columns and words of the statistics of tensions, and the files of a study, as ``cablepod run`` prints them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

#: Heads of :func:`columns`.
HEADS = "".join(f"{head:>9}" for head in ("mean", "std", "least", "peak", "at [s]")) + f"{'fatigue':>10}"


def columns(row: Mapping[str, Any]) -> str:
    """Return mean, standard deviation, extremes of a tension in kN, instant of the peak in s, fatigue range in kN."""
    numbers = "".join(f"{1e-3 * row[name]:>9.3f}" for name in ("mean", "std", "least", "peak"))
    return f"{numbers}{row['peak_time']:>9.2f}{1e-3 * row['fatigue_range']:>10.3f}"


def part_of_run(attrs: Mapping[Any, Any]) -> str:
    """Say of which part of a run its statistics are."""
    if not attrs.get("window_start"):
        return "statistics over the whole run"
    return f"statistics from {attrs['window_start']:g} s, where the last ramp ends, to {attrs['window_end']:g} s"


def fatigue_text(attrs: Mapping[Any, Any]) -> str:
    """Say what a fatigue range is."""
    return f"fatigue: equivalent range of rainflow cycles, exponent {attrs['exponent']:g}, at {attrs['frequency']:g} Hz"


def finite(value: Any) -> float | None:
    """Return a finite number; None for nan, which JSON has not."""
    number = float(value)
    return number if math.isfinite(number) else None


def files_text(folder: Path, figures: Iterable[str]) -> str:
    """Return the files of a study: figures in the order of their worth, then the files of data."""
    names = {path.name for path in folder.iterdir()}
    drawn = [f"{name}.png" for name in figures if f"{name}.png" in names]
    return f"{folder}: {', '.join([*drawn, *sorted(name for name in names if name.endswith('.nc'))])}"
