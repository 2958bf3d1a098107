"""Section forces and reactions of a mast: equilibrium with its loads, and a beam-column by hand."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import SMALL, WIND, small

import cablepod as cp
from cablepod.mast._beam import MASS, hermite
from cablepod.mast._statics import rest_in
from cablepod.parameters._mast import mast_parameters
from cablepod.wind._mast_air import mean_mast_air

OUTPUTS = ("bending_moment", "shear_force", "axial_compression", "foot_force", "anchor_force")


def windy(mapping):
    """Steady wind on a mast of two sections, along neither axis."""
    mapping["wind"] = {**WIND, "direction": [0.6, 0.0, 0.8], "profile": "power", "exponent": 0.2, "ground": -1.0}
    del mapping["wind"]["turbulence"]
    mapping["mast"]["drag_area"] = 0.3
    mapping["mast"]["section"] = [{"from": 0.0, "to": 12.0, "mass": 35.0, "bending_stiffness": 6e6, "drag_area": 0.4}]
    mapping["mast"]["load"] = [{"level": 30.0, "force": [300.0, 0.0, -150.0]}]


def by_statics(scene):
    """Moments (node, 2) and horizontal forces (element, 2) by summing all that acts above; independent of stiffnesses."""
    p = mast_parameters(scene)
    found = rest_in(p, mean_mast_air(p))
    beam, wind = (
        found.beam,
        {name: scene[f"wind_{name}"].values[()] for name in ("speed", "exponent", "ground", "air_density")},
    )
    height, nodes = beam.height, beam.height.size
    speed = wind["speed"] * ((height - wind["ground"]) / 10.0) ** wind["exponent"]
    area = 0.5 * (np.append(beam.section[:, 4] * beam.length, 0.0) + np.append(0.0, beam.section[:, 4] * beam.length))
    force = (0.5 * wind["air_density"] * area * speed**2)[:, None] * np.array([0.6, 0.8])
    force[-1] += [300.0, -150.0]
    moved, pull = beam.all_rows @ found.unknowns, np.zeros(nodes)
    for level, own in zip(found.levels, found.force, strict=True):
        force[beam.node(level)] += own[[0, 2]]
        pull[beam.node(level)] -= own[1]
    single = np.zeros((2, 2 * nodes))
    single[:, beam.free] = found.unknowns.reshape(2, -1)
    places, weights = np.polynomial.legendre.leggauss(5)
    moments = np.zeros((nodes, 2))
    for i in range(nodes):
        reach = np.maximum(height - height[i], 0.0)
        moments[i] = reach @ force + np.where(height > height[i], pull, 0.0) @ (moved - moved[i])
        for e in range(i, nodes - 1):
            shapes = hermite(0.5 * (1.0 + places), float(beam.length[e]), 0)
            weight = beam.section[e, MASS] * p.gravity * beam.length[e]
            moments[i] += weight * (single[:, 2 * e : 2 * e + 4] @ shapes @ (0.5 * weights) - moved[i])
    shear = np.array([force[e + 1 :].sum(axis=0) for e in range(nodes - 1)])
    return moments, shear, force, found


@pytest.mark.parametrize("base", ["pinned", "clamped"])
def test_moments_shear_and_reactions_at_rest_are_in_equilibrium_with_the_loads(base):
    scene = small(lambda mapping: (windy(mapping), mapping["mast"].update(base=base)))
    rest = cp.mast.rest(scene)
    moments, shear, force, found = by_statics(scene)
    largest = abs(moments).max()
    assert largest > 500.0
    np.testing.assert_allclose(rest.bending_moment.sel(coordinate=["x", "z"]), moments, rtol=0.0, atol=1e-9 * largest)
    np.testing.assert_allclose(
        rest.shear_force.sel(coordinate=["x", "z"]), shear, rtol=0.0, atol=1e-9 * abs(shear).max()
    )
    np.testing.assert_allclose(rest.foot_force.sel(coordinate=["x", "z"]), force.sum(axis=0), rtol=1e-9)
    weight = 9.81 * (12.0 * 35.0 + 18.0 * 20.0)
    assert float(rest.foot_force.sel(coordinate="y")) == pytest.approx(-weight - found.pull.sum(), rel=1e-12)
    assert (float(abs(rest.bending_moment.isel(node=0)).max()) > 0.01 * largest) == (base == "clamped")


def test_guys_in_still_air_stand_with_their_weight_on_mast_and_anchor():
    rest = cp.mast.rest(small())
    both = rest.guy_force + rest.anchor_force
    weight = 9.81 * 8000.0 * 3.8e-5 * rest.guy_length
    np.testing.assert_allclose(both.sel(coordinate="y"), -weight, rtol=1e-9)
    np.testing.assert_allclose(both.sel(coordinate=["x", "z"]), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.sqrt((rest.anchor_force**2).sum("coordinate")), rest.guy_tension_anchor, rtol=1e-12)


def test_a_mast_that_stays_at_rest_keeps_the_forces_of_rest():
    scene = small(windy)
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
    shear = np.sqrt((run.shear_force**2).sum("coordinate")).max("time")
    np.testing.assert_allclose(run.shear_force_largest, shear, rtol=1e-12)
    across = np.sqrt((run.anchor_force.sel(coordinate=["x", "z"]) ** 2).sum("coordinate")).max("time")
    np.testing.assert_allclose(run.anchor_force_horizontal_largest, across, rtol=1e-12)
    assert float(run.guy_axial_force_minimum.min()) == pytest.approx(run.attrs["smallest_chordwise_force"])


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
