"""Trained test functions: independent ODE solution, identities, gain of the training, refusals."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import xarray as xr
from references.condensed_ode import Reference
from scenes import LENGTHS, everything, full_modes
from scipy.integrate import solve_ivp
from scipy.optimize import root
from suite import slow

import cablepod as cp
from cablepod import examples as shipped
from cablepod.condensed._coefficients import ORDERS
from cablepod.condensed._runs import SCHEMES, SCHEMES_OF
from cablepod.oblique import _train as oblique
from cablepod.pod import _normal as pod_normal

EVEN = [1.0] * 8
POSITION = ("position",)


def with_tests_of(modes, rank, tests, out_of_plane=None):
    """Return the first modes with test functions."""
    result = modes.isel(mode=slice(0, rank)).assign_attrs(trained_second_order=1)
    result["test_function"] = (("mode", "particle"), tests)
    if out_of_plane is not None:
        result["test_function_out_of_plane"] = (("mode", "particle"), out_of_plane)
    return result


def skewed(modes, rank, suffix="", *, seed=5, size=0.1):
    """Return test functions: the modes plus random multiples of all modes."""
    shape = modes[f"mode_shape{suffix}"].transpose("mode", "particle").values
    return shape[:rank] + size * np.random.default_rng(seed).uniform(-1.0, 1.0, (rank, len(shape))) @ shape


# --- the equations --------------------------------------------------------------------------------------------------


class Oblique(Reference):
    """Petrov-Galerkin projection of the link equations on shapes and test functions (r, inner)."""

    def __init__(self, scene, lengths, shapes, tests, *, order):
        super().__init__(scene, lengths, order=order)
        self.shapes, self.tests = shapes, tests
        self.mass = self.p.mass * self.share[1:-1]
        self.matrix = self.masses[0] if order == "leading" else np.diag(self.mass)

    def second_rates(self, t, q, v):
        w, speed = (q @ self.shapes)[:, None], (v @ self.shapes)[:, None]
        matrix = self.matrix
        force = matrix @ self.accelerate(t, w)[0][:, 0]
        if self.order == "inertial":
            _, c, e, _ = self.frame(t)
            lever, rate = self.lever(w, speed, self.forces(t) @ e, c)
            force = force - lever.T @ (self.mass * (rate @ speed.ravel()))
            matrix = matrix + lever.T @ (self.mass[:, None] * lever)
        return np.linalg.solve(self.tests @ matrix @ self.shapes.T, self.tests @ force) - self.damping * v

    def deflections(self, times):
        def unbalanced(q):
            return self.tests @ self.matrix @ self.accelerate(0.0, (q @ self.shapes)[:, None], moving=False)[0][:, 0]

        project = np.linalg.solve((self.tests * self.mass) @ self.shapes.T, self.tests * self.mass)
        q = root(unbalanced, project @ super().rest()[:, 0], tol=1e-14).x
        rates = self.p.end_positions(np.zeros(1), 1)[0]
        line = rates[0] + np.outer(self.s[1:-1] / self.s[-1], rates[1] - rates[0])
        impulse = -self.mass * (line @ self.frame(0.0)[3][0])
        v = np.linalg.solve(self.tests @ self.matrix @ self.shapes.T, self.tests @ impulse)

        def rate(t, state):
            return np.concatenate([state[q.size :], self.second_rates(t, state[: q.size], state[q.size :])])

        run = solve_ivp(
            rate, (0.0, times[-1]), np.concatenate([q, v]), method="DOP853", t_eval=times, rtol=1e-11, atol=1e-12
        )
        return run.y[: q.size].T @ self.shapes


#: Orders with their schemes.
PAIRS = [(order, scheme) for order, schemes in SCHEMES_OF.items() for scheme in schemes]


@pytest.mark.parametrize("order", [ORDERS[0], *map(slow, ORDERS[1:])])
def test_projected_link_equations(soft, order):
    scene = cp.make_scene({**everything(soft), "chain": {"links": len(LENGTHS)}})
    modes, times = full_modes(), np.array([0.4, 0.8])
    tests = skewed(modes, 2)
    shapes = modes["mode_shape"].values[:2]
    reference = Oblique(scene, LENGTHS, shapes[:, 1:-1], tests[:, 1:-1], order=order).deflections(times)
    few = with_tests_of(modes, 2, tests)
    coarse, fine = (
        cp.condensed.simulate(
            scene, few, order=order, scheme=SCHEMES[0], times=times, step=h, outputs=POSITION
        ).position
        for h in (1 / 4000, 1 / 8000)
    )
    # Richardson extrapolation, as in tests/condensed: the error is of fourth order
    real = pod_normal.deflections(((4.0 * fine - coarse) / 3.0).values)[0]
    np.testing.assert_allclose(real[:, 1:-1], reference, rtol=0, atol=1e-8)
    options = {"rank": 2, "order": order, "scheme": SCHEMES[0], "times": times, "step": 1 / 8000, "outputs": POSITION}
    galerkin = cp.condensed.simulate(scene, modes, **options)
    assert np.abs(pod_normal.deflections(galerkin.position.values)[0][:, 1:-1] - reference).max() > 1e-4


@pytest.mark.parametrize(("order", "scheme"), [PAIRS[0], *(slow(*pair) for pair in PAIRS[1:])])
@pytest.mark.parametrize("dims", [2, slow(3)])
def test_modes_as_test_functions_are_the_galerkin_model(soft, order, scheme, dims):
    scene = cp.make_scene({**everything(soft, dims), "chain": {"links": len(LENGTHS)}})
    modes = full_modes(dims=dims).isel(mode=slice(0, 3))
    mixing = np.array([[1.0, 0.5, 0.0], [0.2, 1.0, -0.3], [0.0, 2.0, 1.0]])  # only the span counts
    out = mixing.T @ modes["mode_shape_out_of_plane"].values if dims == 3 else None
    with_tests = with_tests_of(modes, 3, mixing @ modes["mode_shape"].values, out)
    options = {
        "order": order,
        "scheme": scheme,
        "step": 1 / 500,
        "times": [0.5, 1.0],
        "outputs": ("position", "velocity"),
    }
    one, other = (cp.condensed.simulate(scene, item, **options) for item in (modes, with_tests))
    for name in ("position", "velocity", "amplitude"):
        # Newton's method has a tolerance of 1e-11 of the amplitudes, a sag of 0.1 m; rates err by 500 times as much
        np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-9 if name != "velocity" else 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("dims", [2, 3])
def test_explicit_and_implicit_steps_agree(soft, order, dims):
    """The tangents of Newton's method are accurate enough."""
    scene = cp.make_scene({**everything(soft, dims), "chain": {"links": len(LENGTHS)}})
    modes = full_modes(dims=dims)
    with_tests = with_tests_of(modes, 3, skewed(modes, 3), skewed(modes, 3, "_out_of_plane") if dims == 3 else None)
    both = []
    for scheme in SCHEMES_OF[order]:
        runs = [
            cp.condensed.simulate(
                scene, with_tests, order=order, scheme=scheme, times=[0.8], step=h, outputs=POSITION
            ).position
            for h in (1 / 1000, 1 / 2000)
        ]
        both.append(((4.0 * runs[1] - runs[0]) / 3.0).values)
    for other in both[1:]:
        np.testing.assert_allclose(other, both[0], rtol=0, atol=1e-7)


