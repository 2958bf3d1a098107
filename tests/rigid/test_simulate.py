"""Chain of rigid links: known solutions, orders, identities, energies and lengths."""

from __future__ import annotations

import numpy as np
import pytest
from convergence import distances, orders
from scenes import RIGID_CABLE, link_length_errors, pendulum, rigid_scene
from scenes import TERMS as SHARED
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk
from suite import slow

import cablepod as cp

FORMULATIONS = ("rattle", "index1")
TERMS = {
    **SHARED,
    "free end": {
        "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0], "free": "upper"},
        "motion": {"lower": {"x": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 2.0}}},
        "damping": {"mass_proportional": 0.5},
    },
    "line": {
        "cable": {**RIGID_CABLE, "unstretched_length": 13.93},
        "initial": {"points": [[0.0, 0.0], [5.0, -2.0], [8.0, 6.0]]},
    },
    "unequal links": {"chain": {"link_lengths": [1.0, 0.2, 2.0, 1.0, 0.5, 3.0, 1.0]}},
}
ALL = ("position", "velocity", "tension", "tension_extremes")

# --- pendulums --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_single_link_is_a_pendulum(formulation):
    # let go at a right angle: sin(theta/2) = k sn(K - omega t), k = sin(45 deg); T = m (g cos + l omega^2) = 3 m g cos theta
    length, times = 2.0, np.linspace(0.0, 10.0, 41)
    run = cp.rigid.simulate(
        pendulum(length, [length, 0.0]), links=1, times=times, formulation=formulation, tolerance=1e-6, outputs=ALL[:3]
    )
    k2 = 0.5
    theta = 2 * np.arcsin(np.sqrt(k2) * ellipj(ellipk(k2) - np.sqrt(9.81 / length) * times, k2)[0])
    exact = length * np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    # the tolerance, 1e-6 of the motion
    assert np.abs(run.position[:, 1] - exact).max() < 2e-6 * length
    # the free end has half a link's mass
    np.testing.assert_allclose(run.tension[:, 0], 3 * 9.81 * (1.0 * length / 2) * np.cos(theta), atol=1e-4)
    speed = np.linalg.norm(run.velocity[:, 1], axis=-1)
    np.testing.assert_allclose(speed, np.sqrt(2 * 9.81 * length * np.cos(theta).clip(0)), atol=1e-4)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_two_links_are_the_double_pendulum_of_lagrange(formulation):
    shares, total, times = np.array([0.6, 0.4]), 2.0, np.linspace(0.0, 3.0, 13)
    l1, l2 = shares * total
    m1, m2, g = 1.0 * total / 2, 1.0 * l2 / 2, 9.81  # half of each link beside it
    angles = np.radians([100.0, -60.0])
    points = np.cumsum(np.stack([np.sin(angles), -np.cos(angles)], axis=1) * [[l1], [l2]], axis=0)

    def rates(t, state):
        a, b, da, db = state
        c, s = np.cos(a - b), np.sin(a - b)
        matrix = [[(m1 + m2) * l1, m2 * l2 * c], [l1 * c, l2]]
        right = [-m2 * l2 * db**2 * s - (m1 + m2) * g * np.sin(a), l1 * da**2 * s - g * np.sin(b)]
        return [da, db, *np.linalg.solve(matrix, right)]

    exact = solve_ivp(rates, (0, 3), [*angles, 0, 0], method="DOP853", rtol=1e-12, atol=1e-12, t_eval=times).y
    scene = pendulum(
        total,
        points[1].tolist(),
        chain={"link_lengths": shares.tolist()},
        initial={"points": [[0.0, 0.0], *points.tolist()]},
    )
    run = cp.rigid.simulate(scene, times=times, formulation=formulation, tolerance=1e-6, outputs=("position",))
    first = l1 * np.stack([np.sin(exact[0]), -np.cos(exact[0])], axis=-1)
    second = first + l2 * np.stack([np.sin(exact[1]), -np.cos(exact[1])], axis=-1)
    # the tolerance, 1e-6 of the motion of 2 m
    np.testing.assert_allclose(run.position[:, 1], first, rtol=0, atol=4e-6)
    np.testing.assert_allclose(run.position[:, 2], second, rtol=0, atol=4e-6)


