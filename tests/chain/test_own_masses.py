"""Chains with masses and stiffnesses of their own, eq. (3): closed forms, and SciPy on equations written link by link."""

from __future__ import annotations

import copy
import math
import warnings

import numpy as np
import pytest
import xarray as xr
from references.chain_ode import Links
from references.damped_string import roots_with_mass
from scenes import spatial
from scipy.optimize import brentq

import cablepod as cp
from cablepod.cli import main

SCHEMES = ("velocity_verlet", "trapezoidal", "generalized_alpha", "energy_momentum")
EVERY = ("position", "velocity", "tension", "tension_extremes")


def shares(lengths):
    """Half of the links beside each particle."""
    return 0.5 * (np.append(lengths, 0.0) + np.append(0.0, lengths))


def own_of(mapping):
    """Return a scene of a cable of given length with the masses and stiffnesses of its chain as its own."""
    own = copy.deepcopy(mapping)
    cable, links = own["cable"], own["chain"].get("links")
    relative = np.asarray(own["chain"].get("link_lengths", np.ones(links or 0)))
    length = cable["unstretched_length"] * (relative / relative.sum())
    own["chain"]["masses"] = (cable.pop("density") * cable["area"] * shares(length)).tolist()
    own["chain"]["stiffness"] = (cable.pop("youngs_modulus") * cable.pop("area") / length).tolist()
    return own


def uniform(**tables):
    """Return a cable whose chain has numbers without rounding: mass 1 kg/m, stiffness 2^14 N, links of 2 m, gravity 8 m/s2."""
    return {
        "gravity": 8.0,
        "cable": {"youngs_modulus": 2.0**17, "area": 0.125, "density": 8.0, "unstretched_length": 8.0},
        "ends": {"lower": [0.0, 0.0], "upper": [6.0, 5.0]},
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": 0.05, "angular_frequency": 5.0}}},
        "load": {"uniform": [0.5, 0.25]},
        "point_load": [{"arc_length": 0.3, "force": [3.0, -4.0]}],
        "time": {"duration": 1.0, "interval": 0.125},
        "chain": {"links": 4},
    } | copy.deepcopy(tables)


def assert_equal(a, b):
    for name in a.data_vars:
        np.testing.assert_array_equal(a[name].values, b[name].values, err_msg=name)


# --- the uniform chain ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["linear", "green"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_masses_and_stiffnesses_of_the_cable_give_its_bits(scheme, law):
    given = uniform(damping={"mass_proportional": 0.5})
    runs = [
        cp.chain.simulate(cp.make_scene(mapping), scheme=scheme, law=law, step=2.0**-9, outputs=EVERY)
        for mapping in (given, own_of(given))
    ]
    assert_equal(*runs)
    for name in ("highest_angular_frequency", "energy_excess"):
        assert runs[0].attrs[name] == runs[1].attrs[name]


@pytest.mark.parametrize(
    "tables",
    [
        {"damping": {"link_viscosity": 2e-3}},
        {"damping": {"tension_proportional": 2e-3}},
        {"damping": {"ratio": 0.05}},
        {"ends": {"lower": [0.0, 0.0], "upper": [6.0, 5.0], "free": "upper"}, "motion": {}},
        {"initial": {"points": [[0.0, 0.0], [1.0, -2.0], [6.0, 5.0]]}},
    ],
    ids=["viscosity", "tension damping", "ratio", "free end", "points"],
)
def test_further_terms_of_the_cable_give_its_bits(tables):
    given = uniform(**tables)
    assert_equal(*(cp.chain.simulate(cp.make_scene(m), step=2.0**-9, outputs=EVERY) for m in (given, own_of(given))))


def test_rest_and_rigid_links_of_the_cable_give_its_bits():
    given = uniform(point_load=[{"arc_length": 0.3, "force": [3.0, -4.0]}])
    scenes = [cp.make_scene(mapping) for mapping in (given, own_of(given))]
    for law in ("linear", "green"):
        assert_equal(*(cp.chain.rest(scene, law=law) for scene in scenes))
    assert_equal(*(cp.rigid.rest(scene) for scene in scenes))
    for formulation in ("rattle", "index1"):
        assert_equal(
            *(cp.rigid.simulate(scene, formulation=formulation, step=2.0**-8, outputs=EVERY) for scene in scenes)
        )


