"""Wind on a mast: its field, given fields and records, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import WIND, small, windy
from scene_files import put

import cablepod as cp
from cablepod.errors import SceneError


def blown(wind, **time):
    """The mast in another wind."""
    return small(lambda mapping: (windy(mapping), mapping.update(wind=wind), mapping["time"].update(time)))


def with_record(path, **time):
    """The mast in the wind of a record."""
    return blown({**WIND, "turbulence": {"record": str(path)}}, **time)


HALF = {"speed": 10.0, "direction": [1.0, 0.0, 0.0]}


@pytest.fixture(scope="module")
def scene():
    return small(windy)


@pytest.fixture(scope="module")
def field(scene):
    return cp.wind.field(scene)


def test_the_field_of_a_mast_depends_on_its_geometry_alone(scene, field):
    assert dict(field.sizes) == {"time": 41, "point": 17 + 3 * 9, "component": 3}
    assert field.guy.values.tolist() == [0] * 17 + [1] * 9 + [2] * 9 + [3] * 9
    np.testing.assert_allclose(field.position[-1], [0.0, 28.0, 0.0], atol=1e-12)
    tighter = cp.wind.field(small(lambda mapping: (windy(mapping), put(mapping, "guy.1.top_tension", 6000.0))))
    np.testing.assert_array_equal(tighter.wind, field.wind)
    other = cp.wind.field(scene, seed=4)
    assert float(abs(other.wind - field.wind).max()) > 1.0
    height = field.position[:17, 1]
    assert (np.diff(field.mean_wind[:17, 0]) > 0.0).all()
    np.testing.assert_allclose(height, np.linspace(0.0, 30.0, 17))


@pytest.mark.parametrize("kind", ["condensed", "chain", "catenary"])
def test_a_given_field_is_the_wind_of_the_scene(scene, field, kind):
    own, given = cp.mast.simulate(scene, guys=kind), cp.mast.simulate(scene, guys=kind, wind=field)
    np.testing.assert_allclose(given.guy_tension, own.guy_tension, rtol=1e-7)
    # without labels points belong to mast and guys by their places: the mast has the one of the guys' ends too
    bare = field.drop_vars(["guy", "relative_arc_length"])
    placed = cp.mast.simulate(scene, guys=kind, wind=bare)
    # the mean is then linear between its points, without the drag of the profile near the ground
    np.testing.assert_allclose(placed.guy_tension_std, own.guy_tension_std, rtol=1e-2)


def test_a_mast_starts_at_rest_in_the_mean_of_a_field(scene, field):
    steady = field.copy()
    steady["mean_wind"] = 0.5 * field.mean_wind
    steady["wind"] = (0.0 * field.wind + steady.mean_wind).transpose(*field.wind.dims)
    half = blown(HALF)
    expected = cp.mast.simulate(half)
    run = cp.mast.simulate(scene, wind=steady)
    assert float(np.ptp(run.displacement.values, axis=0).max()) < 1e-5 * float(abs(run.displacement).max())
    # a field is linear between its points, without the drag of the profile near the ground
    np.testing.assert_allclose(run.displacement[0], expected.displacement[0], rtol=5e-3, atol=1e-9)
    np.testing.assert_allclose(run.guy_tension[0], expected.guy_tension[0], rtol=1e-3)


def test_a_record_is_a_given_field(scene, field, tmp_path):
    cp.archive.write(field, tmp_path / "field.nc")
    kept = with_record(tmp_path / "field.nc")
    run, expected = cp.mast.simulate(kept), cp.mast.simulate(scene, wind=field)
    np.testing.assert_allclose(run.guy_tension, expected.guy_tension, rtol=1e-12)
    np.testing.assert_allclose(cp.wind.field(kept).wind, field.wind, atol=1e-9)
    with pytest.raises(SceneError, match=r"^wind\.turbulence\.record: .*too short"):
        with_record(tmp_path / "field.nc", duration=400.0)


def test_rest_with_a_record_is_in_the_mean_of_the_record(field, tmp_path):
    steady = field.assign(mean_wind=0.5 * field.mean_wind)
    steady["wind"] = (field.wind - 0.5 * field.mean_wind).transpose(*field.wind.dims)
    cp.archive.write(steady, tmp_path / "half.nc")
    kept = with_record(tmp_path / "half.nc")
    half = blown(HALF)
    with pytest.warns(UserWarning, match=r"^wind\.speed, .*the record is used"):
        rest = cp.mast.rest(kept)
    assert rest.attrs["air"] == "mean wind of the record"
    expected, run = cp.mast.rest(half), cp.mast.simulate(kept, times=[0.0, 0.04])
    # the field is linear between its points, without the drag of the profile near the ground
    np.testing.assert_allclose(rest.guy_tension, expected.guy_tension, rtol=2e-4)  # by wind.speed: 30 % less
    np.testing.assert_allclose(rest.displacement, expected.displacement, rtol=5e-3, atol=1e-9)
    np.testing.assert_array_equal(rest.displacement, run.displacement[0])
    np.testing.assert_array_equal(cp.summary(kept).guy_tension_mean_wind, rest.guy_tension)
    found, wanted = (cp.mast.frequencies(scene, count=4).angular_frequency for scene in (kept, half))
    np.testing.assert_allclose(found, wanted, rtol=1e-3)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda field: field.isel(point=slice(0, 17)), "guy 1"),
        (lambda field: field.isel(point=slice(17, None)), "the mast"),
        (lambda field: field.isel(time=slice(0, 9)), "too short"),
        (lambda field: field.drop_vars(["guy", "position"]), "without places"),
        (lambda field: field.assign_coords(guy=("point", field.guy.values + 0.5)), "whole numbers"),
        (lambda field: field.isel(component=slice(0, 2)), "components|numbers"),
        (lambda field: field.where(field.time > 0.5), "finite"),
        (lambda _: 3.0, "field"),
    ],
)
def test_other_fields_are_refused(scene, field, change, text):
    with pytest.raises(SceneError, match=rf"^wind: .*({text}).*"):
        cp.mast.simulate(scene, wind=change(field))


def test_a_record_of_two_instants_is_no_steady_one(field, tmp_path):
    two = field.isel(time=[0, -1]).drop_vars("mean_wind")
    two.to_netcdf(tmp_path / "two.nc")
    found = cp.wind.field(with_record(tmp_path / "two.nc"))
    np.testing.assert_allclose(found.wind.isel(time=[0, -1]), two.wind, rtol=1e-12)
