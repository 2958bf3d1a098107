"""Wind in all models and schemes: order, agreement, rest, prepared models."""

from __future__ import annotations

import math

import numpy as np
import pytest
from convergence import distances, orders
from suite import slow
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp

#: An end that swings in a wind that rises: relative velocities change all the time.
SWING = {"upper": {"z": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 3.0}}}
RISING = {**GUY, "wind": {**WIND, "ramp": 0.5}, "motion": SWING, "time": {"duration": 1.0, "interval": 0.1}}
DAMPING = ({}, {"damping": {"tension_proportional": 0.002}})
#: Longest of three steps [s] of the models by scheme, of the condensed one by order: those of quick tests, and others.
OFTEN = {
    ("chain", "velocity_verlet"): 5e-4, ("chain", "trapezoidal"): 2e-3, ("chain", "generalized_alpha"): 2e-3,
    ("condensed", "leading"): 0.01,
}  # fmt: skip
RARE = {
    ("chain", "energy_momentum"): 2e-3, ("condensed", "exact"): 0.01, ("condensed", "inertial"): 0.01,
    ("cable", "velocity_verlet"): 1.6e-4, ("cable", "trapezoidal"): 4e-3,
}  # fmt: skip


def runs_of(model, name, tables):
    """Return positions with three steps, each half of the last one."""
    scene, steps = cp.make_scene(tables), [(OFTEN | RARE)[model, name] / 2**i for i in range(3)]
    if model == "condensed":
        modes = cp.condensed.vibration_modes(scene, rank=4)
        runs = [cp.condensed.simulate(scene, modes, order=name, step=h, outputs=("position",)) for h in steps]
    elif model == "cable":
        runs = [cp.cable.simulate(scene, law="linear", scheme=name, step=h, elements=4) for h in steps]
    else:
        runs = [cp.chain.simulate(scene, scheme=name, step=h) for h in steps]
    return [run.position.values for run in runs]


@pytest.mark.parametrize(
    ("model", "name", "damping"),
    [*((*pair, {}) for pair in OFTEN), *(slow(*pair, damping) for pair in RARE for damping in DAMPING)],
    ids=str,
)
def test_second_order_remains(model, name, damping):
    (order,) = orders(distances(runs_of(model, name, {**RISING, **damping})))
    assert 1.7 < order < 2.4


@pytest.mark.slow
@pytest.mark.parametrize("damping", DAMPING)
def test_models_agree_in_wind(damping):
    tables = {**RISING, **damping, "chain": {"links": 80}}
    chain = cp.chain.simulate(cp.make_scene(tables), step=8e-5).position.values
    moved = np.abs(chain - chain[0]).max()
    assert moved > 0.3
    explicit, implicit, conserving = (
        runs_of(*pair, tables)[-1]
        for pair in (("cable", "velocity_verlet"), ("cable", "trapezoidal"), ("chain", "energy_momentum"))
    )
    assert np.abs(explicit - implicit).max() < 5e-5 * moved  # of the steps
    assert np.abs(explicit - chain).max() < 1e-3 * moved  # of the links
    assert np.abs(conserving - chain).max() < 5e-5 * moved
    scene = cp.make_scene(tables)
    modes = cp.condensed.vibration_modes(scene, rank=8, static_modes=True)
    for order in ("exact", "inertial"):
        run = cp.condensed.simulate(scene, modes, order=order, step=2e-3)
        assert np.abs(run.position.values - chain).max() < 2e-3 * moved
        assert run.attrs["error_estimate"] < 5e-3 or damping  # nan with damping by the tension


@pytest.mark.slow
def test_rest_of_the_cable_in_wind():
    scene = cp.make_scene({**GUY, "wind": {**WIND, "profile": "uniform"}, "chain": {"links": 320}})
    chain, cable = cp.chain.rest(scene), cp.cable.rest(scene, law="linear")
    change = np.abs(chain.position - cp.catenary.rest(scene, points=321).position.values).max()
    assert np.abs(cable.position - chain.position).max() < 5e-6 * change
    assert cable.attrs["space_error_estimate"] < 1e-10
    run = cp.cable.simulate(scene, law="linear", step=1e-3, scheme="trapezoidal", elements=8, times=[0.0, 0.2])
    assert np.abs(run.position[1] - run.position[0]).max() < 1e-8