@pytest.mark.slow
def test_quadrature_with_test_functions_agrees_with_the_links(soft):
    scene = cp.make_scene({**soft, "chain": {"links": 40}})
    sines = np.sin(np.pi * np.outer(np.arange(1.0, 5.0), np.linspace(0.0, 1.0, 41)))
    modes = full_modes([1.0] * 40).isel(mode=slice(0, 2))
    modes["mode_shape"] = (("mode", "particle"), sines[:2] + 0.1 * sines[2:])
    few = with_tests_of(modes, 2, sines[:2] - 0.05 * sines[2:])
    options = {"scheme": SCHEMES[0], "step": 1 / 500, "times": [1.0, 2.0], "outputs": POSITION}
    for order in ("exact", "inertial"):
        links, points, more = (
            cp.condensed.simulate(scene, few, order=order, quadrature=item, **options).position.values
            for item in (None, 12, 20)
        )
        plain = cp.condensed.simulate(scene, modes, order=order, **options).position.values
        # both use splines through the same particles; 12 points are exact to degree 21
        assert np.abs(points - more).max() < 0.05 * np.abs(points - links).max()
        # links are a second-order rule, which errs in the slopes of the third sine by (3 pi / 40)^2 / 12, half a per cent
        assert np.abs(points - links).max() < 0.1 * np.abs(plain - links).max()


