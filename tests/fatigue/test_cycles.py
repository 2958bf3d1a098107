"""Rainflow cycles: the example of the standard, another implementation, closed forms, refusals."""

import json
import time
import warnings

import numpy as np
import pytest
import xarray as xr
from mast_scenes import small, windy

import cablepod as cp
from cablepod import provenance


def series_of(values, **coords):
    return xr.DataArray(np.asarray(values, dtype=float), dims="time", coords=coords, attrs={"units": "N"})


def test_the_example_of_the_standard():
    # ASTM E1049-85, figure 6: ranges 3, 4, 8, 9, 8, 6 as half cycles, 4 as a whole one
    cycles = cp.fatigue.ranges(series_of([-2, 1, -3, 5, -1, 3, -4, 4, -2]))
    assert cycles.cycle_range.values.tolist() == [3, 4, 4, 8, 9, 8, 6]
    assert cycles["cycle_count"].values.tolist() == [0.5, 0.5, 1, 0.5, 0.5, 0.5, 0.5]
    assert cycles.cycle_mean.values.tolist() == [-0.5, -1, 1, 1, 0.5, 0, 1]


def peer_series():
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.normal(size=2000))
    return [
        rng.normal(size=5000),
        walk,
        np.round(2.0 * walk),  # plateaus and equal ranges
        np.round(rng.normal(size=500)),
        np.repeat(rng.normal(size=50), 3),
        np.zeros(10),
        np.array([2.0, 1.0, 2.0]),
        1e-200 * rng.normal(size=50),
    ]


@pytest.mark.parametrize("number", range(8))
def test_cycles_equal_those_of_the_rainflow_package_in_every_digit(number):
    rainflow = pytest.importorskip("rainflow")
    values = peer_series()[number]
    if number == 7:
        values = (
            1e200 * values
        )  # its products of differences underflow; a power of ten is none of two, so of the same numbers
        cycles = cp.fatigue.ranges(series_of(values))
        small = cp.fatigue.ranges(series_of(1e-200 * values))
        assert np.array_equal(small.cycle_start, cycles.cycle_start)
    else:
        cycles = cp.fatigue.ranges(series_of(values))
    columns = (cycles[f"cycle_{name}"].values for name in ("range", "mean", "count", "start", "end"))
    assert list(zip(*(column.tolist() for column in columns), strict=True)) == list(
        rainflow.extract_cycles(values.tolist())
    )


def test_it_is_much_faster_than_the_rainflow_package():
    rainflow = pytest.importorskip("rainflow")
    values = np.cumsum(np.random.default_rng(1).normal(size=(20, 6000)), axis=1)
    series = xr.DataArray(values, dims=("member", "time"), coords={"time": 0.1 * np.arange(6000)})
    cp.fatigue.equivalent(series)
    plain = values[0].tolist()

    def fastest(call):
        seconds = []
        for _ in range(7):
            begin = time.process_time()
            call()
            seconds.append(time.process_time() - begin)
        return min(seconds)

    ratio = 20 * fastest(lambda: list(rainflow.extract_cycles(plain))) / fastest(lambda: cp.fatigue.equivalent(series))
    assert ratio > 10.0, ratio  # 25 to 40 on an idle machine, where the labels cost as much as the counting


def test_a_sine_has_one_cycle_a_period_of_twice_its_amplitude():
    instants = np.linspace(0.0, 50.0, 50 * 64 + 1)
    sine = series_of(3.0 * np.sin(2.0 * np.pi * 2.0 * instants), time=instants)
    cycles = cp.fatigue.ranges(sine)
    # 100 periods; beside the cycles between peaks, the first quarter and the last make half cycles
    assert float(cycles["cycle_count"].sum()) == pytest.approx(100.5)
    assert np.median(cycles.cycle_range) == pytest.approx(6.0, rel=1e-12)
    for exponent in (3, 4, 5):
        damage = 99.5 * 6.0**exponent + 0.5 * 2 * 3.0**exponent
        expected = (damage / (0.5 * 50.0)) ** (1.0 / exponent)
        found = cp.fatigue.equivalent(sine, exponent=exponent, frequency=0.5)
        assert float(found) == pytest.approx(expected, rel=1e-9)
        assert found.attrs["units"] == "N"


