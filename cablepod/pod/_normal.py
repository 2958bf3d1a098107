"""Modes of layout "normal": Karhunen-Loeve modes of the deflection normal to the instantaneous chord.

The deflection is measured in the co-rotating chord frame.  It is not centred, because the condensed model has no mean shape
beside its modes.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod._inputs import NO_MOTION, floats
from cablepod.discretisation._chord_frame import ChordFrame, reference_axis, stretch_to_close
from cablepod.errors import SceneError, scene_error

#: Suffixes of the variables in and out of the plane of chord and vertical.
SETS = ("", "_out_of_plane")
#: Rounding of an axis in files, which may have short floats.
REFERENCE_ROUNDING = 1e-6
#: Whose axis modes must refer to, and a remedy, in messages.
OF_SCENE = "of the scene at its start; try: modes of a cable with its inclination"


def reference_of(position: np.ndarray) -> np.ndarray:
    """Return the axis that the normals in space refer to, chosen from the first chord of positions (samples, particle, dims)."""
    return ChordFrame.of(position[:1, -1] - position[:1, 0]).reference


def deflections(position: np.ndarray, reference: np.ndarray | None = None) -> np.ndarray:
    """Return deflections (normals, samples, particle) [m] of positions (samples, particle, dims) [m].

    `reference` is the axis that the normals in space refer to, by default chosen from the first chord.
    """
    return ChordFrame.of(position[:, -1] - position[:, 0], reference).split(position)[1]


def sets(modes: xr.Dataset) -> list[tuple[str, np.ndarray]]:
    """Return suffix and modes (mode, particle) for each normal, without modes of zero singular value.

    Vibration modes have no singular values, and all of them are kept.
    """
    variables = modes.variables
    largest = variables["singular_value"].values.max() if "singular_value" in variables else None
    result = []
    for suffix in SETS[: modes.sizes.get("coordinate", 2) - 1]:
        names = [f"{name}{suffix}" for name in ("mode_shape", *(("singular_value",) if largest is not None else ()))]
        if missing := [name for name in names if name not in variables]:
            raise SceneError(f"modes: given a Dataset without {' and '.join(missing)}; allowed: modes of pod.decompose")
        shape = floats(variables[f"mode_shape{suffix}"].values)
        if largest is not None:
            shape = shape[variables[f"singular_value{suffix}"].values > NO_MOTION * largest]
        result.append((suffix, shape))
    return result


def project(
    position: np.ndarray, modes: xr.Dataset, weight: np.ndarray
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return amplitudes (time, mode) [m] of positions (time, particle, dims) [m], name -> (dimensions, values).

    In space also ``normal_reference``, that of the modes, otherwise of the first chord.
    """
    frame = ChordFrame.of(position[:, -1] - position[:, 0], _reference_in("modes", modes))
    result = reference_variable(frame.reference)
    for part, suffix in zip(frame.split(position)[1], SETS, strict=False):
        shape = _values("modes", modes, f"mode_shape{suffix}", ("mode", "particle"))
        result[f"amplitude{suffix}"] = (("time", "mode"), (part * weight) @ shape.T)
    return result


def reconstruct(amplitudes: xr.Dataset, modes: xr.Dataset, sigma: np.ndarray) -> np.ndarray:
    """Return positions (time, particle, dims) [m] of amplitudes of all modes, with the same chordwise stretch in all links."""
    ends = floats(amplitudes["end_position"].values)
    frame = ChordFrame.of(ends[:, 1] - ends[:, 0], _reference_in("amplitudes", amplitudes))
    parts = [
        _values("amplitudes", amplitudes, f"amplitude{suffix}", ("time", "mode"))
        @ _values("modes", modes, f"mode_shape{suffix}", ("mode", "particle"))
        for suffix in SETS[: ends.shape[2] - 1]
    ]
    length = np.diff(sigma) * float(_values("modes", modes, "unstretched_length", ()))
    slopes = sum((np.diff(part, axis=1) / length) ** 2 for part in parts)
    chordwise_stretch = stretch_to_close(np.asarray(slopes), length, frame.chord)
    along = np.concatenate(
        [np.zeros((len(chordwise_stretch), 1)), np.cumsum(chordwise_stretch * length, axis=1)], axis=1
    )
    return frame.join(ends[:, 0], along, np.stack(parts))


def reference_variable(reference: np.ndarray | None) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return ``normal_reference``, name -> (dimensions, values), in space; nothing in the plane, where a chord has one normal."""
    return {} if reference is None or reference.size == 2 else {"normal_reference": (("coordinate",), reference)}


def refer_to_axis_of(modes: xr.Dataset, chord: np.ndarray) -> np.ndarray:
    """Tell whether the normals of cables with chords (..., dims) [m] at the start refer to the axis of modes, if this is known.

    Otherwise the modes of both normals would be exchanged, or turned.
    """
    reference = _reference_in("modes", modes) if chord.shape[-1] == 3 else None
    if reference is None:
        return np.ones(chord.shape[:-1], dtype=bool)
    return np.abs(reference_axis(chord) @ reference) > 1.0 - REFERENCE_ROUNDING


def check_axis(modes: xr.Dataset, chord: np.ndarray, whose: str = OF_SCENE) -> None:
    """Refuse modes whose normals refer to another axis than those of a cable with a chord (dims,) [m] at the start."""
    if not refer_to_axis_of(modes, chord):
        raise scene_error(
            "modes: normal_reference",
            modes["normal_reference"].values.tolist(),
            f"{reference_axis(chord).tolist()}, the axis {whose}",
        )


def _reference_in(key: str, dataset: xr.Dataset) -> np.ndarray | None:
    """Return the axis that the normals of modes or amplitudes in space refer to, None where it is not known."""
    if "normal_reference" not in dataset.variables:
        return None
    reference = _values(key, dataset, "normal_reference", ("coordinate",))
    if not abs(float(np.linalg.norm(reference)) - 1.0) < REFERENCE_ROUNDING:  # also for nan
        raise scene_error(f"{key}: normal_reference", reference.tolist(), "a unit vector")
    return reference


def _values(key: str, dataset: xr.Dataset, name: str, dims: tuple[str, ...]) -> np.ndarray:
    """Return the values of a variable, refused where it is missing or has other dimensions."""
    variable = dataset.variables.get(name)
    if variable is None:
        raise SceneError(f"{key}: given a Dataset without {name}; allowed: one with {name} {dims}")
    if variable.dims != dims:
        raise scene_error(f"{key}: {name}", variable.dims, f"{dims}")
    return floats(variable.values)