def test_links_push_as_well_as_pull():
    # a link let go at 60 degrees above the horizontal: at first T = - m g cos of the angle to the upright
    point = [1.0, np.sqrt(3.0)]
    run = cp.rigid.simulate(pendulum(2.0, point), links=1, times=[0.0, 2.0], outputs=("tension", "tension_extremes"))
    np.testing.assert_allclose(run.tension[0, 0], -9.81 * np.sqrt(3) / 2, rtol=1e-9)
    assert run.attrs["links_in_compression"] == 1
    assert run.attrs["first_compression"] == 0.0
    assert run.attrs["smallest_tension"] == pytest.approx(-9.81 * np.sqrt(3) / 2, rel=1e-9)
    # and the link swings through the lowest point within these seconds: T = m g (3 + 2 cos 30 deg) there
    np.testing.assert_allclose(run.tension_maximum[0], 9.81 * (3 + np.sqrt(3)), rtol=1e-4)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_extremes_include_the_last_step(formulation):
    # on the way down the tension rises from 0 all the time
    run = cp.rigid.simulate(
        pendulum(2.0, [2.0, 0.0]), links=1, times=[0.0, 0.5], formulation=formulation, step=0.01, outputs=ALL
    )
    np.testing.assert_array_equal(run.tension_maximum, run.tension[-1])
    np.testing.assert_array_equal(run.tension_minimum, run.tension[0])


# --- known motions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("links", "gap", "expected"), [(43, 3, 0.8531), (85, 5, 0.8488)])
def test_a_folded_chain_falls_faster_than_free(formulation, links, gap, expected):
    # Calkin and March (1989): sqrt(pi) Gamma(3/4) / (2 sqrt 2 Gamma(5/4)) = 0.847213 of the free fall through its length, in the
    # limit link << gap << length; chains of rigid links computed independently give what is expected here, to its digits
    link = 1.0 / links
    down, up = (links - gap) // 2 * link, (links - gap) / 2 * link
    points = [[0.0, 0.0], [0.0, -down], [gap * link, -down], [gap * link, up - down]]
    scene = pendulum(1.0, points[-1], chain={"links": links}, initial={"points": points})
    fall = np.sqrt(2.0 / 9.81)
    ratio = np.arange(0.84, 0.86, 1e-5)
    run = cp.rigid.simulate(scene, times=ratio * fall, formulation=formulation, step=1e-4)
    lowest = ratio[np.argmin(run.position[:, -1, 1].values)]
    assert lowest == pytest.approx(expected, abs=6e-5)
    assert lowest > 0.847213
    assert float(run.position[:, -1, 1].min()) == pytest.approx(-1.0, abs=0.01)


def test_the_elastic_chain_tends_to_the_rigid_one_as_one_over_the_stiffness(soft):
    times = np.linspace(0.0, 2.0, 9)
    mapping = {**soft, "cable": {**RIGID_CABLE, "density": 1000.0}}
    rigid = cp.rigid.simulate(cp.make_scene(mapping), times=times, formulation="index1", tolerance=1e-9)
    only = {"scheme": "velocity_verlet", "tolerance": 1e-6, "outputs": ("position",)}
    distance = []
    for modulus in (1e9, 4e9, 16e9):
        cable = {**RIGID_CABLE, "youngs_modulus": modulus}
        elastic = cp.chain.simulate(cp.make_scene({**mapping, "cable": cable}), times=times, **only)
        distance.append(np.abs(elastic.position - rigid.position).max().item())
    np.testing.assert_allclose(np.log(np.divide(distance[:-1], distance[1:])) / np.log(4.0), 1.0, atol=0.1)


def test_rest_tends_to_the_inextensible_catenary(soft):
    errors = []
    for n in (10, 20, 40):
        # 1e13 N: strains of 1e-11
        stiff = rigid_scene(soft, cable={**RIGID_CABLE, "youngs_modulus": 1e16})
        rest = cp.rigid.rest(stiff, links=n)
        assert float(rest.residual) < 1e-10 * float(rest.tension.max())
        errors.append(np.abs(rest.position - cp.catenary.rest(stiff, points=n + 1).position).max().item())
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.1)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_chain_at_rest_stays(soft, formulation):
    scene = rigid_scene(soft, motion={}, point_load=[{"arc_length": 0.3, "force": [5.0, -20.0]}])
    run = cp.rigid.simulate(scene, times=[0.0, 1.0, 4.0], formulation=formulation, step=0.01, outputs=ALL)
    # rounding of the rest, 1e-15 of 10 m, over 400 steps
    assert np.abs(run.position - run.position[0]).max() < 1e-11
    np.testing.assert_allclose(run.tension[-1], cp.rigid.rest(scene).tension, rtol=1e-9)
    np.testing.assert_allclose(run.tension_minimum, run.tension_maximum, rtol=1e-9)


