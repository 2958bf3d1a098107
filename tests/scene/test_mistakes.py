"""Every mistake in the values of a scene is answered by one clear error."""

from __future__ import annotations

import fractions
from typing import Any

import numpy as np
import pytest
from scene_files import LOAD, put, refused

import cablepod as cp

BIG = 10**400
BEYOND = 10**5000  # more digits than Python writes
RAMP = {"kind": "ramp", "amplitude": 1.0, "duration": 1.0}


def nested(depth: int) -> Any:
    value: Any = 1.0
    for _ in range(depth):
        value = [value]
    return value


MISTAKES = [
    # unknown and missing keys and tables
    ("cables", {}, r"^cables: unknown key or table; allowed: title, gravity, temperature, .*, cable, ends, .*; try: cable$"),
    ("cable.aera", 1.0, r"^cable\.aera: unknown key; allowed: youngs_modulus, axial_stiffness, area, specific_weight, .*"),
    ("ends.left", [0, 0], r"^ends\.left: unknown key; allowed: lower, upper, chord, inclination, free$"),
    ("time.step", 1.0, r"^time\.step: unknown key; allowed: duration, interval$"),
    ("chain.elements", 5, r"^chain\.elements: unknown key; allowed: links, link_lengths, masses, stiffness$"),
    (
        "damping.viscous",
        5.0,
        r"^damping\.viscous: unknown key; allowed: mass_proportional, link_viscosity, tension_proportional, ratio, ratios$",
    ),
    ("motion.top", {}, r"^motion\.top: unknown key; allowed: lower, upper$"),
    ("motion.upper.z", RAMP, r"^motion\.upper\.z: unknown axis; allowed: x, y$"),
    ("motion.upper.x.phase", 1.0, r"^motion\.upper\.x\.phase: unknown key; allowed: amplitude, angular_frequency, ramp$"),
    ("load", {"uniform": [0, 0], "up": 1}, r"^load\.up: unknown key; allowed: uniform, kind \(of a time factor\)$"),
    ("load", {"uniform": [0, 0], "phase": 1}, r"^load\.kind: missing; allowed: one of one_minus_cosine, .*file$"),
    ("cable", None, r"^cable: missing; allowed: a table with the keys youngs_modulus, "),
    ("ends", None, r"^ends: missing; allowed: a table with the keys lower, upper, chord, inclination, free$"),
    (
        "cable.area",
        None,
        r"^cable\.area: missing; allowed: area of the unstrained cross-section \[m2\], or cable\.axial_stiffness in place of "
        r"youngs_modulus and cable\.mass_per_length in place of density$",
    ),
    ("cable.youngs_modulus", None, r"^cable\.youngs_modulus: missing; allowed: Young's modulus \[Pa\], or cable\.axial_"),
    (
        "ends.upper",
        None,
        r"^ends\.upper: missing; allowed: position of the upper end at rest \[m\], or ends\.chord \[m\] with ends\.inclination",
    ),
    ("time.interval", None, r"^time\.interval: missing; allowed: time between snapshots \[s\]$"),
    ("chain.links", None, r"^chain\.links: missing; allowed: a whole number of at least 2, or chain\.link_lengths$"),
    ("motion.upper.x.kind", None, r"^motion\.upper\.x\.kind: missing; allowed: one of one_minus_cosine, "),
    ("motion.upper.x.amplitude", None, r"^motion\.upper\.x\.amplitude: missing; allowed: amplitude \[m\]$"),
    ("load", {}, r"^load\.uniform: missing; allowed: load per unstretched length, beside the weight \[N m-1\]$"),
    # ways to give length and weight
    (
        "cable.unstretched_length",
        9.0,
        r"^cable: given top_tension = 200\.0 and unstretched_length = 9\.0; allowed: exactly one of top_tension, "
        r"bottom_tension, horizontal_force, unstretched_length, sag$",
    ),
    ("cable.top_tension", None, r"^cable: given none; allowed: exactly one of top_tension, "),
    ("cable.specific_weight", 9.0, r"^cable: given specific_weight = 9\.0 and density = 1000\.0; allowed: exactly one"),
    ("cable.density", None, r"^cable: given none; allowed: exactly one of specific_weight, density, mass_per_length$"),
    # signs and sizes
    ("cable.youngs_modulus", 0, r"^cable\.youngs_modulus: given 0; allowed: a finite number above 0$"),
    ("cable.youngs_modulus", 1e25, r"^cable\.youngs_modulus: given 1e\+25; allowed: an axial stiffness of 1e-6 to 1e18"),
    ("cable.youngs_modulus", 1e-5, r"^cable\.youngs_modulus: given 1e-05; allowed: an axial stiffness of 1e-6 to 1e18"),
    ("cable.area", 0.0, r"^cable\.area: given 0\.0; allowed: a finite number above 0$"),
    ("cable.area", 1e-300, r"^cable\.area: given 1e-300; allowed: .* of a size from 1e-30 to 1e\+30$"),
    ("cable.density", 1e20, r"^cable\.density: given 1e\+20; allowed: 1e-15 to 1e15 kg/m and at most 1e15 N/m \(it is"),
    ("cable.density", 1e-20, r"^cable\.density: given 1e-20; allowed: 1e-15 to 1e15 kg/m"),
    ("gravity", 1e16, r"^cable\.density: given 1000\.0; allowed: .* at most 1e15 N/m \(it is 1 kg/m\)$"),
    ("chain.links", 1, r"^chain\.links: given 1; allowed: a whole number of at least 2$"),
    ("chain.links", 0, r"^chain\.links: given 0; allowed: a whole number of at least 2$"),
    ("chain.links", 8.0, r"^chain\.links: given 8\.0; allowed: a whole number of at least 2$"),
    ("chain.links", BIG, r"^chain\.links: given 1000\d+\.\.\.; allowed: .* at most 9007199254740992$"),
    ("chain.link_lengths", [1.0, 0.0], r"^chain\.link_lengths\[1\]: given 0\.0; allowed: a finite number above 0$"),
    ("chain.link_lengths", [1.0, 2.0], r"^chain\.link_lengths: given \[1\.0, 2\.0\]; allowed: 8 numbers, as many as"),
    ("chain", {"link_lengths": [1.0, 2e6]}, r"^chain\.link_lengths: .*differ by a factor of at most 1e6$"),
    ("chain.link_lengths", [1.0], r"^chain\.link_lengths: given \[1\.0\]; allowed: a list of at least 2 finite numbers$"),
    ("damping.link_viscosity", -1.0, r"^damping\.link_viscosity: given -1\.0; allowed: a finite number of at least 0$"),
    ("motion.upper.x.angular_frequency", -1, r"^motion\.upper\.x\.angular_frequency: given -1; allowed: .* least 0$"),
    ("motion.upper.x", {**RAMP, "duration": 0}, r"^motion\.upper\.x\.duration: given 0; allowed: .* above 0$"),
    ("time.interval", 0, r"^time\.interval: given 0; allowed: a finite number above 0$"),
    ("time.interval", 0.0, r"^time\.interval: given 0\.0; allowed: a finite number above 0$"),
    ("time.interval", 5.0, r"^time\.interval: given 5\.0; allowed: at most time\.duration, 4 s$"),
    ("time.duration", -4.0, r"^time\.duration: given -4\.0; allowed: a finite number above 0$"),
    # no numbers; others, of every key, are in test_two_hundred_mistakes.py
    ("cable.area", np.bool_(True), r"^cable\.area: given True; allowed: a finite number above 0$"),
    ("cable.area", fractions.Fraction(BIG, 3), r"^cable\.area: given Fraction.*; allowed: a finite number above 0$"),
    ("cable.area", BEYOND, r"^cable\.area: given something of type int that cannot be shown; allowed: a finite number above 0$"),
    (
        "chain.links",
        BEYOND,
        r"^chain\.links: given something of type int that cannot be shown; allowed: a whole number of at least 2 and",
    ),
    (
        "chain.links",
        -BEYOND,
        r"^chain\.links: given something of type int that cannot be shown; allowed: a whole number of at least 2$",
    ),
    ("gravity", -BIG, r"^gravity: given -1000\d+\.\.\.; allowed: a finite number of at least 0$"),
    ("gravity", 1e31, r"^gravity: given 1e\+31; allowed: a finite number of at least 0, of a size from 1e-30 to 1e\+30$"),
    ("ends.upper", [1.0, float("nan")], r"^ends\.upper\[1\]: given nan; allowed: a finite number$"),
    ("ends.upper", ["8", "6"], r"^ends\.upper\[0\]: given '8'; allowed: a finite number$"),
    ("ends.upper", [True, 6.0], r"^ends\.upper\[0\]: given True; allowed: a finite number$"),
    ("ends.upper", "86", r"^ends\.upper: given '86'; allowed: a list of two or three finite numbers$"),
    ("ends.upper", 8.0, r"^ends\.upper: given 8\.0; allowed: a list of two or three finite numbers$"),
    ("ends.upper", [8.0], r"^ends\.upper: given \[8\.0\]; allowed: a list of two or three finite numbers$"),
    ("ends.upper", np.array(8.0), r"^ends\.upper: given array\(8\.\); allowed: a list of two or three finite numbers$"),
    ("ends.upper", np.eye(2), r"^ends\.upper\[0\]: given array\(\[1\., 0\.\]\); allowed: a finite number$"),
    (
        "ends.upper",
        nested(100_000),
        r"^ends\.upper: given something of type list that cannot be shown; allowed: a list of two or",
    ),
    ("title", 5, r"^title: given 5; allowed: a text that is not empty$"),
    ("title", " ", r"^title: given ' '; allowed: a text that is not empty$"),
    # ends
    ("ends.upper", [0.0, 0.0], r"^ends\.upper: given \[0\.0, 0\.0\]; allowed: a point other than ends\.lower"),
    ("ends.upper", [1e-9, 0.0], r"^ends\.upper: .*allowed: a chord from 1e-06 m to 1e\+09 m \(it is 1e-09 m\)$"),
    ("ends.upper", [1e29, -1e29], r"^ends\.upper: .*allowed: a chord from 1e-06 m to 1e\+09 m"),
    (
        "ends.upper",
        [8, 6, 1],
        r"^ends\.upper: given 3 numbers; allowed: 2 numbers, for x, y; try: a spatial scene, with three numbers",
    ),
    ("ends.free", "top", r'^ends\.free: given \'top\'; allowed: one of "lower", "upper"$'),
    ("ends.free", ["upper"], r'^ends\.free: given \[\'upper\'\]; allowed: one of "lower", "upper"$'),
    ("ends.free", "upper", r"^motion\.upper: given one along x; allowed: no motion of the end that ends\.free names \(upper\)$"),
    # tensions that no cable has
    ("cable.top_tension", 10.0, r"^cable\.top_tension: given 10\.0; allowed: at least \d+\.\d+ N, the minimum over all lengths"),
    (
        "initial.top_tension",
        10.0,
        r"^initial\.top_tension: given 10\.0; allowed: at least \d+\.\d+ N, the minimum over all lengths",
    ),
    # the wrong kind of table
    ("cable", [1, 2], r"^cable: given \[1, 2\]; allowed: a table with the keys youngs_modulus, "),
    ("ends", "here", r"^ends: given 'here'; allowed: a table with the keys lower, upper, chord, inclination, free$"),
    ("motion", 5, r"^motion: given 5; allowed: tables motion\.lower\.x, motion\.upper\.y and so on$"),
    ("motion.upper", 5, r"^motion\.upper: given 5; allowed: tables motion\.upper\.x and so on$"),
    ("motion.upper.x", 5, r"^motion\.upper\.x: given 5; allowed: a table with the key kind$"),
    ("motion.upper.x.kind", "sine", r'^motion\.upper\.x\.kind: given \'sine\'; allowed: one of "one_minus_cosine", '),
    ("motion.upper.x.kind", 5, r'^motion\.upper\.x\.kind: given 5; allowed: one of "one_minus_cosine", '),
    ("load", 5, r"^load: given 5; allowed: a table with the keys uniform$"),
    ("time", [], r"^time: given \[\]; allowed: a table with the keys duration, interval$"),
    ("chain", 40, r"^chain: given 40; allowed: a table with the keys links, link_lengths, masses, stiffness$"),
    ("point_load", LOAD, r"^point_load: given \{.*\}; allowed: an array of tables, \[\[point_load\]\]$"),
    ("point_load", [5], r"^point_load\.1: given 5; allowed: a table with the keys arc_length, force$"),
    # loads
    ("load", {"uniform": [1, 2, 3]}, r"^load\.uniform: given 3 numbers; allowed: 2 numbers, for x, y; try: a spatial"),
    ("load", {"uniform": 9.81}, r"^load\.uniform: given 9\.81; allowed: a list of two or three finite numbers$"),
    ("load", {"uniform": [0, 0], "kind": "x"}, r'^load\.kind: given \'x\'; allowed: one of "one_minus_cosine"'),
    ("point_load", [LOAD, {**LOAD, "force": [1, 2, 3]}], r"^point_load\.2\.force: given .*; allowed: 2 numbers"),
    ("point_load", [{**LOAD, "arc_length": 1.5}], r"^point_load\.1\.arc_length: given 1\.5; .* least 0 and of at most 1$"),
    ("point_load", [{**LOAD, "arc_length": -0.1}], r"^point_load\.1\.arc_length: given -0\.1; allowed: a finite number"),
    ("point_load", [{"force": [0, 1]}], r"^point_load\.1\.arc_length: missing; allowed: place of the load as a fraction"),
    ("point_load", [{**LOAD, "at": 1}], r"^point_load\.1\.at: unknown key; allowed: arc_length, force, kind"),
    ("point_load", [{**LOAD, "kind": "ramp"}], r"^point_load\.1\.amplitude: missing; allowed: amplitude \[1\]$"),
    # the start
    ("initial", {}, r"^initial: given an empty table; allowed: one with some of top_tension, unstretched_length, points$"),
    ("initial", {"top_tension": 1, "unstretched_length": 1}, r"^initial: given top_tension = 1\.0 and unstretched_length"),
    ("initial.points", [[0, 0]], r"^initial\.points: given \[\[0, 0\]\]; allowed: a list of at least two points$"),
    ("initial.points", [[0, 0], [8]], r"^initial\.points\[1\]: given \[8\]; allowed: a list of two or three finite"),
    ("initial.points", [[0, 0], 8], r"^initial\.points\[1\]: given 8; allowed: a list of two or three finite"),
    ("initial.points", [[0, 0, 0], [8, 6, 0]], r"^initial\.points\[0\]: given 3 numbers; allowed: 2 numbers, for x, y"),
    ("initial.points", [[0, 0], [8, 6, 0]], r"^initial\.points\[1\]: given 3 numbers; allowed: 2 numbers, for x, y"),
    ("initial.points", [[0, 0], [8, 6.1]], r"^initial\.points: given \[8\.0, 6\.1\]; allowed: a line that begins and ends"),
    ("initial", {"points": [[0, 0], [8, 6], [8, 6.1]]}, r"^initial\.points: given \[8\.0, 6\.1\]; allowed: a line that"),
    ("initial.points", np.array(1.0), r"^initial\.points: given array\(1\.\); allowed: a list of at least two points$"),
    ("initial.points", [[0, 0], [1e30, -1e30], [8, 6.1]], r"^initial\.points: given \[8\.0, 6\.1\]; allowed: a line that"),
    # ensembles
    ("ensemble", 5, r"^ensemble: given 5; allowed: a table with the keys members, seed, sampling, ranges$"),
    ("ensemble", {"ranges": {"gravity": [1, 2]}}, r"^ensemble\.members: missing; allowed: number of members \[1\]$"),
    ("ensemble", {"members": 3}, r"^ensemble\.ranges: given None; allowed: a mapping from key paths to \[low, high\]$"),
    ("ensemble", {"members": 3, "ranges": {}}, r"^ensemble\.ranges: given \{\}; allowed: a mapping from key paths"),
    ("ensemble", {"members": 3, "ranges": []}, r"^ensemble\.ranges: given \[\]; allowed: a mapping from key paths"),
    ("ensemble.member", 5, r"^ensemble\.member: unknown key; allowed: members, seed, sampling, ranges; try: ensemble\.members$"),
    ("ensemble", {"members": 0}, r"^ensemble\.members: given 0; allowed: a whole number of at least 1$"),
    ("ensemble", {"members": np.bool_(True)}, r"^ensemble\.members: given True; allowed: a whole number of at least 1$"),
    ("ensemble", {"members": 10**9}, r"^ensemble\.members: given 1000000000; allowed: .* at most 10000000$"),
    ("ensemble", {"members": 3, "seed": -1}, r"^ensemble\.seed: given -1; allowed: a whole number of at least 0$"),
    # one more has no float, as which tables of members may hold it
    ("ensemble", {"members": 3, "seed": 2**53 + 1}, r"^ensemble\.seed: given 9007199254740993; .* at most 9007199254740992$"),
    ("wind", {"speed": 9.0, "direction": [1.0, 0.0], "turbulence": {"spectrum": "kaimal", "seed": 2**62}}, r"^wind\.turb.*0992$"),
    ("ensemble", {"members": 3, "sampling": "random"}, r'^ensemble\.sampling: given \'random\'; .*"sobol", "grid"$'),
]  # fmt: skip
#: The same in the table of a scene and in a call of ensemble.design.
RANGES = [
    ({"cable.tension": [1, 2]}, r"ranges\.cable\.tension: unknown key path; allowed: the path of a number"),
    ({"cable": [1, 2]}, r"ranges\.cable: unknown key path"),
    ({"ends.upper": [1, 2]}, r"ranges\.ends\.upper: unknown key path"),
    ({"title": [1, 2]}, r"ranges\.title: unknown key path"),
    ({5: [1, 2]}, r"ranges\.5: unknown key path"),
    ({"ensemble.members": [1, 2]}, r"ranges\.ensemble\.members: unknown key path"),
    ({"gravity": [2, 1]}, r"ranges\.gravity: given \[2, 1\]; allowed: \[low, high\] with low < high$"),
    ({"gravity": [1, 1]}, r"ranges\.gravity: given \[1, 1\]; allowed: \[low, high\] with low < high$"),
    ({"gravity": [1, 2, 2.5]}, r"ranges\.gravity: given \[1, 2, 2\.5\]; allowed: \[low, high, count\] with low"),
    ({"gravity": [1, 2, 1]}, r"ranges\.gravity: given \[1, 2, 1\]; .* a whole count of at least 2$"),
    ({"gravity": [2, 1, 3]}, r"ranges\.gravity: given \[2, 1, 3\]; allowed: .* with low < high"),
    ({"gravity": [1, 2, 4]}, r"members: given 3; allowed: 4, the product of the counts 4, or none given$"),
    ({"gravity": [1, 2, 10**9]}, r"members: given 1000000000; allowed: .* at most 10000000$"),
    ({"gravity": [1, 2, 3, 4]}, r"ranges\.gravity: given .*; lists of values need sampling \"grid\" or"),
    (
        {"gravity": [1, 2, 3], "cable.top_tension": [200, 300]},
        r"ranges\.cable\.top_tension: .*; allowed: \[low, high, count\], as (ensemble\.)?ranges\.gravity has a count$",
    ),
    ({"ends.upper": [1, 2, 3]}, r"ranges\.ends\.upper: unknown key path; .*; try: ends\.upper\.x or ends\.upper\.y$"),
    ({"gravity": 1.0}, r"ranges\.gravity: given 1\.0; allowed: a list of at least 2 finite numbers$"),
    ({"gravity": ["1", 2]}, r"ranges\.gravity\[0\]: given '1'; allowed: a finite number$"),
    ({"gravity": [-1, 2]}, r"ranges\.gravity: given \[-1\.0, 2\.0\], at -1 no scene: gravity: given -1\.0; "),
    (
        {"cable.top_tension": [10, 300]},
        r"ranges\.cable\.top_tension: given \[10\.0, 300\.0\], at 10 no scene: cable\.top_tension: given 10\.0; "
        r"allowed: at least ",
    ),
    ({"time.interval": [1, 5]}, r"ranges\.time\.interval: .* at 5 no scene: time\.interval: given 5\.0; .* time\.duration, 4 s$"),
    ({"chain.links": [5, 9]}, r"ranges\.chain\.links: given \[5, 9\]; allowed: a list of whole numbers, by sampling"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("path", "value", "match"), MISTAKES, ids=[f"{index}-{path}" for index, (path, _, _) in enumerate(MISTAKES)]
)
def test_a_mistake_is_named(soft, path, value, match):
    refused(put(soft, path, value), match)


@pytest.mark.parametrize(("ranges", "match"), RANGES, ids=[str(next(iter(item[0].items()))) for item in RANGES])
def test_a_mistake_in_a_range_is_named(soft, ranges, match):
    refused(soft | {"ensemble": {"members": 3, "ranges": ranges}}, rf"^ensemble\.{match}")
    with pytest.raises(cp.SceneError, match=f"^{match}"):
        cp.ensemble.design(cp.make_scene(soft), ranges, members=3)


@pytest.mark.parametrize("mapping", [None, 5, [], "cable", [("cable", 1)]])
def test_what_is_no_mapping(mapping):
    refused(mapping, r"^scene: given .*; allowed: a mapping with the tables of a scene; read_scene reads a file$")


@pytest.mark.parametrize(
    "name",
    [5, None, ("a",), BEYOND, "", "a\nb", "x" * 5000, "\ud800"],
    ids=lambda name: repr(name)[:9] if name != BEYOND else "beyond",
)
def test_strange_names_of_keys(soft, name):
    for table in (soft, soft["cable"], soft["motion"], soft["motion"]["upper"], soft["motion"]["upper"]["x"]):
        table[name] = 1.0
        refused(soft, r"(unknown key|unknown axis)[a-z ]*; allowed: ")
        del table[name]
    soft["load"] = {"uniform": [0, 0], name: 1}
    refused(soft, r"^load\..*: unknown key; allowed: ")


class Mute:
    """Something that cannot even be shown."""

    def __repr__(self):
        raise RuntimeError("no")


def test_a_value_that_cannot_be_shown(soft):
    refused(
        put(soft, "cable.area", Mute()),
        r"^cable\.area: given something of type Mute that cannot be shown; allowed: a finite number",
    )


@pytest.mark.parametrize("wrong", ["turbulance", "turbulenc"])
def test_a_misspelt_table_in_a_table_is_named(wrong, soft):
    soft["cable"]["diameter"] = 0.02
    wind = {"speed": 10.0, "direction": [1.0, 0.0], wrong: {"spectrum": "kaimal"}}
    with pytest.raises(cp.SceneError, match=rf"^wind\.{wrong}: .*allowed: .*, turbulence; try: wind\.turbulence$"):
        cp.make_scene({**soft, "wind": wind})


def test_parameters_as_an_index_of_members_are_refused(soft):
    members = cp.ensemble.design(
        cp.make_scene(soft), {"cable.top_tension": [200, 220], "gravity": [9.7, 9.81]}, members=2
    )
    given = members.set_index(member=["cable_top_tension", "gravity"])
    match = r'^scene: member: given an index of the parameters cable_top_tension, gravity; .*; try: reset_index\("member"\)$'
    for call in (cp.catenary.rest, cp.summary, cp.chain.rest):
        with pytest.raises(cp.SceneError, match=match):
            call(given)
    assert cp.catenary.rest(given.reset_index("member")).position.equals(
        cp.catenary.rest(members.drop_vars("member", errors="ignore")).position
    )
