"""Peaks of storms: coverage of the intervals, equivariance, labels, failed members, refusals."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import cablepod as cp
from cablepod.errors import SceneError

NAMES = ("mean", "mean_low", "mean_high", "quantile", "quantile_low", "quantile_high", "count")


def drawn(count, n, seed=5):
    return xr.DataArray(
        np.random.default_rng(seed).gumbel(loc=100.0, scale=3.0, size=(count, n)),
        dims=("set", "member"),
        name="tension_maximum",
        attrs={"units": "N", "long_name": "largest tension"},
    )


@pytest.mark.parametrize("n", [3, 10, 40])
@pytest.mark.parametrize("level", [0.5, 0.9])
def test_intervals_hold_the_true_values_as_often_as_they_say(n, level):
    sets = 4000
    result = cp.extremes.peaks(drawn(sets, n), level=level, probability=0.78)
    truth = {"mean": 100.0 + 3.0 * np.euler_gamma, "quantile": 100.0 - 3.0 * np.log(-np.log(0.78))}
    for name, value in truth.items():
        below, above = result[f"{name}_low"] > value, result[f"{name}_high"] < value
        # 4 standard errors of a frequency of 4000 sets, and one of the 20 000 samples that give the interval
        tail = 0.5 - 0.5 * level
        tolerance = np.sqrt(tail * (1.0 - tail)) * (4.0 / np.sqrt(sets) + 1.0 / np.sqrt(20_000))
        assert abs(float(below.mean()) - tail) < tolerance
        assert abs(float(above.mean()) - tail) < tolerance


def test_they_are_better_than_the_intervals_of_a_normal_distribution():
    from scipy import stats

    data = drawn(40_000, 5)
    result = cp.extremes.peaks(data)
    truth = 100.0 + 3.0 * np.euler_gamma
    half = stats.t.ppf(0.95, 4) * data.std("member", ddof=1) / np.sqrt(5)
    ours = float(((result.mean_low <= truth) & (truth <= result.mean_high)).mean())
    students = float((abs(data.mean("member") - truth) <= half).mean())
    assert abs(ours - 0.9) < 0.0075  # four standard errors, and that of the 20 000 samples
    assert students < 0.89


def test_peaks_of_gaussian_records_are_covered_too():
    # Davenport: largest of a record with 600 crossings, distribution exp(-600 exp(-x^2 / 2)), which is not quite Gumbel's
    rng = np.random.default_rng(2)

    def largest(*shape):
        return np.sqrt(-2.0 * np.log(-np.log(rng.random(shape)) / 600.0))

    truth = largest(1_000_000)
    root = np.sqrt(2.0 * np.log(600.0))
    assert truth.mean() == pytest.approx(root + np.euler_gamma / root, rel=1e-2)  # Davenport, to first order
    result = cp.extremes.peaks(xr.DataArray(largest(4000, 10), dims=("set", "member")))
    covered = float(((result.mean_low <= truth.mean()) & (truth.mean() <= result.mean_high)).mean())
    assert 0.87 < covered < 0.93


def test_estimates_by_hand():
    values = np.array([3.0, 1.0, 2.0])
    result = cp.extremes.peaks(xr.DataArray(values, dims="member"), probability=np.exp(-1.0))
    # second L-moment: half of the mean distance of two values, (1 + 1 + 2) / 3 / 2
    scale = 2.0 / 3.0 / np.log(2.0)
    assert float(result["mean"]) == pytest.approx(2.0, rel=1e-15)
    assert float(result["quantile"]) == pytest.approx(2.0 - np.euler_gamma * scale, rel=1e-14)  # the mode
    assert float(result["mean_low"]) < 2.0 < float(result["mean_high"])


def test_shift_and_scale_shift_and_scale_the_result():
    data = drawn(3, 8)
    one, other = cp.extremes.peaks(data), cp.extremes.peaks(7.0 * data - 2e5)
    for name in NAMES[:-1]:  # rounding of 2e5
        np.testing.assert_allclose(other[name], 7.0 * one[name] - 2e5, rtol=0, atol=1e-9, err_msg=name)


def test_variables_of_a_dataset_and_their_labels():
    data = drawn(3, 8)
    other = (data**2).rename("other").assign_attrs(units="N2")
    still = xr.DataArray(1.0)
    given = xr.Dataset({"tension_maximum": data, "other": other, "still": still, "failure": ("member", ["x"] * 8)})
    given = given.assign_coords(set=["a", "b", "c"], member=np.arange(8))
    result = cp.extremes.peaks(given)
    assert set(result.data_vars) == {f"{name}_{part}" for name in ("tension_maximum", "other") for part in NAMES}
    assert result["set"].values.tolist() == ["a", "b", "c"]
    assert "member" not in result.variables
    assert result.other_mean_low.attrs["units"] == "N2"
    assert result.tension_maximum_quantile.attrs["long_name"] == (
        "largest tension that is not exceeded with probability 0.78"
    )
    alone = cp.extremes.peaks(data)
    for part in NAMES:
        np.testing.assert_array_equal(result[f"tension_maximum_{part}"], alone[part])
    shuffled = cp.extremes.peaks(given.isel(member=[3, 1, 2, 0, 7, 5, 6, 4]).transpose("member", ...))
    xr.testing.assert_equal(shuffled.transpose(*result.dims), result)


def test_peaks_of_an_array_are_written_and_shown(tmp_path):
    peaks = cp.extremes.peaks(drawn(2, 5))
    cp.archive.write(peaks, tmp_path / "peaks.nc")
    assert np.array_equal(cp.archive.read(tmp_path / "peaks.nc")["mean"], peaks["mean"])
    assert cp.plots.report(peaks, tmp_path / "peaks.html").stat().st_size


def test_failed_members_are_left_out():
    data = drawn(3, 8)
    holed = data.copy(deep=True)
    holed[0, 2], holed[1, :6] = np.nan, np.nan
    result = cp.extremes.peaks(holed)
    assert result["count"].values.tolist() == [7, 2, 8]
    assert np.isnan(result["mean"][1])
    one = cp.extremes.peaks(data[0].drop_isel(member=2))
    for name in NAMES:
        np.testing.assert_array_equal(result[name][0], one[name])


def test_equal_peaks_have_no_scatter():
    result = cp.extremes.peaks(xr.DataArray(np.full(5, 7.0), dims="member"))
    assert all(float(result[name]) == 7.0 for name in NAMES[:-1])


def test_results_of_an_ensemble(soft, tmp_path):
    scenes = cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200.0, 300.0]}, members=4, seed=1)
    runs = cp.ensemble.run(scenes, tmp_path / "it", step=4e-3, outputs=("tension_extremes",))
    result = cp.extremes.peaks(runs[["tension_maximum"]])
    np.testing.assert_allclose(result.tension_maximum_mean, runs.tension_maximum.mean("member"), rtol=1e-14)
    assert result.attrs["id"]


@pytest.mark.parametrize(
    ("data", "options", "words"),
    [
        ([1.0, 2.0, 3.0], {}, "data: given .*allowed: a DataArray or a Dataset"),
        (drawn(2, 8), {"dim": "storm"}, "dim: given 'storm'; allowed: a dimension of the data, set, member"),
        (drawn(2, 2), {}, "data: given 2 peaks of tension_maximum along member; allowed: at least 3"),
        (drawn(2, 0), {}, "data: given 0 peaks"),
        (drawn(2, 8) * np.inf, {}, "data: given infinite values"),
        (drawn(2, 8).astype(str), {}, "data: given values of type <U"),
        (xr.Dataset({"failure": ("member", ["", ""])}), {}, "data: given a Dataset without a variable of numbers"),
        (drawn(2, 8), {"level": 1.0}, "level: given 1"),
        (drawn(2, 8), {"level": 0.0}, "level: given 0"),
        (drawn(2, 8), {"probability": 1.5}, "probability: given 1.5"),
        (drawn(2, 8).assign_coords(mean=1.0), {}, "data: given one with the coordinate mean"),
    ],
)
def test_what_is_no_sample_of_peaks_is_refused(data, options, words):
    with pytest.raises(SceneError, match=words):
        cp.extremes.peaks(data, **options)
