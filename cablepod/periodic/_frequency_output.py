"""Labels and numbers of the branches of a frequency response."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod.periodic import _fields as fields
from cablepod.periodic import _output as output
from cablepod.periodic._continuation import Branch, Point
from cablepod.periodic._events import Event
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import State


def labelled(model: PeriodicModel, branches: list[Branch], events: list[Event], wanted: tuple[str, ...]) -> xr.Dataset:
    """Return branches and bifurcations as a Dataset with the outputs `wanted`."""
    scale = model.scales[0]
    points = [(branch, point) for branch in branches for point in branch.points]
    most = max(point.state.harmonics for _, point in points)
    rows: dict[str, list[Any]] = {}
    highest = 0.0
    for _, point in points:
        for name, value in _numbers(model, point, wanted, most).items():
            rows.setdefault(name, []).append(value)
        highest = max(highest, output.significant_harmonic(point.state) * point.state.omega * scale)
    variables: dict[str, Any] = {"branch": (("point",), np.array([branch.number for branch, _ in points]))}
    dims = {"tension_minimum": "link", "tension_maximum": "link", "multiplier_real": "multiplier",
            "multiplier_imag": "multiplier"}  # fmt: skip
    for name, values in rows.items():
        array = np.array(values)
        inner: tuple[str, ...] = (dims[name],) if name in dims else ("mode",) if array.ndim == 2 else ()
        if name.startswith("harmonic_") and array.ndim == 3:
            inner = ("harmonic", "mode")
        variables[name] = (("point", *inner), array)
    variables |= {
        "bifurcation_kind": (("bifurcation",), np.array([event.kind for event in events], dtype="U15")),
        "bifurcation_set": (("bifurcation",), np.array([event.which for event in events], dtype="U12")),
        "bifurcation_angular_frequency": (("bifurcation",), np.array([event.state.omega * scale for event in events])),
        "bifurcation_branch": (("bifurcation",), np.array([event.branch for event in events], dtype=int)),
        "bifurcation_deflection_maximum": (
            ("bifurcation",),
            np.array([fields.largest_deflection(model, _samples(model, event.state)) for event in events]),
        ),
        "leads_to": (("bifurcation",), np.array([event.leads_to for event in events], dtype=int)),
    }
    coords: dict[str, Any] = {"point": np.arange(1, len(points) + 1), "bifurcation": np.arange(1, len(events) + 1)}
    if "multipliers" in wanted:
        coords["multiplier"] = np.arange(1, 2 * model.size + 1)
    if "harmonics" in wanted:
        coords["harmonic"] = np.arange(most + 1)
    names = {"harmonic": ("1", "number of the harmonic of the motion, whose period is `periods` of the forcing")}
    result = output.dataset(model, variables, coords, **names)
    result.attrs.update(
        {f"branch_{branch.number}_ended": branch.ended for branch in branches},
        smallest_chordwise_force=float(np.min(result["smallest_chordwise_force"].values)),
        **output.axial_attributes(model, highest),
    )
    return result


def _samples(model: PeriodicModel, state: State) -> np.ndarray:
    """Return the coordinates at the phases of a period at which extremes are looked for (phases, r)."""
    return fields.coordinates(model, state, fields.PHASES * state.periods)


def _numbers(model: PeriodicModel, point: Point, wanted: tuple[str, ...], most: int) -> dict[str, Any]:
    """Return the numbers of one point by their names."""
    state, stability = point.state, point.stability
    assert stability is not None
    omega = state.omega * model.scales[0]
    q = _samples(model, state)
    found: dict[str, Any] = {
        "angular_frequency": omega,
        "deflection_maximum": fields.largest_deflection(model, q),
        "stable": stability.is_stable,
        "periods": state.periods,
        "harmonic_count": state.harmonics,
        "harmonic_tail": state.tail,
        "smallest_chordwise_force": stability.smallest_force,
    }
    ranges = [fields.half_range(part) for part in fields.mode_amplitudes(model, q)]
    found |= {name: value for name, (_, value) in output.per_set(model, "amplitude", (), ranges).items()}
    if "multipliers" in wanted:
        found |= {"multiplier_real": stability.multipliers.real, "multiplier_imag": stability.multipliers.imag}
    if "tension_extremes" in wanted:
        phase = 2.0 * np.pi / fields.PHASES * np.arange(len(q))
        tension = fields.tensions(model, *fields.close_chord(model, q, omega, phase))
        found |= {"tension_minimum": -fields.maximum(-tension), "tension_maximum": fields.maximum(tension)}
    if "harmonics" in wanted:
        for name, (_, value) in output.harmonic_variables(model, state).items():
            found[name] = np.pad(value, ((0, most - state.harmonics), (0, 0)))
    return found