def test_temperature_keeps_masses_and_axial_stiffness():
    given = uniform(temperature=-30.0, chain={"link_lengths": [1.0, 3.0, 2.0, 1.5]})
    given["cable"] |= {"thermal_expansion": 2e-4, "diameter": 0.05}
    for mapping in (given, {**given, "ice": {"thickness": 0.01}}):
        a, b = (cp.chain.rest(cp.make_scene(scene)) for scene in (mapping, own_of(mapping)))
        assert float(b.unstretched_length) == pytest.approx(8.0 * (1.0 - 2e-4 * 50.0), rel=1e-14)
        np.testing.assert_allclose(a.tension, b.tension, rtol=1e-12)
    warm = own_of(given)
    warm.pop("temperature")
    assert float(cp.chain.rest(cp.make_scene(warm)).tension_upper) < 0.99 * float(a.tension_upper)


@pytest.mark.parametrize("tables", [{}, {"ice": {"thickness": 0.02}}], ids=["wind", "wind and ice"])
def test_wind_and_ice_on_unequal_links_as_on_the_cable(tables):
    given = uniform(
        chain={"link_lengths": [1.0, 3.0, 2.0, 1.5]},
        wind={"speed": 20.0, "direction": [1.0, 0.0], "ground": -10.0},
        **tables,
    )
    given["cable"]["diameter"] = 0.05
    given = spatial(given)  # as most scenes in wind are: one kernel for all
    given["wind"]["direction"].append(0.0)
    a, b = (cp.chain.simulate(cp.make_scene(mapping), step=1e-3) for mapping in (given, own_of(given)))
    # links of 0.9 to 3 m in coordinates of 8 m, 1000 steps: rounding, amplified by the stiff links
    np.testing.assert_allclose(a.position, b.position, rtol=0.0, atol=1e-12)
    a, b = (
        cp.summary(cp.make_scene(own_of({**given, "wind": wind})))
        for wind in (given["wind"], {**given["wind"], "speed": 0.0})
    )
    assert float(a.tension_upper_still_air) == pytest.approx(float(b.tension_upper), rel=1e-14)
    assert float(a.tension_upper_mean_wind) > 1.05 * float(b.tension_upper)


def test_masses_alone_and_stiffness_alone():
    given = uniform()
    both = own_of(given)
    rest = cp.chain.rest(cp.make_scene(given))
    for name, kept in (("masses", ("youngs_modulus", "area")), ("stiffness", ("density", "area"))):
        cable = {key: given["cable"][key] for key in (*kept, "unstretched_length")}
        chain = {name: both["chain"][name]}
        assert_equal(rest, cp.chain.rest(cp.make_scene({**given, "cable": cable, "chain": chain})))


def test_few_particles_of_their_own_are_not_too_few():
    given = uniform(chain={"links": 2}, motion={"upper": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 0.3}}})
    with pytest.warns(cp.errors.CoarseWarning, match="^links: given 2"):
        cp.chain.simulate(cp.make_scene(given))
    with warnings.catch_warnings():
        warnings.simplefilter("error", cp.errors.CoarseWarning)
        cp.chain.simulate(cp.make_scene(own_of(given)))


def test_masses_of_held_ends_change_nothing():
    light, heavy = own_of(uniform()), own_of(uniform())
    heavy["chain"]["masses"][0], heavy["chain"]["masses"][-1] = 1e3, 1e-3
    assert_equal(*(cp.chain.simulate(cp.make_scene(mapping), outputs=EVERY) for mapping in (light, heavy)))


# --- independent equations --------------------------------------------------------------------------------------------

MASSES, STIFFNESS, LINKS = [0.7, 0.4, 2.5, 1.1], [3e3, 8e2, 2e3], np.array([2.0, 1.0, 3.0])
UPPER = np.array([4.0, 3.0, 1.0])


def three_links(**tables):
    return {
        "gravity": 9.7,
        "cable": {"unstretched_length": 6.0},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": UPPER.tolist()},
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": 0.1, "angular_frequency": 4.0}}},
        "load": {"uniform": [0.0, 0.5, 2.0]},
        "damping": {"mass_proportional": 0.3},
        "chain": {"masses": MASSES, "stiffness": STIFFNESS, "link_lengths": LINKS.tolist()},
        "time": {"duration": 2.0, "interval": 0.25},
    } | copy.deepcopy(tables)


def ends(t):
    """Positions and velocities of both ends."""
    moved = [[0.0] * 3, [0.1 * (1.0 - math.cos(4.0 * t)), 0.0, 0.0]]
    return np.array([[0.0] * 3, UPPER]) + moved, np.array([[0.0] * 3, [0.4 * math.sin(4.0 * t), 0.0, 0.0]])


