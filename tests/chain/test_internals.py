"""The chain from inside: its solver and equations by closed forms, and what a run does where a kernel fails."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest
from scenes import along, pulled, scene_with
from suite import slow

import cablepod as cp
from cablepod.cable import _runs as cable_runs
from cablepod.chain import _implicit as implicit
from cablepod.chain import _kernels_banded as kernels_banded
from cablepod.chain import _kernels_explicit as kernel_explicit
from cablepod.chain import _kernels_implicit as kernel_implicit
from cablepod.chain import _kernels_links as kernels_links
from cablepod.chain import _start as chain_start
from cablepod.chain._explicit import ExplicitChainRun
from cablepod.chain._implicit import ImplicitChainRun
from cablepod.chain._kernels_arguments import Chain, Sizes
from cablepod.chain._lanes import LANES
from cablepod.discretisation._chain import chain_of
from cablepod.integrate import _march as march
from cablepod.integrate import _scheme as integrate_scheme
from cablepod.parameters._from_scene import parameters

SCHEMES = ("trapezoidal", "generalized_alpha", "energy_momentum")

# --- solver and equations ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dims", "lanes"), [(2, 1), (3, 1), (2, LANES), slow(3, LANES)])
@pytest.mark.parametrize("m", [1, 2, 3, 4, 7, 40])
@pytest.mark.parametrize("first", [0, 1])
def test_block_elimination_against_a_dense_solution(dims, m, first, lanes):
    rng = np.random.default_rng(m + dims)
    pairs = [(i, j) for i in range(dims) for j in range(i, dims)]

    def positive(count):
        """Make random positive matrices (count, dims, dims), as those of taut links."""
        half = rng.normal(size=(count, dims, dims))
        return half @ half.transpose(0, 2, 1)

    stiff, blocks = (np.stack([positive(m + 3 - k) for _ in range(lanes)], axis=-1) for k in (0, 1))
    stiff[[0, -1]] = 0.0
    blocks[:, range(dims), range(dims)] += 0.1
    right = rng.normal(size=(dims, m, lanes))
    particles, free = m + 2, slice(first, first + m)
    b = np.full((dims, particles, lanes), np.nan)
    b[:, free] = right
    s, block = (np.ascontiguousarray([matrices[:, i, j] for i, j in pairs]) for matrices in (stiff, blocks))
    matrix, carry = np.zeros((particles, 6, lanes)), np.zeros((2, 5 if dims == 2 else 9, lanes))
    (kernels_banded.solve_planar if dims == 2 else kernels_banded.solve_spatial)(
        (0,) * lanes, block.ravel(), s.ravel(), *b.reshape(dims, -1), matrix.ravel(), *carry.reshape(2, -1), first,
        first + m,
    )  # fmt: skip
    for lane in range(lanes):
        dense = np.zeros((m, dims, m, dims))
        for i in range(m):
            p = first + i
            dense[i, :, i] = stiff[p, ..., lane] + stiff[p + 1, ..., lane] + blocks[p, ..., lane]
            if i + 1 < m:
                dense[i, :, i + 1] = dense[i + 1, :, i] = -stiff[p + 1, ..., lane]
        exact = np.linalg.solve(dense.reshape(m * dims, -1), right[..., lane].T.ravel()).reshape(m, dims).T
        np.testing.assert_allclose(b[:, free, lane], exact, rtol=1e-9, atol=1e-11)
    assert np.isnan(b[:, :first]).all()
    assert np.isnan(b[:, first + m :]).all()


def test_the_difference_quotient_conserves_energy_in_every_case():
    def energy(square, law):
        over = max(math.sqrt(square) - 2.0, 0.0)
        return 0.5 * 3.0 * over**2 if law is None else 3.0 * 4.0 / 8.0 * (square / 4.0 - 1.0) ** 2

    none, (reach, value, slope) = np.empty(0), np.empty((3, 2))
    # taut, slack, slackening, tightening, hardly changing
    for size0, size1 in [(2.5, 3.0), (1.0, 1.5), (2.5, 1.0), (1.0, 2.5), (2.3, 2.3 + 1e-9), (2.0 - 1e-9, 2.0 + 1e-9)]:
        for inverse in (None, 0.25):
            law = none if inverse is None else np.array([inverse])
            chain = Chain(0, 2, np.array([3.0]), np.array([2.0]), law, *[none] * 6, none.reshape(0, 0))
            before, after = np.array([0.0, size0, 0.0, 0.0]), np.array([0.0, size1, 0.0, 0.0])
            kernels_links.conserving_links(Sizes((0,), (0, 0)), chain, before, after, reach, value, slope)
            gained = 0.5 * value[0] * (size1**2 - size0**2)
            assert gained == pytest.approx(energy(size1**2, inverse) - energy(size0**2, inverse), rel=1e-9, abs=1e-16)


@pytest.mark.parametrize("green", [False, True])
def test_the_reach_of_links_and_its_derivative(green):
    # a wrong derivative costs Newton's method only steps, so the rest itself does not show it
    rng = np.random.default_rng(3)
    length, stiffness, force = rng.uniform(1.0, 2.0, 5), rng.uniform(6.0, 12.0, 5), np.array([3.0, -4.0, 5.0])
    drops = np.cumsum(rng.normal(size=(5, 3)), axis=0)

    def at(force):
        return chain_start.reach_of_links(force - drops, length, stiffness, green=green)

    h, (reach, derivative) = 1e-5, at(force)
    differences = [(at(force + d)[0] - at(force - d)[0]) / (2 * h) for d in h * np.eye(3)]
    np.testing.assert_allclose(derivative, differences, rtol=1e-7, atol=1e-8)
    # from link to link, with the root of T = K xi (xi^2 - 1) / 2
    total = np.zeros(3)
    for pull, l0, k in zip(force - drops, length, stiffness, strict=True):
        tension = float(np.linalg.norm(pull))
        roots = np.roots([0.5, 0.0, -0.5, -tension / k]) if green else np.array([1.0 + tension / k])
        total += l0 * float(roots.real.max()) * pull / tension
    np.testing.assert_allclose(reach, total, rtol=1e-12)


@pytest.mark.parametrize("law", ["linear", "green"])
def test_the_energy_of_links(soft, law):
    stiffness, length = np.array([6e3, 8e2, 6e3]), np.array([2.0, 1.0, 3.0])  # EA [N], of links of their own
    chain = {"masses": [1.0] * 4, "stiffness": (stiffness / length).tolist(), "link_lengths": length.tolist()}
    own = {"cable": {"unstretched_length": 6.0}, "ends": {"lower": [0.0] * 3, "upper": [4.0, 3.0, 1.0]}, "chain": chain}
    bent = np.array(
        [[0.0, 0.0, 0.0], [2.1, 0.5, 0.3], [2.2, 0.9, 0.5], [4.9, 3.0, 1.0]]
    )  # the link in the middle is slack
    total = chain_of(parameters(cp.make_scene(soft))).total_length
    straight = np.linspace(0.0, 1.0, 9)[:, None] * [8.8, 6.6]
    for mapping, position, ea, l0 in ((own, bent, stiffness, length), (soft, straight, 2e4, np.full(8, total / 8))):
        xi = np.linalg.norm(np.diff(position, axis=0), axis=1) / l0
        density = 0.5 * np.maximum(xi - 1.0, 0.0) ** 2 if law == "linear" else (xi**2 - 1.0) ** 2 / 8.0
        found = chain_of(parameters(cp.make_scene(mapping)), law=law).strain_energy(position[None])[0]
        assert found == pytest.approx((ea * l0 * density).sum(), rel=1e-9)


# --- stability limits -------------------------------------------------------------------------------------------------


def test_the_stability_limit_is_where_it_is_predicted():
    # a straight, weightless chain: its highest axial frequency is the bound itself
    s = np.linspace(0, 1, 9)
    jitter = 1e-7 * np.where(np.arange(9) % 2, 1.0, -1.0)
    jitter[[0, -1]] = 0
    line = np.stack([4.0 * s + jitter, 0 * s], axis=1)
    scene = along(line, 3.9)
    chain = chain_of(parameters(scene))
    limit = chain.step_limit()
    link = 3.9 / 8
    assert limit == pytest.approx(2 / (2 * np.sqrt(1e3 / link**2) * np.cos(np.pi / 16)), rel=1e-12)

    def largest(step):
        run = ExplicitChainRun(chain, chain_start.start(chain), times=np.array([1000 * step]))
        return np.abs(run(1 / step).position - line).max()

    assert largest(0.999 * limit) < 1e-5
    with pytest.raises(cp.RunStopped, match="broke down"):
        largest(1.01 * limit)


@pytest.mark.parametrize("viscosity", [1e-3, 1e-2, 0.1])
def test_the_stability_limit_with_viscous_links(soft, viscosity):
    scene = scene_with(soft, motion={}, damping={"link_viscosity": viscosity})
    chain = chain_of(parameters(scene))
    limit = chain.step_limit()
    assert limit < 2 / chain.highest_frequency()
    start = chain_start.start(chain)
    start[1:-1:2] += 1e-9

    def largest(step):
        run = ExplicitChainRun(chain, start, times=np.array([3000 * step]))
        return np.abs(run(1 / step).position - start).max()

    assert largest(0.99 * limit) < 1e-8
    # beyond, the fastest axial mode grows until links go slack
    assert largest(1.05 * limit) > 1e-6


# --- runs that fail, and other threads ----------------------------------------------------------------------------------


def test_the_remedy_names_other_schemes_only(soft):
    about = chain_of(parameters(cp.make_scene(soft))), np.zeros((9, 2)), ""
    times = np.zeros(1)
    assert ImplicitChainRun(*about, "trapezoidal", times=times).remedy.startswith("scheme energy_momentum")
    assert ImplicitChainRun(*about, "energy_momentum", times=times).remedy == "a step half as long"
    assert "energy_momentum" not in cable_runs.ExplicitCableRun(*about, times=times).remedy


@pytest.mark.parametrize(("model", "what"), [(cp.chain, "links hold"), (cp.cable, "cable holds")])
def test_excessive_energy_is_warned_of(soft, monkeypatch, model, what):
    # with the limit set to what any motion holds
    monkeypatch.setattr(integrate_scheme, "ENERGY_WARN", 1e-9)
    with pytest.warns(
        cp.NotConvergedWarning, match=f"{what} up to .* times the energy that rest, loads and ends explain"
    ):
        model.simulate(cp.make_scene(soft), step=1e-3, **({} if model is cp.chain else {"elements": 2}))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_failed_substeps_leave_the_state_unchanged(soft, monkeypatch, scheme):
    plain = kernel_implicit.implicit

    def run(*, garble):
        tried = []

        def stubborn(*arguments):
            (step, *_), state, marks = arguments[5:8]
            if step in (pytest.approx(0.05), pytest.approx(0.025)):
                marks.failed[0] = True
            if step == pytest.approx(0.05):
                tried.append(step)
                return 1  # every step of the grid fails
            if step == pytest.approx(0.025):
                for values in state[: 2 if scheme == "energy_momentum" else 4]:
                    values += garble
                return 2  # and its second piece of two
            return plain(*arguments)

        monkeypatch.setattr(kernel_implicit, "implicit", stubborn)
        result = cp.chain.simulate(pulled(soft), scheme=scheme, step=0.05, times=[0.0, 0.5, 1.0])
        assert len(tried) == result.attrs["steps_cut"] == 20
        return result

    np.testing.assert_array_equal(run(garble=1e-3).position, run(garble=0.0).position)


@pytest.mark.parametrize("solved", [12, 0])
def test_a_run_that_fails_keeps_its_partial_result(soft, monkeypatch, solved):
    options = {"scheme": "trapezoidal", "step": 0.05, "outputs": ("position", "velocity")}
    whole = cp.chain.simulate(pulled(soft), **options)
    plain = implicit.ImplicitStepper.advance

    def until_then(self, start, steps):
        return plain(self, start, min(steps, solved - start)) if start < solved else 0

    monkeypatch.setattr(implicit.ImplicitStepper, "advance", until_then)
    monkeypatch.setattr(implicit.ImplicitStepper, "substep", lambda self, number: False)
    said = rf"^Newton's method did not converge, with the step cut into {march.MAX_SUBSTEPS}, at {0.05 * solved:g} s "
    with pytest.raises(
        cp.RunStopped, match=said + rf"\(trapezoidal, step 0\.05 s, step number {solved}\); try"
    ) as stopped:
        cp.chain.simulate(pulled(soft), **options)
    partial = stopped.value.partial
    if not solved:
        assert partial is None
        return
    assert partial.attrs["incomplete"] == "stopped at 0.6 s of 1 s"
    np.testing.assert_array_equal(partial.time, [0.0, 0.25, 0.5])
    for name in ("position", "velocity"):
        np.testing.assert_array_equal(partial[name], whole[name][:3])


@pytest.mark.parametrize("name", ["linear", "green"])
def test_other_threads_go_on_during_a_run(soft, monkeypatch, name):
    plain, inside = kernel_explicit.verlet, threading.Event()

    def watched(*arguments):
        inside.set()
        plain(*arguments)
        inside.clear()

    scene = cp.make_scene(soft)
    options = {"links": 8000, "law": name, "step": 1e-6, "times": [0.012]}  # one call of a few tenths of a second
    cp.chain.simulate(scene, **{**options, "times": [0.0]})
    monkeypatch.setattr(kernel_explicit, "verlet", watched)
    run = threading.Thread(target=cp.chain.simulate, args=(scene,), kwargs=options)
    run.start()
    inside.wait()
    waits = 0
    while inside.is_set():
        time.sleep(1e-3)
        waits += 1
    run.join()
    assert waits > 10
