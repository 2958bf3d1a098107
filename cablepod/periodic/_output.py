"""Labelled results of periodic responses: names, units, attributes, warnings, history."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.conventions import COORDINATES, ENDS, STILL_AIR, label
from cablepod.errors import OutOfRangeWarning, RunStopped, warn
from cablepod.integrate._output import middles_of, particle_coordinates
from cablepod.periodic._fields import mode_amplitudes
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import State
from cablepod.pod._normal import SETS
from cablepod.reduced._validity import MAX_FORCING_RATIO, first_axial_frequency

#: Share of the motion in a harmonic that counts for the comparison with axial frequencies.
SIGNIFICANT_HARMONIC = 1e-2
#: Name -> (units, long name) of the variables of this sub-package.
NAMES: dict[str, tuple[str, str]] = {
    "angular_frequency": ("rad s-1", "angular frequency of the forcing"),
    "mode": ("1", "number of the mode, its label in the modes given"),
    "point": ("1", "number of the point, from 1, along one branch after the other"),
    "branch": ("1", "number of the branch, from 1"),
    "amplitude": ("m", "half of the range of the amplitude of the mode over a period"),
    "amplitude_out_of_plane": ("m", "half of the range of the amplitude of the mode out of the plane over a period"),
    "deflection_maximum": ("m", "largest deflection normal to the chord, from its mean over a period"),
    "stable": ("1", "whether no Floquet multiplier lies outside of the unit circle"),
    "growth": ("s-1", "growth rate of the fastest disturbance"),
    "multiplier": ("1", "number of the Floquet multiplier"),
    "multiplier_real": ("1", "real part of the Floquet multiplier"),
    "multiplier_imag": ("1", "imaginary part of the Floquet multiplier"),
    "multiplier_set": ("1", "coordinates of the disturbance"),
    "periods": ("1", "number of periods of the forcing in one of the motion"),
    "harmonic_count": ("1", "number of harmonics"),
    "harmonic_tail": ("1", "share of the last two harmonics in the motion"),
    "harmonic": ("1", "number of the harmonic of the motion, 0 for the mean"),
    "harmonic_cosine": ("m", "cosine coefficient of the amplitude of the mode"),
    "harmonic_sine": ("m", "sine coefficient of the amplitude of the mode"),
    "harmonic_cosine_out_of_plane": ("m", "cosine coefficient of the amplitude of the mode out of the plane"),
    "harmonic_sine_out_of_plane": ("m", "sine coefficient of the amplitude of the mode out of the plane"),
    "tension_minimum": ("N", "smallest tension of the link over a period"),
    "tension_maximum": ("N", "largest tension of the link over a period"),
    "smallest_chordwise_force": ("N", "smallest chordwise force over a period"),
    "bifurcation": ("1", "number of the bifurcation, from 1"),
    "bifurcation_kind": ("1", "what happens at the bifurcation"),
    "bifurcation_set": ("1", "coordinates of the disturbance that becomes unstable"),
    "bifurcation_angular_frequency": ("rad s-1", "angular frequency of the forcing at the bifurcation"),
    "bifurcation_branch": ("1", "branch on which the bifurcation lies"),
    "bifurcation_deflection_maximum": ("m", "largest deflection at the bifurcation, from its mean over a period"),
    "leads_to": ("1", "branch that leaves at the bifurcation, 0 for none that was followed"),
}


def indexes(model: PeriodicModel) -> dict[str, Any]:
    """Return the coordinates of results on the particles and modes of the model."""
    chain = model.condensed.chain
    return {
        "mode": np.array(model.condensed.mode_numbers),
        "end": list(ENDS),
        **particle_coordinates(chain),
        "link_arc_length": (("link",), middles_of(chain.arc_length)),
    }


def dataset(
    model: PeriodicModel, variables: Mapping[str, Any], coords: Mapping[str, Any], **names: tuple[str, str]
) -> xr.Dataset:
    """Make a labelled Dataset, with those coordinates of :func:`indexes` that its variables need."""
    used = {dim for dims, _ in variables.values() for dim in dims}
    known = {
        name: value
        for name, value in indexes(model).items()
        if used.issuperset(value[0] if isinstance(value, tuple) else (name,)) and name not in coords
    }
    if "coordinate" in used:
        count = next(
            np.shape(value)[dims.index("coordinate")] for dims, value in variables.values() if "coordinate" in dims
        )
        known["coordinate"] = list(COORDINATES[:count])
    result = xr.Dataset({name: (dims, value) for name, (dims, value) in variables.items()}, {**known, **coords})
    return label(result, **{name: text for name, text in (NAMES | names).items() if name in result.variables})


def padded(values: np.ndarray, count: int) -> np.ndarray:
    """Fill the last dimension up to `count` modes with nan."""
    missing = count - values.shape[-1]
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, missing)], constant_values=np.nan) if missing else values


def per_set(model: PeriodicModel, name: str, dims: tuple[str, ...], parts: list[np.ndarray]) -> dict[str, Any]:
    """Return one variable (..., mode) for each set of modes."""
    count = max(len(shapes) for shapes in model.sets)
    return {
        f"{name}{suffix}": ((*dims, "mode"), padded(part, count)) for suffix, part in zip(SETS, parts, strict=False)
    }


def harmonic_variables(model: PeriodicModel, state: State) -> dict[str, Any]:
    """Return the coefficients of the harmonics as amplitudes of the modes."""
    c = state.full(model).coefficients * model.scales[1]
    cosine, sine = np.zeros((state.harmonics + 1, model.size)), np.zeros((state.harmonics + 1, model.size))
    cosine[0], cosine[1:], sine[1:] = c[0], c[1::2], c[2::2]
    return per_set(model, "harmonic_cosine", ("harmonic",), mode_amplitudes(model, cosine)) | per_set(
        model, "harmonic_sine", ("harmonic",), mode_amplitudes(model, sine)
    )


def significant_harmonic(state: State) -> float:
    """Return the highest significant harmonic over that of the forcing."""
    c = state.coefficients
    size = np.sqrt((c[1::2] ** 2).sum(axis=1) + (c[2::2] ** 2).sum(axis=1))
    found = np.flatnonzero(size > SIGNIFICANT_HARMONIC * max(size.max(initial=0.0), 1e-300))
    return float(found[-1] + 1) / state.periods if found.size else 1.0


def axial_attributes(model: PeriodicModel, harmonic_frequency: float) -> dict[str, float]:
    """Compare the highest significant angular frequency [rad/s] with the first axial one."""
    chain = model.condensed.chain
    axial = float(first_axial_frequency(chain.p, chain.total_length))
    return {"first_axial_frequency": axial, "forcing_over_axial_frequency": harmonic_frequency / axial}


def warn_of_result(attrs: Mapping[str, Any], undamped: str) -> None:
    """Warn of slack cables, waves along the cable, and of stability that no damping decides: `undamped` tells of what."""
    if attrs.get("smallest_chordwise_force", 1.0) < 0.0:
        warn(
            f"the chordwise force falls to {attrs['smallest_chordwise_force']:.3g} N, below zero: the cable goes slack there, "
            "and the condensed model is ill-posed; compare with chain.simulate",
            OutOfRangeWarning,
        )
    ratio = attrs.get("forcing_over_axial_frequency", 0.0)
    if ratio > MAX_FORCING_RATIO:
        warn(
            f"harmonics of the motion reach {ratio:.2g} times the first axial frequency, {attrs['first_axial_frequency']:.3g} "
            f"rad/s (above {MAX_FORCING_RATIO}): the condensed model lacks waves along the cable; compare with chain.simulate",
            OutOfRangeWarning,
        )
    if undamped:
        warn(
            f"{undamped}: responses that are not unstable are neutral, not attracting; give damping.mass_proportional",
            OutOfRangeWarning,
        )


def record(
    result: xr.Dataset,
    function: str,
    scene: xr.Dataset,
    modes: xr.Dataset,
    parameters: Mapping[str, Any],
    more: tuple[xr.Dataset, ...] = (),
    *,
    kept: str = "",
) -> xr.Dataset:
    """Append the stage to the history of the result; after Ctrl-C mark it and raise RunStopped with what was `kept`."""
    title = str(scene.attrs.get("title", "scene"))
    attrs = {name: value for name, value in result.attrs.items() if value is not None}
    title = f"{title}: {function.replace('periodic.', '').replace('_', ' ')}"
    result.attrs = {"title": title, "stage": "periodic", "air": STILL_AIR} | attrs
    if kept:
        result.attrs["incomplete"] = 1
    chosen, inputs = provenance.defaulted_options(**parameters), (scene, modes, *more)
    result = provenance.record(result, function=function, parameters=parameters, inputs=inputs, chosen=chosen)
    if kept:
        raise RunStopped(f"{function} was interrupted after {kept}; try `partial`, which has them", result)
    return result
