"""Distance of a scene from the training scenes of modes."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod.discretisation._similarity import FEATURES, features, features_of_columns
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters


def distance_outside_training(
    modes: xr.Dataset | None, p: Parameters, length: float, until: float, tension: float | None = None
) -> dict[str, Any]:
    """Tell how far a scene lies outside the training scenes of modes; parameters as those of :func:`features`.

    Returns
    -------
    dict
        ``outside_training``: largest distance of log(1 + feature) to its range over the training scenes, 0 inside: 0.7 is a
        factor of two where the feature is above 1, and what is far below 1 counts as none; ``outside_training_feature``: of which
        feature, "none" inside.  Empty where the modes do not know their training scenes.
    """
    if modes is None or "training_range" not in modes:
        return {}
    excess, worst = _excess(modes, features(p, length, until, tension)[None])
    return {"outside_training": float(excess[0]), "outside_training_feature": worst[0]}


def member_distances_outside_training(
    modes: xr.Dataset, columns: MemberParameters, length: np.ndarray, until: float, tension: np.ndarray
) -> dict[str, list[Any]]:
    """Tell the same of many scenes, a list for each name."""
    if "training_range" not in modes:
        return {}
    excess, worst = _excess(modes, features_of_columns(columns, length, until, tension))
    return {"outside_training": excess.tolist(), "outside_training_feature": worst}


def _excess(modes: xr.Dataset, values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """How far FEATURES (members, features) are outside, and which is worst."""
    low, high = np.log1p(modes.variables["training_range"].values)
    place = np.log1p(values)
    excess = np.maximum(low - place, place - high)
    worst, largest = np.argmax(excess, axis=1), excess.max(axis=1)
    # rounding of the training scene itself is not outside
    out = largest > 1e-9
    return np.where(out, largest, 0.0), [FEATURES[k] if far else "none" for k, far in zip(worst, out, strict=True)]