def test_members_use_the_test_functions(soft):
    scene = cp.make_scene({**soft, "chain": {"links": 8}})
    modes = full_modes(EVEN)
    few = with_tests_of(modes, 2, skewed(modes, 2))
    many = scene.assign(cable_top_tension=("member", [300.0, 400.0]))
    together = cp.condensed.simulate(many, few, step=0.002, times=[0.5, 1.0], outputs=("tension_extremes",))
    for i in range(2):
        alone = cp.condensed.simulate(
            many.isel(member=i), few, step=0.002, times=[0.5, 1.0], outputs=("tension_extremes",)
        )
        np.testing.assert_allclose(together["amplitude"].isel(member=i), alone["amplitude"], rtol=0, atol=1e-12)


def test_test_functions_lower_the_step_limit(soft):
    scene = cp.make_scene({**soft, "chain": {"links": 8}})
    modes = full_modes(EVEN)
    few = with_tests_of(modes, 3, skewed(modes, 3, size=0.3))
    limit = cp.condensed.simulate(scene, few, scheme=SCHEMES[0], step=1e-4, times=[0.01], outputs=()).attrs[
        "step_limit"
    ]
    plain = cp.condensed.simulate(scene, modes, rank=3, scheme=SCHEMES[0], step=1e-4, times=[0.01], outputs=()).attrs[
        "step_limit"
    ]
    assert limit < plain
    with pytest.raises(cp.SceneError, match="step"):
        cp.condensed.simulate(scene, few, scheme=SCHEMES[0], step=1.01 * limit)


# --- training -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def example():
    """Example 3 for 30 s: scene, chain, modes."""
    scene = shipped.scene("example3")
    chain = cp.chain.simulate(scene, times=np.arange(301) * 0.1)
    return scene, chain, cp.pod.decompose(chain, layout="normal", rank=5)


@pytest.fixture(scope="module")
def trained(example):
    return cp.oblique.train(*example, rank=3, iterations=8)


def deflection_error(run, chain):
    one, other = (pod_normal.deflections(item["position"].values)[0] for item in (run, chain))
    moved = chain["position"].values - chain["position"].values[0]
    motion = np.sqrt((moved**2).sum(axis=-1).mean(axis=-1)).max()
    return np.sqrt(((one - other) ** 2).mean(axis=1)).max() / motion


def test_reported_errors_are_those_of_runs(example, trained):
    scene, chain, modes = example
    times = chain["time"].values
    for which, attribute in ((trained, "training_error"), (modes, "training_error_galerkin")):
        run = cp.condensed.simulate(scene, which, rank=3, times=times, tolerance=1e-7)
        # up to the time error of the training runs, 1e-5 of the motion
        assert deflection_error(run, chain) == pytest.approx(trained.attrs[attribute], abs=3e-5)
    real = pod_normal.deflections(chain["position"].values)[0]
    few = modes["mode_shape"].values[:3]
    moved = chain["position"].values - chain["position"].values[0]
    motion = np.sqrt((moved**2).sum(axis=-1).mean(axis=-1)).max()
    left = np.sqrt(((real - real @ few.T @ few) ** 2).mean(axis=1)).max() / motion
    assert trained.attrs["projection_error"] == pytest.approx(left, rel=1e-9)


