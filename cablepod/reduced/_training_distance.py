"""Distance of a scene from the training scenes of modes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from cablepod.conventions import FEATURES
from cablepod.discretisation._similarity import features
from cablepod.parameters._parameters import Parameters

#: Maximum distance by rounding: the training scenes themselves are inside.
ROUNDING = 1e-9


def distance_outside_training(
    modes: xr.Dataset | None, p: Parameters, length: Any, end_time: float, tension: Any = None
) -> dict[str, Any]:
    """Compute the distance of a scene from the training scenes of modes; parameters as for ``features``.

    Returns
    -------
    dict
        ``outside_training``: largest distance of log(1 + feature) from its training range, 0 inside; 0.7 is a factor of two for
        features above 1, and features far below 1 count as zero.  ``outside_training_feature``: name of that feature, "none"
        inside.  Lists for stacked members.  Empty where the modes have no training range.
    """
    if modes is None or "training_range" not in modes.variables or _features_of(modes) != list(FEATURES):
        return {}
    given = modes.variables["training_range"].values
    if np.ndim(length):  # stacked members are not hashed
        return _distance(given, features(p, length, end_time, tension))
    return dict(_kept_distance(given.shape, given.dtype.str, given.tobytes(), p, length, end_time, tension))


def _features_of(modes: xr.Dataset) -> list[Any]:
    """Return the names of features, none where they have no names."""
    variable = modes.variables.get("feature")
    return [] if variable is None else list(variable.to_index().tolist())  # twice as fast as its values


@lru_cache(64)
def _kept_distance(
    shape: tuple[int, ...],
    dtype: str,
    training_range: bytes,
    p: Parameters,
    length: float,
    end_time: float,
    tension: Any,
) -> dict[str, Any]:
    """Return the distance of one scene, which does not depend on the run."""
    given = np.frombuffer(training_range, dtype).reshape(shape)
    return _distance(given, features(p, length, end_time, tension))


def _distance(training_range: np.ndarray, numbers: np.ndarray) -> dict[str, Any]:
    """Return the attributes for features within a training range (bound, feature)."""
    low, high = np.log1p(training_range)
    scaled = np.log1p(numbers)
    excess = np.maximum(low - scaled, scaled - high)
    largest = excess.max(axis=-1)
    outside = largest > ROUNDING
    return {
        "outside_training": np.where(outside, largest, 0.0).tolist(),
        "outside_training_feature": np.where(outside, np.array(FEATURES)[np.argmax(excess, axis=-1)], "none").tolist(),
    }