@pytest.mark.parametrize("is_free", [False, True], ids=["held", "free end"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_three_links_against_scipy(scheme, is_free):
    tables = {"ends": {"lower": [0.0] * 3, "upper": UPPER.tolist(), "free": "upper"}, "motion": {}} if is_free else {}
    scene = cp.make_scene(three_links(**tables))
    loads = np.outer(MASSES, [0.0, -9.7, 0.0]) + np.outer(shares(LINKS), [0.0, 0.5, 2.0])
    links = Links(LINKS, np.array(STIFFNESS), np.array(MASSES), lambda _: loads, ends, damping=0.3, is_free=is_free)
    times = np.arange(9) * (0.05 if is_free else 0.25)  # a free end soon whips, links snap: compared before that
    expected = links.positions(cp.chain.rest(scene).position, times)
    errors = []
    for step in (1e-3, 5e-4):
        run = cp.chain.simulate(scene, times=times, scheme=scheme, step=step)
        found = run.position.values[:, 1:] if is_free else run.position.values[:, 1:-1]
        errors.append(np.abs(found - expected).max())
    assert errors[1] < 2e-5  # generalized alpha has the largest error, of the step
    if not is_free:  # links of the free chain go slack, which are kinks
        assert 3.5 < errors[0] / errors[1] < 4.5  # of second order


def test_energy_of_unequal_particles_is_conserved():
    mapping = three_links(motion={}, damping={}, load={"uniform": [0.0, 0.0, 0.0]})
    mapping["initial"] = {"points": [[0.0, 0.0, 0.0], [1.5, 1.2, 0.4], [2.2, 1.4, 0.5], UPPER.tolist()]}
    run = cp.chain.simulate(
        cp.make_scene(mapping), scheme="energy_momentum", step=5e-3, outputs=("position", "velocity")
    )
    stretched = np.linalg.norm(run.position.diff("particle"), axis=-1)
    strain = 0.5 * np.array(STIFFNESS) * np.maximum(stretched - LINKS, 0.0) ** 2
    kinetic = 0.5 * np.array(MASSES) * (run.velocity.values**2).sum(-1)
    height = 9.7 * np.array(MASSES) * run.position.sel(coordinate="y").values
    energy = strain.sum(1) + kinetic.sum(1) + height.sum(1)
    assert kinetic.sum(1).max() > 5.0
    assert np.ptp(energy) < 1e-8 * kinetic.sum(1).max()


# --- closed forms -----------------------------------------------------------------------------------------------------


def taut(masses, *, tension=100.0, length=10.0, stiffness=1e6, **tables):
    """Return a weightless chain of equal links, straight and with a tension at rest."""
    links = len(masses) - 1
    unstretched = length / (1.0 + tension / stiffness)
    return {
        "gravity": 0.0,
        "cable": {"unstretched_length": unstretched},
        "ends": {"lower": [0.0, 0.0], "upper": [length, 0.0]},
        "chain": {"masses": list(masses), "stiffness": [stiffness / (unstretched / links)] * links},
    } | tables


def beaded(links, place, ratio):
    """Masses of a string of 2 kg of equal links with a bead."""
    masses = 2.0 * shares(np.full(links, 1.0 / links))
    masses[round(place * links)] += 2.0 * ratio
    return masses


@pytest.mark.parametrize(("place", "ratio"), [(0.5, 1.0), (0.3, 2.5), (0.1, 0.5)])
def test_frequency_of_a_string_with_a_bead(place, ratio):
    expected = roots_with_mass(place, ratio, 1)[0] / 10.0 * math.sqrt(100.0 / 0.2)
    errors = []
    for links in (20, 40):
        numbers = cp.summary(cp.make_scene(taut(beaded(links, place, ratio))))
        first = numbers.angular_frequency_out_of_plane.values[0]
        assert numbers.angular_frequency_in_plane.values[0] == pytest.approx(first, rel=1e-7)  # of stiff links
        errors.append(abs(first / expected - 1.0))
    assert errors[1] < 3e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.2)  # the chain is of second order


def test_motion_of_a_string_with_a_bead():
    links, place, ratio, amplitude, zeta = 40, 0.3, 2.5, 1e-4, 0.02
    beta, x = roots_with_mass(place, ratio, 1)[0] / 10.0, np.linspace(0.0, 10.0, links + 1)
    omega = beta * math.sqrt(100.0 / 0.2)
    shape = np.where(x < 3.0, np.sin(beta * x) / math.sin(beta * 3.0), np.sin(beta * (10.0 - x)) / math.sin(beta * 7.0))
    period = 2.0 * math.pi / omega
    mapping = taut(
        beaded(links, place, ratio),
        initial={"points": np.stack([x, amplitude * shape], axis=1).tolist()},
        time={"duration": 3.0 * period, "interval": period / 8.0},
        damping={"ratios": [zeta]},
    )
    run = cp.chain.simulate(cp.make_scene(mapping), scheme="trapezoidal", step=period / 2000.0)
    damped, t = omega * math.sqrt(1.0 - zeta**2), run.time.values
    expected = np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))
    found = run.position.values[:, round(place * links), 1] / amplitude
    # frequency of 40 links: 1e-4, over three periods a phase of 2e-3
    np.testing.assert_allclose(found, expected, atol=4e-3)