# --- order and identities ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize(
    ("formulation", "order", "rate", "allowed"),
    # steps that resolve the fastest of these motions: at 2 % of it the second term of the error is 0.1 of an order, and at the
    # longer steps of the scheme of fourth order several times that
    [("rattle", 2.0, 400, 0.1), ("index1", 4.0, 100, 0.5)],
)
def test_order_in_the_step_with_every_term(soft, name, formulation, order, rate, allowed):
    scene = rigid_scene(soft, **TERMS[name])
    runs = [
        cp.rigid.simulate(scene, times=[0.25, 0.5, 1.0], formulation=formulation, step=1 / (rate * 2**i), outputs=ALL)
        for i in range(4)
    ]
    for what in ("position", "velocity", "tension"):
        found = orders(distances([run[what].values for run in runs]))
        np.testing.assert_allclose(found, order, atol=allowed, err_msg=what)
    drift = [run.attrs["energy_drift"] for run in runs]
    # work of ends and loads and what damping takes are integrated to the order of the scheme
    assert np.log2(drift[1] / drift[2]) > order - 0.5


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_lengths_are_kept_to_rounding(soft, name, formulation):
    # instants between two steps too, and a step so long that positions are off by per cents
    times = np.sort(np.random.default_rng(2).uniform(0.0, 4.0, 50))
    run = cp.rigid.simulate(rigid_scene(soft, **TERMS[name]), times=times, formulation=formulation, step=1 / 30)
    # 1e-16 of 10 m in a link of 0.2 m
    assert np.abs(link_length_errors(run)).max() < 1e-13
    assert run.attrs["length_error"] < 1e-13


@pytest.mark.parametrize(("formulation", "order"), [("rattle", 2.0), ("index1", 4.0)])
def test_between_steps_the_output_has_the_order_of_the_scheme(soft, formulation, order):
    scene, times = rigid_scene(soft, **TERMS["both ends"]), np.sort(np.random.default_rng(1).uniform(0.05, 2.0, 40))
    exact = cp.rigid.simulate(scene, times=times, formulation="index1", step=1 / 1600, outputs=ALL)
    rates = (50, 100, 200)
    runs = [cp.rigid.simulate(scene, times=times, formulation=formulation, step=1 / r, outputs=ALL) for r in rates]
    for what in ("position", "velocity", "tension"):
        errors = [np.abs(run[what] - exact[what]).max().item() for run in runs]
        # instants fall on other parts of the steps
        assert np.log2(errors[0] / errors[2]) / 2 > order - 0.4, what


def test_the_energy_error_of_rattle_stays_bounded(soft):
    # a swinging, slack chain with fixed ends
    scene = rigid_scene(soft, motion={}, chain={"links": 4}, initial={"points": start_of_swing()})
    drift = [
        cp.rigid.simulate(scene, times=[until], step=1 / 50).attrs["energy_drift"] for until in (20.0, 200.0, 2000.0)
    ]
    assert drift[0] > 1e-6
    assert drift[2] < 3.0 * drift[0]


