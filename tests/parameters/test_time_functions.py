"""Time functions: values against formulas, rates against finite differences, smoothness where it is promised."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from cablepod.parameters._time_functions import TimeFunction

SAMPLES = np.linspace(0.0, 12.0, 41)
RECORD = 0.3 * np.sin(0.9 * SAMPLES) + 0.02 * SAMPLES**2

KINDS = {
    "one_minus_cosine": {"amplitude": -0.07, "angular_frequency": 1.3},
    "harmonic": {"amplitude": 0.4, "angular_frequency": 1.7, "phase": 0.6},
    "ramp": {"amplitude": -2.5, "duration": 9.0},
    "polynomial": {"coefficients": np.array([0.3, -0.2, 0.05, 0.001])},
    "file": {"time": SAMPLES, "value": RECORD},
}
RAMPED = [kind for kind in KINDS if kind != "ramp"]
FORMULAS = {
    "one_minus_cosine": lambda t: -0.07 * (1 - np.cos(1.3 * t)),
    "harmonic": lambda t: 0.4 * (np.sin(1.7 * t + 0.6) - np.sin(0.6)),
    "ramp": lambda t: -2.5 * (6 * (t / 9) ** 5 - 15 * (t / 9) ** 4 + 10 * (t / 9) ** 3),
    "polynomial": lambda t: 0.3 * t - 0.2 * t**2 + 0.05 * t**3 + 0.001 * t**4,
    "file": CubicSpline(SAMPLES, RECORD),
}


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def test_values_follow_the_formula(kind):
    time = np.linspace(0.0, 9.0, 37)
    np.testing.assert_allclose(TimeFunction(kind, KINDS[kind])(time), FORMULAS[kind](time), rtol=1e-13, atol=1e-14)


def test_rates_are_those_of_the_values(kind):
    function = TimeFunction(kind, KINDS[kind])
    # Inside the intervals of the record, where the spline is one cubic; elsewhere the places do not matter.
    time = 0.5 * (SAMPLES[:-1] + SAMPLES[1:])[1:29]
    # Sixth-order central differences.  Truncation: h^6/140 times the 7th derivative of value or rate, at most 28 (0.4 *
    # 1.7^8, harmonic): 2e-13 at h = 0.01.  Rounding: some 2e-16 * 4 (the largest value) / h = 1e-13.
    h, offsets, weights = 0.01, np.array([1, 2, 3]), np.array([45, -9, 1]) / 60.0
    for derivative in (0, 1):
        ahead, behind = (np.array([function(time + sign * k * h, derivative) for k in offsets]) for sign in (1, -1))
        np.testing.assert_allclose(function(time, derivative + 1), weights @ (ahead - behind) / h, rtol=0, atol=1e-12)


def test_the_function_is_twice_continuously_differentiable(kind):
    function = TimeFunction(kind, KINDS[kind])
    knots = {"file": SAMPLES[1:-1], "ramp": np.array([0.0, 9.0])}.get(kind, np.array([1.0]))
    for derivative in range(3):
        jump = function(knots + 1e-9, derivative) - function(knots - 1e-9, derivative)
        # 2e-9 s times the next rate, at most about 3 here (60 * 2.5 / 9^3 for the ramp)
        assert np.abs(jump).max() < 1e-8


def test_every_kind_begins_at_zero(kind):
    values = {**KINDS[kind], "value": RECORD + 0.5} if kind == "file" else KINDS[kind]
    function = TimeFunction(kind, values)
    assert function(0.0) == 0.0
    assert function.offset == {"file": 0.5, "harmonic": 0.4 * np.sin(0.6)}.get(kind, 0.0)


def test_the_record_of_a_load_keeps_its_value_at_zero():
    values = {**KINDS["file"], "value": RECORD + 0.5}
    for ramp in (0.0, 7.0):
        factor = TimeFunction("file", values | {"ramp": ramp}, keeps_start=True)
        assert factor(0.0) == 0.5
    # the ramp multiplies the change, half of it in the middle
    time = SAMPLES[10]
    assert TimeFunction("file", values | {"ramp": 2 * time}, keeps_start=True)(time) == pytest.approx(
        0.5 + 0.5 * RECORD[10], rel=1e-14
    )


@pytest.mark.parametrize("kind", RAMPED)
def test_a_ramp_multiplies_the_function(kind):
    plain, ramped = TimeFunction(kind, KINDS[kind]), TimeFunction(kind, KINDS[kind] | {"ramp": 4.0})
    time = np.linspace(0.0, 9.0, 37)
    s = np.minimum(time / 4.0, 1.0)
    np.testing.assert_allclose(ramped(time), (6 * s**5 - 15 * s**4 + 10 * s**3) * plain(time), rtol=1e-12, atol=1e-14)
    assert [ramped(0.0, derivative) for derivative in range(3)] == [0.0, 0.0, 0.0]
    for derivative in range(3):  # after the ramp the function itself
        np.testing.assert_array_equal(ramped(time[16:], derivative), plain(time[16:], derivative))


@pytest.mark.parametrize("kind", RAMPED)
@pytest.mark.parametrize("keeps_start", [False, True])
def test_rates_with_a_ramp_are_those_of_the_values(kind, keeps_start):
    function = TimeFunction(kind, KINDS[kind] | {"ramp": 6.1}, keeps_start)
    # places inside the intervals of the record, and not within 3 h of the end of the ramp
    time = 0.5 * (SAMPLES[:-1] + SAMPLES[1:])[1:29]
    time = time[np.abs(time - 6.1) > 0.05]
    # truncation of the sixth-order differences: h^6/140 times the 7th derivative, at most some 100 here: 1e-12; rounding 1e-13
    h, offsets, weights = 0.01, np.array([1, 2, 3]), np.array([45, -9, 1]) / 60.0
    for derivative in (0, 1):
        ahead, behind = (np.array([function(time + sign * k * h, derivative) for k in offsets]) for sign in (1, -1))
        np.testing.assert_allclose(function(time, derivative + 1), weights @ (ahead - behind) / h, rtol=0, atol=3e-12)


@pytest.mark.parametrize("kind", RAMPED)
def test_a_ramped_function_is_twice_continuously_differentiable(kind):
    function = TimeFunction(kind, KINDS[kind] | {"ramp": 4.1})
    for derivative in range(3):
        jump = function(np.array([1e-9, 4.1 + 1e-9]), derivative) - function(np.array([-1e-9, 4.1 - 1e-9]), derivative)
        assert np.abs(jump).max() < 1e-8  # 2e-9 s times the next rate, at most about 3


@pytest.mark.parametrize("kind", RAMPED)
@pytest.mark.parametrize("ramp", [0.0, 3.7])
@pytest.mark.parametrize("steps_per_second", [100.0, 64.0 / 0.3])
def test_tables_are_those_of_the_function(kind, ramp, steps_per_second):
    function = TimeFunction(kind, KINDS[kind] | {"ramp": ramp})
    derivatives = (0, 2, 1)
    whole = function.all_at_steps(0, 1023, steps_per_second, derivatives, 0.3)
    time = np.arange(1024) / steps_per_second
    for row, derivative in zip(whole, derivatives, strict=True):
        expected = function(time, derivative) + (0.0 if derivative else 0.3)
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-13)
    # blocks have the same bits before, in and after the end of the ramp, where they begin at a multiple of COMMON_STEPS
    for start in (256, 512, 768):
        block = function.all_at_steps(start, 255, steps_per_second, derivatives, 0.3)
        np.testing.assert_array_equal(block, whole[:, start : start + 256])


def test_a_ramp_is_a_time_scale(kind):
    if kind in RAMPED:
        plain, short = TimeFunction(kind, KINDS[kind]), TimeFunction(kind, KINDS[kind] | {"ramp": 0.1})
        assert short.shortest_time_scale == 0.1
        assert TimeFunction(kind, KINDS[kind] | {"ramp": 0.0}).shortest_time_scale == plain.shortest_time_scale
        assert TimeFunction(kind, KINDS[kind] | {"ramp": 1e3}).shortest_time_scale == min(
            plain.shortest_time_scale, 1e3
        )
        # the samples resolve the range of values during the ramp and after it
        time = np.linspace(0.0, 9.0, 20001)
        samples = TimeFunction(kind, KINDS[kind] | {"ramp": 3.0}).sampling_times(9.0)
        ramped = TimeFunction(kind, KINDS[kind] | {"ramp": 3.0})
        assert np.abs(ramped(samples)).max() == pytest.approx(np.abs(ramped(time)).max(), rel=2e-3)


@pytest.mark.parametrize("phase", [-2.0, 0.0, 0.1, np.pi / 2, 3.0])
def test_a_harmonic_motion_begins_at_zero_exactly(phase):
    function = TimeFunction("harmonic", {"amplitude": 1.0, "angular_frequency": 3.0, "phase": phase})
    assert function(0.0) == 0.0
    assert function(0.0, 1) == pytest.approx(3.0 * np.cos(phase), rel=1e-15)


def test_a_ramp_rests_before_and_after():
    ramp = TimeFunction("ramp", KINDS["ramp"])
    for time, value in ((-5.0, 0.0), (0.0, 0.0), (9.0, -2.5), (1e6, -2.5)):
        assert [ramp(time, derivative) for derivative in range(3)] == [value, 0.0, 0.0]
    assert ramp(4.5) == pytest.approx(-1.25, rel=1e-15)


def test_a_record_passes_through_its_samples():
    function = TimeFunction("file", KINDS["file"])
    np.testing.assert_allclose(function(SAMPLES), RECORD, rtol=0, atol=1e-15)
    assert function.begin == 0.0
    assert function.end == 12.0


def test_a_record_of_a_smooth_motion_is_interpolated_to_fourth_order():
    errors = []
    for count in (81, 161):
        samples = np.linspace(0.0, 10.0, count)
        function = TimeFunction("file", {"time": samples, "value": np.sin(samples)})
        errors.append(np.abs(function(np.linspace(0, 10, 999)) - np.sin(np.linspace(0, 10, 999))).max())
    assert 12 < errors[0] / errors[1] < 20


def test_a_record_of_a_cubic_is_that_cubic():
    uneven = np.cumsum([0.0, 0.3, 0.5, 0.2, 0.9, 0.4, 0.6])
    function = TimeFunction("file", {"time": uneven, "value": uneven**3 - 2 * uneven})
    time = np.linspace(0, uneven[-1], 50)
    np.testing.assert_allclose(function(time), time**3 - 2 * time, rtol=0, atol=1e-13)
    np.testing.assert_allclose(function(time, 2), 6 * time, rtol=0, atol=1e-12)


def test_only_a_record_begins_and_ends(kind):
    function = TimeFunction(kind, KINDS[kind])
    assert (function.begin, function.end) == ((0.0, 12.0) if kind == "file" else (-np.inf, np.inf))


def test_the_shape_of_the_times_is_kept(kind):
    function = TimeFunction(kind, KINDS[kind])
    for derivative in range(3):
        assert np.shape(function(1.0, derivative)) == ()
        assert function(np.ones((2, 3)), derivative).shape == (2, 3)
        assert function([1, 2], derivative).shape == (2,)
