"""The Galerkin model from inside: its two forms, its vibrations and filters, and what its estimate is made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import TERMS, spatial

import cablepod as cp
from cablepod.galerkin import _estimate as galerkin_estimate
from cablepod.galerkin import _explicit as explicit
from cablepod.galerkin import _implicit as implicit
from cablepod.galerkin import _kernels_energy as kernel
from cablepod.galerkin import _model as galerkin_model
from cablepod.galerkin._assembly import model_of
from cablepod.integrate import _march as march
from cablepod.integrate._comparison import motion_scale
from cablepod.parameters._from_scene import parameters

SCHEMES = ("velocity_verlet", "filtered_verlet", "trapezoidal")

# what is held here holds for models that cannot be trusted too
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


TIMES = np.arange(0.0, 4.01, 0.1)


def stiff(soft):
    """The soft scene with a stiff cable that is moved slowly, as a mapping."""
    soft["cable"] |= {"youngs_modulus": 2e8, "top_tension": 150.0}
    soft["motion"]["upper"]["x"] |= {"amplitude": 0.05, "angular_frequency": 1.0}
    return soft


def modes_of(scene, **options):
    """Modes of the chain of a scene."""
    return cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), **options)


def test_the_packed_form_has_the_gradient_of_the_energy(soft):
    # energy link by link, differentiated numerically, against the packed coefficients
    scene = cp.make_scene({**soft, **TERMS["both ends"]})
    modes = modes_of(scene)
    model = model_of(parameters(scene), modes, rank=3, law="green")
    shape, rates = model.slopes
    weight = model.chain.p.stiffness * model.chain.length
    rng = np.random.default_rng(5)
    y = rng.normal(size=len(rates)) * 0.1

    def energy(y):
        square = np.sum((shape + np.tensordot(y, rates, axes=1)) ** 2, axis=1)
        return np.sum(weight * (square - 1) ** 2) / 8

    pairs, work = model.polynomial_form[2:], [np.zeros(model.gram_form[1].size) for _ in range(2)]
    gradient = np.zeros(y.size)
    kernel.polynomial_gradient(y, *model.gram_form, *pairs, *work, gradient)
    packed = [kernel.polynomial_energy(state, *model.polynomial_form, work[0]) for state in (y, 0.0 * y)]
    assert packed[0] - packed[1] == pytest.approx(energy(y) - energy(0.0 * y), rel=1e-10)
    h = 1e-3  # the energy is quartic: the five-point formula is exact but for rounding
    unit = np.eye(y.size) * h
    numeric = [(8 * (energy(y + u) - energy(y - u)) - energy(y + 2 * u) + energy(y - 2 * u)) / (12 * h) for u in unit]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-7, atol=1e-7 * np.abs(numeric).max())
    own, hessian = model.gradient(y)
    np.testing.assert_allclose(own, gradient[: own.size], rtol=1e-10, atol=1e-10 * np.abs(own).max())
    steps = [(model.gradient(y + u)[0] - model.gradient(y - u)[0]) / (2 * h) for u in unit[: own.size]]
    np.testing.assert_allclose(hessian, steps, rtol=1e-3, atol=1e-4 * np.abs(hessian).max())


def test_the_cost_does_not_depend_on_the_particles(soft):
    # the packed factor has at most as many rows as columns, however many links the modes have
    scene = cp.make_scene(soft)
    sizes = []
    for links in (40, 120):
        modes = cp.pod.decompose(cp.chain.simulate(scene, links=links, step=1e-4), rank=2)
        sizes.append(model_of(parameters(scene), modes, rank=2, law="green").polynomial_form[0].shape)
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("layout", ["separate", "vector"])
def test_polynomial_form_and_link_form_are_one_model(soft, monkeypatch, layout, scheme):
    scene = cp.make_scene({**soft, **TERMS["both ends"]})
    modes = modes_of(scene, layout=layout)
    runs = []
    for cost, ratio in ((0.0, np.inf), (np.inf, 0.0)):
        monkeypatch.setattr(explicit, "POLYNOMIAL_COST", cost)
        monkeypatch.setattr(implicit, "MIN_ROW_RATIO", ratio)
        runs.append(cp.galerkin.simulate(scene, modes, rank=3, scheme=scheme, step=0.005))
    assert float(cp.compare.errors(*runs).error_max) < 1e-10
    assert runs[0].attrs["energy_defect"] == pytest.approx(runs[1].attrs["energy_defect"], rel=1e-3, abs=1e-12)
    if "newton_iterations" in runs[0].attrs:
        # the tangent is exact: two iterations, one where the start is good; with half of its geometric part it takes three
        assert all(run.attrs["newton_iterations"] < 2.05 * run.attrs["number_of_steps"] for run in runs)


@pytest.mark.parametrize("phase", [0.25, 0.5, 0.9])
def test_filtered_steps_have_the_exact_frequencies_of_small_vibrations(soft, phase):
    scene = cp.make_scene({**soft, "motion": {}})
    modes = modes_of(cp.make_scene(soft))
    model = model_of(parameters(scene), modes, rank=2, law="green")
    rest = model.initial
    squared, shapes = model.vibrations(rest, np.zeros(0))
    omega, size = np.sqrt(squared[0]), 1e-6 * np.abs(rest).max()
    rate = omega / phase
    times = np.arange(0, round(20 * 2 * np.pi / phase), 7) / rate  # 20 periods
    start = (model, rest + size * shapes[:, 0], scene, modes)
    run = explicit.ExplicitGalerkinRun(*start, "filtered_verlet", times=times)(rate)
    exact = size * np.cos(omega * times)
    np.testing.assert_allclose((run.q - rest) @ shapes[:, 0], exact, atol=1e-3 * size)
    # stiffer vibrations, for which these steps are too long, are slowed and not excited
    assert rate < 0.5 * np.sqrt(squared[-1])
    assert np.abs((run.q - rest) @ shapes[:, -1]).max() < 1e-3 * size


def test_filtered_steps_stop_where_the_stiffness_outgrows_them(soft, monkeypatch):
    scene = cp.make_scene(soft)
    modes = modes_of(scene)
    options = {"rank": 2, "scheme": "filtered_verlet", "step": 0.05}
    assert cp.galerkin.simulate(scene, modes, **options).attrs["step_limit"] < 0.05
    monkeypatch.setattr(explicit, "_filter_of", explicit._filter_of.__wrapped__)  # filters are kept between calls
    monkeypatch.setattr(explicit, "SLOWED", 4.5)  # above the stability limit from the start
    with pytest.raises(cp.RunStopped, match=r"stiffened: at 0 s|left the finite numbers"):
        cp.galerkin.simulate(scene, modes, **options)


@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning")  # such steps make energy too
def test_where_newton_fails_the_step_is_cut_or_the_run_stops_and_keeps_what_it_has(soft, monkeypatch):
    # a stiff cable is jerked: two shapes are as good as one another over a step of half a second
    motion = {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.3, "angular_frequency": 6.0}}}
    scene = cp.make_scene({**soft, "motion": motion})
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=5e-4, times=np.arange(41) / 10))
    whole = cp.galerkin.simulate(scene, modes, scheme="trapezoidal", step=0.5)
    assert whole.attrs["steps_cut"] > 0
    assert np.isfinite(whole.position).all()
    monkeypatch.setattr(march, "MAX_SUBSTEPS", 1)
    said = r"Newton's method did not converge, with the step cut into 1, at .* s \(trapezoidal, step 0\.5 s, step number \d\); "
    with pytest.raises(cp.RunStopped, match=said) as stopped:
        cp.galerkin.simulate(scene, modes, scheme="trapezoidal", step=0.5)
    partial = stopped.value.partial
    assert partial.attrs["incomplete"].startswith("stopped at ")
    assert 0 < partial.sizes["time"] < 9
    longer = cp.galerkin.simulate(scene, modes, scheme="trapezoidal", step=0.5, times=partial.time.values)
    np.testing.assert_array_equal(partial.position, longer.position)


def test_filtered_steps_are_those_of_the_mean_state(scenes, monkeypatch):
    # the frequencies change as the end moves: fitted at the mean state, they are wrong by less than at the start
    scene = cp.read_scene(scenes / "example4.toml")
    times = np.arange(0.0, 60.1, 0.5)
    modes = cp.pod.decompose(cp.chain.simulate(scene, links=20, times=times, tolerance=1e-3))
    options = {"rank": 1, "times": times, "outputs": ("position",)}
    exact = cp.galerkin.simulate(scene, modes, scheme="velocity_verlet", step=5e-4, **options)

    def error():
        run = cp.galerkin.simulate(scene, modes, scheme="filtered_verlet", step=0.02, **options)
        return float(cp.compare.errors(run, exact).error_max)

    mean = error()
    monkeypatch.setattr(explicit, "_filter_of", explicit._filter_of.__wrapped__)  # filters are kept between calls
    monkeypatch.setattr(galerkin_model.GalerkinModel, "mean_vibrations", lambda self, _: self.initial_vibrations)
    assert mean < error() / 3  # a seventh, measured


def test_without_an_equilibrium_at_the_mean_state_the_start_counts(soft):
    # a load beyond all numbers, under which Newton's method finds none
    scene = cp.make_scene(soft)
    modes = modes_of(scene)
    model = model_of(parameters(scene), modes, rank=2, law="green")
    model.__dict__["_generalised_loads"] = (np.full((1, model.initial.size), np.inf), [])
    with np.errstate(all="ignore"):
        assert model.mean_vibrations(1.0) is model.initial_vibrations


def test_a_mode_that_nothing_pulls_back_at_the_start_does_not_divide_by_zero(soft):
    mapping = spatial(stiff(soft))
    mapping["ends"]["upper"][2] = 3.0
    mapping["load"] = {"uniform": [0.0, 0.0, 2.0], "kind": "harmonic", "amplitude": 0.5, "angular_frequency": 2.0}
    scene = cp.make_scene(mapping)
    chain = cp.chain.simulate(scene, times=TIMES, tolerance=1e-4, scheme="velocity_verlet", outputs=("position",))
    modes = cp.pod.decompose(chain, layout="vector")
    model = model_of(parameters(scene), modes, rank=1, law="linear")
    assert model.vibrations(model.initial, model.displacements(np.zeros(1))[0])[0][-1] <= 0.0
    with pytest.warns(cp.OutOfRangeWarning):
        run = cp.galerkin.simulate(scene, modes, rank=1, times=TIMES, law="linear", step=1e-3)
    assert np.isfinite(run.position).all()
    assert run.attrs["step_limit"] > 0.0


def test_what_is_off_along_the_chord_counts(soft):
    scene = cp.make_scene(stiff(soft))
    modes = cp.pod.decompose(cp.chain.simulate(scene, times=TIMES, tolerance=1e-4, outputs=("position",)))
    model = model_of(parameters(scene), modes, rank=3, law="linear")
    start = (model, model.initial, scene, modes)
    estimates = galerkin_estimate.GalerkinEstimate(model, 4.0)
    run = explicit.ExplicitGalerkinRun(*start, "velocity_verlet", estimates.sample_interval, times=TIMES)
    trajectory = run(1000.0, sampled=True)
    bump = 5e-3 * np.sin(np.pi * model.sigma)
    chord = model.chain.p.upper - model.chain.p.lower
    shifted = replace(model, mean=model.mean + bump[:, None] * chord / np.linalg.norm(chord))
    told = [estimate.error(trajectory) for estimate in (estimates, replace(estimates, model=shifted))]
    position = model.positions(trajectory.q, TIMES)
    moved = motion_scale(position, position[0], 10.0)
    # squares add up: of the shape that the links would have by themselves the model is off by a hundredth of the bump
    assert told[1] ** 2 - told[0] ** 2 == pytest.approx(np.mean(bump**2) / moved**2, rel=0.05)
