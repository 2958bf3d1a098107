"""Static numbers of a scene, its first frequencies, and notes on what is unusual."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import SCENE, taken
from cablepod.cable._air import MeshAir
from cablepod.cable._frequencies import converged_vibrations
from cablepod.cable._mesh import mesh_of
from cablepod.cable._simulate import element_count
from cablepod.cable._start import equilibrium_in_wind
from cablepod.catenary._statics import load_plane
from cablepod.conventions import label
from cablepod.discretisation._chain import square
from cablepod.discretisation._similarity import features
from cablepod.errors import SceneError
from cablepod.parameters._from_scene import Members
from cablepod.parameters._parameters import Parameters
from cablepod.scene._notes import StaticNumbers, likely_keys, notes_of, static_numbers
from cablepod.wind._air import CableAir, mean_air_of

#: Number of frequencies in the plane and out of it.
FREQUENCIES = 3
#: Names of the frequencies, and points of the shape in the wind.
PLANES, POINTS = ("angular_frequency_in_plane", "angular_frequency_out_of_plane"), 401
#: Numbers that differ in still air, with the ending ``_still_air`` where the scene has wind.
AT_REST = (
    "stretched_length", "tension_lower", "tension_upper", "stress", "strain", "sag", "sag_over_chord", "utilisation", *PLANES,
)  # fmt: skip
#: Name -> (units, long name) of the numbers of a summary.
NUMBERS = {
    "chord": ("m", "distance of the ends"),
    "inclination": ("rad", "angle of the chord above the horizontal"),
    "weight_per_length": ("N m-1", "weight per unstretched length"),
    "mass_per_length": ("kg m-1", "mass per unstretched length"),
    "density": ("kg m-3", "mass per volume of the unstrained cable"),
    "axial_stiffness": ("N", "axial stiffness EA"),
    "unstretched_length": ("m", "unstretched length of the cable"),
    "stretched_length": ("m", "stretched length of the cable"),
    "tension_lower": ("N", "tension at the lower end"),
    "tension_upper": ("N", "tension at the upper end"),
    "horizontal_force": ("N", "component of the tension normal to the total load, constant along the cable"),
    "stress": ("Pa", "largest stress at rest"),
    "strain": ("1", "largest strain at rest"),
    "sag": ("m", "largest distance of the cable from the chord at rest"),
    "sag_over_chord": ("1", "sag over chord"),
    "irvine_parameter": ("1", "Irvine's parameter lambda squared"),
    "load_over_weight": ("1", "largest sum of the loads beside the weight, over the weight"),
    "motion_over_chord": ("1", "largest displacement of an end along an axis, over the chord"),
    "breaking_strength": ("N", "breaking strength of the cable"),
    "utilisation": ("1", "largest tension at rest over the breaking strength"),
}
#: The same of the frequencies, which have the dimension mode but for the axial one.
FREQUENCY_NUMBERS = {
    "angular_frequency_in_plane": ("rad s-1", "angular frequency of vibrations in the plane of chord and load"),
    "angular_frequency_out_of_plane": ("rad s-1", "angular frequency of vibrations out of this plane"),
    "first_axial_frequency": ("rad s-1", "first angular frequency of vibrations along the cable, taken as straight"),
}


def summary(scene: xr.Dataset) -> xr.Dataset:
    """Summarise a scene: static numbers, first frequencies, and notes on what is unusual.

    Parameters
    ----------
    scene
        A scene, with or without ``member``; it needs neither ``[time]`` nor ``[chain]``.

    Returns
    -------
    xarray.Dataset
        Scalars, or arrays along ``member``: ``chord`` [m], ``inclination`` [rad], ``weight_per_length`` [N/m],
        ``mass_per_length`` [kg/m], ``density`` [kg/m3], ``axial_stiffness`` [N], ``unstretched_length``, ``stretched_length``
        [m], ``tension_lower``, ``tension_upper``, ``horizontal_force`` [N], ``stress`` [Pa], ``strain``, ``sag`` [m],
        ``sag_over_chord``, ``irvine_parameter``, ``load_over_weight``, ``motion_over_chord``; where given
        ``breaking_strength`` [N] and ``utilisation``.  ``angular_frequency_in_plane``, ``angular_frequency_out_of_plane (mode)``
        and ``first_axial_frequency`` [rad/s], the same in Hz as ``frequency_in_plane``, ``frequency_out_of_plane (mode)`` and
        ``first_axial_frequency_hertz``.  ``note`` is a text with a line for each note, the worst first; empty for a usual scene.

    Raises
    ------
    SceneError
        For a scene without equilibrium.

    Notes
    -----
    Rest is the elastic catenary under weight and uniform load at time 0, linear law; point loads are not in it.  In wind it is
    the cable in the mean wind (point loads included), and the numbers of the catenary bear the ending ``_still_air``.
    Frequencies are those of :func:`cablepod.cable.frequencies` by the linear law about rest under all loads at time 0, nan for a
    free end or a cable that is not taut.  The first axial frequency is pi / L0 sqrt(EA / mu).  lambda squared is
    (q_n L0 / T)^2 EA / T with the load per length q_n normal to the chord and the mean tension T of both ends.  Loads and
    motions are bounds of their absolute values during the run.  The thresholds of the notes are constants of
    ``cablepod.scene._notes``, each with its reason.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> numbers = cp.summary(examples.scene("example2"))
    >>> round(float(numbers.stress) / 1e6), numbers.frequency_in_plane.values.round(2).tolist(), str(numbers.note.values)
    (120, [1.0, 1.98, 2.98], '')
    """
    scene = taken("scene", scene, SCENE)
    members = list(Members(scene))
    rows = [_numbers_of_member(p) for p in members]
    single = "member" not in scene.dims
    variables: dict[str, Any] = {}
    for name in rows[0]:
        if all(name in row for row in rows):
            values = np.array(rows[0][name] if single else [row[name] for row in rows])
        else:  # a member without breaking strength
            values = np.array([row.get(name, math.nan) for row in rows])
        dims = () if single else ("member",)
        variables[name] = ((*dims, "mode") if values.ndim > len(dims) else dims, values)
    result = xr.Dataset(variables, coords={"mode": np.arange(1, FREQUENCIES + 1)})
    if not single:
        varied = {name: variable for name, variable in scene.variables.items() if variable.dims == ("member",)}
        result = result.assign_coords({name: variable.copy() for name, variable in varied.items()})
    named = {name: names for name, names in {**NUMBERS, **FREQUENCY_NUMBERS}.items() if name in result}
    for name in AT_REST:
        if f"{name}_still_air" in result:
            units, text = named[name]
            named |= {name: (units, f"{text}, in the mean wind"), f"{name}_still_air": (units, f"{text}, in still air")}
    for name, (_, text) in list(named.items()):
        if "frequency" in name:
            of_hertz = name.removeprefix("angular_") if "angular" in name else f"{name}_hertz"
            result[of_hertz] = result[name] / (2.0 * math.pi)
            named[of_hertz] = ("Hz", text.replace("angular ", ""))
    label(
        result,
        **named,
        mode=("1", "number of the mode, from 1, by rising frequency"),
        note=("1", "what is unusual, one note a line"),
    )
    del result["note"].attrs["units"]
    result.attrs.update(title=f"{scene.attrs.get('title', 'scene')}: summary", stage="summary")
    return provenance.record(result, function="summary", parameters={}, inputs=[scene])


def _numbers_of_member(p: Parameters) -> dict[str, Any]:
    """Return the numbers of one scene by name."""
    numbers = static_numbers(p)
    statics, chord = numbers.statics, numbers.chord
    reach = np.subtract(*p.initial_ends[::-1])
    sag, weight = _sag(p, numbers), math.hypot(*p.weight)
    result = {
        "chord": chord,
        "inclination": math.asin(max(-1.0, min(1.0, reach[1] / chord))),
        "weight_per_length": weight,
        "mass_per_length": p.mass,
        "density": numbers.density,
        "axial_stiffness": p.stiffness,
        "unstretched_length": numbers.length,
        "horizontal_force": statics[2],
        "irvine_parameter": float(features(p, numbers.length, 0.0, 0.5 * float(statics[4] + statics[5]))[0]),
        "load_over_weight": numbers.load / (weight * numbers.length) if weight > 0.0 else math.nan,
        "motion_over_chord": numbers.motion / chord,
    }
    if p.breaking_strength is not None:
        result |= {"breaking_strength": p.breaking_strength}
    still = _at_rest(p, chord, statics[1], (statics[4], statics[5], numbers.tension), sag)
    still |= dict(zip(PLANES, _frequencies(p, numbers.length), strict=True))
    air = mean_air_of(p)
    if p.wind is not None:
        result |= {f"{name}_still_air": value for name, value in still.items()}
    result |= still if air is None or not air.mean.any() else _in_wind(p, numbers.length, air)
    result |= {
        "first_axial_frequency": math.pi / numbers.length * math.sqrt(p.stiffness / p.mass),
    }
    notes = [f"{note.key}: {note.text}" for note in notes_of(p)]
    if notes:
        notes += [f"perhaps {text}" for _, text in likely_keys(p)]
    return result | {"note": "\n".join(notes)}


def _at_rest(
    p: Parameters, chord: float, stretched_length: float, tension: tuple[float, float, float], sag: float
) -> dict[str, Any]:
    """Return the numbers of a shape at rest by name, for the tension at both ends and the largest one [N]."""
    result = {
        "stretched_length": stretched_length,
        "tension_lower": tension[0],
        "tension_upper": tension[1],
        "stress": tension[2] / p.area,
        "strain": tension[2] / p.stiffness,
        "sag": sag,
        "sag_over_chord": sag / chord,
    }
    return result if p.breaking_strength is None else result | {"utilisation": tension[2] / p.breaking_strength}


def _in_wind(p: Parameters, length: float, air: CableAir) -> dict[str, Any]:
    """Return the numbers of the rest in the mean wind by name, with frequencies in and out of the plane of chord and load."""
    p = replace(p, motions={}, length_key="unstretched_length", length_value=length, initial={})
    mesh = mesh_of(p, element_count(None, p), None, "linear", POINTS)
    position = equilibrium_in_wind(mesh, MeshAir(mesh, air))
    stretch = mesh.stretch(position)
    tension = p.stiffness * (stretch - 1.0)
    shape = mesh.interpolate(position)
    reach = shape[-1] - shape[0]
    along = reach / np.linalg.norm(reach)
    off = shape - shape[0]
    sag = float(np.sqrt(square(off - (off @ along)[:, None] * along)).max())
    ends = float(tension[0]), float(tension[-1]), float(tension.max())
    result = _at_rest(p, float(np.linalg.norm(reach)), float(mesh.length @ stretch), ends, sag)
    load = mesh.loads(0.0) + MeshAir(mesh, air).at_rest(position)
    return result | dict(zip(PLANES, _frequencies_in_wind(p, reach, load.sum(axis=0)), strict=True))


def _frequencies_in_wind(p: Parameters, reach: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first angular frequencies in the plane of chord and total load, and out of it, in the mean wind [rad/s]."""
    try:
        if p.dims == 2:
            within, across = (
                converged_vibrations(p, FREQUENCIES, law="linear", out_of_plane=out_of_plane)[1]
                for out_of_plane in (False, True)
            )
            return within, across
        _, values, vectors, _ = converged_vibrations(p, 3 * FREQUENCIES, law="linear")
    except SceneError:  # not taut
        return np.full(FREQUENCIES, math.nan), np.full(FREQUENCIES, math.nan)
    normal = np.cross(reach, load)
    normal /= np.linalg.norm(normal)
    share = ((vectors.T.reshape(values.size, -1, 3) @ normal) ** 2).sum(axis=1)
    pads = np.full(FREQUENCIES, math.nan)
    return tuple(np.concatenate([values[chosen], pads])[:FREQUENCIES] for chosen in (share < 0.5, share >= 0.5))  # type: ignore[return-value]