def test_many_samples_are_counted_as_few():
    # the history keeps the hash of a long series, and that of a short one
    samples = np.tile(np.random.default_rng(4).normal(size=3000), 40)
    few, many = (cp.fatigue.ranges(series_of(samples[:size])) for size in (3000, samples.size))
    for result, size in ((few, 3000), (many, samples.size)):
        told = json.loads(result.attrs["history_json"])[-1]["parameters"]["series"]
        assert told == provenance.to_json(samples[None, :size])
    # of forty times the same, the cycles of which all but those at the joints are closed
    assert float(many.cycle_count.sum()) == pytest.approx(40.0 * float(few.cycle_count.sum()), rel=1e-2)
    plain = cp.fatigue.ranges(series_of(samples[:3000], time=0.1 * np.arange(3000), link=40))
    assert plain.cycle.values.tolist() == list(range(1, plain.sizes["cycle"] + 1))
    assert plain.sel(cycle=slice(2, 4)).sizes["cycle"] == 3
    assert int(plain.link) == 40


def test_two_samples_are_half_a_cycle():
    cycles = cp.fatigue.ranges(series_of([1.0, 3.0]))
    assert cycles.cycle_range.values.tolist() == [2.0]
    assert cycles["cycle_count"].values.tolist() == [0.5]


def test_members_links_and_failed_members():
    rng = np.random.default_rng(5)
    values = rng.normal(size=(3, 400, 2))
    values[1, :, 1] = np.linspace(0.0, 1.0, 400)  # a single half cycle
    values[2] = np.nan
    coords = {"time": np.linspace(0.0, 40.0, 400), "link": [1, 40], "member": [0, 1, 2]}
    series = xr.DataArray(values, dims=("member", "time", "link"), coords=coords)
    cycles, damage = cp.fatigue.ranges(series), cp.fatigue.equivalent(series)
    assert cycles.cycle_range.dims == ("member", "link", "cycle")
    assert damage.dims == ("member", "link")
    for member in range(2):
        for link in (1, 40):
            part = {"member": member, "link": link}
            alone = cp.fatigue.ranges(series.sel(part))
            count = alone.sizes["cycle"]
            assert np.array_equal(cycles.cycle_range.sel(part)[:count], alone.cycle_range)
            assert not cycles["cycle_count"].sel(part)[count:].any()
            assert np.isnan(cycles.cycle_range.sel(part)[count:]).all()
            assert float(damage.sel(part)) == float(cp.fatigue.equivalent(series.sel(part)))
    assert np.isnan(damage.sel(member=2)).all()
    assert not cycles["cycle_count"].sel(member=2).any()


def test_the_equivalent_range_scales_with_the_series():
    instants = np.linspace(0.0, 60.0, 601)
    values = np.random.default_rng(2).normal(size=601)
    small, large = (float(cp.fatigue.equivalent(series_of(f * values, time=instants))) for f in (1.0, 1e90))
    assert large == pytest.approx(1e90 * small, rel=1e-12)


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: cp.fatigue.ranges([1.0, 2.0]), "series"),
        (lambda: cp.fatigue.ranges(series_of([1, 2, 3]), dim="tim"), "dim"),
        (lambda: cp.fatigue.ranges(series_of([1.0])), "series"),
        (lambda: cp.fatigue.ranges(series_of([1.0, np.nan, 2.0])), "series"),
        (lambda: cp.fatigue.ranges(series_of([1.0, np.inf, 2.0])), "series"),
        (lambda: cp.fatigue.ranges(xr.DataArray(["a", "b"], dims="time")), "series"),
        (lambda: cp.fatigue.ranges(xr.DataArray(np.ones((2, 3)), dims=("cycle", "time"))), "series"),
        (lambda: cp.fatigue.ranges(series_of([1, 2, 3], cycle_mean=4.0)), "series"),
        (lambda: cp.fatigue.equivalent(series_of([1, 2, 3])), "series"),
        (lambda: cp.fatigue.equivalent(series_of([1, 2, 3], time=[0.0, 2.0, 1.0])), "series"),
        (lambda: cp.fatigue.equivalent(series_of([1, 2], time=[0.0, 1.0]), exponent=0), "exponent"),
        (lambda: cp.fatigue.equivalent(series_of([1, 2], time=[0.0, 1.0]), frequency=-1.0), "frequency"),
    ],
)
def test_wrong_calls_are_refused(call, key):
    with pytest.raises(cp.SceneError, match=f"^{key}: given .*; allowed: "):
        call()


def test_miners_sum_by_hand():
    # 2 whole cycles and 2 half ones of range 4, and a half one of range 2
    series = series_of([0, 4, 0, 4, 0, 4, 2])
    cycles = cp.fatigue.ranges(series)
    expected = float((cycles.cycle_count * (cycles.cycle_range / 8.0) ** 3).sum()) / 1000.0
    assert expected == pytest.approx((2.5 * 0.5**3 + 0.5 * 0.25**3) / 1000.0, rel=1e-14)
    damage = cp.fatigue.damage(series, slope=3, reference_range=8.0, reference_cycles=1000)
    assert float(damage) == pytest.approx(expected, rel=1e-14)
    assert damage.attrs["units"] == "1"


