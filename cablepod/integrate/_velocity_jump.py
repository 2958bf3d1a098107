"""Warning of ends that start from rest with a nonzero speed, which sends an axial wave along the cable."""

from __future__ import annotations

import math
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from cablepod.batch._members import inside_members
from cablepod.catenary._piecewise import is_piecewise
from cablepod.catenary._statics import load_plane, piecewise_statics, solve_statics, unstretched_length
from cablepod.conventions import COORDINATES, ENDS
from cablepod.errors import SceneError, VelocityJumpWarning, warn
from cablepod.parameters._from_scene import Members
from cablepod.parameters._key_paths import motion_path
from cablepod.parameters._parameters import Parameters
from cablepod.scene._warnings import warn_of_unusual_members

#: Maximum tension of the wave without a warning, as a fraction of the tension at rest.
MAX_WAVE_TENSION = 1e-3
#: Minimum number of axial passages in the ramp that the warning proposes.  At its end the third derivative of v t s(t / ramp)
#: jumps by 60 v / ramp^2, which leaves 60 / (30 pi)^2, less than a hundredth, of the wave of the jump.
PASSAGES = 30.0


def warn_of_velocity_jump(p: Parameters, *, prefix: str = "") -> None:
    """Warn if an end starts with such a speed that its axial wave exceeds :data:`MAX_WAVE_TENSION`; not within members.

    Parameters
    ----------
    p
        Parameters of a scene; what follows from them is computed once.
    prefix
        Begins the message.
    """
    if p.motions and p.initial_end_rates[0].any() and not inside_members():
        jump = _jump(p)
        if jump.tension > MAX_WAVE_TENSION * jump.rest:  # false for nan, of a slack cable without weight
            air = "" if p.wind is None else " in still air"
            warn(
                f"{prefix}{jump.key}: starts from rest at {jump.speed:.3g} m/s, a jump that sends an axial wave of "
                f"{jump.tension:.3g} N ({100.0 * jump.tension / jump.rest:.2g} % of the tension at rest{air}) along the cable "
                f"and into the peaks of the tension; try: {jump.key}.ramp = {jump.ramp:.2g} s, a smooth start",
                VelocityJumpWarning,
            )


def warn_of_members(scene: xr.Dataset) -> None:
    """Warn once of what is unusual in a scene with members, and of the member whose ends start fastest."""
    warn_of_unusual_members(scene)
    try:
        members = Members(scene)
        if members.can_be_stacked:
            stacked = members.stacked(0, len(members))
            speeds = np.abs(stacked.initial_end_rates[0]).max(axis=(1, 2)) if stacked.motions else np.zeros(1)
        else:
            speeds = np.array([np.abs(p.initial_end_rates[0]).max() if p.motions else 0.0 for p in members])
    except SceneError:
        return  # the run of that member says why
    for fastest in np.argsort(-speeds, kind="stable").tolist():
        if not speeds[fastest] > 0.0:
            return
        prefix = f"member {members.name(fastest)}, whose ends start fastest of {len(members)}: "
        with suppress(SceneError):  # the run of that member says why
            warn_of_velocity_jump(members[fastest], prefix=prefix)
            return


class _Jump(NamedTuple):
    """Largest wave of both ends."""

    key: str  #: key path of the motion
    speed: float  #: of the end [m/s]
    tension: float  #: of the wave [N]
    rest: float  #: mean tension at rest in still air [N]
    ramp: float  #: duration of a sufficient ramp [s]


@lru_cache(64)
def _jump(p: Parameters) -> _Jump:
    """Return the largest wave of both ends."""
    waves, rest = wave_tensions(p)
    end = int(waves.argmax())
    rates = p.initial_end_rates[0, end]
    key = motion_path(ENDS[end], COORDINATES[int(np.abs(rates).argmax())])
    passage = unstretched_length(p) * math.sqrt(p.mass / p.stiffness)
    period = p.shortest_time_scale
    ramp = max(PASSAGES * passage, period if math.isfinite(period) else 0.0)
    return _Jump(key, float(np.linalg.norm(rates)), float(waves[end]), rest, ramp)


def wave_tensions(p: Parameters) -> tuple[np.ndarray, float]:
    """Return the change of tension behind the axial wave of each end (end,), and the mean tension at rest in still air [N].

    A speed v along the cable changes the tension by v sqrt(K mu).  A speed w across it draws the cable round a kink that runs at
    c = sqrt(T / mu), and acts as a speed w^2 / 2c along it.
    """
    statics, plane = solve_statics(p, p.length_key, p.length_value), load_plane(p)
    length, horizontal, tensions = float(statics[0]), float(statics[2]), statics[4:]
    weight, rest = float(plane.load) * length, float(tensions.mean())
    chord = p.initial_ends[1] - p.initial_ends[0]
    directions = np.stack([chord, chord]) / plane.chord
    if weight > 1e-9 * rest and tensions.min() > 0.0:
        middle = (tensions[1] ** 2 - tensions[0] ** 2) / (2.0 * weight)
        upward = middle + np.array([-0.5, 0.5]) * weight
        directions = (horizontal * plane.across + upward[:, None] * plane.against) / tensions[:, None]
    stiffness, mass = p.stiffness, p.mass
    if is_piecewise(p):
        forces = piecewise_statics(p, p.length_key, p.length_value).end_forces
        directions = forces / np.sqrt((forces**2).sum(axis=1))[:, None]
    if p.segments:
        stiffness, mass = (np.array([getattr(p.segments[k], name) for k in (0, -1)]) for name in ("stiffness", "mass"))
    rates = p.initial_end_rates[0]
    along = np.abs((rates * directions).sum(axis=1))
    across = np.maximum((rates**2).sum(axis=1) - along**2, 0.0)
    with np.errstate(all="ignore"):
        inflow = 0.5 * across / np.sqrt(tensions / mass)
    return (along + inflow) * np.sqrt(stiffness * mass), rest
