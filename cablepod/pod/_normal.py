"""Modes of layout "normal": Karhunen-Loeve modes of the deflection normal to the instantaneous chord.

The deflection is measured in the co-rotating chord frame.  It is not centred, because the condensed model has no mean shape
beside its modes.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod.discretisation._chord_frame import ChordFrame, stretch_to_close
from cablepod.errors import SceneError, check_dataset

#: Suffixes of the variables in and out of the plane of chord and vertical.
SETS = ("", "_out_of_plane")


def deflections(position: np.ndarray, reference: int | None = None) -> np.ndarray:
    """Return deflections (normals, samples, particle) [m] of positions (samples, particle, dims) [m].

    `reference` is the axis that defines the normals in space, by default chosen from the first chord.
    """
    return ChordFrame.of(position[:, -1] - position[:, 0], reference).split(position)[1]


#: What modes of this layout are.
MODES = 'modes of the deflection normal to the chord, pod.decompose(snapshots, layout="normal")'


def sets(modes: xr.Dataset) -> list[tuple[str, np.ndarray]]:
    """Return suffix and modes (mode, particle) for each normal, without modes of zero singular value.

    Vibration modes have no singular values, and all of them are kept.

    Raises
    ------
    SceneError
        If `modes` have another layout.
    """
    check_dataset("modes", modes, ("mode_shape", "arc_length"), MODES)
    if modes.attrs.get("layout") != "normal":
        raise SceneError(f"modes: given layout {modes.attrs.get('layout')!r}; allowed: {MODES}")
    largest = modes.variables["singular_value"].values.max() if "singular_value" in modes else None
    result = []
    for suffix in SETS[: modes.sizes.get("coordinate", 2) - 1]:
        variable = modes.variables[f"mode_shape{suffix}"]
        shape = variable.values if variable.dims == ("mode", "particle") else variable.values.T
        if largest is not None:
            shape = shape[modes.variables[f"singular_value{suffix}"].values > 1e-9 * largest]
        result.append((suffix, shape))
    return result


def project(
    position: np.ndarray, modes: xr.Dataset, weight: np.ndarray
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return amplitudes (time, mode) [m] of positions (time, particle, dims) [m], name -> (dimensions, values)."""
    parts = deflections(position)
    result: dict[str, tuple[tuple[str, ...], np.ndarray]] = {}
    for part, suffix in zip(parts, SETS, strict=False):
        shape = modes[f"mode_shape{suffix}"].transpose("mode", "particle").values
        result[f"amplitude{suffix}"] = (("time", "mode"), (part * weight) @ shape.T)
    return result


def reconstruct(amplitudes: xr.Dataset, modes: xr.Dataset, sigma: np.ndarray) -> np.ndarray:
    """Return positions (time, particle, dims) [m] of amplitudes, with the same stretch along the chord in all links."""
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
    chordwise_stretch = stretch_to_close(np.asarray(slopes), length, frame.chord)
    along = np.concatenate(
        [np.zeros((len(chordwise_stretch), 1)), np.cumsum(chordwise_stretch * length, axis=1)], axis=1
    )
    return frame.join(ends[:, 0], along, np.stack(parts))
