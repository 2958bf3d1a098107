"""Rest, buckling and frequencies of a mast against exact solutions."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import WIND, small, small_tables
from printed import printed
from scipy.linalg import expm
from scipy.optimize import brentq

import cablepod as cp
from cablepod.errors import OutOfRangeWarning, SceneError

HEIGHT, STIFFNESS, MASS = 60.0, 2.0e7, 40.0
LEVELS, RADIUS, TENSION = (25.0, 50.0), 30.0, 20000.0
CABLE = {"youngs_modulus": 1.6e11, "area": 1.0e-4, "density": 1e-6}


def spring_mast(**changes):
    """Four guys without weight at each of two levels, which are springs; no gravity."""
    guys = [
        {"cable": "light", "level": level, "radius": RADIUS, "count": 4, "direction": [1.0, 0.0, 0.0], "top_tension": TENSION}
        for level in LEVELS
    ]  # fmt: skip
    mast = {"height": HEIGHT, "bending_stiffness": STIFFNESS, "mass": MASS, "elements": 24, **changes}
    return cp.make_scene({"gravity": 0.0, "mast": mast, "cables": {"light": CABLE}, "guy": guys})


def determinant(omega: float, base: str) -> float:
    """The determinant of a beam-column on springs, from transfer matrices of (w, w', M, H), H = EI w''' + N w'."""
    state = np.eye(4)[:, [1, 3] if base == "pinned" else [2, 3]]
    springs, pulls = [], []
    for level in LEVELS:
        length = np.hypot(level, RADIUS)  # with the strain at rest
        axial = (
            CABLE["youngs_modulus"]
            * CABLE["area"]
            * (1.0 + TENSION / (CABLE["youngs_modulus"] * CABLE["area"]))
            / length
        )
        cosine = RADIUS / length
        along, across = axial * cosine**2 + TENSION / length * (1.0 - cosine**2), TENSION / length
        springs.append(2.0 * along + 2.0 * across)
        pulls.append(4.0 * TENSION * level / length)
    bottom = 0.0
    for place, (top, spring) in enumerate(zip((*LEVELS, HEIGHT), (*springs, 0.0), strict=True)):
        force = sum(pulls[place:])
        rate = np.zeros((4, 4))
        rate[0, 1], rate[1, 2], rate[2, 1], rate[2, 3], rate[3, 0] = 1.0, 1.0 / STIFFNESS, -force, 1.0, MASS * omega**2
        state = expm(rate * (top - bottom)) @ state
        state[3] -= spring * state[0]
        bottom = top
    end = state[2:] / np.abs(state[2:]).max(axis=0)
    return float(np.linalg.det(end))


@pytest.mark.parametrize("base", ["pinned", "clamped"])
def test_frequencies_on_springs_are_those_of_the_exact_determinant(base):
    found = cp.mast.frequencies(spring_mast(base=base), count=8, guys="catenary").angular_frequency.values[::2]
    grid = np.linspace(0.5, 1.05 * found[-1], 4000)
    values = np.array([determinant(omega, base) for omega in grid])
    exact = [
        brentq(determinant, a, b, args=(base,))
        for a, b, u, v in zip(grid, grid[1:], values, values[1:], strict=False)
        if u * v < 0
    ]
    np.testing.assert_allclose(found, exact[: found.size], rtol=1e-4)
    condensed = cp.mast.frequencies(spring_mast(base=base), count=8, rank=1).angular_frequency.values[::2]
    np.testing.assert_allclose(condensed, exact[: found.size], rtol=1e-4)


@pytest.mark.parametrize("gap", [1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("guys", ["condensed", "chain", "catenary"])
def test_a_load_close_to_a_guy_leaves_the_frequencies(gap, guys):
    # a short element: its own highest frequency is 1e9 times the lowest ones, which have to keep their digits
    def at(level):
        return small(
            lambda mapping: mapping["mast"].update(elements=24, load=[{"level": level, "force": [1.0, 0.0, 0.0]}])
        )

    far, close = (cp.mast.frequencies(at(level), count=6, guys=guys) for level in (28.0, 28.0 + gap))
    np.testing.assert_allclose(close.angular_frequency, far.angular_frequency, rtol=2e-5)


def test_a_load_right_above_the_foot_makes_no_element():
    # whose stiffness would have no digit left
    def at(level):
        return small(lambda mapping: mapping["mast"].update(load=[{"level": level, "force": [1.0, 0.0, 0.0]}]))

    guy, foot = (cp.mast.frequencies(at(level), count=4, guys="catenary") for level in (28.0, 1e-10))
    # the force at the guy bends the mast by 1e-7 of its height
    np.testing.assert_allclose(foot.angular_frequency, guy.angular_frequency, rtol=1e-6)


def test_condensed_guys_that_do_not_hold_the_mast_have_no_frequencies():
    def slack(mapping):
        mapping["guy"][0] |= {"top_tension": 300.0, "radius": 30.0}
        mapping["cables"]["guy"]["diameter"] = 0.012
        mapping["mast"]["bending_stiffness"] = 4e7
        del mapping["mast"]["load"]
        mapping["wind"] = {"speed": 40.0, "direction": [1.0, 0.0, 0.0]}

    with pytest.warns(
        OutOfRangeWarning, match=r"not stable at rest.*3 of the frequencies are not known; try guys=.chain"
    ):
        assert np.isnan(cp.mast.frequencies(small(slack), count=3).angular_frequency).all()
    with pytest.warns(OutOfRangeWarning, match="not stable at rest"):
        assert np.isnan(cp.summary(small(slack)).frequency_mean_wind[0])
    assert float(cp.mast.frequencies(small(slack), count=3, guys="chain").angular_frequency[0]) > 1.0


def test_rest_is_in_equilibrium_and_has_the_given_tensions():
    still = cp.mast.rest(small())
    np.testing.assert_allclose(still.guy_tension, 5000.0, rtol=1e-9)
    assert abs(still.displacement).max() < 1e-9
    weight = 20.0 * 9.81 * 30.0
    np.testing.assert_allclose(
        still.axial_force[0], weight - float(still.guy_force.sel(coordinate="y").sum()), rtol=1e-6
    )

    def pulled(mapping):
        for name in ("kind", "amplitude", "duration"):
            del mapping["mast"]["load"][0][name]

    rest = cp.mast.rest(small(pulled))
    # moments about the foot: the load at 30 m, guys at 28 m, weight and vertical forces at displaced points
    moved = rest.displacement.sel(level=28.0)
    top = rest.displacement.sel(level=30.0)
    for axis, force in (("x", 1000.0), ("z", 400.0)):
        pull = rest.guy_force.sel(coordinate=axis).sum() * 28.0 - rest.guy_force.sel(coordinate="y").sum() * moved.sel(
            coordinate=axis
        )
        assert float(top.sel(coordinate=axis)) > 0.0
        assert (
            abs(float(pull) + force * 30.0 + 9.81 * 20.0 * 30.0 * 0.5 * float(top.sel(coordinate=axis)))
            < 0.01 * force * 30.0
        )
    assert float(abs(rest.bending_moment.isel(node=[0, -1])).max()) < 0.05 * float(abs(rest.bending_moment).max())


@pytest.mark.parametrize(("gravity", "tension", "slack"), [(9.81, 600.0, 0), (0.0, 5000.0, 1)])
def test_guys_that_go_slack_leave_the_mast_its_rest(gravity, tension, slack):
    # sagging guys, where Newton's method fails from the upright mast, and guys without weight, of which one carries nothing;
    # no weight of the mast to speak of, so that moments about the foot are those of load and guys alone
    force = np.array([1200.0, 6000.0])

    def pulled(mapping):
        mapping["gravity"] = gravity
        mapping["mast"].update(mass=0.5, load=[{"level": 30.0, "force": [force[0], 0.0, force[1]]}])
        mapping["guy"][0]["top_tension"] = tension

    rest = cp.mast.rest(small(pulled)).sel(coordinate=["x", "z"])
    vertical = cp.mast.rest(small(pulled)).guy_force.sel(coordinate="y").sum()
    moments = 30.0 * force + 28.0 * rest.guy_force.sum("guy") - float(vertical) * rest.displacement.sel(level=28.0)
    # the weight of 15 kg, displaced by less than 0.4 m
    assert float(abs(moments).max()) < 1e-9 * 30.0 * 6000.0 + 15.0 * gravity * 0.4
    assert int((rest.guy_tension == 0.0).sum()) == slack
    if slack:
        for run in (cp.mast.frequencies, cp.mast.simulate):
            with pytest.raises(
                SceneError, match=r"^guy\.1: given guys without weight, of which guy \d is slack at rest"
            ):
                run(small(pulled))


def test_drag_bends_the_mast_downwind():
    def windy(mapping):
        mapping["wind"] = WIND
        mapping["mast"]["drag_area"] = 0.3

    rest = cp.mast.rest(small(windy))
    assert float(rest.displacement.sel(level=28.0, coordinate="x")) > 1e-3
    assert abs(float(rest.displacement.sel(level=28.0, coordinate="z"))) < 1e-9
    # drag on mast and on the upper halves of the guys against the resultant of the guys
    assert float(rest.guy_tension[1]) > 5000.0 > float(rest.guy_tension[0])


def test_a_mast_that_leans_far_at_rest_warns_of_its_slopes():
    def pulled(mapping):
        mapping["mast"]["load"][0] = {"level": 30.0, "force": [1.3e5, 0.0, 0.0]}
        mapping["mast"]["bending_stiffness"] = 4e8  # it does not buckle under its guys

    with pytest.warns(OutOfRangeWarning, match=r"^the mast slopes by 0\.1\d* \(above 0\.1\) at rest, .* small slopes"):
        rest = cp.mast.rest(small(pulled))
    moved = rest.displacement.sel(coordinate="x")
    assert float(moved.sel(level=30.0) - moved.sel(level=28.0)) > 0.1 * 2.0


def test_a_buckling_mast_is_refused_with_its_critical_factor():
    factor = float(cp.mast.rest(small()).buckling_factor)

    def softer(mapping):
        mapping["mast"]["bending_stiffness"] /= 1.2 * factor

    with pytest.raises(SceneError, match=r"^mast\.bending_stiffness: .*critical factor 0\.[89]"):
        cp.mast.rest(small(softer))

    def one_guy(mapping):
        mapping["guy"][0]["count"] = 1  # across the guy its string stiffness alone holds the mast

    with pytest.raises(SceneError, match=r"^mast\.bending_stiffness: .*critical factor 0\.5"):
        cp.mast.rest(small(one_guy))


def test_the_critical_load_of_a_clamped_column_is_that_of_euler():
    def column(**changes):
        mast = {"height": HEIGHT, "bending_stiffness": STIFFNESS, "mass": 1e-6, "base": "clamped"}
        guy = {"cable": "light", "level": HEIGHT, "radius": 1e-3, "count": 3, "direction": [1.0, 0.0, 0.0], **changes}
        cables = {"light": {"youngs_modulus": 1e7, "area": 1e-6, "density": 1e-6}}
        return {"gravity": 0.0, "mast": mast, "cables": cables, "guy": [guy]}

    euler = np.pi**2 * STIFFNESS / (4.0 * HEIGHT**2)
    rest = cp.mast.rest(cp.make_scene(column(top_tension=1.0)))
    # the guys run along the mast: their pull is 3 N, and their string stiffness 3 N / HEIGHT is no more than rounding here
    np.testing.assert_allclose(rest.buckling_factor, euler / 3.0, rtol=1e-3)


def test_shares_of_the_kinetic_energy_add_up_to_one():
    found = cp.mast.frequencies(small(), count=12)
    assert found.mode_shape.dims == ("mode", "node", "coordinate")
    total = found.mast_share + found.guy_share.sum("guy")
    # of condensed guys the coordinates move with their ends, which neither part has alone
    assert float(abs(total - 1.0).max()) < 0.35
    springs = cp.mast.frequencies(small(), count=6, guys="catenary")
    np.testing.assert_allclose(springs.mast_share + springs.guy_share.sum("guy"), 1.0, rtol=1e-9)


# --- rest in the mean wind ------------------------------------------------------------------------------------------------


def stiff_mast(wind):
    """A mast that does not move with three guys of 61 m, 1 kg/m and 15 kN."""
    cable = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "diameter": 0.016}
    guy = {
        "cable": "steel",
        "level": 57.7,
        "radius": 20.4,
        "count": 3,
        "direction": [-1.0, 0.0, 0.0],
        "top_tension": 15000.0,
    }
    mast = {"height": 60.0, "bending_stiffness": 1e12, "mass": 1e3, "base": "clamped", "elements": 8}
    return cp.make_scene(
        {"mast": mast, "cables": {"steel": cable}, "guy": [guy], **({"wind": wind} if wind else {})}
    ), cable


def test_guys_of_a_stiff_mast_in_the_mean_wind_are_cables_in_that_wind():
    wind = {"speed": 45.0, "direction": [1.0, 0.0, 0.0]}
    scene, cable = stiff_mast(wind)
    found, rest = cp.mast.frequencies(scene, count=8), cp.mast.rest(scene)
    assert found.attrs["air"] == "mean wind of 45 m/s at 10 m above the ground"
    hertz, share = found.angular_frequency.values / (2.0 * np.pi), found.guy_share.values
    for guy, anchor in enumerate(rest.anchor.values):
        ends = {"lower": anchor.tolist(), "upper": [0.0, 57.7, 0.0]}
        single = cp.make_scene({"cable": {**cable, "top_tension": 15000.0}, "wind": wind, "ends": ends})
        tension = cp.cable.rest(single).tension
        # a uniform load with the moment of the drag, which grows with the height, gave up to 3.7 % more
        assert float(rest.guy_tension[guy]) == pytest.approx(float(tension[-1]), rel=4e-3)
        assert float(rest.guy_tension_anchor[guy]) == pytest.approx(float(tension[0]), rel=4e-3)
        string = np.sqrt(float(tension.mean())) / (2.0 * np.hypot(20.4, 57.7))
        lowest = hertz[share[:, guy] > 0.4].min()  # the two leeward guys vibrate together
        # order "leading" leaves 0.2 %; in still air it would be 0.99 Hz beside 1.19 and 1.20
        assert lowest == pytest.approx(string, rel=4e-3)
    chain = cp.mast.simulate(scene, guys="chain", links=40, times=[0.0, 0.02], outputs=("guy_force",))
    largest = float(abs(rest.guy_force).max())
    np.testing.assert_allclose(rest.guy_force, chain.guy_force[0], atol=4e-3 * largest)
    still = cp.mast.frequencies(stiff_mast(None)[0], count=1)
    assert still.attrs["air"] == "still air"
    assert float(still.angular_frequency[0]) / (2.0 * np.pi) == pytest.approx(0.9914, rel=3e-3)


@pytest.mark.parametrize("ramp", [0.0, 4.0])
def test_a_summary_has_still_air_and_mean_wind_side_by_side(ramp, tmp_path):
    def windy(mapping, **wind):
        mapping["wind"] = {"speed": 20.0, "direction": [1.0, 0.0, 0.0], **wind}
        mapping["mast"]["drag_area"] = 0.3

    def calm(mapping):
        mapping["mast"]["drag_area"] = 0.3

    scene, blown = small(lambda mapping: windy(mapping, ramp=ramp)), small(windy)
    numbers, still, rest = cp.summary(scene), cp.summary(small(calm)), cp.mast.rest(blown)
    assert not any(str(name).endswith(("_still_air", "_mean_wind")) for name in still)
    names = [str(name) for name in still.data_vars if name not in ("guy_length", "anchor", "note")]
    assert {"frequency", "guy_tension", "buckling_factor"} <= set(names)
    for name in names:
        np.testing.assert_array_equal(numbers[f"{name}_still_air"], still[name], err_msg=name)
        other = numbers[f"{name}_{'still_air' if ramp else 'mean_wind'}"]
        np.testing.assert_array_equal(numbers[name], other, err_msg=name)
        assert numbers[f"{name}_mean_wind"].attrs["long_name"].endswith(", in the mean wind")
    np.testing.assert_array_equal(numbers.guy_tension_mean_wind, rest.guy_tension)
    frequencies = cp.mast.frequencies(blown, count=6).angular_frequency
    np.testing.assert_array_equal(numbers.angular_frequency_mean_wind, frequencies)
    assert numbers.attrs["air"] == cp.mast.rest(scene).attrs["air"]
    text = printed(tmp_path, small_tables(lambda mapping: windy(mapping, ramp=ramp)))
    for state, ending in (("still air", "still_air"), ("mean wind", "mean_wind")):
        line = next(line for line in text.splitlines() if f" {state} " in line and line.endswith(" Hz"))
        hertz = [float(value) for value in line.split(state)[1].split()[:-1]]
        np.testing.assert_allclose(hertz, numbers[f"frequency_{ending}"], rtol=1e-3)


def test_members_with_and_without_ramp_have_the_numbers_of_their_scenes():
    def windy(mapping):
        mapping["wind"] = {"speed": 20.0, "direction": [1.0, 0.0, 0.0], "ramp": 0.0}

    scenes = cp.ensemble.design(small(windy), {"wind.ramp": [0.0, 5.0]}, members=2, sampling="grid")
    numbers = cp.summary(scenes)
    for member in range(2):
        single = cp.summary(scenes.isel(member=member, drop=True))
        for name in ("guy_tension", "guy_tension_mean_wind", "frequency_still_air", "frequency"):
            np.testing.assert_array_equal(numbers[name].isel(member=member), single[name], err_msg=name)


def test_a_ramp_towards_a_wind_that_fells_the_mast_is_told():
    def storm(mapping):
        mapping["wind"] = {"speed": 200.0, "direction": [1.0, 0.0, 0.0], "ramp": 5.0}
        mapping["mast"]["drag_area"] = 0.3

    numbers = cp.summary(small(storm))
    assert np.isnan(numbers.frequency_mean_wind).all()
    np.testing.assert_array_equal(numbers.frequency, numbers.frequency_still_air)
    assert np.isfinite(numbers.frequency).all()


def two_tables(mapping, apart, *, stiffness=1.3e8, height=83.0):
    """Guys to eight sides at half the height, five of them above the others by a distance over the height."""
    mapping["mast"] |= {"height": height, "bending_stiffness": stiffness}
    mapping["guy"][0] |= {"level": 0.5 * height, "radius": 0.7 * height, "top_tension": 6000.0}
    other = {"level": 0.5 * height + height * apart, "count": 5, "direction": [0.0, 0.0, 1.0]}
    mapping["guy"].append({**mapping["guy"][0], **other})
    mapping["mast"]["load"] = [{"level": height, "force": [2500.0, 0.0, -1500.0]}]


@pytest.mark.parametrize(("stiffness", "height"), [(1.3e8, 83.0), (1.6e9, 87.0), (1e11, 87.0)])
def test_tables_of_guys_nearly_at_one_level_keep_their_own_heights(stiffness, height):
    """Short elements of stiff masts left no digit of the stiffness: masts were said to have no rest."""

    def at(apart):
        return cp.mast.rest(small(lambda mapping: two_tables(mapping, apart, stiffness=stiffness, height=height)))

    one, far = at(0.0), at(1e-3)  # with a node for each table
    for apart in (1e-5, 2.1e-5, 1e-4, 2.9e-4):
        near = at(apart)
        for of in (lambda rest: rest.guy_tension.values, lambda rest: rest.displacement.values[-1]):
            change, share = of(far) - of(one), apart / 1e-3
            # but for what is of second order in the distance, and of other elements
            atol = 0.1 * share * np.abs(change).max()
            np.testing.assert_allclose(of(near), of(one) + share * change, rtol=0.0, atol=atol)
        horizontal = (near.foot_force - near.guy_force.sum("guy"))[[0, 2]]
        np.testing.assert_allclose(horizontal, [2500.0, -1500.0], atol=2.9e-4)  # 1e-7 of the largest force


@pytest.mark.parametrize("apart", [1e-8, 1e-6, 1e-4])
def test_guys_nearly_at_one_level_may_break(apart):
    def at(apart):
        def change(mapping):
            two_tables(mapping, apart)
            for guy in mapping["guy"]:
                guy |= {"breaks": 1.0, "breaks_number": 1}

        return cp.mast.simulate(small(change)).guy_tension_maximum

    np.testing.assert_allclose(at(apart), at(0.0), rtol=2e-3)  # the tables move by up to 8 mm
