"""Section forces and reactions of a mast: equilibrium with its loads, and a beam-column by hand."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import SMALL, WIND, small, two_sections_in_wind

import cablepod as cp

OUTPUTS = ("bending_moment", "shear_force", "axial_compression", "foot_force", "anchor_force")


def test_a_cantilever_in_uniform_wind_is_that_by_hand():
    # q the drag per length: V = q (L - y), M = q (L - y)^2 / 2, at the top u = q L^4 / 8 EI, with three elements already
    height, stiffness, load = 20.0, 2.0e7, 0.5 * 1.25 * 0.5 * 30.0**2
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "mast": {
                "height": height, "bending_stiffness": stiffness, "mass": 10.0, "elements": 3, "base": "clamped",
                "drag_area": 0.5,
            },
            "wind": {"speed": 30.0, "direction": [1.0, 0.0, 0.0], "profile": "uniform"},
            "time": {"duration": 1.0, "interval": 0.1},
        }
    )  # fmt: skip
    rest = cp.mast.rest(scene).sel(coordinate="x")
    ends = np.stack([rest.element_bottom, rest.element_top], axis=1)
    np.testing.assert_allclose(rest.shear_force, load * (height - ends), rtol=1e-9, atol=1e-9 * load * height)
    moment = 0.5 * load * (height - rest.node_height.values) ** 2
    np.testing.assert_allclose(rest.bending_moment, moment, rtol=1e-9, atol=1e-9 * moment[0])
    np.testing.assert_allclose(rest.displacement[-1], load * height**4 / 8.0 / stiffness, rtol=1e-9)
    run = cp.mast.simulate(scene, outputs=("envelopes",))
    np.testing.assert_allclose(run.shear_force_largest, load * (height - rest.element_bottom), rtol=1e-6)


def tall(elements, **wind):
    """A mast of 72 m on three levels of guys, in the wind of a power profile from the ground on."""
    return cp.make_scene(
        {
            "mast": {"height": 72.0, "bending_stiffness": 4e7, "mass": 60.0, "drag_area": 0.6, "elements": elements},
            "cables": {"guy": {"youngs_modulus": 1.6e11, "area": 2e-4, "density": 8000.0, "diameter": 0.018}},
            "guy": [
                {
                    "cable": "guy", "level": level, "radius": 45.0, "count": 3, "direction": [1.0, 0.0, 0.0],
                    "top_tension": 3e4,
                }
                for level in (23.0, 45.0, 68.0)
            ],
            "damping": {"mass_proportional": 0.1},
            "wind": {"speed": 26.0, "direction": [1.0, 0.0, 0.0], "profile": "power", "exponent": 0.2, **wind},
            "time": {"duration": 20.0, "interval": 0.1},
        }
    )  # fmt: skip


def at_supports(result):
    """Shear along x below and above each level of guys and at the foot."""
    shear, found = result.shear_force.sel(coordinate="x"), []
    for level in (0.0, 23.0, 45.0, 68.0):
        for end, heights in (("upper", result.element_top), ("lower", result.element_bottom)):
            where = np.flatnonzero(np.isclose(heights, level))
            found += [float(shear.isel(element=int(e)).sel(end=end)) for e in where]
    return np.array(found)


def test_shear_at_guys_and_foot_does_not_depend_on_the_elements():
    coarse, fine = (cp.mast.rest(tall(elements)) for elements in (24, 192))
    assert at_supports(fine).size == 7
    np.testing.assert_allclose(at_supports(coarse), at_supports(fine), rtol=1e-3)
    np.testing.assert_allclose(coarse.foot_force, fine.foot_force, rtol=2e-4, atol=1e-6)
    # the free top of 4 m by the profile alone
    top = 0.5 * 1.25 * 0.6 * 26.0**2 * 10.0**-0.4 * (72.0**1.4 - 68.0**1.4) / 1.4
    assert at_supports(coarse)[-1] == pytest.approx(top, rel=1e-6)


def test_shear_in_gusts_does_not_depend_on_the_elements():
    runs = [
        cp.mast.simulate(
            tall(elements, turbulence={"spectrum": "kaimal", "seed": 3}),
            outputs=("envelopes", "shear_force", "foot_force"),
        )
        for elements in (24, 96)
    ]
    coarse, fine = (np.array([at_supports(run.isel(time=k)) for k in range(0, 201, 10)]) for run in runs)
    assert (np.ptp(fine, axis=0) > 0.2 * abs(fine).max(axis=0)).all()  # it is gusty
    # 0.8 % of the largest at each support; forces in the middle of elements lack 4 to 20 %, inertia left out 1 to 5 %
    assert (abs(coarse - fine).max(axis=0) < 0.012 * abs(fine).max(axis=0)).all()
    largest = [float(run.foot_force_horizontal_largest) for run in runs]
    assert largest[0] == pytest.approx(largest[1], rel=5e-3)
    np.testing.assert_allclose(runs[0].foot_force[:, [0, 2]], runs[0].shear_force[:, 0, 0, [0, 2]], rtol=1e-12)


def test_shear_at_the_foot_has_the_inertia_of_the_lowest_element():
    # under a pulse at the top; half of one of eight elements has a sixteenth of the mass
    def heavy(mapping, elements):
        mapping["mast"].update(mass=200.0, elements=elements)
        mapping["mast"]["load"][0] |= {"duration": 0.2}
        mapping["time"] = {"duration": 2.0, "interval": 0.02}

    coarse, fine = (
        cp.mast.simulate(small(lambda mapping, n=n: heavy(mapping, n)), step=0.005, outputs=("foot_force",)).foot_force
        for n in (8, 64)
    )
    across = fine.sel(coordinate="x").values
    np.testing.assert_allclose(coarse.sel(coordinate="x"), across, rtol=0.0, atol=0.01 * np.ptp(across))


def test_guys_in_still_air_stand_with_their_weight_on_mast_and_anchor():
    rest = cp.mast.rest(small())
    both = rest.guy_force + rest.anchor_force
    weight = 9.81 * 8000.0 * 3.8e-5 * rest.guy_length
    np.testing.assert_allclose(both.sel(coordinate="y"), -weight, rtol=1e-9)
    np.testing.assert_allclose(both.sel(coordinate=["x", "z"]), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.sqrt((rest.anchor_force**2).sum("coordinate")), rest.guy_tension_anchor, rtol=1e-12)


@pytest.mark.parametrize("level", [28.0, 28.0 + 4e-10, 28.0 - 4e-10, 83.0 / 3.0])
def test_above_the_guys_a_mast_carries_its_own_weight_only(level):
    def at(mapping):
        mapping["guy"][0]["level"] = level
        del mapping["mast"]["load"]

    scene = small(at)
    above = 20.0 * 9.81 * (30.0 - level)
    for result in (cp.mast.rest(scene), cp.mast.simulate(scene, outputs=("axial_compression",)).isel(time=-1)):
        found = result.axial_compression.sel(element=result.element_top > level + 1e-6)
        assert found.size
        assert float(found[0]) == pytest.approx(above, rel=1e-9)


def test_a_mast_that_stays_at_rest_keeps_the_forces_of_rest():
    scene = small(two_sections_in_wind)
    rest, run = cp.mast.rest(scene), cp.mast.simulate(scene, outputs=(*OUTPUTS, "envelopes"))
    for name in OUTPUTS:
        scale = float(abs(rest[name]).max())
        np.testing.assert_allclose(run[name], rest[name].broadcast_like(run[name]), rtol=0.0, atol=1e-9 * scale)
    size = np.sqrt((rest.bending_moment**2).sum("coordinate"))
    np.testing.assert_allclose(run.bending_moment_largest, size, atol=1e-9 * float(size.max()))
    np.testing.assert_allclose(run.axial_compression_maximum, run.axial_compression_minimum, rtol=1e-9)
    np.testing.assert_allclose(run.anchor_force_largest, rest.guy_tension_anchor, rtol=1e-9)


def test_a_column_with_a_force_in_the_middle_is_that_by_hand():
    # between pinned ends: M = F tan(kL/2) / 2k in the middle, k^2 = N/EI, F/2 at the ends beside N u_top / L
    height, stiffness, force, count = 20.0, 2.0e5, 400.0, 40
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "mast": {
                "height": height, "bending_stiffness": stiffness, "mass": 1.0, "elements": count,
                "load": [{"level": 0.5 * height, "force": [force, 0.0, 0.0]}],
            },
            "cables": {"light": {"youngs_modulus": 1.6e11, "area": 1e-4, "density": 1e-6}},
            "guy": [
                {"cable": "light", "level": height, "radius": 5.0, "count": 4, "direction": [1.0, 0.0, 0.0], "top_tension": 500.0}
            ],
        }
    )  # fmt: skip
    rest = cp.mast.rest(scene)
    axial = float(rest.axial_compression[0])
    k = np.sqrt(axial / stiffness)
    assert 0.3 < k * height / np.pi < 0.9  # the axial force counts
    moment = rest.bending_moment.sel(coordinate="x").values
    assert -moment[count // 2] == pytest.approx(0.5 * force * np.tan(0.5 * k * height) / k, rel=1e-5)
    assert 0.5 * force * np.tan(0.5 * k * height) / k > 1.1 * force * height / 4.0
    tilt = axial * float(rest.displacement.sel(level=height, coordinate="x")) / height
    np.testing.assert_allclose(rest.shear_force.sel(coordinate="x")[: count // 2], 0.5 * force - tilt, rtol=1e-9)
    np.testing.assert_allclose(rest.shear_force.sel(coordinate="x")[count // 2 :], -0.5 * force - tilt, rtol=1e-9)
    assert float(rest.foot_force.sel(coordinate="x")) == pytest.approx(0.5 * force - tilt, rel=1e-9)


def test_under_a_slow_load_the_foot_carries_what_the_guys_do_not():
    def slow(mapping):
        mapping["mast"]["load"][0] |= {"duration": 20.0}
        mapping["mast"]["modes"] = 16  # of few modes the guys lack the static displacement of the others
        mapping["time"] = {"duration": 20.0, "interval": 0.1}

    run = cp.mast.simulate(small(slow), outputs=(*OUTPUTS, "guy_force", "envelopes"))
    load = np.array([1000.0, 0.0, 400.0])
    at_end = run.isel(time=-1)
    foot = load + at_end.guy_force.sum("guy").values
    np.testing.assert_allclose(at_end.foot_force[[0, 2]], foot[[0, 2]], atol=2.0)  # 2 N of 1077 N: what still swings
    np.testing.assert_allclose(at_end.foot_force[1], -float(at_end.axial_compression[0]), rtol=1e-12)
    shear = np.sqrt((run.shear_force**2).sum("coordinate")).max(("time", "end"))
    np.testing.assert_allclose(run.shear_force_largest, shear, rtol=1e-12)
    across = np.sqrt((run.anchor_force.sel(coordinate=["x", "z"]) ** 2).sum("coordinate")).max("time")
    np.testing.assert_allclose(run.anchor_force_horizontal_largest, across, rtol=1e-12)
    assert float(run.guy_axial_force_minimum.min()) == pytest.approx(run.attrs["smallest_chordwise_force"])


def test_no_displacement_along_an_axis_is_above_the_largest_one():
    # whose magnitude is taken at the output times: few of them miss the extremes that all steps have
    def rarely(mapping):
        load = mapping["mast"]["load"][0]
        varies = {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": 5.0, "ramp": 1.0}
        mapping["mast"]["load"][0] = {"level": load["level"], "force": load["force"], **varies}
        mapping["time"] = {"duration": 9.0, "interval": 3.0}

    run = cp.mast.simulate(small(rarely), outputs=("extremes", "envelopes"))
    least, most = abs(run.displacement_minimum), abs(run.displacement_maximum)
    assert (np.maximum(least, most).max("coordinate") <= run.displacement_largest).all()


def test_forces_on_anchors_in_a_storm_are_those_of_a_chain():
    # a guy alone: from the force on its upper end alone, as a run of the mast has it
    guy = {
        "cable": {**SMALL["cables"]["guy"], "top_tension": 5000.0},
        "ends": {"lower": [20.0, 0.0, 0.0], "upper": [0.0, 28.0, 0.0]},
        "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 6.0, "ramp": 1.0}}},
        "wind": {**WIND, "speed": 25.0, "direction": [0.6, 0.0, 0.8]},
        "damping": {"mass_proportional": 0.1}, "time": {"duration": 20.0, "interval": 0.04}, "chain": {"links": 30},
    }  # fmt: skip
    run = cp.chain.simulate(cp.make_scene(guy), tolerance=1e-3, outputs=("position", "tension"))
    ends = run.position.values[:, [1, -2]] - run.position.values[:, [0, -1]]
    forces = ends / np.linalg.norm(ends, axis=-1, keepdims=True) * run.tension.values[:, [0, -1], None]
    on_anchor, on_mast = forces[:, 0], forces[:, 1]
    chord = run.position.values[:, -1] - run.position.values[:, 0]
    along = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    mirrored = on_mast - 2.0 * (on_mast * along).sum(axis=1, keepdims=True) * along
    found = on_anchor[0] + mirrored - mirrored[0]
    error = np.linalg.norm(found - on_anchor, axis=1)
    assert error.max() < 0.03 * np.ptp(np.linalg.norm(on_anchor, axis=1))
    largest = [np.linalg.norm(values, axis=1).max() for values in (found, on_anchor)]
    assert largest[0] == pytest.approx(largest[1], rel=2e-3)
