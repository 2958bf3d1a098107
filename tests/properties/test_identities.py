"""Random cables keep the identities of physics."""

from __future__ import annotations

import copy
import math
import warnings
from typing import Any

import numpy as np
import xarray as xr
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from random_scenes import COMMON
from scenes import spatial, uniform_chain

import cablepod as cp

Mapping = dict[str, Any]


@st.composite
def cables(draw: st.DrawFn, *, weightless: bool = False) -> Mapping:
    """Draw a cable, taut to sagging, whose upper end moves, for about two periods of its first transverse vibration."""
    span, rise = draw(st.floats(2.0, 50.0)), draw(st.floats(-30.0, 30.0))
    chord = math.hypot(span, rise)
    weight = 10.0 ** draw(st.floats(0.0, 2.0))  # N/m
    force = weight * chord * 10.0 ** draw(st.floats(-0.3, 1.5))  # sag over span from 1/4 to 1/250
    stiffness = force * 10.0 ** draw(st.floats(2.0, 4.0))  # strain from 0.01 % to 1 %
    first = math.pi / chord * math.sqrt(force / (weight / 9.81))  # rad/s
    duration = 4.0 * math.pi / first
    load = [weight * draw(st.floats(-1.0, 1.0)), weight * draw(st.floats(-0.5, 0.5))]
    return {
        "gravity": 0.0 if weightless else 9.81,
        "cable": {
            "youngs_modulus": stiffness / 1e-3,
            "area": 1e-3,
            "density": weight / 9.81 / 1e-3,
            "horizontal_force": force,
        },
        "ends": {"lower": [0.0, 0.0], "upper": [span, rise]},
        "load": {"uniform": [load[0], load[1] - weight] if weightless else load},
        # a tenth of what stretches the cable to its tension, so that it stays taut where it began so
        "motion": {"upper": {axis: draw(ends_motion(0.1 * chord * force / stiffness, first)) for axis in "xy"}},
        "time": {"duration": duration, "interval": duration / 16.0},
        "chain": {"links": draw(st.integers(4, 10))},
    }


@st.composite
def ends_motion(draw: st.DrawFn, most: float, first: float) -> Mapping:
    """Draw a harmonic motion [m] at 0.1 to 3 times a frequency [rad/s]."""
    return {
        "kind": "harmonic",
        "amplitude": most * draw(st.floats(0.1, 1.0)) * draw(st.sampled_from([-1.0, 1.0])),
        "angular_frequency": first * draw(st.floats(0.1, 3.0)),
        "phase": draw(st.floats(-3.0, 3.0)),
    }


def step_of(scene: xr.Dataset) -> float:
    """Half of the stability limit of the explicit chain [s], the time of an axial wave along a link."""
    link = float(cp.catenary.rest(scene).unstretched_length) / int(scene.chain_links)
    return 0.5 * link * math.sqrt(float(scene.cable_density / scene.cable_youngs_modulus))


def runs(mapping: Mapping, step: float) -> dict[str, xr.Dataset]:
    """Run chain, Galerkin and condensed model with a given step [s]; two modes of what the chain did."""
    scene = cp.make_scene(mapping)
    outputs = ("position", "tension")
    chain = cp.chain.simulate(scene, step=step, outputs=outputs)
    with warnings.catch_warnings():
        # the model says where it cannot be trusted; it must do so symmetrically all the same
        warnings.simplefilter("ignore", cp.OutOfRangeWarning)
        normal, separate = (cp.pod.decompose(chain, layout=layout, rank=2) for layout in ("normal", "vector"))
        condensed = cp.condensed.simulate(scene, normal, step=step, scheme="trapezoidal", outputs=outputs)
        galerkin = cp.galerkin.simulate(scene, separate, step=step, scheme="trapezoidal", outputs=outputs)
    return {"chain": chain, "galerkin": galerkin, "condensed": condensed}


