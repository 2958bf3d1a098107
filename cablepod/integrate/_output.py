"""Labelled results of all models: variables and attributes of trajectories, equilibria, results of stopped runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

import numpy as np
import xarray as xr

from cablepod.conventions import COORDINATES, labelled_dataset
from cablepod.discretisation._chain import LumpedChain, square
from cablepod.errors import RunStopped
from cablepod.integrate._means import MEANS, Means
from cablepod.integrate._output_times import OutputTimes
from cablepod.parameters._parameters import Parameters

#: Dimensions of the variables of a trajectory.
PARTICLES, LINKS = ("time", "particle", "coordinate"), ("time", "link")
#: Minimum and maximum of the tensions over all steps (n,) [N]; None if they are not requested.
Extremes = tuple[np.ndarray, np.ndarray] | None
DIMS = {"position": PARTICLES, "velocity": PARTICLES, "tension": LINKS}


def chain_coordinates(chain: LumpedChain, *, has_links: bool) -> dict[str, Any]:
    """Return the coordinates of a result on the particles of a chain, or on the output particles of a mesh.

    `has_links` tells whether it has variables of the links between them.  Neither particles nor links have labels, by which
    xarray would pair those of the same number in results of different meshes.
    """
    coords: dict[str, Any] = particle_coordinates(chain)
    if has_links:
        coords["link_arc_length"] = (LINKS[1:], middles_of(chain.particles))
    return {**coords, "coordinate": np.array(COORDINATES[: chain.p.dims])}


def particle_coordinates(chain: LumpedChain) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return the coordinates of particles: their arc lengths, and their masses where these are their own."""
    values = {"arc_length": chain.particles, "particle_mass": chain.own_masses}
    return {name: (PARTICLES[1:2], array) for name, array in values.items() if array is not None}


def middles_of(arc_length: np.ndarray) -> np.ndarray:
    """Return the unstretched arc lengths of the middles of links (n,) [m] for those of their particles (n + 1,) [m]."""
    return 0.5 * (arc_length[1:] + arc_length[:-1])


def is_over_links(variables: Mapping[str, Any]) -> bool:
    """Tell whether some of the variables, name -> (dimensions, values), are over ``link``."""
    return any("link" in dims for dims, _ in variables.values())


def law_suffix(chain: LumpedChain) -> str:
    """Return the part of a title that names the law, empty for the linear one."""
    return f", {chain.law} law" if chain.green else ""


def trajectory_variables(
    outputs: tuple[str, ...],
    extremes: Extremes,
    values: Mapping[str, Callable[[], np.ndarray]],
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return dimensions and values of the requested variables of a trajectory.

    Parameters
    ----------
    outputs
        Names of the requested ones.
    extremes
        Minimum and maximum of the tensions (n,) [N]; None if they are not requested.
    values
        Functions that compute "position" [m], "velocity" [m/s] (times, n + 1, dims) and "tension" (times, n) [N].
    """
    result = {name: (DIMS[name], compute()) for name, compute in values.items() if name in outputs}
    if extremes is not None:
        result["tension_minimum"], result["tension_maximum"] = ((("link",), extreme) for extreme in extremes)
    return result


def peak_variables(
    extremes: Extremes, times: tuple[float, float] | None, arc_length: np.ndarray
) -> dict[str, tuple[tuple[str, ...], float]]:
    """Return dimensions and values of time and place of the extremes of all links; none where they are not requested.

    Parameters
    ----------
    extremes
        Minimum and maximum of the tensions (n,) [N].
    times
        Times of the smallest and the largest [s]; None if they are not requested.
    arc_length
        Unstretched arc length from the lower end to the middle of the links (n,) [m].
    """
    if extremes is None or times is None:
        return {}
    places = (arc_length[int(extremes[0].argmin())], arc_length[int(extremes[1].argmax())])
    result: dict[str, tuple[tuple[str, ...], float]] = {}
    for name, time, place in zip(("tension_minimum", "tension_maximum"), times, places, strict=True):
        result[f"{name}_time"], result[f"{name}_arc_length"] = ((), time), ((), float(place))
    return result


def mean_variables(outputs: tuple[str, ...], means: Means) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return dimensions and values of those of the mean and the root mean square of the tensions that are requested."""
    values = () if means is None else means
    return {name: (("link",), value) for name, value in zip(MEANS, values, strict=False) if name in outputs}


def trajectory_attributes(model: str, scheme: str, instants: OutputTimes, **options: Any) -> dict[str, Any]:
    """Return the attributes that all trajectories have, and the options of the model."""
    return {
        "stage": "trajectory",
        "model": model,
        **options,
        "scheme": scheme,
        "step": 1.0 / instants.steps_per_second,
        "number_of_steps": int(instants.steps[-1]),
    }


def time_scale_attributes(p: Parameters) -> dict[str, float]:
    """Return the shortest time scale of motions and loads [s] as an attribute; none where there are none."""
    scale = float(p.shortest_time_scale)
    return {"shortest_time_scale": scale} if math.isfinite(scale) else {}


def rest_dataset(
    position: np.ndarray,
    tension: np.ndarray,
    unbalanced: np.ndarray,
    coords: Mapping[str, Any],
    scalars: Mapping[str, Any],
    **attrs: Any,
) -> xr.Dataset:
    """Make the result of an equilibrium.

    Parameters
    ----------
    position
        Positions of the output particles (particle, dims) [m].
    tension
        Tensions between them (link,) [N].
    unbalanced
        Forces left on the inner particles (inner, dims) [N].
    coords, scalars
        Coordinates and scalar variables.
    **attrs
        Attributes, the title first.
    """
    scalars = {**scalars, "residual": float(np.sqrt(square(unbalanced)).max(initial=0.0))}
    variables: dict[str, Any] = {"position": (PARTICLES[1:], position), "tension": (LINKS[1:], tension)}
    variables |= {name: ((), value) for name, value in scalars.items()}
    further = {name: given for name, given in coords.items() if isinstance(given, tuple)}
    labels = {name: np.asarray(given) for name, given in coords.items() if name not in further}
    result = labelled_dataset(variables, labels, further)
    result.attrs = {"stage": "rest", **attrs}
    return result


def stop(partial: xr.Dataset | None, time: float, end_time: float, why: str) -> NoReturn:
    """Raise :class:`cablepod.errors.RunStopped` at `time` [s] with the result before it, marked as incomplete."""
    if partial is not None:
        partial.attrs["incomplete"] = f"stopped at {time:.6g} s of {end_time:.6g} s"
    raise RunStopped(why, partial)
