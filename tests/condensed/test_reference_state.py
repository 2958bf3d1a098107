"""Second-order terms of order "leading": closed forms, order of convergence, frequencies about rest."""

from __future__ import annotations

import numpy as np
import pytest
from convergence import orders
from references.links import tangent_at_rest
from scenes import full_modes, scene_with
from scipy.optimize import brentq

import cablepod as cp
from cablepod.condensed._assembly import model_of
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._reference_state import reference_state
from cablepod.parameters._from_scene import parameters

#: Gauss-Legendre points on half a parabola, whose squared slopes are symmetric.
POINTS, WEIGHTS = (values * 0.5 for values in np.polynomial.legendre.leggauss(40))
PROFILE = 3.0 * (0.5 + POINTS) ** 2  # squared slopes over their mean


class FirstOrder(CondensedModel):
    """The model of order "leading" without the terms of second order."""

    reference_state = None


def state(strains, sag, mean_fourth=9.0 / 5.0):
    """The reference state of a cable whose sag at the first strain is given."""
    rest_load = 2.0 * sag * (strains[0] + sag) ** 2
    found = reference_state(np.array(strains)[:, None], np.array([rest_load]), mean_fourth)
    return float(found.uniform[0]), float(found.sag[0])


def force_per_slope(strain, sag):
    """Force per unit slope over K of a parabola of given sag, projected on it, by the exact closure without loads along it."""
    squared = 2.0 * sag * PROFILE

    def stretch(n):
        # n = zeta' (1 - 1 / xi), by Newton's method at each point
        z = np.full(POINTS.size, 1.0 + n)
        for _ in range(50):
            xi = np.sqrt(z * z + squared)
            z = z - (z * (1.0 - 1.0 / xi) - n) / (1.0 - squared / xi**3)
        return z

    n = brentq(lambda n: WEIGHTS @ stretch(n) - 1.0 - strain, 0.1 * sag, 2.0 * (strain + sag) + sag, xtol=1e-17)
    return WEIGHTS @ (n / stretch(n) * squared) / (WEIGHTS @ squared)


@pytest.mark.parametrize(("strain", "sag"), [(1.0, 0.0), (1.0, 0.3), (0.0, 1.0), (-0.7, 1.0)])
def test_the_force_of_one_equilibrium_is_right_to_second_order(strain, sag):
    errors, left_out = [], []
    for size in (0.02, 0.01, 0.005):
        x, a = strain * size, sag * size
        uniform, found = state((x, x), a)
        factor = uniform + 1.8 * found  # mean over the parabola's own squared slopes
        exact = force_per_slope(x, a) if a else x / (1.0 + x)
        errors.append(abs(factor * (x + factor * a) / exact - 1.0))
        left_out.append(abs((x + a) / exact - 1.0))
        assert found == pytest.approx(a, rel=1e-12, abs=1e-18)
    if not sag:  # a straight cable
        assert max(errors) < 1e-14
    else:
        assert orders(errors) == pytest.approx([2.0, 2.0], abs=0.15)
    assert orders(left_out) == pytest.approx([1.0, 1.0], abs=0.1)


def test_the_factor_lies_between_those_of_the_shortest_and_the_longest_chord():
    first, last = state((-2e-5, -2e-5), 1.8e-4), state((7e-4, 7e-4), 8e-6)
    both = state((-2e-5, 7e-4), 1.8e-4)
    inverse = [1.0 / (uniform + 1.8 * sag) for uniform, sag in (first, both, last)]
    assert inverse[0] < inverse[1] < inverse[2]
    # nearer to the shortest chord, with most of the sag
    assert inverse[1] - inverse[0] < 0.5 * (inverse[2] - inverse[0])


def test_large_sags_and_cables_without_tension_have_no_terms():
    assert state((-0.07, -0.07), 0.08) == (1.0, 0.0)
    slack = reference_state(np.array([[-1e-3], [-1e-3]]), np.zeros(1), 9.0 / 5.0)
    assert (float(slack.uniform[0]), float(slack.sag[0])) == (1.0, 0.0)
    lost = reference_state(np.full((2, 1), np.nan), np.zeros(1), 9.0 / 5.0)
    assert (float(lost.uniform[0]), float(lost.sag[0])) == (1.0, 0.0)