def turned(mapping: Mapping, matrix: np.ndarray) -> Mapping:
    """Turn or mirror all vectors of a scene (not gravity); motions of one frequency each axis become ones of all axes."""
    result = copy.deepcopy(mapping)
    for end in ("lower", "upper"):
        result["ends"][end] = (matrix @ mapping["ends"][end]).tolist()
    result["load"]["uniform"] = (matrix @ mapping["load"]["uniform"]).tolist()
    result["motion"] = {"upper": {}}
    for i, axis in enumerate("xyz"[: len(matrix)]):
        for j, function in enumerate(mapping["motion"]["upper"].values()):
            if abs(matrix[i, j]) > 1e-15:
                assert axis not in result["motion"]["upper"], "an axis has one motion only"
                amplitude = matrix[i, j] * function["amplitude"]
                result["motion"]["upper"][axis] = {**function, "amplitude": amplitude}
    return result


def agree(got: np.ndarray, wanted: np.ndarray, scene: xr.Dataset, tolerance: float) -> None:
    """Hold that positions agree to a part of the chord."""
    chord = float(np.linalg.norm(scene.ends_upper - scene.ends_lower))
    assert np.abs(got - wanted).max() <= tolerance * chord


#: Rounding of positions, 1e-16 of the chord, is worth up to K/T n^2 ~ 1e6 times as much where links pull transversely; Newton's
#: method leaves 1e-10 of the forces, which bend the cable by a part of the chord.
ROUNDING = 1e-10
PHYSICAL = settings(max_examples=20, **COMMON)


@PHYSICAL
@given(cables())
def test_equilibrium_stays_at_rest(mapping):
    scene = cp.make_scene({**mapping, "motion": {}})
    rest = cp.chain.rest(scene)
    chain = cp.chain.simulate(scene, step=step_of(scene))
    agree(chain.position.values, rest.position.values, scene, ROUNDING)
    modes = cp.pod.decompose(cp.chain.simulate(cp.make_scene(mapping), step=step_of(scene)), layout="vector", rank=2)
    reduced = cp.galerkin.simulate(scene, modes, step=step_of(scene), scheme="trapezoidal")
    agree(reduced.position.values, reduced.position.values[:1], scene, ROUNDING)


@PHYSICAL
@given(cables(), st.sampled_from(["linear", "green"]))
def test_energy_is_kept(mapping, law):
    # let go from the shape of another length, between ends that stand still
    scene = cp.make_scene({**mapping, "motion": {}})
    length = float(cp.catenary.rest(scene).unstretched_length)
    slacker = length * (1.0 + 0.3 * float(scene.cable_horizontal_force / scene.cable_youngs_modulus / scene.cable_area))
    scene = cp.make_scene({**mapping, "motion": {}, "initial": {"unstretched_length": slacker}})
    interval = float(scene.time_interval)
    # the energy is kept at steps, so instants are steps
    step = interval / math.ceil(interval / (8.0 * step_of(scene)))
    run = cp.chain.simulate(scene, law=law, scheme="energy_momentum", step=step, outputs=("position", "velocity"))
    chain = uniform_chain(scene, run)
    kinetic = 0.5 * (run.velocity.values**2).sum(axis=2) @ chain.mass
    xi = np.linalg.norm(np.diff(run.position, axis=1), axis=2) / chain.length
    per_length = (xi**2 - 1.0) ** 2 / 8.0 if law == "green" else np.maximum(xi - 1.0, 0.0) ** 2 / 2.0
    strain = per_length @ (chain.stiffness * chain.length**2)
    weight = np.array([0.0, -float(scene.gravity * scene.cable_density * scene.cable_area)])
    load = scene.load_uniform.values + weight
    share = chain.mass / float(scene.cable_density * scene.cable_area)  # of the length
    work = np.einsum("tpc,p,c->t", run.position.values, share, load)
    total = kinetic + strain - work
    assert kinetic.max() > 0.0
    # 1e-11: Newton's method stops at rounding of the forces; sums of strain energies round at 1e-16 of themselves
    assert np.ptp(total) <= 1e-9 * kinetic.max() + 1e-11 * (strain.max() + np.abs(work).max())


