"""Damping proportional to the tension: decay of the modes of a taut string, by every scheme and by the condensed model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from convergence import distances, orders
from references.free_decay import LENGTH, MASS, STIFFNESS, TENSION, decay_of, string_from_mode
from suite import slow

import cablepod as cp

#: Damping ratios of some per cent in all six modes.
ALPHA, BETA, LINKS = 0.1, 1.0e-3, 60
DAMPING = {"mass_proportional": ALPHA, "tension_proportional": BETA}


def string(mode, links=LINKS, **options):
    """The taut string that starts from a mode, with its shape, see :mod:`references.free_decay`."""
    return string_from_mode(mode, DAMPING, links=links, **options)


def frequency_of(mode):
    """Angular frequency in the chain: links of the length `reach` under tension, masses of the unstretched length [rad/s]."""
    reach, natural = LENGTH / LINKS, LENGTH / (1.0 + TENSION / STIFFNESS) / LINKS
    return 2.0 * math.sqrt(TENSION / reach / (MASS * natural)) * math.sin(mode * math.pi / (2 * LINKS))


def expected(omega):
    """Decay rate zeta omega by Rayleigh's formula [1/s]."""
    return omega * (ALPHA / (2.0 * omega) + BETA * omega / 2.0)


@pytest.mark.parametrize("mode", range(1, 7))
def test_modes_of_a_taut_string_decay_as_rayleigh_says(mode):
    scene, shape = string(mode)
    rate, omega = decay_of(cp.chain.simulate(scene, tolerance=1e-5, outputs=("position",)), shape)
    assert omega == pytest.approx(frequency_of(mode), rel=1e-3)
    assert rate == pytest.approx(expected(omega), rel=5e-3)


@pytest.mark.parametrize("scheme", ["trapezoidal", slow("generalized_alpha"), slow("energy_momentum")])
@pytest.mark.parametrize("spatial", [False, slow(True)])
def test_implicit_schemes_damp_alike(scheme, spatial):
    scene, shape = string(4, turned=0.5 * math.pi if spatial else None)
    rate, omega = decay_of(cp.chain.simulate(scene, scheme=scheme, step=5e-4), shape)
    assert rate == pytest.approx(expected(omega), rel=5e-3)


@pytest.mark.slow
def test_law_21_damps_alike():
    scene, shape = string(3)
    rate, omega = decay_of(cp.chain.simulate(scene, law="green", step=1.5e-4), shape)
    assert rate == pytest.approx(expected(omega), rel=5e-3)


@pytest.mark.parametrize("scheme", [None, "trapezoidal"])
def test_second_order_remains(scheme):
    scene, _ = string(6)
    steps = [1.6e-4, 8e-5, 4e-5] if scheme is None else [8e-4, 4e-4, 2e-4]
    runs = [cp.chain.simulate(scene, step=step, scheme=scheme).position.values for step in steps]
    assert orders(distances(runs)) == pytest.approx([2.0], abs=0.15)


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("mode", [1, 3, 6])
def test_the_condensed_model_damps_alike(mode, spatial):
    scene, shape = string(mode, turned=0.5 * math.pi if spatial else None)
    run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=6), tolerance=1e-5)
    rate, omega = decay_of(run, shape)
    assert omega == pytest.approx(frequency_of(mode), rel=2e-3)
    assert rate == pytest.approx(expected(omega), rel=5e-3)
    assert 0.0 < run.attrs["error_estimate"] < 0.05  # of the motion: a mode of the string that the model has


def test_the_condensed_model_keeps_second_order():
    scene, _ = string(6)
    modes = cp.condensed.vibration_modes(scene, rank=6)
    runs = [cp.condensed.simulate(scene, modes, step=step).amplitude.values for step in (4e-3, 2e-3, 1e-3)]
    assert orders(distances(runs)) == pytest.approx([2.0], abs=0.15)


@pytest.mark.slow
def test_a_slack_cable_is_not_damped():
    # a free particle falls beside a slack link: nothing but gravity acts
    scene = {
        "cable": {"youngs_modulus": 1e9, "area": 1e-4, "density": 8000.0, "unstretched_length": 12.0},
        "ends": {"lower": [0.0, 0.0], "upper": [10.0, 0.0]},
        "chain": {"links": 2},
        "initial": {"points": [[0.0, 0.0], [5.0, 0.0], [10.0, 0.0]]},
        "time": {"duration": 0.4, "interval": 0.1},
    }
    damped = cp.make_scene({**scene, "damping": {"tension_proportional": 10.0}})
    for options in ({}, {"scheme": "trapezoidal", "step": 1e-3}, {"scheme": "energy_momentum", "step": 1e-3}):
        run = cp.chain.simulate(damped, **options)
        assert run.position.values[:, 1, 1] == pytest.approx(-0.5 * 9.81 * run.time.values**2, abs=1e-4)


def test_members_of_the_condensed_model_are_single_runs():
    scene, _ = string(2, duration=0.2)
    members = cp.ensemble.design(scene, {"damping.tension_proportional": [1e-4, 1e-3]}, members=6, seed=1)
    modes = cp.condensed.vibration_modes(scene, rank=4)
    together = cp.condensed.simulate(members, modes, step=1e-3, outputs=("position",))
    alone = cp.condensed.simulate(members.isel(member=4, drop=True), modes, step=1e-3, outputs=("position",))
    assert np.array_equal(together.position.isel(member=4), alone.position)


def test_other_schemes_of_the_condensed_model_refuse_it():
    scene, _ = string(1, links=10, duration=0.1)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    for scheme in ("numerov", "trapezoidal"):
        with pytest.raises(cp.SceneError, match=r"^scheme: given"):
            cp.condensed.simulate(scene, modes, scheme=scheme)