@pytest.mark.slow
def test_a_drag_that_works_against_the_motion_takes_energy():
    # still but for the damping: the wind of a moment sets the cable in motion, and no wind stops it
    scene = cp.make_scene({**GUY, "wind": {**WIND, "speed": 1e-6, "profile": "uniform"}})
    rest = cp.chain.rest(scene).position.values
    moved = rest + 0.2 * np.sin(np.pi * np.linspace(0.0, 1.0, len(rest)))[:, None] * np.array([0.0, 0.0, 1.0])
    tables = {**GUY, "wind": {**WIND, "speed": 1e-6, "profile": "uniform"}, "initial": {"points": moved.tolist()}}
    end = {**tables, "time": {"duration": 20.0, "interval": 0.05}}
    run = cp.chain.simulate(cp.make_scene(end), scheme="energy_momentum", step=2e-3).position.values[:, 10, 2]
    first, last = np.abs(run[:40]).max(), np.abs(run[-40:]).max()
    assert last < 0.95 * first


# --- prepared models ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=[2, 3])
def gusty(request):
    """A guy in gusts whose upper end moves, in the plane and in space, with its modes."""
    dims = request.param
    tables = {
        **GUY,
        "ends": {"lower": [0.0] * dims, "upper": [20.4, 57.7, 0.0][:dims]},
        "chain": {"links": 40},
        "wind": {**KAIMAL, "direction": [1.0, 0.0] if dims == 2 else [0.6, 0.0, 0.8]},
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 3.0}}},
        "time": {"duration": 4.0, "interval": 0.1},
    }
    scene = cp.make_scene(tables)
    return scene, cp.condensed.vibration_modes(scene, rank=5, static_modes=True)


@pytest.mark.slow
def test_prepared_runs_in_wind(gusty):
    scene, modes = gusty
    guy = cp.condensed.prepare(scene, modes, step=0.002)
    run = guy.run(outputs=("position", "end_force"))
    simulated = cp.condensed.simulate(scene, modes, step=0.002, outputs=("position",))
    assert np.array_equal(run.position, simulated.position.values)
    chain = cp.chain.simulate(scene, step=1e-4, outputs=("position", "tension"))
    reach = (chain.position[:, -1] - chain.position[:, -2]).values
    force = -chain.tension.values[:, -1, None] * reach / np.sqrt((reach**2).sum(axis=1))[:, None]
    # without the half link at the end, which bears weight, inertia and drag of its own
    assert np.abs(run.end_force - force).max() < 0.02 * force.std(axis=0).max()


@pytest.mark.slow
def test_steps_of_a_host_in_wind(gusty):
    scene, modes = gusty
    amplitude, omega, interval = 0.05, 3.0, 0.1

    def forces(step):
        guy = cp.condensed.prepare(scene, modes, step=step)
        run = guy.run().end_force
        start, along, force = guy.end_position, np.eye(guy.end_position.size)[0], [guy.force]
        for t in step * np.arange(1, round(4.0 / step) + 1):
            force.append(
                guy.step(
                    start + amplitude * (1.0 - math.cos(omega * t)) * along,
                    amplitude * omega * math.sin(omega * t) * along,
                    step,
                    amplitude * omega**2 * math.cos(omega * t) * along,
                )
            )
        # at the start the force of a host is without the inertia of its mass
        return guy, np.abs(np.array(force)[:: round(interval / step)] - run)[1:].max()

    guy, difference = forces(0.002)
    # the run interpolates the air in the frame of the chord, the host does so at every step; the run also holds the drag over two
    # steps
    assert difference < 4e-5 * 1000.0  # of their standard deviation [N]
    resumed = cp.condensed.resume(guy.dataset())
    assert np.array_equal(resumed.state, guy.state)
    with pytest.raises(cp.SceneError, match=r"^step: given 0\.5; allowed: steps until 4 s, where the wind ends"):
        resumed.step(guy.end_position, 0.0 * guy.end_position, 0.5)


@pytest.mark.slow
def test_a_given_field_for_a_prepared_model(gusty):
    scene, modes = gusty
    other = cp.wind.field(scene, seed=11)
    own, given = (cp.condensed.prepare(scene, modes, step=0.004, wind=wind) for wind in (None, other))
    simulated = cp.condensed.simulate(scene, modes, step=0.004, wind=other, outputs=("position",)).position.values
    assert np.array_equal(given.run(outputs=("position",)).position, simulated)
    assert np.abs(own.run().end_force - given.run().end_force).max() > 20.0
    given.step(given.end_position, 0.0 * given.end_position, 0.004)
    stored = given.dataset()
    assert np.array_equal(cp.condensed.resume(stored, wind=other).state, given.state)
    with pytest.raises(cp.SceneError, match=r"^wind: missing; allowed: that given to `prepare`"):
        cp.condensed.resume(stored)
    with pytest.raises(cp.SceneError, match=r"^wind: given .*; allowed: the field with the id"):
        cp.condensed.resume(stored, wind=cp.wind.field(scene, seed=12))
    with pytest.raises(cp.SceneError, match=r"^wind: given; allowed: none"):
        cp.condensed.resume(own.dataset(), wind=other)
