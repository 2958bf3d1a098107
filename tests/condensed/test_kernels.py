"""Kernels and solvers alone: closure, Newton's method for many systems, steps of constant size, blocks, dyads of springs."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import PAIRS, everything, full_modes, spatial
from suite import slow

import cablepod as cp
from cablepod.condensed import _stepper
from cablepod.condensed._fields import close_exactly
from cablepod.condensed._kernels_error import _hold_by_springs
from cablepod.condensed._newton import equilibria, solve_each, solved
from cablepod.discretisation._laws import law_tension
from cablepod.integrate import _march

# --- closure ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("green", [False, True])
def test_solutions_close_the_chord_and_satisfy_the_law(green):
    """Shapes, loads and chords jump from one instant to the next, some into compression; each reported root is a root."""
    generator = np.random.default_rng(3)
    count = 0
    for _ in range(200):
        links, shapes = 20, 30
        stiffness, strain = 10.0 ** generator.uniform(3, 8), 10.0 ** generator.uniform(-6, -0.5)
        length = np.full(links, 10.0 ** generator.uniform(0, 2) / links)
        squared = (10.0 ** generator.uniform(-3, 0) * generator.standard_normal((shapes, links))) ** 2
        tau = 0.2 * stiffness * strain * generator.standard_normal((shapes, links))
        chord = (
            length.sum()
            * (1.0 + strain - 0.5 * squared.mean(axis=1))
            * (1.0 + 0.02 * generator.standard_normal(shapes))
        )
        force, z = close_exactly(squared, tau, length, chord, stiffness, green, (stiffness * strain, 1.0))
        good = np.isfinite(force)
        count += int(good.sum())
        force, z, squared = force[good], z[good], squared[good]
        np.testing.assert_allclose(z @ length, chord[good], rtol=1e-12)
        xi = np.sqrt(z**2 + squared)
        law = stiffness * (0.5 * z * (xi**2 - 1.0) if green else (1.0 - 1.0 / xi) * z)
        # the closure bounds the error of H, a mean over all links, by 1e-10 of H and rounding; one link may err by more, and a
        # false root errs by all of H
        off = np.abs(force[:, None] + tau[good] - law).max(axis=1)
        assert (off <= 1e-8 * np.abs(force) + 1e-13 * stiffness).all()
    assert count > 5500  # of 6000; under strong compression there is no solution


@pytest.mark.parametrize("green", [False, True])
def test_the_closure_without_a_guess(green):
    rng = np.random.default_rng(3)
    times, links, stiffness = 40, 7, 1e6
    weights = rng.uniform(0.5, 2.0, links)
    squared = rng.uniform(0.0, 1.5, (times, links))
    # stretched links; the chordwise force of the first is H, and the others follow
    stretch = rng.uniform(1.0, 1.4, (times, links))
    xi = np.sqrt(stretch**2 + squared)
    force = law_tension(xi, stiffness, green=green) * stretch / xi
    tau = force - force[:, :1]
    found, tension, nothing = np.empty_like(stretch), np.empty(times), (np.nan, 1.0)  # so that Newton's method fails
    for i in range(times):
        part = slice(i, i + 1)
        chord = stretch[part] @ weights
        tension[part], found[part] = close_exactly(squared[part], tau[part], weights, chord, stiffness, green, nothing)
    # halving ends at the rounding of H, some 1e-16 K
    np.testing.assert_allclose(found, stretch, rtol=1e-12)
    np.testing.assert_allclose(tension, force[:, 0], atol=1e-12 * stiffness)
    # with these slopes links buckle at 0.28 of their length
    none = np.zeros((1, links))
    tension, _ = close_exactly(none + 0.04, none, weights, np.array([0.2 * weights.sum()]), stiffness, green, nothing)
    assert np.isnan(tension[0])


# --- Newton's method for many systems ---------------------------------------------------------------------------------


def roots(powers):
    """Residuals 2 - x^n, whose solutions are the n-th roots of 2; those with n = 0 have no derivative."""

    def residuals(x, part):
        n = powers[part, None]
        return 2.0 - x**n, (n * x ** np.maximum(n - 1, 0))[:, :, None]

    return residuals


def test_each_system_is_solved_as_if_it_were_alone():
    powers, start, seen = np.array([1, 2, 3, 0, 5]), np.full((5, 1), 1.5), []
    options = (lambda change, x, part: np.abs(change).max(axis=1) <= 1e-15), 30
    residuals = roots(powers)
    x, found = solve_each(start, lambda x, part: seen.extend(part) or residuals(x, part), *options)
    # one linear step and one that finds nothing to change; without a derivative there is none
    assert (seen.count(0), seen.count(3)) == (2, 1)
    assert found.tolist() == [True, True, True, False, True]
    np.testing.assert_allclose(x[found, 0], 2.0 ** (1.0 / powers[found]), rtol=1e-15)
    alone = [solve_each(start[k : k + 1], roots(powers[k : k + 1]), *options)[0][0] for k in np.flatnonzero(found)]
    np.testing.assert_array_equal(x[found], alone)


def test_singular_matrices_leave_the_others_as_they_are():
    matrices = np.array([np.eye(2), np.ones((2, 2)), [[0.0, 2.0], [4.0, 0.0]]])
    result = solved(matrices, np.ones((3, 2)))
    assert np.isnan(result[1]).all()
    np.testing.assert_array_equal(result[[0, 2]], [[1.0, 1.0], [0.25, 0.5]])


def test_an_equilibrium_further_away_than_the_deflection_is_none():
    target = np.array([[1.1], [-1.5], [20.0]])  # near, turned over, beyond ten times the guess
    q, found = equilibria(np.ones((3, 1)), lambda q, part: (target[part] - q, np.ones((len(q), 1, 1))))
    assert found.tolist() == [True, False, False]
    assert q[0] == 1.1


def test_dyads_of_springs_are_inverted():
    rng = np.random.default_rng(3)
    springs, inverse_mass = rng.normal(size=(3, 7)), 1.0 / rng.uniform(1.0, 2.0, 7)
    mass = np.diag(1.0 / inverse_mass)
    vectors = rng.normal(size=(2, 7))
    expected = mass @ np.linalg.solve(mass + 0.7 * springs.T @ springs, vectors.T)
    own = vectors.copy()
    getattr(_hold_by_springs, "py_func", _hold_by_springs)(springs, 0.7, inverse_mass, np.zeros((3, 9)), own[0], own[1])
    np.testing.assert_allclose(own.T, expected, rtol=0.0, atol=1e-13)


# --- steps ------------------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # modes of another cable; the ends come near
@pytest.mark.constant_sizes
@pytest.mark.parametrize("case", ["everything", slow("one of each deflection"), slow("downhill"), "unstable"])
def test_steps_of_a_constant_number_of_coordinates_are_those_of_any_number(soft, monkeypatch, case):
    """Loads that vary, damping, several blocks of loads, extremes; the order of the sums differs, and nothing else."""
    mapping, rank, rate = everything(soft), 3, 500  # as in tests/models, whose kernels it takes
    if case == "one of each deflection":
        mapping, rank = spatial({**soft, "damping": {"mass_proportional": 0.8}}), 1
    elif case == "downhill":  # where the chordwise force is least in the last link
        mapping = {**soft, "ends": {"lower": [0.0, 6.0], "upper": [8.0, 0.0]}}
    elif case == "unstable":  # the tension grows with the distance of the ends
        mapping["motion"], rate = {"upper": {"x": {"kind": "ramp", "amplitude": 0.3, "duration": 1.0}}}, 5
    scene, modes = cp.make_scene(mapping), full_modes(dims=3 if rank == 1 else 2)
    options = {"scheme": "numerov", "step": 1.0 / rate, "times": np.linspace(0.0, 2.0, 41)}
    outputs = ("velocity", "tension_extremes")

    def run():
        try:
            return cp.condensed.simulate(scene, modes, rank=rank, outputs=outputs, **options)
        except cp.RunStopped as stopped:
            return str(stopped)

    one = run()
    monkeypatch.setattr(_stepper, "MAX_CONSTANT_SIZE", 0)
    other = run()
    if case == "unstable":
        assert one == other
        assert "its stability limit is below the step" in one
        return
    # rounding, which the sums of a thousand steps add up to 1e-12 of the motion
    for name in ("amplitude", "velocity", "tension_minimum", "tension_maximum"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9, atol=1e-10 * float(np.abs(other[name]).max()))
    for name in ("smallest_chordwise_force", "time_of_smallest_force"):
        assert one.attrs[name] == pytest.approx(other.attrs[name], rel=1e-9)


def test_blocks_do_not_change_the_motion(soft, monkeypatch):
    scene, modes, seen = cp.make_scene(everything(soft)), full_modes(), []
    for order, scheme in (pair for pair in PAIRS if pair[0] != "exact"):
        options = {"order": order, "scheme": scheme, "step": 1 / 1000, "times": [1.0], "outputs": ("tension_extremes",)}
        whole = cp.condensed.simulate(scene, modes, **options)
        with monkeypatch.context() as patch:
            patch.setattr(_march, "BLOCK", 64)
            parts = cp.condensed.simulate(scene, modes, progress=seen.append, **options)
        # at the start of a block implicit steps have another first guess (tolerance 1e-11), and the sine recurrence restarts
        np.testing.assert_allclose(parts.amplitude, whole.amplitude, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(parts.tension_maximum, whole.tension_maximum, rtol=1e-8)
    assert seen[-1] == 1.0
    assert len(seen) > 40