def start_of_swing():
    """Four links of 2.75 m from (0, 0) to (8, 6), off their rest by a load that is then taken away."""
    scene = {
        "cable": RIGID_CABLE,
        "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
        "load": {"uniform": [3.0, 0.0]},
        "chain": {"links": 4},
    }
    return cp.rigid.rest(cp.make_scene(scene)).position.values.tolist()


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_work_of_the_ends_balances_the_energy(formulation):
    # a weightless link towed along itself: all energy of its free end comes from the held one
    scene = pendulum(
        2.0, [0.0, -2.0], gravity=0.0, motion={"lower": {"y": {"kind": "ramp", "amplitude": 3.0, "duration": 1.0}}}
    )
    run = cp.rigid.simulate(scene, links=1, times=[0.5], formulation=formulation, step=1e-3, outputs=ALL)
    # half way the ramp has its greatest speed, 15/8 of the mean
    speed, mass = 3.0 * 15 / 8, 1.0
    np.testing.assert_allclose(run.velocity[0, 1], [0.0, speed], atol=1e-9)
    assert run.attrs["energy_exchanged"] == pytest.approx(0.5 * mass * speed**2, rel=1e-5)
    assert run.attrs["energy_drift"] < 1e-5
    # no acceleration there; before it the largest is 10/sqrt(3) amplitude / duration^2
    np.testing.assert_allclose(run.tension[0, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(run.tension_maximum[0], mass * 30 / np.sqrt(3), rtol=1e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_velocity_jump_is_transmitted_without_delay(formulation):
    # the end of a straight chain starts along it at 2 m/s: all of it moves at that speed
    along = {"lower": {"y": {"kind": "polynomial", "coefficients": [2.0]}}}
    scene = pendulum(2.0, [0.0, -2.0], gravity=0.0, motion=along, chain={"links": 5})
    run = cp.rigid.simulate(scene, times=[0.0, 1.0], formulation=formulation, step=0.01, outputs=("velocity",))
    np.testing.assert_allclose(run.velocity[0], np.tile([0.0, 2.0], (6, 1)), atol=1e-13)
    np.testing.assert_allclose(run.velocity[1], run.velocity[0], atol=1e-12)
    assert run.attrs["start_jolt_speed"] == 2.0
    # five particles of 0.4, the last of 0.2 kg
    assert run.attrs["start_jolt_energy"] == pytest.approx(0.5 * 1.8 * 4.0)


# --- defaults ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["uniform load", "free end", "line", "unequal links"])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_default_step_meets_the_tolerance(soft, name, formulation):
    scene, times = rigid_scene(soft, **TERMS[name]), np.linspace(0.0, 2.0, 9)
    run = cp.rigid.simulate(scene, times=times, formulation=formulation)
    truth = cp.rigid.simulate(scene, times=times, formulation="index1", step=1 / 2000)
    assert float(cp.compare.errors(run, truth).error_max) < 1e-4
    assert run.attrs["time_error_estimate"] < 1e-4
    span = (truth.tension.max("time") - truth.tension.min("time")).max()
    assert float(np.sqrt(((run.tension - truth.tension) ** 2).mean("link")).max() / span) < 1e-4


@pytest.mark.parametrize(
    "name",
    ["slack_cable", "released_line", "slack_line", slow("folded_chain"), slow("whip"), "pendulum", "double_pendulum"],
)
def test_both_formulations_agree_on_the_shipped_scenes(scenes, name):
    scene = cp.read_scene(scenes / f"{name}.toml")
    runs = [cp.rigid.simulate(scene, formulation=item, tolerance=1e-6) for item in FORMULATIONS]
    # each within 1e-6 of the motion
    assert float(cp.compare.errors(*runs).error_max) < 2e-6
    scale = float(np.abs(runs[1].tension).max())
    np.testing.assert_allclose(runs[0].tension, runs[1].tension, rtol=0, atol=1e-4 * scale)
    for run in runs:
        assert np.abs(link_length_errors(run)).max() < 1e-12
        assert run.attrs["length_error"] < 1e-12
        assert run.attrs["energy_drift"] < 1e-5
        assert (run.attrs["links_in_compression"] > 0) == (name == "whip")


def test_the_end_of_a_whip_is_faster_than_its_handle(scenes):
    scene = cp.read_scene(scenes / "whip.toml")
    run = cp.rigid.simulate(scene, formulation="index1", step=2e-5, outputs=("velocity",))
    speed = np.linalg.norm(run.velocity.values, axis=-1)
    assert speed[:, 0].max() == pytest.approx(2.0 / 0.3 * 15 / 8, rel=1e-3)
    assert speed[:, -1].max() > 4 * speed[:, 0].max()


def test_chaos_is_warned_of(scenes):
    scene = cp.read_scene(scenes / "double_pendulum.toml")
    with pytest.warns(cp.NotConvergedWarning, match="chaotic"):
        run = cp.rigid.simulate(scene, times=[0.0, 60.0])
    assert run.attrs["energy_drift"] < 1e-3


def test_a_step_far_too_long_is_warned_of(scenes):
    scene = cp.read_scene(scenes / "double_pendulum.toml")
    with pytest.warns(cp.NotConvergedWarning, match=r"turns by up to [12][.0-9]* rad"):
        run = cp.rigid.simulate(scene, times=[3.0], step=0.2)
    assert run.attrs["steps_cut"] > 0
    assert np.abs(link_length_errors(run)).max() < 1e-13


def test_one_instant_none_and_progress(soft):
    run = cp.rigid.simulate(rigid_scene(soft), times=[0.0], outputs=ALL)
    np.testing.assert_allclose(run.position[0], cp.rigid.rest(rigid_scene(soft)).position, atol=1e-12)
    assert run.attrs["number_of_steps"] == 0
    assert not cp.rigid.simulate(rigid_scene(soft), times=[0.1], step=0.01, outputs=()).data_vars.keys() - {
        "unstretched_length"
    }
    parts = []
    cp.rigid.simulate(rigid_scene(soft), times=[1.0], step=0.01, progress=parts.append)
    assert parts[-1] == 1.0
