"""Range of the similarity numbers over the training scenes of modes."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod.conventions import FEATURES, LABELS, shared_coordinates


def range_of(snapshots: xr.Dataset) -> np.ndarray:
    """Return minimum and maximum of FEATURES over the scenes of snapshots (2, features), nan if unknown."""
    unknown = np.full((2, len(FEATURES)), np.nan)
    if "scene_feature" not in snapshots or list(snapshots["feature"].values) != list(FEATURES):
        return unknown
    values = snapshots["scene_feature"].transpose(..., "feature").values.reshape(-1, len(FEATURES))
    return np.stack([values.min(axis=0), values.max(axis=0)])


def union_of_ranges(first: np.ndarray | None, second: np.ndarray | None) -> np.ndarray | None:
    """Return the range (2, features) of the union of two sets of scenes.

    None is the range of an empty set, nan an unknown range.
    """
    if first is None or second is None:
        return second if first is None else first
    return np.stack([np.minimum(first[0], second[0]), np.maximum(first[1], second[1])])


def add_training_range(modes: xr.Dataset, trained: np.ndarray | None) -> xr.Dataset:
    """Add ``training_range (bound, feature)`` to modes in place, if it is known, and return them."""
    if trained is not None and np.isfinite(trained).all():
        modes["training_range"] = (("bound", "feature"), trained)
        modes.coords.update(shared_coordinates({name: LABELS[name] for name in ("feature", "bound")}))
    return modes
