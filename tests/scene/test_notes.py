"""Notes on unusual scenes: units a thousand or a million times off, each threshold, and the warning of the models."""

from __future__ import annotations

import copy
import inspect
import itertools
import math
import re
import warnings

import pytest

import cablepod as cp
from cablepod import examples

#: A steel guy, as an engineer gives it; nothing is unusual about it.
GUY = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 7850.0, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.2, "angular_frequency": 1.0}}},
    "load": {"uniform": [15.0, 0.0]},
    "time": {"duration": 10.0, "interval": 1.0},
    "chain": {"links": 8},
}
#: Keys of the cable that can stand for others, with the value of the same cable.
OTHER_KEYS = {
    "specific_weight": 77000.0,
    "bottom_tension": 14000.0,
    "horizontal_force": 5000.0,
    "unstretched_length": 61.16,
    "breaking_strength": 1.2e5,
}
KEYS = ("youngs_modulus", "area", "density", "top_tension", *OTHER_KEYS, "ends")
FACTORS = (1e-6, 1e-3, 1e3, 1e6)


def guy(**changes):
    """The steel guy with keys of its cable changed; a key of length or weight takes the place of the other."""
    mapping = copy.deepcopy(GUY)
    for key, value in changes.items():
        if key in ("bottom_tension", "horizontal_force", "unstretched_length"):
            del mapping["cable"]["top_tension"]
        if key == "specific_weight":
            del mapping["cable"]["density"]
        (mapping if key == "gravity" else mapping["cable"])[key] = value
    return mapping


def notes(mapping):
    """Notes of a scene, as pairs of a key and a text, the worst first; without what one key may explain."""
    lines = str(cp.summary(cp.make_scene(mapping)).note.values).splitlines()
    return [tuple(line.split(": ", 1)) for line in lines if not line.startswith("perhaps ")]


