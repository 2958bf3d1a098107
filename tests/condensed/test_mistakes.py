"""Refusals, warnings and stopped runs of the condensed model."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scenes import ORDERS, circling, full_modes, spatial
from suite import slow

import cablepod as cp


@pytest.fixture(scope="module")
def modes():
    return {dims: full_modes(dims=dims) for dims in (2, 3)}


def test_invalid_options_are_refused(soft, modes):
    scene, m = cp.make_scene(soft), modes[2]
    free = cp.make_scene({**soft, "motion": {}, "ends": {**soft["ends"], "free": "upper"}})
    viscous = cp.make_scene({**soft, "damping": {"link_viscosity": 1.0}})
    limit = cp.condensed.simulate(scene, m, step=1e-3, times=[0.0]).attrs["step_limit"]
    dependent = m.copy(deep=True)
    dependent["mode_shape"][1] = 2.0 * m.mode_shape[0].values
    cases = [
        (scene, m, {"rank": 5}, "^rank: given 5; allowed: at most 4, the number of modes$"),
        (scene, m, {"rank": 0}, "^rank: given 0; allowed: a whole number of at least 1$"),
        (scene, m, {"rank": 1.5}, "^rank: given 1.5; allowed: a whole number of at least 1$"),
        (scene, m, {"order": "second"}, '^order: given \'second\'; allowed: one of "leading", "exact", "inertial"$'),
        (scene, m, {"law": "green"}, '^law: given \'green\'; allowed: "linear" with order "leading"'),
        (scene, m, {"law": "hooke"}, '^law: given \'hooke\'; allowed: one of "linear", "green"$'),
        (scene, m, {"scheme": "rk4"}, '^scheme: given \'rk4\'; allowed: one of "velocity_verlet", "trapezoidal", "numerov"$'),
        (
            scene, m, {"scheme": "numerov", "order": "exact"},
            '^scheme: given \'numerov\'; allowed: one of "velocity_verlet", "trapezoidal" with order "exact"$',
        ),
        (
            scene, m, {"scheme": "numerov", "step": 1.001 * 3.0**0.5 * limit},
            "^step: given .* s; allowed: below the stability limit, .* s, 3.464 over the highest",
        ),
        (scene, m, {"outputs": ("energy",)}, "^outputs: given 'energy'; allowed: some of "),
        (scene, m, {"step": 0.1, "tolerance": 0.1}, r"^step and tolerance: given \(0.1, 0.1\); allowed: one of them"),
        (scene, m, {"tolerance": 0.0}, "^tolerance: given 0.0; allowed: a finite number above 0$"),
        (scene, m, {"times": [1.0, 0.5]}, "^times: given "),
        (scene, m, {"scheme": "trapezoidal", "step": -1.0}, "^step: given -1.0; allowed: a finite number above 0"),
        (
            scene, m, {"scheme": "velocity_verlet", "step": 1.001 * limit},
            f"^step: given {1.001 * limit:.6g} s; allowed: below the stability limit, {limit:.6g} s, 2 over the highest",
        ),
        (free, m, {}, "^ends.free: given 'upper'; allowed: two held ends"),
        (viscous, m, {}, "^damping.link_viscosity: given 1.0; allowed: none for a reduced model"),
        (cp.make_scene(spatial(soft)), m, {}, "^modes: given 2 coordinates; allowed: the 3 coordinates of the scene$"),
        (scene, modes[3], {}, "^modes: given 3 coordinates; allowed: the 2 coordinates of the scene$"),
        (scene, m.assign(mode_shape=m.mode_shape + 0.1), {}, "^modes: mode_shape: given .*at the ends.*; allowed: zero at both"),
        (scene, dependent, {}, "^modes: given some that are sums of others; allowed: independent ones"),
        (scene, scene, {}, "^modes: given a Dataset of stage .scene. without .*; allowed: modes of the deflection"),
    ]  # fmt: skip
    for some, some_modes, options, match in cases:
        with pytest.raises(cp.SceneError, match=match):
            cp.condensed.simulate(some, some_modes, **options)
    for layout in ("separate", "vector"):
        other = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3), layout=layout)
        with pytest.raises(
            cp.SceneError, match=f"^modes: given layout '{layout}'; allowed: modes of the deflection normal"
        ):
            cp.condensed.simulate(scene, other)
        with pytest.raises(cp.SceneError, match="layout 'normal'"):
            cp.galerkin.simulate(scene, m)


def test_a_chord_that_turns_into_its_first_normal_is_refused(soft, modes):
    taut = {**soft, "cable": {**soft["cable"], "top_tension": 600.0}, "time": {"duration": 20.0, "interval": 0.5}}
    for angle, is_refused in ((1.4, False), (1.5, True)):  # the limit is acos(0.99) = 0.14 below a right angle
        scene = cp.make_scene(circling(taut, angle))
        if is_refused:
            with pytest.raises(
                cp.SceneError, match=r"motion: the chord turns into the direction \[-0.6, 0.8, 0.0\], which"
            ):
                cp.condensed.simulate(scene, modes[3], rank=2, step=1e-3)
        else:
            cp.condensed.simulate(scene, modes[3], rank=2, step=1e-3)


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # modes that lack the sag
@pytest.mark.filterwarnings("ignore::cablepod.errors.MemberFailedWarning")
# spatial lanes with steps that fit are compiled for this test alone
@pytest.mark.parametrize("step", [1e-3, slow(None)])
def test_modes_in_and_out_of_the_plane_are_not_exchanged(soft, step):
    """Within 11 degrees of the vertical the first normal is a level one: there modes of a slanted cable are for the other one."""
    scenes = cp.ensemble.design(cp.make_scene(spatial(soft)), {"ends.upper.x": [0.5, 5.0]}, members=2, sampling="grid")
    steep, slanted = (scenes.isel(member=k) for k in (0, 1))
    modes = cp.condensed.vibration_modes(slanted, rank=2)
    match = r"^modes: normal_reference: given \[0.0, 1.0, 0.0\]; allowed: \[0.0, 0.0, 1.0\], the axis of the scene"
    with pytest.raises(cp.SceneError, match=match):
        cp.condensed.simulate(steep, modes, step=step)
    run, alone = (cp.condensed.simulate(given, modes, step=step, outputs=()) for given in (scenes, slanted))
    assert re.search(match, str(run.failure.values[0]))
    np.testing.assert_allclose(run.amplitude[1], alone.amplitude, rtol=0, atol=1e-10)


@pytest.mark.filterwarnings("ignore:.*the model expects an error:cablepod.OutOfRangeWarning")  # modes of another cable
def test_slack_cables_and_fast_ends_cause_warnings(soft, modes):
    lifted = cp.make_scene(
        {**soft, "load": {"uniform": [0.0, 30.0], "kind": "ramp", "amplitude": 1.0, "duration": 1.0}}
    )
    for order in ORDERS[:2]:
        with pytest.warns(
            cp.OutOfRangeWarning, match=r"the chordwise force falls to -.* N at .* s, below zero"
        ) as found:
            run = cp.condensed.simulate(
                lifted, modes[2], rank=2, order=order, step=1e-3, times=np.arange(1001) / 1000,
                outputs=("position", "tension"),
            )  # fmt: skip
        assert len(found) == 1
        assert run.attrs["smallest_chordwise_force"] < 0.0
    place = round(run.attrs["time_of_smallest_force"] * 1000)
    # the reported time is that of the least chordwise part of all tensions
    reach, chord = np.diff(run.position.values, axis=1), np.diff(run.end_position.values, axis=1)
    along = (reach * chord).sum(axis=2) / np.linalg.norm(chord, axis=2)
    force = run.tension.values * along / np.linalg.norm(reach, axis=2)
    assert force.min() == force[place].min()
    assert force.min() == pytest.approx(run.attrs["smallest_chordwise_force"], rel=1e-6)
    fast = {"upper": {"x": {"kind": "harmonic", "amplitude": 1e-4, "angular_frequency": 20.0, "phase": 0.0}}}
    with pytest.warns(
        cp.OutOfRangeWarning, match=r"with 0.45 times the first axial frequency, 44.4 rad/s \(above 0.2\)"
    ):
        run = cp.condensed.simulate(cp.make_scene({**soft, "motion": fast}), modes[2], rank=2, step=1e-3, times=[0.1])
    axial = math.pi / float(run.unstretched_length) * math.sqrt(2e4)
    assert run.attrs["first_axial_frequency"] == pytest.approx(axial, rel=1e-12)
    assert run.attrs["forcing_over_axial_frequency"] == pytest.approx(20.0 / axial, rel=1e-12)


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_a_stiffening_cable_stops_with_a_partial_result(soft, modes, order):
    pull = {"upper": {"x": {"kind": "ramp", "amplitude": 0.5, "duration": 4.0}}}
    scene, numbered = cp.make_scene({**soft, "motion": pull}), modes[2].assign_coords(mode=[1, 2, 4, 7])
    times = np.arange(401) / 100
    limit = cp.condensed.simulate(scene, numbered, order=order, step=1e-3, times=[0.0]).attrs["step_limit"]
    with pytest.raises(
        cp.RunStopped, match=r"stiffened: from .* s on its stability limit is below the step"
    ) as stopped:
        cp.condensed.simulate(scene, numbered, order=order, scheme="velocity_verlet", step=0.9 * limit, times=times)
    partial = stopped.value.partial
    assert partial.mode.values.tolist() == [1, 2, 4, 7]
    assert 10 < partial.sizes["time"] < 400
    assert float(partial.attrs["incomplete"].split()[2]) >= float(partial.time[-1])
    short = cp.condensed.simulate(
        scene, numbered, order=order, scheme="velocity_verlet", step=0.9 * limit, times=partial.time.values[:-20]
    )
    np.testing.assert_array_equal(short.amplitude, partial.amplitude[:-20])


def meeting(soft):
    """Make a scene whose ends meet at 2 s: the chord has no direction."""
    home = {axis: {"kind": "ramp", "amplitude": -size, "duration": 2.0} for axis, size in (("x", 8.0), ("y", 6.0))}
    return cp.make_scene({**soft, "motion": {"upper": home}})


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_a_diverging_run_stops_with_a_partial_result(soft, modes, order):
    options = {"order": order, "scheme": "trapezoidal", "step": 0.02, "times": np.arange(101) * 0.02}
    with pytest.raises(cp.RunStopped, match="found no equilibrium along the chord at") as stopped:
        cp.condensed.simulate(meeting(soft), modes[2], **options)
    partial = stopped.value.partial
    assert 5 < partial.sizes["time"] <= 100
    assert np.isfinite(partial.amplitude).all()
    assert np.isfinite(partial.position).all()  # also where the cable is so folded that links turn over
    assert f"of {2.0:g} s" in partial.attrs["incomplete"]


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")
@pytest.mark.parametrize("options", [{}, {"tolerance": 1e-2}, {"order": "exact"}], ids=str)
def test_a_stopped_run_that_chose_its_step_has_output_times_only(soft, modes, options):
    with pytest.raises(cp.RunStopped) as stopped:
        cp.condensed.simulate(meeting(soft), modes[2], times=[0.5, 4.0], rank=3, **options)
    assert stopped.value.partial.time.values.tolist() == [0.5]


@pytest.mark.parametrize(
    "run",
    [
        *(lambda *a, o=order: cp.condensed.simulate(*a, order=o, outputs=("position",)) for order in ORDERS),
        lambda *a: cp.condensed.simulate(*a, step=1e-4),
        cp.condensed.prepare,
    ],
    ids=[*ORDERS, "step", "prepare"],
)
def test_modes_without_a_rest_are_refused(run):
    # one vibration mode of a stiff cable holds so little of its sag, that all else of it would be strain
    scene = cp.make_scene(
        {
            "cable": {"axial_stiffness": 1e7, "mass_per_length": 1.0, "horizontal_force": 500.0},
            "ends": {"lower": [0.0, 0.0], "upper": [40.0, 10.0]},
            "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.001, "angular_frequency": 5.0}}},
            "chain": {"links": 20},
            "time": {"duration": 0.1, "interval": 0.1},
        }
    )
    with pytest.raises(cp.SceneError, match=r"modes: given 1, .* no deflection near that at rest .*static_modes=True"):
        run(scene, cp.condensed.vibration_modes(scene, rank=1))
    modes = cp.condensed.vibration_modes(scene, rank=2, static_modes=True)
    start = cp.condensed.simulate(scene, modes, order="exact", times=[0.0], outputs=("tension",))
    # the static modes hold the rest of the linearised cable, whose tensions are 6e-4 from those of the chain
    assert np.abs(start.tension.values[0] / cp.chain.rest(scene).tension.values - 1.0).max() < 1e-3
