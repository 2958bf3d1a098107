"""Waves along the cable in the error estimate: an independent integration, and errors against the chain."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

import cablepod as cp
from cablepod.condensed import _estimate_neglected as waves
from cablepod.parameters._from_scene import parameters

LENGTH = 9.2


def bar(p, end_time):
    """Largest rms distance of the waves in a bar from what the model contains, by a method of high order [m]."""
    omega = math.pi / LENGTH * math.sqrt(p.stiffness / p.mass) * np.arange(1, waves.MODES + 1)
    chord = p.upper - p.lower
    n, along, alpha = np.arange(1, waves.MODES + 1), chord / np.linalg.norm(chord), p.damping

    def on_modes(times, *derivatives):
        ends = sum(factor * (p.end_positions(times, order) @ along) for order, factor in derivatives)
        return 2.0 / (math.pi * n) * (ends[:, :1] - (-1.0) ** n * ends[:, 1:])

    def rates(time, state):
        b, b_rate = state.reshape(2, -1)
        force = -on_modes(np.array([time]), (2, 1.0), (1, alpha))[0]
        return np.concatenate([b_rate, force - alpha * b_rate - omega**2 * b])

    start = np.concatenate([np.zeros(n.size), -on_modes(np.zeros(1), (1, 1.0))[0]])
    times = np.linspace(0.0, end_time, 1001)
    options = {"rtol": 1e-5, "atol": 1e-9, "max_step": 0.1 * p.shortest_time_scale, "t_eval": times}
    found = solve_ivp(rates, (0.0, end_time), start, method="DOP853", **options)
    distance = found.y[: n.size] + on_modes(times, (2, 1.0), (1, alpha)).T / omega[:, None] ** 2
    return math.sqrt(0.5 * (distance**2).sum(axis=0).max())


@pytest.mark.parametrize(
    ("kind", "damping", "ratio"),
    [
        ("harmonic", 3.0, 0.03),
        ("harmonic", 0.0, 0.3),
        ("one_minus_cosine", 0.0, 0.08),
        ("one_minus_cosine", 3.0, 1.04),
        ("harmonic", 3.0, 3.1),
    ],
)
def test_waves_are_those_of_a_bar(soft, kind, damping, ratio):
    omega = ratio * math.pi / LENGTH * math.sqrt(2e7 / 1000.0)
    motion = {"upper": {"x": {"kind": kind, "amplitude": 0.01, "angular_frequency": omega}}}
    p = parameters(cp.make_scene({**soft, "motion": motion, "damping": {"mass_proportional": damping}}))
    assert waves.waves(p, LENGTH, 0.3) == pytest.approx(bar(p, 0.3), rel=0.12)  # that of the start counts no damping


def test_ends_that_stand_still_make_no_waves(soft):
    assert waves.waves(parameters(cp.make_scene({**soft, "motion": {}})), LENGTH, 1.0) == 0.0


@pytest.mark.filterwarnings("ignore::cablepod.VelocityJumpWarning", "ignore::cablepod.OutOfRangeWarning")
@pytest.mark.parametrize("order", ["leading", "exact", "inertial"])
@pytest.mark.parametrize(("kind", "omega"), [("harmonic", 15.0), ("one_minus_cosine", 30.0)])
def test_the_estimate_contains_starts_with_a_jump_and_fast_ends(soft, order, kind, omega):
    # a taut cable on nearly all of its modes: hardly anything but the waves is wrong
    motion = {"upper": {"x": {"kind": kind, "amplitude": 0.05, "angular_frequency": omega}}}
    cable = {**soft["cable"], "youngs_modulus": 2e8, "top_tension": 2000.0}
    time, ends = {"duration": 1.0, "interval": 0.01}, {"lower": [0.0, 0.0], "upper": [9.0, 0.0]}
    scene = cp.make_scene(
        {**soft, "cable": cable, "ends": ends, "motion": motion, "chain": {"links": 12}, "time": time}
    )
    chain = cp.chain.simulate(scene, step=2e-4, outputs=("position",))
    modes = cp.pod.decompose(chain, layout="normal", rank=8)
    run = cp.condensed.simulate(scene, modes, order=order)
    error = float(cp.compare.errors(run, chain).error_max)
    assert error == pytest.approx(run.attrs["error_estimate"], rel=0.25)
    members = xr.concat([scene.assign(cable_density=scene.cable_density * factor) for factor in (1.0, 1.5)], "member")
    assert float(cp.condensed.simulate(members, modes, order=order).error_estimate[0]) == pytest.approx(
        run.attrs["error_estimate"], rel=1e-7
    )
