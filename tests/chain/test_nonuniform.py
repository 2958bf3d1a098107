"""Chains of cables with segments and attachments: frequencies and damping of a taut string, schemes, wind, members."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from references.damped_string import roots_of_two_parts, roots_with_damper, roots_with_mass
from references.free_decay import decay_of, ratio_of
from suite import slow, slow_but

import cablepod as cp
from cablepod.chain._attached import attached_forces
from cablepod.chain._implicit import stiffness_at_rest
from cablepod.chain._start import rest_shape
from cablepod.discretisation._chain import LumpedChain, chain_of
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._parameters import Segment

SCHEMES = ("trapezoidal", "generalized_alpha", "energy_momentum")
TENSION, MASS, LENGTH, STIFFNESS = 1e5, 2.0, 10.0, 1e9  # T [N], m per stretched length [kg/m], l [m], EA [N]
FIRST = math.pi / LENGTH * math.sqrt(TENSION / MASS)
STRETCH = 1.0 + TENSION / STIFFNESS

pytestmark = pytest.mark.filterwarnings("ignore::cablepod.errors.UnusualSceneWarning")  # a string of an area of 1 m2


def string(links: int, duration: float = 0.1, **tables: Any) -> Any:
    """Make a taut string without gravity."""
    cable = {
        "youngs_modulus": STIFFNESS,
        "area": 1.0,
        "density": MASS * STRETCH,
        "unstretched_length": LENGTH / STRETCH,
    }
    ends = {"lower": [0.0, 0.0], "upper": [LENGTH, 0.0]}
    time = {"duration": duration, "interval": duration / 100}
    return cp.make_scene(
        {"gravity": 0.0, "cable": cable, "ends": ends, "chain": {"links": links}, "time": time, **tables}
    )


def vibrations(scene: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return angular frequencies [rad/s] and damping ratios of a chain about rest, by rising frequency."""
    chain = chain_of(parameters(scene))
    stiffness, dims = stiffness_at_rest(chain)[1], 2
    damping = np.zeros_like(stiffness)
    attached = attached_forces(chain, rest_shape(chain)[0], None)
    if attached is not None:
        attached.add_stiffness(stiffness)
        for item, particle in zip(chain.p.attachments, chain.attached_particles, strict=True):
            rows = slice(dims * (particle - 1), dims * particle)
            damping[rows, rows] = item.damper * np.outer(item.direction, item.direction)
    mass = np.repeat(chain.mass[1:-1], dims)[:, None]
    zero, one = np.zeros_like(stiffness), np.eye(len(stiffness))
    roots = np.linalg.eigvals(np.block([[zero, one], [-stiffness / mass, -damping / mass]]))
    roots = roots[roots.imag > 0.0]
    roots = roots[np.argsort(np.abs(roots))]
    return np.abs(roots), -roots.real / np.abs(roots)


def assert_second_order(errors: list[float], least: float) -> None:
    """Check that errors of runs with n, 2 n, 4 n links fall by four each time, to `least`."""
    assert abs(errors[-1]) < least
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.05)  # the next order


def test_frequencies_with_a_mass() -> None:
    table, expected = [{"arc_length": 0.5, "mass": MASS * LENGTH}], roots_with_mass(0.5, 1.0, 3)
    found = [vibrations(string(links, attachment=table))[0][:3] / FIRST * math.pi for links in (20, 40, 80)]
    for mode in range(3):
        assert_second_order([float(each[mode] - expected[mode]) for each in found], 3e-3)


def test_damping_ratio_with_a_damper_near_the_end() -> None:
    """At a / l = 0.02, with kappa = 1."""
    damper = math.sqrt(TENSION * MASS) / (math.pi * 0.02)
    table = [{"arc_length": 0.02, "damper": damper, "direction": "normal"}]
    (root,) = roots_with_damper(0.02, 1.0 / (math.pi * 0.02), 1)
    exact = root.imag / abs(root)
    errors = [vibrations(string(links, attachment=table))[1][0] - exact for links in (50, 100, 200)]
    assert_second_order(errors, 1e-6)
    coarse = vibrations(string(12, attachment=table))[1][0]  # the first link is a quarter of the others
    assert coarse == pytest.approx(exact, rel=0.02)


