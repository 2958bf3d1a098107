"""One meaning of rest: in the mean wind of the scene, beside still air; against strings, chains and scenes without wind."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import xarray as xr
from printed import printed
from references.links import chain_frequencies
from suite import slow
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp

ACROSS = {"speed": 28.0, "direction": [0.0, 0.0, 1.0]}
#: Numbers of a summary that depend on the air.
AT_REST = (
    "stretched_length", "tension_lower", "tension_upper", "horizontal_force", "stress", "strain", "sag", "sag_over_chord",
    "irvine_parameter", "angular_frequency_in_plane", "angular_frequency_out_of_plane", "frequency_in_plane",
    "frequency_out_of_plane",
)  # fmt: skip


def guy(wind=None, **tables):
    """The guy, with the wind and further tables."""
    mapping = {**copy.deepcopy(GUY), **tables}
    return cp.make_scene(mapping if wind is None else {**mapping, "wind": wind})


def of_length(length):
    """The cable of the guy with an unstretched length [m] in place of the tension."""
    return {**{key: value for key, value in GUY["cable"].items() if key != "top_tension"}, "unstretched_length": length}


def planar(wind=None, **tables):
    """The guy in its plane."""
    ends = {name: place[:2] for name, place in GUY["ends"].items()}
    return guy(None if wind is None else {**wind, "direction": [1.0, 0.0]}, ends=ends, **tables)


def string(rest: xr.Dataset) -> float:
    """First frequency of a taut string with the mean tension of a rest [Hz]; the guys have a mass of 1 kg/m."""
    return math.sqrt(float(rest.tension.mean())) / (2.0 * math.hypot(20.4, 57.7))


# --- frequencies ----------------------------------------------------------------------------------------------------------


def test_frequencies_in_wind_have_the_tension_of_the_drag():
    scene = guy(ACROSS)
    found = cp.cable.frequencies(scene, count=6, law="linear")
    hertz, out = found.angular_frequency.values / (2.0 * math.pi), found.out_of_plane_share.values > 0.5
    # a string has neither the slope of the blown guy nor its variation of tension: 0.6 % of the length, a fiftieth of the tension
    assert hertz[out][0] == pytest.approx(string(cp.cable.rest(scene, law="linear")), rel=1e-3)
    coarse, fine = (chain_frequencies(scene, links) / (2.0 * math.pi) for links in (40, 80))
    # Richardson leaves the square of (pi k / n)^2 / 24; the elements are converged to 1e-5
    assert hertz == pytest.approx((4.0 * fine - coarse) / 3.0, rel=2e-5)
    assert hertz[0] > 1.05 * cp.cable.frequencies(guy()).angular_frequency.values[0] / (2.0 * math.pi)


def test_the_plane_of_the_modes_contains_the_drag():
    # the drag turns the plane of chord and load: with the weight alone half of the modes would be neither in it nor across it
    share = cp.cable.frequencies(guy(ACROSS), count=2, law="linear").out_of_plane_share.values
    assert share == pytest.approx([1.0, 0.0], abs=0.02)


def test_frequencies_in_wind_do_not_refine_towards_the_points_of_the_profile():
    # the profile is linear between points: to 1e-8 the elements would go up to 128, which takes 20 s
    found = cp.cable.frequencies(guy(WIND))
    assert found.attrs["elements"] <= 24
    assert found.attrs["space_error_estimate"] <= 1e-5


# --- the air of a result ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wind", "air"),
    [
        (None, "still air"),
        (WIND, "mean wind of 25 m/s at 10 m above the ground"),
        (KAIMAL, "mean wind of 25 m/s at 10 m above the ground"),
        ({**WIND, "profile": "uniform"}, "mean wind of 25 m/s"),
        ({**WIND, "ramp": 3.0}, "still air, from which the wind rises"),
        ({**WIND, "speed": 0.0}, "still air"),
    ],
    ids=["none", "steady", "gusts", "uniform", "ramp", "speed 0"],
)
def test_results_at_rest_say_in_which_air(wind, air):
    scene = guy(wind)
    results = [
        cp.chain.rest(scene), cp.cable.rest(scene, elements=4), cp.cable.frequencies(scene, count=1), cp.summary(scene),
        cp.condensed.vibration_modes(scene, rank=2),
    ]  # fmt: skip
    assert [result.attrs["air"] for result in results] == [air] * len(results)


def test_results_without_wind_say_so():
    sway = {"upper": {"x": {"kind": "harmonic", "amplitude": 1e-3, "angular_frequency": 3.0}}}
    scene = guy(motion=sway, damping={"mass_proportional": 0.1})
    assert cp.periodic.orbit(scene, cp.condensed.vibration_modes(scene, rank=1)).attrs["air"] == "still air"
    assert cp.rigid.rest(guy(cable=of_length(61.3))).attrs["air"] == "still air"


def test_a_record_is_named(tmp_path):
    cp.wind.field(guy(KAIMAL, time={"duration": 2.0, "interval": 0.1})).to_netcdf(tmp_path / "field.nc")
    wind = {**WIND, "turbulence": {"record": str(tmp_path / "field.nc")}}
    scene = guy(wind, time={"duration": 2.0, "interval": 0.1})
    assert cp.chain.rest(scene).attrs["air"] == "mean wind of the record"
    numbers = cp.summary(scene)
    assert float(numbers.tension_upper) == pytest.approx(
        float(cp.cable.rest(scene, law="linear").tension_upper), rel=1e-4
    )
    assert float(numbers.tension_upper_still_air) == pytest.approx(15000.0, rel=1e-9)


def test_members_in_different_air_say_so():
    scenes = cp.ensemble.design(guy(WIND), {"wind.speed": [0.0, 20.0]}, members=2, sampling="grid")
    for result in (cp.chain.rest(scenes, links=8), cp.summary(scenes)):
        assert result.attrs["air"].startswith("that of each member")
    same = cp.ensemble.design(guy(WIND), {"cable.top_tension": [1e4, 2e4]}, members=2, sampling="grid")
    for result in (cp.chain.rest(same, links=8), cp.summary(same)):
        assert result.attrs["air"] == "mean wind of 25 m/s at 10 m above the ground"


def test_rigid_links_refuse_wind_at_rest_too():
    with pytest.raises(cp.SceneError, match=r"^wind: given 25 m/s; allowed: none here; try: chain\.rest$"):
        cp.rigid.rest(guy(WIND))


# --- summary ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [guy, planar], ids=["space", "plane"])
def test_a_summary_has_still_air_and_mean_wind_side_by_side(make):
    strong = {"cable": {**GUY["cable"], "breaking_strength": 2e5}}
    calm, windy, rising = (
        cp.summary(make(**strong)),
        *(cp.summary(make({**WIND, "ramp": r}, **strong)) for r in (0.0, 3.0)),
    )
    rest = cp.cable.rest(make(WIND, **strong), law="linear", points=401)
    assert not any(str(name).endswith(("_still_air", "_mean_wind")) for name in calm)
    for name in (*AT_REST, "utilisation"):
        assert "still air" not in calm[name].attrs["long_name"]
        for numbers, air in ((windy, "mean_wind"), (rising, "still_air")):
            np.testing.assert_array_equal(numbers[f"{name}_still_air"], calm[name], err_msg=name)
            np.testing.assert_array_equal(numbers[f"{name}_mean_wind"], windy[f"{name}_mean_wind"], err_msg=name)
            np.testing.assert_array_equal(numbers[name], numbers[f"{name}_{air}"], err_msg=name)
            assert numbers[f"{name}_still_air"].attrs["long_name"].endswith(", in still air")
            assert numbers[f"{name}_mean_wind"].attrs["long_name"].endswith(", in the mean wind")
    # the deflection of the summary is converged to 1e-5, that of the elements to 1e-8
    assert float(windy.tension_upper_mean_wind) == pytest.approx(float(rest.tension_upper), rel=1e-5)
    assert float(windy.stretched_length_mean_wind) == pytest.approx(float(rest.stretched_length), rel=1e-7)
    assert float(windy.utilisation_mean_wind) == pytest.approx(float(rest.tension_upper) / 2e5, rel=1e-5)
    position = rest.position.values
    along = (position[-1] - position[0]) / np.linalg.norm(position[-1] - position[0])
    off = position - position[0]
    sag = np.linalg.norm(off - np.outer(off @ along, along), axis=1).max()
    assert float(windy.sag_mean_wind) == pytest.approx(sag, rel=2e-5)
    taut = string(rest)
    assert float(windy.frequency_out_of_plane_mean_wind[0]) == pytest.approx(taut, rel=1e-3)
    assert float(windy.frequency_in_plane_mean_wind[1]) == pytest.approx(2.0 * taut, rel=2e-3)


def test_numbers_in_a_weak_wind_are_those_in_still_air():
    # the formulas of shapes of elements and of the catenary, at 1 mm/s
    numbers = cp.summary(guy({**WIND, "speed": 1e-3}))
    for name in AT_REST:
        np.testing.assert_allclose(numbers[f"{name}_mean_wind"], numbers[f"{name}_still_air"], rtol=1e-5, err_msg=name)
        assert not np.array_equal(numbers[f"{name}_mean_wind"], numbers[f"{name}_still_air"]), name


def test_the_frequencies_of_both_planes_are_those_in_space():
    scene = guy(ACROSS, point_load=[{"arc_length": 0.4, "force": [100.0, -300.0, 50.0]}])
    numbers = cp.summary(scene)
    both = np.concatenate([numbers[f"angular_frequency_{plane}"].values for plane in ("in_plane", "out_of_plane")])
    modes = cp.cable.frequencies(scene, count=6, law="linear").angular_frequency.values
    np.testing.assert_allclose(np.sort(both), modes, rtol=1e-5)


def test_members_in_wind_have_the_numbers_of_their_scenes():
    varied = {"wind.speed": [0.0, 30.0], "wind.ramp": [0.0, 4.0]}
    scenes = cp.ensemble.design(guy({**WIND, "ramp": 0.0}), varied, members=4, sampling="grid")
    numbers = cp.summary(scenes)
    for member in range(4):
        single = cp.summary(scenes.isel(member=member, drop=True))
        xr.testing.assert_equal(numbers.isel(member=member).drop_vars(set(numbers.coords) - {"mode"}), single)


UNLIKE = {
    "slack": {"cable": of_length(63.0)},
    "ice": {"ice": {"thickness": 0.015, "density": 700.0}},
    "point load": {"point_load": [{"arc_length": 0.3, "force": [0.0, -500.0, 0.0], "kind": "harmonic", "amplitude": 1.0,
                                   "angular_frequency": 2.0, "phase": 1.0}]},
    "weightless": {"gravity": 0.0},
    "other start": {"initial": {"top_tension": 16000.0}},
}  # fmt: skip


@pytest.mark.parametrize(
    ("make", "name"),
    [*((guy, name) for name in UNLIKE), (planar, "slack"), *(slow(planar, name) for name in list(UNLIKE)[1:])],
)
def test_unlike_scenes_have_a_summary_in_wind(make, name):
    tables = copy.deepcopy(UNLIKE[name])
    if make is planar and "point_load" in tables:
        tables["point_load"][0]["force"] = [0.0, -500.0]
    scene = make(WIND, **tables)
    numbers, rest = cp.summary(scene), cp.cable.rest(scene, law="linear")
    assert float(numbers.tension_upper) == pytest.approx(float(rest.tension_upper), rel=1e-4)
    hertz = np.concatenate([numbers.frequency_in_plane, numbers.frequency_out_of_plane])
    assert (hertz > 0.0).all()


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_a_free_end_has_no_frequencies_in_wind_either(end):
    numbers = cp.summary(guy(WIND, ends={**GUY["ends"], "free": end}))
    assert float(numbers.tension_upper) > 16000.0
    for name in ("in_plane", "out_of_plane"):
        assert np.isnan(numbers[f"frequency_{name}"]).all()


def test_wind_along_a_weightless_cable_leaves_no_plane():
    level = {"lower": [0.0, 20.0, 0.0], "upper": [60.0, 20.0, 0.0]}
    numbers = cp.summary(guy(WIND, ends=level, gravity=0.0))
    np.testing.assert_allclose(numbers.frequency_in_plane, numbers.frequency_out_of_plane, rtol=1e-6)
    assert float(numbers.frequency_in_plane[0]) == pytest.approx(
        float(numbers.frequency_in_plane_still_air[0]), rel=1e-6
    )


def test_a_wide_arc_needs_more_elements():
    ends = {"lower": [0.0, 100.0, 0.0], "upper": [20.4, 157.0, 0.0]}
    scene = guy(WIND, ends=ends, cable=of_length(200.0))
    # that of the chain has an error of the second order in its links, a fourth with twice as many
    coarse, fine = (float(cp.chain.rest(scene, links=links).tension_upper) for links in (100, 200))
    assert float(cp.cable.rest(scene, law="linear").tension_upper) == pytest.approx(2.0 * fine - coarse, rel=1e-3)


def test_notes_are_about_the_tension_in_the_mean_wind():
    cable = {**GUY["cable"], "breaking_strength": 2e4}
    calm, windy, rising = (
        str(cp.summary(guy(wind, cable=cable)).note.values)
        for wind in (None, {**WIND, "speed": 60.0}, {**WIND, "speed": 60.0, "ramp": 2.0})
    )
    assert "at rest" not in calm
    for note in (windy, rising):
        assert "a tension at rest in the mean wind over the breaking strength of 1.38" in note


def test_a_wind_without_rest_is_told_beside_still_air():
    # light and slack, with the wind along the chord: the drag and the shape do not settle
    level = {"lower": [0.0, 100.0, 0.0], "upper": [60.0, 100.0, 0.0]}
    tables = {"ends": level, "cable": {**of_length(61.0), "density": 8.0}}
    with pytest.raises(cp.SceneError, match=r"^wind: no rest found in this wind"):
        cp.summary(guy({**WIND, "speed": 30.0}, **tables))
    numbers = cp.summary(guy({**WIND, "speed": 30.0, "ramp": 5.0}, **tables))
    assert np.isnan(numbers.tension_upper_mean_wind)
    assert float(numbers.tension_upper) == float(numbers.tension_upper_still_air) > 0.0


# --- the start of a run is not rest ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "initial", [{"top_tension": 16000.0}, {"points": [[0.0, 0.0, 0.0], [20.4, 57.7, 0.0]]}], ids=["tension", "points"]
)
@pytest.mark.parametrize("wind", [None, WIND], ids=["still air", "wind"])
def test_rest_does_not_depend_on_the_start_of_a_run(initial, wind):
    # a straight line with a free end once gave a tension of 0, another tension an error estimate of 1e-4
    for ends in (GUY["ends"], {**GUY["ends"], "free": "lower"}):
        rest, started = (
            cp.cable.rest(guy(wind, ends=ends, **tables), elements=8) for tables in ({}, {"initial": initial})
        )
        xr.testing.assert_allclose(started, rest, rtol=1e-12)
        assert started.attrs["space_error_estimate"] == rest.attrs["space_error_estimate"]


# --- texts ----------------------------------------------------------------------------------------------------------------------


def test_check_prints_both_side_by_side(tmp_path):
    numbers = cp.summary(guy(WIND))
    lines = [line for line in printed(tmp_path, {**GUY, "wind": WIND}).splitlines() if line.startswith("  ")]
    assert lines[0].split() == ["rest", *["mean", "wind", "of", "25", "m/s", "at", "10", "m", "above", "the", "ground"]]
    table = {line[:34].strip(): line[34:].strip() for line in lines if "plane" not in line}
    upper = float(numbers.tension_upper)
    assert table["tension, upper end"] == f"15 kN in still air, {1e-3 * upper:.5g} kN in the mean wind"
    for plane in ("in_plane", "out_of_plane"):
        found = [line for line in lines if line.startswith(f"  first frequencies {plane.replace('_', ' ')}")]
        for line, ending in zip(found, ("still_air", "mean_wind"), strict=True):
            hertz = [float(value) for value in line[34:].partition(" Hz")[0].split()]
            assert hertz == pytest.approx(numbers[f"frequency_{plane}_{ending}"].values, rel=1e-4)
            assert line.endswith(f" in {'the ' * (ending == 'mean_wind')}{ending.replace('_', ' ')}")
    calm = printed(tmp_path, GUY)
    assert "still air" not in calm
    assert "wind" not in calm