def said_of(mapping):
    """The refusal of a scene, or what a model warns of before it runs; "" of a usual scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", cp.UnusualSceneWarning)
        try:
            cp.chain.simulate(cp.make_scene(mapping), times=[0.0], step=1e-12)
        except (cp.SceneError, cp.UnusualSceneWarning) as said:
            return str(said).partition("; see cp.summary")[0]
    return ""


def scaled(key, factor):
    """The guy with one key in another unit."""
    if key == "ends":
        return {**GUY, "ends": {"lower": [0.0, 0.0], "upper": [20.4 * factor, 57.7 * factor]}}
    return guy(**{key: usual(key) * factor})


def usual(key):
    """The value of a key of the guy."""
    return {**GUY["cable"], **OTHER_KEYS, "gravity": 9.81}[key]


@pytest.mark.parametrize("key", OTHER_KEYS)
def test_a_usual_guy_has_no_notes(key):
    assert notes(GUY) == notes(guy(**{key: OTHER_KEYS[key]})) == []


# a gravity that is too small has no unit that would explain it
@pytest.mark.parametrize(
    ("key", "factor"), [*itertools.product(KEYS, FACTORS), *(("gravity", factor) for factor in FACTORS[2:])]
)
def test_another_unit_of_a_key_is_noted_or_refused_by_its_name(key, factor):
    named = {"ends": "ends.upper", "gravity": "gravity"}.get(key, f"cable.{key}")
    mapping = scaled(key, factor)
    said = said_of(mapping)
    remedy = said.partition("; try: ")[2]
    assert named in remedy, said
    if ": the scene has " in said:  # a warning
        assert said.startswith(named), said
    # the value that is meant is told; an area 1000 times too large may also be one in cm2
    if key != "ends" and (key, factor) != ("area", 1e3):
        told = re.search(rf"{re.escape(named)} = (\S+)", remedy)
        assert told is not None, said
        assert float(told[1]) == pytest.approx(usual(key), rel=1e-5)


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [
        ("youngs_modulus", 160.0, "GPa"),
        ("youngs_modulus", 1.6e5, "MPa"),
        ("area", 125.0, "mm2"),
        ("area", 1.25, "cm2"),
        ("density", 7.85, "t/m3"),
        ("specific_weight", 77.0, "kN/m3"),
        ("top_tension", 15.0, "kN"),
        ("gravity", 9810.0, "mm/s2"),
        ("unstretched_length", 61160.0, "mm"),
        ("breaking_strength", 120.0, "kN"),
    ],
)
def test_the_unit_is_named(key, value, unit):
    assert f"(given in {unit}?)" in said_of(guy(**{key: value}))


WIND = {"speed": 20.0, "direction": [1.0, 0.0]}


@pytest.mark.parametrize(("given", "meant"), [("17", "0.017"), ("12.7", "0.0127")])
@pytest.mark.parametrize(
    ("more", "key"), [({"breaking_strength": 1.5e5}, "cable.diameter"), ({"strand": "EHS 1/2 in"}, "cable.diameter")]
)
def test_a_diameter_in_millimetres_is_refused_with_metres(given, meant, more, key):
    mapping = guy(**more, diameter=float(given))
    if "strand" in more:
        mapping["cable"] = {"top_tension": 15000.0, **more, "diameter": float(given)}
    with pytest.raises(cp.SceneError, match=rf"^{key}: given {given}\S*; allowed: .* try: {meant} \(given in mm\?\)$"):
        cp.make_scene(mapping)


@pytest.mark.parametrize("wind", [{}, {"wind": WIND}])
def test_ice_in_millimetres_is_refused_with_metres(wind):
    mapping = guy(diameter=0.016) | wind
    with pytest.raises(cp.SceneError, match=r"^ice.thickness: given 10\S*; allowed: .* try: 0.01 \(given in mm\?\)$"):
        cp.make_scene(mapping | {"ice": {"thickness": 10.0}})
    mapping = guy(diameter=0.016) | wind | {"ice": {"thickness": 0.4}}
    assert "ice.thickness" in dict(notes(mapping))


@pytest.mark.parametrize("ice", [{}, {"ice": {"thickness": 0.01}}])
@pytest.mark.parametrize(("factor", "unit"), [(100.0, "cm"), (1000.0, "mm")])
def test_a_diameter_that_the_area_contradicts_is_noted_with_its_unit(ice, factor, unit):
    mapping = guy(diameter=0.0029 * factor, area=4.0e-6, top_tension=500.0, breaking_strength=6000.0) | ice
    del mapping["load"]
    said = said_of(mapping)
    assert said.startswith("cable.diameter: "), said
    assert f"cable.diameter = 0.0029 (given in {unit}?)" in said
    assert notes(guy(diameter=0.016) | ice) == []


@pytest.mark.parametrize(
    ("temperatures", "key", "asked"),
    [
        ({"temperature": 268.0}, "temperature", "kelvins? 268 K are -5.15 degC"),
        ({"temperature": -5.0, "reference_temperature": 293.15}, "reference_temperature", "kelvins? 293.15 K are 20 degC"),
        ({"temperature": 268.0, "reference_temperature": 293.15}, "temperature", "kelvins? 268 K are -5.15 degC"),
        ({"temperature": 125.0}, "temperature", "105 K from the reference temperature of 20 degC"),
    ],
)  # fmt: skip
def test_temperatures_in_kelvins_are_noted(temperatures, key, asked):
    mapping = guy(thermal_expansion=1.2e-5) | temperatures
    ((found, text),) = notes(mapping)
    assert found == key
    assert asked in text
    assert "kelvins" in text
    with pytest.warns(cp.UnusualSceneWarning, match=f"^{key}: "):
        cp.chain.simulate(cp.make_scene(mapping), step=1e-3, times=[0.0])
    usual = {"temperature": -40.0, "reference_temperature": 10.0}
    assert notes(guy(thermal_expansion=1.2e-5) | usual) == []


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        ("gravity", 31.0, "gravity"),
        ("gravity", 0.00981, "gravity"),
        ("gravity", 9.81e-6, "gravity"),
        ("cable.density", 499.0, "cable.density"),
        ("cable.density", 25001.0, "cable.density"),
        ("cable.top_tension", 2.6e9 * 1.25e-4, "cable.top_tension"),
        ("motion.upper.x.amplitude", 6.2, "motion.upper.x"),
        ("load", {"uniform": [970.0, 0.0], "kind": "ramp", "amplitude": 1.0, "duration": 5.0}, "load.uniform"),
        ("point_load", [{"arc_length": 0.5, "force": [0.0, -6e4]}], "point_load.force"),
        ("ends.upper", [20.4, -57.7], "ends.upper"),
        ("cable.breaking_strength", 14000.0, "cable.breaking_strength"),
    ],
)
def test_each_threshold(path, value, key):
    mapping = copy.deepcopy(GUY)
    *tables, name = path.split(".")
    table = mapping
    for part in tables:
        table = table[part]
    table[name] = value
    assert key in dict(notes(mapping))


@pytest.mark.parametrize(
    ("change", "order"),
    [  # notes on the cable, then those on its tables, the worst of each first
        ({"gravity": 31.0, "density": 50.0}, ["cable.density", "gravity"]),
        ({"gravity": 310.0, "density": 490.0}, ["gravity", "cable.density"]),
        ({"wind": {"air_density": 3.0}, "ice": {"density": 9000.0}}, ["ice.density", "wind.air_density"]),
        ({"wind": {"air_density": 300.0}, "ice": {"density": 1100.0}}, ["wind.air_density", "ice.density"]),
        ({"wind": {"air_density": 300.0}, "density": 490.0}, ["cable.density", "wind.air_density"]),
    ],
)
def test_the_worst_note_is_the_first(change, order):
    mapping = guy(diameter=0.016, **{key: change[key] for key in ("gravity", "density") if key in change})
    mapping["wind"] = {"speed": 5.0, "direction": [1.0, 0.0]} | change.get("wind", {})
    mapping["ice"] = {"thickness": 0.005} | change.get("ice", {})
    assert [key for key, _ in notes(mapping) if key in order] == order


@pytest.mark.parametrize(
    ("function", "bound"),
    [
        ({"kind": "one_minus_cosine", "amplitude": -3.5, "angular_frequency": 1.0}, 7.0),
        ({"kind": "harmonic", "amplitude": 3.5, "angular_frequency": 1.0, "phase": -1.5707963267948966}, 7.0),
        ({"kind": "ramp", "amplitude": -7.0, "duration": 2.0}, 7.0),
        ({"kind": "polynomial", "coefficients": [0.0, 0.07]}, 7.0),  # at the end, 10 s
    ],
)
def test_the_largest_motion_is_that_of_the_run(function, bound):
    mapping = {**GUY, "motion": {"upper": {"y": function}}}
    numbers = cp.summary(cp.make_scene(mapping))
    assert float(numbers.motion_over_chord) == pytest.approx(bound / math.hypot(20.4, 57.7), rel=1e-12)
    assert "motion.upper.y" in dict(notes(mapping))


#: Shipped scenes that are unusual on purpose: lengths as printed in the paper, a folded chain, a whip.
UNUSUAL = {"example2_as_printed", "example2_soft", "example3_as_printed", "example4_as_printed", "folded_chain", "whip"}


@pytest.mark.parametrize("name", [name for name in examples.scenes() if not name.startswith("mast")])
def test_shipped_scenes_are_usual_but_for_some(name):
    assert bool(str(cp.summary(examples.scene(name)).note.values)) == (name in UNUSUAL)


# --- the warning --------------------------------------------------------------------------------------------------------

UNUSUAL_GUY = guy(density=7.85, top_tension=1500.0)


def unusual_scene(**changes):
    return cp.make_scene({**UNUSUAL_GUY, **changes})


def warned(function, *arguments, **options):
    """Call a function; return its warnings of unusual scenes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        function(*arguments, **options)
    return [item for item in caught if issubclass(item.category, cp.UnusualSceneWarning)]


