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
#: Numbers of the scenes of the last runs, which do not depend on the run.
_kept_features = lru_cache(64)(features)


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
    if modes is None or "training_range" not in modes or modes["feature"].values.tolist() != list(FEATURES):
        return {}
    low, high = np.log1p(modes.variables["training_range"].values)
    numbers = features if np.ndim(length) else _kept_features  # stacked members are not hashed
    scaled = np.log1p(numbers(p, length, end_time, tension))
    excess = np.maximum(low - scaled, scaled - high)
    largest = excess.max(axis=-1)
    outside = largest > ROUNDING
    return {
        "outside_training": np.where(outside, largest, 0.0).tolist(),
        "outside_training_feature": np.where(outside, np.array(FEATURES)[np.argmax(excess, axis=-1)], "none").tolist(),
    }
