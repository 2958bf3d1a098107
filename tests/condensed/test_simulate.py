"""The condensed model: independent ODE solution, convergence order, identities, symmetries."""

from __future__ import annotations

import math

import numpy as np
import pytest
from convergence import distances, orders
from references.condensed_ode import Reference
from scenes import LENGTHS, ORDERS, PAIRS, circling, everything, full_modes
from suite import slow

import cablepod as cp
from cablepod import examples as shipped


@pytest.fixture(scope="module")
def modes():
    return {dims: full_modes(dims=dims) for dims in (2, 3)}


# --- independent ODE solution -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dims", "order", "law"),
    [(d, order, "linear") for d in (2, 3) for order in ORDERS] + [(3, "exact", "green"), (2, "inertial", "green")],
)
def test_all_modes_solve_the_equations_of_the_links(soft, modes, dims, order, law):
    scene = cp.make_scene({**everything(soft, dims), "chain": {"links": len(LENGTHS)}})
    times = np.array([0.4, 0.8])
    reference = Reference(scene, LENGTHS, order=order, law=law).positions(times)
    options = {"order": order, "law": law, "scheme": "velocity_verlet", "times": times}
    # Richardson extrapolation of a second-order scheme: the error is of fourth order, (20 rad/s / 4000)^4 / 2000 < 1e-12 of the
    # fastest motion; DOP853 has a tolerance of 1e-11 a step, over about 1e3 steps
    coarse, fine = (
        cp.condensed.simulate(scene, modes[dims], **options, step=step).position for step in (1 / 4000, 1 / 8000)
    )
    np.testing.assert_allclose(((4.0 * fine - coarse) / 3.0)[:, 1:-1], reference, rtol=0, atol=1e-8)


class Lagrangian(Reference):
    """Equations of motion with the kinetic energy of the true chordwise motion."""

    def true_lever(self, w, push, c):
        zeta, _, jacobian = self.along(w, push, c)
        reach, across = np.diff(np.concatenate([[0.0], zeta, [c]])), np.diff(np.pad(w[:, 0], 1))
        # derivative of a link's chordwise force by its slope, in the balance of the particles beside it
        give = self.p.stiffness * across * reach / (reach**2 + across**2) ** 1.5
        return np.linalg.solve(
            jacobian, np.diag(give[1:-1], 1) + np.diag(give[1:-1], -1) - np.diag(give[:-1] + give[1:])
        )

    def lever(self, w, v, push, c):
        return self.true_lever(w, push, c), self.true_lever(w + 1e-20j * v, push, c).imag / 1e-20


def test_chordwise_inertia_is_that_of_the_kinetic_energy(soft, modes):
    ratio = []
    for times_tension in (1.0, 2.0):
        # slopes are inverse to the tension; with K proportional to its cube, Irvine's parameter and the scaled motion are equal
        tension, times = 200.0 * times_tension, np.array([0.5, 1.0]) / math.sqrt(times_tension)
        soft |= {"motion": {}, "initial": {"top_tension": 0.95 * tension}, "chain": {"links": len(LENGTHS)}}
        soft["cable"] |= {"top_tension": tension, "youngs_modulus": 2e7 * times_tension**3}
        scene = cp.make_scene(soft)
        run = {
            order: cp.condensed.simulate(scene, modes[2], order=order, times=[0.0, *times], step=1 / 16000).position
            for order in ORDERS[1:]
        }
        lagrangian = Lagrangian(scene, LENGTHS, order="inertial")
        start = run["exact"].values[0, 1:-1] @ lagrangian.frame(0.0)[3].T
        truth = lagrangian.positions(times, start, rtol=1e-8)
        error = {order: float(np.abs(run[order][1:, 1:-1] - truth).max()) for order in run}
        ratio.append(error["inertial"] / error["exact"])
    # chordwise inertia is proportional to the squared slopes (0.3, 0.15); the part that the model neglects, the non-uniform
    # change of link lengths, to their fourth power
    assert ratio[0] < 0.3**2
    assert ratio[0] / ratio[1] == pytest.approx(4.0, rel=0.15)


