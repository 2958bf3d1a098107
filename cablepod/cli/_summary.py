"""Format the table of ``cablepod check``, and what to know of a scene before it runs."""

from __future__ import annotations

import json
import math

import xarray as xr

from cablepod.conventions import ENDINGS_OF_AIR, digits, note_lines, printed, unit_text
from cablepod.discretisation._modal_damping import KEYS
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._key_paths import key_of_variable, variable_name, variable_of
from cablepod.scene._notes import LARGEST_RADIANS
from cablepod.scene._ranges import are_choices, points_of_grid

#: Lines of the table: text and name.
LINES = (
    ("chord", "chord"),
    ("inclination of the chord", "inclination"),
    ("weight", "weight_per_length"),
    ("mass", "mass_per_length"),
    ("mass of the particles", "mass"),
    ("density", "density"),
    ("axial stiffness EA", "axial_stiffness"),
    ("unstretched length", "unstretched_length"),
    ("tension, upper end", "tension_upper"),
    ("tension, lower end", "tension_lower"),
    ("stress", "stress"),
    ("strain", "strain"),
    ("sag, normal to the chord", "sag"),
    ("sag over chord", "sag_over_chord"),
    ("sag, below the chord", "sag_below_chord"),
    ("Irvine's lambda squared", "irvine_parameter"),
    ("loads over weight", "load_over_weight"),
    ("motion over chord", "motion_over_chord"),
    ("breaking strength", "breaking_strength"),
    ("utilisation at rest", "utilisation"),
)
#: Ratios that are printed in per cent.
SHARES = ("strain", "sag_over_chord", "motion_over_chord", "utilisation")
_, OF_STILL_AIR, OF_MEAN_WIND = ENDINGS_OF_AIR
FREQUENCIES = (("first frequencies in plane", "in_plane"), ("first frequencies out of plane", "out_of_plane"))


def table(summary: xr.Dataset) -> str:
    """Return the numbers of a summary one a line, its frequencies in Hz and rad/s, and its notes."""
    windy = any(str(name).endswith(OF_STILL_AIR) for name in summary)
    lines = [f"  {'rest':<32}{summary.attrs['air']}"] if windy else []
    for text, name in LINES:
        if name in summary and not math.isnan(float(summary[name])):
            units = "%" if name in SHARES else summary[name].attrs["units"]
            values = [printed(float(summary[key]), units) for key, _ in _states(summary, name)]
            both = values[0] if len(values) == 1 else f"{values[0]} in still air, {values[1]} in the mean wind"
            lines.append(f"  {text:<32}{both}")
    for text, plane in FREQUENCIES:
        for key, state in _states(summary, f"frequency_{plane}"):
            known = [summary[name].dropna("mode").values for name in (key, f"angular_{key}")]  # few particles have few
            hertz, omega = ("  ".join(map(digits, values)) for values in known)
            found = f"{hertz} Hz  ({omega} rad/s){state and f' in {state}'}" if hertz else "none"
            lines.append(f"  {text:<32}{found}")
        for key, state in _states(summary, f"damping_ratio_{plane}"):
            if key in summary and (summary[key] > 0.0).any():  # dampers across this plane leave zeros
                ratios = "  ".join(digits(round(100.0 * value, 9)) for value in summary[key].values)
                lines.append(f"  {'their damping ratios':<32}{ratios} % by dampers alone{state and f', in {state}'}")
    hertz, omega = (digits(float(summary[f"first_axial_frequency{end}"])) for end in ("_hertz", ""))
    lines.append(f"  {'first axial frequency':<32}{hertz} Hz  ({omega} rad/s)")
    return "\n".join([*lines, *(f"  note: {note}" for note in note_lines(summary))])


def _states(summary: xr.Dataset, name: str) -> list[tuple[str, str]]:
    """Return the names of a number at rest, and in which air: still air and mean wind where the scene has wind."""
    still, windy = f"{name}{OF_STILL_AIR}", f"{name}{OF_MEAN_WIND}"
    return [(still, "still air"), (windy, "the mean wind")] if still in summary else [(name, "")]


def remarks(scene: xr.Dataset) -> str:
    """Return what to know of a scene before it runs: no damping, no motion out of the plane, ramps; empty where at rest.

    Of a mast it returns the notes of its summary.
    """
    if "mast_height" in scene:
        from cablepod.mast import summary as mast_summary  # its imports take a second

        return "\n".join(f"  note: {note}" for note in note_lines(mast_summary(scene)))
    p = parameters(scene)
    functions = p.time_functions()
    found = []
    if functions and not (p.mass_damping or p.tension_damping or p.damping_ratios or p.link_viscosity or p.wind):
        by_dampers = "none but dampers: vibrations across them never decay; see damping.mass_proportional"
        none = "none: vibrations never decay, resonances grow over the whole run; see damping.mass_proportional"
        found.append(("damping", by_dampers if any(each.damper for each in p.attachments) else none))
    if p.damping_ratios is not None:
        ratios = "  ".join(digits(round(100.0 * ratio, 9)) for ratio in p.damping_ratios)
        which = "each its own, the last of all others" if len(p.damping_ratios) > 1 else "of all vibrations"
        beside = "; dampers add to it" if any(attachment.damper for attachment in p.attachments) else ""
        found.append((KEYS[p.has_list_of_ratios], f"{ratios} % {which}{beside}"))
    if p.inclination is not None and 0.0 < abs(p.inclination) <= LARGEST_RADIANS:
        angle = (
            f"{p.inclination:g} degrees, nearly level; if that is in radians, {math.degrees(p.inclination):.4g} degrees"
        )
        found.append(("ends.inclination", angle))
    if functions and p.dims == 2:
        planar = "two coordinates: motion out of the plane cannot be seen; ends with three numbers show it"
        found.append(("space", planar))
    for key, function in functions.items():
        if function.ramp:
            found.append((key, f"{function.kind}, starts by a ramp of {function.ramp:g} s"))
    return "\n".join(f"  {text:<31} {value}" for text, value in found)


def ensemble_of(scene: xr.Dataset) -> str:
    """Return number of members and ranges of the table [ensemble] of a scene; empty without one."""
    if "ensemble_json" not in scene.attrs:
        return ""
    table = json.loads(scene.attrs["ensemble_json"])
    ranges, members, grid = table["ranges"], table["members"], table["sampling"] == "grid"
    points = points_of_grid(ranges, members) if grid else 0
    lines = [f"  {'ensemble':<32}{members} members, {str(table['sampling']).replace('_', ' ')}"]
    for path, values in ranges.items():
        if are_choices(values):
            shown = dict.fromkeys(
                value if isinstance(value, str) else f"[{', '.join(map(str, value))}]" for value in values
            )
            lines.append(f"  {path:<31} {', '.join(shown)}" + (f", {len(values)} values" if grid else ""))
            continue
        target, key = variable_of(scene, path), key_of_variable(variable_name(path))
        units = str(scene[target[0]].attrs.get("units", "")) if target else (key.units or "" if key else "")
        count = f", {len(values) if len(values) > 2 else points} values" if grid else ""
        line = f"  {path:<31} {_range(values)} {unit_text(units)}".rstrip()
        hertz = [value / (2.0 * math.pi) for value in values] if units == "rad s-1" else []
        lines.append(line + (f" ({_range(hertz)} Hz)" if hertz else "") + count)
    return "\n".join(lines)


def _range(values: list[float]) -> str:
    return f"{digits(min(values))} to {digits(max(values))}"
