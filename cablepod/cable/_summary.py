"""Static numbers of a scene, its first frequencies, and notes on what is unusual."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import SCENE, taken
from cablepod.cable._frequencies import converged_vibrations, normal_of_plane
from cablepod.cable._mesh import mesh_of
from cablepod.cable._simulate import counts_of
from cablepod.cable._start import converged_equilibrium
from cablepod.catenary._sag import irvine_parameter
from cablepod.catenary._statics import load_plane, piecewise_statics, sag_of_scene
from cablepod.chain._summary import numbers_at_rest, numbers_of_chain
from cablepod.conventions import AIR_OF_EACH, ENDINGS_OF_AIR, STILL_AIR, label, names_in_air
from cablepod.discretisation._chain import square
from cablepod.discretisation._similarity import features
from cablepod.errors import SceneError
from cablepod.parameters._from_scene import Members
from cablepod.parameters._nonuniform import SAME_PLACE
from cablepod.parameters._parameters import Parameters, Segment, ramp_of
from cablepod.parameters._utilisation import strengths_of, utilisation
from cablepod.scene._notes import StaticNumbers, likely_keys, notes_of, static_numbers
from cablepod.wind._profile import air_at_rest

#: Number of frequencies in the plane and out of it.
FREQUENCIES = 3
#: Names of the frequencies.
PLANES = ("angular_frequency_in_plane", "angular_frequency_out_of_plane")
RATIOS = ("damping_ratio_in_plane", "damping_ratio_out_of_plane")
#: Points of the shape in the wind, and tolerance of this shape: this part of the sag in still air (the profile of the wind misses
#: 3e-5 of the deflection), at least this part of the length.
POINTS, SAG_RTOL, SHAPE_RTOL = 401, 1e-5, 1e-8
#: Name of the largest tension [N], which notes need and a summary has not.
LARGEST = "largest_tension"
AT_REST, OF_STILL_AIR, OF_MEAN_WIND = ENDINGS_OF_AIR
#: Name -> (units, long name) of the numbers of a summary.
NUMBERS = {
    "chord": ("m", "distance of the ends"),
    "inclination": ("rad", "angle of the chord above the horizontal"),
    "weight_per_length": ("N m-1", "weight per unstretched length"),
    "mass_per_length": ("kg m-1", "mass per unstretched length"),
    "mass": ("kg", "mass of all particles"),
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
    "sag_below_chord": ("m", "largest distance of the cable below the chord, along the total load at rest"),
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
    "damping_ratio_in_plane": ("1", "damping ratio of these vibrations in the plane, by attached dampers"),
    "damping_ratio_out_of_plane": ("1", "damping ratio of these vibrations out of the plane, by attached dampers"),
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
        [m], ``tension_lower``, ``tension_upper``, ``horizontal_force`` [N], ``stress`` [Pa], ``strain``, ``sag`` [m] normal to
        the chord, ``sag_over_chord``, ``sag_below_chord`` [m] along the total load, as ``cable.sag``; stress and density with
        an area only; ``irvine_parameter``, ``load_over_weight``, ``motion_over_chord``; where given
        ``breaking_strength`` [N] and ``utilisation``.  ``angular_frequency_in_plane``, ``angular_frequency_out_of_plane (mode)``
        and ``first_axial_frequency`` [rad/s], the same in Hz as ``frequency_in_plane``, ``frequency_out_of_plane (mode)`` and
        ``first_axial_frequency_hertz``; with attached dampers ``damping_ratio_in_plane``, ``damping_ratio_out_of_plane (mode)``.
        ``note`` is a text with a line for each note, the worst first; empty for a usual scene.
        Rest is in the mean wind of the scene, with ``wind.ramp`` in the still air from which the wind rises; the attribute
        ``air`` says which.  Where the scene has wind, the numbers in still air and in its mean wind stand side by side, with the
        endings ``_still_air`` and ``_mean_wind`` (nan where a cable with a ramp finds no rest in the full wind).
        A chain with masses or stiffnesses of its own has ``mass`` [kg] of all particles in place of the mass per length, and
        neither the Irvine parameter nor ``sag_below_chord`` and ``horizontal_force``.

    Raises
    ------
    SceneError
        For a scene without equilibrium.

    Notes
    -----
    Rest in still air is the elastic catenary under weight and uniform load at time 0, linear law; point loads are not in it. Rest
    in wind is that of :func:`cablepod.cable.rest` by the linear law, point loads included.  A free end is held.  Frequencies are
    those of :func:`cablepod.cable.frequencies` by the linear law about rest under all loads at time 0, nan for a free end or a
    cable that is not taut.  The first axial frequency is pi / L0 sqrt(EA / mu).  A chain with masses or stiffnesses of its own is
    at rest as :func:`cablepod.chain.rest`, with all loads; its axial stiffness is that of the links in series, times the length,
    its frequencies are those of its particles, in and out of the plane each with the other displacement held.  lambda squared is
    (q_n L0 / T)^2 EA / T with the load per length q_n normal to the chord (drag included) and the mean tension T of both ends.
    Loads (without drag) and motions are bounds of their absolute values during the run.  The thresholds of the notes are
    constants of ``cablepod.scene._notes``, each with its reason.

    Of a cable of several segments weight, mass, density and stiffness are means over the length, also in lambda squared; stress,
    strain and utilisation are those of the segment where they are largest.  The weight of attachments acts at rest; it is not
    in lambda squared and not among the loads.  The first axial frequency is then that of the straight cable with its masses.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import examples
    >>> numbers = cp.summary(examples.scene("example2"))
    >>> round(float(numbers.stress) / 1e6), numbers.frequency_in_plane.values.round(2).tolist(), str(numbers.note.values)
    (120, [1.0, 1.98, 2.97], '')
    """
    scene = taken("scene", scene, SCENE)
    members = list(Members(scene))
    rows = [_numbers_of_member(p) for p in members]
    single = "member" not in scene.dims
    variables: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        missing = np.full(np.shape(next(row[name] for row in rows if name in row)), math.nan)
        values = np.array(rows[0][name] if single else [row.get(name, missing) for row in rows])
        dims = () if single else ("member",)
        variables[name] = ((*dims, "mode") if values.ndim > len(dims) else dims, values)
    result = xr.Dataset(variables, coords={"mode": np.arange(1, FREQUENCIES + 1)})
    named = names_in_air(NUMBERS | FREQUENCY_NUMBERS, result)
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
    if not single:  # with the units of the scene, words without
        varied = {name: variable for name, variable in scene.variables.items() if variable.dims == ("member",)}
        result = result.assign_coords({name: variable.copy() for name, variable in varied.items()})
    airs = set(map(air_at_rest, members))
    air = airs.pop() if len(airs) == 1 else AIR_OF_EACH
    result.attrs.update(title=f"{scene.attrs.get('title', 'scene')}: summary", stage="summary", air=air)
    return provenance.record(result, function="summary", parameters={}, inputs=[scene])