# --- steps ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "scheme"), PAIRS)
def test_the_scheme_has_its_order_in_space_and_between_steps(soft, modes, scheme, order):
    scene, expected = cp.make_scene(everything(soft, 3)), 4.0 if scheme == "numerov" else 2.0
    assert float(scene.damping_mass_proportional) > 0.0
    on_steps, between = [0.5, 1.0, 2.0], [0.123456, 0.7654321, 1.9]
    options = {"rank": 3, "order": order, "scheme": scheme, "times": sorted(on_steps + between)}
    runs = [
        cp.condensed.simulate(scene, modes[3], step=1 / rate, outputs=("position",), **options).position
        for rate in ((100, 200, 400, 800) if scheme == "numerov" else (800, 1600, 3200, 6400))
    ]
    # between the steps the error also depends on the position of an instant within a step
    for times, allowed in ((on_steps, 0.05), (between, 0.075)):
        found = orders(distances([run.sel(time=times).values for run in runs]))
        np.testing.assert_allclose(found, expected, rtol=allowed)


@pytest.mark.filterwarnings("ignore:.*the model expects an error:cablepod.OutOfRangeWarning")  # modes of another cable
@pytest.mark.parametrize(("damping", "scheme"), [(0.5, "numerov"), (130.0, "velocity_verlet")])
def test_default_scheme_at_heavy_damping(soft, modes, damping, scheme):
    """Numerov's step would have to resolve a damping above twice the highest frequency, which is 60 rad/s or less here."""
    soft["damping"] = {"mass_proportional": damping}
    scene = cp.make_scene(soft)
    times = np.array([0.5, 1.0, 2.0])
    run = cp.condensed.simulate(scene, modes[2], rank=2, times=times)
    assert run.attrs["scheme"] == scheme
    assert run.attrs["step_limit"] > 2.0 / 60.0
    fine = cp.condensed.simulate(scene, modes[2], rank=2, times=times, scheme="trapezoidal", step=1 / 8000)
    # the default time error is at most a tenth of the estimate, or 1e-6
    assert float(cp.compare.errors(run, fine).error_max) <= max(0.2 * run.attrs["error_estimate"], 2e-6)


@pytest.mark.parametrize("damping", [0.5, 20.0])
def test_default_step_at_heavy_damping_by_the_tension(soft, modes, damping):
    """The limit of explicit steps is far below that of the frequencies: 1 / (damping omega^2), omega of 11 rad/s."""
    soft["damping"] = {"tension_proportional": damping}
    scene, options = cp.make_scene(soft), {"rank": 2, "times": [0.25, 0.5], "outputs": ("position",)}
    run = cp.condensed.simulate(scene, modes[2], tolerance=1e-4, **options)
    fine = cp.condensed.simulate(scene, modes[2], step=run.attrs["step"] / 8.0, **options)
    assert float(cp.compare.errors(run, fine).error_max) < 2e-4  # twice the tolerance
    limit, at_start = run.attrs["step_limit"], {**options, "times": [0.0]}
    cp.condensed.simulate(scene, modes[2], step=0.99 * limit, **at_start)
    with pytest.raises(cp.SceneError, match="step"):
        cp.condensed.simulate(scene, modes[2], step=1.01 * limit, **at_start)


