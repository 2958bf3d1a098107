"""The continuous cable at rest and its small vibrations: against analytic results, other solvers, its order, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from convergence import orders
from references.elements import Elements
from references.irvine import horizontal, symmetric_roots
from references.links import chain_frequencies
from scenes import scene_with, spatial
from scipy.integrate import solve_bvp
from suite import slow

import cablepod as cp

SAGGING = {
    "cable": {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "unstretched_length": 12.0},
    "ends": {"lower": [0.0, 0.0], "upper": [10.0, 1.0]},
}


# --- rest -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["example1", "example2", "example3", "example4", "sagging", "slack, steep", "soft"])
def test_rest_by_the_linear_law_is_the_catenary(name, scenes, soft):
    if name == "slack, steep":
        scene = scene_with(SAGGING, ends={"lower": [0.0, 0.0], "upper": [2.0, 10.0]})
    else:
        scene = scene_with(soft) if name == "soft" else cp.read_scene(scenes / f"{name}.toml")
    rest = cp.cable.rest(scene, law="linear", points=41)
    exact = cp.catenary.rest(scene, points=41)
    length = float(exact.unstretched_length)
    # between nodes the polynomials of an element are as good as at them: the default asks for 1e-10 of the length there
    assert np.abs(rest.position - exact.position).max() < 1e-9 * length
    nodes = cp.cable.rest(scene, law="linear", elements=128)
    assert (
        np.abs(nodes.position - cp.catenary.rest(scene, points=nodes.sizes["particle"]).position).max() < 1e-10 * length
    )
    # a tension is K times a strain, which has the rounding of positions over the distance of nodes, a 2000th of the length here
    rounding = 1e-12 * float(scene.cable_youngs_modulus * scene.cable_area)
    assert float(nodes.tension_upper) == pytest.approx(float(exact.tension_upper), rel=1e-8, abs=rounding)
    assert float(nodes.tension_lower) == pytest.approx(float(exact.tension_lower), rel=1e-8, abs=rounding)
    assert float(nodes.stretched_length) == pytest.approx(float(exact.stretched_length), rel=1e-11)


def boundary_value_solution(mapping, length, fractions):
    """Rest by law (21) from the differential equation (F)' = q, r' = F/|F| xi(|F|), by collocation in SciPy."""
    k = mapping["cable"]["youngs_modulus"] * mapping["cable"]["area"]
    q = mapping["cable"]["density"] * mapping["cable"]["area"] * 9.81
    (x0, y0), (x1, y1) = mapping["ends"]["lower"], mapping["ends"]["upper"]

    def slope(s, state):
        size = np.hypot(state[2], state[3])
        # Cardano: xi^3 - xi = 2 |F| / K, its root above 1
        c = 3.0 * np.sqrt(3.0) * size / k
        xi = (
            2.0
            / np.sqrt(3.0)
            * np.where(
                c < 1.0, np.cos(np.arccos(np.minimum(c, 1.0)) / 3.0), np.cosh(np.arccosh(np.maximum(c, 1.0)) / 3.0)
            )
        )
        return np.stack([xi * state[2] / size, xi * state[3] / size, 0.0 * size, q + 0.0 * size])

    def ends(a, b):
        return np.array([a[0] - x0, a[1] - y0, b[0] - x1, b[1] - y1])

    s = np.linspace(0.0, length, 400)
    guess = np.stack(
        [x0 + (x1 - x0) * s / length, y0 - 3.0 * np.sin(np.pi * s / length), 0 * s + 30.0, q * (s - length / 2)]
    )
    solution = solve_bvp(slope, ends, s, guess, tol=1e-10, max_nodes=50000)
    assert solution.success
    return solution.sol(length * fractions).T[:, :2]


@pytest.mark.parametrize("youngs_modulus", [2.0e5, 2.0e7, 2.0e4])
def test_rest_by_law_21_solves_the_boundary_value_problem(youngs_modulus):
    mapping = {**SAGGING, "cable": {**SAGGING["cable"], "youngs_modulus": youngs_modulus}}
    rest = cp.cable.rest(scene_with(mapping), elements=32, points=21)
    other = boundary_value_solution(mapping, 12.0, np.linspace(0.0, 1.0, 21))
    # the other solver asks for 1e-10, relative, of the slopes between its nodes
    assert np.abs(rest.position.values - other).max() < 1e-9
    if youngs_modulus == 2.0e5:  # strains of some tenths: here the laws differ by more than a hundred times that
        assert (
            np.abs(
                cp.cable.rest(scene_with(mapping), elements=32, points=21, law="linear").position.values - other
            ).max()
            > 1e-3
        )


@pytest.mark.parametrize(("order", "numbers"), [(1, (32, 64)), (2, (64, 128)), (3, (32, 64)), (4, (32, 64))])
def test_rest_converges_at_the_order_of_the_elements(order, numbers):
    scene = scene_with(SAGGING, cable={**SAGGING["cable"], "unstretched_length": 11.0})
    exact = cp.cable.rest(scene, elements=64, points=400).position  # of order 7
    errors = [
        float(np.sqrt(((cp.cable.rest(scene, elements=n, order=order, points=400).position - exact) ** 2).mean()))
        for n in numbers
    ]
    # order + 2 from order 2 on: GLL nodes are places of superconvergence (Bakker 1982), and what interpolation between them
    # adds, of order + 1, is small in so smooth a shape.  A sag of a quarter of the span leaves a fifth of an order to the limit.
    assert orders(errors) == pytest.approx([2 if order == 1 else order + 2], abs=0.25)


def test_rest_under_point_loads_is_the_limit_of_the_chain(soft):
    soft["point_load"] = [{"arc_length": 0.25, "force": [3.0, -20.0]}, {"arc_length": 0.7, "force": [0.0, 10.0]}]
    soft["load"] = {"uniform": [2.0, 1.0]}
    scene = scene_with(soft)
    coarse, fine = (cp.chain.rest(scene, links=n, law="green").position.values[:: n // 20] for n in (200, 400))
    limit = (4.0 * fine - coarse) / 3.0
    rest = cp.cable.rest(scene, points=21)
    # Richardson: what is left is of fourth order, 1e-4 of the distance of the two chains at least
    assert np.abs(rest.position.values - limit).max() < 1e-8
    assert np.abs(fine - limit).max() > 1e-7
    assert float(rest.residual) < 1e-7  # K/h times the rounding of positions


def test_rest_planar_is_spatial(soft):
    soft["point_load"] = [{"arc_length": 0.25, "force": [3.0, -20.0]}]
    flat, deep = cp.cable.rest(scene_with(soft)), cp.cable.rest(scene_with(spatial(soft)))
    assert np.array_equal(flat.position.values, deep.position.values[:, :2])
    assert not deep.position.values[:, 2].any()
    assert np.array_equal(flat.tension.values, deep.tension.values)


def test_rest_of_a_hardly_extensible_cable():
    mapping = {**SAGGING, "cable": {**SAGGING["cable"], "youngs_modulus": 1e16}}
    rest = cp.cable.rest(scene_with(mapping), law="linear", points=41)
    assert np.abs(rest.position - cp.catenary.rest(scene_with(mapping)).position).max() < 1e-9


@pytest.mark.parametrize("law", ["linear", "green"])
@pytest.mark.parametrize(
    ("length", "upper", "elements"), [(20.0, [10.0, 1.0], 2), (13.0, [2.5, 9.5], 8), (40.0, [10.0, 1.0], 4)]
)
def test_few_elements_of_a_slack_stiff_cable_rest(length, upper, elements, law):
    # the nodes of the continuous cable are off by up to 1e-2 in strain, at a strain of 1e-6 at rest
    cable = {**SAGGING["cable"], "youngs_modulus": 1e11, "unstretched_length": length}
    scene = scene_with(SAGGING, cable=cable, ends={"lower": [0.0, 0.0], "upper": upper}, chain={"links": 10})
    rest = cp.cable.rest(scene, elements=elements, law=law)
    # K times the rounding of positions over the least distance of nodes, a 200th of the length, against the weight
    weight = 9.81 * length
    assert float(rest.residual) < 1e-6 * weight
    # so few elements are off by up to 3e-3 of the weight; from the strain between nodes it would be thousands of times the weight
    exact = cp.catenary.rest(scene, points=21).tension[1::2]
    assert np.abs(rest.tension.values - exact.values).max() < 5e-3 * weight
    for scheme, step in (("trapezoidal", 1e-3), ("velocity_verlet", 1e-6)):
        run = cp.cable.simulate(
            scene,
            elements=elements,
            law=law,
            times=[0.0, 10 * step],
            step=step,
            scheme=scheme,
            outputs=("position", "tension_extremes"),
        )
        assert np.abs(run.position - rest.position).max() < 1e-9 * length
        assert np.abs(xr.concat([run.tension_minimum, run.tension_maximum], "of") - rest.tension).max() < 1e-6 * weight


@pytest.mark.parametrize("solve", [cp.cable.rest, cp.cable.frequencies, cp.cable.simulate])
def test_elements_too_few_for_the_shape_at_rest_are_refused(solve):
    # of 3 m in 10: steeper ones need 128 elements, whose frequencies take seconds
    scene = scene_with(
        SAGGING, ends={"lower": [0.0, 0.0], "upper": [3.0, 10.0]}, time={"duration": 0.1, "interval": 0.1}
    )
    with pytest.raises(
        cp.SceneError, match=r"elements: with 2 of order 3 no rest is found .*; allowed: enough elements"
    ):
        solve(scene, elements=2, order=3)
    if solve is not cp.cable.simulate:
        assert solve(scene).attrs["elements"] > 4


def turning(span):
    """A cable whose bend has a radius of some cm; 128 elements, the most that are tried, are of 9 cm."""
    return scene_with(SAGGING, ends={"lower": [0.0, 0.0], "upper": [span, 10.0]})


@pytest.mark.parametrize("span", [0.5, 0.1])
def test_a_cable_that_turns_sharply(span):
    scene = turning(span)
    rest = cp.cable.rest(scene, law="linear", points=41)
    assert rest.attrs["elements"] == 128
    error = np.abs(rest.position - cp.catenary.rest(scene).position).max()
    # what is said of it is the largest distance at nodes and between them
    assert error <= rest.attrs["space_error_estimate"] * float(rest.unstretched_length) < 3e-2 * span


# links err by 2e-5 in the first frequency (from 240 to 480), and by 1 % where the bend is sharper than they are long (to 960);
# singular values of 1790 unknowns take two seconds: the sharper bend, held less closely, is slow
@pytest.mark.parametrize(("span", "of_links"), [(0.5, 1e-4), slow(0.1, 1.5e-2)])
def test_frequencies_of_a_cable_that_turns_sharply(span, of_links):
    scene = turning(span)
    found = cp.cable.frequencies(scene, elements=128, law="linear", count=1).angular_frequency
    np.testing.assert_allclose(found, chain_frequencies(scene, 480)[:1], rtol=of_links)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"law": "cubic"}, r'law: given .cubic.; allowed: one of "linear", "green"'),
        ({"order": 17}, r"order: given 17; .* at most 16"),
        ({"elements": 0}, r"elements: given 0; allowed: a whole number of at least 1"),
        ({"points": [0.0, 0.5]}, r"points: given .*; allowed: rising fractions"),
        ({"points": [0.0, 0.5, 0.5, 1.0]}, r"points: given .*; allowed: rising fractions"),
        ({"points": "all"}, r'points: given .all.; allowed: .*"nodes"'),
    ],
)
def test_rest_refuses(soft, options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.cable.rest(scene_with(soft), **options)


def test_a_cable_that_folds_at_rest_is_refused():
    with pytest.raises(cp.SceneError, match=r"^cable: no rest found with all places taut"):
        cp.cable.rest(scene_with(SAGGING, ends={"lower": [0.0, 0.0], "upper": [0.0, 10.0]}))


def test_where_results_are_given(soft):
    assert cp.cable.rest(scene_with(soft)).sizes == {"particle": 9, "link": 8, "coordinate": 2}
    relative = cp.cable.rest(scene_with(soft, chain={"link_lengths": [1.0, 3.0]}))
    assert (relative.arc_length / relative.unstretched_length).values == pytest.approx([0.0, 0.25, 1.0], rel=1e-15)
    del soft["chain"]
    assert cp.cable.rest(scene_with(soft)).sizes["particle"] == 41
    nodes = cp.cable.rest(scene_with(soft), elements=3, order=4, points="nodes")
    assert nodes.sizes["particle"] == 13
    some = cp.cable.rest(scene_with(soft), elements=3, order=4, points=[0.0, 0.2, 1.0])
    assert (some.arc_length / some.unstretched_length).values == pytest.approx([0.0, 0.2, 1.0])
    for dataset in (nodes, some):
        for variable in dataset.variables.values():
            assert {"units", "long_name"} <= set(variable.attrs)


# --- small vibrations -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lam2", [0.1, 1.0, 10.0, 4.0 * np.pi**2, 60.0, 200.0, 1000.0])
@pytest.mark.parametrize("law", ["linear", "green"])
def test_frequencies_of_a_horizontal_cable_are_irvine_and_caugheys(lam2, law):
    slope = 0.02
    scene, unit, strain = horizontal(lam2, slope)
    result = cp.cable.frequencies(scene, count=8, law=law)
    found = result.angular_frequency.values / unit
    out = result.out_of_plane_share.values > 0.5
    assert np.abs(result.out_of_plane_share.values - out).max() < 1e-12  # each mode is in the plane or normal to it
    # the theory leaves out the square of the slope of the sag, at most slope/2, and the stretch: a cable of mass mu per
    # unstretched length is longer by H/K than its span and has tension over stretch, not tension, across it
    allowed = slope**2 / 4.0 + 1.6 * strain
    theory = np.sort(np.concatenate([symmetric_roots(lam2, 4), 2.0 * np.pi * np.arange(1, 5)]))[: (~out).sum()]
    assert np.abs(found[~out] / theory - 1.0).max() < allowed
    assert np.abs(found[out] / np.pi / np.arange(1, out.sum() + 1) - 1.0).max() < allowed


def test_the_distance_from_irvine_and_caughey_falls_with_the_square_of_the_sag():
    distance = []
    for slope in (0.08, 0.04, 0.02):
        scene, unit, _ = horizontal(30.0, slope, dims=2)
        found = cp.cable.frequencies(scene, count=4, law="linear").angular_frequency.values / unit
        theory = np.sort(np.concatenate([symmetric_roots(30.0, 3), 2.0 * np.pi * np.arange(1, 4)]))[:4]
        distance.append(np.abs(found / theory - 1.0).max())
    assert orders(distance) == pytest.approx([2.0, 2.0], abs=0.1)


def test_the_crossover():
    # below 4 pi^2 the first symmetric vibration is the lowest, above it the antisymmetric one; the shape tells which
    for lam2, antisymmetric in ((0.97 * 4.0 * np.pi**2, False), (1.03 * 4.0 * np.pi**2, True)):
        scene, _, _ = horizontal(lam2, 0.02, dims=2)
        shape = cp.cable.frequencies(scene, count=1, points=41).mode_shape.values[0, :, 1]
        assert (np.abs(shape + shape[::-1]).max() < 1e-6) == antisymmetric
        assert (np.abs(shape - shape[::-1]).max() < 1e-6) != antisymmetric


@pytest.mark.parametrize("law", ["linear", "green"])
def test_frequencies_of_a_weightless_cable_are_exact(law):
    length, span, stiffness, mass = 10.0, 10.5, 2.0e4, 1.0
    stretch = span / length
    tension = stiffness * (stretch - 1.0) if law == "linear" else 0.5 * stiffness * stretch * (stretch**2 - 1.0)
    tangent = stiffness if law == "linear" else stiffness * (1.5 * stretch**2 - 0.5)
    scene = cp.make_scene(
        {
            "gravity": 1e-9,
            "cable": {"youngs_modulus": stiffness, "area": 1.0, "density": mass, "unstretched_length": length},
            "ends": {"lower": [0.0, 0.0], "upper": [0.6 * span, 0.8 * span]},
        }
    )
    result = cp.cable.frequencies(scene, count=6, law=law)
    number = np.arange(1, 7) * np.pi / length
    exact = np.sort(np.concatenate([number * np.sqrt(tension / stretch / mass), number * np.sqrt(tangent / mass)]))[:6]
    # the default asks that twice the elements change nothing by more than 1e-8
    assert result.angular_frequency.values == pytest.approx(exact, rel=1e-8)
    shape = result.mode_shape.values[0]
    assert np.abs(shape @ [0.6, 0.8]).max() < 1e-6  # the lowest one is across the cable
    assert np.abs(shape @ [-0.8, 0.6]).max() == pytest.approx(np.sqrt(2.0), rel=1e-8)  # a sine of mean square 1


@pytest.mark.parametrize("order", [1, 2, 3])
def test_frequencies_converge_at_twice_the_order(order):
    scene = scene_with(SAGGING, cable={**SAGGING["cable"], "unstretched_length": 10.2})
    exact = cp.cable.frequencies(scene, elements=32, count=3).angular_frequency.values
    numbers = (16, 32) if order == 3 else (32, 64)
    errors = [
        np.abs(
            cp.cable.frequencies(scene, elements=n, order=order, count=3).angular_frequency.values / exact - 1.0
        ).max()
        for n in numbers
    ]
    assert orders(errors) == pytest.approx([2 * order], abs=0.1)


@pytest.mark.parametrize("number", [2, 3, 4])
@pytest.mark.parametrize("law", ["linear", "green"])
def test_frequencies_of_inclined_cables_are_the_limit_of_the_chain(number, law, scenes):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    found = cp.cable.frequencies(scene, law=law).angular_frequency.values
    coarse, fine = (chain_frequencies(scene, links, law) for links in (60, 120))
    # mode k of n links is off by (pi k / n)^2 / 24, Richardson leaves its square or so: 1e-6 for k = 6
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(found, rel=3e-6)
    assert np.abs(fine / found - 1.0).max() > 1e-4


def test_frequencies_have_units_members_and_norm(soft):
    scene = scene_with(soft)
    single = cp.cable.frequencies(scene, count=3, points="nodes", elements=4)
    share = Elements(single.arc_length.values).share
    mean = ((single.mode_shape**2).sum("coordinate") * share).sum("particle") / share.sum()
    assert mean.values == pytest.approx(np.ones(3), rel=1e-12)
    assert not single.mode_shape.values[:, [0, -1]].any()
    assert single.angular_frequency.attrs["units"] == "rad s-1"
    both = cp.cable.frequencies(cp.ensemble.design(scene, {"cable.top_tension": [200.0, 300.0, 2]}))
    for member, tension in enumerate((200.0, 300.0)):
        alone = cp.cable.frequencies(scene_with(soft, cable={**soft["cable"], "top_tension": tension}))
        np.testing.assert_allclose(both.angular_frequency[member], alone.angular_frequency, rtol=1e-12)


def test_frequencies_refuse(soft):
    del soft["motion"]
    with pytest.raises(cp.SceneError, match=r"ends.free: given .upper.; allowed: ends that are held"):
        cp.cable.frequencies(scene_with(soft, ends={**soft["ends"], "free": "upper"}))
    with pytest.raises(cp.SceneError, match=r"count: given 9; allowed: at most 6"):
        cp.cable.frequencies(scene_with(soft), count=9, elements=1, order=4)
    with pytest.raises(cp.SceneError, match=r"count: given 0"):
        cp.cable.frequencies(scene_with(soft), count=0)
