"""Vibration modes: closed forms, the chain's own tangent, the continuous cable, and their use as modes."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
import xarray as xr
from convergence import orders
from references.irvine import horizontal, symmetric_roots
from references.links import tangent_at_rest
from scenes import LENGTHS, everything, scene_with, spatial
from suite import slow

import cablepod as cp
from cablepod import lineage

LAWS = ("linear", "green")


def frequencies(scene, rank, **options):
    return cp.condensed.vibration_modes(scene, rank=rank, **options).angular_frequency.values


def quiet(mapping):
    """The same scene with ends and loads as at time 0."""
    still = {name: table for name, table in copy.deepcopy(mapping).items() if name != "motion"}
    for table in (still.get("load", {}), *still.get("point_load", [])):
        for name in ("kind", "amplitude", "angular_frequency"):
            table.pop(name, None)
    return still


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dims", [2, 3])
@pytest.mark.parametrize("law", LAWS)
def test_a_weightless_chain_has_the_frequencies_of_a_string_of_beads(law, dims):
    length, span, stiffness, mass, links = 10.0, 10.5, 2.0e4, 1.0, 12
    stretch = span / length
    secant = stiffness * (1.0 - 1.0 / stretch) if law == "linear" else 0.5 * stiffness * (stretch**2 - 1.0)
    upper = [0.6 * span, 0.8 * span, 0.0][:dims]
    cable = {"youngs_modulus": stiffness, "area": 1.0, "density": mass, "unstretched_length": length}
    scene = cp.make_scene({"gravity": 1e-9, "cable": cable, "ends": {"lower": [0.0] * dims, "upper": upper}})
    modes = cp.condensed.vibration_modes(scene, rank=links - 1, links=links, law=law)
    number = np.arange(1, links)
    exact = 2.0 * links / length * np.sqrt(secant / mass) * np.sin(0.5 * np.pi * number / links)
    sines = np.sqrt(2.0 / links) * np.sin(np.pi * np.outer(number, np.arange(links + 1)) / links)
    for suffix in ("", "_out_of_plane")[: dims - 1]:
        # rounding of the highest frequency, seven times the lowest, through T / xi, a difference of numbers 20 times as large
        assert modes[f"angular_frequency{suffix}"].values == pytest.approx(exact, rel=1e-12)
        shapes = modes[f"mode_shape{suffix}"].values
        sign = np.sign((shapes * sines).sum(axis=1, keepdims=True))  # entries of equal size decide it, up to rounding
        assert sign * shapes == pytest.approx(sines, abs=1e-10)


@pytest.mark.parametrize("lam2", [0.1, 1.0, 10.0, 4.0 * np.pi**2, 60.0, 200.0, 1000.0])
@pytest.mark.parametrize("law", LAWS)
def test_frequencies_of_a_horizontal_cable_are_irvine_and_caugheys(lam2, law):
    slope, links = 0.02, 200
    scene, unit, strain = horizontal(lam2, slope)
    modes = cp.condensed.vibration_modes(scene, rank=6, links=links, law=law)
    theory = np.sort(np.concatenate([symmetric_roots(lam2, 3), 2.0 * np.pi * np.arange(1, 4)]))[:6]
    # the theory leaves out the square of the slope and the stretch, as in the test of cable.frequencies; the wave number times
    # the length of a link, squared, over 24 is the error of n links, 6e-4 in the sixth mode
    allowed = slope**2 / 4.0 + 1.6 * strain
    assert (np.abs(modes.angular_frequency.values / unit / theory - 1.0) < allowed + (theory / links) ** 2 / 24.0).all()
    taut = np.pi * np.arange(1, 7)
    out_of_plane = modes.angular_frequency_out_of_plane.values / unit
    assert (np.abs(out_of_plane / taut - 1.0) < allowed + (taut / links) ** 2 / 24.0).all()


def test_the_distance_from_irvine_and_caughey_falls_with_the_square_of_the_sag():
    distance = []
    theory = np.sort(np.concatenate([symmetric_roots(30.0, 2), 2.0 * np.pi * np.arange(1, 3)]))[:4]
    for slope in (0.08, 0.04, 0.02):
        scene, unit, _ = horizontal(30.0, slope, dims=2)
        coarse, fine = (frequencies(scene, 4, links=links) / unit for links in (150, 300))
        distance.append(np.abs((4.0 * fine - coarse) / 3.0 / theory - 1.0).max())
    assert orders(distance) == pytest.approx([2.0, 2.0], abs=0.1)


@pytest.mark.parametrize(("ratio", "antisymmetric"), [(0.97, False), (1.03, True)])
def test_the_crossover(ratio, antisymmetric):
    scene, _, _ = horizontal(ratio * 4.0 * np.pi**2, 0.02, dims=2)
    shape = cp.condensed.vibration_modes(scene, rank=1, links=40).mode_shape.values[0]
    # a level cable is symmetric, up to rounding over the distance of the two frequencies
    assert (np.abs(shape + shape[::-1]).max() < 1e-9) == antisymmetric
    assert (np.abs(shape - shape[::-1]).max() < 1e-9) != antisymmetric


def test_a_nearly_inextensible_cable_loses_no_digits():
    # antisymmetric vibrations do not stretch the cable; the strain at rest, 4e-9 and less, shifts them by half of itself
    stiff, stiffest = (frequencies(horizontal(lam2, 0.02, dims=2)[0], 5, links=100)[[0, 2, 4]] for lam2 in (1e5, 1e9))
    assert stiffest == pytest.approx(stiff, rel=1e-8)


# --- chain and continuous cable ---------------------------------------------------------------------------------------


def condensed_chain(scene, law):
    """Squared frequencies of each deflection of the chain about rest, chordwise particles without mass."""
    tangent, mass, x = tangent_at_rest(scene, law)
    dims = x.shape[1]
    chord = (x[-1] - x[0]) / np.linalg.norm(x[-1] - x[0])
    if dims == 2:
        axes = np.array([chord, [-chord[1], chord[0]]])
    else:
        first = np.eye(3)[1] - chord[1] * chord
        first /= np.linalg.norm(first)
        axes = np.array([chord, first, np.cross(chord, first)])
    turned = np.einsum("ac,icjd,bd->iajb", axes, tangent, axes)
    result = []
    for k in range(1, dims):
        inside = np.linalg.solve(turned[:, 0, :, 0], turned[:, 0, :, k])
        reduced = turned[:, k, :, k] - turned[:, k, :, 0] @ inside
        result.append(np.linalg.eigvalsh(reduced / np.sqrt(np.outer(mass, mass))))
    return result


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("dims", [2, 3])
def test_frequencies_are_those_of_the_chain_without_chordwise_mass(soft, dims, law):
    scene = cp.make_scene(quiet(everything(soft, dims)) | {"chain": {"link_lengths": LENGTHS}})
    modes = cp.condensed.vibration_modes(scene, rank=4, law=law)
    for suffix, squares in zip(("", "_out_of_plane"), condensed_chain(scene, law), strict=False):
        # the chain's tangent along the cable is 300 times as large as across: rounding of that
        assert modes[f"angular_frequency{suffix}"].values == pytest.approx(np.sqrt(squares), rel=1e-10)


@pytest.mark.parametrize("number", [2, 3, 4])
def test_frequencies_are_near_those_of_the_continuous_cable(number, scenes):
    scene = cp.read_scene(scenes / f"example{number}.toml")
    found = cp.cable.frequencies(scene, count=4, law="linear").angular_frequency.values
    coarse, fine = (frequencies(scene, 4, links=links) for links in (60, 120))
    rest = cp.chain.rest(scene, links=120)
    reach = np.diff(rest.position.values, axis=0)
    chord = rest.position.values[-1] - rest.position.values[0]
    slope = np.abs(reach[:, 0] * chord[1] - reach[:, 1] * chord[0]).max() / (np.abs(reach @ chord).min())
    # what the deflection moves along the chord has a share of up to the squared slope of the energy of the motion
    # (slopes 0.013 to 0.087, distances 7e-6 to 2.2e-3); Richardson's extrapolation leaves 1e-6
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(found, rel=0.5 * slope**2 + 1e-6)


# --- use as modes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("static_modes", [False, True])
@pytest.mark.parametrize("dims", [2, 3])
def test_modes_are_orthonormal_and_labelled(soft, dims, static_modes):
    scene = cp.make_scene(everything(soft, dims) | {"chain": {"link_lengths": LENGTHS}})
    modes = cp.condensed.vibration_modes(scene, rank=3, static_modes=static_modes)
    weight = 0.5 * (np.array(LENGTHS)[1:] + np.array(LENGTHS)[:-1])
    weight /= weight.mean()
    for suffix in ("", "_out_of_plane")[: dims - 1]:
        shape = modes[f"mode_shape{suffix}"]
        assert shape.dims == ("mode", "particle")
        inner = shape.values[:, 1:-1]
        assert (inner * weight) @ inner.T == pytest.approx(np.eye(3), abs=1e-12)
        assert modes[f"angular_frequency{suffix}"].attrs["units"] == "rad s-1"
    assert ("mode_shape_out_of_plane" in modes) == (dims == 3)
    assert all({"units", "long_name"} <= set(variable.attrs) for variable in modes.variables.values())
    assert modes.attrs["layout"] == "normal"


def test_frequencies_in_space_say_that_the_other_deflection_is_held():
    """Blown aside, the deflection of a guy couples with that in its vertical plane, which doubles a frequency without it."""
    tables = {
        "cable": {"axial_stiffness": 2e7, "mass_per_length": 1.0, "top_tension": 6000.0, "diameter": 0.03},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [80.0, 40.0, 0.0]},
        "chain": {"links": 40},
        "wind": {"speed": 25.0, "direction": [0.0, 0.0, 1.0], "profile": "uniform"},
    }
    scene = cp.make_scene(tables)
    held = cp.condensed.vibration_modes(scene, rank=1).angular_frequency_out_of_plane
    assert "other deflection held" in held.attrs["long_name"]
    assert float(held[0]) > 1.8 * float(cp.cable.frequencies(scene, count=1).angular_frequency[0])


@pytest.mark.parametrize("static_modes", [False, True])
@pytest.mark.parametrize("order", ["leading", "exact", "inertial"])
@pytest.mark.parametrize("dims", [2, slow(3)])
def test_all_vibration_modes_give_the_motion_of_any_other_full_basis(soft, dims, order, static_modes):
    mapping = everything(soft, dims) | {"chain": {"link_lengths": LENGTHS}}
    scene = cp.make_scene(mapping)
    chain = cp.chain.simulate(scene, times=np.linspace(0.0, 2.0, 41), outputs=("position",))
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=static_modes)
    other = cp.pod.decompose(chain, layout="normal")
    options = {"order": order, "step": 1e-3, "times": [0.0, 0.5, 1.0], "outputs": ("position",)}
    a, b = (cp.condensed.simulate(scene, basis, **options) for basis in (modes, other))
    # the same equations in other coordinates: rounding, grown over 1000 steps
    assert np.abs(a.position.values - b.position.values).max() < 1e-9
    again = cp.pod.reconstruct(cp.pod.project(a, modes), modes)
    # deflections return; along the chord all links get the same stretch
    across = [-0.6, 0.8, 0.0][:dims] if dims == 2 else None
    if across:
        assert np.abs((again.position - a.position).values[0] @ across).max() < 1e-9


def test_ensembles_and_files_take_them(soft, tmp_path):
    scene = scene_with(soft)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    members = cp.ensemble.design(scene, {"cable.top_tension": [200.0, 300.0]}, members=3, seed=1)
    runs = cp.condensed.simulate(members, modes, step=4e-3)
    single = cp.condensed.simulate(members.isel(member=1), modes, step=4e-3)
    np.testing.assert_allclose(runs.position.isel(member=1), single.position, rtol=0, atol=1e-12)
    again = cp.archive.read(cp.archive.write(modes, tmp_path / "modes.nc") or tmp_path / "modes.nc")
    xr.testing.assert_equal(again, modes)
    assert again.attrs["id"] == modes.attrs["id"]
    stage = json.loads(modes.attrs["history_json"])[-1]
    assert stage["function"] == "condensed.vibration_modes"
    assert stage["parameters"]["links"] == 8
    names: dict[str, object] = {}
    exec(lineage.script(again).rpartition("cp.archive.write")[0], names)  # stops where an id differs
    xr.testing.assert_equal(names["vibration_modes"], modes)


def test_the_distance_from_training_is_that_from_rest(soft):
    scene, moving = cp.make_scene(quiet(soft)), scene_with(soft)
    modes = cp.condensed.vibration_modes(moving, rank=3)
    at_rest = cp.condensed.simulate(scene, modes, step=4e-3)
    assert at_rest.attrs["outside_training"] == 0.0
    run = cp.condensed.simulate(moving, modes, step=4e-3)
    range_of_pod = cp.pod.decompose(cp.chain.simulate(moving), layout="normal").training_range
    excess = np.log1p(range_of_pod.values[1]) - np.log1p(modes.training_range.values[1])
    assert run.attrs["outside_training"] == pytest.approx(excess.max(), rel=1e-12)
    assert run.attrs["outside_training_feature"] == str(range_of_pod.feature.values[excess.argmax()])
    assert excess.max() > 0.5


# --- static modes -----------------------------------------------------------------------------------------------------


def test_one_static_mode_holds_the_rest(soft):
    for mapping in (soft, spatial(soft), quiet(everything(soft, 3))):
        scene = cp.make_scene(quiet(mapping) | {"chain": {"link_lengths": LENGTHS}})
        modes = cp.condensed.vibration_modes(scene, rank=1, static_modes=True)
        run = cp.condensed.simulate(scene, modes, order="exact", times=[0.0], outputs=("position",))
        rest = cp.chain.rest(scene)
        # Newton's method for the model's equilibrium ends at 1e-9 of a sag of some 0.1 m
        assert np.abs(run.position.values[0] - rest.position.values).max() < 1e-9


def test_two_static_modes_hold_the_rest_between_moved_ends_to_second_order(soft):
    scene = cp.make_scene(quiet(soft))
    length = float(cp.chain.rest(scene).unstretched_length)
    modes = cp.condensed.vibration_modes(scene, rank=2, static_modes=True)
    residuals = []
    for shift in (-0.004, -0.002, -0.001):
        moved = copy.deepcopy(quiet(soft))
        chord = np.hypot(8.0, 6.0)
        moved["ends"]["upper"] = [8.0 * (1.0 + shift / chord), 6.0 * (1.0 + shift / chord)]
        del moved["cable"]["top_tension"]
        moved["cable"]["unstretched_length"] = length
        rest = cp.chain.rest(cp.make_scene(moved)).expand_dims(time=[0.0])
        shape = np.array([-0.6, 0.8]) @ rest.position.values[0].T
        amplitude = cp.pod.project(rest, modes).amplitude.values[0]
        residuals.append(np.abs(shape - amplitude @ modes.mode_shape.values).max())
    assert orders(residuals) == pytest.approx([2.0, 2.0], abs=0.25)


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rank": 0}, "rank: given 0"),
        ({"rank": 8}, "rank: given 8; allowed: at most 7, the number of inner particles"),
        ({"rank": 1.5}, "rank: given 1.5"),
        ({"rank": 2, "links": 1}, "links: given 1"),
        ({"rank": 2, "law": "cubic"}, "law: given 'cubic'"),
    ],
)
def test_wrong_options_are_refused(soft, options, message):
    with pytest.raises(cp.SceneError, match=message):
        cp.condensed.vibration_modes(scene_with(soft), **options)


def test_scenes_without_one_chord_at_rest_are_refused(soft):
    scene = scene_with(soft)
    free = scene_with(quiet(soft), ends={**soft["ends"], "free": "upper"})
    with pytest.raises(cp.SceneError, match=r"ends.free: given 'upper'; allowed: two held ends"):
        cp.condensed.vibration_modes(free, rank=2)
    members = cp.ensemble.design(scene, {"cable.top_tension": [200.0, 300.0]}, members=3, seed=1)
    with pytest.raises(cp.SceneError, match=r"scene: given several members; allowed: one"):
        cp.condensed.vibration_modes(members, rank=2)