def diatomic(k, first, second, links):
    """Angular frequencies of a chain between held ends whose particles have the masses `first`, `second`, `first`, ..."""
    theta = np.pi * np.arange(1, links // 2) / links
    total = 1.0 / first + 1.0 / second
    root = np.sqrt(total**2 - 4.0 * np.sin(theta) ** 2 / (first * second))
    return np.sqrt(np.sort(np.concatenate([k * (total - root), k * (total + root), [2.0 * k / first]])))


def test_frequencies_of_alternating_masses():
    links, first, second = 12, 0.3, 1.7
    masses = [9.0, *([first, second] * links)[: links - 1], 9.0]
    mapping = taut(masses, time={"duration": 1.0, "interval": 0.5})
    scene = cp.make_scene(mapping)
    numbers = cp.summary(scene)
    axial = diatomic(mapping["chain"]["stiffness"][0], first, second, links)
    transverse = diatomic(100.0 / (10.0 / links), first, second, links)
    assert float(numbers.first_axial_frequency) == pytest.approx(axial[0], rel=1e-9)
    np.testing.assert_allclose(numbers.angular_frequency_out_of_plane, transverse[:3], rtol=1e-9)
    np.testing.assert_allclose(numbers.angular_frequency_in_plane, transverse[:3], rtol=1e-9)
    run = cp.chain.simulate(scene, step=0.9 * 2.0 / axial[-1])
    assert run.attrs["highest_angular_frequency"] == pytest.approx(axial[-1], rel=1e-12)
    with pytest.raises(cp.SceneError, match=r"^step: "):
        cp.chain.simulate(scene, step=1.001 * 2.0 / axial[-1])


def test_summary_of_a_turned_chain_and_its_numbers():
    planar = own_of(uniform(load={"uniform": [0.0, 0.25]}, point_load=[], motion={}))
    turn = np.array([0.6, 0.0, 0.8])
    spatial = {**planar, "load": {"uniform": [0.0, 0.25, 0.0]}}
    spatial["ends"] = {end: (place[0] * turn + [0.0, place[1], 0.0]).tolist() for end, place in planar["ends"].items()}
    a, b = (cp.summary(cp.make_scene(mapping)) for mapping in (planar, spatial))
    for name in set(a.data_vars) - {"note"}:
        np.testing.assert_allclose(a[name], b[name], rtol=1e-9, err_msg=name)
    rest = cp.chain.rest(cp.make_scene(planar))
    assert float(a.mass) == sum(planar["chain"]["masses"])
    assert float(a.tension_upper) == float(rest.tension_upper)
    assert float(a.strain) == pytest.approx(float(rest.tension.max()) / 2.0**14, rel=1e-12)
    assert float(a.axial_stiffness) == 2.0**14
    assert not {"density", "stress", "mass_per_length", "irvine_parameter"} & set(a.data_vars)


def test_check_prints_the_frequencies_that_there_are(tmp_path, capsys):
    path = tmp_path / "beads.toml"
    path.write_text(
        "[cable]\nunstretched_length = 6.0\n[ends]\nlower = [0.0, 0.0]\nupper = [5.0, 2.0]\n[chain]\n"
        "masses = [0.5, 0.4, 2.5, 0.5]\nstiffness = [3.0e3, 8.0e2, 2.0e3]\nlink_lengths = [2.0, 1.0, 3.0]\n"
    )
    numbers = cp.summary(cp.read_scene(path))
    assert np.isnan(numbers.frequency_out_of_plane.values).tolist() == [False, False, True]  # of two particles
    assert main(["check", str(path)]) == 0
    lines = {line.strip()[:30].strip(): line for line in capsys.readouterr().out.splitlines()}
    assert " 3.9 kg" in lines["mass of the particles"]
    for plane, count in (("in plane", 3), ("out of plane", 2)):
        found = lines[f"first frequencies {plane}"].split(plane)[1].split(" Hz")[0].split()
        values = numbers[f"frequency_{plane.replace(' ', '_')}"].values[:count]
        np.testing.assert_allclose([float(number) for number in found], values, rtol=1e-4)


@pytest.mark.parametrize("links", [1, 3])
def test_a_bead_hanging_on_weightless_links(links):
    # all but massless particles between bead and ends: a V of two straight sides
    mass, side, k, span = 12.0, 3.0, 4e3, 4.0
    masses = np.full(2 * links + 1, 2e-8)
    masses[links] = mass
    given = {
        "gravity": 9.81,
        "cable": {"unstretched_length": 2.0 * side},
        "ends": {"lower": [0.0, 0.0], "upper": [span, 0.0]},
        "chain": {"masses": masses.tolist(), "stiffness": [k * links] * (2 * links)},
    }
    scene = cp.make_scene(given)
    half, weight = 0.5 * span, mass * 9.81

    def unbalanced(depth):
        reach = math.hypot(half, depth)
        return 2.0 * k * (reach - side) * depth / reach - weight

    depth = brentq(unbalanced, 1e-3, 10.0, xtol=1e-14)
    rest = cp.chain.rest(scene)
    # 1e-7 kg of 12 kg
    assert float(rest.position[links, 1]) == pytest.approx(-depth, rel=1e-7)
    np.testing.assert_allclose(rest.tension, k * (math.hypot(half, depth) - side), rtol=1e-7)
    stiff = cp.rigid.rest(scene)
    height = math.sqrt(side**2 - half**2)
    assert float(stiff.position[links, 1]) == pytest.approx(-height, rel=1e-7)
    np.testing.assert_allclose(stiff.tension, 0.5 * weight * side / height, rtol=1e-7)


def test_rest_of_unequal_particles_is_a_funicular_polygon():
    rng = np.random.default_rng(4)
    masses, k, length = rng.uniform(0.2, 9.0, 8), rng.uniform(5e2, 9e3, 7), rng.uniform(0.5, 2.0, 7)
    given = {
        "gravity": 9.81,
        "cable": {"unstretched_length": float(length.sum())},
        "ends": {"lower": [0.0, 0.0], "upper": [5.0, 2.0]},
        "chain": {"masses": masses.tolist(), "stiffness": k.tolist(), "link_lengths": length.tolist()},
    }
    scene = cp.make_scene(given)
    for rest in (cp.chain.rest(scene), cp.rigid.rest(scene)):
        reach = np.diff(rest.position, axis=0)
        stretched = np.linalg.norm(reach, axis=1)
        force = rest.tension.values[:, None] * reach / stretched[:, None]
        np.testing.assert_allclose(force[:, 0], force[0, 0], rtol=1e-11)
        np.testing.assert_allclose(np.diff(force[:, 1]), masses[1:-1] * 9.81, rtol=1e-10)
        expected = length + (0.0 if rest.attrs["title"].endswith("rigid links at rest") else rest.tension.values / k)
        np.testing.assert_allclose(stretched, expected, rtol=1e-12)


def test_rigid_pendulums_of_unequal_masses():
    # small vibrations of a double pendulum of masses m1, m2 and lengths l1, l2
    m1, m2, l1, l2, g = 1.5, 0.4, 1.2, 0.7, 9.81
    matrix = np.linalg.solve(
        [[(m1 + m2) * l1**2, m2 * l1 * l2], [m2 * l1 * l2, m2 * l2**2]], np.diag([(m1 + m2) * g * l1, m2 * g * l2])
    )
    squared, vectors = np.linalg.eig(matrix)
    omega, (a1, a2) = math.sqrt(squared.min()), 1e-4 * vectors[:, squared.argmin()]
    line = [[0.0, 0.0], [l1 * math.sin(a1), -l1 * math.cos(a1)]]
    line.append([line[1][0] + l2 * math.sin(a2), line[1][1] - l2 * math.cos(a2)])
    given = {
        "gravity": g,
        "cable": {"unstretched_length": l1 + l2},
        "ends": {"lower": [0.0, 0.0], "upper": line[2], "free": "upper"},
        "initial": {"points": line},
        "chain": {"masses": [3.0, m1, m2], "stiffness": [1e5, 1e5], "link_lengths": [l1, l2]},
        "time": {"duration": 5.0, "interval": 0.25},
    }
    run = cp.rigid.simulate(cp.make_scene(given), step=1e-3)
    found = run.position.sel(coordinate="x").values[:, 1:]
    expected = np.outer(np.cos(omega * run.time.values), [line[1][0], line[2][0]])
    np.testing.assert_allclose(
        found, expected, atol=1e-4 * 1e-4
    )  # angles of 1e-4, of which cubes are left out; steps of 1e-3


# --- members, wind ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{"step": 2.0**-8}, {"scheme": "trapezoidal", "step": 2.0**-6}, {}], ids=str)
def test_members_with_masses_of_their_own(options):
    rng = np.random.default_rng(7)
    mapping = own_of(uniform())
    own = {f"chain.{name}": mapping["chain"][name] for name in ("masses", "stiffness")}
    lists = {
        path: [(values * rng.uniform(0.7, 1.4, len(values))).tolist() for _ in range(6)] for path, values in own.items()
    }
    mapping["ensemble"] = {"members": 6, "sampling": "list", "ranges": lists}
    scenes = cp.ensemble.design(cp.make_scene(mapping))
    np.testing.assert_array_equal(scenes.chain_masses, lists["chain.masses"])
    assert np.unique(cp.chain.rest(scenes).tension_upper).size == 6
    together = cp.chain.simulate(scenes, **options)
    assert together.particle_mass.dims == ("member", "particle")
    np.testing.assert_array_equal(together.particle_mass, lists["chain.masses"])
    for i in range(6):
        alone = cp.chain.simulate(scenes.isel(member=i, drop=True), **options)
        # lanes of implicit members add in another order
        rounding = 1e-9 if "scheme" in options else 1e-13
        np.testing.assert_allclose(together.position[i], alone.position, rtol=0.0, atol=rounding)
    with pytest.raises(cp.SceneError, match=r'^weights: given "mass" and members with different ratios'):
        cp.pod.decompose(together, weights="mass")
    assert "particle_mass" not in cp.pod.decompose(together, rank=2, weights="length").coords


def test_drag_on_a_light_particle_limits_the_step():
    # one particle of 1 g carries a metre of line of 0.1 m in a storm: explicit steps must resolve its drag, not that of the mean
    given = {
        "cable": {"unstretched_length": 4.2, "diameter": 0.1},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [4.0, 0.0, 0.0]},
        "chain": {"masses": [1.0, 5.0, 1e-3, 5.0, 1.0], "stiffness": [50.0] * 4},
        "wind": {"speed": 40.0, "direction": [1.0, 0.0, 0.0], "ground": -10.0, "ramp": 0.5},
        "time": {"duration": 1.0, "interval": 0.125},
    }
    scene = cp.make_scene(given)
    explicit = cp.chain.simulate(scene, scheme="velocity_verlet", tolerance=1e-4)
    implicit = cp.chain.simulate(scene, scheme="trapezoidal", tolerance=1e-4)
    moved = float(np.abs(implicit.position - implicit.position[0]).max())
    np.testing.assert_allclose(explicit.position, implicit.position, rtol=0.0, atol=1e-3 * moved)


