"""Range of the similarity numbers over the training scenes of modes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import xarray as xr

from cablepod.discretisation._similarity import FEATURES, feature_index


@lru_cache
def _bounds() -> xr.IndexVariable:
    return xr.IndexVariable("bound", ["least", "largest"])


def range_of(snapshots: xr.Dataset) -> np.ndarray:
    """Return the least and largest of FEATURES over the scenes of snapshots (2, features); nan where they are not known."""
    unknown = np.full((2, len(FEATURES)), np.nan)
    if "scene_feature" not in snapshots or list(snapshots["feature"].values) != list(FEATURES):
        return unknown
    values = snapshots["scene_feature"].transpose(..., "feature").values.reshape(-1, len(FEATURES))
    return np.stack([values.min(axis=0), values.max(axis=0)])


def union_of_ranges(one: np.ndarray | None, other: np.ndarray | None) -> np.ndarray | None:
    """Return the range of two sets of scenes; not known where that of one is not."""
    if one is None or other is None:
        return other if one is None else one
    return np.stack([np.minimum(one[0], other[0]), np.maximum(one[1], other[1])])


def add_training_range(modes: xr.Dataset, trained: np.ndarray | None) -> xr.Dataset:
    """Add to modes ``training_range (bound, feature)`` where it is known; in place, returned for chaining."""
    if trained is not None and np.isfinite(trained).all():
        modes["training_range"] = (("bound", "feature"), trained)
        modes.coords["feature"], modes.coords["bound"] = feature_index(), _bounds()
    return modes
