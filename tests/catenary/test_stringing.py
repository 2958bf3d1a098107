"""Stringing tables: against catenaries of fifty digits, and scenes at single temperatures."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import xarray as xr
from references import catenary_mpmath as reference

import cablepod as cp
from cablepod import lineage

ALPHA = 2.3e-5
LEVEL = {
    "title": "a span",
    "gravity": 10.0,
    "cable": {
        "axial_stiffness": 3.653e7, "mass_per_length": 1.5, "horizontal_force": 30000.0, "thermal_expansion": ALPHA,
        "diameter": 0.031, "breaking_strength": 1.853e5,
    },
    "ends": {"lower": [0.0, 0.0], "upper": [400.0, 0.0]},
}  # fmt: skip
WIND = {"speed": 25.0, "direction": [1.0, 0.0], "ground": -90.0}
ICE = {"thickness": 0.01}
TEMPERATURES = [-20.0, 0.0, 20.0, 40.0, 80.0]


def scene(**tables):
    return cp.make_scene({**copy.deepcopy(LEVEL), **copy.deepcopy(tables)})


@pytest.mark.parametrize("ends", [[400.0, 0.0], [300.0, 120.0]])
def test_tables_are_those_of_fifty_digits(ends):
    MP, (a, b) = reference.MP, ends
    table = cp.catenary.stringing(scene(ends={"lower": [0.0, 0.0], "upper": ends}), TEMPERATURES)
    given = reference.from_quantity(a, b, 15.0, 3.653e7, 2, 30000.0)
    for k, temperature in enumerate(TEMPERATURES):
        factor = 1 + MP.mpf(ALPHA) * (MP.mpf(temperature) - 20)
        exact = reference.from_length(a, b, 15 / factor, 3.653e7, given.length * factor)
        expected = {
            "tension_lower": exact.tension(0),
            "tension_upper": exact.tension(exact.length),
            "horizontal_force": exact.force,
            "unstretched_length": exact.length,
            "sag": reference.sag(exact),
        }
        for name, value in expected.items():
            assert float(abs(float(table[name][k]) / value - 1)) < 1e-11, name  # 1e-10 is asked for


def test_rows_are_the_scenes_at_their_temperature():
    table = cp.catenary.stringing(scene(), TEMPERATURES)
    assert table["temperature"].values.tolist() == TEMPERATURES
    assert table["temperature"].attrs["units"] == "degC"
    for k, temperature in enumerate(TEMPERATURES):
        single = scene(temperature=temperature)
        numbers = cp.summary(single)
        for name, other in (
            ("tension_upper", "tension_upper"),
            ("sag", "sag_below_chord"),
            ("utilisation", "utilisation"),
        ):
            assert float(table[name][k]) == pytest.approx(float(numbers[other]), rel=1e-14), name
        omega = cp.cable.frequencies(single, count=3, law="linear")["angular_frequency"]
        np.testing.assert_allclose(table["angular_frequency"][k], omega, rtol=1e-12)
    np.testing.assert_allclose(table["frequency"], table["angular_frequency"] / (2 * math.pi), rtol=1e-15)
    assert table.attrs["air"] == "still air"


def test_cases_replace_ice_and_wind_of_the_scene():
    cases = {
        "bare": {},
        "ice": {"ice": ICE},
        "storm": {"wind": {**WIND, "ramp": 5.0}},
        "both": {"ice": ICE, "wind": WIND},
    }
    table = cp.catenary.stringing(scene(ice={"thickness": 0.03}), [0.0, 30.0], cases=cases)
    assert table["case"].values.tolist() == list(cases)
    assert table["sag"].dims == ("case", "temperature")
    assert table["angular_frequency"].dims == ("case", "temperature", "mode")
    for name, tables in (("bare", {}), ("ice", {"ice": ICE}), ("storm", {"wind": WIND}), ("both", cases["both"])):
        numbers = cp.summary(scene(temperature=30.0, **tables))
        for variable, other in (
            ("tension_lower", "tension_lower"),
            ("sag", "sag_below_chord"),
            ("utilisation", "utilisation"),
        ):
            found = float(table[variable].sel(case=name, temperature=30.0))
            assert found == pytest.approx(float(numbers[other]), rel=1e-9), (name, variable)
        omega = table["angular_frequency"].sel(case=name, temperature=30.0).values
        np.testing.assert_allclose(omega[:2], numbers["angular_frequency_in_plane"][:2], rtol=1e-9)
    # what is given holds without ice and wind: the length is one of the temperature alone
    lengths = table["unstretched_length"].values
    np.testing.assert_allclose(lengths, np.tile(lengths[0], (4, 1)), rtol=1e-15)


def test_the_temperature_of_the_scene_is_left_aside():
    one, other = (cp.catenary.stringing(each, TEMPERATURES) for each in (scene(), scene(temperature=-5.0)))
    xr.testing.assert_equal(one, other)


def test_a_table_is_archived_and_made_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the script writes what it makes
    table = cp.catenary.stringing(scene(), [0.0, 20.0], cases={"ice": {"ice": ICE}})
    cp.archive.write(table, tmp_path / "table.nc")
    again = cp.archive.read(tmp_path / "table.nc")
    xr.testing.assert_identical(again.drop_attrs(), table.drop_attrs())
    script = lineage.script(again)
    assert "catenary.stringing(" in script
    exec(compile(script, "script", "exec"), {})  # it checks itself


def test_cables_that_are_not_taut_have_no_frequencies():
    vertical = {"lower": [0.0, 0.0], "upper": [0.0, 40.0]}
    slack = {**LEVEL["cable"], "horizontal_force": None, "unstretched_length": 60.0}
    cable = {name: value for name, value in slack.items() if value is not None}
    table = cp.catenary.stringing(cp.make_scene({**LEVEL, "cable": cable, "ends": vertical}), [0.0, 20.0])
    assert np.isnan(table["frequency"]).all()
    assert float(table["sag"][0]) == 0.0


@pytest.mark.parametrize(
    ("temperatures", "cases", "message"),
    [
        ([], None, r"^temperatures: given \[\]; allowed: a finite number or a list of them"),
        ([20.0, 20.0], None, r"^temperatures: given \[20\.0, 20\.0\]; allowed: different temperatures"),
        ([math.nan], None, r"^temperatures: given \[nan\]; allowed: a finite number"),
        ([-300.0], None, r"^temperatures\[0\]: given -300\.0; allowed: a finite number of at least -273\.15"),
        ("warm", None, r"^temperatures: given 'warm'; allowed: a finite number"),
        ([0.0], [], r"^cases: given \[\]; allowed: a mapping from names to tables"),
        ([0.0], {}, r"^cases: given \{\}; allowed: a mapping from names to tables"),
        ([0.0], {"a": 5}, r"^cases\.a: given 5; allowed: a mapping with the tables ice and wind"),
        ([0.0], {"a": {"rain": {}}}, r"^cases\.a\.rain: unknown table; allowed: ice, wind$"),
        (
            [0.0],
            {"a": {"ice": {"thick": 1.0}}},
            r"^cases\.a\.ice\.thick: unknown key; allowed: thickness, density; try: ",
        ),
        ([0.0], {"a": {"wind": {"speed": 5.0}}}, r"^cases\.a\.wind\.direction: missing; allowed: direction into which"),
        (
            [0.0],
            {"a": {"wind": {"speed": 5.0, "direction": [0.0, 1.0]}}},
            r"^cases\.a\.wind\.direction: given .*horizontal",
        ),
    ],
)
def test_wrong_calls_are_refused_by_key(temperatures, cases, message):
    with pytest.raises(cp.SceneError, match=message):
        cp.catenary.stringing(scene(), temperatures, cases=cases)


def test_scenes_without_a_table_are_refused_by_key():
    bare = copy.deepcopy(LEVEL)
    del bare["cable"]["thermal_expansion"], bare["cable"]["diameter"]
    with pytest.raises(
        cp.SceneError, match=r"^temperature: given 0\.0; allowed: none without cable\.thermal_expansion"
    ):
        cp.catenary.stringing(cp.make_scene(bare), [0.0])
    bare["cable"]["thermal_expansion"] = ALPHA
    with pytest.raises(
        cp.SceneError, match=r"^cable\.diameter: missing; allowed: a diameter \[m\], on which the ice grows"
    ):
        cp.catenary.stringing(cp.make_scene(bare), [0.0], cases={"ice": {"ice": ICE}})
    with pytest.raises(
        cp.SceneError, match=r"^cable\.diameter: missing; allowed: a diameter \[m\], on which the wind acts"
    ):
        cp.catenary.stringing(cp.make_scene(bare), [0.0], cases={"storm": {"wind": WIND}})
    with pytest.raises(cp.SceneError, match=r"^point_load\.1: given 'a point load'; allowed: none"):
        cp.catenary.stringing(scene(point_load=[{"arc_length": 0.5, "force": [0.0, -10.0]}]), [0.0])
    with pytest.raises(cp.SceneError, match=r"^ends\.free: given 'upper'; allowed: ends that are held"):
        cp.catenary.stringing(scene(ends={**LEVEL["ends"], "free": "upper"}), [0.0])
    members = cp.ensemble.design(scene(), {"cable.mass_per_length": [1.0, 2.0, 2]})
    with pytest.raises(cp.SceneError, match=r"^scene: given several members; allowed: one"):
        cp.catenary.stringing(members, [0.0])


def test_a_figure_has_a_line_for_each_case():
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    table = cp.catenary.stringing(scene(), [0.0, 20.0, 40.0], cases={"bare": {}, "ice": {"ice": ICE}})
    ax = cp.plots.stringing(table, variable="sag")
    assert [line.get_label() for line in ax.lines] == ["bare", "ice"]
    np.testing.assert_array_equal(ax.lines[1].get_ydata(), table["sag"].sel(case="ice"))
    assert (ax.get_xlabel(), ax.get_title()) == ("temperature [\u00b0C]", "a span")
    single = cp.plots.stringing(table.isel(case=0, drop=True), variable="frequency", ax=plt.figure().subplots())
    np.testing.assert_array_equal(single.lines[0].get_ydata(), table["frequency"][0, :, 0])
    in_millimetres = table.assign(sag=(1e3 * table["sag"]).assign_attrs(table["sag"].attrs, units="mm"))
    assert "[mm]" in cp.plots.stringing(in_millimetres, variable="sag", ax=plt.figure().subplots()).get_ylabel()
    with pytest.raises(cp.SceneError, match=r"^variable: given 'tension'; allowed: one of tension_lower, .*frequency$"):
        cp.plots.stringing(table, variable="tension")
    plt.close("all")