def _numbers_of_member(p: Parameters) -> dict[str, Any]:
    """Return the numbers of one scene by name."""
    numbers = static_numbers(p)
    reach, weight = np.subtract(*p.initial_ends[::-1]), math.hypot(*p.weight)
    result = {
        "chord": numbers.chord,
        "inclination": math.asin(max(-1.0, min(1.0, reach[1] / numbers.chord))),
        **({} if p.masses is not None else {"weight_per_length": weight, "mass_per_length": p.mass}),
        **({} if p.masses is not None or p.area is None else {"density": numbers.density}),
        "axial_stiffness": p.stiffness,
        "unstretched_length": numbers.length,
        "load_over_weight": numbers.load / (weight * numbers.length) if weight > 0.0 else math.nan,
        "motion_over_chord": numbers.motion / numbers.chord,
        "first_axial_frequency": _first_axial_frequency(p, numbers.length),
    }
    if p.own_keys:
        result |= numbers_of_chain(p)
    if p.breaking_strength is not None:
        result |= {"breaking_strength": p.breaking_strength}
    still = _of_chain(replace(p, wind=None, turbulence=None)) if p.own_keys else _in_still_air(p, numbers)
    tension = still.pop(LARGEST)
    if p.wind is None:
        result |= still
    else:
        full, ramp = replace(p, wind={**p.wind, "ramp": 0.0}), bool(ramp_of(p))
        try:
            in_wind = dict(still)
            if air_at_rest(full) != STILL_AIR:
                in_wind = _of_chain(full) if p.own_keys else _in_wind(full, numbers.length, still["sag"])
                tension = in_wind.pop(LARGEST)
        except SceneError:
            if not ramp:
                raise
            tension = None
            in_wind = {name: np.full(np.shape(value), math.nan) for name, value in still.items()}
        parts = {AT_REST: still if ramp else in_wind, OF_STILL_AIR: still, OF_MEAN_WIND: in_wind}
        result |= {f"{name}{ending}": value for ending, part in parts.items() for name, value in part.items()}
    notes = [f"{note.key}: {note.text}" for note in notes_of(p, tension)]
    if notes:
        notes += [f"perhaps {text}" for _, text in likely_keys(p)]
    return result | {"note": "\n".join(notes)}