@PHYSICAL
@given(cables())
def test_a_mirrored_scene_moves_as_its_mirror_image(mapping):
    scene = cp.make_scene(mapping)
    mirror = np.diag([-1.0, 1.0])
    image = runs(turned(mapping, mirror), step_of(scene))
    for model, run in runs(mapping, step_of(scene)).items():
        agree(image[model].position.values, run.position.values @ mirror, scene, ROUNDING)
        np.testing.assert_allclose(image[model].tension, run.tension, rtol=1e-6, err_msg=model)


@PHYSICAL
@given(cables(weightless=True), st.integers(1, 6282).map(lambda k: 1e-3 * k))
def test_a_turned_scene_moves_as_the_scene_turned(mapping, angle):
    del mapping["motion"]["upper"]["y"]  # an axis has one motion only
    mapping["motion"]["upper"]["x"]["amplitude"] *= 0.5
    matrix = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    scene = cp.make_scene(mapping)
    image = runs(turned(mapping, matrix), step_of(scene))
    for model, run in runs(mapping, step_of(scene)).items():
        agree(image[model].position.values, run.position.values @ matrix.T, scene, ROUNDING)


@PHYSICAL
@given(cables(), st.integers(1, 6282).map(lambda k: 1e-3 * k))
def test_in_space_the_vertical_is_the_only_direction(mapping, angle):
    del mapping["motion"]["upper"]["y"]
    scene = cp.make_scene(mapping)
    space = spatial(mapping)
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    image = runs(turned(space, matrix), step_of(scene))
    span, rise = mapping["ends"]["upper"]
    for model, run in runs(mapping, step_of(scene)).items():
        if model == "condensed" and abs(rise) > 0.97 * math.hypot(span, rise):
            continue  # along the vertical a horizontal axis tells the normals apart, and these turn as that says
        agree(image[model].position.values, run.position.values @ matrix[:, :2].T, scene, ROUNDING)
        np.testing.assert_allclose(image[model].tension, run.tension, rtol=1e-6, err_msg=model)


@PHYSICAL
@given(cables(), st.integers(-16, 16), st.integers(-12, 12), st.integers(-12, 12))
def test_units_do_not_matter(mapping, of_length, of_force, of_time):
    # powers of two round nothing: what differs is a constant with units hidden in the code, so that cables from micrometres to
    # thousands of kilometres are looked at
    a, force, t = 2.0**of_length, 2.0**of_force, 2.0**of_time
    m = force * t**2 / a
    of_mass = m / a * mapping["cable"]["density"] * mapping["cable"]["area"]
    assume(1e-15 <= of_mass <= 1e15 and of_mass * mapping["gravity"] * a / t**2 <= 1e15)  # others are refused
    other = copy.deepcopy(mapping)
    other["gravity"] *= a / t**2
    for key, unit in (
        ("youngs_modulus", force / a**2),
        ("area", a**2),
        ("density", m / a**3),
        ("horizontal_force", force),
    ):
        other["cable"][key] *= unit
    other["ends"]["upper"] = [a * x for x in mapping["ends"]["upper"]]
    other["load"]["uniform"] = [force / a * x for x in mapping["load"]["uniform"]]
    for function in other["motion"]["upper"].values():
        function["amplitude"] *= a
        function["angular_frequency"] /= t
    for key in ("duration", "interval"):
        other["time"][key] *= t
    scene = cp.make_scene(mapping)
    scaled = runs(other, t * step_of(scene))
    for model, run in runs(mapping, step_of(scene)).items():
        # of the chord: what LAPACK rounds, as it scales its matrices by thresholds, and the steps of a run add up
        agree(scaled[model].position.values / a, run.position.values, scene, 1e-11)
        np.testing.assert_allclose(scaled[model].tension / force, run.tension, rtol=1e-6, err_msg=model)