MODELS = {
    "chain": lambda scene: cp.chain.simulate(scene, times=[0.0, 0.01], step=1e-5),
    "cable": lambda scene: cp.cable.simulate(scene, times=[0.0, 0.01], step=1e-6, elements=4),
    "rigid": lambda scene: cp.rigid.simulate(
        scene.drop_vars("cable_top_tension").assign(cable_unstretched_length=62.0), times=[0.0, 0.01], step=1e-3
    ),
}


@pytest.mark.parametrize("model", MODELS)
def test_full_models_warn_once_at_the_users_line(model):
    found = warned(MODELS[model], unusual_scene())
    assert len(found) == 1
    assert found[0].filename == __file__
    assert 0 <= found[0].lineno - inspect.getsourcelines(MODELS[model])[1] <= 2
    assert str(found[0].message).startswith("cable.density: the scene has a density of 7.85 kg/m3")
    assert "try: cable.density = 7850 (given in t/m3?)" in str(found[0].message)
    assert warned(MODELS[model], cp.make_scene(GUY)) == []


def test_reduced_models_warn_once():
    usual, scene = cp.make_scene(GUY), unusual_scene()
    chain = cp.chain.simulate(usual, tolerance=1e-3)
    modes, normal = cp.pod.decompose(chain, rank=2), cp.pod.decompose(chain, rank=2, layout="normal")
    options = {"times": [0.0, 0.01], "step": 1e-5}
    for simulate, of in ((cp.galerkin.simulate, modes), (cp.condensed.simulate, normal)):
        for _ in range(2):  # the second time the scene is known
            found = warned(simulate, scene, of, rank=1, **options)
            assert [item.filename for item in found] == [__file__]
        assert warned(simulate, usual, of, rank=1, **options) == []


