"""Format what ``cablepod run`` prints of a mast."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod.cli._statistics import HEADS, columns, fatigue_text, files_text, finite, part_of_run
from cablepod.conventions import ENDINGS_OF_AIR, digits, direction, note_lines, printed, printed_unit
from cablepod.plots._mast import modes_of_mast
from cablepod.study._figures import MAST_FIGURES

#: Number of frequencies that are printed.
FREQUENCIES = 6
#: What the column of directions tells.
TOWARDS = "towards: angle from +x towards +z of the anchor, seen from the mast"
_, OF_STILL_AIR, OF_MEAN_WIND = ENDINGS_OF_AIR
#: What stands in place of the factor of buckling of a mast that falls when guys break.
NO_REST = "none: the mast falls"


def answers(study: xr.DataTree) -> dict[str, Any]:
    """Return the answers that an engineer asks first: buckling, frequencies of the mast, displacement and moment."""
    rest, motion = study["rest"].to_dataset(), study["motion"].to_dataset()
    frequencies = study["frequencies"].to_dataset()
    own = modes_of_mast(frequencies["mast_share"].values, FREQUENCIES)  # of the picture
    hertz = frequencies["angular_frequency"].values / (2.0 * math.pi)
    factor = float(rest["buckling_factor"])
    largest, moments = motion["displacement_largest"].values, motion["bending_moment_largest"].values
    shear, foot = motion["shear_force_largest"].values, motion["foot_force_minimum"].sel(coordinate="y")
    anchors = motion["anchor_force_largest"].values if "anchor_force_largest" in motion else np.zeros(0)
    return {
        "buckling_factor": factor if math.isfinite(factor) else None,
        "frequencies_hertz": hertz[:FREQUENCIES].tolist(),
        "frequencies_of_the_mast_hertz": hertz[own].tolist(),
        "largest_displacement": float(largest.max()),
        "largest_displacement_level": float(motion["level"][int(largest.argmax())]),
        "largest_bending_moment": float(moments.max()),
        "largest_bending_moment_height": float(motion["node_height"][int(moments.argmax())]),
        "largest_shear": float(shear.max()),
        "largest_shear_element": [float(motion[f"element_{end}"][int(shear.argmax())]) for end in ("bottom", "top")],
        "largest_foot_force_downwards": -float(foot),
        "largest_foot_force_horizontal": float(motion["foot_force_horizontal_largest"]),
        "largest_anchor_force": float(anchors.max()) if anchors.size else None,
        "largest_anchor_force_guy": int(anchors.argmax()) + 1 if anchors.size else None,
        "error_estimate": finite(motion.attrs.get("error_estimate", math.nan)),
        "step": float(motion.attrs["step"]),
        "wall_time_s": float(motion.attrs["wall_time_s"]),
        "compile_time_s": float(study.attrs["compile_time_s"]),
    }


def check_text(scene: xr.Dataset) -> str:
    """Return the static numbers of a mast: buckling, frequencies, guys at rest, and notes."""
    from cablepod.mast import summary

    numbers = summary(scene)
    windy = f"frequency{OF_STILL_AIR}" in numbers
    states = {OF_STILL_AIR: "still air", OF_MEAN_WIND: "mean wind"} if windy else {"": "at rest"}
    lines = [f"  {'rest':<28}{numbers.attrs['air']}"] if windy else []
    for text, name in (
        ("axial force at the foot", "axial_force_foot"), ("critical factor of buckling", "buckling_factor"),
        ("  without guys that break", "buckling_factor_after_break"), ("largest displacement", "displacement_largest"),
        ("largest bending moment", "bending_moment_largest"), ("first frequencies", "frequency"),
    ):  # fmt: skip
        if name not in numbers:
            continue
        for number, (ending, state) in enumerate(states.items()):
            values = _printed(numbers[f"{name}{ending}"])
            if name == "buckling_factor_after_break" and values == "nan":
                values = NO_REST
            lines.append(f"  {'' if number else text:<28}{state:<11}{values}")
    ends = {"guy_tension_anchor": "anchor [kN]", "guy_tension": "mast [kN]"}
    lines.append("")
    if len(states) > 1:
        lines.append(" " * 59 + "".join(f"{state:>22}" for state in states.values()))
    columns = [(f"{name}{ending}", text) for ending in states for name, text in ends.items()]
    heads = "".join(f"{text:>{12 - n % 2 * 2}}" for n, (_, text) in enumerate(columns))
    lines.append(f"  {'guy':>3}{'level [m]':>11}{'towards':>10}{'anchor [m]':>21}{'length [m]':>12}{heads}")
    for g in range(numbers.sizes.get("guy", 0)):
        anchor = numbers["anchor"][g].values
        lines.append(
            f"  {g + 1:>3}{float(numbers['guy_level'][g]):>11g}{direction(anchor[0], anchor[2]):>10}{place(anchor):>21}"
            f"{float(numbers['guy_length'][g]):>12.4f}"
            + "".join(f"{1e-3 * float(numbers[name][g]):>{12 - n % 2 * 2}.3f}" for n, (name, _) in enumerate(columns))
        )
    if numbers.sizes.get("guy", 0):
        lines.append(f"  ({TOWARDS})")
    return "\n".join([*lines, *(f"  note: {note}" for note in note_lines(numbers))])


def _printed(values: xr.DataArray) -> str:
    """Return quantities with four digits, in the unit of the largest; rounding of a number that is 0 is not shown."""
    numbers = np.atleast_1d(np.where(np.abs(values.values) < 1e-9, 0.0, values.values))
    factor, unit = printed_unit(values.attrs["units"], float(np.abs(numbers).max()))
    return f"{'  '.join(digits(factor * number, 4) for number in numbers)} {unit}".rstrip()


def place(anchor: np.ndarray) -> str:
    """Return the coordinates of an anchor [m]."""
    return "(" + ", ".join(f"{value:.4g}" for value in anchor + 0.0) + ")"


def as_json(study: xr.DataTree) -> str:
    """Return answers and table as JSON."""
    content = {"title": study.attrs["title"], "answers": answers(study), "guys": table_of_guys(study)}
    return json.dumps(content, indent=2, allow_nan=False)


def text(study: xr.DataTree, folder: Path) -> str:
    """Return what the command prints: answers, and tensions of each guy."""
    found, rows, rest = answers(study), table_of_guys(study), study["rest"]
    guys = study["guys"].attrs if rows else {}
    factor = "none" if found["buckling_factor"] is None else f"{found['buckling_factor']:.3g}"
    lines = [
        str(study.attrs["title"]),
        "",
        f"at rest      critical factor of buckling {factor}, in {rest.attrs['air']}",
        *_after_break(rest),
        f"frequencies  {'  '.join(f'{value:.4g}' for value in found['frequencies_hertz'])} Hz, with the guys",
    ]
    of_mast = "  ".join(f"{value:.4g}" for value in found["frequencies_of_the_mast_hertz"])
    lines.append(f"             {of_mast} Hz, those in which the mast moves most, as in modes.png")
    moved, moment = printed(found["largest_displacement"], "m", 4), printed(found["largest_bending_moment"], "N m", 4)
    lines += [
        f"largest      displacement {moved} at {found['largest_displacement_level']:g} m, "
        f"bending moment {moment} at {found['largest_bending_moment_height']:g} m",
        *_reactions(found),
        f"             step {found['step']:.4g} s, {found['wall_time_s']:.2g} s of run time"
        + (f" (and {found['compile_time_s']:.2g} s of compiling, once on this machine)" if found["compile_time_s"] else "")
        + ("" if found["error_estimate"] is None else
           f"; rms error of tensions, estimated: {100.0 * found['error_estimate']:.2g} % of their std"),
        "",
        f"tension of the guys at the mast [kN], at rest in {rest.attrs['air']}; {part_of_run(guys)}" if rows else "",
        *_around_break(study),
        f"{fatigue_text(guys)}; {TOWARDS}" if rows else "",
        f"{'guy':>3}{'level [m]':>11}{'towards':>10}{'anchor [m]':>21}{'rest':>9}"
        + HEADS + (f"{'used':>8}" if rows and "utilisation" in rows[0] else ""),
    ]  # fmt: skip
    for row in rows:
        anchor = row["anchor"]
        line = f"{row['guy']:>3}{row['level']:>11g}{direction(anchor[0], anchor[2]):>10}{place(np.array(anchor)):>21}"
        line += f"{1e-3 * row['rest']:>9.3f}{columns(row)}"
        if "utilisation" in row:
            used = row["utilisation"]
            line += f"{'-':>8}" if used is None else f"{100.0 * used:>6.1f} %" if used < 9.9995 else f"{'>999':>6} %"
        if "breaks" in row:
            line += f"  breaks at {row['breaks']:g} s"
        lines.append(line)
    return "\n".join([*lines, "", files_text(folder, MAST_FIGURES)])


def _reactions(found: dict[str, Any]) -> list[str]:
    """Return lines with the largest shear, and the largest forces on foundation and anchors."""
    lower, upper = found["largest_shear_element"]
    force = f"             force on the foundation {printed(found['largest_foot_force_downwards'], 'N', 4)} downwards, "
    force += f"{printed(found['largest_foot_force_horizontal'], 'N', 4)} horizontal"
    if found["largest_anchor_force"] is not None:
        force += f", on the anchor of guy {found['largest_anchor_force_guy']} {printed(found['largest_anchor_force'], 'N', 4)}"
    return [f"             shear {printed(found['largest_shear'], 'N', 4)} between {lower:g} and {upper:g} m", force]


def _around_break(study: xr.DataTree) -> list[str]:
    """Return a note that statistics mix what is before and after a break, and how to have the part after; none without."""
    motion = study["motion"].to_dataset()
    end = float(motion["time"].values[-1])
    breaks = motion["guy_breaks"].values.tolist() if "guy_breaks" in motion else []
    times = sorted({time for time in breaks if time <= end})
    if not times:
        return []
    at = ", ".join(f"{time:g} s" for time in times)
    after = ""
    if times[-1] < end:
        call = f'cp.mast.simulate(scene, guys="{motion.attrs["guys"]}", window=({times[-1]:g}, {end:g}))'
        after = f"; of the part after it: {call}"
    return [f"note: statistics of guys and mast mix what is before and after the break at {at}{after}"]


def _after_break(rest: Any) -> list[str]:
    """Return a line with the critical factor of buckling without the guys that break, and these; none where no guy does."""
    if "buckling_factor_after_break" not in rest:
        return []
    factor = float(rest["buckling_factor_after_break"])
    names = ", ".join(
        f"guy {guy} at {time:g} s"
        for guy, time in zip(rest["guy"].values.tolist(), rest["guy_breaks"].values.tolist(), strict=True)
        if math.isfinite(time)
    )
    left = f"{factor:.3g}" if math.isfinite(factor) else NO_REST
    return [f"             that is with all guys; {left} without those that break, {names}"]


def table_of_guys(study: xr.DataTree) -> list[dict[str, Any]]:
    """Return the rows of the printed table, a guy each; [N, s]."""
    if "guys" not in study:
        return []
    guys = study["guys"].to_dataset()
    no_breaks = np.full(guys.sizes["guy"], np.inf)
    return [
        {
            "guy": g + 1,
            "level": float(guys["guy_level"][g]),
            "anchor": guys["anchor"][g].values.tolist(),
            **{
                name: finite(guys[variable][g])
                for name, variable in (
                    ("rest", "guy_tension_rest"), ("mean", "guy_tension_mean"), ("std", "guy_tension_std"),
                    ("least", "guy_tension_minimum"), ("peak", "guy_tension_maximum"), ("peak_time", "guy_tension_maximum_time"),
                    ("fatigue_range", "fatigue_range"), ("utilisation", "utilisation"),
                )
                if variable in guys
            },
            **({"breaks": float(guys["guy_breaks"][g])} if math.isfinite(guys.get("guy_breaks", no_breaks)[g]) else {}),
        }
        for g in range(guys.sizes["guy"])
    ]  # fmt: skip