def test_reported_errors_with_uneven_links(soft):
    """Modes that are orthonormal in mass are not orthonormal in the norm of the error."""
    scene = cp.make_scene({**soft, "chain": {"link_lengths": [1.0, 3.0, 0.5, 2.0, 1.0, 2.5]}})
    chain = cp.chain.simulate(scene, times=np.arange(21) * 0.1)
    modes = cp.pod.decompose(chain, layout="normal")
    made = cp.oblique.train(scene, chain, modes, rank=2, iterations=1)
    run = cp.condensed.simulate(scene, modes, rank=2, times=chain["time"].values, tolerance=1e-7, outputs=POSITION)
    assert made.attrs["training_error_galerkin"] == pytest.approx(deflection_error(run, chain), rel=1e-3)


def test_training_halves_the_error(trained):
    attrs = trained.attrs
    assert attrs["training_error"] < 0.5 * attrs["training_error_galerkin"]
    assert attrs["projection_error"] < attrs["training_error"] < 3.0 * attrs["projection_error"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "rank"), [("example2", 4), ("example4", 3)])
def test_the_error_approaches_that_of_the_projection(name, rank):
    """Fitted over the whole run at once, Example 4 ends at 4.1 times the projection; in Example 2 errors are below 1e-5."""
    scene = shipped.scene(name)
    chain = cp.chain.simulate(scene, times=np.arange(301) * 0.1, tolerance=1e-6)
    modes = cp.pod.decompose(chain, layout="normal", rank=8)
    attrs = cp.oblique.train(scene, chain, modes, rank=rank, order="exact").attrs
    assert attrs["projection_error"] < attrs["training_error"] < 1.2 * attrs["projection_error"]
    assert attrs["training_error_galerkin"] > 5.0 * attrs["projection_error"]


def test_part_of_a_training_case_is_a_shorter_run(example):
    scene, chain, modes = example
    options = {"rank": 2, "order": "leading", "law": "linear", "quadrature": None}
    whole = oblique._training_case(0, scene, chain, modes, options, 1e-5)
    part, short = (
        whole.first_part(0.25),
        oblique._training_case(0, scene, chain.isel(time=slice(76)), modes, options, 1e-5),
    )
    assert part.times[-1] == 7.5
    assert part.scheme_and_step == whole.scheme_and_step  # errors of parts and whole belong to one model
    short.__dict__["scheme_and_step"] = whole.scheme_and_step
    tests = (skewed(modes, 2),)
    np.testing.assert_allclose(
        part.errors(tests) * part.motion, short.errors(tests) * short.motion, rtol=1e-12, atol=1e-15
    )
    assert whole.first_part(1.0).times.size == whole.times.size
    assert whole.first_part(1e-6).times.size == 2  # the shortest run


@pytest.mark.slow
def test_the_gain_holds_after_the_training_time(example, trained):
    """Trained on 30 s, half of the error over 90 s."""
    scene, _, modes = example
    times = np.arange(901) * 0.1
    chain = cp.chain.simulate(scene, times=times)
    with_tests, plain = (
        deflection_error(cp.condensed.simulate(scene, which, rank=3, times=times), chain) for which in (trained, modes)
    )
    assert with_tests < 0.5 * plain


@pytest.mark.slow
def test_the_error_estimate_agrees_with_the_training_error(example, trained):
    scene, chain, modes = example
    estimates = [
        cp.condensed.simulate(scene, which, rank=3, times=chain["time"].values).attrs["error_estimate"]
        for which in (trained, modes)
    ]
    real = [trained.attrs["training_error"], trained.attrs["training_error_galerkin"]]
    for estimate, error in zip(estimates, real, strict=True):
        assert error / 5.0 < estimate < 5.0 * error