# --- modes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["svd", "covariance", "snapshots"])
def test_modes_weighted_by_mass(method):
    run = cp.chain.simulate(cp.make_scene(three_links()))
    np.testing.assert_array_equal(run.particle_mass, MASSES)
    modes = cp.pod.decompose(run, layout="vector", weights="mass", method=method)
    mass = np.array(MASSES[1:-1]) / np.mean(MASSES[1:-1])
    sigma = np.array([2.0, 3.0])[:, None] / 6.0
    position = run.position.values
    lifted = position[:, 1:-1] - (1.0 - sigma) * position[:, :1] - sigma * position[:, -1:]
    matrix = (np.sqrt(mass)[:, None] * (lifted - lifted.mean(axis=0))).reshape(len(lifted), -1)
    values = np.linalg.svd(matrix, compute_uv=False)
    np.testing.assert_allclose(modes.singular_value[:4], values[:4], rtol=1e-6)
    shape = modes.mode_shape.values[:4, 1:-1]
    np.testing.assert_allclose(np.einsum("apc,p,bpc->ab", shape, mass, shape), np.eye(4), atol=1e-8)
    amplitude = cp.pod.project(run, modes).amplitude
    np.testing.assert_allclose((amplitude**2).sum("time")[:4], values[:4] ** 2, rtol=1e-6)
    other = cp.pod.decompose(run, layout="vector", weights="length", method=method)
    assert np.abs(np.abs(other.mode_shape) - np.abs(modes.mode_shape)).max() > 0.01


