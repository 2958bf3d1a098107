"""Limits of a scene: strains, tensions, memory and numbers that no cable and no machine has."""

from __future__ import annotations

import copy
import math

import pytest
from scene_files import put, refused

import cablepod as cp

ABSURD = {
    "a modulus in GPa": ({"cable.youngs_modulus": 20.0}, r"cable\.youngs_modulus: .* 0\.02 N, .* by 1e\+04; allowed: .* Pa"),
    "a short cable": (
        {"cable.top_tension": None, "cable.unstretched_length": 0.9},
        r"cable\.youngs_modulus: .* with unstretched_length = 0\.9 is strained by 10\.1; allowed: a strain of at most 10",
    ),
    "a long start": (
        {"initial.unstretched_length": 120.0},
        r"initial\.unstretched_length: given 120\.0; allowed: a start .* at most 11 times its length \(it is 12",
    ),
    "a wide start": (
        {"initial.points": [[0.0, 0.0], [0.0, 60.0], [8.0, 6.0]]},
        r"initial\.points: given .*; allowed: a start that stretches .* \(it is 11\.",
    ),
    "ends that part": (
        {"motion.upper.y": {"kind": "polynomial", "coefficients": [30.0]}},
        r"motion: given one that takes the ends 126\.\d+ m apart at 4 s; allowed: at most 11\d",
    ),
    "a heavy load": (
        {"point_load": [{"arc_length": 0.25, "force": [0.0, -5e7]}]},
        r"point_load\.1\.force: given loads of 5e\+07 N in all .*; allowed: .* of 20000 N, by at most 10 .* is 1\.25e\+03 or",
    ),
    "loads that part the cable": (
        {"point_load": [{"arc_length": 0.25, "force": [-5e5, 0.0]}, {"arc_length": 0.75, "force": [6e5, 0.0]}]},
        r"point_load\.2\.force: given loads of 6e\+05 N in all .* is 15 or more",
    ),
    "a load that grows": (
        {"load": {"uniform": [0.0, -10.0], "kind": "polynomial", "coefficients": [0.0, 0.0, 0.0, 20.0]}},
        r"load\.uniform: given loads of 5\.1\d+e\+05 N in all at their largest; .* is 12\.\d+ or more",
    ),
    "a load that comes and goes": (
        {"load": {"uniform": [0.0, -1e5], "kind": "one_minus_cosine", "amplitude": 1.0, "angular_frequency": 50.0 * math.pi}},
        r"load\.uniform: given loads of 2\.0\d+e\+06 N in all at their largest",
    ),
    "a free end that is pulled": (
        {
            "motion": {},
            "ends.free": "upper",
            "initial": {"points": [[0.0, 0.0], [8.0, 0.0]]},
            "point_load": [{"arc_length": 1.0, "force": [2.1e5, 0.0]}],
        },
        r"point_load\.1\.force: given loads of 2\.1e\+05 N .* is 10\.5 or more",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ABSURD)
def test_absurd_strains_are_refused(soft, name):
    changes, match = ABSURD[name]
    for path, value in changes.items():
        put(soft, path, value)
    with pytest.raises(cp.SceneError, match=match):
        cp.make_scene(soft)


def test_strains_as_of_rubber_are_not_refused(soft):
    # a load on a held end strains nothing, and half of one between the ends goes to each
    loads = [{"arc_length": 1.0, "force": [1e9, 0.0]}, {"arc_length": 0.5, "force": [0.0, -3.9e5]}]
    assert cp.make_scene(put(copy.deepcopy(soft), "point_load", loads)).attrs
    # 200 N on 25 N: a strain of 8
    assert cp.chain.rest(cp.make_scene(put(soft, "cable.youngs_modulus", 2.5e4))).stretched_length > 0.0
    # a free end goes where it likes
    put(soft, "initial.points", [[0.0, 0.0], [0.0, 500.0]])
    cp.make_scene(put(put(soft, "motion", {}), "ends.free", "upper"))


def test_the_least_tension_is_named(scenes):
    text = (scenes / "example1.toml").read_text()
    assert "top_tension = 1875.0 " in text
    import tomllib

    mapping = tomllib.loads(text.replace("top_tension = 1875.0 ", "top_tension = 600.0 "))
    refused(mapping, r"^cable\.top_tension: given 600\.0; allowed: at least 628\.29\d* N, the minimum over all lengths")
    mapping["cable"]["top_tension"] = 628.3
    cp.make_scene(mapping)


def test_cables_without_a_rest(soft):
    weightless = {**soft, "gravity": 0.0}
    weightless["cable"] = {**soft["cable"], "unstretched_length": 10.5}
    del weightless["cable"]["top_tension"]
    refused(weightless, r"^cable\.unstretched_length: given 10\.5; allowed: at most the chord, 10 m, as a slack cable")
    upright = {**soft, "ends": {"lower": [0, 0], "upper": [0, 6]}, "motion": {}}
    upright["cable"] = {**soft["cable"], "horizontal_force": 10.0}
    del upright["cable"]["top_tension"]
    refused(
        upright,
        r"^cable\.horizontal_force: given 10\.0; allowed: a tension or a length, as the chord lies along the load",
    )
    no_mass = {**soft, "gravity": 0.0, "cable": {**soft["cable"], "specific_weight": 9810.0}}
    del no_mass["cable"]["density"]
    refused(
        no_mass,
        r"^cable\.specific_weight: given 9810\.0; allowed: cable\.density or cable\.mass_per_length instead, as without gravity",
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"chain.links": 10**12},
        {"chain.links": 2**53},
        {"chain.links": 10**12, "time": None},
        {"time.interval": 1e-9, "time.duration": 1e3},
        {"time.interval": 1e-8, "time.duration": 1e4, "chain": None},
        {"chain.links": 10**6, "time.interval": 1e-6},
    ],
    ids=str,
)
def test_what_memory_would_not_hold(soft, changes):
    for path, value in changes.items():
        put(soft, path, value)
    refused(
        soft, r"^chain\.links and time\.interval: given \d+ links and \d+ instants, .* GB of output; allowed: half of"
    )


def test_instants_beyond_counting(soft):
    soft["time"] = {"duration": 1e20, "interval": 1e-20}
    refused(soft, r"^time\.interval: given 1e-20; allowed: an interval that 1e\+20 s holds at most 1e12 times$")


def test_motions_beyond_all_numbers(soft):
    soft["motion"]["upper"]["x"] = {"kind": "polynomial", "coefficients": [1e30] * 1000}
    refused(
        soft,
        r"^motion\.upper\.x: given a polynomial that leaves the finite numbers by 4 s; allowed: one that is finite",
    )
