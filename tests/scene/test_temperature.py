"""Temperature: the same cable, longer or shorter; against catenaries of fifty digits."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import xarray as xr
from references import catenary_mpmath as reference

import cablepod as cp

ALPHA = 1.15e-5
GUY = {
    "gravity": 10.0,
    "cable": {"axial_stiffness": 2e7, "mass_per_length": 1.0, "top_tension": 15000.0, "thermal_expansion": ALPHA},
    "ends": {"lower": [0.0, 0.0], "upper": [20.0, 50.0]},
    "time": {"duration": 1.0, "interval": 0.25},
    "chain": {"links": 12},
}
MOTION = {"upper": {"x": {"kind": "ramp", "amplitude": -0.02, "duration": 0.5}}}


def guy(temperature=None, reference_temperature=None, **changes):
    mapping = copy.deepcopy(GUY) | {
        name: value
        for name, value in (("temperature", temperature), ("reference_temperature", reference_temperature))
        if value is not None
    }
    for name, value in changes.items():
        mapping["cable"][name] = value
    mapping["cable"] = {name: value for name, value in mapping["cable"].items() if value is not None}
    return cp.make_scene(mapping)


def longer(scene, factor):
    """The same cable without a temperature: unstretched length times a factor, mass kept."""
    length = float(cp.catenary.rest(scene)["unstretched_length"])
    return guy(
        thermal_expansion=None, top_tension=None, unstretched_length=factor * length, mass_per_length=1.0 / factor
    )


@pytest.mark.parametrize("temperature", [-40.0, -20.0, 0.0, 20.0, 60.0])
def test_tension_by_temperature_is_that_of_fifty_digits(temperature):
    MP = reference.MP
    given = reference.from_quantity(20.0, 50.0, 10.0, 2e7, 0, 15000.0)
    factor = 1 + MP.mpf(ALPHA) * (MP.mpf(temperature) - 20)
    cable = reference.from_length(20.0, 50.0, 10 / factor, 2e7, given.length * factor)
    rest = cp.catenary.rest(guy(temperature))
    for name, value in (
        ("unstretched_length", cable.length),
        ("horizontal_force", cable.force),
        ("tension_lower", cable.tension(0)),
        ("tension_upper", cable.tension(cable.length)),
    ):
        # the rounding of the length is that of the forces times K/T, up to 3e3
        assert float(abs(float(rest[name]) / value - 1)) < 3e-12, name


def test_at_the_reference_temperature_nothing_changes():
    plain = cp.catenary.rest(guy())
    for scene in (guy(20.0), guy(-5.0, -5.0)):
        assert cp.catenary.rest(scene).equals(plain)
    assert float(cp.catenary.rest(guy(20.0, -5.0))["tension_upper"]) < 15000.0


@pytest.mark.parametrize("key", ["top_tension", "bottom_tension", "horizontal_force", "sag", "unstretched_length"])
def test_what_is_given_holds_at_the_reference_temperature(key):
    known = cp.summary(guy())
    name = {"top_tension": "tension_upper", "bottom_tension": "tension_lower", "sag": "sag_below_chord"}.get(key, key)
    given = {"top_tension": None, key: float(known[name])}
    cold, one = (cp.catenary.rest(scene) for scene in (guy(-30.0), guy(-30.0, **given)))
    for number in ("unstretched_length", "tension_upper", "tension_lower"):
        assert float(one[number]) == pytest.approx(float(cold[number]), rel=1e-10)


def test_every_model_has_the_cable_at_its_temperature():
    factor = 1.0 + ALPHA * (-30.0 - 20.0)
    same = longer(guy(), factor).assign_attrs(title="same")
    cold = guy(-30.0)
    assert float(cp.summary(cold)["mass_per_length"]) == pytest.approx(1.0 / factor, rel=1e-15)
    for calls in (cp.chain.rest, cp.cable.rest):
        np.testing.assert_allclose(calls(cold)["tension"], calls(same)["tension"], rtol=1e-10)
    np.testing.assert_allclose(
        cp.cable.frequencies(cold)["angular_frequency"], cp.cable.frequencies(same)["angular_frequency"], rtol=1e-10
    )
    cold, same = (
        cp.make_scene({**mapping, "motion": MOTION})
        for mapping in (
            {**GUY, "temperature": -30.0},
            {
                **GUY,
                "cable": {
                    "axial_stiffness": 2e7,
                    "mass_per_length": 1.0 / factor,
                    "unstretched_length": float(cp.catenary.rest(same)["unstretched_length"]),
                },
            },
        )
    )
    modes = cp.condensed.vibration_modes(cold, rank=3)
    np.testing.assert_allclose(modes["mode_shape"], cp.condensed.vibration_modes(same, rank=3)["mode_shape"], atol=1e-8)
    run = cp.chain.simulate(same, step=1e-3, scheme="trapezoidal")
    pod = cp.pod.decompose(run, rank=2)
    for call in (
        lambda scene: cp.chain.simulate(scene, step=1e-3, scheme="trapezoidal"),
        lambda scene: cp.cable.simulate(scene, elements=4, step=1e-4),
        lambda scene: cp.condensed.simulate(scene, modes, step=1e-3),
        lambda scene: cp.condensed.simulate(scene, modes, step=1e-4, order="exact"),
        lambda scene: cp.galerkin.simulate(scene, pod, step=1e-4),
    ):
        np.testing.assert_allclose(call(cold)["position"], call(same)["position"], rtol=0, atol=1e-8)
    one, other = cp.condensed.prepare(cold, modes), cp.condensed.prepare(same, modes)
    np.testing.assert_allclose(one.force, other.force, rtol=1e-9)
    again = cp.condensed.resume(one.dataset())
    np.testing.assert_allclose(again.force, one.force, rtol=1e-15)


def test_rigid_links_expand():
    given = {"top_tension": None, "unstretched_length": 60.0}
    warm = guy(120.0, **given)
    same = guy(thermal_expansion=None, top_tension=None, unstretched_length=60.0 * (1.0 + 100.0 * ALPHA))
    for call in (cp.rigid.rest, lambda scene: cp.rigid.simulate(scene, step=2e-3)):
        np.testing.assert_allclose(call(warm)["position"], call(same)["position"], rtol=0, atol=1e-9)


def test_segments_and_attached_masses_are_at_the_temperature():
    factor = 1.0 - 40.0 * ALPHA
    parts = {
        "segment": [{"from": 0.0, "to": 0.5}, {"from": 0.5, "mass_per_length": 2.0}],
        "attachment": [{"arc_length": 0.3, "mass": 5.0}],
    }
    for chosen in (["segment"], ["attachment"], ["segment", "attachment"]):
        own = {name: copy.deepcopy(parts[name]) for name in chosen}
        given = cp.make_scene({**GUY, **own})
        cold = cp.catenary.rest(cp.make_scene({**GUY, **own, "temperature": -20.0}))
        cable = {
            "axial_stiffness": 2e7,
            "mass_per_length": 1.0 / factor,
            "unstretched_length": factor * float(cp.catenary.rest(given)["unstretched_length"]),
        }
        if "segment" in own:
            own["segment"][1]["mass_per_length"] = 2.0 / factor
        same = cp.catenary.rest(cp.make_scene({**GUY, **own, "cable": cable}))
        assert float(cold["tension_upper"]) > 20000.0
        for name in ("unstretched_length", "tension_lower", "tension_upper"):
            assert float(cold[name]) == pytest.approx(float(same[name]), rel=1e-9), (chosen, name)


def place_of_mass(scene, mass):
    """Arc length [m] of the particle of the chain at rest that bears an attached mass."""
    rest = cp.chain.rest(scene, links=30)
    length, reach = np.diff(rest.arc_length), np.diff(rest.position, axis=0)
    force = rest.tension.values * reach[:, 1] / np.linalg.norm(reach, axis=1)
    borne = np.diff(force) / float(scene.gravity)
    at = int(np.argmax(borne))
    assert mass < borne[at] < mass + 3.0 * length.max()  # with the rope beside it, of at most 3 kg/m
    return float(rest.arc_length[1 + at])


def test_a_distance_is_on_the_same_piece_of_rope_at_every_temperature():
    # 0.3 of a length, and the distance of this place at the reference temperature, are one place; so are the border of the
    # segments and the distance at which it is, where another place would leave a sliver of an element
    cable = {name: value for name, value in GUY["cable"].items() if name != "top_tension"} | {
        "unstretched_length": 100.0
    }
    segments = [
        {"to": 0.3, "thermal_expansion": 2.3e-5},
        {"to": 0.7, "mass_per_length": 3.0},
        {"thermal_expansion": 0.0},
    ]
    scene = {**GUY, "cable": cable, "temperature": 80.0, "segment": segments}
    for place in (0.1, 0.3, 0.5, 0.9):
        found = []
        for given in (
            {"arc_length": place},
            {"distance_from_lower": 100.0 * place},
            {"distance_from_upper": 100.0 - 100.0 * place},
        ):
            warm = cp.make_scene({**scene, "attachment": [{**given, "mass": 50.0}]})
            found.append(place_of_mass(warm, 50.0))
        below = min(place, 0.3) * 2.3e-5 + max(min(place, 0.7) - 0.3, 0.0) * ALPHA  # part times coefficient
        assert found == pytest.approx([100.0 * (place + 60.0 * below)] * 3, rel=1e-13), place


def test_ice_grows_on_the_cable_at_its_temperature():
    mapping = {**copy.deepcopy(GUY), "temperature": -20.0, "ice": {"thickness": 0.01}}
    mapping["cable"]["diameter"] = 0.016
    iced = cp.make_scene(mapping)
    bare = guy(-20.0)
    lengths = [float(cp.catenary.rest(scene)["unstretched_length"]) for scene in (iced, bare)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-15)
    mass = 1.0 / (1.0 - 40.0 * ALPHA) + 700.0 * math.pi * 0.01 * 0.026
    assert float(cp.summary(iced)["mass_per_length"]) == pytest.approx(mass, rel=1e-14)


def test_the_scene_keeps_temperatures_and_old_scenes_their_ids(tmp_path):
    scene = guy(-20.0, 10.0)
    assert float(scene["temperature"]) == -20.0
    assert scene["temperature"].attrs["units"] == scene["reference_temperature"].attrs["units"] == "degC"
    assert scene["cable_thermal_expansion"].attrs["units"] == "K-1"
    cp.archive.write(scene, tmp_path / "scene.nc")
    again = cp.archive.read(tmp_path / "scene.nc")
    xr.testing.assert_identical(again.drop_attrs(), scene.drop_attrs())
    assert again.attrs["id"] == scene.attrs["id"] != guy(-21.0, 10.0).attrs["id"]
    assert not {"temperature", "reference_temperature"} & set(guy().variables)
    (tmp_path / "scene.toml").write_text(
        "temperature = -20.0\nreference_temperature = 10\ngravity = 10.0\n"
        "[cable]\naxial_stiffness = 2e7\nmass_per_length = 1.0\ntop_tension = 15000.0\nthermal_expansion = 1.15e-5\n"
        "[ends]\nlower = [0, 0]\nupper = [20, 50]\n[time]\nduration = 1\ninterval = 0.25\n[chain]\nlinks = 12\n"
    )
    assert cp.read_scene(tmp_path / "scene.toml").attrs["id"] == scene.attrs["id"]


@pytest.mark.parametrize("start", [None, 5.0])
def test_a_temperature_is_an_axis_of_an_ensemble(start):
    scene = cp.make_scene({**GUY, "motion": MOTION} | ({} if start is None else {"temperature": start}))
    members = cp.ensemble.design(scene, {"temperature": [-40.0, 40.0, 3], "cable.top_tension": [9e3, 15e3, 2]})
    assert members["temperature"].dims == ("member",)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    together = cp.condensed.simulate(members, modes, step=1e-3)
    rest = cp.catenary.rest(members)
    for k in range(members.sizes["member"]):
        values = members.isel(member=k)
        single = cp.make_scene(
            {
                **GUY,
                "motion": MOTION,
                "temperature": float(values["temperature"]),
                "cable": {**GUY["cable"], "top_tension": float(values["cable_top_tension"])},
            }
        )
        np.testing.assert_allclose(
            together["position"][k], cp.condensed.simulate(single, modes, step=1e-3)["position"], rtol=0, atol=1e-9
        )
        assert float(rest["tension_upper"][k]) == pytest.approx(
            float(cp.catenary.rest(single)["tension_upper"]), rel=1e-14
        )


def test_a_temperature_in_the_table_of_an_ensemble():
    mapping = {**GUY, "ensemble": {"ranges": {"temperature": [-40.0, 40.0, 3]}}}
    members = cp.ensemble.design(cp.make_scene(mapping))
    assert members["temperature"].values.tolist() == [-40.0, 0.0, 40.0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"thermal_expansion": None}, r"^temperature: given -20\.0; allowed: none without cable\.thermal_expansion \[1/K\], 0"),
        ({"thermal_expansion": 11.5}, r"^cable\.thermal_expansion: given 11\.5; allowed: a finite number of at least -0\.0005"),
        ({"temperature": -300.0}, r"^temperature: given -300\.0; allowed: a finite number of at least -273\.15 and of at most"),
        ({"reference_temperature": "warm"}, r"^reference_temperature: given 'warm'; allowed: a finite number"),
    ],
)  # fmt: skip
def test_wrong_temperatures_are_refused_by_key(changes, message):
    with pytest.raises(cp.SceneError, match=message):
        guy(**{"temperature": -20.0, **changes})


def test_a_reference_without_expansion_is_refused_too():
    with pytest.raises(
        cp.SceneError, match=r"^reference_temperature: given 10\.0; allowed: none without cable\.thermal_exp"
    ):
        guy(None, 10.0, thermal_expansion=None)
    with pytest.raises(
        cp.SceneError, match=r"^temperature: given -20\.0; allowed: none without cable\.thermal_expansion"
    ):
        cp.catenary.rest(guy(thermal_expansion=None).assign(temperature=-20.0))
    with pytest.raises(cp.SceneError, match=r"temperature: given .*none without cable\.thermal_expansion"):
        cp.ensemble.design(guy(thermal_expansion=None), {"temperature": [-40.0, 40.0, 3]})
    with pytest.raises(cp.SceneError, match=r"unknown key or table.*try: temperature"):
        cp.make_scene({**GUY, "temperatur": 5.0})


def test_a_weightless_cable_that_warms_has_no_rest():
    mapping = {**GUY, "gravity": 0.0, "cable": {**GUY["cable"], "top_tension": 100.0}, "temperature": 60.0}
    with pytest.raises(
        cp.SceneError, match=r"^temperature: given 'an unstretched length of .* m'; allowed: at most the chord"
    ):
        cp.make_scene(mapping)