def _sag(p: Parameters, numbers: StaticNumbers) -> float:
    """Return the largest distance of the catenary from the chord [m]: there the tangent is parallel to the chord."""
    from cablepod.catenary import _kernels_shape as kernel  # numba is imported only to compute

    plane, (length, _, horizontal, mid_force, *_) = load_plane(p), numbers.statics.tolist()
    if not (plane.load > 0.0 and plane.span > 0.0):
        return 0.0
    at = 0.5 * length + (horizontal * plane.rise / plane.span - mid_force) / plane.load
    s = np.array([min(max(at, 0.0), length)])
    x, y, tension = np.empty(1), np.empty(1), np.empty(1)
    kernel.shape(s, numbers.statics, plane.load, p.stiffness, x, y, tension)
    return abs(float(x[0] * plane.rise - y[0] * plane.span)) / float(plane.chord)


def _frequencies(p: Parameters, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the first angular frequencies in the plane of chord and load and out of it [rad/s], nan where there are none."""
    if p.free_end is not None:
        return np.full(FREQUENCIES, math.nan), np.full(FREQUENCIES, math.nan)
    planar = _in_plane(p, length)
    try:
        within = converged_vibrations(planar, FREQUENCIES, law="linear", out_of_plane=False)[1]
        return within, converged_vibrations(planar, FREQUENCIES, law="linear", out_of_plane=True)[1]
    except SceneError:  # not taut at rest
        return np.full(FREQUENCIES, math.nan), np.full(FREQUENCIES, math.nan)


def _in_plane(p: Parameters, length: float) -> Parameters:
    """Return the scene at time 0 in the plane of chord and load, x across the load and y against it; loads are constant."""
    plane = load_plane(p)
    axes = np.stack([plane.across, plane.against])
    loads = []
    for load in p.point_loads:
        factor = 1.0 if load.factor is None else float(load.factor(0.0))
        loads.append(replace(load, force=factor * (axes @ load.force), factor=None))
    return replace(
        p,
        lower=np.zeros(2),
        upper=np.array([plane.span, plane.rise]),
        weight=np.array([0.0, -plane.load]),
        motions={},
        load=None,
        load_factor=None,
        point_loads=tuple(loads),
        length_key="unstretched_length",
        length_value=length,
        initial={},
        wind=None,
        turbulence=None,
    )
