"""Diagnostics of the validity of reduced models, their thresholds and warnings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import NO_MOTION
from cablepod.errors import OutOfRangeWarning, SceneError, warn
from cablepod.parameters._parameters import Parameters

#: Maximum ratio of the forcing frequency to the first axial one (above, waves run along the cable, which neither the condensed
#: model nor modes of slower motion contain).
MAX_FORCING_RATIO = 0.2
#: Maximum condition number of the modes' mass products (above, the modes are linearly dependent up to rounding).
MAX_MODE_CONDITION = 1e12
#: Maximum estimated error as a fraction of the motion (above, the modes do not represent the motion).
MAX_ESTIMATED_ERROR = 0.5
#: Maximum tension of law (21) over that of the linear law, less 1 (above, the motion is that of another material: where tension
#: holds the cable in place, positions differ by two to three times this fraction of the motion).
MAX_EXTRA_TENSION = 0.05


def check_independent(gram: np.ndarray) -> None:
    """Refuse modes whose mass products (modes, modes) show that some are sums of others."""
    if gram.size and not np.linalg.cond(gram) < MAX_MODE_CONDITION:
        raise SceneError("modes: given some that are sums of others; allowed: independent ones, as pod.decompose gives")


def first_axial_frequency(p: Parameters, length: Any) -> Any:
    """Return the first axial angular frequency pi/L sqrt(K/mu) of a cable of unstretched `length` [m] [rad/s]."""
    return math.pi / length * np.sqrt(p.stiffness / p.mass)


def forcing_attributes(p: Parameters, length: Any) -> dict[str, Any]:
    """Compare the forcing frequency with the first axial frequency of a cable of unstretched `length` [m].

    Returns numbers for one scene, arrays for stacked members: ``first_axial_frequency`` [rad/s] and
    ``forcing_over_axial_frequency``, 0 where nothing changes.
    """
    axial = first_axial_frequency(p, length)
    return {
        "first_axial_frequency": axial,
        "forcing_over_axial_frequency": 2.0 * math.pi / p.shortest_time_scale / axial,
    }


def check_forcing(attrs: Mapping[str, Any], lacking: str, prefix: str = "") -> None:
    """Warn where loads or ends change so fast that waves run along the cable."""
    ratio, axial = attrs["forcing_over_axial_frequency"], attrs["first_axial_frequency"]
    if ratio > MAX_FORCING_RATIO:
        warn(
            f"{prefix}loads or ends change with {ratio:.2g} times the first axial frequency, {axial:.3g} rad/s (above "
            f"{MAX_FORCING_RATIO}): {lacking} waves along the cable; compare with chain.simulate",
            OutOfRangeWarning,
        )


def check_estimate(attrs: Mapping[str, Any], prefix: str = "") -> None:
    """Warn where the estimated error exceeds half of the motion."""
    error = attrs.get("error_estimate", 0.0)
    if error > MAX_ESTIMATED_ERROR:
        of = f" of the model {attrs['model']}, r = {attrs['rank']}" if "model" in attrs and "rank" in attrs else ""
        warn(
            f"{prefix}the model expects an error of {error:.2g} times the motion (error_estimate{of}, above "
            f"{MAX_ESTIMATED_ERROR}): "
            "the modes do not represent this scene; give more modes, modes trained nearer to it, or compare with chain.simulate",
            OutOfRangeWarning,
        )


def _check_slack(attrs: Mapping[str, Any], prefix: str = "") -> None:
    """Warn where the chordwise force becomes negative."""
    if attrs["smallest_chordwise_force"] < 0.0:
        implicit = attrs["scheme"] != "velocity_verlet"
        long_step = f" (or the step of {attrs['step']:g} s does not resolve the motion)" if implicit else ""
        warn(
            f"{prefix}the chordwise force falls to {attrs['smallest_chordwise_force']:.3g} N at "
            f"{attrs['time_of_smallest_force']:.4g} s, below zero: the cable goes slack there, and the condensed "
            f"model is ill-posed{long_step}; compare with chain.simulate",
            OutOfRangeWarning,
        )


def _check_forcing(attrs: Mapping[str, Any], prefix: str = "") -> None:
    """Warn of waves along the cable, for the condensed model."""
    check_forcing(attrs, "the condensed model lacks", prefix)


#: Diagnostic -> (sign, threshold of sign times diagnostic, warning function).
CHECKS = {
    "smallest_chordwise_force": (-1.0, 0.0, _check_slack),
    "forcing_over_axial_frequency": (1.0, MAX_FORCING_RATIO, _check_forcing),
    "error_estimate": (1.0, MAX_ESTIMATED_ERROR, check_estimate),
}


def warn_condensed_out_of_range(attrs: Mapping[str, Any]) -> None:
    """Warn of diagnostics of a condensed run beyond their thresholds."""
    for *_, check in CHECKS.values():
        check(attrs)


def warn_condensed_members(attrs: Mapping[str, list[Any]]) -> None:
    """Warn once for all members of each diagnostic, with the worst member."""
    for name, (sign, threshold, check) in CHECKS.items():
        values = sign * np.array(attrs.get(name, []), dtype=float)
        exceeds = values > threshold
        if exceeds.any():
            i = int(np.nanargmax(values))
            worst = {key: member_values[i] for key, member_values in attrs.items()}
            check(worst, f"{int(exceeds.sum())} of {exceeds.size} members, of these number {i} the worst: ")


def energy_attributes(modes: xr.Dataset | None, *ranks: int) -> dict[str, float]:
    """Return ``energy_share_kept``, the share of the snapshots' energy in the modes of a run, the least one of the sets of modes.

    Sets are those of the coordinates with layout "separate", of the deflections with "normal".  One along which the snapshots do
    not move has no energy to keep.  Empty for modes without shares.

    Parameters
    ----------
    modes
        Modes of the run, if it has any.
    ranks
        How many modes it has of each set; with layout "normal" a number for each deflection.
    """
    shares, sizes = [], []
    for suffix, rank in zip(("", "_out_of_plane"), ranks, strict=False):
        names = (f"energy_share{suffix}", f"singular_value{suffix}")
        if modes is None or not all(name in modes.variables for name in names):
            return {}
        share, values = (np.atleast_2d(modes.variables[name].transpose(..., "mode").values) for name in names)
        shares.append(share[:, :rank].sum(axis=1))
        sizes.append(values.max(axis=1))
    share, size = np.concatenate(shares), np.concatenate(sizes)
    return {"energy_share_kept": float(share[size > NO_MOTION * size.max()].min(initial=1.0))}


def law_attributes(law: str, stretch: float) -> dict[str, float]:
    """Return ``tension_above_linear_law``, that of law (21) over that of the linear law at a stretch, less 1; none for others."""
    if law != "green":
        return {}
    return {"tension_above_linear_law": 0.5 * stretch * (stretch + 1.0) - 1.0}  # xi (xi^2 - 1) / 2 over xi - 1


def warn_galerkin_out_of_range(attrs: Mapping[str, Any]) -> None:
    """Warn of diagnostics of a Galerkin run beyond their thresholds."""
    if attrs["smallest_stretch"] < 1.0:
        warn(
            f"links are compressed, to {attrs['smallest_stretch']:.6g} of their unstretched length (smallest_stretch): a cable "
            "goes slack there, and few modes do not represent its kinks; compare with chain.simulate",
            OutOfRangeWarning,
        )
    extra_tension = attrs.get("tension_above_linear_law", 0.0)
    if extra_tension > MAX_EXTRA_TENSION:
        warn(
            f"links are stretched to {attrs['largest_stretch']:.4g} of their unstretched length (largest_stretch), where law "
            f"(21) has {100.0 * extra_tension:.2g} % more tension than the linear law of the same stiffness "
            f"(tension_above_linear_law, above {100.0 * MAX_EXTRA_TENSION:g} %): the motion is that of another material than in "
            'chain.simulate; give law="linear" unless eq. (21) is the law of the cable',
            OutOfRangeWarning,
        )
    if attrs.get("outside_training", math.inf) > 0.0:
        check_forcing(attrs, "modes of slower motion lack")
    check_estimate(attrs)