def test_frequencies_of_two_parts() -> None:
    place = 0.37
    exact = roots_of_two_parts(place, 3.0, 2) / LENGTH * math.sqrt(TENSION / MASS)
    parts = [{"to": place}, {"density": 3.0 * MASS * STRETCH}]
    for mode in range(2):
        errors = [vibrations(string(links, segment=parts))[0][mode] / exact[mode] - 1.0 for links in (20, 40, 80)]
        assert abs(errors[-1]) < 5e-4  # the border lies at another place of its link for each number
        assert 3.5 < errors[0] / errors[1] < 4.5
        assert 3.5 < errors[1] / errors[2] < 4.5


def test_a_damper_at_a_node_leaves_the_mode_alone() -> None:
    """Ratios of modes 2 and 4 are 0 by rounding, those of 1 and 3 are not."""
    table = [{"arc_length": 0.5, "damper": 20.0, "direction": "normal"}]
    omega, ratio = vibrations(string(20, attachment=table))
    np.testing.assert_allclose(omega[:4] / FIRST, [1.0, 2.0, 3.0, 4.0], rtol=0.03)
    assert np.abs(ratio[[1, 3]]).max() < 1e-12
    assert ratio[[0, 2]].min() > 1e-3


def decay(scheme: str, mode: int, place: float, damper: float) -> tuple[float, float]:
    """Return the damping ratio of a run, and that of the linear theory of the same chain."""
    links, amplitude = 20, 1e-4 * LENGTH  # tension by the motion: 2.5e-4 of that at rest
    x = np.linspace(0.0, LENGTH, links + 1)
    shape = np.sin(mode * math.pi * x / LENGTH) * (x > 0.0) * (x < LENGTH)
    table = [{"arc_length": place, "damper": damper, "direction": [0.0, 1.0]}]
    initial = {"points": np.stack([x, amplitude * shape], axis=1).tolist()}
    scene = string(links, 10.0 * 2.0 * math.pi / (FIRST * mode), attachment=table, initial=initial)
    omega, ratio = vibrations(scene)
    nearest = int(np.abs(omega - mode * FIRST).argmin())
    run = cp.chain.simulate(scene, scheme=scheme, step=2e-6, outputs=("position",))
    assert run.attrs["scheme"] == scheme
    return ratio_of(run, np.stack([0.0 * shape, shape], axis=1)), float(ratio[nearest])


@pytest.mark.parametrize("scheme", [slow("velocity_verlet"), *SCHEMES])
def test_decay_in_time_is_that_of_the_linear_theory(scheme: str) -> None:
    damper = 0.5 * math.sqrt(TENSION * MASS) / (math.pi * 0.05)
    found, expected = decay(scheme, 1, 0.05, damper)
    assert expected > 0.02
    assert found == pytest.approx(expected, rel=0.01)  # the start is no mode of the damped chain


def test_long_implicit_steps_that_are_chosen_have_dampers_and_springs() -> None:
    scene = cp.make_scene({
        "cable": {"area": 3.1e-4, "youngs_modulus": 1.6e11, "density": 7850.0, "top_tension": 5e3},
        "ends": {"lower": [0.0, 0.0], "upper": [60.0, 0.0]},
        "motion": {"upper": {"y": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 0.5, "ramp": 4.0}}},
        "attachment": [{"arc_length": 0.2, "spring": 3e3, "damper": 3e2, "direction": [0.0, 1.0]}],
        "time": {"duration": 10.0, "interval": 0.25}, "chain": {"links": 40},
    })  # fmt: skip
    options = {"tolerance": 1e-2, "outputs": ("position",)}
    chosen = cp.chain.simulate(scene, **options)
    short = cp.chain.simulate(scene, scheme="trapezoidal", step=5e-3, outputs=("position",))
    assert chosen.attrs["choice_of_scheme"].startswith("implicit")
    motion = np.abs(short.position - short.position[0]).max()
    # without attachments the difference is 0.15, with them 0.001
    assert np.abs(chosen.position - short.position).max() < 0.01 * motion


