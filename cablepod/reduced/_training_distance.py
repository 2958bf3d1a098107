"""Distance of a scene from the training scenes of modes."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod.discretisation._similarity import FEATURES, features, features_of_columns
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters

#: Maximum distance by rounding: the training scenes themselves are inside.
ROUNDING = 1e-9


def distance_outside_training(
    modes: xr.Dataset | None, p: Parameters, length: float, end_time: float, tension: float | None = None
) -> dict[str, Any]:
    """Compute the distance of a scene from the training scenes of modes; parameters as for ``features``.

    Returns
    -------
    dict
        ``outside_training``: largest distance of log(1 + feature) from its training range, 0 inside; 0.7 is a factor of two for
        features above 1, and features far below 1 count as zero.  ``outside_training_feature``: name of that feature, "none"
        inside.  Empty where the modes have no training range.
    """
    if modes is None or "training_range" not in modes:
        return {}
    excess, worst = _excess(modes, features(p, length, end_time, tension)[None])
    return {"outside_training": float(excess[0]), "outside_training_feature": worst[0]}


def member_distances_outside_training(
    modes: xr.Dataset, parameters: MemberParameters, length: np.ndarray, end_time: float, tension: np.ndarray
) -> dict[str, list[Any]]:
    """Compute the distances of many scenes, a list for each name."""
    if "training_range" not in modes:
        return {}
    excess, worst = _excess(modes, features_of_columns(parameters, length, end_time, tension))
    return {"outside_training": excess.tolist(), "outside_training_feature": worst}


def _excess(modes: xr.Dataset, values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return the largest excess of features (members, features) over their range, and its feature."""
    low, high = np.log1p(modes.variables["training_range"].values)
    scaled = np.log1p(values)
    excess = np.maximum(low - scaled, scaled - high)
    worst, largest = np.argmax(excess, axis=1), excess.max(axis=1)
    outside = largest > ROUNDING
    names = [FEATURES[k] if is_outside else "none" for k, is_outside in zip(worst, outside, strict=True)]
    return np.where(outside, largest, 0.0), names