def test_several_scenes_are_trained_together(example):
    scene, chain, modes = example
    other = scene.assign(cable_top_tension=4000.0)
    second = cp.chain.simulate(other, times=chain["time"].values)
    both = cp.oblique.train([scene, other], [chain, second], modes, rank=2, iterations=3)
    alone = [cp.oblique.train(*pair, modes, rank=2, iterations=1) for pair in ((scene, chain), (other, second))]
    assert both.attrs["training_error_galerkin"] == pytest.approx(
        max(item.attrs["training_error_galerkin"] for item in alone), rel=1e-9
    )
    assert both.attrs["training_error"] <= both.attrs["training_error_galerkin"]
    inside = cp.condensed.simulate(scene.assign(cable_top_tension=3900.0), both, times=chain["time"].values)
    assert inside.attrs["outside_training"] == 0.0


def test_training_in_space(soft):
    scene = cp.make_scene({**everything(soft, 3), "chain": {"links": 8}})
    chain = cp.chain.simulate(scene, times=np.arange(41) * 0.1)
    modes = cp.pod.decompose(chain, layout="normal", rank=2)
    made = cp.oblique.train(scene, chain, modes, iterations=3, tolerance=1e-4)
    assert made["test_function_out_of_plane"].dims == ("mode", "particle")
    assert made.attrs["training_error"] <= made.attrs["training_error_galerkin"]
    run = cp.condensed.simulate(scene, made, times=chain["time"].values)
    real = [pod_normal.deflections(item["position"].values, 1) for item in (run, chain)]
    moved = chain["position"].values - chain["position"].values[0]
    motion = np.sqrt((moved**2).sum(axis=-1).mean(axis=-1)).max()
    error = np.sqrt(((real[0] - real[1]) ** 2).sum(axis=0).mean(axis=1)).max() / motion
    assert error == pytest.approx(made.attrs["training_error"], abs=3e-4)


def test_inputs_are_unchanged_and_files_are_complete(example, trained, tmp_path):
    scene, chain, modes = example
    before = [item.copy(deep=True) for item in example]
    again = cp.oblique.train(scene, chain, modes, rank=3, iterations=8)
    for one, other in zip(example, before, strict=True):
        xr.testing.assert_identical(one, other)
    xr.testing.assert_identical(again, trained)
    path = tmp_path / "trained.nc"
    cp.archive.write(trained, path)
    back = cp.archive.read(path)
    runs = [cp.condensed.simulate(scene, item, times=[2.0], step=0.01) for item in (trained, back)]
    np.testing.assert_array_equal(runs[0]["position"], runs[1]["position"])


def test_test_functions_are_valid_for_their_quadrature(example):
    """The quadrature error of rough test functions is part of the training."""
    scene, chain, modes = example
    few = cp.oblique.train(scene, chain, modes, rank=4, order="exact", quadrature=12, iterations=2, tolerance=1e-4)
    options = {"order": "exact", "times": chain["time"].values, "tolerance": 1e-5}
    run = cp.condensed.simulate(scene, few, quadrature=12, outputs=POSITION, **options)
    assert deflection_error(run, chain) == pytest.approx(few.attrs["training_error"], abs=2e-4)
    for other in (None, 16):
        with pytest.raises(cp.SceneError, match=r"quadrature: given .*; allowed: 12 points"):
            cp.condensed.simulate(scene, few, quadrature=other, **options)
    shape = modes["mode_shape"].values
    with pytest.raises(cp.SceneError, match="quadrature: given 6; allowed: more points"):
        cp.condensed.simulate(scene, with_tests_of(modes, 1, shape[:1] + shape[4:5]), quadrature=6, **options)


def test_progress_ends_at_one(example):
    fractions: list[float] = []
    cp.oblique.train(*example, rank=1, iterations=1, progress=fractions.append)
    assert fractions[-1] == 1.0
    assert all(0.0 < part <= 1.0 for part in fractions)


# --- warnings and refusals ------------------------------------------------------------------------------------------