def _at_rest(p: Parameters, chord: float, tensions: list[float], sag: float, **others: float) -> dict[str, Any]:
    """Return the numbers of a shape at rest by name.

    They follow from the largest tension in each segment [N], one for a uniform cable, the sag [m] and what is known of it.  A
    stress needs an area.
    """
    segments: tuple[Parameters | Segment, ...] = p.segments or (p,)
    parts = list(zip(tensions, segments, strict=True))
    stresses = [tension / part.area for tension, part in parts if part.area is not None]
    result = {
        **others,
        **({"stress": max(stresses)} if stresses else {}),
        "strain": others.get("strain", max(tension / part.stiffness for tension, part in parts)),
        LARGEST: max(tensions),
        "sag": sag,
        "sag_over_chord": sag / chord,
    }
    return result if p.breaking_strength is None else result | {"utilisation": largest_utilisation(p, tensions)}


def largest_utilisation(p: Parameters, tensions: list[float]) -> float:
    """Return the largest utilisation of segments by their tensions [N], of those that have a breaking strength."""
    return float(np.nanmax(utilisation(np.array(tensions), strengths_of(p.segments or (p,)))))


def _of_chain(p: Parameters) -> dict[str, Any]:
    """Return the numbers as :func:`_in_still_air` of a chain with masses or stiffnesses of its own, at rest in its air."""
    numbers, *frequencies = numbers_at_rest(p, FREQUENCIES)
    largest, sag = numbers.pop(LARGEST), numbers.pop("sag")
    return _at_rest(p, math.dist(*p.initial_ends), [largest], sag, **numbers) | dict(
        zip(PLANES, frequencies, strict=True)
    )


def _in_still_air(p: Parameters, numbers: StaticNumbers) -> dict[str, Any]:
    """Return the numbers of the rest in still air by name, with frequencies in and out of the plane of chord and load."""
    length, stretched, horizontal, _, lower, upper = (float(number) for number in numbers.statics)
    irvine = float(features(p, length, 0.0, 0.5 * (lower + upper))[0])
    plane = load_plane(p)
    below = sag_of_scene(p, numbers.statics)
    result = _at_rest(
        p, numbers.chord, largest_tensions(p, numbers.tension), below * float(plane.span / plane.chord),
        stretched_length=stretched, tension_lower=lower, tension_upper=upper, horizontal_force=horizontal,
        irvine_parameter=irvine, sag_below_chord=below,
    )  # fmt: skip
    return result | _named(p, _frequencies(p, length))


def _named(p: Parameters, frequencies: tuple[np.ndarray, np.ndarray]) -> dict[str, Any]:
    """Return by name the frequencies in the plane and out of it [rad/s], with dampers complex roots [1/s]."""
    result = dict(zip(PLANES, map(np.abs, frequencies), strict=True))
    if any(attachment.damper for attachment in p.attachments):
        for name, roots in zip(RATIOS, frequencies, strict=True):
            # without dampers in a plane its numbers are the frequencies
            result[name] = np.maximum(-roots.real, 0.0) / np.abs(roots) if np.iscomplexobj(roots) else 0.0 * roots
    return result


def largest_tensions(p: Parameters, largest: float) -> list[float]:
    """Return the largest tension at rest in still air in each segment [N], which is at an end of it; `largest` of all."""
    if not p.segments:
        return [largest]
    solved = piecewise_statics(p, p.length_key, p.length_value)
    above = [part.start + (SAME_PLACE if part.start else 0.0) for part in p.segments]  # of a mass at its lower end
    places = [solved.total * np.array([start, part.end]) for start, part in zip(above, p.segments, strict=True)]
    return [float(np.sqrt(square(solved.at(place)[1])).max()) for place in places]


def _first_axial_frequency(p: Parameters, length: float) -> float:
    """Return the first angular frequency of vibrations along the cable, taken as straight [rad/s].

    That of a uniform cable is between held ends, that of several parts with a free end where the scene has one.
    """
    if p.segments or p.attachments:
        return mesh_of(p, counts_of(None, p)[0], law="linear").first_axial_frequency()
    return math.pi / length * math.sqrt(p.stiffness / p.mass)