def test_a_model_prepared_for_a_host_warns():
    usual, scene = cp.make_scene(GUY), unusual_scene()
    normal = cp.condensed.vibration_modes(usual, rank=2)
    assert [item.filename for item in warned(cp.condensed.prepare, scene, normal)] == [__file__]
    assert warned(cp.condensed.prepare, usual, normal) == []


@pytest.mark.parametrize("model", ["chain", "cable", "rigid"])
def test_members_warn_once(model):
    scenes = cp.ensemble.design(unusual_scene(), {"cable.top_tension": [1000.0, 2000.0]}, members=12)
    found = warned(MODELS[model], scenes)
    assert len(found) == 1
    assert found[0].filename == __file__


def test_a_weightless_line_is_noted_for_its_gravity_alone(soft):
    # a weightless line longer than its span, which starts from given points
    line = {"points": [[0.0, 0.0], [4.0, 4.0], [8.0, 6.0]]}
    cable = {"youngs_modulus": 2e9, "area": 1e-5, "density": 1000.0, "unstretched_length": 12.0}
    scene = cp.make_scene({**soft, "gravity": 0.0, "cable": cable, "initial": line})
    (only,) = warned(cp.chain.simulate, scene, times=[0.0, 0.01], step=1e-5)
    assert str(only.message).startswith("gravity: the scene has a gravitational acceleration of 0")


# --- tables beside the cable ---------------------------------------------------------------------------------------------

AIRY = guy(diameter=0.016) | {"wind": WIND}
SINE = {"kind": "harmonic", "amplitude": 0.2, "angular_frequency": 1.0}


