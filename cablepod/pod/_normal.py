"""Modes of layout "normal": Karhunen-Loeve modes of the deflection normal to the chord of the moment.

What is left when the motion of the chord is taken out by its frame, not by a straight line alone.  The deflection is not
centred: its mean is part of what the modes must hold, so that a model on them has no other shape to fall back on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import ENDS, label
from cablepod.discretisation._chord_frame import ChordFrame, stretch_to_close
from cablepod.errors import SceneError

#: Suffixes of the variables in and out of the plane of chord and vertical.
SETS = ("", "_out_of_plane")


def deflections(position: np.ndarray, reference: int | None = None) -> np.ndarray:
    """Deflections (normals, samples, particle) [m] of positions (samples, particle, dims) [m].

    `reference` is the axis that tells the normals apart in space, by default that of the first chord.
    """
    return ChordFrame.of(position[:, -1] - position[:, 0], reference).split(position)[1]


def sets(modes: xr.Dataset) -> list[tuple[str, np.ndarray]]:
    """Suffixes and modes (mode, particle) of the sets of a Dataset of this layout; a set that never moved is left out.

    Raises
    ------
    SceneError
        Where `modes` have another layout.
    """
    if "mode_shape" not in modes or modes.attrs.get("layout") != "normal":
        raise SceneError(
            f"modes: given layout {modes.attrs.get('layout')!r}; allowed: modes of the deflection normal to the chord, "
            'pod.decompose(snapshots, layout="normal")'
        )
    largest = modes.variables["singular_value"].values.max()
    found = []
    for suffix in SETS[: modes.sizes.get("coordinate", 2) - 1]:
        values = modes.variables[f"singular_value{suffix}"].values
        kept = values > 1e-9 * largest
        shape = modes.variables[f"mode_shape{suffix}"]
        found.append((suffix, (shape.values if shape.dims == ("mode", "particle") else shape.values.T)[kept]))
    return found


def project(position: np.ndarray, modes: xr.Dataset, weight: np.ndarray) -> dict[str, Any]:
    """Amplitudes (time, mode) of positions (time, particle, dims), by variable name."""
    parts = deflections(position)
    result = {}
    for part, suffix in zip(parts, SETS, strict=False):
        shape = modes[f"mode_shape{suffix}"].transpose("mode", "particle").values
        result[f"amplitude{suffix}"] = (("time", "mode"), (part * weight) @ shape.T)
    return result


def amplitude_dataset(values: dict[str, Any], ends: np.ndarray, time: np.ndarray, modes: xr.Dataset) -> xr.Dataset:
    """Label amplitudes by variable name and positions of the ends (time, 2, coordinate)."""
    count = values["amplitude"][1].shape[1]
    result = xr.Dataset(
        {**values, "end_position": (("time", "end", "coordinate"), ends)},
        coords={
            "time": time,
            "mode": modes["mode"].values[:count],
            "coordinate": modes["coordinate"].values,
            "end": list(ENDS),
        },
    )
    return label(result)


def reconstruct(amplitudes: xr.Dataset, modes: xr.Dataset, sigma: np.ndarray) -> np.ndarray:
    """Positions (time, particle, dims) of amplitudes; along the chord all links are taken to be stretched alike."""
    ends = amplitudes["end_position"].transpose("time", "end", "coordinate").values
    frame = ChordFrame.of(ends[:, 1] - ends[:, 0])
    rank = amplitudes.sizes["mode"]
    parts = [
        amplitudes[f"amplitude{suffix}"].transpose("time", "mode").values
        @ modes[f"mode_shape{suffix}"].transpose("mode", "particle").values[:rank]
        for suffix in SETS[: ends.shape[2] - 1]
    ]
    length = np.diff(sigma) * float(modes["unstretched_length"])
    slopes = sum((np.diff(part, axis=1) / length) ** 2 for part in parts)
    z = stretch_to_close(np.asarray(slopes), length, frame.chord)
    along = np.concatenate([np.zeros((len(z), 1)), np.cumsum(z * length, axis=1)], axis=1)
    return frame.join(ends[:, 0], along, np.stack(parts))