def test_decay_at_a_node_is_none() -> None:
    found, _ = decay("trapezoidal", 2, 0.5, 20.0)
    assert abs(found) < 1e-6  # of the fit, as the tension varies with the motion; that of mode 1 is 6e-3


def test_spring_and_mass_in_one_place_vibrate_as_an_oscillator() -> None:
    """A stiff spring on a mass that is heavy beside the chain: sqrt((k + 4 T / l) / M), the string as two springs."""
    heavy, spring = 1e3 * MASS * LENGTH, 1e6
    table = [{"arc_length": 0.5, "mass": heavy, "spring": spring, "direction": [0.0, 1.0]}]
    omega, ratio = vibrations(string(20, attachment=table))
    third = MASS * LENGTH / 3.0  # of the string moves with the mass
    expected = math.sqrt((spring + 4.0 * TENSION / LENGTH) / (heavy + third))
    assert np.abs(omega / expected - 1.0).min() < 1e-4
    assert np.abs(ratio).max() < 1e-9


GUY: dict[str, Any] = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 15000.0, "diameter": 0.014},
    "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 5.0]},
    "chain": {"links": 12},
    "time": {"duration": 1.0, "interval": 0.1},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.07, "angular_frequency": 3.0}}},
    "damping": {"mass_proportional": 0.2},
}
THINGS: dict[str, Any] = {
    "segment": [{"to": 0.4, "diameter": 0.03}, {"density": 9000.0, "youngs_modulus": 1e11}],
    "attachment": [
        {"arc_length": 0.3, "mass": 20.0, "drag_area": 0.5},
        {"distance_from_upper": 3.0, "damper": 300.0, "direction": "normal"},
        {"distance_from_lower": 10.0, "spring": 500.0, "damper": 20.0, "mass": 3.0, "direction": [0.0, 0.0, 1.0]},
    ],
}
WIND = {"speed": 25.0, "direction": [1.0, 0.0, 0.2]}


@pytest.mark.parametrize("scheme", slow_but(SCHEMES, "trapezoidal"))
@pytest.mark.parametrize("wind", [slow(False), True])
def test_schemes_agree(wind: bool, scheme: str) -> None:
    """Two schemes of second order with short steps; the drag of bodies, parts, dampers and springs have other code in each."""
    scene = cp.make_scene({**GUY, **THINGS, **({"wind": WIND} if wind else {})})
    explicit = cp.chain.simulate(scene, scheme="velocity_verlet", step=1e-5, outputs=("position", "tension"))
    motion = float(np.abs(explicit.position - explicit.position[0]).max())
    implicit = cp.chain.simulate(scene, scheme=scheme, step=1e-4, outputs=("position",))
    assert float(np.abs(implicit.position - explicit.position).max()) < 1e-4 * motion  # errors of their steps


def test_chain_stays_at_rest_in_the_mean_wind_with_springs_and_dampers() -> None:
    tables = {key: value for key, value in GUY.items() if key != "motion"}
    scene = cp.make_scene({**tables, **THINGS, "wind": WIND})
    run = cp.chain.simulate(scene, scheme="velocity_verlet")
    rest = cp.chain.rest(scene)
    assert float(np.abs(run.position - rest.position).max()) < 1e-11 * 61.0
    calm = cp.chain.rest(cp.make_scene({**tables, **THINGS}))
    assert float(np.abs(rest.position - calm.position).max()) > 0.01