@pytest.mark.parametrize("scheme", ["numerov", "velocity_verlet"])
def test_a_window_that_begins_at_the_first_step_leaves_the_motion_as_it_is(soft, modes, scheme):
    """Blocks of steps end where the window begins, and the first step of Numerov's method needs the loads of three instants."""
    motion = {"upper": {"x": {"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 5.0}}}
    scene = cp.make_scene({**soft, "motion": motion})
    options = {"rank": 2, "scheme": scheme, "step": 0.01, "times": [0.01, 0.5], "outputs": ("tension_extremes",)}
    whole, within = (cp.condensed.simulate(scene, modes[2], window=part, **options) for part in (None, (0.01, 0.5)))
    np.testing.assert_array_equal(within.amplitude, whole.amplitude)


@pytest.mark.parametrize("order", ORDERS)
def test_explicit_and_implicit_steps_agree(soft, modes, order):
    scene = cp.make_scene(everything(soft))
    outputs = ("position", "velocity", "tension")
    a, b = (
        cp.condensed.simulate(scene, modes[2], order=order, scheme=scheme, step=1 / 8000, times=[1.0], outputs=outputs)
        for scheme in ("velocity_verlet", "trapezoidal")
    )
    # errors of (omega h)^2 / 12 and / 24: 1e-5 of the fastest motion, some mm
    np.testing.assert_allclose(a.position, b.position, atol=1e-7)
    np.testing.assert_allclose(a.velocity, b.velocity, atol=1e-5)
    np.testing.assert_allclose(a.tension, b.tension, rtol=1e-4)


@pytest.mark.filterwarnings("ignore:.*the model expects an error:cablepod.OutOfRangeWarning")
@pytest.mark.parametrize(
    ("motion", "scheme"),
    [
        ({}, "velocity_verlet"),
        # where the third derivative of a motion jumps the error of the scheme of fourth order is of second order
        ({"kind": "ramp", "amplitude": 0.1, "duration": 0.73}, "numerov"),
        ({"kind": "harmonic", "amplitude": 0.05, "angular_frequency": 5.0, "ramp": 1.0}, "numerov"),
    ],
)
def test_the_chosen_step_meets_the_tolerance(soft, modes, motion, scheme):
    scene = cp.make_scene({**soft, "motion": {"upper": {"x": motion}}} if motion else soft)
    options = {"rank": 3, "outputs": ("position",)}
    run = cp.condensed.simulate(scene, modes[2], tolerance=1e-5, scheme=scheme if motion else None, **options)
    assert run.attrs["scheme"] == scheme  # with a tolerance, the choice where none is given
    exact = cp.condensed.simulate(scene, modes[2], step=run.attrs["step"] / 16, scheme=scheme, **options)
    assert float(cp.compare.errors(run, exact).error_max) < 1e-5


@pytest.mark.parametrize("order", ["exact", "inertial"])
@pytest.mark.parametrize("ratio", [1.03, 1.06])
def test_a_sagging_cable_starts_at_the_equilibrium_of_the_chain(order, ratio):
    scene = shipped.scene("example3").drop_vars("cable_top_tension")
    chord = float(np.linalg.norm(scene.ends_upper - scene.ends_lower))
    scene = scene.assign(cable_unstretched_length=((), ratio * chord, {"units": "m"}))
    chain = cp.chain.simulate(scene, times=np.arange(0.0, 3.01, 0.25), step=2e-4)
    chain_modes = cp.pod.decompose(chain, layout="normal", rank=8)
    run = cp.condensed.simulate(scene, chain_modes, order=order, times=[0.0], step=1e-3, outputs=("position",))
    off = np.abs(run.position.values[0] - chain.position.values[0]).max()
    # eight modes represent the shape, some metres of sag, to about 1e-6
    assert off < 1e-4


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal", "numerov"])
def test_the_start_alone_needs_no_step(scheme, soft, modes):
    scene = cp.make_scene(soft)
    start, stepped = (
        cp.condensed.simulate(scene, modes[2], scheme=scheme, times=[0.0], **o) for o in ({}, {"step": 1e-4})
    )
    assert np.array_equal(start.position, stepped.position)


# --- identities -----------------------------------------------------------------------------------------------------


# the last is compiled for seconds for this test alone; its order, law and steps are each in the others
@pytest.mark.parametrize(("order", "scheme"), [*PAIRS[3:-1], slow(*PAIRS[-1])])
def test_equilibrium_by_the_other_law_stays_at_rest(soft, modes, scheme, order):
    still = everything(soft) | {"motion": {}, "load": {"uniform": [3.0, -2.0]}}
    still["point_load"] = still["point_load"][:1]
    options = {"rank": 3, "order": order, "scheme": scheme, "step": 1 / 500, "times": np.arange(5.0)}
    run = cp.condensed.simulate(cp.make_scene(still), modes[2], law="green", **options)
    sag = float(np.abs(run.amplitude[0]).max())
    assert sag > 0.1
    assert float(np.abs(run.amplitude - run.amplitude[0]).max()) < 1e-12 * sag


def test_a_chord_that_passes_the_vertical_in_space_moves_as_in_the_plane(soft, modes):
    taut = {**soft, "cable": {**soft["cable"], "top_tension": 600.0}, "time": {"duration": 20.0, "interval": 0.5}}
    space = circling(taut, 1.3)  # from 37 to 111 degrees
    both = modes[3].copy(deep=True)
    both["mode_shape"] = modes[2].mode_shape
    wide = cp.condensed.simulate(cp.make_scene(space), both, step=2e-3)
    flat = cp.condensed.simulate(cp.make_scene({**taut, "motion": space["motion"]}), modes[2], step=2e-3)
    assert float(flat.position[-1, -1, 0]) < -3.0
    np.testing.assert_allclose(wide.position[..., :2], flat.position, atol=1e-11)
    np.testing.assert_allclose(wide.position[..., 2], 0.0, atol=1e-13)


@pytest.mark.parametrize("order", ORDERS[:2])
def test_velocity_verlet_conserves_energy(soft, modes, order):
    soft = {**soft, "motion": {}, "initial": {"top_tension": 220.0}, "load": {"uniform": [3.0, -2.0]}}
    scene = cp.make_scene(soft)
    reference = Reference(scene, LENGTHS, order=order)
    _, c, e, normals = reference.frame(0.0)
    force, total, k = reference.forces(0.0), reference.s[-1], reference.p.stiffness
    mass, length = reference.p.mass * reference.share[1:-1], reference.length
    tau = np.concatenate([[0.0], -np.cumsum(force @ e)])
    drift = []
    times = np.arange(0.0, 4.0, 0.1)
    for rate in (500, 1000):
        run = cp.condensed.simulate(
            scene, modes[2], order=order, step=1 / rate, times=times, outputs=("position", "velocity")
        )
        w, v = (run[name].values[:, 1:-1] @ normals[0] for name in ("position", "velocity"))
        motion = 0.5 * v**2 @ mass
        if order == "leading":
            motion = 0.5 * ((v @ reference.masses[0]) * v).sum(axis=1)
            half = 0.5 * reference.factor * (np.diff(np.pad(w, ((0, 0), (1, 1))), axis=1) / length) ** 2
            mean = c / total - 1.0 + half @ length / total - tau @ length / total / k
            potential = 0.5 * k * total * mean**2 + half @ (length * tau) - w @ (force @ normals[0])
        else:
            stretch = np.linalg.norm(np.diff(run.position.values, axis=1), axis=2) / length - 1.0
            potential = 0.5 * k * stretch**2 @ length - (run.position.values[:, 1:-1] * force).sum(axis=(1, 2))
        drift.append(np.ptp(motion + potential) / np.ptp(motion))
    assert drift[0] < 0.02
    # bounded, and of second order in the step
    assert drift[0] / drift[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("dims", [2, 3])
def test_a_default_call_whose_second_run_stops_has_an_estimate(soft, dims):
    """The end moves by a third of the chord, towards the other one: runs with long steps stop, and do not count."""
    if dims == 3:
        soft |= {"ends": {"lower": [0.0] * 3, "upper": [7.0, 6.0, 3.0]}, "load": {"uniform": [1.0, -2.0, 3.0]}}
        soft["motion"]["upper"]["z"] = {"kind": "harmonic", "amplitude": 0.04, "angular_frequency": 2.0, "phase": 1.0}
    modes = cp.pod.decompose(cp.chain.simulate(cp.make_scene(soft), tolerance=1e-3), rank=3, layout="normal")
    soft["motion"]["upper"]["x"]["amplitude"] = -3.0
    run = cp.condensed.simulate(cp.make_scene(soft), modes)
    assert 0.5 < run.attrs["error_estimate"] < np.inf  # no cable moves so
    assert np.isfinite(run["position"]).all()
