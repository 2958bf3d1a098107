"""One-sided spectra of the turbulence along and across the mean wind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.wind._profile import mean_speed

#: Von Karman's constant, as in the paper's sources of the spectra.
KARMAN = 0.4
#: Least height above the ground for spectra and coherence, in m and in roughness lengths; those of the boundary layer do not hold
#: below, where points in a mean wind that vanishes would be coherent with those above, but not with each other.
MIN_HEIGHT, MIN_ROUGHNESSES = 1.0, 1.5
#: Standard deviation across over that along the wind of Davenport's spectrum, which has no formula across.
DAVENPORT_ACROSS = 0.75


def friction_velocity(wind: Mapping[str, Any]) -> float:
    """Return u* [m/s] by the mean speed 10 m above the ground and the roughness length."""
    return KARMAN * float(mean_speed(wind, np.array(10.0))) / float(np.log(10.0 / float(wind["roughness_length"])))


def height_in_layer(wind: Mapping[str, Any], height: np.ndarray) -> np.ndarray:
    """Return heights above the ground for spectra and coherence [m]: the given ones, or the least."""
    return np.maximum(height, max(MIN_HEIGHT, MIN_ROUGHNESSES * float(wind["roughness_length"])))


def spectra(
    wind: Mapping[str, Any], turbulence: Mapping[str, Any], height: np.ndarray, frequency: np.ndarray, *, across: bool
) -> np.ndarray:
    """Return the one-sided spectrum of a component (points, frequencies) [m2/s].

    Parameters
    ----------
    wind, turbulence
        Tables [wind] and [wind.turbulence].
    height
        Heights above the ground (points,) [m].
    frequency
        [Hz], above 0.
    across
        Whether the component is that across the mean wind.

    Notes
    -----
    Kaimal's spectra as in E. Simiu and R. H. Scanlan, Wind effects on structures, 3rd ed. (1996), section 2.3; A. G. Davenport,
    The spectrum of horizontal gustiness near the ground in high winds, Q. J. R. Meteorol. Soc. 87, 194 (1961); T. von Karman,
    Progress in the statistical theory of turbulence, PNAS 34, 530 (1948), isotropic.
    """
    height = height_in_layer(wind, height)[:, None]
    speed = np.maximum(mean_speed(wind, height), 1e-6 * float(wind["speed"]))
    name, n = str(turbulence["spectrum"]), np.asarray(frequency, dtype=float)[None, :]
    if name == "kaimal":
        f, friction = n * height / speed, friction_velocity(wind)
        size, width = (15.0, 9.5) if across else (200.0, 50.0)
        root = np.cbrt(1.0 + width * f)
        return size * friction**2 * (height / speed) / (root * root * root * root * root)
    if name == "davenport":
        x = 1200.0 * n / float(mean_speed(wind, np.array(10.0)))
        size = friction_velocity(wind) * (DAVENPORT_ACROSS if across else 1.0)
        return np.broadcast_to(size**2 * 4.0 * x**2 / (1.0 + x**2) ** (4.0 / 3.0) / n, (height.size, n.size))
    variance = (float(turbulence["intensity"]) * float(wind["speed"])) ** 2
    if not across:
        f = n * float(turbulence["length_scale"]) / speed
        return variance * 4.0 * f / (1.0 + 70.8 * f**2) ** (5.0 / 6.0) / n
    f = n * 0.5 * float(turbulence["length_scale"]) / speed
    return variance * 4.0 * f * (1.0 + 755.2 * f**2) / (1.0 + 283.2 * f**2) ** (11.0 / 6.0) / n
