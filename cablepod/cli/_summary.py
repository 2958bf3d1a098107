"""Format the table of ``cablepod check``."""

from __future__ import annotations

import math

import xarray as xr

#: Lines of the table: text, name, unit as printed, factor from SI.
LINES = (
    ("chord", "chord", "m", 1.0),
    ("inclination of the chord", "inclination", "degrees", 180.0 / math.pi),
    ("weight", "weight_per_length", "N/m", 1.0),
    ("mass", "mass_per_length", "kg/m", 1.0),
    ("density", "density", "kg/m3", 1.0),
    ("axial stiffness EA", "axial_stiffness", "MN", 1e-6),
    ("unstretched length", "unstretched_length", "m", 1.0),
    ("tension, upper end", "tension_upper", "N", 1.0),
    ("tension, lower end", "tension_lower", "N", 1.0),
    ("stress", "stress", "MPa", 1e-6),
    ("strain", "strain", "%", 100.0),
    ("sag", "sag", "m", 1.0),
    ("sag over chord", "sag_over_chord", "%", 100.0),
    ("Irvine's lambda squared", "irvine_parameter", "", 1.0),
    ("loads over weight", "load_over_weight", "", 1.0),
    ("motion over chord", "motion_over_chord", "%", 100.0),
    ("breaking strength", "breaking_strength", "N", 1.0),
    ("utilisation at rest", "utilisation", "%", 100.0),
)
FREQUENCIES = (
    ("first frequencies in plane", "in_plane"),
    ("first frequencies out of plane", "out_of_plane"),
)


def table(summary: xr.Dataset) -> str:
    """Return the numbers of a summary one a line, its frequencies in Hz and rad/s, and its notes."""
    lines = [
        f"  {text:<32}{_digits(factor * float(summary[name]))} {unit}".rstrip()
        for text, name, unit, factor in LINES
        if name in summary and not math.isnan(float(summary[name]))
    ]
    for text, plane in FREQUENCIES:
        hertz, omega = (
            "  ".join(map(_digits, summary[f"{kind}_{plane}"].values)) for kind in ("frequency", "angular_frequency")
        )
        lines.append(f"  {text:<32}{hertz} Hz  ({omega} rad/s)" if "nan" not in hertz else f"  {text:<32}none")
    hertz, omega = (_digits(float(summary[f"first_axial_frequency{end}"])) for end in ("_hertz", ""))
    lines.append(f"  {'first axial frequency':<32}{hertz} Hz  ({omega} rad/s)")
    notes = [line for line in str(summary["note"].values).split("\n") if line]
    return "\n".join([*lines, *(f"  note: {note}" for note in notes)])


def _digits(value: float) -> str:
    """Return a number with five digits, a large one without exponent."""
    return f"{value:.0f}" if 1e5 <= abs(value) < 1e9 else f"{value:.5g}"