def test_streams_by_mass_take_equal_masses_only():
    run = cp.chain.simulate(cp.make_scene(three_links()))
    stream = cp.pod.Stream(layout="vector", weights="mass").update(run).update(run)
    once = cp.pod.decompose(run, layout="vector", weights="mass")
    np.testing.assert_allclose(stream.modes(rank=2).mode_shape, once.mode_shape[:2], atol=1e-9)
    other = three_links()
    other["chain"]["masses"] = [1.0, 1.0, 1.0, 1.0]
    other = cp.chain.simulate(cp.make_scene(other))
    for refused in (lambda: stream.update(other), lambda: cp.pod.decompose([run, other], weights="mass")):
        with pytest.raises(
            cp.SceneError, match=r'^weights: given "mass" and trajectories of chains with different ratios'
        ):
            refused()
    cp.pod.decompose([run, other], weights="length")
    bad = run.assign_coords(particle_mass=("particle", [1.0, -1.0, 1.0, 1.0]))
    with pytest.raises(cp.SceneError, match="particle_mass that are not finite and above 0"):
        cp.pod.decompose(bad, weights="mass")


def test_masses_of_particles_survive_a_file(tmp_path):
    run = cp.chain.simulate(cp.make_scene(three_links()))
    cp.archive.write(run, tmp_path / "run.nc")
    again = cp.archive.read(tmp_path / "run.nc")
    xr.testing.assert_identical(again.particle_mass, run.particle_mass)
    a, b = (cp.pod.decompose(snapshots, layout="vector", weights="mass") for snapshots in (run, again))
    np.testing.assert_array_equal(a.mode_shape, b.mode_shape)


