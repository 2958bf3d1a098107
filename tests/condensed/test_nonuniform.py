"""The condensed model of cables with segments and attachments: closed forms of taut strings, chains of many links, refusals."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import xarray as xr
from references.damped_string import LENGTH, SPEED, damper, roots_with_damper, string
from suite import slow

import cablepod as cp

FIRST = math.pi / LENGTH * SPEED
#: A sagging guy, both of whose ends move.
GUY: dict[str, Any] = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 15000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {
        "upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.07, "angular_frequency": 2.0}},
        "lower": {"y": {"kind": "one_minus_cosine", "amplitude": -0.01, "angular_frequency": 1.3}},
    },
    "damping": {"mass_proportional": 0.2},
    "time": {"duration": 6.0, "interval": 0.02},
    "chain": {"links": 80},
}
PARTS = [{"to": 0.35}, {"from": 0.35, "youngs_modulus": 1.1e11, "area": 9e-5, "density": 7000.0}]

pytestmark = pytest.mark.filterwarnings("ignore::cablepod.errors.UnusualSceneWarning")  # a string of an area of 0.01 m2


def distance(model: Any, reference: Any) -> float:
    """Return the largest rms distance of positions over the largest rms displacement of the reference."""

    def largest(difference: Any) -> float:
        return float(np.sqrt((difference**2).sum("coordinate").mean("particle")).max())

    return largest(model.position - reference.position) / largest(reference.position - reference.position[0])


def chain_of(scene: Any, **options: Any) -> Any:
    """Run the chain in steps that resolve all that the model has: explicit ones with springs have no other quick test."""
    return cp.chain.simulate(scene, scheme="trapezoidal", step=1e-3, **options)


# --- vibrations about rest --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("place", "kappa"), [(0.02, 1.0), (0.04, 0.3), (0.1, 3.0)])
def test_modes_with_a_damper_have_its_kink_and_complex_shapes(place: float, kappa: float) -> None:
    scene = string(attachment=[damper(place, kappa / (math.pi * place))])
    modes = cp.condensed.vibration_modes(scene, rank=3)
    assert modes.sizes["mode"] == 4
    assert np.isnan(modes.damping_ratio.values[3])  # of the kink shape
    # the complex shape is that of the continuous cable
    cable = cp.cable.frequencies(scene, count=3, points=101, law="linear")
    shape = modes.mode_shape_real.values[:3] + 1j * modes.mode_shape_imaginary.values[:3]
    other = cable.mode_shape.values[:, :, 1] + 1j * cable.mode_shape_imaginary.values[:, :, 1]
    product = np.abs((shape * np.conj(other)).sum(axis=1))
    assert product == pytest.approx(np.linalg.norm(shape, axis=1) * np.linalg.norm(other, axis=1), rel=1e-4)


def test_kink_shapes_stand_after_the_modes() -> None:
    things = [damper(0.1, 1.0), {"arc_length": 0.4, "mass": 20.0}, {"arc_length": 0.7, "mass": 1e-3}]
    modes = cp.condensed.vibration_modes(string(attachment=things), rank=4)
    assert modes.sizes["mode"] == 4 + 2  # none of the light mass
    weights = modes.particle_mass.values
    shapes = modes.mode_shape.values
    gram = (shapes * weights) @ shapes.T
    assert gram == pytest.approx(np.diag(np.diag(gram)), abs=1e-9 * gram.max())
    # with the modes they hold the triangle of a force on the damper
    sigma = modes.arc_length.values / modes.arc_length.values[-1]
    triangle = np.minimum(sigma / 0.1, (1.0 - sigma) / 0.9)
    left = triangle - np.linalg.lstsq(shapes.T, triangle, rcond=None)[0] @ shapes
    assert np.abs(left).max() < 1e-6
    # without the kink shapes a part of it is left
    left = triangle - np.linalg.lstsq(shapes[:4].T, triangle, rcond=None)[0] @ shapes[:4]
    assert np.abs(left).max() > 0.1


# --- motion -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
@pytest.mark.parametrize(("place", "kappa"), [(0.02, 1.0), (0.1, 3.0)])
def test_decay_of_a_damped_stay(place: float, kappa: float, scheme: str) -> None:
    eta = kappa / (math.pi * place)
    attached = [damper(place, eta)]
    root = roots_with_damper(place, eta, 1)[0]
    ratio, omega = root.imag / abs(root), abs(root) / math.pi * FIRST
    modes = cp.condensed.vibration_modes(string(attachment=attached), rank=6)
    # released from half a sine of 0.1 m, whose higher modes decay before the second half of the run
    sigma = np.linspace(0.0, 1.0, 101)
    points = np.stack([LENGTH * sigma, 0.1 * np.sin(np.pi * sigma)], axis=1).tolist()
    time = {"duration": 24.0, "interval": 0.02}
    scene = string(attachment=attached, initial={"points": points}, time=time)
    run = cp.condensed.simulate(scene, modes, scheme=scheme, tolerance=1e-5, outputs=("position",))
    deflection = run.position.sel(coordinate="y").values[:, 50]
    peaks = 1 + np.flatnonzero((deflection[1:-1] > deflection[:-2]) & (deflection[1:-1] > deflection[2:]))
    curve = np.array([np.polyfit([-1.0, 0.0, 1.0], deflection[k - 1 : k + 2], 2) for k in peaks])
    heights, times = curve[:, 2] - curve[:, 1] ** 2 / (4.0 * curve[:, 0]), run.time.values[peaks]
    late = times > 8.0
    rate = -np.polyfit(times[late], np.log(heights[late]), 1)[0]
    assert late.sum() >= 10
    assert rate == pytest.approx(ratio * omega, rel=0.01)


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_a_stiff_damper_holds_its_place(scheme: str) -> None:
    # the damping of the basis over a step is above a thousand times the limit of an explicit rate
    attached = [damper(0.2, 1e5)]
    scene = cp.make_scene({**GUY, "attachment": attached, "time": {"duration": 2.0, "interval": 0.05}})
    modes = cp.condensed.vibration_modes(scene, rank=8, static_modes=True)
    run = cp.condensed.simulate(scene, modes, scheme=scheme, tolerance=1e-4, outputs=("position",))
    normal = np.array([-57.7, 20.4]) / math.hypot(20.4, 57.7)
    held = int(np.abs(modes.arc_length.values - 0.2 * modes.arc_length.values[-1]).argmin())
    moved = (run.position - run.position[0]).values @ normal
    assert np.abs(moved[:, held]).max() < 1e-3 * np.abs(moved).max()


@pytest.mark.filterwarnings("ignore::cablepod.errors.NotConvergedWarning")
def test_explicit_steps_with_both_dampings_are_of_second_order() -> None:
    attached = [damper(0.05, 5.0)]
    tables = {
        "attachment": attached,
        "damping": {"mass_proportional": 2.0},
        "time": {"duration": 3.0, "interval": 0.05},
    }
    scene = cp.make_scene(GUY | tables)
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    runs = [
        cp.condensed.simulate(
            scene, modes, scheme="velocity_verlet", step=0.02 / number, outputs=("position",)
        ).position
        for number in (8, 16, 32)
    ]
    differences = [float(np.abs(coarse - fine).max()) for coarse, fine in pairwise(runs)]
    assert differences[0] / differences[1] == pytest.approx(4.0, abs=0.3)  # 2 of first order


#: Tables, and rms distances that are allowed: twice that of the cable without any of them, which is 0.0007 (waves in the chain);
#: forces along the chord by directions that are not normal to it are taken at the slopes of rest.
THINGS: dict[str, tuple[dict[str, Any], float]] = {
    "mass": ({"attachment": [{"arc_length": 0.3, "mass": 60.0}]}, 1.5e-3),
    "segments": ({"segment": PARTS}, 1.5e-3),
    "segments and load": (
        {"segment": PARTS, "load": {"uniform": [3.0, 0.0], "kind": "harmonic", "amplitude": 0.5, "angular_frequency": 3.0}},
        2e-3,
    ),
    "spring": ({"attachment": [{"arc_length": 0.3, "spring": 3000.0, "direction": "normal"}]}, 1.5e-3),
    "damper": ({"attachment": [{"arc_length": 0.05, "damper": 1000.0, "direction": "normal"}]}, 1.5e-3),
    "inclined": (
        {"attachment": [{"arc_length": 0.1, "damper": 600.0, "spring": 800.0, "direction": [0.8, 0.6]}]},
        8e-3,
    ),
    "all": (
        {
            "segment": PARTS,
            "attachment": [
                {"arc_length": 0.3, "mass": 20.0, "spring": 300.0, "direction": [1.0, 0.0]},
                {"arc_length": 0.95, "damper": 500.0, "direction": "normal"},
            ],
        },
        2e-3,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ["mass", slow("segments"), "segments and load", "spring", "damper", "inclined", "all"])
def test_motion_is_that_of_the_chain(case: str) -> None:
    tables, allowed = THINGS[case]
    scene = cp.make_scene({**GUY, **tables})
    chain = chain_of(scene, outputs=("position", "tension"))
    modes = cp.condensed.vibration_modes(scene, rank=12, static_modes=True)
    run = cp.condensed.simulate(scene, modes, outputs=("position", "tension", "error_estimate"))
    error, estimate = distance(run, chain), run.attrs["error_estimate"]
    assert error < allowed
    assert 0.4 * estimate < error < 1.5 * estimate  # as of uniform cables
    assert float((run.tension - chain.tension).std() / chain.tension.std()) < 1.5 * allowed
    plain = cp.condensed.simulate(cp.make_scene(GUY), modes)
    assert distance(plain, chain) > 10.0 * allowed  # the table matters


def test_small_motion_of_a_sagging_guy_with_an_inclined_spring() -> None:
    """Small motions have the slopes of rest, by which the spring moves along the chord too."""
    motion = {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.007, "angular_frequency": 2.0}}}
    spring = {"arc_length": 0.3, "spring": 3000.0, "direction": [1.0, 0.0]}
    cable = {**GUY["cable"], "top_tension": 6000.0}
    scene = cp.make_scene({**GUY, "cable": cable, "motion": motion, "attachment": [spring]})
    modes = cp.condensed.vibration_modes(scene, rank=12, static_modes=True)
    # without its motion along the chord the spring causes 0.0028
    assert distance(cp.condensed.simulate(scene, modes), chain_of(scene)) < 1.5e-3


def test_the_estimate_sees_modes_that_do_not_hold_the_kink() -> None:
    scene = cp.make_scene({**GUY, "attachment": [{"arc_length": 0.1, "spring": 1e3, "direction": "normal"}]})
    chain = chain_of(scene)
    runs = [
        cp.condensed.simulate(scene, cp.condensed.vibration_modes(given, rank=6, static_modes=True))
        for given in (cp.make_scene(GUY), scene)  # modes of the cable without the spring have no kink
    ]
    errors = [distance(run, chain) for run in runs]
    assert errors[0] > 2.0 * errors[1]
    for error, run in zip(errors, runs, strict=True):
        assert 0.7 < error / run.attrs["error_estimate"] < 1.4


def test_the_estimate_sees_waves_of_parts_that_start_unbalanced() -> None:
    errors = {}
    for name, tables, tolerance in (("parts", {"segment": PARTS}, 0.05), ("uniform", {}, 1e-4)):
        scene = cp.make_scene({**GUY, **tables, "initial": {"top_tension": 20000.0}})
        run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=10, static_modes=True))
        # tensions of the short waves between the parts are not resolved, positions are
        errors[name] = distance(run, cp.chain.simulate(scene, tolerance=tolerance))
        assert 0.7 < errors[name] / run.attrs["error_estimate"] < 1.4
    assert errors["parts"] > 10.0 * errors["uniform"]


def test_motion_in_space_with_a_direction_along_all_axes() -> None:
    tables = {
        **GUY,
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [40.4, 40.7, 0.0]},
        "motion": {
            "upper": {
                "z": {"kind": "one_minus_cosine", "amplitude": 0.3, "angular_frequency": 2.0},
                "x": {"kind": "one_minus_cosine", "amplitude": -0.02, "angular_frequency": 3.0},
            }
        },
    }
    things = [
        {"arc_length": 0.2, "damper": 600.0, "spring": 1500.0, "mass": 10.0, "direction": [-0.5, 0.5, 0.7]},
        {"arc_length": 0.8, "mass": 30.0},
    ]
    scene = cp.make_scene({**tables, "attachment": things})
    chain = chain_of(scene)
    modes = cp.condensed.vibration_modes(scene, rank=10, static_modes=True)
    run = cp.condensed.simulate(scene, modes, outputs=("position", "velocity"))
    # without the attachments 0.0034, by the rotation of the chord
    assert distance(run, chain) < 6e-3
    plain = cp.condensed.simulate(cp.make_scene(tables), modes)
    assert distance(plain, chain) > 0.06
    # central differences of the output err by (2.6 Hz 0.02 s)^2 / 6 of the velocity in the sixth mode
    velocity = np.gradient(run.position.values, run.time.values, axis=0)[2:-2]
    assert np.abs(run.velocity.values[2:-2] - velocity).max() < 0.01 * np.abs(velocity).max()


def test_pod_modes_of_a_cable_of_segments() -> None:
    scene = cp.make_scene({**GUY, "segment": PARTS, "attachment": [{"arc_length": 0.5, "mass": 30.0}]})
    chain = cp.chain.simulate(scene)
    modes = cp.pod.decompose(chain, layout="normal", rank=6, weights="mass")
    weights, shapes = modes.particle_mass.values, modes.mode_shape.values
    gram = (shapes * weights) @ shapes.T
    assert gram == pytest.approx(np.diag(np.diag(gram)), abs=1e-9 * gram.max())  # orthogonal in the masses
    run = cp.condensed.simulate(scene, modes)
    assert distance(run, chain) < 2e-3
    np.testing.assert_allclose(run.particle_mass, chain.particle_mass, rtol=1e-9)  # for modes of it by mass


def test_members_of_different_places_and_sizes() -> None:
    scenes = [
        cp.make_scene({**GUY, "attachment": [{"arc_length": place, "mass": mass}]})
        for place, mass in ((0.3, 60.0), (0.5, 20.0))
    ]
    modes = cp.condensed.vibration_modes(scenes[0], rank=10, static_modes=True)
    stack = xr.concat(scenes, "member", data_vars="different", compat="equals")
    runs = cp.condensed.simulate(stack, modes)
    for k, scene in enumerate(scenes):
        alone = cp.condensed.simulate(scene, modes)
        assert np.abs(runs.position.values[k] - alone.position.values).max() < 1e-12 * 60.0
        np.testing.assert_array_equal(runs.particle_mass[k], alone.particle_mass)


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tables", "options", "message"),
    [
        ({"attachment": [{"arc_length": 0.3, "mass": 2.0}]}, {"order": "inertial"}, r"^attachment\.1: given"),
        (
            {"attachment": [{"arc_length": 0.3, "damper": 2.0, "direction": "normal"}]},
            {"scheme": "numerov"},
            "^scheme: given 'numerov'; allowed: .* with a damper",
        ),
        (
            {
                "attachment": [{"arc_length": 0.3, "spring": 2.0, "direction": "normal"}],
                "damping": {"tension_proportional": 1e-3},
            },
            {},
            r"^damping\.tension_proportional: given 0\.001; allowed: none beside a spring",
        ),
    ],
)
def test_refusals_name_the_key(tables: dict[str, Any], options: dict[str, Any], message: str) -> None:
    modes = cp.condensed.vibration_modes(cp.make_scene(GUY), rank=2)
    with pytest.raises(cp.SceneError, match=message):
        cp.condensed.simulate(cp.make_scene({**GUY, **tables}), modes, **options)