@pytest.mark.parametrize(
    ("change", "key", "said"),
    [
        ({"wind": {**WIND, "speed": 86.4}}, "wind.speed", "given in km/h? 86.4 km/h are 24 m/s"),
        ({"wind": {**WIND, "air_density": 1250.0}}, "wind.air_density", "1.25e+03 kg/m3 (usual: 0.5 to 2 kg/m3)"),
        ({"wind": {**WIND, "ramp": 11.0}}, "wind.ramp", "11 s, longer than the run of 10 s"),
        ({"ice": {"thickness": 0.01, "density": 0.9}}, "ice.density", "0.9 kg/m3 (usual: 100 to 1000 kg/m3)"),
        ({"ice": {"thickness": 0.01, "density": 7000.0}}, "ice.density", "7e+03 kg/m3"),
        ({"damping": {"ratio": 0.5}}, "damping.ratio", "given in %?"),
        ({"damping": {"ratios": [0.01, 0.5]}}, "damping.ratios", "given in %?"),
        ({"motion": {"upper": {"x": {**SINE, "phase": 90.0}}}}, "motion.upper.x.phase", "90 degrees are 1.571 rad"),
        ({"motion": {"upper": {"x": {**SINE, "phase": -90.0}}}}, "motion.upper.x.phase", "given in degrees?"),
        ({"load": {"uniform": [15.0, 0.0], **SINE, "phase": 90.0}}, "load.phase", "given in degrees?"),
        ({"gravity": 0.0}, "gravity", "acceleration of 0"),
    ],
)
def test_tables_beside_the_cable_are_noted(change, key, said):
    found = notes(AIRY | change)
    assert [said in text for of, text in found if of == key] == [True], found


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"wind": {**WIND, "speed": 60.0, "air_density": 0.6, "ramp": 10.0}},
        {"ice": {"thickness": 0.01, "density": 917.0}},
        {"damping": {"ratio": 0.1}},
        {"motion": {"upper": {"x": {**SINE, "phase": -6.2832}}}},
    ],
)
def test_usual_tables_have_no_notes(change):
    assert notes(AIRY | change) == []


@pytest.mark.parametrize("kind", ["cable", "mast"])
@pytest.mark.parametrize(("interval", "said"), [(0.1, "first frequency of 3.09 Hz"), (0.06, "")])
def test_gusts_with_few_samples_in_a_period_are_noted(kind, interval, said):
    """A guy of 20 m, 15 kN and 0.981 kg/m: 3.09 Hz."""
    gusts = {"wind": {**WIND, "turbulence": {"spectrum": "kaimal", "interval": interval}}}
    cable = {**GUY["cable"], "diameter": 0.016}
    if kind == "mast":
        del cable["top_tension"]
        guys = {
            "cable": "a",
            "level": 18.856,
            "radius": 6.6667,
            "count": 3,
            "direction": [1.0, 0.0, 0.0],
            "top_tension": 15000.0,
        }
        mast = {"height": 20.0, "bending_stiffness": 2e7, "mass": 40.0, "drag_area": 0.4}
        mapping = {"mast": mast, "cables": {"a": cable}, "guy": [guys], "time": GUY["time"]}
        mapping |= {"wind": {**gusts["wind"], "direction": [1.0, 0.0, 0.0]}}
    else:
        mapping = {**GUY, "cable": cable, "ends": {"lower": [0.0, 0.0], "upper": [6.6667, 18.856]}} | gusts
    found = [text for key, text in notes(mapping) if key == "wind.turbulence.interval"]
    assert [said in text for text in found] == [True] * bool(said), found


def test_a_drag_coefficient_above_three_is_noted():
    mapping = guy(diameter=0.016, drag_coefficient=3.1) | {"wind": WIND}
    assert [key for key, _ in notes(mapping)] == ["cable.drag_coefficient"]


@pytest.mark.parametrize("ice", [{}, {"ice": {"thickness": 0.01}}])
def test_a_mass_that_contradicts_the_diameter_is_noted(ice):
    mapping = guy(axial_stiffness=2e7, mass_per_length=14.2, diameter=0.017) | {"wind": WIND} | ice
    for key in ("youngs_modulus", "area", "density"):
        del mapping["cable"][key]
    ((key, text),) = notes(mapping)
    # 14.2 / (pi / 4 0.017^2) = 62.6e3
    assert (key, "6.26e+04 kg/m3" in text) == ("cable.mass_per_length", True)
    said = said_of(mapping)
    assert "try: cable.mass_per_length = 1.4475 (given in N/m?)" in said, said
    mapping["cable"]["mass_per_length"] = 1.42
    assert notes(mapping) == []


def test_what_a_table_has_does_not_hide_the_unit_of_the_cable():
    mapping = guy(density=7.85, diameter=0.016) | {"wind": {**WIND, "speed": 86.4}}
    said = said_of(mapping)
    assert "try: cable.density = 7850 (given in t/m3?)" in said, said
    # and what one key cannot explain has no remedy
    said = said_of(AIRY | {"wind": {**WIND, "speed": 86.4}})
    assert said.startswith("wind.speed: ")
    assert "try: " not in said
