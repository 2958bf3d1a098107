"""Values of a scene Dataset that somebody changed are checked as those of a scene file are."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from mast_scenes import SMALL, WIND

import cablepod as cp
from cablepod import examples

CHANGES = [
    ("gravity", -9.81, r"gravity: given -9.81; allowed: a finite number of at least 0"),
    ("gravity", np.nan, r"scene: gravity: given nan; allowed: a finite number"),
    ("cable_area", -1e-4, r"cable.area: given -0.0001; allowed: a finite number above 0"),
    (
        "cable_area",
        np.nan,
        r"scene: cable_area: given nan; allowed: .* or no such variable; try: scene\.drop_vars\('cable_area'\)",
    ),
    ("cable_area", 0.0, r"cable.area: given 0.0; allowed: a finite number above 0"),
    ("cable_area", 1e-40, r"cable.area: given 1e-40; allowed: a finite number above 0, of a size from 1e-30"),
    ("cable_youngs_modulus", np.inf, "scene: cable_youngs_modulus: given 'values that are not finite'"),
    ("cable_top_tension", -1.0, r"cable.top_tension: given -1.0; allowed: a finite number above 0"),
    ("cable_youngs_modulus", 1e30, "cable.youngs_modulus: given 1e[+]30; allowed: an axial stiffness of 1e-6 to 1e18 N"),
    ("time_interval", 0.0, r"time.interval: given 0.0; allowed: a finite number above 0"),
    ("motion_upper_x_angular_frequency", -1.0, r"motion.upper.x.angular_frequency: given -1.0; allowed:"),
    ("motion_upper_x_amplitude", np.nan, r"scene: motion_upper_x_amplitude: given nan; allowed: a finite number"),
    ("motion_upper_x_kind", "circle", r"motion.upper.x.kind: given 'circle'; allowed: one of"),
]  # fmt: skip


def altered(scene: xr.Dataset, name: str, value: float | str) -> xr.Dataset:
    """The scene with another value, as a user writes it."""
    return scene.assign({name: ((), value, scene[name].attrs)})


@pytest.mark.parametrize(("name", "value", "message"), CHANGES)
def test_a_value_that_no_scene_has_is_refused(name, value, message):
    scene = examples.scene("example2")
    for function in (cp.catenary.rest, cp.chain.simulate, cp.cable.simulate, cp.cable.summary):
        for _ in range(2):  # what is refused is not kept
            with pytest.raises(cp.SceneError, match=message):
                function(altered(scene, name, value))
    cp.catenary.rest(scene)


def test_a_value_that_a_scene_may_have_is_taken():
    scene = examples.scene("example2")
    heavier = altered(scene, "gravity", 2.0 * float(scene.gravity))
    given = cp.make_scene(examples_tree() | {"gravity": 2.0 * float(scene.gravity)})
    np.testing.assert_array_equal(cp.catenary.rest(heavier)["position"], cp.catenary.rest(given)["position"])


def examples_tree() -> dict[str, object]:
    """Example 2 as nested tables."""
    import tomllib

    return tomllib.loads(examples.scene_path("example2").read_text())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mast_height", -30.0, "mast.height: given -30.0; allowed: a finite number above 0"),
        ("mast_damping_ratio", -0.1, "mast.damping_ratio: given -0.1"),
        ("mast_base", "floating", "mast.base: given 'floating'"),
        ("wind_speed", -5.0, "wind.speed: given -5.0"),
        ("guy_1_level", np.nan, "scene: guy_1_level: given nan; allowed: a finite number"),
        ("guy_1_level", 31.0, "guy.1.level: given 31.0; allowed: a height of at most mast.height, 30 m"),
        ("guy_1_cable", "rope", "guy.1.cable: given 'rope'; allowed: the name of a cable: guy"),
        ("mast_load_1_level", 31.0, "mast.load.1.level: given 31.0; allowed: a height of at most mast.height, 30 m"),
        ("wind_profile", "power", r'wind.exponent: missing; allowed: the exponent of profile "power"'),
    ],
)
def test_a_value_that_no_mast_has_is_refused(name, value, message):
    scene = cp.make_scene({**SMALL, "wind": WIND})
    assert name in scene
    with pytest.raises(cp.SceneError, match=message):
        cp.mast.rest(altered(scene, name, value))


def test_a_member_that_no_scene_is_is_refused():
    members = cp.ensemble.design(examples.scene("example2"), {"cable.area": [1e-4, 2e-4]}, members=5, seed=1)
    areas = members["cable_area"].values.copy()
    for bad in (-1.0, 0.0):
        other = members.assign(cable_area=("member", np.r_[areas[:2], bad, areas[3:]], members["cable_area"].attrs))
        with pytest.raises(cp.SceneError, match=f"cable.area: given {bad}; allowed: a finite number above 0"):
            cp.catenary.rest(other)


def test_no_members_are_refused():
    members = cp.ensemble.design(examples.scene("example2"), {"cable.area": [1e-4, 2e-4]}, members=5, seed=1)
    for function in (
        cp.catenary.rest,
        cp.chain.rest,
        cp.chain.simulate,
        cp.cable.frequencies,
        cp.rigid.rest,
        cp.summary,
    ):
        with pytest.raises(cp.SceneError, match=r"^scene: given no members; allowed: at least one"):
            function(members.isel(member=[]))


def test_whole_numbers_may_be_floats_where_a_member_lacks_them():
    tree = {key: value for key, value in examples_tree().items() if key != "chain"}
    scenes = [cp.make_scene({**tree, "chain": {"links": 8}}), cp.make_scene(tree)]
    both = xr.concat(scenes, "member", data_vars="all", coords="minimal", join="outer")
    assert both["chain_links"].dtype == float
    assert cp.chain.rest(both.isel(member=0)).sizes["link"] == 8
    assert cp.chain.rest(both, links=5).sizes["link"] == 5
    with pytest.warns(cp.MemberFailedWarning, match=r"member 1: chain\.links: missing; allowed: a whole number"):
        cp.chain.rest(both)
    with pytest.raises(cp.SceneError, match=r"chain\.links: given 8\.5; allowed: a whole number"):
        cp.catenary.rest(both.assign(chain_links=both["chain_links"] + 0.5))


GUY = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 15000.0, "diameter": 0.016},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "chain": {"links": 4, "link_lengths": [1.0, 2.0, 2.0, 1.0]},
    "initial": {"top_tension": 16000.0},
    "wind": {"speed": 10.0, "direction": [1.0, 0.0], "ground": -1.0},
    "segment": [{"to": 0.4}, {"density": 7000.0}],
    "attachment": [{"arc_length": 0.5, "mass": 20.0}],
}


def record(times: list[float]) -> dict[str, object]:
    """Variables of a record of zeros."""
    samples = {"time": ("motion_upper_x_sample", times), "value": ("motion_upper_x_sample", np.zeros(len(times)))}
    return {f"motion_upper_x_{key}": value for key, value in {"kind": "file", **samples}.items()}


#: Variables of motions by their kind.
KINDS = {
    "one_minus_cosine": {"motion_upper_x_amplitude": 0.1, "motion_upper_x_angular_frequency": 2.0},
    "ramp": {"motion_upper_x_amplitude": 0.1, "motion_upper_x_duration": 2.0},
}
KINDS = {kind: {"motion_upper_x_kind": kind, **variables} for kind, variables in KINDS.items()}
#: Variables that do not go with those of the scene, and what is said.
TOGETHER = [
    ({"cable_axial_stiffness": 2e7}, r"cable: given youngs_modulus = .* and axial_stiffness = .*; allowed: exactly one"),
    ({"cable_sag": 0.3}, r"cable: given top_tension = 15000\.0 and sag = 0\.3; allowed: exactly one"),
    ({"ends_chord": 61.0}, r"ends: given upper = \[20\.4, 57\.7\] and chord = 61\.0; allowed: upper, or chord with"),
    ({"chain_links": 5}, r"chain\.link_lengths: given .*; allowed: 5 numbers, as many as chain\.links says"),
    ({"initial_unstretched_length": 60.0}, r"initial: given top_tension = .* and unstretched_length = .*; allowed: exactly"),
    ({"wind_exponent": 0.2}, r"wind\.exponent: given 0\.2; allowed: none with profile"),
    ({"wind_direction": ("coordinate", [0.0, 1.0])}, r"wind\.direction: given \[0\.0, 1\.0\]; allowed: a horizontal"),
    ({"wind_roughness_length": 12.0}, r"wind\.reference_height: given 10\.0; allowed: a height above"),
    ({"ice_thickness": 0.01}, r"ice\.density: missing; allowed: density of the ice"),
    ({"segment_1_mass_per_length": 1e20}, r"segment\.1\.mass_per_length: given 1e\+20; allowed: 1e-15 to 1e15 kg/m"),
    ({"segment_2_from": 0.5}, r"segment\.2\.from: given 0\.5; allowed: 0\.4, where segment\.1 ends"),
    ({"attachment_1_damper": 3.0}, r'attachment\.1\.direction: missing; allowed: "normal"'),
    ({"attachment_3_mass": 3.0}, r"attachment\.3: given without attachment\.2; allowed: tables numbered from 1"),
    ({"motion_upper_z_kind": "ramp", "motion_upper_z_amplitude": 0.1, "motion_upper_z_duration": 1.0},
     r"motion\.upper\.z: unknown axis; allowed: x, y"),
    ({"motion_upper_x_amplitude": 0.1}, r"motion\.upper\.x\.kind: missing; allowed: one of .*, with motion\.upper\.x\.amp"),
    ({"chain_link_lengths": ("chain_link_lengths_item", [1.0, -2.0, 2.0, 1.0])}, r"chain\.link_lengths\[1\]: given -2\.0;"),
    ({"damping_ratios": ("damping_ratios_item", [-0.1])}, r"damping\.ratios\[0\]: given -0\.1; allowed: .* of at least 0"),
    ({**KINDS["one_minus_cosine"], "motion_upper_x_phase": 1.0},
     r"motion\.upper\.x\.phase: unknown key of kind one_minus_cosine; allowed: amplitude, angular_frequency, ramp"),
    ({**KINDS["ramp"], "motion_upper_x_ramp": 1.0}, r"motion\.upper\.x\.ramp: unknown key of kind ramp; allowed: amplitude, dur"),
    ({**KINDS["ramp"], "motion_upper_x_value": ("motion_upper_x_sample", np.zeros(4))},
     r"motion\.upper\.x\.value: unknown key of kind ramp"),
    ({**{name.replace("motion_upper_x", "load"): value for name, value in KINDS["ramp"].items()}, "load_phase": 0.1,
      "load_uniform": ("coordinate", [0.0, 1.0])}, r"load\.phase: unknown key of kind ramp; allowed: amplitude, duration"),
    ({"wind_turbulence_record": "field.nc"}, r"wind\.turbulence\.record_sha256: missing; allowed: that of the record"),
    (record([0.0, 2.0, 1.0, 3.0]), r"motion\.upper\.x\.time: the record is unsorted: time 1 s follows 2 s; allowed: rising"),
    (record([0.0, 1.0, 2.0]), r"motion\.upper\.x\.time: the record is too short: 3 rows; allowed: one of at least 4"),
]  # fmt: skip


@pytest.mark.parametrize(("variables", "message"), TOGETHER)
def test_keys_that_do_not_go_together_are_refused_in_a_dataset_as_in_a_file(variables, message):
    scene = cp.make_scene(GUY)
    with pytest.raises(cp.SceneError, match=f"^{message}"):
        cp.chain.rest(scene.assign(variables))


UNKNOWN = [
    ("cable_aera", "cable_area"),
    ("cabel_diameter", "cable_diameter"),
    ("gravty", "gravity"),
    ("temprature", "temperature"),
    ("motion_upper_x_ampltude", "motion_upper_x_amplitude"),
    ("motion_upper_x_frequency", "motion_upper_x_angular_frequency"),
    ("point_load_12_froce", "point_load_12_force"),
    ("wind_turbulence_sed", "wind_turbulence_seed"),
    ("wind_class", "another name, a coordinate or an attribute for what is your own"),
    ("guy_1_level", "another name, a coordinate or an attribute for what is your own"),
]


@pytest.mark.parametrize(("name", "remedy"), UNKNOWN)
def test_a_variable_that_is_named_as_a_key_and_is_none_is_refused(name, remedy):
    scene = examples.scene("example2").assign({name: 1.0})
    message = (
        rf"^scene: {name}: unknown variable of a scene; allowed: the keys of a scene of one cable, .*; try: {remedy}$"
    )
    for function in (cp.catenary.rest, cp.chain.simulate, cp.cable.summary):
        with pytest.raises(cp.SceneError, match=message):
            function(scene)
    with pytest.raises(cp.SceneError, match=message):
        cp.ensemble.design(scene, {"gravity": [9.0, 10.0]}, members=2)


def test_a_misspelt_variable_of_a_mast_is_refused():
    scene = cp.make_scene(SMALL).assign(guy_1_top_tensoin=1e4)
    with pytest.raises(cp.SceneError, match=r"guy_1_top_tensoin: unknown .* of a mast, .*; try: guy_1_top_tension$"):
        cp.mast.rest(scene)
    with pytest.raises(cp.SceneError, match=r"cable_area: unknown variable of a scene; .* of a mast"):
        cp.mast.rest(cp.make_scene(SMALL).assign(cable_area=1e-4))


def test_variables_coordinates_and_attributes_of_ones_own_are_left_alone():
    scene = examples.scene("example2")
    own = scene.assign(site="north", rms=3.0, tension_ratio=0.3).assign_coords(cable_aera=1.0).assign_attrs(author="me")
    np.testing.assert_array_equal(cp.catenary.rest(own)["position"], cp.catenary.rest(scene)["position"])


@pytest.mark.parametrize("name", ["damping_mass_proportional", "cable_drag_coefficient", "temperature"])
def test_nan_is_no_absent_key_but_of_members(name):
    scene = examples.scene("example2")
    with pytest.raises(cp.SceneError, match=f"^scene: {name}: given nan; allowed: a finite number"):
        cp.chain.rest(scene.assign({name: np.nan}))
    tree = {**examples_tree(), "wind": {"speed": 5.0, "direction": [1.0, 0.0], "profile": "power", "exponent": 0.16}}
    tree["cable"] = {**tree["cable"], "diameter": 0.01}
    members = cp.ensemble.design(cp.make_scene(tree), {"wind.profile": ["power", "uniform"]})
    assert np.isnan(members["wind_exponent"]).values.tolist() == [False, True]
    tree["wind"] = {"speed": 5.0, "direction": [1.0, 0.0], "profile": "uniform"}
    alone = cp.chain.rest(cp.make_scene(tree))
    np.testing.assert_array_equal(cp.chain.rest(members.isel(member=1))["position"], alone["position"])
    with pytest.raises(
        cp.SceneError, match=r"wind_exponent: given nan; allowed: .*; try: scene\.drop_vars\('wind_exponent'\)$"
    ):
        cp.chain.rest(members.isel(member=1, drop=True))