def test_one_reference_state_for_many_members(soft):
    rng = np.random.default_rng(2)
    strains, loads = np.sort(rng.uniform(-1e-3, 2e-3, (2, 6)), axis=0), rng.uniform(0.0, 1e-8, 6)
    loads[3] = np.nan
    together = reference_state(strains, loads, 1.8)
    for i in range(6):
        alone = reference_state(strains[:, i : i + 1], loads[i : i + 1], 1.8)
        for one, many in zip(alone, together, strict=True):
            assert one[0] == pytest.approx(many[i], rel=1e-13)


def test_other_orders_have_none(soft):
    p, modes = parameters(scene_with(soft)), full_modes()
    for order in ("exact", "inertial"):
        model = model_of(p, modes, rank=2, order=order, law="linear")
        assert model.reference_state is None
        np.testing.assert_array_equal(model.slope_factor, 1.0)
    leading = model_of(p, modes, rank=2, order="leading", law="linear")
    assert np.abs(leading.slope_factor - 1.0).max() > 1e-4


# --- frequencies about rest -------------------------------------------------------------------------------------------


def chain_frequencies(scene, count):
    """Lowest in-plane frequencies of the chain about rest, chordwise inertia included."""
    tangent, mass, _ = tangent_at_rest(scene)
    mass = np.repeat(mass, 2)
    return np.sqrt(np.linalg.eigvalsh(tangent.reshape(mass.size, -1) / np.sqrt(np.outer(mass, mass)))[:count])


def model_frequencies(model, count):
    """Lowest frequencies of a model about its equilibrium, by central differences of its forces."""
    q, data = model.initial()[0], model.static_boundary_data
    change = 1e-5 * np.abs(q).max()
    columns = [
        (model.force(q - change * u, 0.0 * q, data)[0] - model.force(q + change * u, 0.0 * q, data)[0]) / (2 * change)
        for u in np.eye(q.size)
    ]
    return np.sqrt(np.sort(np.linalg.eigvals(np.array(columns).T).real)[:count])


@pytest.mark.parametrize(("number", "without", "allowed"), [(2, 3e-4, 2e-5), (3, 2e-4, 2e-4), (4, 1.2e-3, 1.1e-3)])
def test_frequencies_about_rest_come_nearer_to_those_of_the_chain(number, without, allowed, scenes):
    moving = cp.read_scene(scenes / f"example{number}.toml")
    scene = moving.drop_vars([name for name in moving.variables if str(name).startswith("motion_")])
    modes = cp.condensed.vibration_modes(scene, rank=8, static_modes=True)
    model = model_of(parameters(scene), modes, rank=None, order="leading", law="linear")
    exact = chain_frequencies(scene, 3)
    without_terms = FirstOrder(model.chain, model.order, model.modes)
    plain, found = (np.abs(model_frequencies(item, 3) / exact - 1.0).max() for item in (without_terms, model))
    # the terms are those of the equilibrium: what they leave out changes with the vibration, and with the shape of the mode
    assert found < allowed
    assert found < 0.7 * plain
    assert plain > without


def test_a_stretched_straight_cable_vibrates_at_its_exact_frequencies():
    cable = {"youngs_modulus": 2.0e4, "area": 1.0, "density": 1.0, "unstretched_length": 10.0}
    scene = cp.make_scene(
        {"gravity": 1e-9, "cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [9.0, 12.0]}, "chain": {"links": 20}}
    )
    modes = cp.condensed.vibration_modes(scene, rank=6)
    model = model_of(parameters(scene), modes, rank=None, order="leading", law="linear")
    # by half of its length longer, T = K / 2 over a stretch of 3/2; without the terms the frequencies are those of T
    exact = 4.0 * np.sqrt(1e4 / 1.5) * np.sin(np.pi * 6 / 40.0)
    assert modes.angular_frequency.values[-1] == pytest.approx(exact, rel=1e-10)
    assert np.sqrt(model.omega_taut_squared(0.0)) == pytest.approx(exact, rel=1e-9)
