"""Trajectories and shapes of another program: Datasets like those of the package, or refused by name."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
import xarray as xr
from public_calls import SPATIAL
from scenes import SOFT

import cablepod as cp
from cablepod import provenance
from cablepod.archive import describe
from cablepod.lineage import script

pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")
SIGMA = np.linspace(0.0, 1.0, 11)
SINES = np.array([np.sin(i * np.pi * SIGMA) for i in (1, 2, 3)])


@cache
def scene(spatial: bool = False) -> xr.Dataset:
    return cp.make_scene(SPATIAL if spatial else SOFT)


@cache
def chain(spatial: bool = False) -> xr.Dataset:
    return cp.chain.simulate(scene(spatial), links=10, step=1e-3, outputs=("position",))


def of_array(values: np.ndarray | None = None, **options) -> xr.Dataset:
    return cp.snapshots(chain().position.values if values is None else values, scene=scene(), **options)


# --- snapshots ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spatial", [False, True])
def test_positions_of_another_program_are_a_trajectory(spatial):
    run, own = chain(spatial), cp.snapshots(chain(spatial).position.values, scene=scene(spatial))
    xr.testing.assert_identical(own.drop_attrs(deep=False), run.drop_attrs(deep=False))
    assert own.attrs["stage"] == run.attrs["stage"] == "trajectory"
    assert float(cp.compare.errors(own, run).error_max) == 0.0
    for layout in ("separate", "vector", "normal"):
        mine, theirs = (cp.pod.decompose(item, rank=2, layout=layout) for item in (own, run))
        xr.testing.assert_identical(mine.drop_attrs(deep=False), theirs.drop_attrs(deep=False))


def test_instants_in_milliseconds_are_warned_of():
    run = chain()
    with pytest.warns(cp.UnusualSceneWarning, match="seconds, if these are ms"):
        cp.snapshots(run.position.values, scene=scene(False), times=1e3 * run.time.values)


def test_positions_bring_the_masses_of_their_scene():
    heavy = cp.make_scene({**SOFT, "attachment": [{"arc_length": 0.3, "mass": 5.0}]})
    run = cp.chain.simulate(heavy, links=10, step=1e-3)
    modes, own = cp.pod.decompose(run, weights="mass"), cp.snapshots(run.position.values, scene=heavy)
    again = cp.pod.reconstruct(cp.pod.project(run, modes), modes)
    assert float(own.particle_mass.max()) > 5.0
    for item in (own, again):
        found = cp.pod.decompose(item, weights="mass").singular_value
        np.testing.assert_allclose(found, modes.singular_value, atol=1e-12)  # rounding of positions of some metres


def test_a_labelled_array_brings_its_places_and_instants():
    run = chain()
    given = run.position.transpose("coordinate", "particle", "time")
    own = cp.snapshots(given)  # without a scene
    for name in ("position", "arc_length", "time", "unstretched_length"):
        xr.testing.assert_identical(own[name].drop_attrs(), run[name].drop_attrs())
    assert "scene_feature" not in own
    xr.testing.assert_identical(cp.snapshots(run)["position"], run["position"])  # of a Dataset its position
    bare = given.drop_vars(["arc_length", "time"])
    own = cp.snapshots(bare, arc_length=run.arc_length.values, times=run.time.values)
    xr.testing.assert_identical(own["position"].drop_attrs(), run["position"].drop_attrs())
    without = cp.snapshots(bare, arc_length=run.arc_length)  # no instants: enough for modes
    assert "time" not in without.coords
    assert cp.pod.decompose(without, rank=2).sizes["mode"] == 2


def test_the_given_array_is_copied():
    values = chain().position.values.copy()
    own = cp.snapshots(values, scene=scene())
    values[:] = 0.0
    assert float(np.abs(own.position).max()) > 1.0


def test_snapshots_are_a_stage_with_a_hash(tmp_path):
    own = of_array()
    stage = provenance.stages_of(own)[-1]
    assert stage["function"] == "snapshots"
    assert stage["inputs"] == [scene().attrs["id"]]
    changed = chain().position.values.copy()
    changed[3, 4, 1] = np.nextafter(changed[3, 4, 1], 9e9)
    other = cp.snapshots(changed, scene=scene())
    assert other.attrs["id"] != own.attrs["id"] == of_array().attrs["id"]
    path = cp.archive.write(own, tmp_path / "own.nc")
    again = cp.archive.read(path)
    assert again.attrs["id"] == own.attrs["id"]
    assert "snapshots" in describe(path)
    modes = cp.pod.decompose(again, rank=2)
    assert [stage["function"] for stage in provenance.stages_of(modes)] == ["make_scene", "snapshots", "pod.decompose"]
    # nothing can make another program's numbers again, and the script says so
    assert "only a digest is kept of position" in "\n".join(script(again).splitlines())


WRONG_SNAPSHOTS = {
    "two dimensions": (lambda: cp.snapshots(SINES, scene=scene()), r"position: given the shape \(3, 11\); allowed: an array"),
    "no numbers": (lambda: cp.snapshots("run.csv", scene=scene()), "position: given a str; allowed: an array"),
    "ragged": (lambda: cp.snapshots([[1.0], [2.0, 3.0]], scene=scene()), "position: given a list; allowed: an array"),
    "other names": (
        lambda: cp.snapshots(chain().position.rename(particle="node")),
        r"position: given \('time', 'node', 'coordinate'\)|position: given .*node.*; allowed: .*rename",
    ),
    "other units": (
        lambda: cp.snapshots(chain().position.assign_attrs(units="mm")),
        "position: units: given 'mm'; allowed: m",
    ),
    "not finite": (
        lambda: cp.snapshots(chain().position.where(chain().time < 2.0)),
        "position: given .*not finite.*'time': 4.*; allowed: finite",
    ),
    "no places": (
        lambda: cp.snapshots(chain().position.values),
        "arc_length: given none with position of 11 particles; allowed: arc_length=, .* or scene=",
    ),
    "reversed": (lambda: of_array(chain().position.values[:, ::-1]), "position: lower end: given .*from the lower end"),
    "axes": (lambda: of_array(chain().position.values[:, :, ::-1]), "position: upper end: given .*y upwards"),
    "millimetres": (lambda: of_array(1e3 * chain().position.values), "position: upper end: given "),
    "dims": (lambda: cp.snapshots(chain(True).position.values, scene=scene()), "position: given '3 coordinates'"),
    "length": (lambda: of_array(arc_length=np.linspace(0, 11.0, 11)), "arc_length: given '11 m in all'; allowed: within 1 %"),
    "falling": (lambda: of_array(arc_length=np.linspace(10.0, 0.0, 11)), "arc_length: given .*11 numbers that rise from 0"),
    "instants": (lambda: of_array(times=[0.0, 1.0]), "times: given .*; allowed: 9 finite, rising instants"),
    "fewer": (lambda: of_array(chain().position.values[:5]), "times: given 'none with 5 instants'; allowed: times="),
    "members": (
        lambda: cp.snapshots(chain().position.values, scene=cp.ensemble.design(scene(), {"gravity": [9.0, 10.0]}, members=2)),
        "scene: given several members",
    ),
    "labels": (
        lambda: cp.snapshots(chain().position.assign_coords(coordinate=["x", "z"])),
        "position: coordinate: given .*; allowed: .*y upwards",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_SNAPSHOTS)
def test_positions_that_cannot_be_are_refused(name):
    call, message = WRONG_SNAPSHOTS[name]
    with pytest.raises(cp.SceneError, match=message):
        call()


# --- modes --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spatial", [False, True])
def test_sines_are_modes_of_the_condensed_model(spatial):
    sines = cp.modes([np.sin(i * np.pi * SIGMA) for i in range(1, 10)], scene=scene(spatial))
    vibration = cp.condensed.vibration_modes(scene(spatial), rank=9, links=10)
    runs = [cp.condensed.simulate(scene(spatial), modes, step=1e-3) for modes in (sines, vibration)]
    # nine of either span all shapes of nine particles: the same model up to rounding, which a thousand steps let grow
    assert float(cp.compare.errors(*runs).error_max) < 1e-9
    assert all(np.isfinite(run.attrs["error_estimate"]) for run in runs)
    assert cp.pod.project(chain(spatial), sines).sizes["mode"] == 9
    assert set(sines.data_vars) >= {"mode_shape"} | ({"mode_shape_out_of_plane"} if spatial else set())


def test_shapes_are_orthonormal_and_span_what_was_given():
    uneven = np.linspace(0.0, 1.0, 11) ** 1.3
    given = np.array([uneven * (1.0 - uneven), -5.0 * uneven**2 * (1.0 - uneven), uneven**3 * (1.0 - uneven)])
    modes = cp.modes(given, arc_length=7.0 * uneven)
    weight = 0.5 * (np.diff(uneven)[1:] + np.diff(uneven)[:-1])
    shape = modes.mode_shape.values
    gram = (shape[:, 1:-1] * (weight / weight.mean())) @ shape[:, 1:-1].T
    np.testing.assert_allclose(gram, np.eye(3), atol=1e-14)  # rounding
    for count in (1, 2, 3):  # each with those before it
        fit = np.linalg.lstsq(shape[:count].T, given[count - 1], rcond=None)[0] @ shape[:count]
        np.testing.assert_allclose(fit, given[count - 1], atol=1e-14)
    assert np.sign(np.sum(shape[1] * given[1])) == 1.0  # no sign is turned
    run = cp.condensed.simulate(cp.make_scene(SOFT), modes, step=1e-3)
    scaled = cp.condensed.simulate(cp.make_scene(SOFT), cp.modes(1e3 * given, arc_length=7.0 * uneven), step=1e-3)
    np.testing.assert_allclose(run.position, scaled.position, rtol=1e-12)


@pytest.mark.parametrize("layout", ["separate", "vector"])
def test_shapes_are_modes_of_the_galerkin_model(layout):
    mine = cp.pod.decompose(chain(), rank=3, layout=layout)
    own = cp.modes(7.0 * mine.mode_shape, layout=layout, mean=mine["mean"])
    np.testing.assert_allclose(np.abs(own.mode_shape), np.abs(mine.mode_shape), atol=1e-12)
    runs = [cp.galerkin.simulate(scene(), modes, step=1e-3) for modes in (own, mine)]
    assert float(cp.compare.errors(*runs).error_max) < 1e-9  # the same space
    plain = cp.modes(mine.mode_shape.values, layout=layout, scene=scene())
    assert float(np.abs(plain["mean"]).max()) == 0.0


def test_two_sets_of_shapes_in_space():
    both = np.stack([SINES, SINES[::-1]])
    modes = cp.modes(both, scene=scene(True))
    np.testing.assert_allclose(modes.mode_shape_out_of_plane, modes.mode_shape[::-1], atol=1e-14)
    named = xr.DataArray(both, dims=("normal", "mode", "particle")).transpose("particle", "normal", "mode")
    xr.testing.assert_identical(cp.modes(named, scene=scene(True)).mode_shape, modes.mode_shape)


def test_modes_are_a_stage_with_a_hash(tmp_path):
    modes = cp.modes(SINES, scene=scene())
    stage = provenance.stages_of(modes)[-1]
    assert (stage["function"], stage["inputs"]) == ("modes", [scene().attrs["id"]])
    assert cp.modes(SINES[:2], scene=scene()).attrs["id"] != modes.attrs["id"]
    again = cp.archive.read(cp.archive.write(modes, tmp_path / "modes.nc"))
    runs = [cp.condensed.simulate(scene(), item, step=1e-3) for item in (modes, again)]
    xr.testing.assert_identical(*(run.drop_attrs(deep=False) for run in runs))


WRONG_MODES = {
    "labels": (
        lambda: cp.modes(cp.pod.decompose(chain(), layout="vector").mode_shape[..., ::-1], layout="vector", scene=scene()),
        r"shapes: coordinate: given \['y', 'x'\]; allowed: .*y upwards",
    ),
    "dimensions": (lambda: cp.modes(SINES[0], scene=scene()), r"shapes: given the shape \(11,\); allowed: an array"),
    "layout": (lambda: cp.modes(SINES, layout="Normal", scene=scene()), "layout: given 'Normal'"),
    "ends": (lambda: cp.modes(SINES + 1.0, scene=scene()), "shapes: given 'up to 1 at the ends.*zero at both ends"),
    "zero": (lambda: cp.modes(0.0 * SINES, scene=scene()), "shapes: given .*zero or a sum of those before it"),
    "sums": (lambda: cp.modes(SINES[[0, 1, 0]], scene=scene()), "shapes: given 'mode 3 that is zero or a sum"),
    "places": (lambda: cp.modes(SINES), "arc_length: given none with shapes of 11 particles; allowed: .* or scene="),
    "not finite": (lambda: cp.modes(np.where(SINES > 0.9, np.nan, SINES), scene=scene()), "shapes: given .*not finite"),
    "mean": (lambda: cp.modes(SINES, scene=scene(), mean=np.zeros((11, 2))), 'mean: .*allowed: none with layout "normal"'),
    "coordinates": (
        lambda: cp.modes(np.stack([SINES] * 3), layout="separate", scene=scene()), "shapes: given .*2 coordinates of the scene",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_MODES)
def test_shapes_that_cannot_be_are_refused(name):
    call, message = WRONG_MODES[name]
    with pytest.raises(cp.SceneError, match=message):
        call()


# --- the way there ------------------------------------------------------------------------------------------------------

FROM_HERE = {
    "decompose": (lambda: cp.pod.decompose(chain().position.values), "cp.snapshots(position, scene=scene)"),
    "decompose labelled": (lambda: cp.pod.decompose(chain().position), "cp.snapshots(position, scene=scene)"),
    "decompose some": (lambda: cp.pod.decompose([np.zeros((3, 4, 2))]), "cp.snapshots(position, scene=scene)"),
    "decompose own": (
        lambda: cp.pod.decompose(xr.Dataset({"position": (("time", "particle", "coordinate"), chain().position.values)})),
        "cp.snapshots(position, scene=scene)",
    ),
    "errors": (lambda: cp.compare.errors(chain(), chain().position.values), "cp.snapshots(position, scene=scene)"),
    "project": (lambda: cp.pod.project(chain().position.values, SINES), "cp.snapshots(position, scene=scene)"),
    "drawn": (lambda: cp.plots.snapshots(chain(), chain().position.values), "cp.snapshots(position, scene=scene)"),
    "condensed": (lambda: cp.condensed.simulate(scene(), SINES), "cp.modes(shapes, scene=scene)"),
    "prepare": (lambda: cp.condensed.prepare(scene(), SINES), "cp.modes(shapes, scene=scene)"),
    "galerkin": (lambda: cp.galerkin.simulate(scene(), SINES), 'cp.modes(shapes, layout="separate", scene=scene)'),
    "own modes": (
        lambda: cp.condensed.simulate(scene(), xr.Dataset({"mode_shape": (("mode", "particle"), SINES)})),
        "cp.modes(shapes, scene=scene)",
    ),
    "modes drawn": (lambda: cp.plots.modes(SINES), "cp.modes(shapes, scene=scene)"),
    "periodic": (lambda: cp.periodic.orbit(scene(), SINES), "cp.modes(shapes, scene=scene)"),
}  # fmt: skip


@pytest.mark.parametrize("name", FROM_HERE)
def test_arrays_are_refused_with_the_function_that_takes_them(name):
    call, function = FROM_HERE[name]
    with pytest.raises(cp.SceneError, match=f"; try: {re.escape(function)}"):
        call()


def test_a_result_of_the_package_is_not_taken_for_that_of_another():
    with pytest.raises(cp.SceneError) as error:
        cp.pod.decompose(cp.pod.decompose(chain(), rank=2))
    assert "cp.snapshots" not in str(error.value)
