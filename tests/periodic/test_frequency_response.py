"""Branches over frequency: their points, bifurcations, ends and what is kept of them."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY, guy, loaded, multipliers
from scenes import ROOT
from suite import slow

import cablepod as cp

KINDS = {"fold", "pitchfork", "period_doubling", "torus"}


@pytest.fixture(scope="module")
def whirling():
    """A string near resonance, on which whirling leaves and comes back."""
    scene = loaded(0.6, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    return (
        scene,
        modes,
        cp.periodic.frequency_response(scene, modes, frequency=(6.5, 11.0), outputs=("multipliers", "harmonics")),
    )


def test_folds_are_where_the_branch_turns_back(whirling):
    *_, response = whirling
    main = response.isel(point=response.branch.values == 1)
    omega = main.angular_frequency.values
    turns = np.flatnonzero(np.diff(omega)[1:] * np.diff(omega)[:-1] < 0.0) + 1
    folds = response.bifurcation_angular_frequency.values[
        (response.bifurcation_kind.values == "fold") & (response.bifurcation_branch.values == 1)
    ]
    assert turns.size == folds.size == 2
    # a parabola through the points about the turn, whose distance is some hundredths
    for k, fold in zip(turns, folds, strict=True):
        assert fold == pytest.approx(omega[k], abs=np.abs(np.diff(omega[k - 1 : k + 2])).max())
        assert (fold - omega[k]) * (omega[k] - omega[k - 1]) >= -1e-12


def test_branches_that_leave_from_side_branches_are_followed_after_others_have_ended():
    scene = guy(angular_frequency=12.6, amplitude=0.004)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    response = cp.periodic.frequency_response(scene, modes, frequency=(12.0, 12.9), outputs=())
    whirling = (response.bifurcation_kind == "pitchfork") & (response.bifurcation_set == "out_of_plane")
    assert (response.bifurcation_branch > 1).values[whirling].any()
    assert (response.leads_to > 0).values[whirling].all()


def test_a_multiplier_is_one_or_minus_one_at_located_bifurcations(whirling):
    scene, modes, response = whirling
    for k in range(response.sizes["bifurcation"]):
        if response.bifurcation_branch[k] != 1:
            continue
        omega = float(response.bifurcation_angular_frequency[k])
        near = int(
            np.argmin(
                np.abs(response.angular_frequency.values - omega)
                + 10.0 * (response.branch.values != 1)
                + np.abs(response.deflection_maximum.values - float(response.bifurcation_deflection_maximum[k]))
            )
        )
        if str(response.bifurcation_kind[k].values) == "fold":
            continue  # Newton's method at the frequency of a fold has no solution on one side
        moved = scene.assign(load_angular_frequency=omega)
        orbit = cp.periodic.orbit(moved, modes, start=response.isel(point=near), outputs=())
        goal = -1.0 if str(response.bifurcation_kind[k].values) == "period_doubling" else 1.0
        # located to 1e-11 of the frequency, and multipliers move by some hundreds of radians a unit
        assert np.abs(multipliers(orbit) - goal).min() < 1e-6


def test_whirling_leaves_at_one_pitchfork_and_comes_back_at_another(whirling):
    *_, response = whirling
    lead = response.leads_to.values[
        (response.bifurcation_kind.values == "pitchfork") & (response.bifurcation_branch.values == 1)
    ]
    assert 2 in lead
    points = response.isel(point=response.branch.values == 2)
    assert float(np.nanmax(points.amplitude_out_of_plane)) > 0.01
    assert response.attrs["branch_2_ended"] in ("loop", "range")
    main = response.isel(point=response.branch.values == 1)
    assert np.array_equal(main.amplitude_out_of_plane.values, np.zeros_like(main.amplitude_out_of_plane))
    assert set(response.bifurcation_kind.values) <= KINDS


def test_a_whirling_branch_between_two_pitchforks_is_closed():
    scene = guy(damping=0.09)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    response = cp.periodic.frequency_response(
        scene, modes, frequency=(12.4, 12.9), follow=("whirling",), outputs=()
    )  # fmt: skip
    assert response.attrs["branch_1_ended"] == "range"
    assert response.attrs["branch_2_ended"] == "loop"
    assert set(response.branch.values) == {1, 2}  # the second pitchfork leads to it too
    assert list(response.leads_to.values[response.bifurcation_kind.values == "pitchfork"]) == [2, 2]


def test_bifurcations_are_those_of_another_package():
    types = {"LP": "fold", "BP": "pitchfork", "PD": "period_doubling"}
    lines = (ROOT / "data" / "auto07p.csv").read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines if not line.startswith("#")][1:]
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2, links=320)
    response = cp.periodic.frequency_response(scene, modes, frequency=(12.2, 13.6), follow=(), outputs=())
    main = response.isel(bifurcation=response.bifurcation_branch.values == 1)
    assert list(main.bifurcation_kind.values) == [types[name] for name, _ in rows]
    # found 1e-9, at branch points 2e-8, which the other package locates to that
    frequency = [float(value) for _, value in rows]
    assert main.bifurcation_angular_frequency.values == pytest.approx(frequency, rel=1e-7)


#: Bifurcations of chains, extrapolated in their links, of the guy whose top moves by 3 mm along the chord
#: (pipelines/periodic/run.py --case chord): angular frequency [rad/s].
OF_THE_CHAIN = {
    ("pitchfork", "out_of_plane"): (6.27265, 6.41544),
    ("fold", "in_plane"): (6.92658, 6.45285),
    ("period_doubling", "out_of_plane"): (12.25339, 12.65858),
    ("period_doubling", "in_plane"): (12.38056, 12.78678),
}


@pytest.mark.slow
def test_bifurcations_are_those_of_the_chain_extrapolated_in_its_links():
    mapping = copy.deepcopy(GUY)
    mapping["damping"]["mass_proportional"] = 0.05
    length = np.hypot(20.4, 57.7)
    mapping["motion"]["upper"] = {
        axis: {"kind": "harmonic", "amplitude": 0.003 * along / length, "angular_frequency": 9.5}
        for axis, along in (("x", 20.4), ("y", 57.7))
    }
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=2, links=320)  # their own error, of links, is 4e-6
    for rank in (1, 2):
        response = cp.periodic.frequency_response(
            scene, modes, frequency=(5.0, 14.0), rank=rank, follow=(), outputs=()
        )  # fmt: skip
        main = response.isel(bifurcation=response.bifurcation_branch.values == 1)
        assert main.sizes["bifurcation"] == 8
        for (kind, which), expected in OF_THE_CHAIN.items():
            here = (main.bifurcation_kind.values == kind) & (main.bifurcation_set.values == which)
            # found 1.2e-4: terms of higher order in slopes, modes that are left out
            assert main.bifurcation_angular_frequency.values[here] == pytest.approx(expected, rel=2e-4)


def test_points_end_a_branch_and_are_the_limit_of_all(whirling):
    scene, modes, _ = whirling
    response = cp.periodic.frequency_response(scene, modes, frequency=(6.5, 11.0), points=20)
    assert response.sizes["point"] <= 20
    assert response.attrs["branch_1_ended"] == "points"


def test_a_slack_cable_ends_a_branch():
    scene = guy(amplitude=0.3)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    with pytest.warns(cp.OutOfRangeWarning, match="slack"):
        response = cp.periodic.frequency_response(scene, modes, frequency=(3.0, 9.0), out_of_plane=False)
    assert "slack" in [response.attrs[name] for name in response.attrs if name.endswith("_ended")]


def test_what_was_traced_is_kept_after_an_interrupt(whirling):
    scene, modes, _ = whirling

    def stop(share):
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(cp.RunStopped, match="interrupted") as caught:
        cp.periodic.frequency_response(scene, modes, frequency=(6.5, 11.0), progress=stop)
    assert caught.value.partial.sizes["point"] > 2
    assert caught.value.partial.attrs["incomplete"] == 1


def test_a_response_survives_the_archive(whirling, tmp_path):
    *_, response = whirling
    cp.archive.write(response, tmp_path / "response.nc")
    again = cp.archive.read(tmp_path / "response.nc")
    assert again.drop_attrs().equals(response.drop_attrs())
    assert again.attrs["id"] == response.attrs["id"]


@pytest.mark.slow  # 1.5 s
def test_a_pair_that_becomes_real_does_not_halt_a_branch():
    mapping = copy.deepcopy(GUY)
    mapping["cable"]["top_tension"] = 4050.0
    mapping["damping"]["mass_proportional"] = 0.1
    mapping["motion"]["upper"]["x"]["amplitude"] = 0.01
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=4)
    response = cp.periodic.frequency_response(scene, modes, frequency=(3.0, 9.0), follow=(), points=1000)
    assert response.attrs["branch_1_ended"] == "range"


def test_a_response_that_rejoins_beyond_the_range_is_found_from_its_other_end(whirling):
    """The range ends below the peak of the resonance, so that the low response is not on the branch that comes from below."""
    scene, modes, _ = whirling
    response = cp.periodic.frequency_response(scene, modes, frequency=(6.5, 8.5), follow=(), outputs=())
    at_end = response.deflection_maximum.values[np.isclose(response.angular_frequency, 8.5, rtol=1e-9)]
    lowest = cp.periodic.orbit(loaded(0.6, 8.5, 0.05), modes).deflection_maximum
    assert at_end.min() == pytest.approx(float(lowest), rel=1e-4)  # largest of the phases of either
    assert at_end.max() > 3.0 * at_end.min()


def test_a_branch_that_reaches_the_other_end_is_traced_once(whirling):
    scene, modes, _ = whirling
    response = cp.periodic.frequency_response(scene, modes, frequency=(3.0, 4.0), follow=(), outputs=())
    assert set(response.branch.values) == {1}


def test_a_branch_that_ends_at_once_leaves_the_other_end():
    scene = guy(amplitude=10.0)  # slack, with multipliers beyond the numbers at the lowest frequency
    modes = cp.condensed.vibration_modes(scene, rank=2)
    with pytest.warns(cp.errors.OutOfRangeWarning):
        response = cp.periodic.frequency_response(scene, modes, frequency=(0.2, 0.4), follow=(), outputs=())
    assert set(response.branch.values) == {2}
    assert response.attrs["branch_2_ended"] == "slack"


def test_the_ends_of_a_branch_have_as_many_harmonics_as_they_need():
    """At a fifth of the first frequency six harmonics miss most of the superharmonic resonance."""
    scene = guy(amplitude=0.05, angular_frequency=2.5)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    response = cp.periodic.frequency_response(scene, modes, frequency=(2.5, 2.51), follow=(), outputs=())
    assert response.harmonic_tail.max() < 1e-6  # the bound of the page


def steep(tension, damping, rank, motion, **options):
    """The guy at another tension, moved at one end along x."""
    mapping = copy.deepcopy(GUY) | {"damping": {"mass_proportional": damping}}
    mapping["cable"]["top_tension"] = tension
    (end, kind, amplitude), upper = motion, options.pop("upper", GUY["ends"]["upper"])
    mapping["ends"] = {"lower": [0.0, 0.0], "upper": upper}
    mapping["motion"] = {end: {"x": {"kind": kind, "amplitude": amplitude, "angular_frequency": 6.0}}}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=rank, static_modes=rank > 2)
    return cp.periodic.frequency_response(scene, modes, outputs=("multipliers",), **options)


BRANCHES = {
    # a doubling between the last point within the range and its end
    "end": (6000.0, 0.28, 2, ("lower", "harmonic", 0.0064), {"frequency": (8.0, 9.05)}),
    # a whirling branch that comes back to its parent
    "loop": (7390.0, 0.0209, 4, ("upper", "one_minus_cosine", 0.000483), {"frequency": (8.0, 9.5)}),
}


@pytest.mark.parametrize("case", BRANCHES)
def test_multipliers_leave_the_circle_at_bifurcations_alone_and_at_each(case):
    *of_scene, options = BRANCHES[case]
    found = steep(*of_scene, **options)
    outside = (np.abs(multipliers(found)) > 1.0 + 1e-7).sum(axis=1)  # the bound of `stable`
    for number in np.unique(found.branch):
        changes = np.count_nonzero(np.diff(outside[found.branch.values == number]))
        assert changes == np.count_nonzero(found.bifurcation_branch == number) > 0


@pytest.mark.parametrize("order", ["leading", slow("exact")])
def test_what_turned_responses_share_is_no_bifurcation(order):
    """A vertical cable moved along itself may swing in any plane: a multiplier of each response is one."""
    mapping = copy.deepcopy(GUY) | {"damping": {"mass_proportional": 0.0155}}
    mapping["cable"]["top_tension"], mapping["ends"]["upper"] = 21178.0, [0.0, 57.7]
    mapping["motion"] = {"upper": {"y": {"kind": "harmonic", "amplitude": 0.00577, "angular_frequency": 6.0}}}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    found = cp.periodic.frequency_response(
        scene, modes, frequency=(15.3, 15.7), order=order, follow=("period_doubling",)
    )
    swings = found.branch.values > 1
    assert np.abs(multipliers(found) - 1.0).min(axis=1)[swings].max() == 0.0
    assert set(found.bifurcation_branch.values) == {1}


def test_without_an_amplitude_the_steps_are_long():
    scene = guy(amplitude=0.0)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    found = cp.periodic.frequency_response(scene, modes, frequency=(5.0, 7.0), points=300, outputs=())
    assert found.attrs["branch_1_ended"] == "range"


def test_no_step_jumps_to_another_branch():
    """Two doubled branches pass near each other; one that jumped to and fro met the same bifurcations again and again."""
    motion, upper = ("upper", "one_minus_cosine", 0.00294), [72.33, 0.0]
    found = steep(6584.0, 0.3385, 2, motion, upper=upper, frequency=(12.0, 16.0), points=150)
    places = np.stack([found.bifurcation_branch, found.bifurcation_angular_frequency.round(6)])
    assert places.shape[1] > 5
    assert np.unique(places, axis=1).shape[1] > places.shape[1] - 2  # two doublings of the string lie at one place


@pytest.mark.parametrize("key", ["mass_proportional", "tension_proportional", "ratio"])
def test_points_meet_the_peak_of_a_small_resonance(key):
    """Of a string under a small uniform load p sin: (4 / pi) p / 2 zeta omega^2 mu at its first frequency omega."""
    ratio, force = 0.004, 1e-4
    scene = loaded(force, 7.0, 0.0)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    omega = float(modes.angular_frequency[0])
    value, units = {
        "mass_proportional": (2.0 * ratio * omega, "s-1"),
        "tension_proportional": (2.0 * ratio / omega, "s"),
        "ratio": (ratio, "1"),
    }[key]
    scene = scene.drop_vars("damping_mass_proportional").assign({f"damping_{key}": ((), value, {"units": units})})
    found = cp.periodic.frequency_response(scene, modes, frequency=(0.6 * omega, 1.5 * omega), follow=(), outputs=())
    peak = 4.0 / np.pi * force / (2.0 * ratio * omega**2 * 8000.0 * 1.25e-4)
    # 1 %: a step of a quarter of the motion is an eighth of the width; links and shape take 0.1 %
    assert float(found.deflection_maximum.max()) == pytest.approx(peak, rel=0.01)


@pytest.mark.parametrize(
    ("damping", "amplitude", "peak"),
    [
        ({"ratio": 0.002}, 0.001, 3.1435),
        ({"tension_proportional": 6.4e-4}, 0.001, 3.1434),
        ({"mass_proportional": 0.0063}, 0.003, 2.0963),  # at a third of the first frequency: 3e-4 of it wide
    ],
)
def test_no_step_passes_over_a_narrow_superharmonic_resonance(damping, amplitude, peak):
    tables = {
        **GUY,
        "damping": damping,
        "motion": {"upper": {"x": GUY["motion"]["upper"]["x"] | {"amplitude": amplitude}}},
    }
    scene = cp.make_scene(tables)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    # points start far from the resonance, where steps are as large as they get
    found = cp.periodic.frequency_response(
        scene, modes, frequency=(0.8 * peak, 1.1 * peak), follow=(), out_of_plane=False, outputs=()
    )
    near = np.abs(found.angular_frequency.values / peak - 1.0) < 5e-3
    orbits = [
        float(cp.periodic.orbit(
            scene.assign(motion_upper_x_angular_frequency=omega), modes, out_of_plane=False, outputs=()
        ).deflection_maximum)
        for omega in peak * np.linspace(0.999, 1.001, 9)
    ]  # fmt: skip
    # the predictor errs by 2 % of the motion at most: points lie within 1 % of such a peak
    assert found.deflection_maximum.values[near].max() == pytest.approx(max(orbits), rel=0.01)
