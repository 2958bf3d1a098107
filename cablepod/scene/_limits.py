"""Limits of scenes: finite motions and loads, static equilibrium, strains of at most 10."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablepod._resources import check_memory
from cablepod.catenary._sag import least_sag
from cablepod.catenary._statics import length_and_strain, load_plane
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.parameters._parameters import Parameters, count_instants, has_record
from cablepod.parameters._time_functions import TimeFunction, check_reach

#: Maximum strain (natural rubber breaks at 5 to 8; a larger strain is a wrong number, such as a modulus in GPa).
MAX_STRAIN = 10.0
#: Maximum number of instants.
MOST_INSTANTS = 1e12


def check_numbers(p: Parameters) -> None:
    """Refuse times, motions, loads and statics that no cable can have, and output larger than the memory, before a run.

    Raises
    ------
    SceneError
        For records that do not cover the run, motions and load factors that are not finite during it, tensions below the minimum,
        a weightless slack cable, and strains above :data:`MAX_STRAIN`; the message names the key.
    """
    check_functions(p.time_functions(), p.duration or 0.0)
    _check_statics(p)
    if p.wind is not None:
        from cablepod.scene import _wind_field  # needed by wind only

        _wind_field.check_above_ground(p)
        if has_record(p):
            _wind_field.checked_field(
                p, p.duration or 0.0, _wind_field.field_of_record(p), _wind_field.key_of_record(p)
            )
    instants = 1 if p.duration is None or p.interval is None else count_instants(p.duration, p.interval)
    check_memory(instants, p.links or 1, p.dims, key="chain.links and time.interval")


def check_times(duration: float | None, interval: float | None) -> None:
    """Refuse an interval [s] longer than the run, and one so short that the number of instants is no number."""
    if duration is None or interval is None:
        return
    if interval > duration:
        raise scene_error("time.interval", interval, f"at most time.duration, {duration:g} s")
    if duration / interval > MOST_INSTANTS:
        raise scene_error("time.interval", interval, f"an interval that {duration:g} s holds at most 1e12 times")


def check_functions(functions: Mapping[str, TimeFunction], end_time: float) -> None:
    """Refuse records that do not cover the run until `end_time` [s], and motions and load factors that are not finite in it."""
    check_reach(functions, end_time)
    for key, function in functions.items():
        time = function.sampling_times(end_time)
        with np.errstate(all="ignore"):
            finite = [bool(np.isfinite(function(time, derivative)).all()) for derivative in range(3)]
        if not all(finite):
            raise SceneError(
                f"{key}: given a {function.kind} that leaves the finite numbers by {end_time:g} s; "
                "allowed: one that is finite during the run, with its first two derivatives"
            )


def _check_statics(p: Parameters) -> None:
    """Refuse tensions below the minimum, a weightless slack cable, and strains above the maximum."""
    length, strain = length_and_strain(p, p.length_key, p.length_value)
    attachment_fractions(p, length)
    # a run with a free end that starts from given points is never at this equilibrium
    if strain > MAX_STRAIN and (p.free_end is None or "points" not in p.initial):
        if p.length_key == "sag":
            _check_sag(p)
        raise SceneError(
            f"{p.stiffness_path}: given an axial stiffness of {p.stiffness:g} N, which at rest with {p.length_key} = "
            f"{p.length_value:g} is strained by {strain:.3g}; allowed: a strain of at most {MAX_STRAIN:g} (moduli are in "
            "Pa, areas in m2, stiffnesses in N)"
        )
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            initial_length, initial_strain = length_and_strain(p, key, p.initial[key], prefix="initial")
            stretch = (1.0 + initial_strain) * initial_length / length
            _check_stretch(f"initial.{key}", p.initial[key], stretch)
    if p.free_end is None:
        _check_between_ends(p, length)
    _check_loads(p, length)


def _check_sag(p: Parameters) -> None:
    """Refuse a sag so small that the cable is strained above the maximum."""
    tensioned = p.bare or p
    least = least_sag(load_plane(tensioned)[:4], tensioned.stiffness, MAX_STRAIN)
    if p.length_value < least:
        allowed = f"at least {least:.6g} m, at which the cable is strained by {MAX_STRAIN:g}"
        raise scene_error("cable.sag", p.length_value, allowed)


def _check_between_ends(p: Parameters, length: float) -> None:
    """Refuse initial points and motions that stretch a cable of `length` [m] too far between its ends."""
    line = p.initial.get("points")
    if line is not None:
        _check_stretch("initial.points", line.tolist(), np.hypot.reduce(np.diff(line, axis=0), axis=1).sum() / length)
    time = p.sampling_times()
    ends = p.end_positions(time)
    distance = np.hypot.reduce(ends[:, 1] - ends[:, 0], axis=1)
    worst, max_stretch = int(distance.argmax()), 1.0 + MAX_STRAIN
    if distance[worst] > max_stretch * length:
        raise SceneError(
            f"motion: given one that takes the ends {distance[worst]:g} m apart at {time[worst]:g} s; allowed: at most "
            f"{max_stretch * length:g} m, {max_stretch:g} times the unstretched length of the cable"
        )


def _check_stretch(key: str, given: Any, stretch: float) -> None:
    """Refuse an initial shape that stretches the cable too far."""
    max_stretch = 1.0 + MAX_STRAIN
    if stretch > max_stretch:
        raise scene_error(
            key,
            given,
            f"a start that stretches the cable to at most {max_stretch:g} times its length (it is {stretch:.3g})",
        )


def _check_loads(p: Parameters, length: float) -> None:
    """Refuse loads that strain a cable of `length` [m] too far in any equilibrium.

    In equilibrium the tension vectors at two points differ by the loads between them.  The larger tension is thus at least half
    of these loads, and all of them if the other point is a free end.
    """
    time = p.sampling_times()
    forces = {p.stiffness_path: np.tile(p.weight * length, (time.size, 1))}
    if p.load is not None:
        forces["load.uniform"] = _force_at(time, p.load * length, p.load_factor)
    distributed = sum(forces.values())
    held = [place for place, end in ((0.0, "lower"), (1.0, "upper")) if end != p.free_end]
    below = np.zeros((time.size, p.dims))  # sum of the point loads below a point
    between = [below]  # loads between the lower end and each point at which the tension may be largest
    places = [(load.fraction, f"{load.key}.force", load.force, load.factor) for load in p.point_loads]
    places += [(item.fraction(length), f"{item.key}.mass", item.weight, None) for item in p.attachments if item.mass]
    for fraction, key, at_place, factor in sorted(places, key=lambda place: place[0]):
        if fraction in held:
            continue  # carried by the support
        force = forces[key] = _force_at(time, at_place, factor)
        between += [below + fraction * distributed, below + fraction * distributed + force]
        below = below + force
    between.append(below + distributed)
    ends = {"lower": between[0], "upper": between[-1]}
    if p.free_end is None:
        tension = 0.5 * max(_largest(place - end) for place in between for end in ends.values())
    else:
        tension = max(_largest(place - ends[p.free_end]) for place in between)
    stiffness = max([p.stiffness, *(segment.stiffness for segment in p.segments)])
    if tension > MAX_STRAIN * stiffness:
        key = max(forces, key=lambda key: _largest(forces[key]))
        raise SceneError(
            f"{key}: given loads of {_largest(forces[key]):.4g} N in all at their largest; allowed: loads that strain the cable, "
            f"of an axial stiffness of {stiffness:g} N, by at most {MAX_STRAIN:g} at rest (it is {tension / stiffness:.3g} "
            "or more; moduli are in Pa, areas in m2, stiffnesses in N)"
        )


def _force_at(time: np.ndarray, force: np.ndarray, factor: TimeFunction | None) -> np.ndarray:
    """Return a force (dims,) times its factor at `time`: (time, dims) [N]."""
    return np.outer(np.ones(time.size) if factor is None else factor(time), force)


def _largest(force: np.ndarray) -> float:
    """Return the largest magnitude of a force (time, dims)."""
    return float(np.hypot.reduce(force, axis=1).max())