# --- refusals ---------------------------------------------------------------------------------------------------------


def test_other_models_refuse_by_key():
    scene = cp.make_scene(own_of(uniform(point_load=[])))
    run = cp.chain.simulate(scene)
    fields, normal = cp.pod.decompose(run, rank=2), cp.pod.decompose(run, rank=2, layout="normal")
    refused = {
        "catenary": lambda: cp.catenary.rest(scene),
        "stringing": lambda: cp.catenary.stringing(scene.assign(cable_thermal_expansion=1e-5), [0.0, 20.0]),
        "cable": lambda: cp.cable.simulate(scene),
        "cable rest": lambda: cp.cable.rest(scene),
        "frequencies": lambda: cp.cable.frequencies(scene),
        "condensed": lambda: cp.condensed.simulate(scene, normal),
        "prepared": lambda: cp.condensed.prepare(scene, normal),
        "vibrations": lambda: cp.condensed.vibration_modes(scene, rank=2),
        "galerkin": lambda: cp.galerkin.simulate(scene, fields),
        "orbit": lambda: cp.periodic.orbit(scene, normal),
        "backbone": lambda: cp.periodic.backbone(scene, normal, amplitude=0.1),
        "study": lambda: cp.study.run(scene),
    }
    for name, call in refused.items():
        with pytest.raises(cp.SceneError, match=r"^chain\.masses: given masses of particles; allowed: a cable without"):
            pytest.fail(f"{name} gave {type(call())}")
    alone = uniform(chain={"stiffness": [8192.0] * 4})
    for key in ("youngs_modulus",):
        alone["cable"].pop(key)
    with pytest.raises(cp.SceneError, match=r"^chain\.stiffness: given stiffnesses of links"):
        cp.catenary.rest(cp.make_scene(alone))


