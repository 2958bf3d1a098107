"""A mast at another temperature: the same mast, written with its heights, lengths and masses at that temperature."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from mast_scenes import SMALL

import cablepod as cp

GUYS, STEEL, WARMTH = 1.2e-5, 1.0e-5, -50.0
COLD: dict = copy.deepcopy(SMALL)
COLD["temperature"] = 20.0 + WARMTH
COLD["mast"] |= {"thermal_expansion": STEEL, "section": [{"from": 0.0, "to": 10.0, "mass": 30.0}], "drag_area": 0.3}
COLD["cables"]["guy"]["thermal_expansion"] = GUYS


def by_hand():
    """The cold mast without a temperature."""
    mapping = copy.deepcopy(COLD)
    del mapping["temperature"]
    f, g = 1.0 + STEEL * WARMTH, 1.0 + GUYS * WARMTH
    lengths = cp.mast.rest(cp.make_scene({**mapping, "mast": {**mapping["mast"], "load": []}}))["guy_length"]
    mapping["mast"] |= {"height": 30.0 * f, "mass": 20.0 / f}
    mapping["mast"]["load"][0]["level"] = 30.0 * f
    mapping["mast"]["section"] = [{"from": 0.0, "to": 10.0 * f, "mass": 30.0 / f}]
    del mapping["guy"][0]["top_tension"]
    mapping["guy"][0] |= {"level": 28.0 * f, "unstretched_length": g * float(lengths[0])}
    mapping["cables"]["guy"]["density"] = 8000.0 / g
    return mapping


@pytest.mark.parametrize("key", ["temperature", "reference_temperature"])
def test_kelvins_are_noted_and_not_refused(key):
    assert "temperature" not in str(cp.mast.summary(cp.make_scene(COLD))["note"].values)
    note = str(cp.mast.summary(cp.make_scene({**COLD, key: 283.0}))["note"].values).splitlines()[0]
    assert note.startswith(f"{key}: a temperature of 283 degC")
    assert "283 K are 9.85 degC" in note


def test_rest_and_frequencies_are_those_of_the_mast_written_by_hand():
    cold, hand = cp.make_scene(COLD), cp.make_scene(by_hand())
    one, other = cp.mast.rest(cold), cp.mast.rest(hand)
    assert float(one["guy_tension"][0]) > 5300.0  # both shorten, the guys by more
    for name in ("guy_tension", "guy_tension_anchor", "guy_length", "axial_force", "buckling_factor"):
        # heights of nodes are rounded to 1e-9 m: K/T times that over the length
        np.testing.assert_allclose(one[name], other[name], rtol=1e-7, err_msg=name)
    np.testing.assert_allclose(
        cp.mast.frequencies(cold)["angular_frequency"], cp.mast.frequencies(hand)["angular_frequency"], rtol=1e-7
    )


def test_heights_that_label_results_are_those_of_the_scene():
    rest = cp.mast.rest(cp.make_scene(COLD))
    warm = cp.mast.rest(cp.make_scene({**COLD, "temperature": 20.0}))
    np.testing.assert_array_equal(rest["level"], [28.0, 30.0])
    np.testing.assert_array_equal(rest["guy_level"], warm["guy_level"])
    np.testing.assert_allclose(rest["node_height"], warm["node_height"], rtol=0, atol=6e-9)  # eight decimals
    np.testing.assert_array_equal(rest["element_top"], rest["node_height"][1:])
    np.testing.assert_array_equal(rest["element_bottom"], rest["node_height"][:-1])
    assert float(rest["displacement"].sel(level=30.0, coordinate="x")) == float(rest["displacement"][-1, 0])


@pytest.mark.parametrize("guys", ["condensed", "chain", "catenary"])
def test_runs_are_those_of_the_mast_written_by_hand(guys):
    times, step = np.linspace(0.0, 0.1, 3), 2e-4 if guys == "chain" else 2e-3
    runs = []
    for mapping in (COLD, by_hand()):
        scene = cp.make_scene(mapping)
        runs.append(cp.mast.simulate(scene, guys=guys, step=step, times=times, outputs=("displacement", "guy_tension")))
    one, other = runs
    size = float(np.abs(other["displacement"]).max())
    np.testing.assert_allclose(one["displacement"], other["displacement"].values, rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(one["guy_tension"], other["guy_tension"], rtol=1e-6)


def test_a_temperature_is_an_axis_of_an_ensemble(tmp_path):
    mapping = copy.deepcopy(COLD)
    del mapping["temperature"]
    members = cp.ensemble.design(cp.make_scene(mapping), {"temperature": [-40.0, 40.0, 3]})
    result = cp.ensemble.run(
        members, tmp_path / "masts", model="mast", outputs=("displacement", "guy_tension", "bending_moment"), step=4e-3
    )
    assert result["bending_moment"].sizes["node"] == 9
    np.testing.assert_array_equal(result["level"], [28.0, 30.0])
    tension = result["guy_tension"].isel(time=0).mean("guy").values
    assert tension[0] > tension[1] > tension[2]


def test_expansions_that_are_missing_are_named():
    mapping = copy.deepcopy(COLD)
    del mapping["mast"]["thermal_expansion"]
    with pytest.raises(
        cp.SceneError, match=r"^temperature: given -30\.0; allowed: none without mast\.thermal_expansion"
    ):
        cp.make_scene(mapping)
    mapping = copy.deepcopy(COLD)
    del mapping["cables"]["guy"]["thermal_expansion"]
    with pytest.raises(
        cp.SceneError, match=r"^temperature: .* none without cables\.guy\.thermal_expansion \[1/K\], 0 where"
    ):
        cp.make_scene(mapping)


def test_ice_and_temperature_together():
    mapping = {**copy.deepcopy(COLD), "ice": {"thickness": 0.01}}
    mapping["mast"]["diameter"] = 0.2
    iced, bare = cp.mast.rest(cp.make_scene(mapping)), cp.mast.rest(cp.make_scene(COLD))
    np.testing.assert_allclose(iced["guy_length"], bare["guy_length"], rtol=1e-15)
    # the mast keeps its mass, the ice grows on it at its temperature
    foot, top = float(iced["axial_force"][0] - bare["axial_force"][0]), 30.0 * (1.0 + STEEL * WARMTH)
    pull = float((bare["guy_force"] - iced["guy_force"]).sel(coordinate="y").sum())
    weight = 9.81 * 700.0 * np.pi * 0.01 * 0.21 * top
    assert foot - pull == pytest.approx(weight, rel=1e-8)  # the axial force is told 1e-9 of the height above the foot
    assert (iced["guy_tension"] > bare["guy_tension"]).all()
