"""Units for people: in which quantities are printed in tables and drawn in figures; results and files stay in SI."""

from __future__ import annotations

import math
import re
from typing import Any

#: SI unit -> size from which on, factor and name of the unit in which it is printed; "%" is a ratio in per cent.
PRINTED: dict[str, tuple[tuple[float, float, str], ...]] = {
    "N": ((1e7, 1e-6, "MN"), (1e3, 1e-3, "kN"), (0.0, 1.0, "N")),
    "N m": ((1e3, 1e-3, "kN m"), (0.0, 1.0, "N m")),
    "m": ((1.0, 1.0, "m"), (0.0, 1e3, "mm")),
    "Pa": ((0.0, 1e-6, "MPa"),),
    "rad": ((0.0, 180.0 / math.pi, "degrees"),),
    "rad s-1": ((0.0, 0.5 / math.pi, "Hz"),),
    "kg m-1": ((0.0, 1.0, "kg/m"),),
    "kg m-3": ((0.0, 1.0, "kg/m3"),),
    "N m-1": ((0.0, 1.0, "N/m"),),
    "%": ((0.0, 100.0, "%"),),
    "1": ((0.0, 1.0, ""),),
}
#: Size by which the unit of a zero is chosen.
SIZE_OF_ZERO = 1e3
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def printed_unit(units: str, size: float = SIZE_OF_ZERO) -> tuple[float, str]:
    """Return factor and name of the unit in which quantities in an SI unit are printed.

    Parameters
    ----------
    units
        SI unit; one that is not in :data:`PRINTED` is printed as it is.
    size
        Largest of the quantities, which decides between kN and N, m and mm.
    """
    steps = PRINTED.get(units, ((0.0, 1.0, units),))
    size = abs(size) if size and math.isfinite(size) else SIZE_OF_ZERO
    return next((factor, name) for least, factor, name in steps if size >= least)


def printed(value: float, units: str, count: int = 5) -> str:
    """Return a quantity in an SI unit as text, in the unit in which it is printed.

    Examples
    --------
    >>> [printed(15000.0, "N"), printed(0.0894, "m"), printed(6.2832, "rad s-1"), printed(0.083, "%")]
    ['15 kN', '89.4 mm', '1 Hz', '8.3 %']
    """
    factor, name = printed_unit(units, value)
    return f"{digits(factor * value, count)} {name}".rstrip()


def unit_text(units: str) -> str:
    """Return units as they are printed: m/s² for "m s-2", nothing for "1".

    Examples
    --------
    >>> [unit_text(units) for units in ("m s-2", "N m2", "1", "kN", "rad s-1", "s-1")]
    ['m/s²', 'N m²', '', 'kN', 'rad/s', 's⁻¹']
    """
    if units == "1":
        return ""
    over, under = [], []
    for token in units.split():
        found = re.fullmatch(r"([A-Za-z]+)(-?\d+)", token)
        if found is None:
            over.append(token)
        elif found[2].startswith("-"):
            under.append((found[1], found[2]))
        else:
            over.append(found[1] + found[2].translate(SUPERSCRIPTS))
    if len(under) == 1 and over:
        name, power = under[0]
        return " ".join(over) + "/" + name + ("" if power == "-1" else power[1:].translate(SUPERSCRIPTS))
    return " ".join([*over, *(name + power.translate(SUPERSCRIPTS) for name, power in under)])


def digits(value: float, count: int = 5) -> str:
    """Return a number with so many digits, a large one without exponent."""
    return f"{value:.0f}" if 10.0**count <= abs(value) < 1e9 else f"{value:.{count}g}"


def note_lines(summary: Any) -> list[str]:
    """Return the notes of the summary of a scene, or of members, one a line."""
    return [line for text in summary["note"].values.ravel().tolist() for line in str(text).split("\n") if line]


def direction(x: float, z: float) -> str:
    """Return a horizontal direction as the angle from +x towards +z, from 0 to 360 degrees."""
    return f"{round(math.degrees(math.atan2(z, x)), 1) % 360.0:g} deg"
