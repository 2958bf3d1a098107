"""Compute Table 2 and the energy shares of Example 3 from initial shapes that explain them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from cablepod import chain, pod
from cablepod.errors import RunStopped, SceneError
from cablepod.examples import scene, table
from cablepod.paper.datasets import described
from cablepod.paper.examples import SUMMED, misfit, printed_values, share_of_five
from cablepod.paper.table1 import inextensible

#: Time step of the runs [s] (half of it changes the ten values by at most 3e-4 as long as no link slackens).
STEP = 2.5e-4
#: Initial sags of Example 3 over that of equilibrium, and time steps [s] (links slacken, results depend on the step).
EXAMPLE_3_SAGS = (0.55, 0.6, 0.62, 0.64, 0.66)
EXAMPLE_3_STEPS = (1.6e-4, 1.25e-4)


def with_start(base: xr.Dataset, start: Mapping[str, Any]) -> xr.Dataset:
    """Return a scene with cable and initial shape of a row of ``data/starts.csv``; nan entries change nothing."""
    values = {key: float(value) for key, value in start.items() if key != "name" and not np.isnan(value)}
    metre, newton = {"units": "m"}, {"units": "N"}
    result = base
    if "cable_length_m" in values:
        length = ((), values["cable_length_m"], metre)
        result = result.drop_vars("cable_top_tension").assign(cable_unstretched_length=length)
    if "cable_tension_N" in values:
        result = result.assign(cable_top_tension=((), values["cable_tension_N"], newton))
    if "start_length_m" in values:
        result = result.assign(initial_unstretched_length=((), values["start_length_m"], metre))
    if "start_tension_N" in values:
        result = result.assign(initial_top_tension=((), values["start_tension_N"], newton))
    if "start_sag" in values:
        line = _sagging_line(base, values["start_sag"])
        result = result.assign(initial_points=(("initial_points_point", "coordinate"), line, metre))
    if "mass_damping_per_s" in values:
        result = result.assign(damping_mass_proportional=((), values["mass_damping_per_s"], {"units": "s-1"}))
    return result


def _sagging_line(base: xr.Dataset, sag: float, count: int = 400) -> np.ndarray:
    """Return points (count, 2) [m] on the inextensible catenary of a scene, its deflection scaled by `sag`."""
    curve = inextensible(base, float(base["cable_top_tension"]))
    x = np.linspace(0.0, curve.a, count)
    straight = curve.b * x / curve.a
    return np.stack([x, straight + sag * (curve.height(x) - straight)], axis=1) + base["ends_lower"].values


def tried(*, progress: Callable[[float], None] | None = None) -> xr.Dataset:
    """Compute the ten values of Table 2 for every initial shape of ``data/starts.csv``.

    Returns
    -------
    xarray.Dataset
        ``tried_singular_value (tried, coordinate, table2_row)`` [m], ``tried_sum (tried, coordinate)`` [m],
        ``tried_sag (tried)``, ``tried_misfit (tried)``, ``tried_misfit_3 (tried)``; nan for initial shapes from which the run
        stops because links slacken.
    """
    target, rows, base = printed_values(), table("starts"), scene("example2")
    names = [str(name) for name in rows["name"]]
    values, sags = np.full((len(names), 2, SUMMED), np.nan), np.empty(len(names))
    for i in range(len(names)):
        changed = with_start(base, {key: column[i] for key, column in rows.items()})
        values[i] = simulated(changed)
        first = chain.simulate(changed, times=[0.0], step=STEP)["position"].values[0]
        sags[i] = _sag(first) / _sag(chain.rest(changed)["position"].values)
        if progress is not None:
            progress((i + 1) / len(names))
    count = target.shape[1]
    return described(
        "initial_shape.tried", {"step": STEP},
        {
            "tried_singular_value": (("tried", "coordinate", "table2_row"), values[..., :count],
                "m", "singular value of the centred, lifted snapshots"),
            "tried_sum": (("tried", "coordinate"), values.sum(axis=-1), "m", "sum of 20 singular values"),
            "tried_sag": ("tried", sags, "1", "sag of the start over that of the cable at rest"),
            "tried_misfit": ("tried", misfit(values[..., :count], target),
                "1", "rms of ln(ours / print) over all rows and both columns"),
            "tried_misfit_3": ("tried", misfit(values[..., :3], target[:, :3]),
                "1", "rms of ln(ours / print) over the first three rows and both columns"),
        },
        {
            "tried": (names, "1", "start of Example 2 that was tried"),
            "coordinate": (["x", "y"],),
            "table2_row": (np.arange(1, count + 1), "1", "row of Table 2"),
        },
        [base],
    )  # fmt: skip


def _sag(position: np.ndarray) -> float:
    """Return the largest distance from the chord [m], negative above it."""
    chord = position[-1] - position[0]
    below = (position - position[0]) @ np.array([chord[1], -chord[0]]) / np.hypot(*chord)
    return float(below[np.abs(below).argmax()])


def simulated(changed: xr.Dataset) -> np.ndarray:
    """Return singular values (coordinate, mode) [m] of a scene's chain; nan without a simulation."""
    try:
        return pod.decompose(chain.simulate(changed, step=STEP), rank=SUMMED)["singular_value"].values
    except (RunStopped, SceneError):  # diverged at this step, or no such cable
        return np.full((2, SUMMED), np.nan)


def example3(*, sags: Sequence[float] = EXAMPLE_3_SAGS, steps: Sequence[float] = EXAMPLE_3_STEPS) -> xr.Dataset:
    """Compute the energy shares of Example 3 at its printed tension from initial shapes of another sag.

    Returns
    -------
    xarray.Dataset
        ``sagging_share (relative_sag, sagging_step, coordinate)``: share of five in the sum of 20 singular values.
    """
    base = scene("example3")
    shares = np.empty((len(sags), len(steps), 2))
    for i, sag in enumerate(sags):
        changed = with_start(base, {"start_sag": sag})
        for j, step in enumerate(steps):
            shares[i, j] = share_of_five(pod.decompose(chain.simulate(changed, step=step), rank=SUMMED))
    return described(
        "initial_shape.example3", {"sags": list(sags), "steps": list(steps)},
        {
            "sagging_share": (("relative_sag", "sagging_step", "coordinate"), shares,
                "1", "share of five in the sum of 20 singular values of Example 3"),
        },
        {
            "relative_sag": (list(sags), "1", "sag of the start over that of equilibrium"),
            "sagging_step": (list(steps), "s", "time step"),
            "coordinate": (["x", "y"],),
        },
        [base],
    )  # fmt: skip
