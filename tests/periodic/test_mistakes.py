"""Refusals name the key, what was given and what is allowed, before anything runs."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY

import cablepod as cp
from cablepod.errors import RunStopped, SceneError


@pytest.fixture(scope="module")
def modes():
    """Two modes of the guy."""
    return cp.condensed.vibration_modes(cp.make_scene(GUY), rank=2)


def scene(change=lambda mapping: None):
    mapping = copy.deepcopy(GUY)
    change(mapping)
    return cp.make_scene(mapping)


def without(*path):
    def change(mapping):
        for key in path[:-1]:
            mapping = mapping[key]
        del mapping[path[-1]]

    return change


def with_motion(**values):
    def change(mapping):
        mapping["motion"]["upper"]["x"] = values

    return change


def second(mapping):
    mapping["motion"]["upper"]["y"] = {"kind": "harmonic", "amplitude": 0.001, "angular_frequency": 5.0}


WIND = {"speed": 20.0, "direction": [1.0, 0.0]}
SCENES = [
    (without("motion"), "motion: given"),
    (with_motion(kind="ramp", amplitude=0.1, duration=1.0), r"motion\.upper\.x\.kind"),
    (with_motion(kind="polynomial", coefficients=[0.1]), r"motion\.upper\.x\.kind"),
    (with_motion(kind="harmonic", amplitude=0.1, angular_frequency=1.0, ramp=2.0), r"motion\.upper\.x\.ramp"),
    (second, r"angular_frequency.*one frequency"),
    (lambda mapping: mapping["ends"].update(free="upper") or mapping.pop("motion"), "motion: given|ends.free"),
    (lambda mapping: mapping["damping"].update(link_viscosity=1e-4), r"damping\.link_viscosity"),
    (lambda mapping: mapping.update(wind=WIND, cable=mapping["cable"] | {"diameter": 0.016}), r"wind\.speed"),
]


@pytest.mark.parametrize(("change", "key"), SCENES)
def test_scenes_without_one_periodic_forcing_are_refused(change, key, modes):
    with pytest.raises(SceneError, match=key):
        cp.periodic.orbit(scene(change), modes)


#: Functions, and options that they refuse under a key.
OPTIONS = [
    *(
        ("orbit", options)
        for options in (
            {"order": "inertial"}, {"rank": 0}, {"rank": 3}, {"harmonics": 1}, {"harmonics": 1000}, {"harmonics": 2.5},
            {"periods": 0}, {"outputs": ("positions",)}, {"start": 3}, {"start": "scene"}, {"out_of_plane": 1},
        )
    ),
    *(
        ("frequency_response", {"frequency": frequency})
        for frequency in (
            (8.0, 4.0), (0.0, 4.0), (-1.0, 4.0), (np.nan, 4.0), (4.0, np.inf), (4.0, 4.0), 4.0, (1.0, 2.0, 3.0), None,
        )
    ),
    *(
        ("frequency_response", options)
        for options in ({"points": 1}, {"follow": ("torus",)}, {"order": "inertial"}, {"outputs": "tensions"})
    ),
    *(
        ("stability_map", options)
        for options in (
            {"frequency": [2.0, 1.0]}, {"amplitude": [0.0, 1.0]}, {"amplitude": []}, {"frequency": [1.0, np.nan]}, {"rank": 9},
        )
    ),
    *(
        ("backbone", options)
        for options in ({"amplitude": 0.0}, {"amplitude": 62.0}, {"mode": 3}, {"mode": 0}, {"motion": "round"})
    ),
]  # fmt: skip
USUAL = {
    "orbit": {},
    "frequency_response": {"frequency": (4.0, 8.0)},
    "stability_map": {"frequency": [1.0, 2.0], "amplitude": [1e-3]},
    "backbone": {"amplitude": 0.1},
}


@pytest.mark.parametrize(("name", "options"), OPTIONS)
def test_options_are_checked(name, options, modes):
    (key,) = options
    options = {"start": scene()} if options.get("start") == "scene" else options
    with pytest.raises(SceneError, match=f"^{key}.*: given .*; allowed: "):
        getattr(cp.periodic, name)(scene(), modes, **USUAL[name] | options)


def test_members_are_refused_where_branches_are_followed(modes):
    members = cp.ensemble.design(scene(), {"cable.top_tension": [8e3, 15e3]}, members=2, sampling="grid")
    with pytest.raises(SceneError, match=r"^scene: given 2 members"):
        cp.periodic.frequency_response(members, modes, frequency=(4.0, 8.0))
    with pytest.raises(SceneError, match=r"^scene: given 2 members"):
        cp.periodic.backbone(members, modes, amplitude=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_motion(kind="harmonic", amplitude=0.003, angular_frequency=1e-3), "a period of 6.28e+03 s is too long"),
        (lambda mapping: mapping["damping"].update(mass_proportional=3000.0), "damping by mass of 3e+03 1/s"),
        (
            lambda mapping: mapping["damping"].update(tension_proportional=1e-3) or mapping["cable"].update(area=1.25e-8),
            "damping by the tension of 0.001 s",
        ),
    ],
)  # fmt: skip
def test_periods_that_multipliers_do_not_survive_stop_with_a_reason(change, message, modes):
    slow = scene(change)
    omega = float(slow.motion_upper_x_angular_frequency)
    calls = (
        lambda: cp.periodic.orbit(slow, modes),
        lambda: cp.periodic.frequency_response(slow, modes, frequency=(omega, 1.1 * omega)),
        lambda: cp.periodic.stability_map(slow, modes, frequency=[omega], amplitude=[1e-3]),
    )
    for call in calls:
        with pytest.raises(cp.RunStopped, match=r"; try ") as caught:
            call()
        assert message in str(caught.value)


def test_zero_damping_is_told(modes):
    with pytest.warns(cp.OutOfRangeWarning, match="neutral"):
        cp.periodic.orbit(scene(lambda mapping: mapping.pop("damping")), modes, outputs=())


def test_harmonics_near_the_first_axial_frequency_are_told(modes):
    fast = scene(with_motion(kind="harmonic", amplitude=1e-5, angular_frequency=80.0))
    with pytest.warns(cp.OutOfRangeWarning, match="axial"):
        cp.periodic.orbit(fast, modes, outputs=())


def sagging(length):
    """Return the guy with an unstretched length in chords, and a slow motion of its upper end."""
    mapping = copy.deepcopy(GUY)
    del mapping["cable"]["top_tension"]
    mapping["cable"]["unstretched_length"] = length * float(np.hypot(*mapping["ends"]["upper"]))
    mapping["motion"]["upper"]["x"] = {"kind": "harmonic", "amplitude": 0.01, "angular_frequency": 1.0}
    return cp.make_scene(mapping)


@pytest.mark.parametrize("rank", [2, 3])
def test_modes_that_miss_the_sag_are_named(rank):
    given = sagging(1.5)
    modes = cp.condensed.vibration_modes(given, rank=3)
    text = (
        rf"modes: given {rank} modes in the plane, without .* of the deflection at rest; allowed: .*static_modes=True"
    )
    with pytest.raises(SceneError, match=text):
        cp.periodic.orbit(given, modes, rank=rank, order="exact")


def test_a_sag_too_deep_for_any_modes_is_named():
    given = sagging(1.5)
    modes = cp.condensed.vibration_modes(given, rank=3, static_modes=True)
    with pytest.raises(SceneError, match=r"scene: given .*a sag of .* % of the chord.*; allowed: a shallower cable"):
        cp.periodic.orbit(given, modes, rank=2, order="exact")


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize("rank", [2, 3])
@pytest.mark.parametrize("length", [1.2, 1.5])
def test_a_rest_in_compression_has_no_responses(length, rank, static):
    # the exact model is at rest with 1 to 25 % of compression; a response about it had tensions of a million newtons
    given = sagging(length)
    modes = cp.condensed.vibration_modes(given, rank=3, static_modes=static)
    why = (
        "scene: given .*in compression" if static else "modes: given . modes in the plane, without .*static_modes=True"
    )
    for call, options in ((cp.periodic.orbit, {}), (cp.periodic.frequency_response, {"frequency": (0.5, 1.0)})):
        with pytest.raises(SceneError, match=why):
            call(given, modes, rank=rank, order="exact", **options)


def test_no_response_on_modes_that_miss_the_sag_says_so():
    given = sagging(1.2)
    modes = cp.condensed.vibration_modes(given, rank=3)
    miss = "given 1 mode in the plane, without 23 % of the deflection at rest"
    with pytest.raises(RunStopped, match=miss):
        cp.periodic.orbit(given, modes, rank=1, order="exact")
    with pytest.raises(RunStopped, match=f"no periodic response grows from rest.*{miss}"):
        cp.periodic.frequency_response(given, modes, rank=1, order="exact", frequency=(0.5, 1.0))
    # the first branch has no point: a bare ValueError, "max() arg is an empty sequence"
    given = sagging(1.25)
    modes = cp.condensed.vibration_modes(given, rank=3, static_modes=True)  # these hold it
    with pytest.raises(RunStopped, match=r"no periodic response grows from rest.*smaller amplitudes$"):
        cp.periodic.frequency_response(given, modes, rank=2, order="exact", frequency=(0.5, 1.0))
