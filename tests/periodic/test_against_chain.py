"""Where a chain settles after long forcing: both branches of a resonance, a superharmonic, whirling, a doubled response."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY

import cablepod as cp

RANK, INSTANTS = 6, 32
#: Name -> angular frequency [rad/s], amplitude [m], damping [1/s], time until the chain has settled [s].
POINTS = {
    "superharmonic": (3.1, 0.02, 0.3, 60.0),
    "resonance": (6.2, 0.02, 0.3, 60.0),
    "lower branch": (12.65, 0.003, 0.09, 250.0),
    "upper branch": (12.65, 0.003, 0.09, 250.0),
    "whirling": (12.56, 0.003, 0.09, 600.0),
    "doubled": (12.503, 0.004, 0.06, 900.0),
}


def scene_of(name, phase=0.0, spatial=False, **tables):
    """The guy of a point; its motion begins at a phase, and its end then lies where that is."""
    omega, amplitude, damping, _ = POINTS[name]
    mapping = copy.deepcopy(GUY) | tables
    mapping["damping"]["mass_proportional"] = damping
    mapping["motion"]["upper"]["x"] |= {"angular_frequency": omega, "amplitude": amplitude, "phase": phase}
    if phase:  # of the same unstretched length
        length = float(cp.catenary.rest(scene_of(name)).unstretched_length)
        mapping["cable"] = {key: value for key, value in mapping["cable"].items() if key != "top_tension"}
        mapping["cable"]["unstretched_length"] = length
        mapping["ends"]["upper"][0] += amplitude * np.sin(phase)
    if spatial:
        for end in mapping["ends"].values():
            end.append(0.0)
    return cp.make_scene(mapping)


def first_guess(name, scene, modes):
    """A point of a frequency response near the orbit that is wanted; None for that grown from rest."""
    omega = POINTS[name][0]
    if name not in ("upper branch", "whirling", "doubled"):
        return None
    response = cp.periodic.frequency_response(
        scene, modes, frequency=(omega - 0.35, omega + 0.1), outputs=("harmonics",), out_of_plane=name != "upper branch"
    )
    near = (np.abs(response.angular_frequency.values - omega) < 0.03) & response.stable.values.astype(bool)
    if name == "upper branch":
        near &= response.deflection_maximum.values > 0.09
    elif name == "whirling":
        near &= np.nan_to_num(response.amplitude_out_of_plane.values).max(axis=1) > 0.02
    else:
        near &= response.periods.values == 2
    places = np.flatnonzero(near)
    closest = np.argmin(np.abs(response.angular_frequency.values[places] - omega))
    return response.isel(point=int(places[closest]))


def size(field):
    """Largest rms over the particles of a vector field (time, particle, coordinate)."""
    return np.sqrt((field**2).sum(axis=2).mean(axis=1)).max()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning")  # tension after the start of the ends with a speed
@pytest.mark.filterwarnings("ignore::cablepod.VelocityJumpWarning")
@pytest.mark.parametrize("name", POINTS)
def test_the_chain_settles_on_the_orbit(name):
    omega, _, _, settled = POINTS[name]
    periods = 2 if name == "doubled" else 1
    scene = scene_of(name)
    modes = cp.condensed.vibration_modes(scene, rank=RANK)
    start = first_guess(name, scene, modes)
    orbit = cp.periodic.orbit(
        scene, modes, start=start, periods=periods, outputs=("position",), out_of_plane=name != "upper branch"
    )
    assert orbit.stable
    position = orbit.position.values[:-1]
    spatial, first, tables = start is not None and name != "upper branch", 0, {}
    if (
        start is not None
    ):  # the chain starts at rest from the shape with the least velocities, in the basin of the orbit
        velocity = np.roll(position, -1, axis=0) - np.roll(position, 1, axis=0)
        first = int(np.argmin((velocity**2).sum(axis=(1, 2))))
        tables["initial"] = {"points": position[first].tolist()}
    chain = scene_of(name, 2.0 * np.pi * first / 128, spatial, **tables)
    period = 2.0 * np.pi / omega
    begin = periods * round(settled / period / periods)
    times = period * (begin + np.arange(2 * INSTANTS * periods) / INSTANTS)
    run = cp.chain.simulate(chain, times=times, tolerance=1e-3, outputs=("position",)).position.values
    truth, later = run[: INSTANTS * periods], run[INSTANTS * periods :]
    motion = size(truth - truth.mean(axis=0))
    assert size(later - truth) < 1e-4 * motion
    found = np.roll(position, -first, axis=0)[:: 128 // INSTANTS]
    errors = []
    for shift in range(periods):  # a doubled orbit may run a period later, and motion out of the plane be mirrored
        for mirror in (1.0, -1.0) if spatial else (1.0,):
            error = np.roll(found, INSTANTS * shift, axis=0) * ([1.0, 1.0, mirror] if spatial else 1.0) - truth
            errors.append(size(error) / motion)
    # found 1.5, 0.6, 1.3, 0.3, 0.5, 0.3 %, mostly of the mean shape: vibration modes hold the sag badly.  With three modes
    # 3.9, 1.6, 3.6, 0.9, 1.2, 1.0 %, of which 0.5, 0.5, 0.8, 0.3, 0.5, 0.7 % are of the motion about it.
    assert min(errors) < 0.02
