"""Snapshots of a trajectory: checks, positions, weights of the particles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from cablepod._inputs import ROUNDING, floats
from cablepod.discretisation._interpolation import are_same
from cablepod.errors import SceneError
from cablepod.parameters._particles import tributary_lengths
from cablepod.pod._blocks import read_blocks

#: Coordinate of the masses of the particles.
MASS = "particle_mass"


def arc_length_of(snapshots: xr.Dataset) -> np.ndarray:
    """Return the arc length (particle) [m], of the first member if there are several."""
    s = snapshots.variables["arc_length"]  # ten times as fast as a DataArray
    return floats(
        s.values if s.ndim == 1 else s.transpose("particle", ...).values.reshape(s.sizes["particle"], -1)[:, 0]
    )


def relative_arc_length(dataset: xr.Dataset) -> np.ndarray:
    """Return sigma = S / L0 of the particles, from 0 to 1."""
    s = arc_length_of(dataset)
    return s / s[-1]


def tributary_weights(sigma: np.ndarray) -> np.ndarray:
    """Return the tributary lengths of the particles (particle), scaled to mean 1 over the inner particles."""
    length = tributary_lengths(np.diff(sigma))
    return length / length[1:-1].mean()


def particle_weights(dataset: xr.Dataset, weights: str | None) -> np.ndarray:
    """Return the weights of the particles (particle), of mean 1 over the inner ones.

    Parameters
    ----------
    dataset
        Snapshots or modes.
    weights
        None for equal weights, "length" for the tributary lengths, "mass" for the masses of the particles, which are in the ratio
        of these lengths unless the chain has masses of its own.
    """
    if weights is None:
        return np.ones(dataset.sizes["particle"])
    mass = masses_of(dataset) if weights == "mass" else None
    return tributary_weights(relative_arc_length(dataset)) if mass is None else mass / mass[1:-1].mean()


def weight_roots(dataset: xr.Dataset, weights: str | None) -> np.ndarray:
    """Return the square roots of the weights of the inner particles."""
    return np.sqrt(particle_weights(dataset, weights)[1:-1])


def masses_of(dataset: xr.Dataset) -> np.ndarray | None:
    """Return the masses of the particles (particle) [kg] of a chain with masses of its own; None for others.

    Raises
    ------
    SceneError
        For members whose particles have other ratios of masses, and for masses that are not above 0.
    """
    if MASS not in dataset.variables:
        return None
    mass = dataset.variables[MASS]
    rows = floats(mass.transpose(..., "particle").values.reshape(-1, mass.sizes["particle"]))
    if not (np.isfinite(rows).all() and rows.min() > 0.0):
        raise SceneError(f"snapshots: given values of {MASS} that are not finite and above 0; allowed: masses [kg]")
    relative = rows[:, 1:-1] / rows[:, 1:-1].sum(axis=1, keepdims=True)  # ends do not take part
    if np.abs(relative / relative[0] - 1.0).max() > ROUNDING:
        raise SceneError(
            f'weights: given "mass" and members with different ratios of {MASS}; allowed: "length" or None; try: each by itself'
        )
    return rows[0]


def position_of(snapshots: xr.Dataset) -> xr.DataArray:
    """Return the positions, possibly lazy, after checks of their particles."""
    position = snapshots["position"]
    if position.sizes["particle"] < 3:
        raise SceneError(
            f"snapshots: given {position.sizes['particle']} particles; allowed: at least 3, because modes vanish at both ends"
        )
    _check_members(snapshots["arc_length"])
    return position


def _check_members(lengths: xr.DataArray) -> None:
    """Refuse members whose particles lie at different S / L0, which do not form one snapshot matrix."""
    if lengths.ndim == 1:
        return
    lead = [name for name in lengths.dims if name != "particle"]
    s = lengths.transpose(*lead, "particle").values.reshape(-1, lengths.sizes["particle"])
    names = lengths[lead[0]].values if len(lead) == 1 else np.arange(len(s))
    # xarray pads members of different shapes with nan
    counts = np.isfinite(s).sum(axis=1)
    if counts.min(initial=s.shape[1]) < s.shape[1]:
        kinds = [f"{number} particles in {_first_names(names[counts == number])}" for number in np.unique(counts)]
        raise SceneError(f"snapshots: given members with {', '.join(kinds)}; allowed: the same particles in all")
    sigma = s / s[:, -1:]
    differs = np.abs(sigma - sigma[0]).max(axis=1) > ROUNDING
    if differs.any():
        raise SceneError(
            f"snapshots: given members with particles at different S / L0, the members {_first_names(names[differs])} differ "
            "from the first one; allowed: the same particles in all"
        )


def check_same_particles(parts: Sequence[xr.Dataset]) -> None:
    """Refuse trajectories with different particles or coordinates."""
    if not parts:
        raise SceneError("snapshots: given no trajectory; allowed: at least one")
    if len(parts) == 1:
        return
    counts = [position_of(part).sizes["particle"] for part in parts]
    if len(set(counts)) > 1:
        places = np.arange(len(parts))
        kinds = [
            f"{number} particles in {_first_names(places[np.equal(counts, number)])}" for number in sorted(set(counts))
        ]
        raise SceneError(f"snapshots: given trajectories with {', '.join(kinds)}; allowed: the same particles in all")
    different = [place for place, part in enumerate(parts) if not are_alike(part, parts[0])]
    if different:
        raise SceneError(
            "snapshots: given trajectories with particles at different S / L0 or with other coordinates, the trajectories "
            f"{_first_names(np.array(different))} differ from the first one; allowed: the same in all"
        )


def are_alike(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Tell whether two Datasets have the same particles S / L0 and coordinates."""
    same = are_same(relative_arc_length(first), relative_arc_length(second))
    return same and first["coordinate"].values.tolist() == second["coordinate"].values.tolist()


def check_same_masses(first: xr.Dataset, second: xr.Dataset) -> None:
    """Refuse trajectories on particles with other ratios of masses, which have no common inner product by mass."""
    weight, other = (particle_weights(part, "mass")[1:-1] for part in (first, second))
    if np.abs(other / weight - 1.0).max() > ROUNDING:
        raise SceneError(
            'weights: given "mass" and trajectories of chains with different ratios of the masses of their particles; allowed: '
            '"length" or None'
        )


def _first_names(names: np.ndarray) -> str:
    """Return the first five names as text."""
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return str(names[:5].tolist()) + more


def broken_member(position: xr.DataArray) -> str:
    """Return " in member ..." for the first member with non-finite positions, or an empty text."""
    if "member" not in position.dims:
        return ""
    names = position["member"].values
    for number, name in enumerate(names):
        if not all(np.isfinite(block).all() for block in read_blocks(position.isel(member=number))):
            return f" in member {name}"
    return ""


def positions(snapshots: xr.Dataset) -> np.ndarray:
    """Return the positions (samples, particle, coordinate) [m]; further dimensions count as samples.

    Raises
    ------
    SceneError
        If positions are missing or not finite.
    """
    position = position_of(snapshots).transpose(..., "time", "particle", "coordinate").values
    position = floats(position.reshape(-1, *position.shape[-2:]))
    if not np.isfinite(position).all():
        where = broken_member(snapshots["position"])
        raise SceneError(f"snapshots: position is not finite everywhere{where}; allowed: finite numbers")
    return position