def test_body_in_the_wind_bends_the_rest_by_its_drag() -> None:
    """The force of a body at rest is half the density times drag area times the squared speed; all forces balance."""
    body = [{"arc_length": 0.3, "drag_area": 2.0}]
    wind = {**WIND, "profile": "uniform", "direction": [1.0, 0.0, 0.0]}
    tables = {**GUY, "cable": {**GUY["cable"], "drag_coefficient": 0.0}, "attachment": body, "wind": wind}
    rest = cp.chain.rest(cp.make_scene(tables))
    reach = np.diff(rest.position.values, axis=0)
    force = (rest.tension.values / np.sqrt((reach**2).sum(axis=1)))[:, None] * reach
    at_ends = force[-1] - force[0]
    assert at_ends[0] == pytest.approx(-0.5 * 1.25 * 2.0 * 25.0**2, rel=1e-9)
    assert at_ends[2] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("scheme", slow_but(("velocity_verlet", *SCHEMES), "velocity_verlet", "trapezoidal"))
def test_stiff_damper_holds_its_particle_at_any_step(scheme: str) -> None:
    """Its rate c step / m is 1e4 and more; explicit damping is unstable above 2, Newton's method without its tangent above 1."""
    table = [{"arc_length": 0.3, "damper": 1e9, "direction": "normal"}, {"arc_length": 0.7, "drag_area": 0.1}]
    scene = cp.make_scene({**GUY, "attachment": table, "wind": WIND})
    step = 1e-4 if scheme == "velocity_verlet" else 2e-3
    run = cp.chain.simulate(scene, scheme=scheme, step=step)
    chain = chain_of(parameters(scene))
    if scheme == "velocity_verlet":
        assert run.attrs["step_limit"] == pytest.approx(chain.step_limit(), rel=1e-12)
    else:
        assert run.attrs["steps_cut"] == 0
    particle = chain.attached_particles[0]
    moved = run.position.values[:, particle] - run.position.values[0, particle]
    assert np.abs(moved @ chain.p.attachments[0].direction).max() < 1e-6
    assert np.abs(moved).max() > 1e-4  # along the cable


def test_particles_stand_at_attachments() -> None:
    p = parameters(cp.make_scene({**GUY, **THINGS}))
    chain = chain_of(p)
    assert chain.links == 12
    total = chain.total_length
    np.testing.assert_allclose(
        chain.arc_length[chain.attached_particles] / total, [0.3, 1.0 - 3.0 / total, 10.0 / total]
    )
    ratio = chain.length.max() / chain.length.min()
    assert ratio < 2.0
    near = [{"distance_from_lower": 0.05, "mass": 1.0}]
    short = chain_of(parameters(cp.make_scene({**GUY, "attachment": near})))
    assert short.length[0] == pytest.approx(0.05)
    assert short.length[1:].max() / short.length[1:].min() == pytest.approx(1.0)
    with pytest.raises(cp.SceneError, match=r"^links: given 3; allowed: at least 4"):
        chain_of(p, 3)
    given = {**GUY, "chain": {"link_lengths": [1.0, 2.0, 1.0]}}
    inside = [{"arc_length": 0.25, "mass": 1.0}]
    unequal = chain_of(parameters(cp.make_scene({**given, "attachment": inside})))
    np.testing.assert_allclose(unequal.length / unequal.total_length, [0.25, 0.5, 0.25])
    with pytest.raises(cp.SceneError, match=r"^chain\.link_lengths: given .*particle at attachment\.1"):
        chain_of(parameters(cp.make_scene({**given, "attachment": [{"arc_length": 0.3, "mass": 1.0}]})))


