"""What a scene may ask of its cable: motions and loads that are finite, a rest, strains that a law of elasticity can mean."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cablepod.catenary._statics import solve_statics
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._time_functions import TimeFunction

SHORTEST, LONGEST = 1e-6, 1e9  # m; the chord
#: Natural rubber, the most extensible of what ropes are made of, breaks at strains of 5 to 8, and no law here means anything
#: there.  What asks for more has a number wrong, as a modulus in GPa.
MOST_STRAIN = 10.0


def check_limits(p: Parameters) -> None:
    """Refuse a scene that no cable bears, before anything runs.

    Raises
    ------
    SceneError
        For motions and factors that leave the finite numbers, ends that meet at the start, tensions below the least possible, a
        weightless slack cable, and strains above MOST_STRAIN; the message names the key.
    """
    _check_functions(p)
    _check_statics(p)


def _check_functions(p: Parameters) -> None:
    """Refuse motions and factors that leave the finite numbers, and ends that the motions bring together at the start."""
    until = p.duration or 0.0
    for key, function in p.time_functions().items():
        time = function.sampling_times(until)
        with np.errstate(all="ignore"):
            finite = [bool(np.isfinite(function(time, derivative)).all()) for derivative in range(3)]
        if not all(finite):
            raise SceneError(
                f"{key}: given a {function.kind} that leaves the finite numbers by {until:g} s; "
                "allowed: one that is finite during the run, and its first two rates too"
            )
    chord = math.dist(*p.end_positions(np.zeros(1))[0])
    if not SHORTEST <= chord <= LONGEST:
        raise SceneError(
            f"motion: given one that begins with the ends {chord:g} m apart; allowed: {SHORTEST:g} m to {LONGEST:g} m"
        )


def _check_statics(p: Parameters) -> None:
    """Refuse a tension below the least possible, a weightless slack cable, and absurd strains, before anything runs."""
    rest = solve_statics(p, p.length_key, p.length_value, prefix="cable")
    length, strain = float(rest[0]), float(rest[4:].max()) / p.stiffness
    # with a free end, a run from given points never is where the cable rests between its ends
    if strain > MOST_STRAIN and (p.free_end is None or "points" not in p.initial):
        raise SceneError(
            f"cable.youngs_modulus: given an axial stiffness of {p.stiffness:g} N, which at rest with {p.length_key} = "
            f"{p.length_value:g} is strained by {strain:.3g}; allowed: a strain of at most {MOST_STRAIN:g} (moduli are in "
            "Pa, areas in m2)"
        )
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            other = solve_statics(p, key, p.initial[key], prefix="initial")
            stretch = (1.0 + float(other[4:].max()) / p.stiffness) * float(other[0]) / length
            _check_stretch(f"initial.{key}", p.initial[key], stretch)
    if p.free_end is None:
        _check_between_ends(p, length)
    _check_loads(p, length)


def _check_between_ends(p: Parameters, length: float) -> None:
    """Refuse a line to begin with, and motions, that stretch a cable of some length [m] between its ends absurdly."""
    line = p.initial.get("points")
    if line is not None:
        _check_stretch("initial.points", line.tolist(), np.hypot.reduce(np.diff(line, axis=0), axis=1).sum() / length)
    time = p.sampling_times()
    ends = p.end_positions(time)
    apart = np.hypot.reduce(ends[:, 1] - ends[:, 0], axis=1)
    worst, most = int(apart.argmax()), 1.0 + MOST_STRAIN
    if apart[worst] > most * length:
        raise SceneError(
            f"motion: given one that takes the ends {apart[worst]:g} m apart at {time[worst]:g} s; allowed: at most "
            f"{most * length:g} m, {most:g} times the unstretched length of the cable"
        )


def _check_stretch(key: str, given: Any, stretch: float) -> None:
    """Refuse a shape to begin with that stretches the cable absurdly."""
    most = 1.0 + MOST_STRAIN
    if stretch > most:
        raise scene_error(
            key, given, f"a start that stretches the cable to at most {most:g} times its length (it is {stretch:.3g})"
        )


def _check_loads(p: Parameters, length: float) -> None:
    """Refuse loads that strain a cable of some length [m] absurdly wherever it comes to rest under them.

    At rest the tensions of two places, as vectors, differ by the loads between them: one of the two carries half of these at
    least, all of them where the other is a free end.
    """
    time = p.sampling_times()
    forces = {"cable.youngs_modulus": np.tile(p.weight * length, (time.size, 1))}
    if p.load is not None:
        forces["load.uniform"] = _over(time, p.load * length, p.load_factor)
    spread = sum(forces.values())
    held = [place for place, end in ((0.0, "lower"), (1.0, "upper")) if end != p.free_end]
    below = np.zeros((time.size, p.dims))  # the point loads below a place
    between = [below]  # the loads between the lower end and places of which one has the largest tension
    for load in sorted(p.point_loads, key=lambda load: load.fraction):
        if load.fraction in held:
            continue  # it strains nothing
        force = forces[f"{load.key}.force"] = _over(time, load.force, load.factor)
        between += [below + load.fraction * spread, below + load.fraction * spread + force]
        below = below + force
    between.append(below + spread)
    ends = {"lower": between[0], "upper": between[-1]}
    if p.free_end is None:
        tension = 0.5 * max(_largest(place - end) for place in between for end in ends.values())
    else:
        tension = max(_largest(place - ends[p.free_end]) for place in between)
    if tension > MOST_STRAIN * p.stiffness:
        key = max(forces, key=lambda key: _largest(forces[key]))
        raise SceneError(
            f"{key}: given loads of {_largest(forces[key]):.4g} N in all at their largest; allowed: loads that strain the cable, "
            f"of an axial stiffness of {p.stiffness:g} N, by at most {MOST_STRAIN:g} at rest (it is {tension / p.stiffness:.3g} "
            "or more; moduli are in Pa, areas in m2)"
        )


def _over(time: np.ndarray, force: np.ndarray, factor: TimeFunction | None) -> np.ndarray:
    """Give a force (dims,) times its factor at instants: (time, dims) [N]."""
    return np.outer(np.ones(time.size) if factor is None else factor(time), force)


def _largest(force: np.ndarray) -> float:
    return float(np.hypot.reduce(force, axis=1).max())
