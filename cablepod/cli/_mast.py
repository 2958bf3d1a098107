"""Format what ``cablepod run`` prints of a mast."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

#: Number of frequencies that are printed.
FREQUENCIES = 6


def answers(study: xr.DataTree) -> dict[str, Any]:
    """Return the answers that an engineer asks first: buckling, frequencies of the mast, displacement and moment."""
    rest, motion = study["rest"].to_dataset(), study["motion"].to_dataset()
    frequencies = study["frequencies"].to_dataset()
    own = frequencies["mast_share"].values >= 0.5
    hertz = frequencies["angular_frequency"].values / (2.0 * math.pi)
    factor = float(rest["buckling_factor"])
    largest = _largest(motion, "displacement")
    moments = _largest(motion, "bending_moment")
    node = int(moments.max(axis=1).argmax())
    return {
        "buckling_factor": factor if math.isfinite(factor) else None,
        "frequencies_hertz": hertz[:FREQUENCIES].tolist(),
        "frequencies_of_the_mast_hertz": hertz[own][:FREQUENCIES].tolist(),
        "largest_displacement": float(largest.max()),
        "largest_displacement_level": float(motion["level"][int(largest.max(axis=1).argmax())]),
        "largest_bending_moment": float(moments.max()),
        "largest_bending_moment_height": float(motion["node_height"][node]),
        "error_estimate": float(motion.attrs["error_estimate"]) if "error_estimate" in motion.attrs else None,
        "step": float(motion.attrs["step"]),
        "wall_time_s": float(motion.attrs["wall_time_s"]),
    }


def _largest(motion: xr.Dataset, name: str) -> np.ndarray:
    """Return the largest magnitude of a variable over time."""
    return np.maximum(np.abs(motion[f"{name}_maximum"].values), np.abs(motion[f"{name}_minimum"].values))


def check_text(scene: xr.Dataset) -> str:
    """Return the static numbers of a mast: buckling, frequencies, guys at rest, and notes."""
    from cablepod.mast import summary

    numbers = summary(scene)
    hertz = numbers["frequency"].values
    lines = [
        f"  {'axial force at the foot':<32}{float(numbers['axial_force_foot']):.5g} N",
        f"  {'critical factor of buckling':<32}{float(numbers['buckling_factor']):.4g}",
        f"  {'largest displacement at rest':<32}{float(numbers['displacement_largest']):.4g} m",
        f"  {'largest bending moment at rest':<32}{float(numbers['bending_moment_largest']):.4g} N m",
        f"  {'first frequencies':<32}{'  '.join(f'{value:.4g}' for value in hertz)} Hz",
        "",
        f"  {'guy':>3}{'level [m]':>11}{'length [m]':>12}{'anchor [kN]':>13}{'mast [kN]':>11}",
    ]
    for g in range(numbers.sizes.get("guy", 0)):
        lower, upper = (1e-3 * float(numbers[name][g]) for name in ("guy_tension_anchor", "guy_tension"))
        lines.append(
            f"  {g + 1:>3}{float(numbers['guy_level'][g]):>11g}{float(numbers['guy_length'][g]):>12.4f}{lower:>13.3f}"
            f"{upper:>11.3f}"
        )
    return "\n".join([*lines, *(f"  note: {note}" for note in str(numbers["note"].values).split("\n") if note)])


def as_json(study: xr.DataTree) -> str:
    """Return answers and table as JSON."""
    content = {"title": study.attrs["title"], "answers": answers(study), "guys": table_of_guys(study)}
    return json.dumps(content, indent=2, allow_nan=False)


def text(study: xr.DataTree, folder: Path) -> str:
    """Return what the command prints: answers, and tensions of each guy."""
    found, rows = answers(study), table_of_guys(study)
    factor = "none" if found["buckling_factor"] is None else f"{found['buckling_factor']:.3g}"
    lines = [
        str(study.attrs["title"]),
        "",
        f"at rest      critical factor of buckling {factor}",
        f"frequencies  {'  '.join(f'{value:.4g}' for value in found['frequencies_hertz'])} Hz, with the guys",
    ]
    if found["frequencies_of_the_mast_hertz"]:
        of_mast = "  ".join(f"{value:.4g}" for value in found["frequencies_of_the_mast_hertz"])
        lines.append(f"             {of_mast} Hz, mostly the mast")
    lines += [
        f"motion       {found['largest_displacement']:.4g} m at {found['largest_displacement_level']:g} m, "
        f"bending moment {1e-3 * found['largest_bending_moment']:.4g} kN m at {found['largest_bending_moment_height']:g} m",
        f"             step {found['step']:.4g} s, {found['wall_time_s']:.2g} s of run time"
        + ("" if found["error_estimate"] is None else f", estimated error of tensions {100.0 * found['error_estimate']:.2g} %"),
        "",
        f"{'guy':>3}{'level [m]':>11}{'rest [kN]':>11}{'mean':>9}{'std':>9}{'least':>9}{'peak':>9}{'at [s]':>9}{'fatigue':>10}"
        + (f"{'used':>8}" if rows and "utilisation" in rows[0] else ""),
    ]  # fmt: skip
    for row in rows:
        kilo = [1e-3 * row[name] for name in ("mean", "std", "least", "peak")]
        numbers = "".join(f"{value:>9.3f}" for value in kilo)
        line = f"{row['guy']:>3}{row['level']:>11g}{1e-3 * row['rest']:>11.3f}{numbers}{row['peak_time']:>9.2f}"
        line += f"{1e-3 * row['fatigue_range']:>10.3f}"
        if "utilisation" in row:
            line += f"{100.0 * row['utilisation']:>6.1f} %"
        lines.append(line)
    files = [path.name for path in sorted(folder.iterdir()) if path.suffix in (".nc", ".png")]
    return "\n".join([*lines, "", f"{folder}: {', '.join(files)}"])


def table_of_guys(study: xr.DataTree) -> list[dict[str, Any]]:
    """Return the rows of the printed table, a guy each; [N, s]."""
    if "guys" not in study:
        return []
    guys = study["guys"].to_dataset()
    return [
        {
            "guy": g + 1,
            "level": float(guys["guy_level"][g]),
            **{
                name: float(np.asarray(guys[variable][g]))
                for name, variable in (
                    ("rest", "guy_tension_rest"), ("mean", "guy_tension_mean"), ("std", "guy_tension_std"),
                    ("least", "guy_tension_minimum"), ("peak", "guy_tension_maximum"), ("peak_time", "guy_tension_maximum_time"),
                    ("fatigue_range", "fatigue_range"), ("utilisation", "utilisation"),
                )
                if variable in guys
            },
        }
        for g in range(guys.sizes["guy"])
    ]  # fmt: skip
