"""Outputs of the condensed model, comparison with the chain, choice of the step, error estimate."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import xarray as xr
from scenes import ORDERS, PAIRS, everything, full_modes, spatial

import cablepod as cp


@pytest.fixture(scope="module")
def modes():
    return {dims: full_modes(dims=dims) for dims in (2, 3)}


@pytest.mark.parametrize(("order", "scheme"), PAIRS)
def test_extremes_in_space_are_taken_over_all_steps(soft, modes, order, scheme):
    scene = cp.make_scene(everything(soft, 3))
    options = {"order": order, "scheme": scheme, "step": 1 / 500}
    run = cp.condensed.simulate(
        scene, modes[3], times=np.arange(501) / 500, outputs=("tension", "tension_extremes"), **options
    )
    # another first guess of the closure changes rounding, 1e-13 K = 1e-8 N
    np.testing.assert_allclose(run.tension_maximum, run.tension.max("time"), rtol=1e-9)
    np.testing.assert_allclose(run.tension_minimum, run.tension.min("time"), rtol=1e-9)
    few = cp.condensed.simulate(scene, modes[3], times=[1.0], outputs=("tension_extremes",), **options)
    np.testing.assert_allclose(few.tension_maximum, run.tension_maximum, rtol=1e-12)


@pytest.mark.parametrize(("order", "law"), [*((o, "linear") for o in ORDERS), ("exact", "green")])
@pytest.mark.parametrize("dims", [2, 3])
def test_velocities_are_the_rates_of_the_positions(soft, modes, dims, order, law):
    mapping = everything(soft, dims)
    steady = copy.deepcopy(mapping) | {"load": {"uniform": mapping["load"]["uniform"]}, "initial": {"top_tension": 280}}
    steady["point_load"] = mapping["point_load"][:1]
    steady["motion"] = {
        "lower": {"y": {"kind": "polynomial", "coefficients": [0.03]}},
        "upper": {"x": {"kind": "polynomial", "coefficients": [0.05]}},
    }
    h = 1 / 2000
    # central differences err by (omega h)^2 / 6 = 1e-4 at 40 rad/s; velocities neglect the rate of stretch by time-dependent
    # loads, (10 N/s) / (1e5 N) times the length, 1e-3 m/s
    for case, allowed in ((steady, 1e-4), (mapping, 5e-3)):
        run = cp.condensed.simulate(
            cp.make_scene(case), modes[dims], order=order, law=law, scheme="velocity_verlet", step=h,
            times=np.arange(1001) * h, outputs=("position", "velocity"),
        )  # fmt: skip
        numeric = (run.position.values[2:] - run.position.values[:-2]) / (2 * h)
        inner = run.velocity.values[1:-1]
        assert np.abs(numeric - inner).max() < allowed * np.abs(inner).max()


def test_a_number_of_a_link_stands_for_a_list_of_one(soft, modes):
    scene, options = cp.make_scene(soft), {"outputs": ("tension",), "step": 1 / 100}
    one, listed = (cp.condensed.simulate(scene, modes[2], links=links, **options) for links in (3, [3]))
    xr.testing.assert_identical(one, listed)


def test_positions_and_tensions_are_those_of_the_chain(soft):
    mapping = {**soft, "cable": {**soft["cable"], "youngs_modulus": 2e8}}
    scene = cp.make_scene(mapping)
    times = np.arange(0.0, 4.01, 0.1)
    chain = cp.chain.simulate(scene, times=times, outputs=("position", "tension"), tolerance=1e-4)
    chain_modes = cp.pod.decompose(chain, layout="normal")
    swing = float(chain.tension.max() - chain.tension.min())
    last = np.inf
    # neglected: third power of slopes of 0.2; chordwise inertia; rotation of the chord
    for order, limit, most in (("leading", 0.05, 0.5), ("exact", 1e-2, 0.1), ("inertial", 1e-3, 0.02)):
        run = cp.condensed.simulate(
            scene, chain_modes, order=order, times=times, outputs=("position", "tension", "tension_extremes")
        )
        error = float(cp.compare.errors(run, chain).error_max)
        assert error < limit
        assert error < last
        last = error
        assert float(np.abs(run.tension - chain.tension).max()) < most * swing
        assert (run.tension_maximum >= run.tension.max("time") * (1 - 1e-12)).all()


def test_damping_acts_on_the_motion_of_the_frame_too(soft):
    # ends that move away together: the cable lags behind, as in the chain
    away = {"kind": "polynomial", "coefficients": [0.0, 0.1]}
    mapping = {
        **soft,
        "cable": {**soft["cable"], "youngs_modulus": 2e8},
        "damping": {"mass_proportional": 2.0},
        "motion": {"lower": {"x": away}, "upper": {"x": away}},
    }
    scene, times = cp.make_scene(mapping), np.arange(0.0, 2.1, 0.2)
    chain = cp.chain.simulate(scene, times=times, tolerance=1e-4, scheme="velocity_verlet")
    run = cp.condensed.simulate(scene, cp.pod.decompose(chain, layout="normal"), order="inertial", times=times)
    shift = 0.1 * times[:, None] ** 2
    lag = np.abs(chain.position[..., 0] - shift - chain.position[0, :, 0]).max()
    # strain and slopes change the lag by 1e-3
    assert float(np.abs(run.position - chain.position).max()) < 5e-3 * float(lag)


@pytest.mark.filterwarnings("ignore:.*the model expects an error:cablepod.OutOfRangeWarning")  # modes of another cable
def test_amplitudes_reconstruct_the_deflection_and_inputs_are_unchanged(soft, modes):
    scene = cp.make_scene(everything(soft, 3))
    before = scene.copy(deep=True), modes[3].copy(deep=True)
    picked = modes[3].isel(mode=[0, 2])  # found again by their numbers
    run = cp.condensed.simulate(scene, picked, order="exact", step=1e-3, times=[0.5, 1.0])
    back = cp.pod.reconstruct(run, modes[3])
    e = run.end_position.isel(end=1).values - run.end_position.isel(end=0).values
    e = e / np.linalg.norm(e, axis=1, keepdims=True)
    difference = (back.position - run.position).values
    across = difference - np.einsum("tpc,tc,td->tpd", difference, e, e)
    assert np.abs(across).max() < 1e-12
    # along the chord the links are stretched differently, by T / K = 3e-3 of the length at most
    assert np.abs(difference).max() < 3e-3 * 10.0
    bare = cp.condensed.simulate(scene, picked, order="exact", step=1e-3, times=[0.5, 1.0], outputs=())
    assert not {"position", "velocity", "tension"} & set(bare.data_vars)
    np.testing.assert_array_equal(bare.amplitude, run.amplitude)
    xr.testing.assert_identical(scene, before[0])
    xr.testing.assert_identical(modes[3], before[1])
    assert all({"units", "long_name"} <= set(v.attrs) for v in run.variables.values())


# --- choice of the step, limiting cases -------------------------------------------------------------------------------


def test_a_stiff_cable_takes_implicit_steps(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    scene["cable_youngs_modulus"] = 1e13 / float(scene["cable_area"])
    times = np.arange(0.0, 32.0)
    chain = cp.chain.simulate(scene, times=times, links=16, scheme="trapezoidal", step=0.1)
    chain_modes = cp.pod.decompose(chain, layout="normal")
    options = {"rank": 3, "order": "exact", "times": times, "outputs": ("position",)}
    run = cp.condensed.simulate(scene, chain_modes, tolerance=1e-4, **options)
    assert run.attrs["scheme"] == "trapezoidal"
    # the fourth mode has 1e-5 of the first; the time error of the chain is the rest
    assert float(cp.compare.errors(run, chain).error_max) < 5e-4
    limit = run.attrs["step_limit"]
    with pytest.raises(cp.SceneError, match=r"^step: given .* allowed: below the stability limit"):
        cp.condensed.simulate(scene, chain_modes, step=2 * limit, scheme="velocity_verlet", **options)
    assert run.attrs["step"] > 5 * limit
    # the tension of a stiff cable needs more than one Newton correction in a step
    for order in ("leading", "exact"):
        longer = cp.condensed.simulate(scene, chain_modes, step=50 * limit, **(options | {"order": order}))
        assert longer.attrs["scheme"] == "trapezoidal"
        assert float(cp.compare.errors(longer, chain).error_max) < 1e-3


@pytest.mark.parametrize("order", ORDERS)
def test_a_vertical_chord_and_motion_only_out_of_plane(soft, order):
    # the cable hangs straight; only one set of deflections moves
    mapping = spatial({**soft, "cable": {**soft["cable"], "youngs_modulus": 2e8}, "motion": {}})
    mapping["ends"]["upper"] = [0.0, 10.0, 0.0]
    mapping["load"] = {"uniform": [0.0, 0.0, 2.0], "kind": "harmonic", "amplitude": 0.5, "angular_frequency": 1.0}
    scene = cp.make_scene(mapping)
    chain = cp.chain.simulate(scene, tolerance=1e-4, scheme="trapezoidal")
    chain_modes = cp.pod.decompose(chain, layout="normal")
    run = cp.condensed.simulate(scene, chain_modes, order=order)
    assert float(cp.compare.errors(run, chain).error_max) < 0.05


# --- required accuracy ------------------------------------------------------------------------------------------------

# Largest error over 125 s against the chain it was trained on (n = 40): (order, modes) -> Examples 2, 3, 4.
LIMITS = {
    ("leading", 2): (2.3e-4, 1.3e-2, 2e-3),
    ("leading", 8): (2e-4, 1.1e-3, 1.1e-3),
    ("exact", 2): (8e-5, 1.3e-2, 1e-3),
    ("exact", 4): (2e-5, 7e-3, 4e-4),
    ("exact", 8): (1e-5, 2.5e-3, 4e-4),
}


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 3, 4])
def test_errors_against_the_chain_it_was_trained_on(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    chain = cp.chain.simulate(scene, times=np.arange(1251) / 10, step=1.25e-4)
    chain_modes = cp.pod.decompose(chain, rank=8, layout="normal")
    for (order, rank), limits in LIMITS.items():
        run = cp.condensed.simulate(scene, chain_modes, rank=rank, order=order, times=chain.time.values, step=0.005)
        assert float(cp.compare.errors(run, chain).error_max) <= limits[number - 2], (order, rank)