def test_sums_over_particles_and_links_are_those_of_the_cable() -> None:
    p = parameters(cp.make_scene({**GUY, **THINGS, "ice": {"thickness": 0.01}}))
    chain = chain_of(p)
    total = chain.total_length
    mass = sum((part.end - part.start) * total * part.mass for part in p.segments) + 23.0
    compliance = sum((part.end - part.start) * total / part.stiffness for part in p.segments)
    moment = sum((part.end**2 - part.start**2) / 2.0 * total**2 * part.mass for part in p.segments)
    moment += 20.0 * 0.3 * total + 3.0 * 10.0
    assert chain.mass.sum() == pytest.approx(mass, rel=1e-13)
    assert chain.mass @ chain.arc_length == pytest.approx(moment, rel=1e-13)
    assert (1.0 / chain.k).sum() == pytest.approx(compliance, rel=1e-13)
    assert chain.loads()[:, 1].sum() == pytest.approx(-9.81 * mass, rel=1e-13)
    drag = sum((part.end - part.start) * part.drag_coefficient * part.diameter for part in p.segments)
    assert chain.drag_ratio is not None
    assert chain.drag_ratio @ chain.tributary_length == pytest.approx(drag / (p.drag_coefficient * p.diameter) * total)


def test_equal_parts_are_a_uniform_chain() -> None:
    p = parameters(cp.make_scene(GUY))
    part = Segment(0.0, 0.37, p.stiffness, p.area, p.mass, p.weight, p.diameter, 1.2, None)
    cut = chain_of(replace(p, segments=(part, replace(part, start=0.37, end=1.0))))
    uniform = chain_of(p)
    assert isinstance(cut, LumpedChain)
    for name in ("mass", "k", "length"):
        np.testing.assert_allclose(getattr(cut, name), getattr(uniform, name), rtol=2e-12)
    np.testing.assert_allclose(cut.loads(), uniform.loads(), rtol=2e-12, atol=1e-12)
    for of_cut, of_uniform in zip(rest_shape(cut), rest_shape(uniform), strict=True):
        np.testing.assert_allclose(of_cut, of_uniform, rtol=1e-11, atol=1e-11)


def test_chain_at_rest_converges_to_the_catenary() -> None:
    tables = {key: value for key, value in THINGS.items() if key == "segment"}
    hanging = {**GUY, **tables, "attachment": [{"arc_length": 0.4, "mass": 60.0}]}
    exact = float(cp.catenary.rest(cp.make_scene(hanging)).tension_upper)
    # the end link of the chain misses the weight of half a link
    errors = []
    for links in (20, 40, 80):
        rest = cp.chain.rest(cp.make_scene(hanging), links=links)
        half = 9.0e3 * 1.25e-4 * 9.81 * float(rest.unstretched_length) / links / 2.0
        errors.append((float(rest.tension_upper) + half * 57.7 / 61.3 - exact) / exact)
    assert abs(errors[-1]) < 1e-5
    assert errors[0] / errors[2] > 10.0


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_members_are_single_runs(scheme: str) -> None:
    scene = cp.make_scene({**GUY, **THINGS, "wind": WIND})
    values = {
        "attachment.1.mass": [5.0, 10.0, 20.0],
        "attachment.1.arc_length": [0.2, 0.3, 0.35],
        "attachment.2.damper": [0.0, 100.0, 300.0],
        "segment.1.to": [0.3, 0.4, 0.5],
    }
    scenes = cp.ensemble.design(scene, values, members=3, sampling="list")
    together = cp.chain.simulate(scenes, scheme=scheme, step=1e-4)
    for member in range(3):
        alone = cp.chain.simulate(scenes.isel(member=member), scheme=scheme, step=1e-4)
        np.testing.assert_array_equal(together.position[member], alone.position)
        np.testing.assert_array_equal(together.arc_length[member], alone.arc_length)


