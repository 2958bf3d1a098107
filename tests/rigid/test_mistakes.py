"""Chain of rigid links: initial shapes, refused shapes and motions, runs that stop."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scenes import RIGID_CABLE, link_length_errors, pendulum, rigid_scene

import cablepod as cp

FORMULATIONS = ("rattle", "index1")
ALL = ("position", "velocity", "tension", "tension_extremes")


def folded(n=10, gap=2, **changes):
    """A chain of n links of 0.1 m, folded, as a line of four points."""
    down = (n - gap) / 20
    points = [[0.0, 0.0], [0.0, -down], [0.1 * gap, -down], [0.1 * gap, 0.0]]
    return pendulum(0.1 * n, points[-1], chain={"links": n}, initial={"points": points}, **changes)


# --- starts -----------------------------------------------------------------------------------------------------------


def first(scene, **options):
    run = cp.rigid.simulate(scene, times=[0.0], **options)
    assert np.abs(link_length_errors(run)).max() < 1e-13  # 1e-16 of 10 m in links of 0.3 m
    return run.position.values[0]


def test_a_chain_as_long_as_its_span_starts_straight():
    line = first(pendulum(3.0, [3.0, 0.0], chain={"links": 6}))
    np.testing.assert_allclose(line, np.stack([np.arange(7) / 2, np.zeros(7)], axis=1), atol=1e-15)
    scene = pendulum(
        5.0, [3.0, 4.0], chain={"links": 5}, ends={"lower": [0.0, 0.0], "upper": [3.0, 4.0], "free": "lower"}
    )
    np.testing.assert_allclose(first(scene), np.arange(6)[:, None] * [0.6, 0.8], atol=1e-14)


def test_links_are_placed_on_a_line_one_by_one():
    line = first(folded())
    expected = np.array(
        [[0, 0], [0, -1], [0, -2], [0, -3], [0, -4], [1, -4], [2, -4], [2, -3], [2, -2], [2, -1], [2, 0]]
    )
    np.testing.assert_allclose(line, 0.1 * expected, atol=1e-15)
    # links that cut the corners need more of the line, which is prolonged
    line = first(folded(), links=7)
    np.testing.assert_allclose(line[:3], np.array([[0, 0], [0, -1], [0, -2]]) / 7, atol=1e-15)
    assert line[3][0] > 0.0
    np.testing.assert_allclose(line[4:, 0], 0.2, atol=1e-15)
    assert line[-1][1] > 0.0
    # from the other end
    ends = {"lower": [0.0, 0.0], "upper": [0.2, 0.0], "free": "lower"}
    other = first(folded(ends=ends), links=7)
    np.testing.assert_allclose(other[::-1], line * [-1, 1] + [0.2, 0.0], atol=1e-14)


def test_between_held_ends_the_particles_are_moved_by_little(soft):
    line = [[0.0, 0.0], [5.0, -2.0], [8.0, 6.0]]
    size = np.hypot(5, 2) + np.hypot(3, 8)
    scene = rigid_scene(soft, motion={}, cable={**RIGID_CABLE, "unstretched_length": size}, initial={"points": line})
    position = first(scene, links=40)
    np.testing.assert_allclose(position[[0, -1]], [line[0], line[2]], atol=1e-14)
    place = np.linspace(0, size, 41)
    on_line = np.stack([np.interp(place, [0, np.hypot(5, 2), size], [p[c] for p in line]) for c in range(2)], axis=1)
    # one link of 0.35 m cuts the corner; the others make room
    assert 1e-4 < np.abs(position - on_line).max() < 0.1


def test_points_are_taken_one_by_one(soft):
    points = cp.rigid.rest(rigid_scene(soft)).position.values
    same = rigid_scene(soft, initial={"points": points.tolist()})
    np.testing.assert_allclose(first(same), points, atol=1e-14)
    # decimals of a file are put right
    rounded = rigid_scene(soft, initial={"points": np.round(points, 10).tolist()})
    assert 0.0 < np.abs(first(rounded) - np.round(points, 10)).max() < 1e-9


# --- refused ----------------------------------------------------------------------------------------------------------


def refused(scene, match, **options):
    with pytest.raises(cp.SceneError, match=match):
        cp.rigid.simulate(scene, **options)


def test_invalid_options_are_refused(soft):
    scene = rigid_scene(soft)
    refused(scene, r"^formulation: given 'index2'; allowed: one of \"rattle\", \"index1\"", formulation="index2")
    refused(scene, "^step and tolerance", step=0.1, tolerance=1e-3)
    refused(scene, r"^step: given 5", step=5, times=[1.0])
    refused(scene, r"^step: given 0", step=0)
    refused(scene, r"^outputs: given 'force'", outputs=("force",))
    refused(scene, r"^times: ", times=[1.0, 0.5])
    refused(scene, r"^links: given 1; allowed: a whole number of at least 2", links=1)
    refused(scene, r"^links: given .* GB of output", links=10**6, times=np.arange(10**6) * 1e-6)
    viscous = rigid_scene(soft, damping={"link_viscosity": 0.001})
    refused(viscous, r"^damping\.link_viscosity: given 0\.001; allowed: none, as rigid links do not stretch")


def test_a_stretched_start_is_refused_with_its_excess(soft):
    short = {**RIGID_CABLE, "unstretched_length": 9.9}
    expected = r"ends: given 10 m apart at the start, 0\.1 m \(0\.0101 of it\) more than .*; allowed: less than 9\.9 m"
    refused(
        rigid_scene(soft, cable=short, ends={"lower": [0.0, 0.0], "upper": [8.0, 6.0], "free": "upper"}, motion={}),
        expected,
    )
    refused(rigid_scene(soft, cable=short, motion={}), expected)
    # a taut elastic cable is one
    taut = {key: value for key, value in RIGID_CABLE.items() if key != "unstretched_length"} | {"top_tension": 500.0}
    refused(rigid_scene(soft, cable=taut), r"cable\.top_tension makes it so long")
    points = cp.rigid.rest(rigid_scene(soft)).position.values
    points[3, 1] -= 0.01
    refused(
        rigid_scene(soft, initial={"points": points.tolist()}),
        r"^initial\.points: .* link 4 a length of 1\.3\d+ m, 0\.00\d+ m .* its own",
    )
    line = {"points": [[0.0, 0.0], [4.0, -5.0], [8.0, 6.0]]}
    refused(rigid_scene(soft, initial=line), r"^initial\.points: given a line of 18\.1\d+ m .*, 7\.1\d* m .* more than")
    refused(rigid_scene(soft, initial={"points": [[0, 0], [5, 3], [8, 6]]}), r"given a line of 10\.0\d+ m .* less than")
    short_line = {"points": [[0, 0], [5, 3], [8, 6]]}
    refused(
        rigid_scene(soft, initial=short_line, ends={"lower": [0, 0], "upper": [8, 6], "free": "upper"}, motion={}),
        "at least the length",
    )
    other = rigid_scene(soft, initial={"unstretched_length": 12.0})
    refused(other, r"^initial\.unstretched_length: given 12\.0; .* 1 m \(0\.0909 of it\) more than")
    assert first(rigid_scene(soft, initial={"unstretched_length": 11.0})).shape == (9, 2)


def test_a_straight_chain_between_held_ends_is_refused(soft):
    just = {**RIGID_CABLE, "unstretched_length": 10.0}
    refused(rigid_scene(soft, cable=just, motion={}), r"just the length of the rigid links")
    line = [[0.8 * i, 0.6 * i] for i in range(11)]
    refused(
        rigid_scene(soft, cable=just, motion={}, initial={"points": line}),
        r"just the length of the rigid links",
        links=10,
    )
    # folded on itself
    points = [[0, 0], [0, -1], [0, 0], [0, 1], [0, 2]]
    flat = rigid_scene(
        soft,
        cable={**RIGID_CABLE, "unstretched_length": 4.0},
        ends={"lower": [0, 0], "upper": [0, 2]},
        motion={},
        initial={"points": points},
    )
    refused(flat, r"^initial\.points: at the start the multipliers are singular \(all links lie on a line", links=4)
    no_rest = rigid_scene(
        soft, cable={**RIGID_CABLE, "unstretched_length": 4.0}, ends={"lower": [0, 0], "upper": [0, 2]}, motion={}
    )
    refused(no_rest, r"^chain: no rest of rigid links found")


@pytest.mark.parametrize("tremor", [0.0, 3e4])  # rad/s: with it the distance is looked at 6e5 times, in blocks
def test_ends_that_come_too_far_apart_are_refused_with_time_and_distance(soft, tremor):
    step = 5e-5 if tremor else 0.01
    # along the chord, 10 + 0.5 (1 - cos 2t): 11 m at pi/2, so 11 m of links are just too short; found between the looks
    motion = {
        axis: {"kind": "one_minus_cosine", "amplitude": 0.5 * part, "angular_frequency": 2.0}
        for axis, part in (("x", 0.8), ("y", 0.6))
    }
    motion = {"upper": motion}
    if tremor:
        motion["lower"] = {"x": {"kind": "one_minus_cosine", "amplitude": 1e-15, "angular_frequency": tremor}}
    refused(
        rigid_scene(soft, motion=motion),
        r"motion: given ends 11 m apart at 1\.5708 s, just the length .*, and too far apart from 1\.570",
    )
    shorter = rigid_scene(soft, motion=motion, cable={**RIGID_CABLE, "unstretched_length": 10.9})
    # 0.5 (1 - cos 2t) = 0.9 at arccos(-0.8) / 2 = 1.249046 s
    refused(
        shorter,
        r"motion: given ends 11 m apart at (1\.5708|4\.71239) s, 0\.1 m \(0\.00917 of it\) more .* from 1\.24905 s on",
    )
    longer = rigid_scene(soft, motion=motion, cable={**RIGID_CABLE, "unstretched_length": 11.0 + 1e-6})
    assert cp.rigid.simulate(longer, times=[0.1], step=step).sizes["time"] == 1
    # not reached within the run
    assert cp.rigid.simulate(shorter, times=[1.0], step=step).sizes["time"] == 1


def test_ends_that_one_long_link_holds_apart(soft):
    chain = {"link_lengths": [1.0, 18.0, 1.0]}
    motion = {"upper": {"x": {"kind": "ramp", "amplitude": -7.0, "duration": 1.0}}}
    scene = rigid_scene(soft, chain=chain, motion=motion)  # 9.9 m and 0.55 m twice, from 10 m to 6.08 m
    refused(scene, r"motion: given ends 6\.08\d+ m apart at [14].*; allowed: always more than 8\.8 m")
    assert cp.rigid.simulate(scene, times=[0.1], step=0.01).sizes["time"] == 1


# --- runs that stop ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_long_step_is_substepped_where_links_rotate_fast(formulation):
    # the falling fold whips round: its end reaches 15 m/s, and 0.1 m of it turns by a right angle in 5 ms
    for step in (0.02, 0.005):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", cp.UnusualSceneWarning)  # thick for its chord
            try:
                run = cp.rigid.simulate(folded(20), times=[0.2, 0.7], formulation=formulation, step=step, outputs=ALL)
                assert [item.category for item in caught] == [cp.NotConvergedWarning]
            except cp.RunStopped as stopped:
                run = stopped.partial
                assert run is not None
        assert all(np.isfinite(run[name]).all() for name in run)
        assert np.abs(link_length_errors(run)).max() < 1e-12
    good = cp.rigid.simulate(folded(20), times=[0.2, 0.5], formulation=formulation, step=1e-4)
    assert good.attrs["energy_drift"] < 1e-3


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_extreme_links_and_masses(formulation):
    # links of 1 : 1000 in both orders, and a chain far from the origin
    ratios = [1.0, 1000.0, 1.0, 300.0, 1000.0]
    scene = pendulum(2.0, [1.2, 0.4], chain={"link_lengths": ratios})
    run = cp.rigid.simulate(scene, times=[0.05, 0.1], formulation=formulation, step=1e-5, outputs=ALL)
    assert np.abs(link_length_errors(run)).max() < 1e-11  # 1e-16 of 2 m in links of 0.9 mm
    assert run.attrs["energy_drift"] < 1e-3
    far = pendulum(
        2.0, [1001.2, 0.4], chain={"links": 5}, ends={"lower": [1000.0, 0.0], "upper": [1001.2, 0.4], "free": "upper"}
    )
    near = pendulum(2.0, [1.2, 0.4], chain={"links": 5})
    a, b = (cp.rigid.simulate(s, times=[0.5], formulation=formulation, step=1e-3).position.values for s in (far, near))
    np.testing.assert_allclose(a - [1000.0, 0.0], b, atol=1e-9)


def test_two_thousand_links_keep_their_lengths(soft):
    run = cp.rigid.simulate(rigid_scene(soft), links=2000, times=[0.05], step=2e-4)
    assert np.abs(link_length_errors(run)).max() < 1e-10
    assert run.attrs["length_error"] < 1e-10