def _in_wind(p: Parameters, length: float, sag: float) -> dict[str, Any]:
    """Return the numbers as :func:`_in_still_air` about rest in the mean wind; `sag` is that in still air [m]."""
    return rest_in_wind(p, length, sag) | _named(p, _frequencies_of_any(p))


def rest_in_wind(p: Parameters, length: float, sag: float) -> dict[str, Any]:
    """Return the numbers of the rest in the mean wind by name; `sag` is that in still air, normal to the chord [m]."""
    lower, upper = p.initial_ends
    p = replace(
        p, lower=lower, upper=upper, motions={}, length_key="unstretched_length", length_value=length, initial={}
    )
    counts = counts_of(None, p)
    tolerance = max(SHAPE_RTOL, SAG_RTOL * sag / length)
    mesh, position, _ = converged_equilibrium(p, counts, tolerance, None, "linear", POINTS)
    stretch, gradient = mesh.stretch(position), mesh.gradient(position)
    tension = mesh.axial_stiffness * (stretch - 1.0)
    ends = (tension / stretch)[[0, -1], None] * gradient[[0, -1]]  # forces [N]
    reach = upper - lower
    chord = float(np.linalg.norm(reach))
    along, total = reach / chord, ends[0] - ends[1]
    normal_to_load = ends[0] - (ends[0] @ total) / max(float(total @ total), 1e-300) * total
    points = [load.force * (1.0 if load.factor is None else float(load.factor(0.0))) for load in p.point_loads]
    points += [attachment.weight for attachment in p.attachments]
    distributed = (total - sum(points)) / length
    transverse = distributed - (distributed @ along) * along
    mean = max(0.5 * float(tension[0] + tension[-1]), 1e-12 * p.stiffness)
    off = mesh.interpolate(position) - lower
    down = total / max(float(np.linalg.norm(total)), 1e-300)
    across = reach - (reach @ down) * down
    share = (off @ across) / max(float(across @ across), 1e-300)  # of the chord above each point
    return _at_rest(
        p, chord, mesh.largest_of_segments(tension), float(np.sqrt(square(off - (off @ along)[:, None] * along)).max()),
        stretched_length=float(mesh.length @ stretch), tension_lower=float(tension[0]), tension_upper=float(tension[-1]),
        horizontal_force=float(np.linalg.norm(normal_to_load)),
        irvine_parameter=irvine_parameter(float(np.linalg.norm(transverse)), length, mean, p.stiffness),
        sag_below_chord=float(((off - share[:, None] * reach) @ down).max()),
    )  # fmt: skip


def _frequencies_of_any(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return the first angular frequencies as :func:`_frequencies`, also in the mean wind and of several parts [rad/s].

    With dampers they are the complex roots of :func:`cablepod.cable._frequencies.vibrations` [1/s].
    """
    none = np.full(FREQUENCIES, math.nan)
    if p.free_end is not None:
        return none, none
    try:
        if p.dims == 2:
            within, across = (
                converged_vibrations(p, FREQUENCIES, law="linear", out_of_plane=out_of_plane)[1]
                for out_of_plane in (False, True)
            )
            return within, across
        mesh, values, vectors, _ = converged_vibrations(p, 3 * FREQUENCIES, law="linear")
    except SceneError:  # not taut
        return none, none
    normal = normal_of_plane(p, mesh)
    if normal is None:  # chord and load span no plane: any two directions across the chord
        along = p.upper - p.lower
        normal = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        normal /= np.linalg.norm(normal)
    share = (np.abs(vectors.T.reshape(values.size, -1, 3) @ normal) ** 2).sum(axis=1)
    within, across = (np.concatenate([values[chosen], none])[:FREQUENCIES] for chosen in (share < 0.5, share >= 0.5))
    return within, across


def _frequencies(p: Parameters, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the first angular frequencies in the plane of chord and load and out of it [rad/s], nan where there are none."""
    if p.free_end is not None:
        return np.full(FREQUENCIES, math.nan), np.full(FREQUENCIES, math.nan)
    if p.segments or p.attachments:
        key = "unstretched_length"
        return _frequencies_of_any(replace(p, wind=None, turbulence=None, length_key=key, length_value=length))
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
