"""Periodic responses of the chain: its matrices, multipliers and bifurcations, and the study in small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import periodic.chain
import periodic.map
import periodic.run
import pytest

import cablepod as cp
from cablepod.periodic._members import model_of
from cablepod.periodic._solve import IN_PLANE, OUT_OF_PLANE

pytestmark = pytest.mark.slow  # its kernels are compiled

CASE = replace(periodic.run.CASES["guy"], ranks=(2, 3), pod_ranks=())


@pytest.fixture(scope="module")
def reduced():
    scene = CASE.scene()
    modes = cp.condensed.vibration_modes(scene, rank=3)
    return model_of(scene, modes, rank=None, order="leading", out_of_plane=True)[0]


@pytest.fixture(scope="module")
def orbit(reduced):
    """A chain of twelve links near resonance, and its orbit."""
    solver = periodic.chain.ChainSolver(periodic.chain.ChainModel.of(CASE.scene(), reduced, 12), 6)
    state, _, iterations = solver.at_frequency(solver.rest(12.3 / reduced.scales[0]))
    assert iterations > 0
    return solver, state


def test_the_chain_settles_on_its_orbit(orbit):
    solver, state = orbit
    omega = state.omega * solver.model.scales[0]
    scene = CASE.scene(omega).assign(damping_mass_proportional=0.5)
    period = 2.0 * np.pi / omega
    times = period * (round(40.0 / period) + np.arange(16) / 16)
    with pytest.warns(cp.VelocityJumpWarning):
        run = cp.chain.simulate(scene, links=12, times=times, tolerance=1e-5, outputs=("position",)).position.values
    model = periodic.chain.ChainModel.of(scene, solver.model, 12)
    damped = periodic.chain.ChainSolver(model, 6)
    found, _, _ = damped.at_frequency(damped.rest(state.omega))
    position = model.positions(found, 16)
    motion = np.abs(run - run.mean(axis=0)).max()
    # exp(-10) of the transient is left, and axial waves of 1e-4
    assert np.abs(run - position).max() < 1e-3 * motion


def test_multipliers_of_the_chain(orbit):
    solver, state = orbit
    mu = solver.multipliers(state)
    coordinates = 11 * 3
    assert mu.size == 2 * coordinates
    decay = np.exp(-solver.model.damping * 2.0 * np.pi / state.omega * coordinates)
    assert np.prod(mu).real == pytest.approx(decay, rel=1e-9)
    pairs = mu * np.exp(0.5 * solver.model.damping * 2.0 * np.pi / state.omega)
    assert np.abs(pairs[:, None] * pairs - 1.0).min(axis=1).max() < 1e-6


def test_determinants_change_sign_with_multipliers(orbit):
    solver, _ = orbit
    branch, events = periodic.chain.main_branch(solver, (12.0, 12.9))
    assert len(events) >= 4
    reference = None
    for point in branch.points[::3]:
        at = point.state
        mu = solver.multipliers(at, stride=32)
        n = 2 * 2 * 11
        products = [np.prod(1.0 - mu[n:]).real, np.prod(1.0 + mu[n:]).real, np.prod(1.0 + mu[:n]).real]
        found = [
            solver.determinant(at, which, first)[0]
            for which, first in ((OUT_OF_PLANE, 0.0), (OUT_OF_PLANE, 0.5), (IN_PLANE, 0.5))
        ]
        signs = np.sign(products) * found
        reference = signs if reference is None else reference
        assert np.array_equal(signs, reference), at.omega


def test_the_study_in_small(tmp_path, monkeypatch):
    monkeypatch.setattr(periodic.run, "TIMED_POINTS", 4)
    monkeypatch.setattr(periodic.run, "MODE_LINKS", 160)
    result = periodic.run.study(CASE, links=(20, 40))
    # extrapolated from two coarse chains, which err by 4 and 1 parts of 7e-3: the condensed model is the nearer one
    error = result["error_max"].values
    assert 3.0 < error[0] / error[1] < 5.0
    assert error[1] < 3e-3
    assert (error[2:] < 1e-3).all()
    assert (result["multiplier_time"] > result["orbit_time"]).all()
    assert list(result["family"].values) == ["chain"] * 2 + ["vibration modes"] * 2 + [
        "order exact", "order exact", "tauter modes",
    ]  # fmt: skip
    periodic.run.draw({"guy": result}, tmp_path / "periodic.png")
    assert (tmp_path / "periodic.png").stat().st_size > 5_000
    assert "| chain | 40 |" in periodic.run.table_of_times(result)
    assert "pitchfork out of the plane, 1" in periodic.run.table_of_frequencies(result)
    cp.archive.write(result, tmp_path / "periodic.nc")


def test_a_map_has_the_verdicts_of_chains_off_its_edges(tmp_path):
    result = periodic.map.study(24, 10, (24,), columns=4, points=4, integrations=2)
    agree, off = periodic.map.verdicts(result, 0)
    unstable = result["chain_growth"].values[0] > 0.0
    assert 4 <= unstable.sum() < unstable.size  # both verdicts
    # on this coarse grid two steps are 0.25 rad/s, far more than the chain errs by
    assert off.sum() > 12
    assert agree[off].all()
    run = np.isfinite(result["chain_left"].values[0])
    grows = (result["sample_growth"].values > 0.0).any(axis=1)
    assert np.array_equal(result["chain_left"].values[0][run] > 0.0, grows[run])
    assert run.sum() == 2
    assert "| 24 | 100.0 % of" in periodic.map.table(result)
    periodic.map.draw(result, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 5_000
    cp.archive.write(result, tmp_path / "map.nc")


def test_changes_nearby_are_those_within_some_steps():
    unstable = np.zeros((6, 9), dtype=bool)
    unstable[:, 5:] = True
    assert np.array_equal(periodic.map.changes_nearby(unstable, 2)[0], [False] * 3 + [True] * 4 + [False] * 2)
