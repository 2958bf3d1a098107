"""The condensed model: against the same equations written otherwise, orders, identities, symmetries, what it refuses."""

from __future__ import annotations

import copy
import itertools
import math

import numpy as np
import pytest
import xarray as xr
from condensed_reference import LENGTHS, Reference, full_modes
from conftest import spatial
from scipy.integrate import solve_ivp

import cablepod as cp
from cablepod.condensed_model import ORDERS, model_of
from cablepod.condensed_output import OutOfRangeWarning
from cablepod.parameters import parameters

SCHEMES = ("velocity_verlet", "trapezoidal")
HARMONIC = {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 1.7, "phase": 0.4}
EVERYTHING = {
    "cable": {"youngs_modulus": 1e8, "area": 1.0e-3, "density": 1000.0, "top_tension": 300.0},
    "damping": {"mass_proportional": 0.8},
    "load": {"uniform": [3.0, -2.0], "kind": "harmonic", "amplitude": 0.3, "angular_frequency": 3.0},
    "point_load": [
        {"arc_length": 0.4, "force": [5.0, -20.0]},
        {"arc_length": 0.7, "force": [8.0, 0.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.0},
    ],
    "motion": {"lower": {"y": HARMONIC}, "upper": {"x": {**HARMONIC, "angular_frequency": 2.1}}},
}


def everything(soft, dims=2):
    mapping = {**soft, **copy.deepcopy(EVERYTHING)}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["ends"]["upper"][2] = 3.0
        mapping["load"]["uniform"][2] = 4.0
        mapping["point_load"][0]["force"][2] = -6.0
        mapping["motion"]["upper"]["z"] = {**HARMONIC, "amplitude": 0.05}
    return mapping


@pytest.fixture(scope="module")
def modes():
    return {dims: full_modes(dims=dims) for dims in (2, 3)}


def distances(runs):
    return [np.abs(a - b).max() for a, b in itertools.pairwise(runs)]


# --- against the equations written otherwise ------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "law"), [("leading", "linear"), ("exact", "linear"), ("exact", "green")])
@pytest.mark.parametrize("dims", [2, 3])
def test_all_modes_are_the_equations_link_by_link(soft, modes, dims, order, law):
    scene = cp.make_scene({**everything(soft, dims), "chain": {"links": len(LENGTHS)}})
    times = np.array([0.5, 1.0, 1.5])
    reference = Reference(scene, LENGTHS, leading=order == "leading", green=law == "green").positions(times)
    # a step of second order, extrapolated: what is left is of fourth order, (20 rad/s / 4000)^4 / 2000 < 1e-12 of the fastest
    # motion; DOP853 keeps 1e-12 of each component, over some 1e3 steps
    coarse, fine = (
        cp.condensed.simulate(scene, modes[dims], order=order, law=law, scheme=SCHEMES[0], times=times, step=h).position
        for h in (1 / 4000, 1 / 8000)
    )
    np.testing.assert_allclose(((4.0 * fine - coarse) / 3.0)[:, 1:-1], reference, rtol=0, atol=1e-9)


class Lagrangian(Reference):
    """The exact model with the kinetic energy of all that moves, chordwise too: M(w) = m + J^T m J, J = d zeta / d w."""

    def lever(self, w, push, c):
        zeta, _, jacobian = self.along(w[:, None], push, c)
        reach, across = np.diff(np.concatenate([[0.0], zeta, [c]])), np.diff(np.pad(w, 1))
        # what a link's slope does to its chordwise force, and so to the balance of the particles beside it
        give = self.p.stiffness * across * reach / (reach**2 + across**2) ** 1.5
        return np.linalg.solve(
            jacobian, np.diag(give[1:-1], 1) + np.diag(give[1:-1], -1) - np.diag(give[:-1] + give[1:])
        )

    def motion(self, times, w0):
        _, c, e, _ = self.frame(0.0)
        push, mass = self.forces(0.0) @ e, self.p.mass * self.share[1:-1]

        def rate(t, state):
            w, v = state.reshape(2, -1)
            force = mass * self.accelerate(t, w[:, None])[0][:, 0]
            lever = self.lever(w, push, c)
            turning = self.lever(w + 1e-20j * v, push, c).imag / 1e-20  # by complex step: no digits are lost
            force = force - lever.T @ (mass * (turning @ v))
            return np.concatenate([v, np.linalg.solve(np.diag(mass) + lever.T @ (mass[:, None] * lever), force)])

        start = np.concatenate([w0, np.zeros_like(w0)])
        return (
            solve_ivp(rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-9, atol=1e-11)
            .y[: w0.size]
            .T
        )


def test_chordwise_inertia_is_that_of_the_kinetic_energy_of_all_that_moves(soft, modes):
    soft = {**soft, "motion": {}, "initial": {"top_tension": 197.0}, "chain": {"links": len(LENGTHS)}}
    left = []
    for modulus in (2e8, 2e9):  # a strain of 1e-3, 1e-4
        scene = cp.make_scene({**soft, "cable": {**soft["cable"], "youngs_modulus": modulus}})
        times = np.array([0.0, 0.3, 0.6])
        run = {
            order: cp.condensed.simulate(scene, modes[2], order=order, times=times, step=1 / 8000).position.values
            for order in ORDERS[1:]
        }
        lagrangian = Lagrangian(scene, LENGTHS)
        normal = lagrangian.frame(0.0)[3][0]
        start = run["exact"][0, 1:-1] @ normal
        truth = lagrangian.motion(times, start)
        error = {order: np.abs(run[order][:, 1:-1] @ normal - truth).max() for order in run}
        # the model takes links to move as if they kept their length: what that leaves out is of the size of the strain
        assert error["inertial"] < 0.02 * error["exact"]
        left.append(error["inertial"])
    assert left[1] < 0.2 * left[0]


# --- steps ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_second_order_in_the_step(soft, modes, scheme, order, dims):
    scene = cp.make_scene(everything(soft, dims))
    runs = [
        cp.condensed.simulate(
            scene, modes[dims], rank=3, order=order, scheme=scheme, times=[0.5, 1.0, 2.0], step=1 / rate
        ).position.values
        for rate in (800, 1600, 3200, 6400)
    ]
    distance = distances(runs)
    np.testing.assert_allclose(np.log2(np.divide(distance[:-1], distance[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_between_two_steps_the_order_is_the_same(soft, modes, scheme):
    scene = cp.make_scene(everything(soft))
    times = np.array([0.123456, 0.7654321, 1.9])
    runs = [
        cp.condensed.simulate(scene, modes[2], rank=3, scheme=scheme, times=times, step=1 / rate).position.values
        for rate in (700, 1400, 2800, 5600)
    ]
    distance = distances(runs)
    # the error also depends on where in a step an instant falls
    np.testing.assert_allclose(np.log2(np.divide(distance[:-1], distance[1:])), 2.0, atol=0.15)


@pytest.mark.parametrize("order", ORDERS)
def test_explicit_and_implicit_steps_agree(soft, modes, order):
    scene = cp.make_scene(everything(soft))
    outputs = ("position", "velocity", "tension")
    a, b = (
        cp.condensed.simulate(scene, modes[2], order=order, scheme=scheme, step=1 / 8000, times=[1.0], outputs=outputs)
        for scheme in SCHEMES
    )
    # errors of (omega h)^2 / 12 and / 24 each: 1e-5 of what moves fastest, some mm
    np.testing.assert_allclose(a.position, b.position, atol=1e-7)
    np.testing.assert_allclose(a.velocity, b.velocity, atol=1e-5)
    np.testing.assert_allclose(a.tension, b.tension, rtol=1e-4)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("order", ["leading", "exact"])
def test_instants_change_no_bit(soft, modes, order, scheme):
    scene = cp.make_scene(everything(soft))
    options = {"order": order, "scheme": scheme, "step": 1 / 1000, "rank": 2}
    every = cp.condensed.simulate(scene, modes[2], times=np.arange(2001) / 1000, **options)
    few = cp.condensed.simulate(scene, modes[2], times=[0.5, 2.0], **options)
    np.testing.assert_array_equal(few.amplitude, every.amplitude[[500, 2000]])
    start = cp.condensed.simulate(scene, modes[2], times=[0.0], **options)
    np.testing.assert_array_equal(start.amplitude, every.amplitude[:1])


def test_blocks_change_no_bit(soft, modes, monkeypatch):
    scene = cp.make_scene(everything(soft))
    seen = []
    for order, scheme in itertools.product(ORDERS[::2], SCHEMES):
        options = {"order": order, "scheme": scheme, "step": 1 / 1000, "times": [1.0], "outputs": ("tension_extremes",)}
        whole = cp.condensed.simulate(scene, modes[2], **options)
        with monkeypatch.context() as patch:
            patch.setattr(cp.stepping, "BLOCK", 64)
            parts = cp.condensed.simulate(scene, modes[2], progress=seen.append, **options)
        # implicit steps guess anew at the begin of a block, and end within 1e-11; tables of sines begin anew
        np.testing.assert_allclose(parts.amplitude, whole.amplitude, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(parts.tension_maximum, whole.tension_maximum, rtol=1e-8)
    assert seen[-1] == 1.0
    assert len(seen) > 40


# --- identities -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "law"), [*((o, "linear") for o in ORDERS), ("exact", "green"), ("inertial", "green")]
)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_equilibrium_stays_at_rest(soft, modes, scheme, order, law):
    still = everything(soft) | {"motion": {}, "load": {"uniform": [3.0, -2.0]}}
    still["point_load"] = still["point_load"][:1]
    run = cp.condensed.simulate(
        cp.make_scene(still), modes[2], rank=3, order=order, law=law, scheme=scheme, step=1 / 500, times=np.arange(5.0)
    )
    sag = float(np.abs(run.amplitude[0]).max())
    assert sag > 0.1
    assert float(np.abs(run.amplitude - run.amplitude[0]).max()) < 1e-12 * sag


@pytest.mark.parametrize("order", ORDERS)
def test_a_mirrored_scene_gives_the_mirrored_motion(soft, modes, order):
    mapping = everything(soft)
    mirrored = copy.deepcopy(mapping)
    mirrored["ends"] = {"lower": [0.0, 0.0], "upper": [-8.0, 6.0]}
    mirrored["load"]["uniform"][0] *= -1
    for load in mirrored["point_load"]:
        load["force"][0] *= -1
    mirrored["motion"]["upper"]["x"] = {**mapping["motion"]["upper"]["x"], "amplitude": -0.03}
    a, b = (
        cp.condensed.simulate(cp.make_scene(m), modes[2], order=order, step=1 / 1000, times=[0.7, 2.0])
        for m in (mapping, mirrored)
    )
    np.testing.assert_allclose(b.position * [-1, 1], a.position, atol=1e-11)
    np.testing.assert_allclose(b.amplitude, -a.amplitude, atol=1e-11)


@pytest.mark.parametrize("order", ORDERS)
def test_in_a_plane_space_adds_nothing_and_a_turned_plane_only_turns(soft, modes, order):
    mapping = everything(soft)
    options = {"order": order, "step": 1 / 1000, "times": [0.7, 2.0], "outputs": ("position", "velocity", "tension")}
    flat = cp.condensed.simulate(cp.make_scene(mapping), modes[2], **options)
    both = modes[3].copy(deep=True)
    both["mode_shape"] = modes[2].mode_shape
    wide = cp.condensed.simulate(cp.make_scene(spatial(mapping)), both, **options)
    np.testing.assert_allclose(wide.position[..., :2], flat.position, atol=1e-12)
    np.testing.assert_allclose(wide.amplitude_out_of_plane, 0.0, atol=1e-13)
    turned = spatial(mapping)
    cosine, sine = 0.6, 0.8
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    turned["ends"]["upper"] = list(turn @ turned["ends"]["upper"])
    turned["load"]["uniform"] = list(turn @ turned["load"]["uniform"])
    for load in turned["point_load"]:
        load["force"] = list(turn @ load["force"])
    move = mapping["motion"]["upper"]["x"]
    turned["motion"]["upper"] = {
        axis: {**move, "amplitude": part * move["amplitude"]} for axis, part in (("x", cosine), ("z", sine))
    }
    other = cp.condensed.simulate(cp.make_scene(turned), both, **options)
    for name in ("position", "velocity"):
        np.testing.assert_allclose(other[name], wide[name].values @ turn.T, atol=1e-10)
    np.testing.assert_allclose(other.tension, wide.tension, rtol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_units_only_scale(soft, modes, order):
    mapping, length, mass, time = everything(soft), 3.0, 7.0, 0.6
    force = mass * length / time**2
    scaled = copy.deepcopy(mapping)
    scaled["gravity"] = 9.81 * length / time**2
    scaled["cable"] = {
        "youngs_modulus": 1e8 * force / length**2,
        "area": 1e-3 * length**2,
        "density": 1000.0 * mass / length**3,
        "top_tension": 300.0 * force,
    }
    scaled["ends"] = {end: list(np.array(place) * length) for end, place in mapping["ends"].items()}
    scaled["damping"] = {"mass_proportional": 0.8 / time}
    scaled["load"] |= {"uniform": [3.0 * force / length, -2.0 * force / length], "angular_frequency": 3.0 / time}
    for load in scaled["point_load"]:
        load["force"] = list(np.array(load["force"]) * force)
        if "kind" in load:
            load["angular_frequency"] /= time
    for end, axis in (("lower", "y"), ("upper", "x")):
        part = scaled["motion"][end][axis]
        scaled["motion"][end][axis] = {
            **part,
            "amplitude": part["amplitude"] * length,
            "angular_frequency": part["angular_frequency"] / time,
        }
    outputs = ("position", "velocity", "tension")
    times = np.array([0.5, 1.5])
    a = cp.condensed.simulate(cp.make_scene(mapping), modes[2], order=order, step=1e-3, times=times, outputs=outputs)
    b = cp.condensed.simulate(
        cp.make_scene(scaled), modes[2], order=order, step=1e-3 * time, times=times * time, outputs=outputs
    )
    np.testing.assert_allclose(b.position / length, a.position, atol=1e-10)
    np.testing.assert_allclose(b.velocity * time / length, a.velocity, atol=1e-9)
    np.testing.assert_allclose(b.tension / force, a.tension, rtol=1e-8)
    for name, factor in (
        ("smallest_chordwise_force", force),
        ("step_limit", time),
        ("first_axial_frequency", 1 / time),
    ):
        assert b.attrs[name] == pytest.approx(factor * a.attrs[name], rel=1e-9)
    assert b.attrs["forcing_over_axial_frequency"] == pytest.approx(a.attrs["forcing_over_axial_frequency"], rel=1e-12)


def test_to_leading_order_velocity_verlet_keeps_its_energy(soft, modes):
    soft = {**soft, "motion": {}, "initial": {"top_tension": 220.0}, "load": {"uniform": [3.0, -2.0]}}
    scene = cp.make_scene(soft)
    reference = Reference(scene, LENGTHS, leading=True)
    _, c, e, normals = reference.frame(0.0)
    force, total, k = reference.forces(0.0), reference.s[-1], reference.p.stiffness
    mass, length = reference.p.mass * reference.share[1:-1], reference.length
    tau = np.concatenate([[0.0], -np.cumsum(force @ e)])
    drift = []
    times = np.arange(0.0, 4.0, 0.1)
    for rate in (500, 1000):
        run = cp.condensed.simulate(scene, modes[2], step=1 / rate, times=times, outputs=("position", "velocity"))
        w, v = (run[name].values[:, 1:-1] @ normals[0] for name in ("position", "velocity"))
        half = 0.5 * (np.diff(np.pad(w, ((0, 0), (1, 1))), axis=1) / length) ** 2
        mean = c / total - 1.0 + half @ length / total - tau @ length / total / k
        energy = {
            "motion": 0.5 * v**2 @ mass,
            "stretching": 0.5 * k * total * mean**2,
            "chordwise loads": half @ (length * tau),
            "loads across": -w @ (force @ normals[0]),
        }
        whole = sum(energy.values())
        drift.append(np.ptp(whole) / np.ptp(energy["motion"]))
    assert drift[0] < 0.02
    # bounded, and of second order in the step
    assert drift[0] / drift[1] == pytest.approx(4.0, rel=0.1)


# --- outputs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("dims", [2, 3])
def test_extremes_are_taken_over_all_steps(soft, modes, dims, order, scheme):
    scene = cp.make_scene(everything(soft, dims))
    run = cp.condensed.simulate(
        scene,
        modes[dims],
        order=order,
        scheme=scheme,
        step=1 / 500,
        times=np.arange(501) / 500,
        outputs=("tension", "tension_extremes"),
    )
    # of a closure that starts elsewhere rounding is left, 1e-13 K = 1e-8 N
    np.testing.assert_allclose(run.tension_maximum, run.tension.max("time"), rtol=1e-9)
    np.testing.assert_allclose(run.tension_minimum, run.tension.min("time"), rtol=1e-9)
    few = cp.condensed.simulate(
        scene, modes[dims], order=order, scheme=scheme, step=1 / 500, times=[1.0], outputs=("tension_extremes",)
    )
    np.testing.assert_allclose(few.tension_maximum, run.tension_maximum, rtol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("dims", [2, 3])
def test_velocities_are_the_rates_of_the_positions(soft, modes, dims, order):
    mapping = everything(soft, dims)
    scene = cp.make_scene(mapping)
    h = 1 / 500
    run = cp.condensed.simulate(
        scene, modes[dims], rank=2, order=order, scheme="velocity_verlet", step=h, times=np.arange(1001) * h,
        outputs=("position", "velocity"),
    )  # fmt: skip
    numeric = (run.position.values[2:] - run.position.values[:-2]) / (2 * h)
    # central differences: rates change by (omega h)^2 / 6 = 1e-3 at 40 rad/s; along the chord the strain's part, 3e-3, is spread
    # evenly, and to leading order slopes of 0.2 are squared but not cubed
    inner = run.velocity.values[1:-1]
    scale = np.abs(inner).max()
    assert np.abs(numeric - inner).max() < (2e-2 if order == "leading" else 2e-3) * scale


def test_positions_and_tensions_are_those_of_the_chain(soft):
    mapping = {**soft, "cable": {**soft["cable"], "youngs_modulus": 2e8}}
    scene = cp.make_scene(mapping)
    times = np.arange(0.0, 4.01, 0.1)
    chain = cp.chain.simulate(scene, times=times, outputs=("position", "tension"), tolerance=1e-4)
    found = cp.pod.decompose(chain, layout="normal")
    swing = float(chain.tension.max() - chain.tension.min())
    last = np.inf
    # slopes of 0.2 cubed; no inertia along the chord; no turning of the chord
    for order, limit, most in (("leading", 0.05, 0.5), ("exact", 1e-2, 0.1), ("inertial", 1e-3, 0.02)):
        run = cp.condensed.simulate(
            scene, found, order=order, times=times, outputs=("position", "tension", "tension_extremes")
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
    chain = cp.chain.simulate(scene, times=times, tolerance=1e-4)
    run = cp.condensed.simulate(scene, cp.pod.decompose(chain, layout="normal"), order="inertial", times=times)
    shift = 0.1 * times[:, None] ** 2
    lag = np.abs(chain.position[..., 0] - shift - chain.position[0, :, 0]).max()
    # strain and slopes along the chord leave 1e-3 of it
    assert float(np.abs(run.position - chain.position).max()) < 5e-3 * float(lag)


def test_amplitudes_reconstruct_the_deflection_and_inputs_stay(soft, modes):
    scene = cp.make_scene(everything(soft, 3))
    before = scene.copy(deep=True), modes[3].copy(deep=True)
    run = cp.condensed.simulate(scene, modes[3], rank=2, order="exact", step=1e-3, times=[0.5, 1.0])
    back = cp.pod.reconstruct(run, modes[3])
    e = run.end_position.isel(end=1).values - run.end_position.isel(end=0).values
    e = e / np.linalg.norm(e, axis=1, keepdims=True)
    difference = (back.position - run.position).values
    across = difference - np.einsum("tpc,tc,td->tpd", difference, e, e)
    assert np.abs(across).max() < 1e-12
    # along the chord the links are not quite stretched alike: T / K = 3e-3 of the length at most
    assert np.abs(difference).max() < 3e-3 * 10.0
    bare = cp.condensed.simulate(scene, modes[3], rank=2, order="exact", step=1e-3, times=[0.5, 1.0], outputs=())
    assert not {"position", "velocity", "tension"} & set(bare.data_vars)
    np.testing.assert_array_equal(bare.amplitude, run.amplitude)
    xr.testing.assert_identical(scene, before[0])
    xr.testing.assert_identical(modes[3], before[1])
    assert all({"units", "long_name"} <= set(v.attrs) for v in run.variables.values())


def test_members_are_single_runs(soft, modes):
    scenes = [cp.make_scene({**soft, "cable": {**soft["cable"], "top_tension": t}}) for t in (200.0, 230.0)]
    joined = cp.condensed.simulate(xr.concat(scenes, "member", data_vars="all"), modes[2], rank=2, step=2e-3)
    for i, scene in enumerate(scenes):
        single = cp.condensed.simulate(scene, modes[2], rank=2, step=2e-3)
        np.testing.assert_array_equal(joined.position.isel(member=i), single.position)
    np.testing.assert_array_equal(joined.cable_top_tension, [200.0, 230.0])


# --- steps that choose themselves, and scenes at the edge -----------------------------------------------------------------


def test_the_default_step_keeps_its_tolerance(soft, modes):
    scene = cp.make_scene(soft)
    run = cp.condensed.simulate(scene, modes[2], rank=3, tolerance=1e-5)
    exact = cp.condensed.simulate(scene, modes[2], rank=3, step=run.attrs["step"] / 8)
    assert run.attrs["scheme"] == "velocity_verlet"
    assert float(cp.compare.errors(run, exact).error_max) < 1e-5


def test_a_stiff_cable_takes_implicit_steps(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    scene["cable_youngs_modulus"] = 1e13 / float(scene["cable_area"])
    times = np.arange(0.0, 32.0)
    chain = cp.chain.simulate(scene, times=times, links=16, scheme="trapezoidal", step=0.1)
    found = cp.pod.decompose(chain, layout="normal")
    run = cp.condensed.simulate(scene, found, rank=3, order="exact", times=times, tolerance=1e-4)
    assert run.attrs["scheme"] == "trapezoidal"
    # an explicit step could not be longer than some ms
    assert run.attrs["step"] > 5 * run.attrs["step_limit"]
    assert float(cp.compare.errors(run, chain).error_max) < 2e-3


@pytest.mark.parametrize("order", ORDERS)
def test_a_vertical_chord_and_motion_only_out_of_plane(soft, order):
    # the cable hangs straight; only one set of deflections ever moves
    mapping = spatial({**soft, "cable": {**soft["cable"], "youngs_modulus": 2e8}, "motion": {}})
    mapping["ends"]["upper"] = [0.0, 10.0, 0.0]
    mapping["load"] = {"uniform": [0.0, 0.0, 2.0], "kind": "harmonic", "amplitude": 0.5, "angular_frequency": 1.0}
    scene = cp.make_scene(mapping)
    chain = cp.chain.simulate(scene, tolerance=1e-4)
    found = cp.pod.decompose(chain, layout="normal")
    run = cp.condensed.simulate(scene, found, order=order)
    assert float(cp.compare.errors(run, chain).error_max) < 0.05


def test_a_chord_that_turns_into_the_axis_that_tells_the_normals(soft, modes):
    to_axis = {"x": {"kind": "ramp", "amplitude": -8.0, "duration": 2.0}}
    scene = cp.make_scene(spatial({**soft, "motion": {"upper": to_axis}}))
    with pytest.raises(cp.SceneError, match="motion: the chord turns into the axis y; allowed: one that stays away"):
        cp.condensed.simulate(scene, modes[3], rank=2, step=1e-3)


# --- what it refuses, and when it warns ------------------------------------------------------------------------------


def test_options_that_cannot_be(soft, modes):
    scene, m = cp.make_scene(soft), modes[2]
    free = cp.make_scene({**soft, "motion": {}, "ends": {**soft["ends"], "free": "upper"}})
    viscous = cp.make_scene({**soft, "damping": {"link_viscosity": 1.0}})
    limit = cp.condensed.simulate(scene, m, step=1e-3, times=[0.0]).attrs["step_limit"]
    dependent = m.copy(deep=True)
    dependent["mode_shape"][1] = 2.0 * m.mode_shape[0].values
    cases = [
        (scene, m, {"rank": 5}, "^rank: given 5; allowed: at most 4, as many modes as there are$"),
        (scene, m, {"rank": 0}, "^rank: given 0; allowed: a whole number of at least 1$"),
        (scene, m, {"rank": 1.5}, "^rank: given 1.5; allowed: a whole number of at least 1$"),
        (scene, m, {"order": "second"}, '^order: given \'second\'; allowed: one of "leading", "exact", "inertial"$'),
        (scene, m, {"law": "green"}, '^law: given \'green\'; allowed: "linear" with order "leading"'),
        (scene, m, {"law": "hooke"}, '^law: given \'hooke\'; allowed: one of "linear", "green"$'),
        (scene, m, {"scheme": "rk4"}, '^scheme: given \'rk4\'; allowed: one of "velocity_verlet", "trapezoidal"$'),
        (scene, m, {"outputs": ("energy",)}, "^outputs: given 'energy'; allowed: some of "),
        (scene, m, {"step": 0.1, "tolerance": 0.1}, r"^step and tolerance: given \(0.1, 0.1\); allowed: one of them"),
        (scene, m, {"tolerance": 0.0}, "^tolerance: given 0.0; allowed: a finite number above 0$"),
        (scene, m, {"times": [1.0, 0.5]}, "^times: given "),
        (scene, m, {"scheme": "trapezoidal", "step": -1.0}, "^step: given -1.0; allowed: a finite number above 0"),
        (
            scene, m, {"scheme": "velocity_verlet", "step": 1.001 * limit},
            f"^step: given {1.001 * limit:.6g} s; allowed: below the stability limit, {limit:.6g} s, 2 over the highest",
        ),
        (free, m, {}, "^ends.free: given 'upper'; allowed: two held ends"),
        (viscous, m, {}, "^damping.link_viscosity: given 1.0; allowed: none for a reduced model"),
        (cp.make_scene(spatial(soft)), m, {}, "^modes: given 2 coordinates; allowed: the 3 coordinates of the scene$"),
        (scene, modes[3], {}, "^modes: given 3 coordinates; allowed: the 2 coordinates of the scene$"),
        (scene, dependent, {}, "^modes: given some that are sums of others; allowed: independent ones"),
        (scene, scene, {}, "^modes: given layout None; allowed: modes of the deflection normal to the chord"),
    ]  # fmt: skip
    for some, some_modes, options, match in cases:
        with pytest.raises(cp.SceneError, match=match):
            cp.condensed.simulate(some, some_modes, **options)
    for layout in ("separate", "vector"):
        other = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), layout=layout)
        with pytest.raises(
            cp.SceneError, match=f"^modes: given layout '{layout}'; allowed: modes of the deflection normal"
        ):
            cp.condensed.simulate(scene, other)
        with pytest.raises(cp.SceneError, match="layout 'normal'"):
            cp.galerkin.simulate(scene, m)


def test_a_slack_cable_and_fast_ends_are_warned_of(soft, modes):
    lifted = cp.make_scene(
        {**soft, "load": {"uniform": [0.0, 30.0], "kind": "ramp", "amplitude": 1.0, "duration": 1.0}}
    )
    for order in ORDERS[:2]:
        with pytest.warns(OutOfRangeWarning, match=r"the chordwise force falls to -.* N at .* s, below zero") as found:
            run = cp.condensed.simulate(lifted, modes[2], rank=2, order=order, step=1e-3, times=np.arange(1001) / 1000)
        assert len(found) == 1
        assert run.attrs["smallest_chordwise_force"] < 0.0
    place = round(run.attrs["time_of_smallest_force"] * 1000)
    # the least chordwise force is that of the instant it is said to be of
    model = model_of(parameters(lifted), modes[2], rank=2, order="exact", law="linear")
    from cablepod import condensed_output

    q = (run.amplitude.values @ np.linalg.inv(model.turned[0][0]).T)[[place]]
    force = condensed_output._closed(model, q, np.array([place / 1000]))[1]
    assert force.min() == pytest.approx(run.attrs["smallest_chordwise_force"], rel=1e-6)
    fast = {"upper": {"x": {"kind": "harmonic", "amplitude": 1e-4, "angular_frequency": 20.0, "phase": 0.0}}}
    with pytest.warns(OutOfRangeWarning, match=r"with 0.45 times the first axial frequency, 44.4 rad/s \(above 0.2\)"):
        run = cp.condensed.simulate(cp.make_scene({**soft, "motion": fast}), modes[2], rank=2, step=1e-3, times=[0.1])
    axial = math.pi / float(run.unstretched_length) * math.sqrt(2e4)
    assert run.attrs["first_axial_frequency"] == pytest.approx(axial, rel=1e-12)
    assert run.attrs["forcing_over_axial_frequency"] == pytest.approx(20.0 / axial, rel=1e-12)


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_a_cable_that_stiffens_stops_with_what_was_done(soft, modes, order):
    pull = {"upper": {"x": {"kind": "ramp", "amplitude": 0.5, "duration": 4.0}}}
    scene = cp.make_scene({**soft, "motion": pull})
    times = np.arange(401) / 100
    limit = cp.condensed.simulate(scene, modes[2], order=order, step=1e-3, times=[0.0]).attrs["step_limit"]
    with pytest.raises(
        cp.RunStopped, match=r"stiffened: from .* s on its stability limit is below the step"
    ) as stopped:
        cp.condensed.simulate(scene, modes[2], order=order, scheme="velocity_verlet", step=0.9 * limit, times=times)
    partial = stopped.value.partial
    assert 10 < partial.sizes["time"] < 400
    assert float(partial.attrs["incomplete"].split()[2]) >= float(partial.time[-1])
    short = cp.condensed.simulate(
        scene, modes[2], order=order, scheme="velocity_verlet", step=0.9 * limit, times=partial.time.values[:-20]
    )
    np.testing.assert_array_equal(short.amplitude, partial.amplitude[:-20])


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_a_run_that_breaks_down_stops_with_what_was_done(soft, modes, order):
    # the ends meet at 2 s: there is no chord any more, and no number
    home = {axis: {"kind": "ramp", "amplitude": -size, "duration": 2.0} for axis, size in (("x", 8.0), ("y", 6.0))}
    scene = cp.make_scene({**soft, "motion": {"upper": home}})
    with pytest.raises(cp.RunStopped, match="left the finite numbers or found no equilibrium") as stopped:
        cp.condensed.simulate(
            scene, modes[2], order=order, scheme="trapezoidal", step=0.02, times=np.arange(101) * 0.02
        )
    partial = stopped.value.partial
    assert 5 < partial.sizes["time"] <= 100
    assert np.isfinite(partial.position).all()
    assert f"of {2.0:g} s" in partial.attrs["incomplete"]


# --- what must come out ---------------------------------------------------------------------------------------------

# Largest error over 125 s against the chain it was trained on (n = 40): (order, modes) -> Examples 2, 3, 4.
LIMITS = {
    ("leading", 2): (6e-4, 1.3e-2, 4e-3),
    ("exact", 2): (8e-5, 1.3e-2, 1e-3),
    ("exact", 4): (2e-5, 7e-3, 4e-4),
    ("exact", 8): (1e-5, 2.5e-3, 4e-4),
}


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 3, 4])
def test_errors_against_the_chain_it_was_trained_on(scenes, number):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    chain = cp.chain.simulate(scene, times=np.arange(1251) / 10, step=1.25e-4)
    found = cp.pod.decompose(chain, rank=8, layout="normal")
    for (order, rank), limits in LIMITS.items():
        run = cp.condensed.simulate(scene, found, rank=rank, order=order, times=chain.time.values, step=0.005)
        assert float(cp.compare.errors(run, chain).error_max) <= limits[number - 2], (order, rank)