def test_miners_sum_is_that_of_the_equivalent_range():
    values = np.random.default_rng(4).normal(size=(3, 400))
    time = 0.1 * np.arange(400)
    series = xr.DataArray(values, dims=("link", "time"), coords={"time": time, "link_number": ("link", [4, 5, 6])})
    damage = cp.fatigue.damage(series, slope=4.5, reference_range=2.0)
    same = cp.fatigue.equivalent(series, exponent=4.5, frequency=2.0)
    np.testing.assert_allclose(damage, 2.0 * time[-1] * (same / 2.0) ** 4.5 / 2e6, rtol=1e-13)
    assert damage["link_number"].values.tolist() == [4, 5, 6]
    series[1] = np.nan
    assert np.isnan(cp.fatigue.damage(series, slope=4.5, reference_range=2.0)).values.tolist() == [False, True, False]


@pytest.mark.parametrize("key", ["slope", "reference_range", "reference_cycles"])
def test_a_curve_without_a_positive_number_is_refused(key):
    options = {"slope": 3, "reference_range": 8.0, "reference_cycles": 1000} | {key: 0.0}
    with pytest.raises(cp.SceneError, match=f"^{key}: given 0"):
        cp.fatigue.damage(series_of([0, 4, 0]), **options)


def test_the_duration_is_in_seconds():
    time = np.arange(0.0, 100.0, 0.25)
    series = xr.DataArray(np.sin(2.0 * np.pi * time), dims="time", coords={"time": ("time", time, {"units": "second"})})
    known = cp.fatigue.equivalent(series)
    for start in (np.datetime64(0, "ms"), np.timedelta64(0, "ms")):
        dated = series.assign_coords(time=start + (1e3 * time).astype("timedelta64[ms]"))
        assert float(cp.fatigue.equivalent(dated)) == pytest.approx(float(known), rel=1e-12)
    for units, factor in (("ms", 1e3), ("min", 1.0 / 60.0)):
        other = series.assign_coords(time=("time", factor * time, {"units": units}))
        with pytest.raises(cp.SceneError, match=rf"series: given a coordinate time in {units}; allowed: time \[s\]"):
            cp.fatigue.equivalent(other)


@pytest.mark.parametrize("time", [[0.0, 1.0, np.inf], [0.0, 2.0, 1.0], [0, 1, 1], [np.nan, 1.0, 2.0], ["a", "b", "c"]])
@pytest.mark.parametrize("name", ["ranges", "equivalent", "damage"])
def test_samples_that_are_not_in_order_are_refused(name, time):
    """Cycles depend on the order; a duration has no end."""
    series = xr.DataArray([0.0, 4.0, 0.0], dims="time", coords={"time": time})
    options = {"slope": 3.0, "reference_range": 1.0} if name == "damage" else {}
    with pytest.raises(
        cp.SceneError, match=r"^series: given a coordinate time (that does not rise|of type <U1); allowed: "
    ):
        getattr(cp.fatigue, name)(series, **options)


def test_cycles_of_dates_begin_and_end_at_seconds_from_the_first():
    series = series_of([0, 4, 1, 3])
    dated = series.assign_coords(
        time=np.datetime64("2020-01-01") + (1000 * series.time.values).astype("timedelta64[ms]")
    )
    found = cp.fatigue.ranges(dated)
    np.testing.assert_array_equal(found.cycle_start, cp.fatigue.ranges(series).cycle_start)
    assert found.cycle_end.attrs["units"] == "s"


def test_instants_that_cut_cycles_are_told_of():
    """Of masts, where every second instant misses more than 8 % of the equivalent range."""
    scene, ranges = small(windy), []
    for interval in (0.02, 0.2, 1.0):
        members = cp.ensemble.design(
            scene.assign(time_duration=40.0, time_interval=interval), {"wind.speed": [18.0, 20.0]}, members=2
        )
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", cp.CoarseWarning)
            (batch,) = cp.ensemble.batches(members, model="mast")
        told = [str(item.message) for item in caught if "cuts cycles" in str(item.message)]
        ranges.append(float(batch.fatigue_range.max()))
        assert bool(told) == (interval > 0.1)
    assert ranges[0] > 1.02 * ranges[1] > 1.2 * ranges[2]