def test_options_that_have_no_meaning():
    scene = cp.make_scene(own_of(uniform()))
    with pytest.raises(cp.SceneError, match=r"^outputs: given 'error_estimate'; allowed: none beside chain\.masses"):
        cp.chain.simulate(scene, outputs=("position", "error_estimate"))
    for call in (cp.chain.rest, cp.chain.simulate, cp.rigid.rest, cp.rigid.simulate):
        with pytest.raises(cp.SceneError, match=r"^links: given 8; allowed: 4, as many as chain\.masses has"):
            call(scene, links=8)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"chain.masses": [1.0] * 4}, r"^chain\.masses: given \[1\.0, 1\.0, 1\.0, 1\.0\]; allowed: 5 numbers, one more than"),
        ({"chain.stiffness": [1.0] * 3}, r"^chain\.stiffness: given \[1\.0, 1\.0, 1\.0\]; allowed: 4 numbers, one for each link"),
        ({"chain.links": 7}, r"^chain\.masses: given .*; allowed: 8 numbers"),
        ({"chain.link_lengths": [1.0, 2.0]}, r"^chain\.link_lengths: given .*; allowed: 4 numbers"),
        ({"chain.masses": [1.0, 2.0, -1.0, 1.0, 1.0]}, r"^chain\.masses\[2\]: given -1\.0; allowed: a finite number above 0"),
        ({"chain.stiffness": [1.0, 0.0, 1.0, 1.0]}, r"^chain\.stiffness\[1\]: given 0\.0; allowed: a finite number above 0"),
        ({"chain.masses": [1.0, math.nan, 1.0, 1.0, 1.0]}, r"^chain\.masses\[1\]: given nan"),
        ({"chain.masses": 3.0}, r"^chain\.masses: given 3\.0; allowed: a list of at least 3 finite numbers"),
        ({"chain.masses": [1.0, 1e-5, 1e5, 1.0, 1.0]}, r"^chain\.masses: given .*differ by a factor of at most 1e\+09$"),
        ({"cable.unstretched_length": None}, r"^cable\.unstretched_length: missing; .*, which chain\.masses needs$"),
        (
            {"cable.unstretched_length": None, "cable.top_tension": 50.0},
            r"^cable\.top_tension: given 50\.0; allowed: cable\.unstretched_length beside chain\.masses$",
        ),
        ({"cable.density": 8.0}, r"^cable\.density: given 8\.0; allowed: none beside chain\.masses$"),
        ({"cable.specific_weight": 8.0}, r"^cable\.specific_weight: given 8\.0; allowed: none beside chain\.masses$"),
        ({"cable.youngs_modulus": 8.0}, r"^cable\.youngs_modulus: given 8\.0; allowed: none beside chain\.stiffness$"),
        ({"cable.strand": "EHS 1/2 in"}, r"^cable\.density: given .*; allowed: none beside chain\.masses, also by a strand$"),
        ({"chain.masses": None}, r"^cable: given none; allowed: exactly one of specific_weight, density, mass_per_length$"),
        ({"chain.masses": None, "cable.density": 8.0}, r"^cable\.area: missing; allowed: area"),
        ({"cable.mass_per_length": 8.0}, r"^cable\.mass_per_length: given 8\.0; allowed: none beside chain\.masses$"),
        ({"cable.axial_stiffness": 8.0}, r"^cable\.axial_stiffness: given 8\.0; allowed: none beside chain\.stiffness$"),
        ({"cable.sag": 1.0, "cable.unstretched_length": None}, r"^cable\.sag: given 1\.0; allowed: cable\.unstretched_length"),
        ({"chain.stiffness": None}, r"^cable\.youngs_modulus: missing; allowed: Young's modulus"),
        ({"initial.top_tension": 50.0}, r"^initial\.top_tension: given 50\.0; allowed: none beside chain\.masses, .*points$"),
        ({"initial.unstretched_length": 7.9}, r"^initial\.unstretched_length: given 7\.9; allowed: none beside chain\.masses"),
        ({"chain.masses": [1e-28] * 5}, r"^chain\.masses: given .*; allowed: 1e-15 to 1e15 kg/m"),
        ({"chain.stiffness": [1e-9] * 4}, r"^chain\.stiffness: given .*; allowed: an axial stiffness of 1e-6 to 1e18 N"),
        ({"chain.stiffness": [1.0] * 4}, r"^chain\.stiffness: given an axial stiffness of 2 N, which at rest .*strained by"),
    ],
)  # fmt: skip
def test_wrong_masses_and_stiffnesses(changes, message):
    mapping = own_of(uniform())
    for path, value in changes.items():
        table, key = path.split(".")
        mapping.setdefault(table, {})
        mapping[table].pop(key, None)
        if value is not None:
            mapping[table][key] = value
    if "chain.link_lengths" in changes or "chain.masses" in changes or "chain.stiffness" in changes:
        mapping["chain"].setdefault("links", 4)
    with pytest.raises(cp.SceneError, match=message):
        cp.make_scene(mapping)


def test_wrong_masses_in_a_dataset():
    scene = cp.make_scene(own_of(uniform()))
    masses = scene.chain_masses.copy()
    masses[2] = -1.0
    with pytest.raises(cp.SceneError, match=r"^chain\.masses\[2\]: given -1\.0; allowed: a finite number above 0"):
        cp.chain.rest(scene.assign(chain_masses=masses))
    with pytest.raises(cp.SceneError, match=r"^cable\.density: given 8\.0; allowed: none beside chain\.masses"):
        cp.chain.rest(scene.assign(cable_density=8.0))


@pytest.mark.parametrize("table", [{"segment": [{"to": 0.5}, {}]}, {"attachment": [{"arc_length": 0.5, "mass": 1.0}]}])
def test_segments_and_attachments_refuse_masses_of_particles(table):
    with pytest.raises(cp.SceneError, match=r"^chain\.masses: given; allowed: none beside \[\[segment\]\] and"):
        cp.make_scene(own_of(uniform()) | table)


def test_masts_refuse_masses_of_particles():
    mast = {"mast": {"height": 30.0, "bending_stiffness": 1e7, "mass": 50.0}, "chain": {"masses": [1.0] * 5}}
    with pytest.raises(cp.SceneError, match=r"^chain\.masses: given .*; allowed: chain\.links, equal links"):
        cp.make_scene(mast)