def test_growing_vibrations_cause_a_warning(soft):
    """A test function that reverses the sign of a modal stiffness makes the equilibrium unstable."""
    soft["cable"]["top_tension"], soft["gravity"] = 2000.0, 0.01  # negligible sag
    scene = cp.make_scene({**soft, "chain": {"links": 40}})
    modes = full_modes([1.0] * 40)
    first, fifth = np.sin(np.pi * np.outer([1.0, 5.0], np.linspace(0.0, 1.0, 41)))
    modes = modes.isel(mode=slice(0, 1))
    modes["mode_shape"] = (("mode", "particle"), (first + 0.25 * fifth)[None])
    with warnings.catch_warnings():
        warnings.simplefilter("error", cp.OutOfRangeWarning)
        still = cp.condensed.simulate(scene, modes, step=0.001, times=[0.15], outputs=POSITION)
    assert "growth_over_run" not in still.attrs
    # the fifth sine is 25 times as stiff: 1 - 0.25 * 0.25 * 25 < 0
    few = with_tests_of(modes, 1, (first - 0.25 * fifth)[None])
    with pytest.warns(cp.OutOfRangeWarning, match="growth_over_run"):
        run = cp.condensed.simulate(scene, few, step=0.001, times=[0.15], outputs=POSITION)
    # 2000 N over a stretch of 1.1, 1 kg/m, 10 / 1.1 m unstretched; squared frequencies of 40 links go with sin(k pi / 80)^2
    stiffer = np.sin(5.0 * np.pi / 80.0) ** 2 / np.sin(np.pi / 80.0) ** 2
    square = (1.0 - 0.0625 * stiffer) / (1.0 - 0.0625) * 2000.0 / 1.1 * (np.pi * 1.1 / 10.0) ** 2
    assert run.attrs["growth_over_run"] == pytest.approx(0.15 * np.sqrt(-square), rel=2e-3)
    with pytest.raises(cp.RunStopped, match=r"vibrations about rest grow by exp\("):
        cp.condensed.simulate(scene, few, step=0.001, times=[4.0], outputs=POSITION)


def test_other_options_than_the_trained_ones_are_refused(example, trained):
    scene, _, modes = example
    for options, match in (
        ({"rank": 2}, "rank: given 2; allowed: 3"),
        ({"order": "exact"}, 'order: given .exact.; allowed: "leading"'),
    ):
        with pytest.raises(cp.SceneError, match=match):
            cp.condensed.simulate(scene, trained, **options)
    with pytest.raises(cp.SceneError, match="rank: given 2; allowed: 3"):
        cp.condensed.simulate(scene, trained.isel(mode=slice(0, 2)))
    with pytest.raises(cp.SceneError, match="do not tell the modes apart"):
        cp.condensed.simulate(scene, with_tests_of(modes, 2, np.ones((2, 41))))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"iterations": 0}, "iterations: given 0"),
        ({"tolerance": -1.0}, "tolerance: given -1"),
        ({"rank": 9}, "rank: given 9"),
        ({"order": "slow"}, "order: given"),
        ({"scenes": []}, "trajectories: given 1"),
        ({"scenes": ["a"]}, r"scenes\[0\]: given a str; allowed: what make_scene gives"),
        ({"trajectories": "other ends"}, "trajectories: given .ends"),
        ({"trajectories": "other particles"}, "trajectories: given .6 particles"),
    ],
)
def test_training_refuses_by_key(example, change, match):
    scene, chain, modes = example
    given = {"scenes": scene, "trajectories": chain, "modes": modes, **change}
    if given["trajectories"] == "other ends":
        given["trajectories"] = chain.assign(position=chain["position"] + 0.5)
    elif given["trajectories"] == "other particles":
        given["trajectories"] = cp.chain.simulate(scene, links=5, times=[0.0, 1.0])
    options = {key: value for key, value in given.items() if key not in ("scenes", "trajectories", "modes")}
    with pytest.raises(cp.SceneError, match=match):
        cp.oblique.train(given["scenes"], given["trajectories"], given["modes"], **options)