def test_ratios_of_damping_see_the_springs() -> None:
    """The ratio is that of all vibrations about rest, also with a spring and a mass."""
    table = [{"arc_length": 0.3, "mass": 5.0, "spring": 2e4, "direction": [0.0, 1.0]}]
    links, ratio = 10, 0.03
    omega, _ = vibrations(string(links, attachment=table))
    x = np.linspace(0.0, LENGTH, links + 1)
    initial = {"points": np.stack([x, 1e-5 * x * (LENGTH - x)], axis=1).tolist()}
    scene = string(links, 6.0 * math.pi / omega[0], attachment=table, damping={"ratio": ratio}, initial=initial)
    run = cp.chain.simulate(scene, scheme="trapezoidal", step=2e-5)
    chain = chain_of(parameters(scene))
    stiffness = stiffness_at_rest(chain)[1]
    attached = attached_forces(chain, rest_shape(chain)[0], None)
    assert attached is not None
    attached.add_stiffness(stiffness)
    across = stiffness[1::2, 1::2]
    mass = chain.mass[1:-1]
    _, shapes = np.linalg.eigh(across / np.sqrt(np.outer(mass, mass)))
    shape = np.zeros((links + 1, 2))
    shape[1:-1, 1] = np.sqrt(mass) * shapes[:, 0]
    rate, damped = decay_of(run, shape)
    assert rate == pytest.approx(ratio * omega[0], rel=1e-3)
    assert damped == pytest.approx(omega[0] * math.sqrt(1.0 - ratio**2), rel=1e-4)


def test_start_from_another_length_keeps_attachments_at_their_particles() -> None:
    tables = {**GUY, **THINGS, "wind": WIND, "initial": {"top_tension": 9000.0}}
    run = cp.chain.simulate(cp.make_scene(tables), scheme="velocity_verlet", step=1e-4, outputs=("position",))
    slack = {key: value for key, value in tables.items() if key != "initial"}
    rest = cp.chain.rest(cp.make_scene({**slack, "cable": {**GUY["cable"], "top_tension": 9000.0}}))
    # distances of attachments are those of the scene, 3e-4 of them shorter than of the longer cable
    np.testing.assert_allclose(run.position[0], rest.position, atol=0.01)
    chain = chain_of(parameters(cp.make_scene(tables)))
    longer = replace(
        chain, length=1.01 * chain.length, arc_length=1.01 * chain.arc_length, scene_length=chain.total_length
    )
    np.testing.assert_array_equal(longer.attached_particles, chain.attached_particles)
    np.testing.assert_allclose(longer.mass - 1.01 * chain.mass, -0.01 * (chain.mass - uniform_mass(chain)), atol=1e-9)


def uniform_mass(chain: LumpedChain) -> np.ndarray:
    """Return the masses of the particles without attachments."""
    return replace(chain, p=replace(chain.p, attachments=())).mass


def test_modes_by_mass_are_orthonormal_by_the_masses_of_the_particles() -> None:
    scene = cp.make_scene({**GUY, **THINGS, "wind": WIND})
    run = cp.chain.simulate(scene, outputs=("position",))
    np.testing.assert_array_equal(run.particle_mass, chain_of(parameters(scene)).mass)
    modes = cp.pod.decompose(run, rank=2, weights="mass", layout="vector").mode_shape.values
    shares = run.particle_mass.values / run.particle_mass.values.sum()
    gram = np.einsum("ipc,p,jpc->ij", modes, shares, modes)
    np.testing.assert_allclose(gram / gram[0, 0], np.eye(2), atol=1e-12)
    plain = {key: value for key, value in GUY.items()}
    assert "particle_mass" not in cp.chain.simulate(cp.make_scene(plain), step=1e-4).coords


@pytest.mark.filterwarnings("ignore::cablepod.errors.VelocityJumpWarning")
def test_wave_of_a_jump_is_that_of_the_segment_at_its_end() -> None:
    motion = {"upper": {"x": {"kind": "polynomial", "coefficients": [0.5]}}}
    scene = string(600, segment=[{"to": 0.5, "area": 4.0, "density": 8.0}, {}], motion=motion)
    passage = 0.3 * LENGTH / math.sqrt(STIFFNESS / MASS)  # to 0.7 of the length, before the border
    run = cp.chain.simulate(scene, times=[0.0, passage], step=0.1 * LENGTH / 600 / math.sqrt(STIFFNESS / MASS))
    behind = run.tension[1, 460:570] - run.tension[0, 460:570]
    assert float(behind.mean()) == pytest.approx(run.attrs["start_jolt_tension"], rel=0.01)  # the front is not sharp
