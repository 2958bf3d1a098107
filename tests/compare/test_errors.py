"""The error of a run against a truth, by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import cablepod as cp


def trajectory(position, times, sigma=None, length=10.0):
    n = position.shape[1]
    sigma = np.linspace(0, 1, n) if sigma is None else sigma
    return xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position)},
        coords={"time": times, "arc_length": ("particle", length * sigma), "coordinate": ["x", "y"]},
    )


def test_the_error_by_hand():
    times = np.arange(3.0)
    truth = np.zeros((3, 4, 2))
    truth[..., 0] = np.arange(4)
    truth[1, 1, 1], truth[2, 2, 1] = 3.0, -4.0  # largest rms displacement sqrt(16 / 4) = 2
    run = truth.copy()
    run[2, :, 0] += [0.0, 0.3, 0.4, 0.0]  # rms sqrt(0.25 / 4) = 0.25
    result = cp.compare.errors(trajectory(run, times), trajectory(truth, times))
    np.testing.assert_allclose(result.error, [0.0, 0.0, 0.125], rtol=1e-14)
    assert float(result.error_max) == pytest.approx(0.125)
    assert float(result.error_rms) == pytest.approx(0.125 / np.sqrt(3))
    assert float(result.displacement_scale) == pytest.approx(2.0)


def test_where_nothing_moves_the_chord_counts():
    times = np.arange(2.0)
    truth = np.zeros((2, 3, 2))
    truth[..., 0] = [0.0, 1.0, 4.0]
    run = truth + np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.0]])
    result = cp.compare.errors(trajectory(run, times), trajectory(truth, times))
    np.testing.assert_allclose(result.error, np.sqrt(0.09 / 3) / 4.0, rtol=1e-14)


def test_the_truth_is_interpolated_in_sigma():
    times = np.arange(4.0)
    fine = np.linspace(0, 1, 81)
    coarse = np.sort(np.r_[0, np.random.default_rng(3).uniform(size=9), 1])

    def wave(s):
        return np.stack([10 * s + 0 * times[:, None], np.sin(np.pi * s) * (1 + times[:, None])], axis=-1)

    # another length: sigma counts, not arc length
    result = cp.compare.errors(trajectory(wave(coarse), times, coarse, 11.0), trajectory(wave(fine), times, fine))
    # cubic splines of a sine on 80 intervals: (pi/80)^4 5/384 ~ 3e-8
    assert float(result.error_max) < 5e-8


def test_instants_must_be_common():
    a = trajectory(np.zeros((3, 4, 2)), np.arange(3.0))
    with pytest.raises(cp.SceneError, match="3 instants; allowed: the instants of the truth, 2"):
        cp.compare.errors(a, a.isel(time=slice(2)))
    with pytest.raises(cp.SceneError, match=r"instant 1 s; allowed: the instants of the truth, here 1\.5 s"):
        cp.compare.errors(a, a.assign_coords(time=[0.0, 1.5, 2.0]))
    with pytest.raises(cp.SceneError, match="without position"):
        cp.compare.errors(a, a.drop_vars("position"))
    with pytest.raises(cp.SceneError, match="truth: position is not finite"):
        cp.compare.errors(a, a.where(a.time < 2))


def test_members_are_compared_one_by_one(soft):
    runs = []
    for tension in (200.0, 240.0):
        scene = cp.make_scene({**soft, "cable": {**soft["cable"], "top_tension": tension}})
        runs.append([cp.chain.simulate(scene, step=h) for h in (2e-3, 1e-3)])
    joined = [
        xr.concat(pair, "member", combine_attrs="override", coords="different", compat="equals")
        for pair in zip(*runs, strict=True)
    ]
    result = cp.compare.errors(*joined)
    assert result.error.dims == ("member", "time")
    for i, (a, b) in enumerate(runs):
        np.testing.assert_array_equal(result.error[i], cp.compare.errors(a, b).error)


def test_members_are_paired_by_their_labels(soft):
    members = cp.ensemble.design(
        cp.make_scene(soft), {"cable.top_tension": [200, 240, 280]}, members=3, sampling="list"
    )
    run = cp.chain.simulate(members, step=1e-3, times=[0.0, 1.0])
    result = cp.compare.errors(run, run.isel(member=[2, 0, 1]))
    assert not result.error.any()
    assert np.array_equal(result.cable_top_tension, run.cable_top_tension)
    with pytest.raises(cp.SceneError, match=r"^run: given the members \[1, 2\]; allowed: those of the truth, \[0, 1\]"):
        cp.compare.errors(run.isel(member=[1, 2]), run.isel(member=[0, 1]))
    one = run.isel(member=1)
    for pair in ((one, run), (run, one), (one, one)):
        assert float(cp.compare.errors(*pair).error_max) == 0.0
    for other in (run.isel(member=[0, 2]), run.isel(member=0)):
        with pytest.raises(cp.SceneError, match=r"^run and truth: given the members .*; allowed: the same; try: isel"):
            cp.compare.errors(one, other)
    assert cp.compare.errors(one.drop_vars("member"), run).error_max.values[1] == 0.0
