"""Range of validity of the reduced models: warnings with the number that decides."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod.errors import OutOfRangeWarning
from cablepod.parameters._members import MemberParameters
from cablepod.parameters._parameters import Parameters

#: Motion of the ends with a frequency above this share of the first axial one makes waves along the cable, which the condensed
#: model lacks, and modes of slower motion.
MAX_FORCING_RATIO = 0.2
#: An estimate of the error above this share of the motion says that the modes do not hold it.
MAX_ESTIMATED_ERROR = 0.5


def forcing_attributes(p: Parameters | MemberParameters, length: Any) -> dict[str, Any]:
    """Compare how fast ends and loads change with the first axial frequency of a cable of some unstretched length [m].

    Numbers for one scene, arrays for many members: ``first_axial_frequency`` pi/L sqrt(K/mu) [rad/s] and
    ``forcing_over_axial_frequency``, 0 where nothing changes.
    """
    axial = math.pi / length * np.sqrt(p.stiffness / p.mass)
    return {
        "first_axial_frequency": axial,
        "forcing_over_axial_frequency": 2.0 * math.pi / p.shortest_time_scale / axial,
    }


def check_forcing(attrs: Mapping[str, Any], what: str, which: str = "") -> None:
    """Warn where loads or ends change so fast that waves run along the cable."""
    ratio = attrs["forcing_over_axial_frequency"]
    if ratio > MAX_FORCING_RATIO:
        warnings.warn(
            f"{which}loads or ends change with {ratio:.2g} times the first axial frequency, {attrs['first_axial_frequency']:.3g} "
            f"rad/s (above {MAX_FORCING_RATIO}): {what} waves along the cable; compare with chain.simulate",
            OutOfRangeWarning,
            stacklevel=5,
        )


def check_estimate(attrs: Mapping[str, Any], which: str = "") -> None:
    """Warn where the model itself expects an error as large as the motion, or nearly."""
    error = attrs.get("error_estimate", 0.0)
    if error > MAX_ESTIMATED_ERROR:
        warnings.warn(
            f"{which}the model expects an error of {error:.2g} times the motion (error_estimate, above {MAX_ESTIMATED_ERROR}): these modes do "
            "not hold this scene; give more modes, or modes trained nearer to it, or compare with chain.simulate",
            OutOfRangeWarning,
            stacklevel=5,
        )


def _check_slack(attrs: Mapping[str, Any], which: str = "") -> None:
    if attrs["smallest_chordwise_force"] < 0.0:
        implicit = attrs["scheme"] != "velocity_verlet"
        long = f" (or the step of {attrs['step']:g} s is too long for what moves)" if implicit else ""
        warnings.warn(
            f"{which}the chordwise force falls to {attrs['smallest_chordwise_force']:.3g} N at "
            f"{attrs['time_of_smallest_force']:.4g} s, below zero: the cable goes slack there, and the condensed "
            f"model is ill-posed{long}; compare with chain.simulate",
            OutOfRangeWarning,
            stacklevel=5,
        )


def _check_forcing(attrs: Mapping[str, Any], which: str = "") -> None:
    check_forcing(attrs, "the condensed model lacks", which)


def _check_growth(attrs: Mapping[str, Any], which: str = "") -> None:
    if attrs.get("growth_over_run", 0.0) > 1.0:
        warnings.warn(
            f"{which}with these test functions small vibrations about rest grow, over the run by a factor of e to "
            f"{attrs['growth_over_run']:.3g} (growth_over_run, above 1): the scene is too far from those that they were "
            "trained on; train them nearer to it, or take the modes without them",
            OutOfRangeWarning,
            stacklevel=5,
        )


#: The number that decides -> what it is multiplied by, above what it is too much, what warns of it.
CHECKS = {
    "smallest_chordwise_force": (-1.0, 0.0, _check_slack),
    "forcing_over_axial_frequency": (1.0, MAX_FORCING_RATIO, _check_forcing),
    "growth_over_run": (1.0, 1.0, _check_growth),
    "error_estimate": (1.0, MAX_ESTIMATED_ERROR, check_estimate),
}


def warn_condensed_out_of_range(attrs: Mapping[str, Any]) -> None:
    """Warn where the numbers of a run say that the condensed model cannot be trusted."""
    for *_, check in CHECKS.values():
        check(attrs)


def warn_condensed_members(attrs: Mapping[str, list[Any]]) -> None:
    """Warn once for all members, by the worst of each kind."""
    for name, (sign, limit, check) in CHECKS.items():
        values = sign * np.array(attrs.get(name, []), dtype=float)
        bad = values > limit
        if bad.any():
            i = int(np.nanargmax(values))
            worst = {key: of_all[i] for key, of_all in attrs.items()}
            check(worst, f"{int(bad.sum())} of {bad.size} members, of these number {i} the worst: ")


def warn_galerkin_out_of_range(attrs: Mapping[str, Any]) -> None:
    """Warn where the numbers of a run say that the Galerkin model cannot be trusted."""
    if attrs["smallest_stretch"] < 1.0:
        warnings.warn(
            f"links are compressed, to {attrs['smallest_stretch']:.6g} of their unstretched length (smallest_stretch): a cable "
            "goes slack there, and few modes do not hold the kinks of that; compare with chain.simulate",
            OutOfRangeWarning,
            stacklevel=4,
        )
    if attrs.get("outside_training", math.inf) > 0.0:
        check_forcing(attrs, "modes of slower motion lack")
    check_estimate(attrs)
