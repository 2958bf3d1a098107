"""Chain with every term at once against SciPy's DOP853 on independently written equations of motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
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


def ends(t):
    s = min(t / 1.3, 1.0)
    lower = np.array([1.0, -2.0, 0.5 + 0.2 * (np.sin(3 * t + 0.7) - np.sin(0.7))])
    upper = np.array([7.0 + 0.4 * (6 * s**5 - 15 * s**4 + 10 * s**3), 5.0 + 0.05 * t - 0.02 * t * t, 3.0])
    ds = 30 * s**4 - 60 * s**3 + 30 * s**2
    v_lower = np.array([0.0, 0.0, 0.6 * np.cos(3 * t + 0.7)])
    v_upper = np.array([0.4 * ds / 1.3, 0.05 - 0.04 * t, 0.0])
    return lower, upper, v_lower, v_upper


def rates(t, state, *, free_upper=False):
    """Right side of m r'' = P + T_j - T_(j-1) - c m r', link by link."""
    length = np.array(RELATIVE) / sum(RELATIVE) * LENGTH
    stiffness, density = 3e4, 0.9
    lower, upper, v_lower, v_upper = ends(t)
    inner = np.array(state).reshape(2, -1, 3)
    r = [lower, *inner[0]] + ([] if free_upper else [upper])
    v = [v_lower, *inner[1]] + ([] if free_upper else [v_upper])
    force = np.zeros((6, 3))
    mass = np.zeros(6)
    for j, rest in enumerate(length):
        mass[j] += 0.5 * density * rest
        mass[j + 1] += 0.5 * density * rest
        gap = r[j + 1] - r[j]
        size = np.sqrt(gap @ gap)
        if size > rest:
            strain_rate = gap @ (v[j + 1] - v[j]) / size / rest
            tension = max(0.0, stiffness * (size / rest - 1) + stiffness * 0.003 * strain_rate)
            force[j] += tension * gap / size
            force[j + 1] -= tension * gap / size
    for j in range(6):
        per_length = mass[j] / density
        force[j] += mass[j] * np.array([0, -9.7, 0]) + per_length * np.array([1.0, 2.0, -3.0]) * 2 * np.sin(5 * t)
        force[j] -= 0.4 * mass[j] * (np.array(v[j]) if j < len(v) else 0.0)
    # sigma 0.5: 5.2 m along links of 1.3, 3.9, 2.6, 0.65, 1.95 m lies at the joint of links 2 and 3
    force[2] += [3.0, -9.0, 1.0]
    # sigma 0.83: 8.632 m lies 0.182 m along link 5, which begins at 8.45 m
    share = (0.83 * LENGTH - 8.45) / 1.95
    pull = np.array([-20.0, 0.0, 5.0]) * 0.5 * (1 - np.cos(2 * t))
    force[4] += (1 - share) * pull
    force[5] += share * pull
    moved = slice(1, 6 if free_upper else 5)
    return np.concatenate([np.ravel(inner[1]), np.ravel(force[moved] / mass[moved, None])])


@pytest.mark.parametrize(
    ("options", "free_upper"),
    [slow({}, False), slow({}, True), ({"scheme": "trapezoidal", "step": 5e-5}, False)],
    ids=["default", "free end", "trapezoidal"],
)
def test_every_term_at_once(options, free_upper):
    mapping = dict(SCENE)
    if free_upper:
        mapping["ends"] = {**SCENE["ends"], "free": "upper"}
        mapping["motion"] = {"lower": SCENE["motion"]["lower"]}
    scene = cp.make_scene(mapping)
    times = np.linspace(0, 3, 7)
    run = cp.chain.simulate(scene, times=times, outputs=("position",), **options)
    start = run.position.values[0, 1 : 6 if free_upper else 5]
    solved = solve_ivp(
        lambda t, y: rates(t, y, free_upper=free_upper),
        (0, 3), np.concatenate([start.ravel(), np.zeros(start.size)]), method="DOP853", t_eval=times, rtol=1e-10, atol=1e-11,
    )  # fmt: skip
    known = solved.y.T.reshape(len(times), 2, -1, 3)[:, 0]
    motion = np.abs(known - known[0]).max()
    # the default keeps 1e-6 of the motion, rms; the largest single distance is allowed five of them
    np.testing.assert_allclose(run.position.values[:, 1 : 6 if free_upper else 5], known, rtol=0, atol=5e-6 * motion)


def test_the_start_is_at_rest_under_the_loads_of_the_start(monkeypatch):
    scene = cp.make_scene({key: value for key, value in SCENE.items() if key != "motion"})
    start = cp.chain.rest(scene).position.values[1:5]
    # the ends of this scene stand still, so no velocity of theirs enters the viscous links
    monkeypatch.setitem(globals(), "ends", lambda t: (*moving(t)[:2], np.zeros(3), np.zeros(3)))
    acceleration = rates(0.0, np.concatenate([start.ravel(), np.zeros(12)]))[12:]
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-8)


moving = ends


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["trapezoidal", "generalized_alpha", "energy_momentum"])
def test_every_term_at_once_of_members_in_lanes(scheme):
    scene = cp.make_scene(SCENE)
    damping = scene["damping_mass_proportional"]
    # so many that those of each thread advance together
    scenes = scene.assign(damping_mass_proportional=("member", np.tile([0.1, 0.4, 0.8, 0.2], 8), damping.attrs))
    times = np.linspace(0, 3, 7)
    runs = cp.chain.simulate(scenes, scheme=scheme, step=5e-4, times=times, outputs=("position",))
    start = runs.position.values[1, 0, 1:5]
    begin = np.concatenate([start.ravel(), np.zeros(start.size)])
    solved = solve_ivp(rates, (0, 3), begin, method="DOP853", t_eval=times, rtol=1e-10, atol=1e-11)
    known = solved.y.T.reshape(len(times), 2, -1, 3)[:, 0]
    motion = np.abs(known - known[0]).max()
    # of second order in the step
    np.testing.assert_allclose(runs.position.values[1, :, 1:5], known, rtol=0, atol=2e-4 * motion)
