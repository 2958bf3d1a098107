"""Light lines in wind: drag acts faster than the links vibrate, and steps and Newton's method take account of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from suite import slow

import cablepod as cp

DIAMETER, MASS, STIFFNESS, SPEED = 2e-3, 2.2e-3, 3.1e3, 40.0
AREA = 0.25 * math.pi * DIAMETER**2
#: Rate rho C d U / mu at which drag takes away a motion along the wind [1/s], with the density and coefficient of a scene.
RATE = 1.25 * 1.2 * DIAMETER * SPEED / MASS


def line(links=10, *, dims=3, **wind):
    return cp.make_scene(
        {
            "cable": {
                "area": AREA, "youngs_modulus": STIFFNESS / AREA, "density": MASS / AREA, "diameter": DIAMETER,
                "top_tension": 10.0,
            },
            "ends": {"lower": [0.0, 0.0, 0.0][:dims], "upper": [0.0, 60.0, 0.0][:dims]},
            "wind": {"speed": SPEED, "direction": [1.0, 0.0, 0.0][:dims], "profile": "uniform", **wind},
            "chain": {"links": links},
            "time": {"duration": 5.0, "interval": 0.5},
        }
    )  # fmt: skip


def dims_for(options):
    """Return 2 for the scheme whose kernel other tests have in the plane alone."""
    return 2 if options.get("scheme") == "energy_momentum" else 3


@pytest.mark.parametrize(
    "options",
    [
        {}, {"tolerance": 1e-3}, {"step": 0.002}, {"scheme": "trapezoidal"}, {"scheme": "trapezoidal", "step": 0.01},
        {"scheme": "trapezoidal", "step": 0.05}, {"scheme": "generalized_alpha"}, {"scheme": "generalized_alpha", "step": 0.01},
        {"scheme": "energy_momentum"}, {"scheme": "energy_momentum", "step": 0.05},
    ],
    ids=str,
)  # fmt: skip
def test_a_light_line_stays_at_rest_in_a_steady_wind(options):
    scene = line(dims=dims_for(options))
    run, rest = cp.chain.simulate(scene, **options), cp.chain.rest(scene)
    # another solver, of the static equations; both leave 1e-10 of the tension
    np.testing.assert_allclose(run.tension, np.broadcast_to(rest.tension, run.tension.shape), rtol=1e-8)


@pytest.mark.parametrize("scheme", [None, slow("trapezoidal")])
def test_the_continuous_light_line_stays_at_rest(scheme):
    scene = line()
    run, rest = cp.cable.simulate(scene, scheme=scheme, elements=8), cp.cable.rest(scene, elements=8)
    np.testing.assert_allclose(run.tension[-1], rest.tension, rtol=1e-6)


@pytest.mark.parametrize("links", [5, 40])
def test_schemes_agree_where_the_wind_rises(links):
    schemes = ("velocity_verlet", "trapezoidal", "generalized_alpha", "energy_momentum")
    truth, *runs = (
        cp.chain.simulate(line(links, dims=dims_for({"scheme": scheme}), ramp=1.0), scheme=scheme, tolerance=1e-4)
        for scheme in schemes
    )
    assert not truth.position.sel(coordinate="z").any()
    motion = np.sqrt(((truth.position - truth.position[0]) ** 2).sum("coordinate").mean("particle")).max()
    for run in runs:
        gap = np.sqrt(((run.position - truth.position) ** 2).sum("coordinate").mean("particle")).max()
        assert gap < 2e-4 * motion  # both within 1e-4
        # nothing vibrates at the end: it is the equilibrium in the full wind
        np.testing.assert_allclose(run.tension[-1], cp.chain.rest(line(links)).tension, rtol=1e-4)


def test_condensed_models_of_light_lines_run_where_the_wind_rises():
    scene = line(20, ramp=1.0)
    modes = cp.condensed.vibration_modes(line(20), rank=4)
    run = cp.condensed.simulate(scene, modes, outputs=("tension",))
    assert run.attrs["step"] * RATE < 0.4
    # to leading order in the slopes, of which the largest is 0.5
    assert float(run.tension[-1].mean()) == pytest.approx(float(cp.chain.rest(line(20)).tension.mean()), rel=0.1)


@pytest.mark.parametrize("model", ["chain", "cable", "condensed", "prepare"])
def test_a_step_beyond_the_rate_of_the_drag_is_refused_with_the_limit(model):
    scene, step = line(3), 1.01 * 0.4 / RATE
    modes = cp.condensed.vibration_modes(scene, rank=1)
    runs = {
        "chain": lambda: cp.chain.simulate(scene, step=step),
        # elements so long and soft that their own limit is above that of the drag
        "cable": lambda: cp.cable.simulate(stiffless(scene), step=step, elements=1, order=2),
        "condensed": lambda: cp.condensed.simulate(scene, modes, step=step, scheme="velocity_verlet"),
        "prepare": lambda: cp.condensed.prepare(scene, modes, step=step),
    }
    with pytest.raises(cp.SceneError, match=rf"given .* limit, {0.4 / RATE:.6g} s, by the rate at which drag changes"):
        runs[model]()


def stiffless(scene):
    return scene.assign(cable_youngs_modulus=scene.cable_youngs_modulus / 20.0)


@pytest.mark.slow
def test_a_host_knows_the_limit_of_the_drag():
    scene = line(3)
    guy = cp.condensed.prepare(scene, cp.condensed.vibration_modes(scene, rank=1))
    assert guy.step_limit == pytest.approx(0.4 / RATE)
    with pytest.raises(cp.SceneError, match="by the rate at which drag changes"):
        guy.step(guy.end_position, np.zeros(3), 0.41 / RATE)
    assert np.isfinite(guy.step(guy.end_position, np.zeros(3), 0.39 / RATE)).all()


@pytest.mark.parametrize("guys", ["chain", "condensed"])
def test_light_guys_of_a_mast_stay_at_rest_in_a_steady_wind(guys):
    cable = {"area": AREA, "youngs_modulus": 2e10, "density": MASS / AREA, "diameter": DIAMETER}
    scene = cp.make_scene(
        {
            "mast": {
                "height": 30.0, "base": "pinned", "bending_stiffness": 1e7, "mass": 50.0, "damping_ratio": 0.01,
            },
            "cables": {"light": cable},
            "guy": [{
                "cable": "light", "level": 30.0, "radius": 20.0, "count": 3, "direction": [1.0, 0.0, 0.0], "top_tension": 300.0,
            }],
            "wind": {"speed": SPEED, "direction": [1.0, 0.0, 0.0], "profile": "uniform"},
            "time": {"duration": 5.0, "interval": 0.5},
            **({"chain": {"links": 10}} if guys == "chain" else {}),
        }
    )  # fmt: skip
    run = cp.mast.simulate(scene, guys=guys)
    assert run.attrs["step"] * RATE < 0.4
    tension = run.guy_tension.transpose("time", ...)
    # from rest, but for what the modes and links of the guys leave of it; held drag of longer steps makes them tens of percent
    np.testing.assert_allclose(tension[-1], tension[0], rtol=0.02)


@pytest.mark.parametrize("links", [20, 80])
def test_rounding_of_a_chain_at_rest_is_no_error_of_its_tensions(links, recwarn):
    cable = {"area": 1.274e-4, "youngs_modulus": 1.6e11, "density": 7850.0, "diameter": 0.0127, "top_tension": 1750.0}
    scene = cp.make_scene(
        {
            "cable": cable, "ends": {"lower": [0.0, 1.0, 0.0], "upper": [30.0, 51.0, 0.0]}, "chain": {"links": links},
            "time": {"duration": 3.0, "interval": 0.05},
        }
    )  # fmt: skip
    run = cp.chain.simulate(scene, scheme="velocity_verlet")
    assert run.attrs["tension_time_error_estimate"] < 1e-6
    assert not [warning for warning in recwarn if warning.category is cp.NotConvergedWarning]
