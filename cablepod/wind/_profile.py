"""Mean wind over height, and the air of a scene at rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.conventions import STILL_AIR
from cablepod.parameters._parameters import InWind, has_record, ramp_of


def mean_speed(wind: Mapping[str, Any], height: np.ndarray) -> np.ndarray:
    """Return the mean wind speed [m/s] at heights above the ground [m]."""
    speed, height = float(wind["speed"]), np.asarray(height, dtype=float)
    profile, reference = str(wind["profile"]), float(wind["reference_height"])
    if profile == "uniform":
        return np.full(height.shape, speed)
    if profile == "power":
        return speed * (np.maximum(height, 0.0) / reference) ** float(wind["exponent"])
    roughness = float(wind["roughness_length"])
    return speed * np.log(np.maximum(height, roughness) / roughness) / np.log(reference / roughness)


def air_at_rest(p: InWind) -> str:
    """Return in words in which air a scene is at rest: its mean wind, or with a ramp the still air from which that rises."""
    recorded = has_record(p)
    if p.wind is None or not (recorded or float(p.wind["speed"])):
        return STILL_AIR
    if ramp_of(p):
        return f"{STILL_AIR}, from which the wind rises"
    if recorded:
        return "mean wind of the record"
    above = "" if p.wind["profile"] == "uniform" else f" at {float(p.wind['reference_height']):g} m above the ground"
    return f"mean wind of {float(p.wind['speed']):g} m/s{above}"
