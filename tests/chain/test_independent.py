"""Chain with every term at once against SciPy's DOP853 on independently written equations of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.chain_ode import Links
from suite import slow

import cablepod as cp

RELATIVE = [1.0, 3.0, 2.0, 0.5, 1.5]
LENGTH = 10.4
SCENE = {
    "gravity": 9.7,
    "cable": {"youngs_modulus": 3.0e7, "area": 1.0e-3, "density": 900.0, "unstretched_length": LENGTH},
    "ends": {"lower": [1.0, -2.0, 0.5], "upper": [7.0, 5.0, 3.0]},
    "motion": {
        "lower": {"z": {"kind": "harmonic", "amplitude": 0.2, "angular_frequency": 3.0, "phase": 0.7}},
        "upper": {
            "x": {"kind": "ramp", "amplitude": 0.4, "duration": 1.3},
            "y": {"kind": "polynomial", "coefficients": [0.05, -0.02]},
        },
    },
    "load": {"uniform": [1.0, 2.0, -3.0], "kind": "harmonic", "amplitude": 2.0, "angular_frequency": 5.0},
    "point_load": [
        {"arc_length": 0.5, "force": [3.0, -9.0, 1.0]},
        {
            "arc_length": 0.83,
            "force": [-20.0, 0.0, 5.0],
            "kind": "one_minus_cosine",
            "amplitude": 0.5,
            "angular_frequency": 2.0,
        },
    ],
    "damping": {"mass_proportional": 0.4, "link_viscosity": 0.003},
    "time": {"duration": 3.0, "interval": 0.5},
    "chain": {"link_lengths": RELATIVE},
}


TIMES = np.linspace(0.0, 3.0, 7)


def ends(t):
    """Positions and velocities of both ends."""
    s = min(t / 1.3, 1.0)
    lower = [1.0, -2.0, 0.5 + 0.2 * (np.sin(3 * t + 0.7) - np.sin(0.7))]
    upper = [7.0 + 0.4 * (6 * s**5 - 15 * s**4 + 10 * s**3), 5.0 + 0.05 * t - 0.02 * t * t, 3.0]
    ds = 30 * s**4 - 60 * s**3 + 30 * s**2
    return np.array([lower, upper]), np.array(
        [[0.0, 0.0, 0.6 * np.cos(3 * t + 0.7)], [0.4 * ds / 1.3, 0.05 - 0.04 * t, 0.0]]
    )


def links(**changes):
    """The chain of the scene for the integrator of the references."""
    length = np.array(RELATIVE) / sum(RELATIVE) * LENGTH
    share = 0.5 * (np.append(length, 0.0) + np.append(0.0, length))

    def loads(t):
        force = 0.9 * share[:, None] * [0.0, -9.7, 0.0] + share[:, None] * [1.0, 2.0, -3.0] * 2.0 * np.sin(5 * t)
        # sigma 0.5: 5.2 m along links of 1.3, 3.9, 2.6, 0.65, 1.95 m lies at the joint of links 2 and 3
        force[2] += [3.0, -9.0, 1.0]
        # sigma 0.83: 8.632 m lies 0.182 m along link 5, which begins at 8.45 m
        part = (0.83 * LENGTH - 8.45) / 1.95
        pull = np.array([-20.0, 0.0, 5.0]) * 0.5 * (1 - np.cos(2 * t))
        force[4] += (1 - part) * pull
        force[5] += part * pull
        return force

    chain = Links(length, 3e4 / length, 0.9 * share, loads, ends, damping=0.4, viscosity=0.003)
    return replace(chain, **changes)


def assert_close(position, known, part):
    """Compare positions of the moving particles; the largest distance is a part of the motion."""
    motion = np.abs(known - known[0]).max()
    np.testing.assert_allclose(position[:, 1 : 1 + known.shape[1]], known, rtol=0, atol=part * motion)


@pytest.mark.parametrize(
    ("options", "free_upper"),
    [slow({}, False), slow({}, True), ({"scheme": "trapezoidal", "step": 2e-4}, False)],
    ids=["default", "free end", "trapezoidal"],
)
def test_every_term_at_once(options, free_upper):
    mapping = dict(SCENE)
    if free_upper:
        mapping["ends"] = {**SCENE["ends"], "free": "upper"}
        mapping["motion"] = {"lower": SCENE["motion"]["lower"]}
    run = cp.chain.simulate(cp.make_scene(mapping), times=TIMES, outputs=("position",), **options)
    # the default keeps 1e-6 of the motion, rms; the largest single distance is allowed five of them; the given step is of second
    # order, with 5e-6 at 5e-5 s
    allowed = 8e-5 if "step" in options else 5e-6
    assert_close(run.position.values, links(is_free=free_upper).positions(run.position[0], TIMES), allowed)


def test_the_start_is_at_rest_under_the_loads_of_the_start():
    scene = cp.make_scene({key: value for key, value in SCENE.items() if key != "motion"})
    start = cp.chain.rest(scene).position.values[1:5]
    # the ends of this scene stand still, so no velocity of theirs enters the viscous links
    still = links(ends=lambda t: (ends(t)[0], np.zeros((2, 3))))
    acceleration = still.rates(0.0, np.concatenate([start.ravel(), np.zeros(12)]))[12:]
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["trapezoidal", "generalized_alpha", "energy_momentum"])
def test_every_term_at_once_of_members_in_lanes(scheme):
    scene = cp.make_scene(SCENE)
    damping = scene["damping_mass_proportional"]
    # so many that those of each thread advance together
    scenes = scene.assign(damping_mass_proportional=("member", np.tile([0.1, 0.4, 0.8, 0.2], 8), damping.attrs))
    runs = cp.chain.simulate(scenes, scheme=scheme, step=5e-4, times=TIMES, outputs=("position",))
    # of second order in the step
    assert_close(runs.position.values[1], links().positions(runs.position[1, 0], TIMES), 2e-4)
