"""Masts from inside: beam, guys and their damping by closed forms, and how often the drag is computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mast_scenes import THINGS, WIND, small, two_sections_in_wind, windy
from scipy.optimize import curve_fit

import cablepod as cp
from cablepod.mast import _condensed_run
from cablepod.mast._beam import MASS, beam_of, hermite
from cablepod.mast._condensed_guy import guy_set, sines
from cablepod.mast._condensed_run import CondensedGuys, CondensedRun
from cablepod.mast._drag import drag_of_mast
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastRequest
from cablepod.mast._runs import MastCase
from cablepod.mast._static_guys import GuyStatics, static_guys
from cablepod.mast._statics import _at, rest_in, rest_of
from cablepod.parameters._mast import mast_parameters
from cablepod.wind._mast_air import mean_mast_air

RATIOS = [0.01, 0.04, 0.02]


def with_things(**tables):
    """The small mast with segments and attachments of its guys."""
    return small(lambda mapping: (mapping["cables"]["guy"].update(THINGS), mapping.update(tables)))


# --- guys -------------------------------------------------------------------------------------------------------------


def condensed(scene, rank):
    """The guys of a scene on the straight mast: exact catenaries and condensed models."""
    guys = static_guys(mast_parameters(scene))
    return guys, guy_set(guys, [guy.p.upper for guy in guys], (sines(rank), sines(rank)))


def test_forces_of_guys_are_the_slopes_of_their_energy():
    _, guys = condensed(small(), 3)
    rng = np.random.default_rng(1)
    upper = guys.upper + np.array([0.1, 0.0, -0.2])
    q = guys.rest(guys.upper) + 0.1 * rng.normal(size=(3, 6))
    forces = np.concatenate(guys.forces(q, upper), axis=1)
    step = 1e-5
    for place in range(9):
        change = np.zeros(9)
        change[place] = step
        high = guys.energy(q + change[:6], upper + change[6:])
        low = guys.energy(q - change[:6], upper - change[6:])
        assert (
            np.abs(forces[:, place] + (high - low) / (2.0 * step)).max() < 1e-3
        )  # N: rounding of the energy over the step


def test_condensed_guys_at_rest_pull_as_catenaries_do():
    # sixteen sines: the error is that of order "leading", the square of the slopes
    exact, guys = condensed(small(), 16)
    forces = guys.forces(guys.rest(guys.upper), guys.upper)[1]
    for guy, force in zip(exact, forces, strict=True):
        np.testing.assert_allclose(
            force, GuyStatics([guy], guy.p.upper[None]).forces[0], atol=1e-4 * np.abs(force).max()
        )


@pytest.mark.parametrize("number", [0, 1, 3, 5])
def test_each_vibration_of_a_guy_has_its_ratio(number):
    # a mast that is too heavy to move: the guys vibrate between fixed ends, from a start that no scene can give
    def heavy(mapping):
        mapping["damping"] = {"ratios": RATIOS}
        mapping["mast"] |= {"bending_stiffness": 4e12, "mass": 2e7, "base": "clamped", "load": []}

    p = mast_parameters(small(heavy))
    model = CondensedGuys(ModalMast(rest_of(p)), (sines(3), sines(3)), None)
    q, on_mast = model.rest
    squared, vectors = np.linalg.eigh(model.guys.tangent(q, model.guys.upper)[1, :6, :6])
    omega = np.sqrt(squared[number])
    request = MastRequest(0.1 / omega * np.arange(600), 1, None, keeps_guys=True)
    start = q.copy()
    start[1] += 1e-4 / np.linalg.norm(vectors[:, number]) * vectors[:, number]
    rest = CondensedRun(model, None).run(replace(request, times=request.times[:2])).guy_position[0, 1]
    vars(model)["rest"] = start, on_mast
    moved = CondensedRun(model, None).run(request).guy_position[:, 1] - rest
    motion = (moved * moved[0]).sum(axis=(1, 2)) / (moved[0] ** 2).sum()

    def decaying(t, rate, frequency, c, s, mean):
        return np.exp(-rate * t) * (c * np.cos(frequency * t) + s * np.sin(frequency * t)) + mean

    rate, frequency = curve_fit(decaying, request.times, motion, p0=(0.02 * omega, omega, 1.0, 0.0, 0.0))[0][:2]
    assert np.hypot(rate, frequency) == pytest.approx(omega, rel=2e-3)
    assert rate / omega == pytest.approx(RATIOS[min(number, 2)], rel=0.02)


def test_a_direction_normal_to_the_chord_is_that_of_each_guy():
    for guy in mast_parameters(with_things()).guys:
        chord, direction = guy.p.upper - guy.p.lower, guy.p.attachments[1].direction
        assert abs(chord @ direction) < 1e-12
        assert abs(np.cross(chord, [0.0, 1.0, 0.0]) @ direction) < 1e-12  # in the vertical plane


def test_stiffness_of_a_guy_is_the_slope_of_its_force():
    scene = with_things(wind=WIND)
    guy = rest_of(mast_parameters(scene)).guys[1]
    stiffness = GuyStatics([guy], guy.p.upper[None]).stiffness()[0]
    step = 1e-4  # m
    for axis in np.eye(3):
        high, low = (GuyStatics([guy], (guy.p.upper + sign * step * axis)[None]).forces[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(stiffness @ axis, (low - high) / (2.0 * step), atol=1e-5 * stiffness.max())


def test_a_straight_guy_brings_its_mass_to_the_mast():
    scene = with_things()
    p = mast_parameters(scene)
    mast = ModalMast(rest_of(p))
    sigma = (np.arange(100000) + 0.5) / 100000
    length = mast.rest.bare[0].length
    per_length = np.where(sigma < 0.3, 5000.0, 8000.0) * 3.8e-5
    expected = length * np.mean(per_length * sigma**2) + 15.0 * (6.0 / length) ** 2
    added = mast.mass_with_guys - mast.rest.beam.mass
    rows = mast.rest.rows
    np.testing.assert_allclose(added, expected * np.einsum("gia,gib->ab", rows, rows), rtol=1e-7, atol=1e-9)
    summary = cp.summary(scene)
    assert "cables.guy.segment.1: guys move as chains of 20 links" in str(summary.note.values)


# --- the mast ---------------------------------------------------------------------------------------------------------


def test_a_guy_to_the_foot_of_the_mast_adds_no_stiffness_against_its_rotation():
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "mast": {"height": 60.0, "bending_stiffness": 2e7, "mass": 40.0},
            "cables": {"light": {"youngs_modulus": 1.6e11, "area": 1e-4, "density": 1e-6}},
            "guy": [{"cable": "light", "level": 60.0, "anchor": [0.0, 0.0, 0.0], "top_tension": 2e4}],
        }
    )
    p = mast_parameters(scene)
    beam = beam_of(p)
    guys = static_guys(p)
    drag = drag_of_mast(p, beam, None)
    rest = _at(p, drag, guys, guys, np.zeros(beam.count))
    rotation = np.zeros(beam.count)
    single = np.column_stack([beam.height, np.ones_like(beam.height)]).ravel()[beam.free]
    rotation[: single.size] = single
    assert abs(rotation @ rest.stiffness @ rotation) < 1e-9 * 2e4 * 60.0
    assert abs(rotation @ rest.geometric @ rotation) > 0.9 * 2e4 * 60.0  # what the guy cancels


def by_statics(scene):
    """Moments (node, 2), shear at the ends of elements (element, end, 2) and force on the foot (3,) by summing all above.

    Drag is the integral of the power profile in closed form; nothing follows from stiffnesses or elements' loads.
    """
    p = mast_parameters(scene)
    found = rest_in(p, mean_mast_air(p))
    beam = found.beam
    height, nodes = beam.height, beam.height.size
    wind = {name: float(scene[f"wind_{name}"]) for name in ("speed", "exponent", "ground", "air_density")}
    power = 2.0 * wind["exponent"]

    def drag(bottom):
        """Drag above a height, and its moment about it, along the wind."""
        force = moment = 0.0
        for low, high, _, _, area in p.sections:
            low, high = (max(end, bottom) for end in (low, high))
            ends = np.array([low, high]) - wind["ground"]
            of_force, of_moment = (np.diff(ends**n / n)[0] * 10.0**-power for n in (power + 1.0, power + 2.0))
            scale = 0.5 * wind["air_density"] * area * wind["speed"] ** 2
            force += scale * of_force
            moment += scale * (of_moment - (bottom - wind["ground"]) * of_force)
        return force, moment

    along = np.array([0.6, 0.8])
    force = np.zeros((nodes, 2))
    force[-1] += [300.0, -150.0]
    moved, pull = beam.all_rows @ found.unknowns, np.zeros(nodes)
    for level, own in zip(found.levels, found.force, strict=True):
        node = np.abs(height - level).argmin()
        force[node] += own[[0, 2]]
        pull[node] -= own[1]
    single = np.zeros((2, 2 * nodes))
    single[:, beam.free] = found.unknowns.reshape(2, -1)
    places, weights = np.polynomial.legendre.leggauss(5)
    moments = np.zeros((nodes, 2))
    for i in range(nodes):
        reach = np.maximum(height - height[i], 0.0)
        moments[i] = reach @ force + np.where(height > height[i], pull, 0.0) @ (moved - moved[i])
        moments[i] += drag(height[i])[1] * along
        for e in range(i, nodes - 1):
            shapes = hermite(0.5 * (1.0 + places), float(beam.length[e]), 0)
            weight = beam.section[e, MASS] * p.gravity * beam.length[e]
            moments[i] += weight * (single[:, 2 * e : 2 * e + 4] @ shapes @ (0.5 * weights) - moved[i])
    shear = np.array(
        [[force[e + 1 :].sum(axis=0) + drag(height[e + end])[0] * along for end in range(2)] for e in range(nodes - 1)]
    )
    weight = p.gravity * (p.sections[:, MASS] * (p.sections[:, 1] - p.sections[:, 0])).sum()
    foot = shear[0, 0]
    return moments, shear, np.array([foot[0], -weight - found.pull.sum(), foot[1]])


@pytest.mark.parametrize("base", ["pinned", "clamped"])
def test_moments_shear_and_reactions_at_rest_are_in_equilibrium_with_the_loads(base):
    scene = small(lambda mapping: (two_sections_in_wind(mapping), mapping["mast"].update(base=base)))
    rest = cp.mast.rest(scene)
    moments, shear, foot = by_statics(scene)
    largest = abs(moments).max()
    assert largest > 500.0
    # eight points of an element integrate the profile to 1e-8
    np.testing.assert_allclose(rest.bending_moment.sel(coordinate=["x", "z"]), moments, rtol=0.0, atol=1e-7 * largest)
    assert rest.shear_force.dims == ("element", "end", "coordinate")
    np.testing.assert_allclose(
        rest.shear_force.sel(end=["lower", "upper"], coordinate=["x", "z"]),
        shear,
        rtol=0.0,
        atol=1e-7 * abs(shear).max(),
    )
    np.testing.assert_allclose(rest.foot_force, foot, rtol=1e-7)
    assert (float(abs(rest.bending_moment.isel(node=0)).max()) > 0.01 * largest) == (base == "clamped")


# --- drag -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rank", "least"), [(2, 0.99), (4, 0.9), (6, 0.7)])
def test_drag_damps_the_vibrations_of_a_guy_as_its_shapes_say(rank, least):
    """In uniform wind the damping of orthonormal shapes is the unit matrix, less where a shape is no polynomial of the points.

    Values of the shapes at the points made it 1.5 for the last of four, 0.37 and 1.4 for the last two of eight.
    """
    options = dict.fromkeys(("links", "times", "step", "tolerance", "window", "wind"))
    case = MastCase(small(windy), None, guys="condensed", rank=rank, outputs=("guy_tension",), **options)
    wind = case.model.model.wind(case.air, np.empty((0, 0)))
    weights = wind.drag[:, 0] / wind.drag[:, 0].sum()
    for shapes in wind.shapes[:, :, :rank]:
        rates = np.linalg.eigvalsh(shapes.T @ (weights[:, None] * shapes))
        assert least < rates.min()
        assert rates.max() < 1.0 + 1e-12


def test_drag_is_held_over_two_short_steps():
    options = dict.fromkeys(("rank", "links", "times", "step", "tolerance", "window", "wind"))
    model = MastCase(small(windy), None, guys="condensed", outputs=("guy_tension",), **options).model
    assert [model.steps_of_drag(factor * model.default_step) for factor in (0.5, 1.0, 1.2)] == [2, 2, 1]


def test_held_drag_keeps_the_second_order(monkeypatch):
    """Drag at the start of both steps, or of rates at another instant, has the first order: a ratio of two."""

    def tension(steps):
        return cp.mast.simulate(small(windy), step=0.04 / steps).guy_tension.values

    runs = [tension(steps) for steps in (4, 8)]
    monkeypatch.setattr(_condensed_run, "STEPS_OF_DRAG", 1)
    fine = tension(32)
    coarse, half = (np.sqrt(((run - fine) ** 2).mean(axis=0)).max() for run in runs)
    assert 3.3 < coarse / half < 4.7
    assert np.abs(runs[0] - tension(4)).max() > 0.0
