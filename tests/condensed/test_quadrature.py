"""Chordwise stretch at quadrature points: comparison with the links, convergence, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from host_scenes import sines

import cablepod as cp
from cablepod import examples

TIMES = np.arange(0.0, 10.1, 0.5)
OPTIONS = {"order": "exact", "scheme": "velocity_verlet", "step": 0.01, "times": TIMES}


def largest_error(run, truth):
    return float(cp.compare.errors(run, truth).error_max)


@pytest.mark.parametrize("law", ["linear", "green"])
def test_links_converge_to_quadrature_points(law):
    """Both approximate the continuous cable; their distance is the second-order error of the links."""
    scene = examples.scene("example4")
    apart = []
    for links in (20, 40, 80):
        modes = sines(2, points=links + 1)
        whole, few = (
            cp.condensed.simulate(scene, modes, law=law, quadrature=points, outputs=("position",), **OPTIONS)
            for points in (None, 16)
        )
        apart.append(largest_error(few, whole))
    # second order; higher orders are a fifth of it at 20 links, where a half-wave of the second mode has ten
    np.testing.assert_allclose([apart[0] / apart[1], apart[1] / apart[2]], 4.0, rtol=0.2)


def test_chordwise_inertia_of_links_converges_to_that_of_points(soft):
    """A soft cable is shaken so fast that chordwise inertia changes the motion by a tenth."""
    shaken = {"upper": {"x": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 8.0, "phase": 0.0}}}
    scene = cp.make_scene({**soft, "motion": shaken})
    options = {"scheme": "velocity_verlet", "step": 1e-3, "times": np.arange(21) / 10, "outputs": ("position",)}
    apart = []
    for links in (20, 40, 80):
        modes = sines(2, points=links + 1)
        whole = cp.condensed.simulate(scene, modes, order="inertial", **options)
        few, without = (
            cp.condensed.simulate(scene, modes, order=order, quadrature=16, **options)
            for order in ("inertial", "exact")
        )
        apart.append(largest_error(few, whole))
    assert largest_error(without, few) > 0.05
    np.testing.assert_allclose([apart[0] / apart[1], apart[1] / apart[2]], 4.0, rtol=0.2)


def test_sixteen_points_suffice_for_three_modes():
    """Sixteen points integrate products of four slopes of three sines to 1e-6."""
    scene, modes = examples.scene("example4"), sines(3, points=81)
    few, many = (cp.condensed.simulate(scene, modes, quadrature=n, outputs=("position",), **OPTIONS) for n in (16, 32))
    assert largest_error(few, many) < 1e-4


def test_members_equal_single_runs():
    scenes = cp.ensemble.design(
        examples.scene("example4"), {"cable.top_tension": [7500.0, 9000.0]}, members=2, sampling="list"
    )
    modes = sines(2)
    options = {**OPTIONS, "quadrature": 12, "outputs": ("position",)}
    both = cp.condensed.simulate(scenes, modes, **options)
    alone = cp.condensed.simulate(scenes.isel(member=1, drop=True), modes, **options)
    # rescaled and recomputed coefficients differ by rounding times the condition of a taut cable, K over tension
    np.testing.assert_allclose(both.position.isel(member=1), alone.position, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"order": "leading"}, "exact"),
        ({"outputs": ("tension_extremes",)}, "links"),
        ({"quadrature": 3}, "quadrature"),
        ({"quadrature": 5}, "smoother"),
    ],
)
def test_unsupported_options_are_refused(changes, match):
    options = {**OPTIONS, "quadrature": 12, **changes}
    with pytest.raises(cp.SceneError, match=match):
        cp.condensed.simulate(examples.scene("example4"), sines(4), **options)


def test_point_loads_are_refused(soft):
    scene = cp.make_scene({**soft, "point_load": [{"arc_length": 0.5, "force": [0.0, -1.0]}]})
    with pytest.raises(cp.SceneError, match="point loads"):
        cp.condensed.simulate(scene, sines(2), quadrature=12, **OPTIONS)
